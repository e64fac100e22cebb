//! The protocol against the maker's printed packets, and against what happens on wires.

use proptest::prelude::*;

use super::protocol::*;

/// UM001 v2.22, section 4.3.7, example case 1: group 1 with yaw, pitch and roll.
const PRINTED: [u8; 18] = [
    0xFA, 0x01, 0x08, 0x00, 0x93, 0x50, 0x2E, 0x42, 0x83, 0x3E, 0xF1, 0x3F, 0x48, 0xB5, 0x04, 0xBB, 0x92,
    0x88,
];

#[test]
fn the_printed_packet_is_read() {
    let mut parser = Parser::default();
    parser.push(&PRINTED);
    let Some(Said::Packet { groups: 1, fields, payload }) = parser.next_said() else { panic!() };
    assert_eq!(fields, [1 << 3]);
    let angles: Vec<f32> =
        payload.chunks(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect();
    assert_eq!(angles, [43.578686, 1.8847202, -2.0249654e-3]);
    assert_eq!(packet(1 << 3, &payload), PRINTED);
}

#[test]
fn the_crc_is_that_of_the_manual() {
    // As the manual's own C function computes it, step by step (3.8.3).
    let manual = |bytes: &[u8]| {
        bytes.iter().fold(0_u16, |mut crc, &byte| {
            crc = crc.rotate_left(8);
            crc ^= u16::from(byte);
            crc ^= (crc & 0xff) >> 4;
            crc ^= crc << 12;
            crc ^ (crc & 0xff) << 5
        })
    };
    for bytes in [&b"123456789"[..], &PRINTED[1..16], &[0xff; 40], &[]] {
        assert_eq!(crc16(bytes), manual(bytes));
    }
    // The check value of CRC-16/XMODEM in Greg Cook's catalogue.
    assert_eq!(crc16(b"123456789"), 0x31c3);
}

#[test]
fn a_line_has_the_checksum_of_the_manual() {
    // The exclusive or of the bytes of VNRRG,1 by hand: 56^4E^52^52^47^2C^31 is 42.
    assert_eq!(checksum(b"VNRRG,1"), 0x56 ^ 0x4e ^ 0x52 ^ 0x52 ^ 0x47 ^ 0x2c ^ 0x31);
    assert_eq!(line("VNRRG,1"), b"$VNRRG,1*42\r\n");
    let mut parser = Parser::default();
    // 3.8.1: XX skips the check.
    parser.push(b"$VNRRG,1*42\r\n$VNRRG,1*XX\r\n$VNRRG,1*43\r\n");
    assert_eq!(parser.next_said(), Some(Said::Line("VNRRG,1".into())));
    assert_eq!(parser.next_said(), Some(Said::Line("VNRRG,1".into())));
    assert_eq!(parser.next_said(), None);
    assert!(parser.take_skipped() > 0);
}

fn sample(k: u32) -> Sample {
    let x = f64::from(k as f32 * 0.25);
    Sample {
        since_start_s: f64::from(k) / 128.0,
        rate_rad_s: [x, -x, 0.5],
        specific_force_m_s2: [0.0, x, -9.75],
        field_gauss: [0.5, 0.25, 0.125],
        temperature_c: 21.5,
        pressure_kpa: 101.25,
    }
}

#[test]
fn a_packet_survives_the_wire_whatever_stands_around_it() {
    assert_eq!(sample(3).packet().len(), Sample::PACKET_BYTES);
    let mut parser = Parser::default();
    parser.push(&[0x00, SYNC, 0x01, SYNC]);
    parser.push(&sample(1).packet()[..20]);
    for k in 2..5 {
        parser.push(&sample(k).packet());
    }
    let said: Vec<Sample> =
        std::iter::from_fn(|| parser.next_said()).filter_map(|said| Sample::of(&said)).collect();
    assert_eq!(said, [sample(2), sample(3), sample(4)]);
}

proptest! {
    /// Any bytes, in any pieces: nothing panics, and the memory does not grow.
    #[test]
    fn noise_does_no_harm(pieces in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..60), 0..60)) {
        let mut parser = Parser::default();
        for piece in &pieces {
            parser.push(piece);
            while parser.next_said().is_some() {}
        }
    }

    /// Packets torn, corrupted and with noise between them: no wrong sample, and all behind the noise are found, as those that
    /// follow are longer than the longest packet that a false beginning may wait for.
    #[test]
    fn it_finds_its_way_back(
        cut in 0usize..58, flip in 0usize..58, bit in 0u8..8, noise in prop::collection::vec(any::<u8>(), 0..300),
        piece in 1usize..40,
    ) {
        let mut bytes = sample(1).packet()[..cut].to_vec();
        let mut corrupt = sample(2).packet();
        corrupt[flip] ^= 1 << bit;
        bytes.extend(corrupt);
        bytes.extend(&noise);
        // A false beginning may wait for as many bytes as the longest packet has.
        (3..14).for_each(|k| bytes.extend(sample(k).packet()));
        let mut parser = Parser::default();
        let mut found = Vec::new();
        for piece in bytes.chunks(piece) {
            parser.push(piece);
            found.extend(std::iter::from_fn(|| parser.next_said()).filter_map(|said| Sample::of(&said)));
        }
        let all: Vec<Sample> = (3..14).map(sample).collect();
        prop_assert_eq!(found, all);
    }
}
