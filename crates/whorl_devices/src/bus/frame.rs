//! Frames of a CAN bus, and the records in which Linux hands them over.

use std::time::Duration;

/// A classical CAN frame with a standard identifier.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    /// 11 bit.
    pub id: u16,
    /// It asks for the frame of its identifier.
    pub is_remote: bool,
    length: u8,
    data: [u8; 8],
}

impl Frame {
    /// Bytes of a record.
    pub const RECORD: usize = 16;
    /// Largest standard identifier.
    pub const LARGEST_ID: u16 = 0x7FF;
    /// Flags of a record's identifier (linux/can.h: `CAN_EFF_FLAG`, `CAN_RTR_FLAG`, `CAN_ERR_FLAG`).
    pub const EXTENDED: u32 = 0x8000_0000;
    const REMOTE: u32 = 0x4000_0000;
    const ERROR: u32 = 0x2000_0000;

    /// A frame with these data, of which the first eight bytes count.
    #[must_use]
    pub fn new(id: u16, bytes: &[u8]) -> Self {
        let mut data = [0; 8];
        data.iter_mut().zip(bytes).for_each(|(to, from)| *to = *from);
        let length = u8::try_from(bytes.len().min(8)).unwrap_or(8);
        Self { id: id & Self::LARGEST_ID, is_remote: false, length, data }
    }

    /// A frame that asks for another.
    #[must_use]
    pub fn remote(id: u16, length: u8) -> Self {
        Self { is_remote: true, length: length.min(8), ..Self::new(id, &[]) }
    }

    /// What it carries.
    #[must_use]
    pub fn data(&self) -> &[u8] {
        let length = if self.is_remote { 0 } else { usize::from(self.length) };
        self.data.get(..length).unwrap_or_default()
    }

    /// Bytes from here on, if it carries as many.
    #[must_use]
    pub fn bytes<const N: usize>(&self, from: usize) -> Option<[u8; N]> {
        self.data().get(from..from + N)?.try_into().ok()
    }

    /// Longest time on the bus: 47 bits and the data, and a stuffed bit after every four of those that may be stuffed.
    #[must_use]
    pub fn longest(bytes: usize, bit_rate: u32) -> Duration {
        let bits = 47 + 8 * bytes + (34 + 8 * bytes - 1) / 4;
        Duration::from_secs_f64(bits as f64 / f64::from(bit_rate.max(1)))
    }

    /// Its time on the bus.
    #[must_use]
    pub fn duration(&self, bit_rate: u32) -> Duration {
        Self::longest(self.data().len(), bit_rate)
    }

    /// As Linux has it, in this computer's order of bytes.
    #[must_use]
    pub fn record(&self) -> [u8; Self::RECORD] {
        let flags = if self.is_remote { Self::REMOTE } else { 0 };
        let [a, b, c, d] = (u32::from(self.id) | flags).to_ne_bytes();
        let [e, f, g, h, i, j, k, l] = self.data;
        [a, b, c, d, self.length, 0, 0, 0, e, f, g, h, i, j, k, l]
    }
}

/// What a record says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Record {
    /// A frame.
    Frame(Frame),
    /// An error of the bus.
    Error,
    /// A frame of another kind, for somebody else.
    Other,
}

/// Finds records among bytes, also where some are missing.
#[derive(Debug, Clone, Default)]
pub struct Records {
    waiting: Vec<u8>,
    refused: u64,
}

impl Records {
    /// Takes bytes.
    pub fn push(&mut self, bytes: &[u8]) {
        self.waiting.extend_from_slice(bytes);
    }

    /// Forgets what has not become a record.
    pub fn clear(&mut self) {
        self.waiting.clear();
    }

    /// The next one.
    pub fn next_record(&mut self) -> Option<Record> {
        loop {
            let bytes: [u8; Frame::RECORD] = self.waiting.get(..Frame::RECORD)?.try_into().ok()?;
            if let Some(record) = read(bytes) {
                self.waiting.drain(..Frame::RECORD);
                return Some(record);
            }
            self.waiting.drain(..1);
            self.refused += 1;
        }
    }

    /// Bytes that were no record, since the last call.
    pub fn take_refused(&mut self) -> u64 {
        std::mem::take(&mut self.refused)
    }
}

/// What these bytes are; `None`: no record.
fn read(bytes: [u8; Frame::RECORD]) -> Option<Record> {
    let [a, b, c, d, length, flags, reserved, long, data @ ..] = bytes;
    // Padding, and the length code of frames whose code says more than eight bytes.
    if length > 8 || flags != 0 || reserved != 0 || long > 15 {
        return None;
    }
    let id = u32::from_ne_bytes([a, b, c, d]);
    if id & Frame::ERROR != 0 {
        // Classes of errors have the low bits (linux/can/error.h).
        return (id & !Frame::ERROR <= 0xFFFF).then_some(Record::Error);
    }
    if id & Frame::EXTENDED != 0 {
        return Some(Record::Other);
    }
    let is_remote = id & Frame::REMOTE != 0;
    let id = u16::try_from(id & !Frame::REMOTE).ok().filter(|id| *id <= Frame::LARGEST_ID)?;
    Some(Record::Frame(Frame { id, is_remote, length, data }))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn all(records: &mut Records) -> Vec<Record> {
        std::iter::from_fn(|| records.next_record()).collect()
    }

    #[test]
    fn records_are_those_of_the_kernel() {
        // linux/can.h: u32 can_id, u8 len, u8 pad, u8 res0, u8 len8_dlc, u8 data[8]; on a little-endian computer.
        let frame = Frame::new(0x181, &[1, 2, 3]);
        if cfg!(target_endian = "little") {
            assert_eq!(frame.record(), [0x81, 1, 0, 0, 3, 0, 0, 0, 1, 2, 3, 0, 0, 0, 0, 0]);
            let asks = Frame::remote(0x29, 8);
            assert_eq!(asks.record(), [0x29, 0, 0, 0x40, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
            assert_eq!(asks.data(), []);
        }
        assert_eq!((frame.bytes::<2>(1), frame.bytes::<2>(2)), (Some([2, 3]), None));
        // The longest frame: 111 bits with 8 bytes, 24 of them stuffed.
        assert_eq!(Frame::longest(8, 1_000_000).as_micros(), 135);
    }

    #[test]
    fn errors_and_extended_frames_are_told_apart() {
        let mut records = Records::default();
        let mut record = Frame::new(0x40, &[]).record();
        record[3] |= 0x20;
        records.push(&record);
        record[3] = 0x80;
        records.push(&record);
        assert_eq!(all(&mut records), [Record::Error, Record::Other]);
    }

    proptest! {
        /// Whatever was on the line before: no panic, and what follows is found again.
        #[test]
        fn records_are_found_again(noise in prop::collection::vec(any::<u8>(), 0..100), ids in prop::collection::vec(0u16..0x800, 4..20)) {
            let frames: Vec<Frame> = ids.iter().map(|id| Frame::new(*id, &[0xFF; 8])).collect();
            let mut records = Records::default();
            records.push(&noise);
            for frame in &frames {
                records.push(&frame.record());
            }
            let found = all(&mut records);
            prop_assert_eq!(found.last().copied(), frames.last().map(|frame| Record::Frame(*frame)));
        }

        /// Bytes that begin no record are refused one by one, and no frame after them is lost, whatever of a record they
        /// make with the first bytes of it: identifiers below 32 look like lengths and codes.
        #[test]
        fn nothing_after_a_broken_record_is_lost(noise in 1usize..60, ids in prop::collection::vec(0u16..0x20, 1..9)) {
            let frames: Vec<Frame> = ids.iter().map(|id| Frame::new(*id, &[0xFF; 8])).collect();
            let mut records = Records::default();
            records.push(&vec![0xFF; noise]);
            frames.iter().for_each(|frame| records.push(&frame.record()));
            prop_assert_eq!(all(&mut records), frames.into_iter().map(Record::Frame).collect::<Vec<_>>());
            prop_assert_eq!(records.take_refused(), noise as u64);
        }

        #[test]
        fn records_come_in_any_pieces(ids in prop::collection::vec(0u16..0x800, 1..20), piece in 1usize..40) {
            let frames: Vec<Frame> = ids.iter().map(|id| Frame::new(*id, &id.to_le_bytes())).collect();
            let bytes: Vec<u8> = frames.iter().flat_map(Frame::record).collect();
            let (mut records, mut found) = (Records::default(), Vec::new());
            for piece in bytes.chunks(piece) {
                records.push(piece);
                found.extend(all(&mut records));
            }
            prop_assert_eq!(found, frames.into_iter().map(Record::Frame).collect::<Vec<_>>());
            prop_assert_eq!(records.take_refused(), 0);
        }
    }
}
