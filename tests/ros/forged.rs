//! Fault rows: forged datagrams. A range of 2^40 samples makes the DDS library allocate without end
//! (docs/upstream/rustdds.md): the process that is hit ends before the machine has no memory left. A sequence number
//! far ahead makes every later sample an old one.

use std::net::UdpSocket;
use std::os::unix::process::ExitStatusExt;
use std::time::Duration;

use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{ActuatorCommand, GateState};
use whorl_ros::EndpointQos;

use crate::support::formation::{Formation, LONG_HOLD_ALONE, STARTUP};
use crate::support::simulation::encoded;
use crate::support::watch::route;
use crate::support::{measured, wait_for};

/// More than a node holds, and its headroom twice: the vector that grows is copied as it does.
const MOST_BYTES: u64 = 1 << 30;

/// A HEARTBEAT (RTPS 2.5, 9.4.5.7) of the writer of discovered writers, in the name of a participant.
fn heartbeat(participant: [u8; 12], first: i64, last: i64) -> Vec<u8> {
    heartbeat_of([0, 0, 3, 0xc7], [0, 0, 3, 0xc2], participant, first, last)
}

/// A HEARTBEAT from and to any endpoint.
pub(super) fn heartbeat_of(
    reader: [u8; 4],
    writer: [u8; 4],
    participant: [u8; 12],
    first: i64,
    last: i64,
) -> Vec<u8> {
    let number = |n: i64| [((n >> 32) as i32).to_le_bytes(), (n as u32).to_le_bytes()].concat();
    let body = [&reader[..], &writer, &number(first), &number(last), &1_000_000_i32.to_le_bytes()].concat();
    let length = u16::try_from(body.len()).unwrap().to_le_bytes();
    [b"RTPS\x02\x04\x01\x12".as_slice(), &participant, &[7, 1], &length, &body].concat()
}

#[test]
fn a_forged_range_ends_one_process_and_not_the_machine() {
    let mut formation = Formation::new(&["whorl_1"], &[LONG_HOLD_ALONE]);
    let participant = formation.participant();
    formation.start("/whorl_1/driver");
    wait_for("the driver on the network", STARTUP, || {
        let known = participant.discovered_writers();
        known.iter().any(|w| w.dds_topic == "rt/whorl_1/imu/data_raw").then_some(())
    });
    let forged = heartbeat(participant.id().participant(), 1, 1 << 40);
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    // To the port for discovery of every participant but this one (RTPS 2.5, 9.6.2.3).
    let base = 7400 + 250 * formation.domain() + 10;
    for number in (0..12).filter(|number| *number != participant.participant_number()) {
        socket.send_to(&forged, ("127.0.0.1", base + 2 * number)).unwrap();
    }
    let mut most = 0;
    let driver = formation.node("/whorl_1/driver");
    let status = wait_for("the end of the driver", STARTUP, || {
        let statm = std::fs::read_to_string(format!("/proc/{}/statm", driver.id())).unwrap_or_default();
        let pages: u64 = statm.split(' ').nth(1).and_then(|pages| pages.parse().ok()).unwrap_or(0);
        most = most.max(pages * 4096);
        driver.ended()
    });
    measured(&format!("a forged range: the driver held {} MiB at most, and ended: {status}", most >> 20));
    assert!(most < MOST_BYTES, "{} MiB", most >> 20);
    // By a signal: who supervises it starts it again.
    assert!(status.signal().is_some(), "{status}; its log:\n{}", driver.log());
}

/// A DATA submessage (RTPS 2.5, 9.4.5.4) of a writer with the sequence number `number`.
fn data(writer: [u8; 16], number: i64, cdr: &[u8]) -> Vec<u8> {
    let (participant, entity) = writer.split_at(12);
    let sequence = [((number >> 32) as i32).to_le_bytes(), (number as u32).to_le_bytes()].concat();
    // No extra flags; inline QoS would begin 16 bytes further on; for any reader.
    let body = [&[0, 0, 16, 0][..], &[0, 0, 0, 0], entity, &sequence, cdr].concat();
    let length = u16::try_from(body.len()).unwrap().to_le_bytes();
    // Flags: little endian, with data.
    [b"RTPS\x02\x04\x01\x12".as_slice(), participant, &[0x15, 5], &length, &body].concat()
}

#[test]
fn a_forged_sequence_number_does_not_deafen_a_subscription() {
    let mut formation = Formation::new(&["whorl_1"], &[LONG_HOLD_ALONE]);
    let watch = formation.watch();
    let participant = formation.participant();
    formation.start("/whorl_1/driver");
    let info = Topic::ActuatorCommand.info();
    let name = route(0, Topic::ActuatorCommand).name(&["whorl_1"]).unwrap();
    let writer = participant.writer(&name, info.message_type.name(), EndpointQos::from(info.qos)).unwrap();
    let mut sent = 0;
    let mut send = |count: u32| {
        for _ in 0..count {
            let now = whorl_ros::wall_clock();
            let command = ActuatorCommand {
                header: Header { stamp: now.into(), frame_id: String::new() },
                sequence: sent,
                valid_until: (now + Duration::from_millis(80)).into(),
                wheel_torque_n_m: vec![0.01, 0.0, 0.0],
                jet_slot: sent / 10,
                jet_slot_length_s: 0.1,
                jet_on_time_s: vec![0.0; 12],
                gimbal_rate_rad_s: Vec::new(),
            };
            sent += 1;
            writer.publish(&encoded(&command.into())).unwrap();
            std::thread::sleep(Duration::from_millis(20));
        }
    };
    let accepted = || {
        let log = watch.log();
        log.latest::<GateState>(route(0, Topic::GateState)).map_or(0, |(_, state)| state.accepted)
    };
    wait_for("the driver to obey", STARTUP, || {
        send(10);
        (accepted() > 20).then_some(())
    });
    // In the writer's own name, to the data port of every other participant.
    let forged = data(writer.id().0, 1 << 33, &encoded(&ActuatorCommand::default().into()));
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let base = 7400 + 250 * formation.domain() + 11;
    for number in (0..12).filter(|number| *number != participant.participant_number()) {
        socket.send_to(&forged, ("127.0.0.1", base + 2 * number)).unwrap();
    }
    let before = accepted();
    // Deafened, it would never obey again.
    wait_for("the driver to obey again", STARTUP, || {
        send(10);
        (accepted() > before + 100).then_some(())
    });
    let refused = |m: &GateState| m.refused > 0;
    watch.wait_next("the refusal of the forged command", route(0, Topic::GateState), STARTUP, refused);
}
