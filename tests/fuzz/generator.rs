//! Messages that no node would send, and some that it would.

use std::f64::consts::PI;

use whorl_msgs::builtin_interfaces::Time;
use whorl_msgs::fields::Visitor;
use whorl_msgs::topics::{Message, MessageType};
use whorl_node::Timestamp;

/// Numbers at which arithmetic changes its mind.
const REALS: [f64; 14] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    PI,
    1e-300,
    5e-324,
    1e6,
    1e20,
    -1e20,
    f64::MAX,
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
];
const COUNTS: [u64; 7] = [0, 1, 2, 255, 1 << 33, u64::MAX - 1, u64::MAX];
/// Numbers of wheels, jets and platforms among them.
const LENGTHS: [usize; 8] = [0, 1, 2, 3, 4, 12, 36, 300];
/// Those of Whorl-I and of a formation of two, by parts of the fields' names.
const RIGHT_LENGTHS: [(&str, usize); 8] = [
    ("wheel", 3),
    ("velocity", 3),
    ("effort", 3),
    ("jet", 12),
    ("on_time", 12),
    ("health", 12),
    ("offset_s", 2),
    ("platforms", 2),
];
/// Around now [ns]: within and beyond every tolerance, an hour, a century.
const OFFSETS_NS: [i64; 10] = [
    0,
    1,
    -1_000_000,
    5_000_000,
    -90_000_000,
    150_000_000,
    900_000_000,
    3_600_000_000_000,
    -3_600_000_000_000,
    3_000_000_000_000_000_000,
];

/// SplitMix64 (Steele, Lea and Flood 2014): the same messages for the same seed on every machine.
pub struct Generator {
    state: u64,
    now: Timestamp,
}

impl Generator {
    pub fn new(seed: u64) -> Self {
        Self { state: seed, now: Timestamp(0) }
    }

    /// Any number.
    pub fn number(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number below `limit`.
    pub fn below(&mut self, limit: u64) -> u64 {
        self.number() % limit.max(1)
    }

    pub fn one_of<T: Copy>(&mut self, list: &[T]) -> T {
        list[usize::try_from(self.below(list.len() as u64)).unwrap()]
    }

    /// A message of this type. One in three differs from a plausible one in few fields only, so that it comes far.
    pub fn message(&mut self, ty: MessageType, now: Timestamp) -> Message {
        self.now = now;
        let mut message = Message::default_of(ty);
        let one_in = self.one_of(&[2, 8, 1000]);
        message.walk(&mut Fill { generator: self, one_in });
        message
    }

    /// Bytes with some changed, missing or added.
    pub fn spoil(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut bytes = bytes.to_vec();
        for _ in 0..self.below(4) {
            let at = usize::try_from(self.below(bytes.len() as u64)).unwrap();
            match self.below(3) {
                0 => bytes.truncate(at),
                1 => bytes.push(self.number() as u8),
                _ => {
                    let value = self.one_of(&[0, 1, 0x7f, 0x80, 0xff]);
                    if let Some(byte) = bytes.get_mut(at) {
                        *byte = value;
                    }
                }
            }
        }
        bytes
    }
}

/// Fills the fields; one in so many with a value that nobody expects.
struct Fill<'g> {
    generator: &'g mut Generator,
    one_in: u64,
}

impl Fill<'_> {
    fn odd(&mut self) -> bool {
        self.generator.below(self.one_in) == 0
    }
}

impl Visitor for Fill<'_> {
    fn real(&mut self, name: &'static str, value: &mut f64) {
        if self.odd() {
            *value = self.generator.one_of(&REALS);
        } else if !["x", "y", "z", "w"].contains(&name) {
            // Components stay as they are by default: a unit quaternion, a vector of zeros or nearly.
            *value = self.generator.below(1000) as f64 * 1e-3;
        } else if *value == 0.0 && self.generator.below(2) == 0 {
            *value = self.generator.below(1000) as f64 * 1e-6;
        }
    }

    fn unsigned(&mut self, _name: &'static str, value: &mut u64) {
        *value = if self.odd() { self.generator.one_of(&COUNTS) } else { self.generator.below(6) };
    }

    fn signed(&mut self, _name: &'static str, value: &mut i64) {
        *value = if self.odd() {
            self.generator.one_of(&[i64::MIN, i64::MAX, -1])
        } else {
            self.generator.below(3) as i64
        };
    }

    fn flag(&mut self, _name: &'static str, value: &mut bool) {
        *value = self.generator.below(2) == 0;
    }

    fn text(&mut self, _name: &'static str, value: &mut String) {
        *value = match self.generator.below(5) {
            0 => "whorl_1".to_owned(),
            1 => "coordinator".to_owned(),
            2 if self.odd() => "\u{0}\u{feff}".repeat(3000),
            _ => String::new(),
        };
    }

    fn time(&mut self, _name: &'static str, value: &mut Time) {
        *value = if self.odd() {
            self.generator.one_of(&[
                Time { sec: 0, nanosec: 0 },
                Time { sec: i32::MAX, nanosec: u32::MAX },
                Time { sec: i32::MIN, nanosec: 0 },
            ])
        } else {
            let offset_ns = self.generator.one_of(&OFFSETS_NS);
            let jitter_ns = self.generator.below(2_000_000) as i64;
            Timestamp(self.generator.now.0.saturating_add(offset_ns).saturating_sub(jitter_ns)).into()
        };
    }

    fn length(&mut self, name: &'static str, length: &mut usize) {
        let right = RIGHT_LENGTHS.iter().find(|(part, _)| name.contains(part)).map(|(_, right)| *right);
        *length = right.filter(|_| !self.odd()).unwrap_or_else(|| self.generator.one_of(&LENGTHS));
    }
}
