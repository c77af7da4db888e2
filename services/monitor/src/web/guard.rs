//! Who is answered: a pure judgement of a request's head.
//!
//! - Nothing can be changed: GET and HEAD only.
//! - A page of another site cannot look through the user's browser (DNS rebinding): without a token the host asked for must
//!   be this machine's own name for itself. With a token, that is what counts.

use axum::http::header::{AUTHORIZATION, COOKIE, HOST};
use axum::http::{HeaderMap, Method, StatusCode, Uri};

/// Under which the browser keeps the token.
pub(super) const COOKIE_NAME: &str = "ilns_token";

/// Whom to answer.
#[derive(Clone, Debug)]
pub(super) struct Guard {
    /// What everybody must know; none on the loopback interface unless asked for.
    pub(super) token: Option<String>,
}

/// A request that is not answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Refusal {
    pub(super) status: StatusCode,
    pub(super) why: &'static str,
}

/// A request that is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Welcome {
    /// Answer.
    Known,
    /// Answer, and have the browser keep the token that came with the link.
    ByLink,
}

impl Guard {
    /// Judges a request by its head.
    pub(super) fn judge(&self, method: &Method, uri: &Uri, headers: &HeaderMap) -> Result<Welcome, Refusal> {
        if method != Method::GET && method != Method::HEAD {
            let why = "only GET and HEAD: nothing can be changed here";
            return Err(Refusal { status: StatusCode::METHOD_NOT_ALLOWED, why });
        }
        let host = headers.get(HOST).and_then(|host| host.to_str().ok());
        let Some(host) = host.filter(|_| headers.get_all(HOST).iter().count() == 1) else {
            return Err(Refusal { status: StatusCode::BAD_REQUEST, why: "one Host header is needed" });
        };
        match &self.token {
            None if is_own_name(host) => Ok(Welcome::Known),
            None => {
                let why = "this page is served to localhost, 127.0.0.1 and [::1] only (a token admits other names: --web-token)";
                Err(Refusal { status: StatusCode::FORBIDDEN, why })
            }
            Some(token) if from_query(uri).is_some_and(|given| is_same(given, token)) => Ok(Welcome::ByLink),
            Some(token) if from_headers(headers).any(|given| is_same(given, token)) => Ok(Welcome::Known),
            Some(_) => {
                let why = "a token is needed: open http://ADDR:PORT/?token=..., or send `Authorization: Bearer ...`";
                Err(Refusal { status: StatusCode::UNAUTHORIZED, why })
            }
        }
    }
}

/// A name that leads to this machine whoever is asked.
fn is_own_name(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if !port.is_empty() && port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    };
    name.eq_ignore_ascii_case("localhost") || name == "127.0.0.1" || name == "[::1]"
}

fn from_query(uri: &Uri) -> Option<&str> {
    uri.query()?.split('&').find_map(|pair| pair.strip_prefix("token="))
}

fn from_headers(headers: &HeaderMap) -> impl Iterator<Item = &str> {
    let texts = |name| headers.get_all(name).into_iter().filter_map(|value| value.to_str().ok());
    let bearer = texts(AUTHORIZATION).filter_map(|value| value.strip_prefix("Bearer "));
    let cookies = texts(COOKIE).flat_map(|value| value.split(';'));
    bearer.chain(cookies.filter_map(|pair| pair.trim().strip_prefix(COOKIE_NAME)?.strip_prefix('=')))
}

/// Takes the same time wherever they differ.
fn is_same(given: &str, token: &str) -> bool {
    let difference = given.bytes().zip(token.bytes()).fold(0, |sum, (a, b)| sum | (a ^ b));
    given.len() == token.len() && difference == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judge(
        guard: &Guard,
        method: Method,
        uri: &str,
        headers: &[(&'static str, &'static str)],
    ) -> Result<Welcome, u16> {
        let mut map = HeaderMap::new();
        headers.iter().for_each(|&(name, value)| {
            map.append(name, value.parse().expect("a header"));
        });
        guard.judge(&method, &uri.parse().expect("a path"), &map).map_err(|refusal| refusal.status.as_u16())
    }

    #[test]
    fn without_a_token_only_this_machine_is_answered() {
        let guard = Guard { token: None };
        for host in ["localhost", "localhost:8088", "LocalHost:1", "127.0.0.1:8088", "[::1]:8088", "[::1]"] {
            assert_eq!(judge(&guard, Method::GET, "/", &[("host", host)]), Ok(Welcome::Known), "{host}");
        }
        for host in
            ["evil.example", "localhost.evil.example", "127.0.0.1.evil.example:8088", "10.0.0.1", "", "localhost:"]
        {
            assert_eq!(judge(&guard, Method::GET, "/", &[("host", host)]), Err(403), "{host}");
        }
        assert_eq!(judge(&guard, Method::GET, "/", &[]), Err(400));
        assert_eq!(judge(&guard, Method::GET, "/", &[("host", "localhost"), ("host", "localhost")]), Err(400));
    }

    #[test]
    fn nothing_can_be_changed() {
        let guard = Guard { token: None };
        for method in [Method::POST, Method::PUT, Method::DELETE, Method::PATCH, Method::OPTIONS, Method::CONNECT] {
            assert_eq!(judge(&guard, method.clone(), "/", &[("host", "localhost")]), Err(405), "{method}");
        }
        assert_eq!(judge(&guard, Method::HEAD, "/", &[("host", "localhost")]), Ok(Welcome::Known));
    }

    #[test]
    fn a_token_comes_with_the_link_the_cookie_or_the_header() {
        let guard = Guard { token: Some("0123456789abcdef".to_owned()) };
        let host = ("host", "boat:8088");
        assert_eq!(judge(&guard, Method::GET, "/?a=1&token=0123456789abcdef", &[host]), Ok(Welcome::ByLink));
        for headers in [("cookie", "x=1; ilns_token=0123456789abcdef"), ("authorization", "Bearer 0123456789abcdef")] {
            assert_eq!(judge(&guard, Method::GET, "/", &[host, headers]), Ok(Welcome::Known));
        }
        let wrong = [("cookie", "ilns_token=0123456789abcdeX"), ("authorization", "Bearer 0123"), ("cookie", "a")];
        for headers in wrong {
            assert_eq!(judge(&guard, Method::GET, "/?token=", &[host, headers]), Err(401), "{headers:?}");
        }
    }
}
