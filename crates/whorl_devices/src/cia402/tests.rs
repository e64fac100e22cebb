//! The protocol against what the makers' documents print, and a whole bus over its bytes.

use std::time::{Duration, Instant};

use proptest::prelude::*;

use super::protocol::*;
use super::{Controllers, session};
use crate::bus::{Can, Frame};
use crate::can_motors::bench::{
    Bench, a_stuck_motor_shows, emulated, list, motors, spoilt_frames_do_no_harm, wheels_turn_as_told,
};
use crate::can_motors::{Drives, Setpoint};
use crate::mailbox::Command;
use crate::place::Place;
use crate::reading::State as Told;

const TORQUE: &str = "wheels: {kind: cia402_motors, bus: can0, rated_torque_n_m: 0.25, motors: \
     {wheel_x: {node: 1}, wheel_y: {node: 2, sign: -1}, wheel_z: {node: 3}}}";

const NODES: &str =
    "{bus: can0, motors: {wheel_x: {node: 1}, wheel_y: {node: 2, sign: -1}, wheel_z: {node: 3}}}";

fn speed() -> String {
    TORQUE.replace("bus: can0,", "bus: 'tcp:10.0.0.7:20100', mode: speed,")
}

#[test]
fn identifiers_are_those_of_the_predefined_connection_set() {
    // CiA 301: function code and node; node 2's questions are 0x602, its answers 0x582.
    let of = |service| identifier(service, 2);
    assert_eq!((of(Service::SdoQuestion), of(Service::SdoAnswer)), (0x602, 0x582));
    assert_eq!((of(Service::ReceivePdo), of(Service::TransmitPdo)), (0x202, 0x182));
    assert_eq!((of(Service::Emergency), of(Service::Heartbeat)), (0x082, 0x702));
    assert_eq!(nmt(Nmt::Start, 2), Frame::new(0, &[0x01, 0x02]));
    assert_eq!(nmt(Nmt::PreOperational, 0), Frame::new(0, &[0x80, 0x00]));
}

#[test]
fn objects_are_read_and_written_as_printed() {
    // The index goes low byte first: 0x6041 is 41 60; commands 40 (read), 2F, 2B, 23 (one, two, four bytes).
    assert_eq!(ask(2, objects::STATUSWORD).data(), [0x40, 0x41, 0x60, 0, 0, 0, 0, 0]);
    assert_eq!(write(2, objects::MODE, 1, 10).data(), [0x2F, 0x60, 0x60, 0, 10, 0, 0, 0]);
    assert_eq!(write(2, objects::CONTROLWORD, 2, 0x0F).data(), [0x2B, 0x40, 0x60, 0, 0x0F, 0, 0, 0]);
    assert_eq!(
        write(2, objects::VELOCITY_UNIT, 4, MILLI_RPM).data(),
        [0x23, 0xA9, 0x60, 0, 0x00, 0x47, 0xB4, 0xFD]
    );
    assert_eq!(mapped(objects::STATUSWORD, 16), 0x6041_0010);
    let value = |data: [u8; 8]| answer(&data);
    assert_eq!(value([0x60, 0x40, 0x60, 0, 0, 0, 0, 0]), Some(Answer::Written(objects::CONTROLWORD)));
    assert_eq!(
        value([0x4B, 0x41, 0x60, 0, 0x37, 0x06, 0, 0]),
        Some(Answer::Value(objects::STATUSWORD, 0x0637))
    );
    // Of one byte the other three do not count.
    assert_eq!(value([0x4F, 0x61, 0x60, 0, 0x0A, 9, 9, 9]), Some(Answer::Value(objects::MODE_NOW, 10)));
    let aborted = value([0x80, 0x60, 0x60, 0, 0x30, 0, 0x09, 0x06]);
    assert_eq!(aborted, Some(Answer::Abort(objects::MODE, 0x0609_0030)));
    assert_eq!(answer(&[0x60, 0x40]), None);
}

#[test]
fn states_are_those_of_table_2_5() {
    for (statusword, expected) in [
        (0x0000, Some(State::NotReadyToSwitchOn)),
        (0x0040, Some(State::SwitchOnDisabled)),
        (0x0021, Some(State::ReadyToSwitchOn)),
        (0x0023, Some(State::SwitchedOn)),
        (0x0027, Some(State::OperationEnabled)),
        // Voltage, and a warning of a warm motor.
        (0x00B7, Some(State::OperationEnabled)),
        (0x9427, Some(State::OperationEnabled)),
        (0x0007, Some(State::QuickStopActive)),
        (0x000F, Some(State::FaultReactionActive)),
        (0x0008, Some(State::Fault)),
        (0x002F, None),
        (0x0060, None),
    ] {
        assert_eq!(state(statusword), expected, "0x{statusword:04X}");
    }
}

#[test]
fn three_commands_lead_to_operation_and_a_fault_to_none() {
    // Table 2-7: shutdown x110, switch on x111, enable operation 1111.
    assert_eq!(toward_operation(Some(State::SwitchOnDisabled)) & 0x87, 0x06);
    assert_eq!(toward_operation(Some(State::ReadyToSwitchOn)) & 0x87, 0x07);
    assert_eq!(toward_operation(Some(State::SwitchedOn)) & 0x8F, 0x0F);
    assert_eq!(toward_operation(Some(State::OperationEnabled)) & 0x8F, 0x0F);
    for other in [Some(State::Fault), Some(State::QuickStopActive), None] {
        assert_eq!(toward_operation(other) & 0x82, 0, "{other:?}");
    }
}

proptest! {
    #[test]
    fn noise_does_no_harm(data in prop::collection::vec(any::<u8>(), 0..9)) {
        let _ = answer(&data);
    }

    /// What is written comes back as it was, whatever its size.
    #[test]
    fn sizes_agree(value in any::<u32>(), bytes in prop::sample::select(vec![1u8, 2, 4])) {
        let mut data = write(1, objects::MODE, bytes, value).data().to_vec();
        // An answer has the same fields as a question.
        data[0] = data[0] & 0x0F | 0x40;
        let masked = value & (u32::MAX >> (32 - 8 * u32::from(bytes)));
        prop_assert_eq!(answer(&data), Some(Answer::Value(objects::MODE, masked)));
    }
}

#[test]
fn wheels_turn_in_torque_mode() {
    wheels_turn_as_told(TORQUE);
}

#[test]
fn wheels_turn_in_speed_mode() {
    wheels_turn_as_told(&speed());
}

#[test]
fn spoilt_frames() {
    spoilt_frames_do_no_harm(TORQUE);
}

#[test]
fn a_stuck_motor() {
    a_stuck_motor_shows(TORQUE);
}

/// Whoever thinks that the motors are others would ask for other torques.
#[test]
fn controllers_with_other_motors_are_refused() {
    emulated(TORQUE, Vec::new(), |root| {
        let mut bench = Bench::start(&list(&TORQUE.replace("0.25", "0.5")), root);
        bench.until("the refusal", &Command::Alive, |b| !b.states.is_empty());
        let Some(Told::Lost(reason)) = bench.states.first() else { panic!("{:?}", bench.states) };
        assert!(
            reason.contains("0x6076") && reason.contains("250000") && reason.contains("0.5 N m"),
            "{reason}"
        );
    });
}

/// The controller's own watchdog, on the bus itself.
#[test]
fn controllers_switch_off_without_the_drivers_heartbeat() {
    emulated(TORQUE, Vec::new(), |root| {
        let setup = Controllers { motors: motors(NODES, &super::TRAITS), rated_torque_n_m: 0.25 };
        let place = Place::below(root);
        let ids = setup.heard();
        let mut can = Can::open(&setup.motors.bus, &place, &ids, &setup.motors.emulated(&ids)).unwrap();
        let mut protocol = session::Protocol::new(&setup);
        protocol.start(&mut can).unwrap();
        let hear = |protocol: &mut session::Protocol<'_>, can: &mut Can| {
            let mut frames = Vec::new();
            can.read(&mut frames).unwrap();
            frames.iter().for_each(|frame| _ = protocol.heard(frame, Instant::now()));
            frames
        };
        let wanted = [Setpoint { torque_n_m: 0.1, speed_rad_s: 0.0 }; 3];
        let mut status = 0;
        for _ in 0..6000 {
            can.write(&protocol.cycle(Some(&wanted), Instant::now())).unwrap();
            std::thread::sleep(Duration::from_millis(10));
            let frames = hear(&mut protocol, &mut can);
            let Some(pdo) = frames.iter().rfind(|frame| frame.id == 0x181) else { continue };
            status = u16::from_le_bytes(pdo.bytes(0).unwrap());
            if state(status) == Some(State::OperationEnabled) {
                break;
            }
        }
        assert_eq!(state(status), Some(State::OperationEnabled), "0x{status:04X}");
        // Process data alone do not keep them on.
        let lost = "node 3: fault 0x8130, the driver's heartbeat was lost";
        let mut until = |says: Option<&[Setpoint]>, frames: usize, is_so: &dyn Fn(Option<String>) -> bool| {
            let begin = Instant::now();
            loop {
                let said = protocol.cycle(says, Instant::now());
                can.write(&said[..frames.min(said.len())]).unwrap();
                std::thread::sleep(Duration::from_millis(10));
                hear(&mut protocol, &mut can);
                let fault = protocol.fault(Instant::now());
                if is_so(fault.clone()) {
                    return;
                }
                assert!(begin.elapsed() < Duration::from_secs(60), "{fault:?}");
            }
        };
        until(Some(&wanted), 4, &|fault| fault.is_some_and(|text| text.contains(lost)));
        // Nobody asks for torque any more: the fault is forgotten.
        until(None, usize::MAX, &|fault| fault.is_none());
    });
}
