//! A WebSocket that has the latest of something that changes: frames of a formation, the state of a workbench.

use std::time::Duration;

use axum::body::Bytes;
use axum::extract::ws::{Message, Utf8Bytes, WebSocket};
use tokio::sync::watch;
use tokio::time::{Instant, sleep_until, timeout};

use crate::places::Place;

/// Its protocol. The token is another one that a browser may ask for.
pub const FRAMES: &str = "whorl";
/// A browser that takes nothing for this long is left.
pub const PATIENCE: Duration = Duration::from_secs(20);
/// A browser is asked so often whether it is there.
const ASK: Duration = Duration::from_secs(5);

/// Sends `past`, then each new `latest`; who is slow misses some, and nobody waits for it. Ends with the browser, with its place, or
/// with the one who changes it.
pub async fn states(
    mut socket: WebSocket,
    past: Vec<Utf8Bytes>,
    mut latest: watch::Receiver<Utf8Bytes>,
    place: Place,
) {
    for state in past {
        if !matches!(timeout(PATIENCE, socket.send(Message::Text(state))).await, Ok(Ok(()))) {
            return;
        }
    }
    let mut last_ping = Instant::now();
    let mut last_heard = last_ping;
    loop {
        if last_heard.elapsed() >= PATIENCE {
            return;
        }
        // Browsers answer by themselves.
        if last_ping.elapsed() >= ASK {
            last_ping = Instant::now();
            let sent = timeout(PATIENCE, socket.send(Message::Ping(Bytes::new()))).await;
            if !matches!(sent, Ok(Ok(()))) {
                return;
            }
        }
        tokio::select! {
            () = place.is_lost() => return,
            () = sleep_until(last_ping + ASK) => {}
            changed = latest.changed() => {
                let state = latest.borrow_and_update().clone();
                let sent = timeout(PATIENCE, socket.send(Message::Text(state))).await;
                if changed.is_err() || !matches!(sent, Ok(Ok(()))) {
                    return;
                }
            }
            received = socket.recv() => match received {
                Some(Ok(_)) => {
                    last_heard = Instant::now();
                    place.heard();
                }
                _ => return,
            }
        }
    }
}
