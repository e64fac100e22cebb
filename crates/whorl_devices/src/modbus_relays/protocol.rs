//! Modbus/TCP as a board with coils hears it, as pure functions.
//!
//! Source: Modbus Organization, "MODBUS Application Protocol Specification" V1.1b3: functions 1, 5 and 15 (sections 6.1, 6.5,
//! 6.11), exceptions (7); "MODBUS Messaging on TCP/IP Implementation Guide" V1.0b, section 3.1.3 (the header).

/// Of the header: transaction, protocol, length, unit.
const HEADER: usize = 7;
/// Longest frame behind the length field (unit and 253 bytes).
const LONGEST: usize = 254;
const READ_COILS: u8 = 1;
const READ_INPUTS: u8 = 2;
const WRITE_COIL: u8 = 5;
const WRITE_COILS: u8 = 15;
const ILLEGAL_FUNCTION: u8 = 1;
const ILLEGAL_ADDRESS: u8 = 2;
const ILLEGAL_VALUE: u8 = 3;
/// Most coils in one request (6.11).
const MOST_COILS: u16 = 0x07B0;

/// A request with its header's transaction and unit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    /// Number of the transaction, which the answer repeats.
    pub transaction: u16,
    /// Unit identifier.
    pub unit: u8,
    /// Function code and data.
    pub pdu: Vec<u8>,
}

impl Frame {
    /// With its header.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        let length = u16::try_from(self.pdu.len() + 1).unwrap_or(u16::MAX);
        let mut bytes = self.transaction.to_be_bytes().to_vec();
        bytes.extend([0, 0]);
        bytes.extend(length.to_be_bytes());
        bytes.push(self.unit);
        bytes.extend(&self.pdu);
        bytes
    }
}

/// The frame at the beginning of the bytes, which it is taken from. `Ok(None)`: it is not complete yet.
///
/// # Errors
/// These bytes are no Modbus; the connection must be closed, because TCP loses nothing that one could wait for.
pub fn take_frame(bytes: &mut Vec<u8>) -> Result<Option<Frame>, &'static str> {
    let Some(&[t0, t1, p0, p1, l0, l1, unit]) = bytes.get(..HEADER) else { return Ok(None) };
    if [p0, p1] != [0, 0] {
        return Err("the protocol identifier is not 0");
    }
    let length = usize::from(u16::from_be_bytes([l0, l1]));
    if !(2..=LONGEST).contains(&length) {
        return Err("the length is not within 2 to 254");
    }
    let whole = HEADER - 1 + length;
    let Some(pdu) = bytes.get(HEADER..whole).map(<[u8]>::to_vec) else { return Ok(None) };
    bytes.drain(..whole);
    Ok(Some(Frame { transaction: u16::from_be_bytes([t0, t1]), unit, pdu }))
}

/// Carries a request out on a board's coils and discrete inputs, and gives the answer's function code and data.
pub fn carry_out(pdu: &[u8], coils: &mut [bool], inputs: &mut [bool]) -> Vec<u8> {
    let function = pdu.first().copied().unwrap_or(0);
    let result = match (function, pdu.get(1..).unwrap_or_default()) {
        (READ_COILS, &[a0, a1, c0, c1]) => {
            read_coils(u16::from_be_bytes([a0, a1]), u16::from_be_bytes([c0, c1]), coils)
        }
        (READ_INPUTS, &[a0, a1, c0, c1]) => {
            read_coils(u16::from_be_bytes([a0, a1]), u16::from_be_bytes([c0, c1]), inputs)
        }
        (WRITE_COIL, &[a0, a1, v0, v1]) => write_coil(u16::from_be_bytes([a0, a1]), [v0, v1], coils),
        (WRITE_COILS, &[a0, a1, c0, c1, bytes, ref values @ ..]) => {
            write_coils([a0, a1], [c0, c1], usize::from(bytes), values, coils)
        }
        (READ_COILS | READ_INPUTS | WRITE_COIL | WRITE_COILS, _) => Err(ILLEGAL_VALUE),
        _ => Err(ILLEGAL_FUNCTION),
    };
    match result {
        Ok(data) => [&[function][..], &data].concat(),
        Err(exception) => vec![function | 0x80, exception],
    }
}

fn within(first: u16, count: u16, coils: &mut [bool]) -> Result<&mut [bool], u8> {
    let first = usize::from(first);
    coils.get_mut(first..first + usize::from(count)).ok_or(ILLEGAL_ADDRESS)
}

fn read_coils(first: u16, count: u16, coils: &mut [bool]) -> Result<Vec<u8>, u8> {
    if !(1..=2000).contains(&count) {
        return Err(ILLEGAL_VALUE);
    }
    let packed: Vec<u8> = within(first, count, coils)?
        .chunks(8)
        .map(|eight| eight.iter().enumerate().fold(0, |byte, (bit, on)| byte | u8::from(*on) << bit))
        .collect();
    Ok([&[u8::try_from(packed.len()).unwrap_or(u8::MAX)][..], &packed].concat())
}

fn write_coil(address: u16, value: [u8; 2], coils: &mut [bool]) -> Result<Vec<u8>, u8> {
    let on = match value {
        [0xFF, 0x00] => true,
        [0x00, 0x00] => false,
        _ => return Err(ILLEGAL_VALUE),
    };
    within(address, 1, coils)?.fill(on);
    Ok([address.to_be_bytes(), value].concat())
}

fn write_coils(
    first: [u8; 2],
    count: [u8; 2],
    bytes: usize,
    values: &[u8],
    coils: &mut [bool],
) -> Result<Vec<u8>, u8> {
    let number = u16::from_be_bytes(count);
    if !(1..=MOST_COILS).contains(&number)
        || bytes != usize::from(number.div_ceil(8))
        || values.len() != bytes
    {
        return Err(ILLEGAL_VALUE);
    }
    for (index, coil) in within(u16::from_be_bytes(first), number, coils)?.iter_mut().enumerate() {
        *coil = values.get(index / 8).is_some_and(|byte| byte >> (index % 8) & 1 == 1);
    }
    Ok([first, count].concat())
}
