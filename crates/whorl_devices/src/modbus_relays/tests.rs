//! The board's side of the protocol against the specification's printed examples, and the schedule of pulses.

use std::time::{Duration, Instant};

use proptest::prelude::*;

use super::Relays;
use super::protocol::{Frame, carry_out, take_frame};
use crate::Place;
use crate::schedule::Schedule;
use crate::valves::Outlet;
use crate::valves_bench::valves_are_shut;

#[test]
fn ten_coils_from_20_on_are_written_as_printed() {
    // V1.1b3, 6.11: request 0F 00 13 00 0A 02 CD 01, answer 0F 00 13 00 0A; coils 27 to 20 are 1100 1101, 29 and 28 are 01.
    let mut coils = vec![false; 40];
    assert_eq!(
        carry_out(&[0x0F, 0x00, 0x13, 0x00, 0x0A, 0x02, 0xCD, 0x01], &mut coils, &mut []),
        [0x0F, 0x00, 0x13, 0x00, 0x0A]
    );
    let written: Vec<u8> = coils[19..29].iter().map(|on| u8::from(*on)).collect();
    assert_eq!(written, [1, 0, 1, 1, 0, 0, 1, 1, 1, 0]);
    assert!(coils[..19].iter().chain(&coils[29..]).all(|on| !on));
    // 6.5: output 173 on: 05 00 AC FF 00, answered as it was asked.
    let mut coils = vec![false; 200];
    assert_eq!(
        carry_out(&[0x05, 0x00, 0xAC, 0xFF, 0x00], &mut coils, &mut []),
        [0x05, 0x00, 0xAC, 0xFF, 0x00]
    );
    assert!(coils[172]);
    // 6.1: coils 20 to 38 are CD 6B 05.
    let packed = [0xCD_u8, 0x6B, 0x05];
    (0..19).for_each(|k| coils[19 + k] = packed[k / 8] >> (k % 8) & 1 == 1);
    // 6.2: inputs 197 to 218 are AC DB 35.
    let mut inputs = vec![false; 218];
    let bits = [0xAC_u8, 0xDB, 0x35];
    (0..22).for_each(|k| inputs[196 + k] = bits[k / 8] >> (k % 8) & 1 == 1);
    assert_eq!(
        carry_out(&[0x02, 0x00, 0xC4, 0x00, 0x16], &mut [], &mut inputs),
        [0x02, 0x03, 0xAC, 0xDB, 0x35]
    );
    assert_eq!(
        carry_out(&[0x01, 0x00, 0x13, 0x00, 0x13], &mut coils, &mut []),
        [0x01, 0x03, 0xCD, 0x6B, 0x05]
    );
}

#[test]
fn what_a_board_does_not_have_is_an_exception() {
    let mut coils = vec![true; 8];
    assert_eq!(carry_out(&[0x0F, 0, 4, 0, 8, 1, 0], &mut coils, &mut []), [0x8F, 2]);
    assert_eq!(carry_out(&[0x0F, 0, 0, 0, 8, 2, 0, 0], &mut coils, &mut []), [0x8F, 3]);
    assert_eq!(carry_out(&[0x05, 0, 0, 1, 0], &mut coils, &mut []), [0x85, 3]);
    assert_eq!(carry_out(&[0x2B, 0], &mut coils, &mut []), [0xAB, 1]);
    assert!(coils.iter().all(|on| *on));
}

#[test]
fn a_slot_replaces_the_one_before_and_short_pulses_are_none() {
    let now = Instant::now();
    let ms = |ms: u64| now + Duration::from_millis(ms);
    let mut schedule = Schedule::new(vec![(4, 0.01), (2, 0.01)]);
    // Unknown: closed valves are written as well.
    assert!(schedule.advance(now));
    assert_eq!(schedule.written(), [(4, false), (2, false)]);
    schedule.pulses(now, &[0.0, 0.0, 0.03, 0.0, 0.009]);
    assert!(schedule.advance(ms(1)));
    assert_eq!(schedule.wanted(), [false, true]);
    assert_eq!(schedule.written(), [(2, true)]);
    assert_eq!(schedule.next_edge(), Some(ms(30)));
    // Commanded again: it stays open, now until 45 ms; the other opens.
    schedule.pulses(ms(20), &[0.0, 0.0, 0.025, 0.0, 0.01]);
    assert!(schedule.advance(ms(20)));
    assert_eq!(schedule.written(), [(4, true)]);
    assert!(schedule.advance(ms(31)));
    assert_eq!(schedule.written(), [(4, false)]);
    assert_eq!(schedule.next_edge(), Some(ms(45)));
    assert!(!schedule.advance(ms(44)) && schedule.advance(ms(45)));
    schedule.pulses(ms(50), &[1.0; 5]);
    schedule.close();
    schedule.advance(ms(51));
    assert_eq!(schedule.wanted(), [false, false]);
}

proptest! {
    #[test]
    fn noise_does_no_harm(mut bytes in prop::collection::vec(any::<u8>(), 0..400), size in 0usize..40) {
        let mut coils = vec![false; size];
        while let Ok(Some(frame)) = take_frame(&mut bytes) {
            let answer = carry_out(&frame.pdu, &mut coils, &mut []);
            prop_assert!(answer.len() <= 253);
        }
    }

    #[test]
    fn frames_are_found_in_any_pieces(values in prop::collection::vec(any::<bool>(), 1..40), piece in 1usize..9) {
        let mut packed = vec![0_u8; values.len().div_ceil(8)];
        values.iter().enumerate().for_each(|(k, on)| packed[k / 8] |= u8::from(*on) << (k % 8));
        let mut pdu = vec![0x0F, 0, 0, 0, values.len() as u8, packed.len() as u8];
        pdu.extend(packed);
        let frames: Vec<Frame> = (7..10).map(|transaction| Frame { transaction, unit: 1, pdu: pdu.clone() }).collect();
        let (mut received, mut found) = (Vec::new(), Vec::new());
        for piece in frames.iter().flat_map(Frame::bytes).collect::<Vec<u8>>().chunks(piece) {
            received.extend_from_slice(piece);
            while let Some(frame) = take_frame(&mut received).unwrap() {
                found.push(frame);
            }
        }
        prop_assert_eq!(&found, &frames);
        let mut coils = vec![false; values.len()];
        carry_out(&found[0].pdu, &mut coils, &mut []);
        prop_assert_eq!(coils, values);
    }
}

/// A board with this many coils, and where it is.
fn board(coils: usize) -> (std::sync::Arc<std::sync::Mutex<Vec<bool>>>, String) {
    use std::io::{Read, Write};
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let host = listener.local_addr().unwrap().to_string();
    let state = std::sync::Arc::new(std::sync::Mutex::new(vec![false; coils]));
    let coils = std::sync::Arc::clone(&state);
    std::thread::spawn(move || {
        for mut socket in listener.incoming().flatten() {
            let (mut received, mut buffer) = (Vec::new(), [0; 512]);
            while let Ok(count @ 1..) = socket.read(&mut buffer) {
                received.extend_from_slice(&buffer[..count]);
                while let Some(mut frame) = take_frame(&mut received).unwrap() {
                    frame.pdu = carry_out(&frame.pdu, &mut coils.lock().unwrap(), &mut []);
                    socket.write_all(&frame.bytes()).unwrap();
                }
            }
        }
    });
    (state, host)
}

#[test]
fn valves_are_shut_whatever_ends_the_session() {
    let (coils, host) = board(6);
    let outlet = |jet, output| Outlet { output, jet, shortest_s: 0.01 };
    let relays = Relays {
        host,
        unit: 1,
        first_coil: 3,
        watchdog_s: 0.0,
        stop_input: None,
        coils: vec![outlet(0, 3), outlet(1, 4)],
    };
    let is_open = |jet: usize| coils.lock().unwrap()[3 + jet];
    valves_are_shut(relays, &Place::default(), &is_open);
}
