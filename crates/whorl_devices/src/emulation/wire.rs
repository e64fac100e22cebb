//! From a device to the computer, with the faults of the wire.

use super::faults::FaultKind;
use crate::bus::Line;

/// Every so many messages are spoilt by a fault that spoils some.
const EVERY: u64 = 5;
/// How late messages are that are late \[ns\].
const LATE_NS: i64 = 30_000_000;

/// The direction from a device to the computer.
#[derive(Debug, Clone)]
pub struct Wire {
    line: Line,
    messages: u64,
    /// At work now.
    pub(super) faults: Vec<FaultKind>,
}

impl Wire {
    /// A wire of so many bits a second.
    #[must_use]
    pub fn new(baud: u32) -> Self {
        Self { line: Line::new(baud), messages: 0, faults: Vec::new() }
    }

    /// Sends bytes, not before this time.
    pub fn send(&mut self, from_ns: i64, bytes: &[u8]) {
        if !self.faults.contains(&FaultKind::Silent) {
            self.line.send(from_ns, bytes);
        }
    }

    /// Sends a message, which faults of the wire may spoil.
    pub fn send_message(&mut self, from_ns: i64, message: Vec<u8>) {
        if let Some((from_ns, message)) = self.spoil(from_ns, message) {
            self.send(from_ns, &message);
        }
    }

    /// Sends a message that its receiver checks, as CAN controllers do with frames: a spoilt one reaches nobody.
    pub fn send_checked(&mut self, from_ns: i64, message: Vec<u8>) {
        if let Some((from_ns, sent)) = self.spoil(from_ns, message.clone())
            && sent == message
        {
            self.send(from_ns, &sent);
        }
    }

    /// What faults of the wire make of a message, and when it is sent; `None`: it is not.
    pub(super) fn spoil(&mut self, from_ns: i64, mut message: Vec<u8>) -> Option<(i64, Vec<u8>)> {
        self.messages += 1;
        let spoilt = self.messages.is_multiple_of(EVERY);
        let mut from_ns = from_ns;
        for fault in self.faults.clone() {
            match fault {
                FaultKind::Torn if spoilt => message.truncate(message.len() / 2),
                FaultKind::Corrupt if spoilt => {
                    // Another bit of another byte each time.
                    let number = (self.messages / EVERY) as usize;
                    let index = number * 7 % message.len().max(1);
                    if let Some(byte) = message.get_mut(index) {
                        *byte ^= 1 << (number % 8);
                    }
                }
                FaultKind::Late => from_ns += LATE_NS,
                FaultKind::Silent => return None,
                _ => {}
            }
        }
        Some((from_ns, message))
    }

    pub(super) fn due_ns(&self) -> Option<i64> {
        self.line.due_ns()
    }

    pub(super) fn arrived(&mut self, now_ns: i64) -> Vec<u8> {
        self.line.arrived(now_ns).into_iter().map(|(_, byte)| byte).collect()
    }

    pub(super) fn clear(&mut self) {
        self.line.clear();
    }
}
