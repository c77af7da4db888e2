//! The paths as a client meets them, without a socket.

use axum::body::to_bytes;
use axum::http::{Method, Request};
use tower::ServiceExt;

use super::*;
use crate::testing::mission_under_way;

fn block_on<T>(future: impl Future<Output = T>) -> T {
    tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime").block_on(future)
}

fn app(token: Option<&str>) -> Router {
    let hub = Hub::live(mission_under_way().snapshot());
    router(Arc::new(hub), Guard { token: token.map(str::to_owned) })
}

fn ask(method: Method, path: &str) -> Request<Body> {
    Request::builder().method(method).uri(path).header("host", "localhost:8088").body(Body::empty()).expect("a request")
}

/// Status, content type and text of an answer.
fn answer(app: Router, request: Request<Body>) -> (u16, String, String) {
    block_on(async {
        let response = app.oneshot(request).await.expect("a router does not fail");
        let mime = response.headers().get(CONTENT_TYPE).map_or("", |mime| mime.to_str().expect("text")).to_owned();
        let status = response.status().as_u16();
        let body = to_bytes(response.into_body(), 1 << 24).await.expect("an end");
        (status, mime, String::from_utf8(body.to_vec()).expect("text"))
    })
}

#[test]
fn every_path_answers_in_its_own_format() {
    for (path, expected_mime, part) in [
        ("/", "text/html; charset=utf-8", "<!doctype html>"),
        ("/assets/main.js", "text/javascript; charset=utf-8", "EventSource"),
        ("/assets/style.css", "text/css; charset=utf-8", "prefers-color-scheme"),
        ("/healthz", "text/plain; charset=utf-8", "ok"),
        ("/metrics", "text/plain; version=0.0.4; charset=utf-8", "ilns_mode{set=\"main\",mode=\"OK\"} 1"),
        ("/api/v1/snapshot", "application/json", "\"mode\":\"OK\""),
        ("/api/v1/history", "application/json", "\"kind\":\"live\""),
    ] {
        let (status, mime, text) = answer(app(None), ask(Method::GET, path));
        assert_eq!((status, mime.as_str()), (200, expected_mime), "{path}");
        assert!(text.contains(part), "{path}: {text:.200}");
        let (status, mime, text) = answer(app(None), ask(Method::HEAD, path));
        assert_eq!((status, mime.as_str(), text.as_str()), (200, expected_mime, ""), "HEAD {path}");
    }
}

#[test]
fn what_does_not_exist_is_404_whatever_its_spelling() {
    for path in [
        "/nothing",
        "/api/v2/stream",
        "/assets/",
        "/assets/none.js",
        "/assets/../Cargo.toml",
        "/assets/..%2f..%2fetc%2fpasswd",
        "/assets/%2e%2e/%2e%2e/etc/passwd",
        "//etc/passwd",
        "/api/v1/history/",
        "/assets/style.css%00",
        "/%ff%fe",
    ] {
        let (status, _, text) = answer(app(None), ask(Method::GET, path));
        assert!(status == 404 || status == 400, "{path}: {status}");
        assert!(!text.contains("root:") && !text.contains("[package]"), "{path}: {text}");
    }
}

#[test]
fn nothing_can_be_changed_on_any_path() {
    for path in ["/", "/api/v1/history", "/api/v1/stream", "/nothing"] {
        for method in [Method::POST, Method::PUT, Method::DELETE, Method::PATCH, Method::OPTIONS, Method::TRACE] {
            let (status, _, text) = answer(app(None), ask(method.clone(), path));
            assert_eq!(status, 405, "{method} {path}");
            assert!(text.contains("GET and HEAD"), "{text}");
        }
    }
}

#[test]
fn a_foreign_host_is_refused_and_a_token_admits_it() {
    let foreign = || Request::builder().uri("/api/v1/snapshot").header("host", "evil.example");
    let (status, _, text) = answer(app(None), foreign().body(Body::empty()).expect("a request"));
    assert_eq!(status, 403, "{text}");
    let token = "0123456789abcdef";
    let (status, _, _) = answer(app(Some(token)), foreign().body(Body::empty()).expect("a request"));
    assert_eq!(status, 401);
    let with_token = foreign().header("authorization", format!("Bearer {token}")).body(Body::empty());
    assert_eq!(answer(app(Some(token)), with_token.expect("a request")).0, 200);
}

#[test]
fn a_link_with_the_token_leaves_it_with_the_browser_and_every_answer_is_locked_down() {
    let response = block_on(app(Some("0123456789abcdef")).oneshot(ask(Method::GET, "/?token=0123456789abcdef")));
    let response = response.expect("a router does not fail");
    let header = |name: HeaderName| response.headers()[name].to_str().expect("text").to_owned();
    assert_eq!(header(SET_COOKIE), "ilns_token=0123456789abcdef; Path=/; HttpOnly; SameSite=Strict");
    assert!(header(CONTENT_SECURITY_POLICY).contains("default-src 'none'"));
    assert_eq!(header(X_CONTENT_TYPE_OPTIONS), "nosniff");
}

#[test]
fn a_finished_run_has_its_history_and_no_stream() {
    let hub = Hub::finished("{\"kind\":\"finished\"}".to_owned(), mission_under_way().snapshot());
    let app = router(Arc::new(hub), Guard { token: None });
    assert_eq!(answer(app.clone(), ask(Method::GET, "/api/v1/history")).2, "{\"kind\":\"finished\"}");
    assert_eq!(answer(app.clone(), ask(Method::GET, "/api/v1/stream")).0, 404);
    assert_eq!(answer(app, ask(Method::GET, "/healthz")).0, 200);
}
