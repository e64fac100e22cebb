//! A serial line in time: how long bytes are on their way.

use std::collections::VecDeque;
use std::time::Duration;

/// Start bit, eight data bits, stop bit.
const BITS_PER_BYTE: f64 = 10.0;
/// Interfaces hand bytes on in groups of the size of their buffer (16550: 16 bytes).
const GROUP: usize = 16;

/// Time that a number of bytes take at a rate of so many bits a second.
#[must_use]
pub fn transmission(bytes: usize, baud: u32) -> Duration {
    Duration::from_secs_f64(bytes as f64 * BITS_PER_BYTE / f64::from(baud.max(1)))
}

/// One direction of a line with a finite rate: bytes that are given to it come out later, in groups. Times are nanoseconds
/// of any clock.
#[derive(Debug, Clone)]
pub struct Line {
    byte_ns: i64,
    /// When the line will have sent everything.
    free_ns: i64,
    waiting: VecDeque<(i64, u8)>,
}

impl Line {
    /// A line of so many bits a second.
    #[must_use]
    pub fn new(baud: u32) -> Self {
        let byte_ns = i64::try_from(transmission(1, baud).as_nanos()).unwrap_or(1).max(1);
        Self { byte_ns, free_ns: i64::MIN, waiting: VecDeque::new() }
    }

    /// Sends bytes, not before `from_ns`, and after everything that is on its way.
    pub fn send(&mut self, from_ns: i64, bytes: &[u8]) {
        for &byte in bytes {
            self.free_ns = self.free_ns.max(from_ns) + self.byte_ns;
            self.waiting.push_back((self.free_ns, byte));
        }
    }

    /// When the next group will have come.
    #[must_use]
    pub fn due_ns(&self) -> Option<i64> {
        self.waiting.get(self.waiting.len().min(GROUP).checked_sub(1)?).map(|(at, _)| *at)
    }

    /// The bytes that have come by then, if a group is complete or the line is quiet, each with its time.
    pub fn arrived(&mut self, now_ns: i64) -> Vec<(i64, u8)> {
        let count = self.waiting.iter().take_while(|(at, _)| *at <= now_ns).count();
        let whole = if count == self.waiting.len() { count } else { count / GROUP * GROUP };
        self.waiting.drain(..whole).collect()
    }

    /// When the next single byte will have come, for a device that takes each by itself.
    #[must_use]
    pub fn next_ns(&self) -> Option<i64> {
        self.waiting.front().map(|(at, _)| *at)
    }

    /// The bytes that have come by then, each with its time.
    pub fn each(&mut self, now_ns: i64) -> Vec<(i64, u8)> {
        let count = self.waiting.iter().take_while(|(at, _)| *at <= now_ns).count();
        self.waiting.drain(..count).collect()
    }

    /// Forgets everything that is on its way, as when the plug is pulled.
    pub fn clear(&mut self) {
        self.waiting.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_take_their_time_and_come_in_groups() {
        // 115200 baud, 10 bits a byte: 86.8 us a byte.
        assert_eq!(transmission(58, 921_600).as_micros(), 629);
        let mut line = Line::new(115_200);
        line.send(1_000, &[7; 20]);
        assert_eq!(line.due_ns(), Some(1_000 + 16 * 86_806));
        assert!(line.arrived(1_000 + 10 * 86_806).is_empty());
        assert_eq!(line.arrived(1_000 + 17 * 86_806).len(), 16);
        let rest = line.arrived(1_000 + 20 * 86_806);
        assert_eq!(rest.len(), 4);
        assert_eq!(rest[3].0, 1_000 + 20 * 86_806);
        assert_eq!(line.due_ns(), None);
    }
}
