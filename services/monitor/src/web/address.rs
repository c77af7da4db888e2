//! Where the page is served, and who may ask for it there.

use core::fmt;
use std::io::ErrorKind;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Port unless told otherwise; the next free one is taken when something listens there already.
const USUAL_PORT: u16 = 8088;

/// Ports that are tried.
const TRIES: u16 = 100;

/// Shorter tokens can be guessed.
const SHORTEST_TOKEN: usize = 16;

/// Where to serve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WebAddress {
    /// On the loopback interface, at 8088 or the next free port.
    Auto,
    /// There and nowhere else.
    At(SocketAddr),
}

impl FromStr for WebAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<WebAddress, String> {
        let loopback = IpAddr::V4(Ipv4Addr::LOCALHOST);
        let port_only = text.strip_prefix("localhost:").or(text.strip_prefix(':')).unwrap_or(text);
        if text == "auto" {
            Ok(WebAddress::Auto)
        } else if let Ok(port) = port_only.parse() {
            Ok(WebAddress::At(SocketAddr::new(loopback, port)))
        } else if let Ok(address) = text.parse() {
            Ok(WebAddress::At(address))
        } else {
            Err("expected a port, or an address and a port such as 127.0.0.1:8088 or [::1]:8088".to_owned())
        }
    }
}

impl fmt::Display for WebAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            WebAddress::Auto => f.write_str("auto"),
            WebAddress::At(address) => address.fmt(f),
        }
    }
}

/// The command line's share of the page.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct WebArgs {
    /// Serve a page for a browser: at 8088 of the loopback interface or the next free port, or exactly where told.
    #[arg(long, value_name = "ADDR:PORT", num_args = 0..=1, default_missing_value = "auto")]
    pub web: Option<WebAddress>,
    /// File whose first line everybody who asks for the page must know (http://ADDR:PORT/?token=...). Needed beyond the
    /// loopback interface.
    #[arg(long, value_name = "FILE")]
    pub web_token: Option<PathBuf>,
}

/// Why the page cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum WebError {
    /// The port is taken.
    #[error(
        "the page cannot be served at {address}: something listens there already (choose another with `--web ADDR:PORT`, or leave the address out for the next free port)"
    )]
    InUse {
        /// Where.
        address: SocketAddr,
    },
    /// No free port.
    #[error("no port from {first} to {last} is free for the page (name one with `--web ADDR:PORT`)")]
    NoFreePort {
        /// First that was tried.
        first: u16,
        /// Last that was tried.
        last: u16,
    },
    /// Not an address of this machine, a privileged port, ...
    #[error("the page cannot be served at {address}")]
    Bind {
        /// Where.
        address: SocketAddr,
        /// Why.
        source: std::io::Error,
    },
    /// Anybody on the network could look.
    #[error(
        "{address} can be reached from other machines: give `--web-token FILE` with a secret of {SHORTEST_TOKEN} characters or more in it, or serve at 127.0.0.1"
    )]
    NeedsToken {
        /// Where.
        address: SocketAddr,
    },
    /// A token that cannot be read.
    #[error("{}: cannot read the token", file.display())]
    TokenFile {
        /// Which file.
        file: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A token that is easily guessed, or that a link cannot hold.
    #[error("{}: its first line is no token: {SHORTEST_TOKEN} letters, digits, `-` or `_` at least (`openssl rand -hex 16` makes one)", file.display())]
    BadToken {
        /// Which file.
        file: PathBuf,
    },
    /// No thread for it.
    #[error("the page's thread cannot be started")]
    Thread(#[source] std::io::Error),
}

/// Listens where the arguments say, and knows whom to answer.
///
/// # Errors
/// [`WebError`]; asked for at all, the page is served or an error says why not.
pub fn listen(address: WebAddress, token: Option<&Path>) -> Result<(TcpListener, Option<String>), WebError> {
    let token = token.map(read_token).transpose()?;
    let listener = match address {
        WebAddress::At(address) => {
            if !address.ip().is_loopback() && token.is_none() {
                return Err(WebError::NeedsToken { address });
            }
            bind(address)?
        }
        WebAddress::Auto => next_free()?,
    };
    Ok((listener, token))
}

fn next_free() -> Result<TcpListener, WebError> {
    let last = USUAL_PORT + TRIES - 1;
    for port in USUAL_PORT..=last {
        match bind(SocketAddr::new(Ipv4Addr::LOCALHOST.into(), port)) {
            Err(WebError::InUse { .. }) => {}
            listener => return listener,
        }
    }
    Err(WebError::NoFreePort { first: USUAL_PORT, last })
}

fn bind(address: SocketAddr) -> Result<TcpListener, WebError> {
    TcpListener::bind(address).map_err(|source| match source.kind() {
        ErrorKind::AddrInUse => WebError::InUse { address },
        _ => WebError::Bind { address, source },
    })
}

fn read_token(file: &Path) -> Result<String, WebError> {
    let text = std::fs::read_to_string(file).map_err(|source| WebError::TokenFile { file: file.to_owned(), source })?;
    let token = text.lines().next().unwrap_or_default().trim();
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_');
    if token.len() < SHORTEST_TOKEN || !token.bytes().all(is_plain) {
        return Err(WebError::BadToken { file: file.to_owned() });
    }
    Ok(token.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_alone_means_the_loopback_interface() {
        for text in ["9000", ":9000", "localhost:9000", "127.0.0.1:9000"] {
            assert_eq!(text.parse(), Ok(WebAddress::At("127.0.0.1:9000".parse().expect("an address"))), "{text}");
        }
        assert_eq!("[::1]:80".parse(), Ok(WebAddress::At("[::1]:80".parse().expect("an address"))));
        for text in ["", "nine", "127.0.0.1", "70000", "example.org:80"] {
            assert!(text.parse::<WebAddress>().is_err(), "{text:?}");
        }
    }

    #[test]
    fn a_port_in_use_is_named_with_the_mend_and_the_next_free_one_is_found() {
        let (first, _) = listen(WebAddress::Auto, None).expect("one of a hundred is free");
        let address = first.local_addr().expect("bound");
        let error = listen(WebAddress::At(address), None).expect_err("in use").to_string();
        assert!(error.contains(&address.to_string()) && error.contains("--web ADDR:PORT"), "{error}");
        let (second, _) = listen(WebAddress::Auto, None).expect("another one is free");
        assert!(second.local_addr().expect("bound").port() > address.port());
    }

    #[test]
    fn beyond_the_loopback_interface_a_token_is_needed_and_must_be_one() {
        let everywhere = WebAddress::At("0.0.0.0:0".parse().expect("an address"));
        let error = listen(everywhere, None).expect_err("no token").to_string();
        assert!(error.contains("--web-token"), "{error}");
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("token");
        for bad in ["", "short", "with spaces in its middle", "ünicode-ünicode-ünicode"] {
            std::fs::write(&file, bad).expect("writable");
            assert!(matches!(listen(everywhere, Some(&file)), Err(WebError::BadToken { .. })), "{bad}");
        }
        std::fs::write(&file, "0123456789abcdef\n").expect("writable");
        let (_, token) = listen(everywhere, Some(&file)).expect("a token");
        assert_eq!(token.as_deref(), Some("0123456789abcdef"));
        assert!(listen(everywhere, Some(&folder.path().join("none"))).is_err());
    }
}
