//! Who may call: pages of this address, and nobody else's.

use std::net::SocketAddr;
use std::sync::Arc;

use axum::extract::{ConnectInfo, Request, State};
use axum::http::header::{CONNECTION, HOST, ORIGIN};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::door::Visitor;
use crate::token::{asks_with, authorised};

/// A site: its address, and what a browser must know to command.
#[derive(Debug)]
pub struct Site {
    /// Where it listens.
    pub address: SocketAddr,
    /// `None`: nobody commands.
    pub token: Option<String>,
    /// Path that apps of other sites may call, too.
    pub for_anybody: Option<&'static str>,
}

impl Site {
    /// Whether a request has the token, in its header or among the protocols that it asks for.
    #[must_use]
    pub fn knows(&self, headers: &HeaderMap) -> bool {
        self.token.as_ref().is_some_and(|token| authorised(headers, token) || asks_with(headers, token))
    }
}

/// Refuses pages of other sites: those that call from the user's browser (by their origin), and those whose name was
/// made to point here (by the host they call).
pub async fn same_site(State(site): State<Arc<Site>>, request: Request, next: Next) -> Response {
    if let Some(ConnectInfo(visitor)) = request.extensions().get::<ConnectInfo<Visitor>>() {
        visitor.asks(site.knows(request.headers()));
    }
    let from_anywhere = site.for_anybody == Some(request.uri().path());
    let mut response = match refusal(site.address, request.headers(), from_anywhere) {
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
    (from_elsewhere && !from_anywhere).then_some("another site's page may not read or command this one\n")
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
}
