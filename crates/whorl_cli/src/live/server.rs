//! The web server of the live page: the page, a stream of frames, and three commands.

use std::net::SocketAddr;
use std::sync::{Arc, PoisonError};
use std::time::Duration;

use axum::Router;
use axum::body::Bytes;
use axum::extract::ws::{Message, Utf8Bytes, WebSocket, WebSocketUpgrade};
use axum::extract::{ConnectInfo, DefaultBodyLimit, Request, State};
use axum::http::header::{
    AUTHORIZATION, CACHE_CONTROL, CONNECTION, CONTENT_SECURITY_POLICY, HOST, ORIGIN, SEC_WEBSOCKET_PROTOCOL,
};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::middleware::{self, Next};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::{get, post};
use sha2::{Digest, Sha256};
use tokio::sync::watch;

use super::door::Visitor;
use super::foxglove::{self, Feed};
use super::places::{Place, Places};
use super::{PATIENCE, Past};
use crate::command::{request_abort, request_hold, request_start};

/// Where Foxglove connects.
const FOXGLOVE: &str = "/foxglove";
/// Browsers that are served at the same time, and as many clients of Foxglove.
pub const BROWSERS: usize = 32;
/// The protocol of the frames. A browser cannot send the token in a header when it opens a WebSocket, but names of protocols: the
/// token is one of those that it asks for.
const FRAMES: &str = "whorl";
/// A browser is asked so often whether it is there.
const ASK: Duration = Duration::from_secs(5);
/// Browsers send nothing but a name or a reason.
const LARGEST_REQUEST: usize = 1024;
/// Scripts and styles are in the page; nothing else may be loaded or called.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; connect-src 'self'; base-uri 'none'; \
                      form-action 'none'; frame-ancestors 'none'";

/// What the server needs.
pub struct Server {
    /// Where it listens.
    pub address: SocketAddr,
    /// Makes the page.
    pub page: Box<dyn Fn() -> String + Send + Sync>,
    /// The latest frame: a browser that is slow misses some, and nobody waits for it.
    pub frames: watch::Sender<Utf8Bytes>,
    /// Frames of the last minute, for a page that is opened in mid-run.
    pub past: Past,
    /// What a browser must know to command; `None`: nobody commands.
    pub token: Option<String>,
    /// Every topic, if it is served.
    pub foxglove: Option<Arc<Feed>>,
    /// Who watches the frames, and who has every topic.
    pub browsers: Arc<Places>,
    pub clients: Arc<Places>,
}

/// The routes.
pub fn routes(server: Arc<Server>) -> Router {
    Router::new()
        .route("/", get(page))
        .route("/frames", get(frames))
        .route(FOXGLOVE, get(foxglove))
        .route("/start", post(start))
        .route("/hold", post(hold))
        .route("/abort", post(abort))
        .layer(DefaultBodyLimit::max(LARGEST_REQUEST))
        .layer(middleware::from_fn_with_state(Arc::clone(&server), same_site))
        .with_state(server)
}

/// Refuses pages of other sites: those that call from the user's browser (by their origin), and those whose name was
/// made to point here (by the host they call).
async fn same_site(State(server): State<Arc<Server>>, request: Request, next: Next) -> Response {
    if let Some(ConnectInfo(visitor)) = request.extensions().get::<ConnectInfo<Visitor>>() {
        let is_operator =
            |token: &String| authorised(request.headers(), token) || asks_with(request.headers(), token);
        visitor.asks(server.token.as_ref().is_some_and(is_operator));
    }
    let from_anywhere = server.foxglove.is_some() && request.uri().path() == FOXGLOVE;
    let mut response = match refusal(server.address, request.headers(), from_anywhere) {
        Some(why) => (StatusCode::FORBIDDEN, why).into_response(),
        None => next.run(request).await,
    };
    // A request has a connection of its own, which has to end in time.
    if response.status() != StatusCode::SWITCHING_PROTOCOLS {
        response.headers_mut().insert(CONNECTION, HeaderValue::from_static("close"));
    }
    response
}

fn refusal(address: SocketAddr, headers: &HeaderMap, from_anywhere: bool) -> Option<&'static str> {
    let header = |name| headers.get(name).and_then(|v| v.to_str().ok());
    let host = header(HOST).unwrap_or_default();
    let named = host.rsplit_once(':').map_or(host, |(name, _)| name).trim_matches(['[', ']']);
    let is_address = named.parse::<std::net::IpAddr>().is_ok() || named == "localhost";
    if address.ip().is_loopback() && !is_address {
        return Some("call this page by its address\n");
    }
    let from_elsewhere = header(ORIGIN).is_some_and(|origin| origin.strip_prefix("http://") != Some(host));
    (from_elsewhere && !from_anywhere).then_some("another site's page may not read or command a formation\n")
}

async fn page(State(server): State<Arc<Server>>) -> Response {
    ([(CONTENT_SECURITY_POLICY, POLICY), (CACHE_CONTROL, "no-store")], Html((server.page)())).into_response()
}

async fn foxglove(
    State(server): State<Arc<Server>>,
    ConnectInfo(visitor): ConnectInfo<Visitor>,
    upgrade: WebSocketUpgrade,
) -> Response {
    match &server.foxglove {
        None => (StatusCode::NOT_FOUND, "start it with: whorl live --foxglove\n").into_response(),
        Some(feed) => {
            let feed = Arc::clone(feed);
            let Some(place) = server.clients.take(false) else { return all_taken() };
            upgrade.protocols(foxglove::PROTOCOLS).max_message_size(foxglove::LARGEST_REQUEST).on_upgrade(
                move |socket| {
                    visitor.upgraded();
                    foxglove::serve(socket, feed, place)
                },
            )
        }
    }
}

fn all_taken() -> Response {
    (StatusCode::SERVICE_UNAVAILABLE, format!("{BROWSERS} are served already\n")).into_response()
}

async fn frames(
    State(server): State<Arc<Server>>,
    ConnectInfo(visitor): ConnectInfo<Visitor>,
    headers: HeaderMap,
    upgrade: WebSocketUpgrade,
) -> Response {
    let operator = server.token.as_ref().is_some_and(|token| asks_with(&headers, token));
    let Some(place) = server.browsers.take(operator) else { return all_taken() };
    let receiver = server.frames.subscribe();
    let past = Arc::clone(&server.past);
    upgrade.protocols([FRAMES]).max_message_size(LARGEST_REQUEST).on_upgrade(move |socket| {
        visitor.upgraded();
        stream(socket, past, receiver, place)
    })
}

/// Whether the token is among the protocols that are asked for.
fn asks_with(headers: &HeaderMap, token: &str) -> bool {
    let asked = headers.get_all(SEC_WEBSOCKET_PROTOCOL).iter().filter_map(|value| value.to_str().ok());
    let digest = Sha256::digest(token);
    asked.flat_map(|value| value.split(',')).any(|name| Sha256::digest(name.trim()) == digest)
}

async fn stream(mut socket: WebSocket, past: Past, mut frames: watch::Receiver<Utf8Bytes>, place: Place) {
    let past: Vec<Utf8Bytes> = past.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned().collect();
    for frame in past {
        if !matches!(tokio::time::timeout(PATIENCE, socket.send(Message::Text(frame))).await, Ok(Ok(()))) {
            return;
        }
    }
    let mut last_ping = tokio::time::Instant::now();
    let mut last_heard = last_ping;
    loop {
        if last_heard.elapsed() >= PATIENCE {
            return;
        }
        // Browsers answer by themselves.
        if last_ping.elapsed() >= ASK {
            last_ping = tokio::time::Instant::now();
            let sent = tokio::time::timeout(PATIENCE, socket.send(Message::Ping(Bytes::new()))).await;
            if !matches!(sent, Ok(Ok(()))) {
                return;
            }
        }
        tokio::select! {
            () = place.is_lost() => return,
            () = tokio::time::sleep_until(last_ping + ASK) => {}
            changed = frames.changed() => {
                let frame = frames.borrow_and_update().clone();
                let sent = tokio::time::timeout(PATIENCE, socket.send(Message::Text(frame))).await;
                if changed.is_err() || !matches!(sent, Ok(Ok(()))) {
                    return;
                }
            }
            received = socket.recv() => match received {
                Some(Ok(_)) => {
                    last_heard = tokio::time::Instant::now();
                    place.heard();
                }
                _ => return,
            }
        }
    }
}

async fn start(State(server): State<Arc<Server>>, headers: HeaderMap, name: String) -> Response {
    command(&server, &headers, move || request_start(name)).await
}

async fn hold(State(server): State<Arc<Server>>, headers: HeaderMap, reason: String) -> Response {
    let reason = if reason.is_empty() { "by the live page".to_owned() } else { reason };
    command(&server, &headers, move || request_hold(reason)).await
}

async fn abort(State(server): State<Arc<Server>>, headers: HeaderMap, reason: String) -> Response {
    let reason = if reason.is_empty() { "by the live page".to_owned() } else { reason };
    command(&server, &headers, move || request_abort(reason)).await
}

async fn command(
    server: &Server,
    headers: &HeaderMap,
    call: impl FnOnce() -> anyhow::Result<String> + Send + 'static,
) -> Response {
    if !server.token.as_ref().is_some_and(|token| authorised(headers, token)) {
        let why = "commands need the token of the address that whorl live printed; without it the page is read-only\n";
        return (StatusCode::UNAUTHORIZED, why).into_response();
    }
    // The coordinator may take seconds to answer; frames go on meanwhile.
    match tokio::task::spawn_blocking(call).await {
        Ok(Ok(said)) => said.into_response(),
        Ok(Err(error)) => (StatusCode::CONFLICT, whorl_commands::in_words(&error)).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, error.to_string()).into_response(),
    }
}

/// Compares digests, so that the time it takes tells nothing of the token.
fn authorised(headers: &HeaderMap, token: &str) -> bool {
    let given =
        headers.get(AUTHORIZATION).and_then(|v| v.to_str().ok()).and_then(|v| v.strip_prefix("Bearer "));
    given.is_some_and(|given| Sha256::digest(given) == Sha256::digest(token))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(list: &[(&'static str, &str)]) -> HeaderMap {
        list.iter().map(|(name, value)| (name.parse().unwrap(), value.parse().unwrap())).collect()
    }

    #[test]
    fn pages_of_other_sites_are_refused() {
        let here: SocketAddr = "127.0.0.1:8470".parse().unwrap();
        let refused = |list: &[(&'static str, &str)]| refusal(here, &headers(list), false).is_some();
        assert!(!refused(&[("host", "127.0.0.1:8470")]));
        assert!(!refused(&[("host", "localhost:8470"), ("origin", "http://localhost:8470")]));
        assert!(refused(&[("host", "127.0.0.1:8470"), ("origin", "https://example.org")]));
        assert!(refused(&[("host", "127.0.0.1:8470"), ("origin", "http://127.0.0.1:80")]));
        assert!(refused(&[("host", "rebound.example.org:8470")]), "a name that was made to point here");
        let app = headers(&[("host", "localhost:8470"), ("origin", "https://app.example.org")]);
        assert!(refusal(here, &app, true).is_none(), "what is served to apps of other sites");
        assert!(refusal(here, &headers(&[("host", "rebound.example.org:8470")]), true).is_some());
    }

    #[test]
    fn an_operator_asks_with_the_token() {
        let asked = |value: &str| asks_with(&headers(&[("sec-websocket-protocol", value)]), "0a1b");
        assert!(asked("whorl, 0a1b") && asked("0a1b"));
        assert!(!asked("whorl") && !asked("whorl, 0a1c") && !asked(""));
        assert!(!asks_with(&HeaderMap::new(), "0a1b"));
    }

    #[test]
    fn only_the_token_commands() {
        assert!(authorised(&headers(&[("authorization", "Bearer abc")]), "abc"));
        assert!(!authorised(&headers(&[("authorization", "Bearer abd")]), "abc"));
        assert!(!authorised(&headers(&[("authorization", "abc")]), "abc"));
        assert!(!authorised(&HeaderMap::new(), "abc"));
    }
}
