//! The web server of the live page: the page, a stream of frames, and three commands.

use std::sync::{Arc, PoisonError};

use axum::Router;
use axum::extract::ws::{Utf8Bytes, WebSocketUpgrade};
use axum::extract::{ConnectInfo, DefaultBodyLimit, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_SECURITY_POLICY};
use axum::http::{HeaderMap, StatusCode};
use axum::middleware;
use axum::response::{Html, IntoResponse, Response};
use axum::routing::{get, post};
use tokio::sync::watch;
use whorl_serving::token::authorised;
use whorl_serving::{FRAMES, Places, Site, Visitor, same_site, states};

use super::Past;
use super::foxglove::{self, Feed};
use crate::command::{request_abort, request_hold, request_start};

/// Where Foxglove connects.
pub const FOXGLOVE: &str = "/foxglove";
/// Browsers that are served at the same time, and as many clients of Foxglove.
pub const BROWSERS: usize = 32;
/// Browsers send nothing but a name or a reason.
const LARGEST_REQUEST: usize = 1024;
/// Scripts and styles are in the page; nothing else may be loaded or called.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; connect-src 'self'; base-uri 'none'; \
                      form-action 'none'; frame-ancestors 'none'";

/// What the server needs.
pub struct Server {
    /// Where it is, and who may command.
    pub site: Arc<Site>,
    /// Makes the page.
    pub page: Box<dyn Fn() -> String + Send + Sync>,
    /// The latest frame: a browser that is slow misses some, and nobody waits for it.
    pub frames: watch::Sender<Utf8Bytes>,
    /// Frames of the last minute, for a page that is opened in mid-run.
    pub past: Past,
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
        .layer(middleware::from_fn_with_state(Arc::clone(&server.site), same_site))
        .with_state(server)
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
    let Some(place) = server.browsers.take(server.site.knows(&headers)) else { return all_taken() };
    let receiver = server.frames.subscribe();
    let past = server.past.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned().collect();
    upgrade.protocols([FRAMES]).max_message_size(LARGEST_REQUEST).on_upgrade(move |socket| {
        visitor.upgraded();
        states(socket, past, receiver, place)
    })
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
    if !server.site.token.as_ref().is_some_and(|token| authorised(headers, token)) {
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
