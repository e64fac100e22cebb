//! The door of a page: what a stranger may send, and for how long, before anything is read of it, and how many may stand
//! in it. Without these bounds a thousand half requests would take all memory that a page may have.

use std::io::{self, ErrorKind};
use std::pin::Pin;
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use axum::extract::connect_info::Connected;
use axum::serve::{IncomingStream, Listener};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::oneshot;
use tokio::time::{Instant, Sleep};

/// Connections at the same time. Those that have upgraded have places of their own, far fewer.
const MOST: usize = 256;
/// Bytes of a request with its head: browsers send less than two thousand.
const LARGEST: usize = 16 << 10;
/// Time for the head of a request.
const HEAD: Duration = Duration::from_secs(5);
/// Time for a whole request and its answer: a coordinator may take some seconds.
const REQUEST: Duration = Duration::from_secs(60);
/// Pause after the operating system had no file for another connection.
const NO_FILE: Duration = Duration::from_millis(100);

/// How far a visitor has come; a higher one is never sent away for a lower one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
enum Stage {
    /// Nothing, or a part of a head, has arrived.
    Silent,
    /// A request is being answered.
    Asks,
    /// The same, with the token.
    Operator,
    /// A WebSocket, which has places and patience of its own.
    Upgraded,
}

const STAGES: [Stage; 4] = [Stage::Silent, Stage::Asks, Stage::Operator, Stage::Upgraded];

/// A connection, as the server's handlers know it.
#[derive(Debug, Clone)]
pub struct Visitor {
    stage: Arc<AtomicU8>,
    /// Bytes that a request with the token may have.
    largest: usize,
}

impl Visitor {
    fn new(largest: usize) -> Self {
        Self { stage: Arc::new(AtomicU8::new(Stage::Silent as u8)), largest }
    }

    fn stage(&self) -> Stage {
        STAGES.get(usize::from(self.stage.load(Ordering::Relaxed))).copied().unwrap_or(Stage::Silent)
    }

    fn is_at(&self, stage: Stage) {
        self.stage.fetch_max(stage as u8, Ordering::Relaxed);
    }

    /// The head of its request is there.
    pub fn asks(&self, is_operator: bool) {
        self.is_at(if is_operator { Stage::Operator } else { Stage::Asks });
    }

    /// It has become a WebSocket.
    pub fn upgraded(&self) {
        self.is_at(Stage::Upgraded);
    }

    /// When it has to be done, if it came at `since`.
    fn deadline(&self, since: Instant) -> Option<Instant> {
        match self.stage() {
            Stage::Silent => Some(since + HEAD),
            Stage::Asks | Stage::Operator => Some(since + REQUEST),
            Stage::Upgraded => None,
        }
    }

    /// Whether it may have sent so many bytes.
    fn may_have_sent(&self, bytes: usize) -> bool {
        match self.stage() {
            Stage::Silent | Stage::Asks => bytes <= LARGEST,
            Stage::Operator => bytes <= self.largest.saturating_add(LARGEST),
            Stage::Upgraded => true,
        }
    }
}

/// Who stands in the door, in the order of coming.
#[derive(Debug, Default)]
struct Inside(Vec<(Visitor, oneshot::Sender<()>)>);

impl Inside {
    /// Lets another one in. Where all places are taken whoever has come the least far leaves, of those the one that came first.
    fn enter(&mut self, largest: usize) -> (Visitor, oneshot::Receiver<()>) {
        self.0.retain(|(_, leave)| !leave.is_closed());
        if self.0.len() >= MOST
            && let Some((index, _)) =
                self.0.iter().enumerate().min_by_key(|(_, (visitor, _))| visitor.stage())
        {
            let (_, leave) = self.0.remove(index);
            let _ = leave.send(());
        }
        let (leave, sent_away) = oneshot::channel();
        let visitor = Visitor::new(largest);
        self.0.push((visitor.clone(), leave));
        (visitor, sent_away)
    }
}

/// A listener whose connections have bounds.
#[derive(Debug)]
pub struct Door {
    listener: TcpListener,
    inside: Mutex<Inside>,
    largest: usize,
}

impl Door {
    /// Requests with the token may have a body of so many bytes; others have none to speak of.
    #[must_use]
    pub fn new(listener: TcpListener, largest: usize) -> Self {
        Self { listener, inside: Mutex::default(), largest }
    }
}

impl Listener for Door {
    type Io = Guarded;
    type Addr = Visitor;

    async fn accept(&mut self) -> (Guarded, Visitor) {
        loop {
            match self.listener.accept().await {
                Ok((stream, _)) => {
                    let inside = self.inside.get_mut().unwrap_or_else(PoisonError::into_inner);
                    let (visitor, sent_away) = inside.enter(self.largest);
                    return (Guarded::new(stream, visitor.clone(), sent_away), visitor);
                }
                // The stranger has gone already, or there is no file for it.
                Err(_) => tokio::time::sleep(NO_FILE).await,
            }
        }
    }

    fn local_addr(&self) -> io::Result<Visitor> {
        Err(ErrorKind::Unsupported.into())
    }
}

impl Connected<IncomingStream<'_, Door>> for Visitor {
    fn connect_info(stream: IncomingStream<'_, Door>) -> Self {
        stream.remote_addr().clone()
    }
}

/// A connection that ends when its time is over, when it sends too much, and when it is sent away.
#[derive(Debug)]
pub struct Guarded {
    stream: TcpStream,
    visitor: Visitor,
    since: Instant,
    timer: Pin<Box<Sleep>>,
    sent_away: oneshot::Receiver<()>,
    read: usize,
}

impl Guarded {
    fn new(stream: TcpStream, visitor: Visitor, sent_away: oneshot::Receiver<()>) -> Self {
        let since = Instant::now();
        let timer = Box::pin(tokio::time::sleep_until(since + HEAD));
        Self { stream, visitor, since, timer, sent_away, read: 0 }
    }

    /// An error once the connection is to end; it wakes whoever waits for reading or writing.
    fn check(&mut self, context: &mut Context<'_>) -> io::Result<()> {
        if !self.visitor.may_have_sent(self.read) {
            return Err(io::Error::new(ErrorKind::InvalidData, "the request is too large"));
        }
        let Some(deadline) = self.visitor.deadline(self.since) else { return Ok(()) };
        if Pin::new(&mut self.sent_away).poll(context).is_ready() {
            return Err(ErrorKind::ConnectionAborted.into());
        }
        if self.timer.deadline() != deadline {
            self.timer.as_mut().reset(deadline);
        }
        match self.timer.as_mut().poll(context) {
            Poll::Ready(()) => Err(ErrorKind::TimedOut.into()),
            Poll::Pending => Ok(()),
        }
    }
}

impl AsyncRead for Guarded {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        self.check(context)?;
        let before = buffer.filled().len();
        let read = Pin::new(&mut self.stream).poll_read(context, buffer);
        self.read = self.read.saturating_add(buffer.filled().len() - before);
        read
    }
}

impl AsyncWrite for Guarded {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        self.check(context)?;
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn silent_strangers_make_place_and_who_asks_is_answered() {
        let mut inside = Inside::default();
        let (operator, mut of_operator) = inside.enter(0);
        operator.asks(true);
        let (browser, mut of_browser) = inside.enter(0);
        browser.asks(false);
        let (socket, mut of_socket) = inside.enter(0);
        socket.upgraded();
        // Ten thousand who send nothing: there are never more than there are places, and the first of them go first.
        let mut strangers: Vec<_> = (0..10_000).map(|_| inside.enter(0)).collect();
        assert_eq!(inside.0.len(), MOST);
        let stay = strangers.iter_mut().map(|(_, sent_away)| sent_away.try_recv().is_err());
        let stay: Vec<bool> = stay.collect();
        assert_eq!(stay.iter().filter(|stays| **stays).count(), MOST - 3);
        assert!(stay[..stay.len() - (MOST - 3)].iter().all(|stays| !stays));
        // As many who ask: those who ask with the token stay.
        let asking: Vec<_> = (0..10_000)
            .map(|_| {
                let (visitor, sent_away) = inside.enter(0);
                visitor.asks(false);
                (visitor, sent_away)
            })
            .collect();
        assert!(of_operator.try_recv().is_err() && of_socket.try_recv().is_err());
        assert!(of_browser.try_recv().is_ok(), "it came first");
        drop((strangers, asking));
        inside.enter(0);
        assert_eq!(inside.0.len(), 3, "who has gone takes no place");
    }

    #[test]
    fn heads_are_small_and_come_soon() {
        let begin = Instant::now();
        let visitor = Visitor::new(1 << 20);
        assert_eq!(visitor.deadline(begin), Some(begin + HEAD));
        assert!(visitor.may_have_sent(LARGEST) && !visitor.may_have_sent(LARGEST + 1));
        visitor.asks(false);
        assert_eq!(visitor.deadline(begin), Some(begin + REQUEST));
        assert!(!visitor.may_have_sent(LARGEST + 1));
        let operator = Visitor::new(1 << 20);
        operator.asks(true);
        assert!(operator.may_have_sent(1 << 20) && !operator.may_have_sent((1 << 20) + LARGEST + 1));
        visitor.upgraded();
        visitor.asks(false);
        assert_eq!((visitor.deadline(begin), visitor.may_have_sent(usize::MAX)), (None, true));
    }
}
