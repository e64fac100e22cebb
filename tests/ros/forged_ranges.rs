//! Fault row: a datagram that claims a range of 2^40 samples, which makes the DDS library allocate without end
//! (docs/upstream/rustdds_ranges.md). The process that is hit ends before the machine has no memory left.

use std::net::UdpSocket;
use std::os::unix::process::ExitStatusExt;
use std::time::Duration;

use crate::support::formation::{Formation, LONG_HOLD_ALONE};
use crate::support::{measured, wait_for};

/// More than a node holds, and its headroom twice: the vector that grows is copied as it does.
const MOST_BYTES: u64 = 1 << 30;

/// A HEARTBEAT (RTPS 2.5, 9.4.5.7) of the writer of discovered writers, in the name of a participant.
fn heartbeat(participant: [u8; 12], first: i64, last: i64) -> Vec<u8> {
    let (reader, writer) = ([0, 0, 3, 0xc7], [0, 0, 3, 0xc2]);
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
    wait_for("the driver on the network", Duration::from_secs(60), || {
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
    let status = wait_for("the end of the driver", Duration::from_secs(60), || {
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
