//! A simulated radio link between computers: relays Ethernet frames with delay and loss.
//!
//! It stands where `tc qdisc ... netem` would, which many kernels are built without, and does the same: each frame is
//! lost with a probability, or waits for a delay of its own. Frames may overtake one another.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::os::fd::{AsRawFd, OwnedFd};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use nix::ifaddrs::getifaddrs;
use nix::sys::socket::sockopt::ReceiveTimeout;
use nix::sys::socket::{
    AddressFamily, MsgFlags, SockFlag, SockProtocol, SockType, SockaddrLike, bind, recv, send, setsockopt,
    socket,
};
use nix::sys::time::{TimeVal, TimeValLike};

use super::machine::prefer;

/// How frames pass between two hosts, in either direction.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Quality {
    /// Nothing passes.
    pub cut: bool,
    /// Probability that a frame is lost, 0..=1.
    pub loss: f64,
    /// Delay of every frame [s].
    pub delay_s: f64,
    /// Further delay, uniform from 0 to this [s].
    pub jitter_s: f64,
}

/// Frames that wait, by the time when they are due.
type Delayed = (Instant, u64, usize, Vec<u8>);

struct Shared {
    ports: Vec<OwnedFd>,
    /// Of `from * ports + to`.
    quality: Mutex<Vec<Quality>>,
    end: AtomicBool,
}

/// Passes frames between ports until dropped.
pub struct Relay {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
}

impl Relay {
    /// Between these interfaces of the calling thread's network namespace, perfect at first.
    pub fn new(interfaces: &[String]) -> Result<Self, String> {
        let ports = interfaces.iter().map(|name| port(name)).collect::<Result<Vec<_>, _>>()?;
        let count = ports.len();
        let quality = Mutex::new(vec![Quality::default(); count * count]);
        let shared = Arc::new(Shared { ports, quality, end: AtomicBool::new(false) });
        let (sender, receiver) = channel();
        let mut threads: Vec<_> = (0..count)
            .map(|from| {
                let (shared, sender) = (shared.clone(), sender.clone());
                std::thread::spawn(move || pass_on(&shared, from, &sender))
            })
            .collect();
        let last = shared.clone();
        threads.push(std::thread::spawn(move || send_when_due(&last, &receiver)));
        Ok(Self { shared, threads })
    }

    /// Changes how frames pass between two ports.
    pub fn set(&self, a: usize, b: usize, quality: Quality) {
        let count = self.shared.ports.len();
        let mut all = self.shared.quality.lock().unwrap_or_else(PoisonError::into_inner);
        all[a * count + b] = quality;
        all[b * count + a] = quality;
    }

    /// How they pass now.
    pub fn get(&self, a: usize, b: usize) -> Quality {
        self.shared.quality(a, b)
    }
}

impl Shared {
    fn quality(&self, from: usize, to: usize) -> Quality {
        self.quality.lock().unwrap_or_else(PoisonError::into_inner)[from * self.ports.len() + to]
    }

    fn send(&self, to: usize, frame: &[u8]) {
        // A full queue loses a frame, as air does.
        let _ = send(self.ports[to].as_raw_fd(), frame, MsgFlags::empty());
    }
}

fn port(interface: &str) -> Result<OwnedFd, String> {
    let failed = |what: &str, error: nix::Error| format!("{what} {interface}: {error}");
    let port = socket(AddressFamily::Packet, SockType::Raw, SockFlag::SOCK_CLOEXEC, SockProtocol::EthAll)
        .map_err(|e| failed("packet socket of", e))?;
    let address = getifaddrs()
        .map_err(|e| failed("addresses of", e))?
        .filter(|a| a.interface_name == interface)
        .find_map(|a| a.address.filter(|a| a.family() == Some(AddressFamily::Packet)))
        .ok_or_else(|| format!("{interface} has no link address"))?;
    bind(port.as_raw_fd(), &address).map_err(|e| failed("binding to", e))?;
    setsockopt(&port, ReceiveTimeout, &TimeVal::milliseconds(100)).map_err(|e| failed("timeout of", e))?;
    Ok(port)
}

fn pass_on(shared: &Shared, from: usize, delayed: &Sender<Delayed>) {
    prefer(None);
    let mut random = Uniform(0x9e37_79b9_7f4a_7c15 ^ (from as u64 + 1));
    let mut buffer = vec![0; 1 << 16];
    let mut order = 0;
    while !shared.end.load(Ordering::Relaxed) {
        let Ok(length) = recv(shared.ports[from].as_raw_fd(), &mut buffer, MsgFlags::empty()) else {
            continue;
        };
        let frame = &mut buffer[..length];
        leave_out_udp_checksum(frame);
        for to in (0..shared.ports.len()).filter(|to| *to != from) {
            let quality = shared.quality(from, to);
            let (loss, jitter) = (random.next(), random.next());
            if quality.cut || loss < quality.loss {
                continue;
            }
            let delay_s = quality.delay_s + jitter * quality.jitter_s;
            if delay_s <= 0.0 {
                shared.send(to, frame);
            } else {
                order += 1;
                let due = Instant::now() + Duration::from_secs_f64(delay_s);
                let _ = delayed.send((due, order, to, frame.to_vec()));
            }
        }
    }
}

fn send_when_due(shared: &Shared, delayed: &Receiver<Delayed>) {
    prefer(None);
    let mut waiting: BinaryHeap<Reverse<Delayed>> = BinaryHeap::new();
    loop {
        let next = waiting.peek().map_or(Duration::from_millis(100), |Reverse(first)| {
            first.0.saturating_duration_since(Instant::now())
        });
        match delayed.recv_timeout(next) {
            Ok(frame) => waiting.push(Reverse(frame)),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
        while let Some(Reverse(first)) = waiting.peek()
            && first.0 <= Instant::now()
            && let Some(Reverse((_, _, to, frame))) = waiting.pop()
        {
            shared.send(to, &frame);
        }
    }
}

/// A kernel leaves the checksum of what it sends into a virtual cable to the other end, which trusts it; one that
/// comes out of a packet socket is not trusted. Zero stands for none (RFC 768).
fn leave_out_udp_checksum(frame: &mut [u8]) {
    const IP: usize = 14;
    let ipv4 = frame.get(12..14) == Some(&[0x08, 0x00]);
    if !ipv4 || frame.len() < IP + 20 || frame[IP + 9] != 17 {
        return;
    }
    let later_fragment = (u16::from_be_bytes([frame[IP + 6], frame[IP + 7]]) & 0x1fff) != 0;
    let udp = IP + 4 * usize::from(frame[IP] & 0x0f);
    if !later_fragment && let Some(checksum) = frame.get_mut(udp + 6..udp + 8) {
        checksum.fill(0);
    }
}

/// Numbers from 0 to 1 (xorshift64*), so that each run loses the same share in another order of frames.
struct Uniform(u64);

impl Uniform {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 * (0.5f64).powi(53)
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.shared.end.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}
