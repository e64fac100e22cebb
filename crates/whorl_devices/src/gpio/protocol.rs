//! The calls of the GPIO character device that are used here, as bytes, and a chip that carries them out: pure functions.
//!
//! Source: Linux, include/uapi/linux/gpio.h (layouts, numbers of the calls), Documentation/userspace-api/gpio:
//! gpio-v2-get-line-ioctl.rst, gpio-v2-line-set-values-ioctl.rst, gpio-v2-line-get-values-ioctl.rst, error-codes.rst.

use super::Valves;

/// Numbers of the calls (gpio.h, `_IOWR(0xB4, ...)`).
const GET_LINE: u8 = 0x07;
const GET_VALUES: u8 = 0x0E;
const SET_VALUES: u8 = 0x0F;
/// `struct gpio_v2_line_request`, and where its fields are.
pub(super) const REQUEST: usize = 592;
const CONSUMER: usize = 256;
const FLAGS: usize = 288;
const NUM_ATTRS: usize = 296;
const ATTRS: usize = 320;
const NUM_LINES: usize = 560;
/// `struct gpio_v2_line_config_attribute`: id, padding, flags, mask.
const ATTR: usize = 24;
/// `struct gpio_v2_line_values`.
pub(super) const VALUES: usize = 16;
const ATTR_FLAGS: u32 = 1;
const MOST: usize = 64;
const ACTIVE_LOW: u64 = 2;
const INPUT: u64 = 4;
const OUTPUT: u64 = 8;
const PULL_UP: u64 = 0x100;
const PULL_DOWN: u64 = 0x200;

/// Of errno.
pub(super) const EPERM: i32 = 1;
pub(super) const EBUSY: i32 = 16;
pub(super) const EINVAL: i32 = 22;

/// Lines and how each is to be.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct LineRequest {
    pub(super) lines: Vec<(u32, u64)>,
}

/// Bits, and which of them are meant. Bit k is the k-th line of the request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct LineValues {
    pub(super) bits: u64,
    pub(super) mask: u64,
}

/// One call.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Call {
    GetLine(LineRequest),
    GetValues(LineValues),
    SetValues(LineValues),
}

/// What a call returns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Answer {
    /// 0, or a number of errno.
    pub(super) error: i32,
    pub(super) values: LineValues,
}

impl LineRequest {
    pub(super) fn of(setup: &Valves) -> Self {
        let drive = if setup.active_low { OUTPUT | ACTIVE_LOW } else { OUTPUT };
        let outputs = setup.outputs().into_iter().map(|line| (line, drive));
        let stop = setup.stop.map(|stop| {
            (stop.line, if stop.active_low { INPUT | ACTIVE_LOW | PULL_UP } else { INPUT | PULL_DOWN })
        });
        Self { lines: outputs.chain(stop).collect() }
    }

    fn bytes(&self) -> Vec<u8> {
        let mut bytes = vec![0; REQUEST];
        let mut put = |at: usize, value: &[u8]| {
            if let Some(place) = bytes.get_mut(at..at + value.len()) {
                place.copy_from_slice(value);
            }
        };
        for (place, (line, _)) in self.lines.iter().take(MOST).enumerate() {
            put(4 * place, &line.to_ne_bytes());
        }
        put(CONSUMER, b"whorl");
        let common = self.lines.first().map_or(0, |(_, flags)| *flags);
        put(FLAGS, &common.to_ne_bytes());
        put(NUM_LINES, &u32::try_from(self.lines.len()).unwrap_or(0).to_ne_bytes());
        let others = self.lines.iter().enumerate().filter(|(_, (_, flags))| *flags != common);
        let mut count = 0;
        for (place, (_, flags)) in others {
            let at = ATTRS + ATTR * count;
            put(at, &ATTR_FLAGS.to_ne_bytes());
            put(at + 8, &flags.to_ne_bytes());
            put(at + 16, &(1_u64 << place).to_ne_bytes());
            count += 1;
        }
        put(NUM_ATTRS, &u32::try_from(count).unwrap_or(0).to_ne_bytes());
        bytes
    }

    fn from_bytes(bytes: &[u8]) -> Self {
        let count = usize::try_from(u32_at(bytes, NUM_LINES)).unwrap_or(0).min(MOST);
        let attrs = usize::try_from(u32_at(bytes, NUM_ATTRS)).unwrap_or(0).min(10);
        let flags = |line: usize| {
            let mut attrs = (0..attrs).map(|attr| ATTRS + ATTR * attr);
            let own =
                attrs.find(|at| u32_at(bytes, *at) == ATTR_FLAGS && u64_at(bytes, at + 16) >> line & 1 == 1);
            own.map_or_else(|| u64_at(bytes, FLAGS), |at| u64_at(bytes, at + 8))
        };
        Self { lines: (0..count).map(|line| (u32_at(bytes, 4 * line), flags(line))).collect() }
    }
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    let four = bytes.get(at..at + 4).and_then(|four| four.try_into().ok());
    four.map_or(0, u32::from_ne_bytes)
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    let eight = bytes.get(at..at + 8).and_then(|eight| eight.try_into().ok());
    eight.map_or(0, u64::from_ne_bytes)
}

impl LineValues {
    fn bytes(self) -> [u8; VALUES] {
        let mut bytes = [0; VALUES];
        bytes[..8].copy_from_slice(&self.bits.to_ne_bytes());
        bytes[8..].copy_from_slice(&self.mask.to_ne_bytes());
        bytes
    }

    fn from_bytes(bytes: &[u8]) -> Self {
        Self { bits: u64_at(bytes, 0), mask: u64_at(bytes, 8) }
    }
}

impl Call {
    /// Its number and its argument.
    pub(super) fn bytes(&self) -> Vec<u8> {
        match self {
            Self::GetLine(request) => [&[GET_LINE][..], &request.bytes()].concat(),
            Self::GetValues(values) => [&[GET_VALUES][..], &values.bytes()].concat(),
            Self::SetValues(values) => [&[SET_VALUES][..], &values.bytes()].concat(),
        }
    }

    /// The call at the beginning of the bytes, which it is taken from. `Ok(None)`: it is not complete yet.
    ///
    /// # Errors
    /// There is no such call.
    pub(super) fn take(bytes: &mut Vec<u8>) -> Result<Option<Self>, &'static str> {
        let Some(number) = bytes.first().copied() else { return Ok(None) };
        let size = match number {
            GET_LINE => REQUEST,
            GET_VALUES | SET_VALUES => VALUES,
            _ => return Err("no such call"),
        };
        let Some(argument) = bytes.get(1..=size).map(<[u8]>::to_vec) else { return Ok(None) };
        bytes.drain(..=size);
        Ok(Some(match number {
            GET_LINE => Self::GetLine(LineRequest::from_bytes(&argument)),
            GET_VALUES => Self::GetValues(LineValues::from_bytes(&argument)),
            _ => Self::SetValues(LineValues::from_bytes(&argument)),
        }))
    }
}

impl Answer {
    pub(super) const SIZE: usize = 4 + VALUES;

    pub(super) fn bytes(self) -> Vec<u8> {
        [&self.error.to_ne_bytes()[..], &self.values.bytes()].concat()
    }

    pub(super) fn from_bytes(bytes: &[u8; Self::SIZE]) -> Self {
        let [e0, e1, e2, e3, ..] = *bytes;
        let values = LineValues::from_bytes(bytes.get(4..).unwrap_or_default());
        Self { error: i32::from_ne_bytes([e0, e1, e2, e3]), values }
    }
}

/// A chip: which of its lines are high, and who has requested them.
#[derive(Debug, Clone)]
pub(super) struct ChipState {
    /// Levels of the lines, as a meter would measure them.
    pub(super) is_high: Vec<bool>,
    requested: Vec<(u32, u64)>,
}

impl ChipState {
    /// So many lines, low as after a reset.
    pub(super) fn new(lines: usize) -> Self {
        Self { is_high: vec![false; lines], requested: Vec::new() }
    }

    /// The request's file descriptor was closed. Outputs stay as they were: the worst that the kernel allows ("may revert to
    /// its default state").
    pub(super) fn closed(&mut self) {
        self.requested.clear();
    }

    fn drive(&mut self, line: u32, flags: u64, active: bool) {
        if let Some(high) = usize::try_from(line).ok().and_then(|line| self.is_high.get_mut(line)) {
            *high = active != (flags & ACTIVE_LOW != 0);
        }
    }

    fn value(&self, line: u32, flags: u64) -> bool {
        let high = usize::try_from(line).ok().and_then(|line| self.is_high.get(line)).copied();
        high.unwrap_or(false) != (flags & ACTIVE_LOW != 0)
    }

    /// As the kernel would.
    pub(super) fn carry_out(&mut self, call: &Call) -> Answer {
        let failed = |error| Answer { error, values: LineValues::default() };
        match call {
            Call::GetLine(_) if !self.requested.is_empty() => failed(EBUSY),
            Call::GetLine(request) => {
                let exists = |line: u32| usize::try_from(line).is_ok_and(|line| line < self.is_high.len());
                let is_valid = |flags: u64| (flags & INPUT != 0) != (flags & OUTPUT != 0);
                if request.lines.is_empty()
                    || !request.lines.iter().all(|(line, flags)| exists(*line) && is_valid(*flags))
                {
                    return failed(EINVAL);
                }
                self.requested.clone_from(&request.lines);
                for (line, flags) in request.lines.iter().filter(|(_, flags)| flags & OUTPUT != 0) {
                    self.drive(*line, *flags, false);
                }
                Answer::default()
            }
            Call::GetValues(values) | Call::SetValues(values)
                if self.requested.is_empty() || values.mask & self.all() == 0 =>
            {
                failed(EINVAL)
            }
            Call::GetValues(LineValues { mask, .. }) => {
                let lines = self.requested.iter().enumerate();
                let active = lines.filter(|(_, (line, flags))| self.value(*line, *flags));
                let bits = active.fold(0, |bits, (place, _)| bits | 1 << place) & mask;
                Answer { error: 0, values: LineValues { bits, mask: *mask } }
            }
            Call::SetValues(values) => {
                let meant: Vec<(usize, (u32, u64))> = (self.requested.iter().copied().enumerate())
                    .filter(|(place, _)| values.mask >> place & 1 == 1)
                    .collect();
                if meant.iter().any(|(_, (_, flags))| flags & OUTPUT == 0) {
                    return failed(EPERM);
                }
                for (place, (line, flags)) in meant {
                    self.drive(line, flags, values.bits >> place & 1 == 1);
                }
                Answer { error: 0, values: *values }
            }
        }
    }

    /// Bits of the lines that were requested.
    fn all(&self) -> u64 {
        (1_u64 << self.requested.len().min(63)) - 1
    }
}
