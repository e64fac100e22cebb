//! Carries announcements to participants that RustDDS does not tell of the others.
//!
//! Where the loopback interface carries no multicast, RustDDS announces a participant to the first twelve of this machine
//! (`SPDP_LOCALHOST_PEER_COUNT`) and to those that it has met. Secured, the thirteenth hears of nobody: it ignores the handshakes
//! that others begin, and exchanges nothing, for ever. Open, two that are both beyond the twelfth meet by dummy participants
//! ([`Nudge`]), which nodes have and commands have not, and only when the next announcement is due, 10 s later at the most.
//!
//! So nobody takes the last of these twelve numbers as a participant: one process at a time, whichever comes first, listens
//! at its port and sends what arrives there on, unchanged, to all that RustDDS leaves out. When it ends, another takes its
//! place. It needs no keys: announcements are in the clear, and each is proved by the handshake that follows.
//!
//! [`Nudge`]: crate::nudge::Nudge

use std::io::ErrorKind;
use std::net::{Ipv4Addr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crate::environment::Network;
use crate::error::RosError;
use crate::nudge::{PARTICIPANTS_HERE, TOLD_BY_RUSTDDS, announcement_port};

/// The number that no participant takes.
const RESERVED: u16 = TOLD_BY_RUSTDDS - 1;
/// How soon a place that became free is taken, and the end of a relay noticed.
const LOOK: Duration = Duration::from_millis(200);
/// Largest datagram of UDP over IPv4.
const LARGEST: usize = 65_507;
/// RTPS 2.5, 8.3.3.1: how every message begins.
const RTPS: &[u8] = b"RTPS";

/// Relays, or waits to do so, until it is dropped.
#[derive(Debug)]
pub(crate) struct Relay(Arc<AtomicBool>);

impl Relay {
    /// For a participant that is about to join; `None` where it is not needed: the network has multicast.
    ///
    /// # Errors
    /// When no thread can be started.
    pub(crate) fn for_network(network: &Network) -> Result<Option<Self>, RosError> {
        if !network.is_localhost() {
            return Ok(None);
        }
        Self::start(network.domain_id).map(Some).map_err(RosError::io("starting a thread"))
    }

    /// The place is taken on return, by us or somebody else, so that no participant of ours gets its number.
    fn start(domain_id: u16) -> std::io::Result<Self> {
        let end = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&end);
        let mut socket = place(domain_id);
        std::thread::Builder::new().name("announcements".into()).spawn(move || {
            let mut buffer = vec![0; LARGEST];
            while !ended.load(Ordering::Relaxed) {
                match &socket {
                    None => {
                        std::thread::sleep(LOOK);
                        socket = place(domain_id);
                    }
                    Some(taken) => match taken.recv(&mut buffer) {
                        Ok(length) => pass_on(taken, domain_id, &buffer[..length]),
                        Err(error)
                            if matches!(
                                error.kind(),
                                ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                            ) => {}
                        Err(_) => socket = None,
                    },
                }
            }
        })?;
        Ok(Self(end))
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// The place in which announcements arrive; `None` while somebody else has it.
fn place(domain_id: u16) -> Option<UdpSocket> {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, announcement_port(domain_id, RESERVED))).ok()?;
    // Without a limit the thread would not notice its end.
    socket.set_read_timeout(Some(LOOK)).ok()?;
    Some(socket)
}

fn pass_on(socket: &UdpSocket, domain_id: u16, message: &[u8]) {
    if !message.starts_with(RTPS) {
        return;
    }
    for number in TOLD_BY_RUSTDDS..PARTICIPANTS_HERE {
        // Nobody may be there; what is lost comes again.
        let _ = socket.send_to(message, (Ipv4Addr::LOCALHOST, announcement_port(domain_id, number)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_tests::Domain;

    fn listener(domain_id: u16, number: u16) -> UdpSocket {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, announcement_port(domain_id, number))).unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        socket
    }

    #[test]
    fn what_is_announced_to_the_twelfth_reaches_those_after_it_once_its_place_is_free() {
        let domain = Domain::take();
        let thirteenth = listener(domain.id, 12);
        let last = listener(domain.id, PARTICIPANTS_HERE - 1);
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        let twelfth = (Ipv4Addr::LOCALHOST, announcement_port(domain.id, 11));
        let arrives = |socket: &UdpSocket, text: &[u8]| {
            let mut buffer = [0; 100];
            let length = socket.recv(&mut buffer).unwrap();
            assert_eq!(&buffer[..length], text);
        };
        let mut buffer = [0; 100];
        let somebody_else = listener(domain.id, RESERVED);
        let relay = Relay::start(domain.id).unwrap();
        drop(somebody_else);
        thirteenth.set_read_timeout(Some(LOOK)).unwrap();
        // Until the relay has noticed that the place is free, nobody is there.
        let taken_over = (0..600).any(|_| {
            let _ = sender.send_to(b"RTPS one", twelfth);
            thirteenth.recv(&mut buffer).is_ok_and(|length| &buffer[..length] == b"RTPS one")
        });
        assert!(taken_over);
        assert!(UdpSocket::bind(twelfth).is_err(), "a participant could take the place");
        arrives(&last, b"RTPS one");
        sender.send_to(b"not a message", twelfth).unwrap();
        sender.send_to(b"RTPS two", twelfth).unwrap();
        thirteenth.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        arrives(&thirteenth, b"RTPS two");
        drop(relay);
    }

    #[test]
    fn only_a_network_of_this_machine_needs_one() {
        let wide = Network { interfaces: None, ..Network::localhost(1) };
        assert!(Relay::for_network(&wide).unwrap().is_none());
    }
}
