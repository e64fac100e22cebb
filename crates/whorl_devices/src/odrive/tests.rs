//! The protocol against what the maker's documentation prints, and a whole bus over its bytes.

use std::f64::consts::TAU;
use std::time::{Duration, Instant};

use proptest::prelude::*;

use super::protocol::*;
use super::session;
use crate::bus::{Can, Frame};
use crate::can_motors::bench::{
    a_stuck_motor_shows, emulated, motors, spoilt_frames_do_no_harm, wheels_turn_as_told,
};
use crate::can_motors::{Drives, Setpoint};
use crate::place::Place;

const TORQUE: &str = "wheels: {kind: odrive_motors, bus: can0, motors: \
     {wheel_x: {node: 0}, wheel_y: {node: 1, sign: -1}, wheel_z: {node: 5}}}";

#[test]
fn messages_are_as_printed() {
    // "can_id = axis_id << 5 | cmd_id": 0x01 << 5 | 0x0C = 0x2C; so 0x0D of node 1 is 0x2D.
    assert_eq!(identifier(Message::SetInputVel, 1), 0x2D);
    assert_eq!(identifier(Message::Heartbeat, 0), 0x01);
    assert_eq!(identifier(Message::ClearErrors, 0x3E), 0x7D8);
    // Little endian, IEEE 754: -2.5 is C0200000, 0.25 is 3E800000.
    let vel = set_input_vel(1, -2.5 * TAU, 0.25);
    assert_eq!(vel.data(), [0x00, 0x00, 0x20, 0xC0, 0x00, 0x00, 0x80, 0x3E]);
    assert_eq!(set_input_torque(1, 0.25), Frame::new(0x2E, &[0x00, 0x00, 0x80, 0x3E]));
    assert_eq!(set_axis_state(1, CLOSED_LOOP), Frame::new(0x27, &[8, 0, 0, 0]));
    let mode = set_controller_mode(1, VELOCITY_CONTROL, PASSTHROUGH);
    assert_eq!(mode, Frame::new(0x2B, &[2, 0, 0, 0, 1, 0, 0, 0]));
    assert!(ask_encoder_estimates(1).is_remote);
    // The heartbeat's state is its fifth byte: homing is 11.
    let beat = heartbeat(&Frame::new(0x01, &[0, 2, 0, 1, 0x0B, 1, 0, 0])).unwrap();
    assert_eq!(beat, Heartbeat { error: 0x0100_0200, state: 11, result: 1 });
    assert_eq!(error_words(beat.error), "bus undervoltage, its watchdog has not heard the driver");
}

#[test]
fn speeds_that_are_none_are_refused() {
    let estimates = |turns_s: f32| {
        let data: Vec<u8> = [1.0_f32, turns_s].into_iter().flat_map(f32::to_le_bytes).collect();
        encoder_estimates(&Frame::new(0x29, &data))
    };
    let (angle, speed) = estimates(-3.0).unwrap();
    assert!((angle - TAU).abs() < 1e-9 && (speed + 3.0 * TAU).abs() < 1e-9);
    assert_eq!(estimates(f32::NAN), None);
    assert_eq!(encoder_estimates(&Frame::new(0x29, &[0; 7])), None);
}

proptest! {
    #[test]
    fn noise_does_no_harm(id in 0u16..0x800, data in prop::collection::vec(any::<u8>(), 0..9)) {
        let frame = Frame::new(id, &data);
        let _ = (heartbeat(&frame), encoder_estimates(&frame));
    }
}

#[test]
fn wheels_turn_in_torque_mode() {
    wheels_turn_as_told(TORQUE);
}

#[test]
fn wheels_turn_in_speed_mode() {
    wheels_turn_as_told(&TORQUE.replace("bus: can0,", "bus: can0, mode: speed,"));
}

#[test]
fn spoilt_frames() {
    spoilt_frames_do_no_harm(TORQUE);
}

#[test]
fn a_stuck_motor() {
    a_stuck_motor_shows(TORQUE);
}

/// The controller's own watchdog, and that its error is said and forgotten.
#[test]
fn controllers_switch_off_when_nothing_comes() {
    emulated(TORQUE, Vec::new(), |root| {
        let group =
            "{bus: can0, motors: {wheel_x: {node: 0}, wheel_y: {node: 1, sign: -1}, wheel_z: {node: 5}}}";
        let setup = super::Controllers { motors: motors(group, &super::TRAITS) };
        let place = Place::below(root);
        let ids = setup.heard();
        let mut can = Can::open(&setup.motors.bus, &place, &ids, &setup.motors.emulated(&ids)).unwrap();
        let mut protocol = session::Protocol::new(&setup.motors);
        protocol.start(&mut can).unwrap();
        let wanted = [Setpoint { torque_n_m: 0.1, speed_rad_s: 0.0 }; 3];
        // What is said to the controllers, and until when.
        let mut until =
            |says: Option<&[Setpoint]>, is_silent: bool, is_so: &dyn Fn(Option<String>) -> bool| {
                let begin = Instant::now();
                loop {
                    if !is_silent {
                        can.write(&protocol.cycle(says, Instant::now())).unwrap();
                    }
                    std::thread::sleep(Duration::from_millis(10));
                    let mut heard = Vec::new();
                    can.read(&mut heard).unwrap();
                    heard.iter().for_each(|frame| _ = protocol.heard(frame, Instant::now()));
                    let fault = protocol.fault(Instant::now());
                    if is_so(fault.clone()) {
                        return;
                    }
                    assert!(begin.elapsed() < Duration::from_secs(60), "{fault:?}");
                }
            };
        until(Some(&wanted), false, &|fault| fault.is_none());
        let expired = "node 5: its watchdog has not heard the driver";
        until(None, true, &|fault| fault.is_some_and(|text| text.contains(expired)));
        until(None, false, &|fault| fault.is_none());
    });
}
