//! What can be asked for. Nothing else exists, and nothing can be changed.

use std::convert::Infallible;
use std::sync::Arc;

use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::{Path, Request, State};
use axum::http::header::{
    ALLOW, CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HeaderName, REFERRER_POLICY, SET_COOKIE,
    X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderValue, StatusCode};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use futures_util::stream;
use tokio::sync::broadcast::error::RecvError;

use super::guard::{COOKIE_NAME, Guard, Refusal, Welcome};
use super::hub::Hub;
use super::{assets, metrics};

/// Everything comes from here, and nobody may put the page into a frame.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src data:; \
    base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

type Shared = State<Arc<Hub>>;

/// The table of paths.
pub(super) fn router(hub: Arc<Hub>, guard: Guard) -> Router {
    Router::new()
        .route("/", get(page))
        .route("/assets/{name}", get(asset))
        .route("/healthz", get(health))
        .route("/metrics", get(metrics))
        .route("/api/v1/stream", get(stream_events))
        .route("/api/v1/history", get(history))
        .route("/api/v1/snapshot", get(snapshot))
        .fallback(nothing_here)
        .layer(from_fn_with_state(Arc::new(guard), admit))
        .with_state(hub)
}

/// Judges a request before anything else looks at it, and tells the browser what the answer may do.
async fn admit(State(guard): State<Arc<Guard>>, request: Request, next: Next) -> Response {
    let mut response = match guard.judge(request.method(), request.uri(), request.headers()) {
        Err(refusal) => refused(refusal),
        Ok(Welcome::Known) => next.run(request).await,
        Ok(Welcome::ByLink) => {
            let mut response = next.run(request).await;
            let token = guard.token.as_deref().unwrap_or_default();
            let cookie = format!("{COOKIE_NAME}={token}; Path=/; HttpOnly; SameSite=Strict");
            if let Ok(cookie) = HeaderValue::from_str(&cookie) {
                response.headers_mut().insert(SET_COOKIE, cookie);
            }
            response
        }
    };
    let headers = response.headers_mut();
    for (name, value) in [
        (CONTENT_SECURITY_POLICY, POLICY),
        (X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (REFERRER_POLICY, "no-referrer"),
        (CACHE_CONTROL, "no-store"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}

fn refused(refusal: Refusal) -> Response {
    let mut response = (refusal.status, text(), format!("{}\n", refusal.why)).into_response();
    if refusal.status == StatusCode::METHOD_NOT_ALLOWED {
        response.headers_mut().insert(ALLOW, HeaderValue::from_static("GET, HEAD"));
    }
    response
}

fn of_type(mime: &'static str) -> [(HeaderName, &'static str); 1] {
    [(CONTENT_TYPE, mime)]
}

fn text() -> [(HeaderName, &'static str); 1] {
    of_type("text/plain; charset=utf-8")
}

async fn page() -> Response {
    (of_type("text/html; charset=utf-8"), assets::PAGE).into_response()
}

async fn asset(Path(name): Path<String>) -> Response {
    match assets::find(&name) {
        Some(asset) => (of_type(asset.mime), asset.text).into_response(),
        None => nothing_here().await,
    }
}

async fn nothing_here() -> Response {
    let paths =
        "there is nothing here; there are / /healthz /metrics /api/v1/stream /api/v1/history /api/v1/snapshot\n";
    (StatusCode::NOT_FOUND, text(), paths).into_response()
}

async fn health(State(hub): Shared) -> Response {
    if hub.is_alive() {
        (text(), "ok\n").into_response()
    } else {
        (StatusCode::SERVICE_UNAVAILABLE, text(), "the monitor has not looked at its channels for 3 s\n")
            .into_response()
    }
}

async fn metrics(State(hub): Shared) -> Response {
    (of_type("text/plain; version=0.0.4; charset=utf-8"), metrics::render(&hub.newest())).into_response()
}

async fn snapshot(State(hub): Shared) -> Response {
    match serde_json::to_string(&*hub.newest()) {
        Ok(json) => (of_type("application/json"), json).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, text(), format!("{error}\n")).into_response(),
    }
}

async fn history(State(hub): Shared) -> Response {
    (of_type("application/json"), hub.history()).into_response()
}

async fn stream_events(State(hub): Shared) -> Response {
    if !hub.is_live() {
        return (StatusCode::NOT_FOUND, text(), "a finished run has no stream; its whole is at /api/v1/history\n")
            .into_response();
    }
    let (events, first) = hub.listen();
    let rest = stream::unfold(events, |mut events| async move {
        match events.recv().await {
            Ok(event) => Some((event, events)),
            // It was too slow: the page then asks for the history again.
            Err(RecvError::Lagged(missed)) => {
                Some((Bytes::from(format!("event: lagged\ndata: {{\"missed\":{missed}}}\n\n")), events))
            }
            Err(RecvError::Closed) => None,
        }
    });
    let whole = futures_util::StreamExt::chain(stream::once(async { first }), rest);
    let body = Body::from_stream(futures_util::StreamExt::map(whole, Ok::<Bytes, Infallible>));
    (of_type("text/event-stream"), body).into_response()
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
