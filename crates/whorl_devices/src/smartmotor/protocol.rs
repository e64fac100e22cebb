//! The commands of Class 5 SmartMotors on a serial chain, as pure functions.
//!
//! Source: Moog Animatics, "SmartMotor Developer's Guide", revision L: addresses and echo on a chain (pages 100, 396), torque
//! mode (pages 125, 133, 589), actual velocity and its scale (pages 768, 776, 877), status word 0 (page 879). That a line ends
//! with a carriage return is taken from the examples on page 100. Not checked against a motor.

use std::f64::consts::TAU;

/// Address of all motors at once.
pub const ALL: u8 = 0;
/// Largest address.
pub const LARGEST_ADDRESS: u8 = 120;
/// First byte of a line is this plus the address (page 100: 0 is 128, 1 is 129).
const ADDRESS_BASE: u8 = 0x80;
/// Full scale of the commanded duty cycle.
pub const FULL_SCALE: f64 = 32767.0;
/// Velocities are encoder counts per sample times this.
const VELOCITY_SCALE: f64 = 65536.0;
/// Longest line on the chain.
const LONGEST_LINE: usize = 64;

/// A line for one motor, or for [`ALL`].
#[must_use]
pub fn line(address: u8, command: &str) -> Vec<u8> {
    let mut bytes = vec![ADDRESS_BASE.saturating_add(address.min(LARGEST_ADDRESS))];
    bytes.extend_from_slice(command.as_bytes());
    bytes.push(b'\r');
    bytes
}

/// The address in the first byte of a line.
#[must_use]
pub fn address_of(byte: u8) -> Option<u8> {
    byte.checked_sub(ADDRESS_BASE).filter(|address| *address <= LARGEST_ADDRESS)
}

/// Speed \[rad/s\] from what RVA reports.
#[must_use]
pub fn speed_rad_s(reported: i64, counts_per_turn: f64, samples_per_s: f64) -> f64 {
    reported as f64 / VELOCITY_SCALE * samples_per_s / counts_per_turn * TAU
}

/// What RVA reports at this speed.
#[must_use]
pub fn reported_speed(speed_rad_s: f64, counts_per_turn: f64, samples_per_s: f64) -> i64 {
    (speed_rad_s / TAU * counts_per_turn / samples_per_s * VELOCITY_SCALE).round() as i64
}

/// What is wrong by status word 0, if anything is.
#[must_use]
pub fn faults(status: i64) -> Option<String> {
    let bits = [
        (8, "bus voltage fault"),
        (16, "peak over-current"),
        (32, "excessive temperature"),
        (64, "excessive position error"),
        (128, "velocity limit"),
        (512, "derivative error limit"),
    ];
    let words: Vec<&str> =
        bits.iter().filter(|(bit, _)| status & bit != 0).map(|(_, words)| *words).collect();
    (!words.is_empty()).then(|| words.join(", "))
}

/// An answer to a question.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Answer {
    /// Whose.
    pub address: u8,
    /// What was asked.
    pub question: String,
    /// The number.
    pub value: i64,
}

/// Finds answers among what a chain sends back: the echo of every line, and behind the echo of a question its answer.
#[derive(Debug, Clone, Default)]
pub struct Replies {
    line: Vec<u8>,
    asked: Option<(u8, String)>,
    refused: u64,
}

impl Replies {
    /// Takes one byte; gives an answer when it is complete.
    pub fn push(&mut self, byte: u8) -> Option<Answer> {
        if byte >= ADDRESS_BASE {
            // A line begins, whatever came before.
            self.refused += u64::from(!self.line.is_empty());
            (self.line, self.asked) = (vec![byte], None);
            return None;
        }
        if byte != b'\r' {
            if self.line.len() < LONGEST_LINE {
                self.line.push(byte);
            }
            return None;
        }
        let line = std::mem::take(&mut self.line);
        let text = |bytes: &[u8]| std::str::from_utf8(bytes).ok().map(str::to_owned);
        match line.split_first() {
            Some((first, rest)) if *first >= ADDRESS_BASE => {
                self.asked =
                    address_of(*first).zip(text(rest)).filter(|(_, command)| command.starts_with('R'));
                None
            }
            _ => {
                let value = text(&line).and_then(|number| number.trim().parse().ok());
                let answer = self.asked.take().zip(value);
                self.refused += u64::from(answer.is_none());
                answer.map(|((address, question), value)| Answer { address, question, value })
            }
        }
    }

    /// Lines that were neither echo nor answer, since the last call.
    pub fn take_refused(&mut self) -> u64 {
        std::mem::take(&mut self.refused)
    }
}
