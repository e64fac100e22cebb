//! The wire protocol of VectorNav sensors, as pure functions.
//!
//! Source: VectorNav, "VN-100 User Manual", UM001 v2.22 (firmware 2.1): section 3.8 (8-bit checksum and CRC-16), 4.2
//! (binary output registers), 4.3 (packets, sizes of fields in 4.3.6). Example case 1 of 4.3.7 is a test. Example case 2
//! contradicts itself in that edition: its field word names ImuStatus where it prints a temperature, and its CRC fits neither.

/// First byte of a binary packet (4.3.1).
pub const SYNC: u8 = 0xFA;
/// Bits of group 1 (table in 4.2.2).
pub const TIME_STARTUP: u16 = 1 << 0;
/// Compensated angular rate \[rad/s\].
pub const ANGULAR_RATE: u16 = 1 << 5;
/// Compensated acceleration, gravity included [m/s^2].
pub const ACCEL: u16 = 1 << 8;
/// Magnetic field \[gauss\], temperature \[deg C\] and pressure \[kPa\].
pub const MAG_PRES: u16 = 1 << 10;
/// The packet that a session asks for.
pub const FIELDS: u16 = TIME_STARTUP | ANGULAR_RATE | ACCEL | MAG_PRES;

/// Bytes of each field of group 1, from bit 0.
const GROUP_1: [usize; 15] = [8, 8, 8, 12, 16, 12, 24, 12, 12, 24, 20, 28, 2, 4, 8];
/// Bytes of each field of group 3, from bit 0.
const GROUP_3: [usize; 11] = [2, 12, 12, 12, 4, 4, 16, 12, 12, 12, 12];
/// The longest line of text that the sensor sends.
const LONGEST_LINE: usize = 256;

/// CRC-16 of a packet (3.8.3), CCITT polynomial from 0. Over everything behind the sync byte, the CRC itself
/// included, it is 0.
#[must_use]
pub fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0, |crc, &byte| {
        (0..8).fold(
            crc ^ u16::from(byte) << 8,
            |crc: u16, _| {
                if crc & 0x8000 == 0 { crc << 1 } else { crc << 1 ^ 0x1021 }
            },
        )
    })
}

/// 8-bit checksum of a line of text, of what stands between `$` and `*` (3.8.2).
#[must_use]
pub fn checksum(text: &[u8]) -> u8 {
    text.iter().fold(0, |sum, byte| sum ^ byte)
}

/// A line of text with frame, checksum and end of line.
#[must_use]
pub fn line(text: &str) -> Vec<u8> {
    format!("${text}*{:02X}\r\n", checksum(text.as_bytes())).into_bytes()
}

/// A binary packet with one group.
#[must_use]
pub fn packet(fields: u16, payload: &[u8]) -> Vec<u8> {
    let mut bytes = vec![SYNC, 0x01];
    bytes.extend(fields.to_le_bytes());
    bytes.extend(payload);
    let crc = crc16(bytes.get(1..).unwrap_or_default());
    bytes.extend(crc.to_be_bytes());
    bytes
}

/// What the sensor said.
#[derive(Debug, Clone, PartialEq)]
pub enum Said {
    /// A packet: group bits, field bits of each group, payload.
    Packet {
        /// Bit 0 is group 1.
        groups: u8,
        /// Field bits of each group that is there, in order.
        fields: Vec<u16>,
        /// The fields, little-endian.
        payload: Vec<u8>,
    },
    /// A line of text, what stood between `$` and `*`.
    Line(String),
}

/// The fields of a packet with [`FIELDS`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Time since the sensor's start \[s\].
    pub since_start_s: f64,
    /// Angular rate, sensor axes [rad/s].
    pub rate_rad_s: [f64; 3],
    /// Specific force, sensor axes [m/s^2].
    pub specific_force_m_s2: [f64; 3],
    /// Magnetic field, sensor axes \[gauss\].
    pub field_gauss: [f64; 3],
    /// Temperature \[deg C\].
    pub temperature_c: f64,
    /// Air pressure \[kPa\].
    pub pressure_kpa: f64,
}

impl Sample {
    /// Bytes of its packet.
    pub const PACKET_BYTES: usize = 4 + 52 + 2;

    /// From a packet's parts; `None` for another packet.
    #[must_use]
    pub fn of(said: &Said) -> Option<Self> {
        let Said::Packet { groups: 1, fields, payload } = said else { return None };
        if *fields != [FIELDS] {
            return None;
        }
        let nanoseconds = u64::from_le_bytes(payload.get(..8)?.try_into().ok()?);
        let mut numbers = payload
            .get(8..)?
            .chunks_exact(4)
            .filter_map(|four| Some(f64::from(f32::from_le_bytes(four.try_into().ok()?))));
        let mut three = || Some([numbers.next()?, numbers.next()?, numbers.next()?]);
        Some(Self {
            since_start_s: nanoseconds as f64 / 1e9,
            rate_rad_s: three()?,
            specific_force_m_s2: three()?,
            field_gauss: three()?,
            temperature_c: numbers.next()?,
            pressure_kpa: numbers.next()?,
        })
    }

    /// As a packet.
    #[must_use]
    pub fn packet(&self) -> Vec<u8> {
        let mut payload = ((self.since_start_s * 1e9).round() as u64).to_le_bytes().to_vec();
        let vectors = [self.rate_rad_s, self.specific_force_m_s2, self.field_gauss];
        for number in vectors.into_iter().flatten().chain([self.temperature_c, self.pressure_kpa]) {
            payload.extend((number as f32).to_le_bytes());
        }
        packet(FIELDS, &payload)
    }
}

/// Takes bytes in any pieces and finds packets and lines. What is torn or corrupt is skipped and counted; the next whole
/// packet is found whatever came before.
#[derive(Debug, Clone, Default)]
pub struct Parser {
    bytes: Vec<u8>,
    skipped: u64,
}

/// What stands at the beginning of the bytes.
enum Beginning {
    /// It may become something; more bytes are needed.
    Open,
    /// Nothing that begins here.
    Nothing,
    /// Something, and its length.
    Whole(Said, usize),
}

impl Parser {
    /// Adds bytes.
    pub fn push(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    /// The next packet or line.
    pub fn next_said(&mut self) -> Option<Said> {
        loop {
            match beginning(&self.bytes) {
                Beginning::Open => return None,
                Beginning::Nothing => {
                    // On to the next byte that something can begin with.
                    let rest = self.bytes.get(1..).unwrap_or_default();
                    let next = rest.iter().position(|byte| [SYNC, b'$'].contains(byte)).unwrap_or(rest.len());
                    let ends_line = |byte: &u8| [b'\r', b'\n'].contains(byte);
                    self.skipped += self.bytes.drain(..=next).filter(|byte| !ends_line(byte)).count() as u64;
                }
                Beginning::Whole(said, length) => {
                    self.bytes.drain(..length.min(self.bytes.len()));
                    return Some(said);
                }
            }
        }
    }

    /// Bytes that were skipped since the last call.
    pub fn take_skipped(&mut self) -> u64 {
        std::mem::take(&mut self.skipped)
    }
}

fn beginning(bytes: &[u8]) -> Beginning {
    match bytes.first() {
        None => Beginning::Open,
        Some(&SYNC) => packet_at(bytes),
        Some(b'$') => line_at(bytes),
        Some(_) => Beginning::Nothing,
    }
}

fn packet_at(bytes: &[u8]) -> Beginning {
    let Some(&groups) = bytes.get(1) else { return Beginning::Open };
    // Groups 1 and 3 alone; this sensor is asked for nothing else.
    if groups == 0 || groups & !0b101 != 0 {
        return Beginning::Nothing;
    }
    let (mut fields, mut length, mut at) = (Vec::new(), 0, 2);
    for (bit, sizes) in [(0b001, &GROUP_1[..]), (0b100, &GROUP_3[..])] {
        if groups & bit == 0 {
            continue;
        }
        let Some(&[low, high]) = bytes.get(at..at + 2) else { return Beginning::Open };
        let word = u16::from_le_bytes([low, high]);
        if word == 0 || word.checked_shr(sizes.len() as u32).unwrap_or(0) != 0 {
            return Beginning::Nothing;
        }
        length +=
            sizes.iter().enumerate().filter(|(bit, _)| word >> bit & 1 == 1).map(|(_, n)| n).sum::<usize>();
        fields.push(word);
        at += 2;
    }
    let Some(whole) = bytes.get(1..at + length + 2) else { return Beginning::Open };
    if crc16(whole) != 0 {
        return Beginning::Nothing;
    }
    let payload = bytes.get(at..at + length).unwrap_or_default().to_vec();
    Beginning::Whole(Said::Packet { groups, fields, payload }, at + length + 2)
}

fn line_at(bytes: &[u8]) -> Beginning {
    let Some(end) = bytes.iter().take(LONGEST_LINE).position(|byte| *byte == b'\n') else {
        return if bytes.len() < LONGEST_LINE { Beginning::Open } else { Beginning::Nothing };
    };
    let text = bytes.get(1..end).unwrap_or_default().trim_ascii_end();
    let parsed = (|| {
        let star = text.iter().rposition(|byte| *byte == b'*')?;
        let (body, sum) = (text.get(..star)?, std::str::from_utf8(text.get(star + 1..)?).ok()?);
        let right = sum == "XX" || u8::from_str_radix(sum, 16).ok() == Some(checksum(body));
        (right && body.is_ascii()).then(|| String::from_utf8_lossy(body).into_owned())
    })();
    parsed.map_or(Beginning::Nothing, |line| Beginning::Whole(Said::Line(line), end + 1))
}
