//! Secured traffic (SROS2): who has no keys, or others, gets nothing in and nothing out.
//!
//! The programs need to be built with `--features security`, as these tests are then.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

use whorl_msgs::diagnostic_msgs::DiagnosticArray;
use whorl_msgs::geometry_msgs::Quaternion;
use whorl_msgs::topics::{Message, Topic};
use whorl_msgs::whorl::{ActuatorCommand, AttitudeReference, ControlStatus, FormationCommand};
use whorl_ros::environment::Network;
use whorl_ros::{EndpointQos, Participant, RawReader, RawWriter, wall_clock};
use whorl_security::Keystore;

use crate::support::formation::{Formation, LONG_HOLD_ALONE, STARTUP, keystore_variables, new_keystore};
use crate::support::simulation::encoded;
use crate::support::watch::{Watch, route};
use crate::support::{skipped, wait_for};

use super::forged::heartbeat_of;

/// How long each attack goes on: longer than DDS needs to find a participant on a computer that is not busy.
const ATTACK: Duration = Duration::from_secs(8);
const WRITTEN: [Topic; 4] =
    [Topic::ActuatorCommand, Topic::AttitudeReference, Topic::FormationCommand, Topic::AttitudeEstimate];
const READ: [Topic; 4] =
    [Topic::ImuRaw, Topic::AttitudeEstimate, Topic::ControlStatus, Topic::FormationState];

/// False, after saying so, where the tests were built without security.
pub(super) fn is_built(what: &str) -> bool {
    if !cfg!(feature = "security") {
        skipped(what, "built without `--features security`");
    }
    cfg!(feature = "security")
}

/// A participant that reads and writes what it can of Whorl-I.
struct Intruder {
    writers: Vec<(Topic, RawWriter)>,
    readers: Vec<RawReader>,
    participant: Participant,
}

impl Intruder {
    fn new(network: &Network) -> Self {
        let participant = Participant::new(network).unwrap();
        let name = |topic| route(0, topic).name(&["whorl_1"]).unwrap();
        // What its own library refuses it, it does not even try.
        let writers = WRITTEN.into_iter().filter_map(|topic| {
            let info = topic.info();
            let qos = EndpointQos::from(info.qos);
            Some((topic, participant.writer(&name(topic), info.message_type.name(), qos).ok()?))
        });
        let writers = writers.collect();
        let readers = READ.into_iter().filter_map(|topic| {
            let info = topic.info();
            let qos = EndpointQos::from(info.qos);
            participant.reader(&name(topic), info.message_type.name(), qos).ok()
        });
        let readers = readers.collect();
        Self { writers, readers, participant }
    }

    /// Writes at 50 Hz for a time; returns how many messages it could read, and how many topics it knows of others.
    fn attack(&self) -> (usize, usize) {
        let begin = Instant::now();
        let mut read = 0;
        while begin.elapsed() < ATTACK {
            read += self.write_and_read();
        }
        let others = |endpoint: &whorl_ros::DiscoveredEndpoint| {
            endpoint.endpoint.participant() != self.participant.id().participant()
        };
        (read, self.participant.discovered_writers().iter().filter(|e| others(e)).count())
    }

    /// How many messages it could read.
    fn write_and_read(&self) -> usize {
        let mut read = 0;
        for (topic, writer) in &self.writers {
            let _ = writer.publish(&encoded(&forged(*topic)));
        }
        for reader in &self.readers {
            reader.drain_notifications();
            while let Ok(Some(_)) = reader.take() {
                read += 1;
            }
        }
        std::thread::sleep(Duration::from_millis(20));
        read
    }
}

/// What would be noticed: a command of one wheel, which is too few; a reference to turn away; an authority that commands nothing.
fn forged(topic: Topic) -> Message {
    let now = wall_clock();
    let header = whorl_msgs::std_msgs::Header { stamp: now.into(), frame_id: String::new() };
    match topic {
        Topic::ActuatorCommand => {
            let valid_until = (now + Duration::from_millis(60)).into();
            ActuatorCommand { header, valid_until, wheel_torque_n_m: vec![0.01], ..Default::default() }.into()
        }
        Topic::AttitudeReference => {
            let q_world_reference = Quaternion { x: 0.0, y: 0.0, z: 1.0, w: 0.0 };
            let valid_until = (now + Duration::from_millis(200)).into();
            AttitudeReference {
                header,
                sequence: 1 << 40,
                valid_until,
                q_world_reference,
                ..Default::default()
            }
            .into()
        }
        Topic::FormationCommand => {
            FormationCommand { header, sequence: 1 << 40, ..Default::default() }.into()
        }
        _ => Message::default_of(topic.info().message_type),
    }
}

/// How many messages of somebody else the platform's nodes have heard, as they say once a second: they refuse a second
/// publisher, who must have got past the keys to be one.
fn heard(watch: &Watch) -> u64 {
    std::thread::sleep(Duration::from_secs(3));
    let log = watch.log();
    let mut latest = BTreeMap::new();
    for (_, report) in log.of::<DiagnosticArray>(route(0, Topic::Diagnostics)) {
        for status in report.status.iter().filter(|status| status.name.ends_with(": transport")) {
            for value in &status.values {
                let Some(text) = value.value.strip_suffix(" from a second publisher") else { continue };
                let count: u64 = text.rsplit(' ').next().unwrap().parse().unwrap();
                latest.insert((status.name.clone(), value.key.clone()), count);
            }
        }
    }
    assert!(latest.len() > 5, "nodes do not report: {latest:?}");
    latest.values().sum()
}

/// A keystore of the same authority whose governance checks no topic: what a participant could do whose own checks were
/// removed.
fn unchecked(keystore: &Keystore, at: &Path, domain: u16) -> Keystore {
    let copy = |from: &str| {
        let status =
            std::process::Command::new("cp").arg("-r").arg(keystore.path().join(from)).arg(at).status();
        assert!(status.unwrap().success());
    };
    std::fs::create_dir_all(at).unwrap();
    ["public", "private", "enclaves"].iter().for_each(|folder| copy(folder));
    let xml = whorl_security::documents::governance(domain)
        .replace("<enable_read_access_control>true", "<enable_read_access_control>false")
        .replace("<enable_write_access_control>true", "<enable_write_access_control>false");
    let (xml_path, signed) = (at.join("enclaves/governance.xml"), at.join("enclaves/governance.p7s"));
    std::fs::write(&xml_path, xml).unwrap();
    let status = std::process::Command::new("openssl")
        .args(["smime", "-sign", "-text", "-signer"])
        .arg(at.join("public/permissions_ca.cert.pem"))
        .arg("-inkey")
        .arg(at.join("private/permissions_ca.key.pem"))
        .arg("-in")
        .arg(&xml_path)
        .arg("-out")
        .arg(&signed)
        .status();
    assert!(status.unwrap().success(), "openssl cannot sign");
    Keystore::open(at).unwrap()
}

/// Those that differ most.
#[test]
fn nothing_gets_in_and_nothing_gets_out_without_the_right_keys() {
    intrude(|who| ["without keys", "with keys of another platform"].contains(&who));
}

#[test]
#[ignore = "slow: more intruders on a secured network"]
fn nothing_gets_in_and_nothing_gets_out_with_other_wrong_keys() {
    intrude(|who| ["with another authority's keys", UNCHECKED].contains(&who));
}

const UNCHECKED: &str = "with keys of another platform, its own checks removed";

/// Each of the intruders that `is_tried`, and then somebody who has the keys.
fn intrude(is_tried: impl Fn(&str) -> bool) {
    if !is_built("intruders on a secured network") {
        return;
    }
    let mut formation = Formation::new(&["whorl_1"], &[LONG_HOLD_ALONE]).secured();
    let watch = formation.watch();
    formation.start_all();
    formation.wait_for_step(&watch, "hold");
    watch.wait_next::<ControlStatus>("the platform to track", route(0, Topic::ControlStatus), STARTUP, |m| {
        m.mode == ControlStatus::MODE_TRACK
    });

    // In their first seconds nodes join anew for a peer whose handshake does not end, as a stranger's never does.
    std::thread::sleep(Duration::from_secs(25));
    let domain = formation.domain();
    let others = new_keystore(&formation.folder().join("other_authority"), domain);
    let own = formation.keystore.clone().unwrap();
    let lax = unchecked(&own, &formation.folder().join("unchecked"), domain);
    let with = |keystore: &Keystore, enclave: &str| Network {
        enclave: Some(keystore.enclave_folder(enclave).unwrap()),
        ..Network::localhost(domain)
    };
    let intruders = [
        ("without keys", Network::localhost(domain)),
        ("with another authority's keys", with(&others, "/whorl_1/local_control")),
        ("with keys of another platform", with(&own, "/whorl_2/local_control")),
        (UNCHECKED, with(&lax, "/whorl_2/local_control")),
    ];
    for (who, network) in intruders.iter().filter(|(who, _)| is_tried(who)) {
        let before = heard(&watch);
        let since = wall_clock();
        let intruder = Intruder::new(network);
        let (read, topics) = intruder.attack();
        formation.check_alive();
        assert_eq!(read, 0, "{who}: messages got out");
        if !who.contains("another platform") {
            assert_eq!(topics, 0, "{who}: discovery is readable");
        }
        assert_eq!(heard(&watch) - before, 0, "{who}: messages got in");
        let log = watch.log();
        let errors_rad = log
            .after::<ControlStatus>(route(0, Topic::ControlStatus), since)
            .map(|(_, status)| nalgebra::Vector3::from(status.attitude_error_b_rad).norm());
        // Who is steered turns by 180 deg. Who has keys of the formation can keep others busy; see docs/security.md.
        let worst_rad = errors_rad.fold(0.0, f64::max);
        assert!(worst_rad < 1.0, "{who}: the platform was steered: {worst_rad} rad");
        drop(log);
        drop(intruder);
        let again = format!("the platform to track after one {who}");
        watch.wait_next::<ControlStatus>(&again, route(0, Topic::ControlStatus), STARTUP, |m| {
            m.mode == ControlStatus::MODE_TRACK
        });
    }
    // The right keys do get in, so that the above says something.
    let before = heard(&watch);
    let insider = Intruder::new(&with(&own, "/whorl_1/local_control"));
    wait_for("messages to be read with the right keys", STARTUP, || {
        (insider.write_and_read() > 0).then_some(())
    });
    wait_for("messages to get in with the right keys", STARTUP, || {
        insider.attack();
        (heard(&watch) > before).then_some(())
    });
    formation.stop();
}

#[test]
fn enforced_security_starts_nothing_without_its_keys() {
    if !is_built("nodes without their keys") {
        return;
    }
    let mut formation = Formation::new(&["whorl_1"], &[LONG_HOLD_ALONE]);
    let store = formation.folder().join("keystore");
    let keystore = new_keystore(&store, formation.domain());
    let driver = keystore.enclave_folder("/whorl_1/driver").unwrap();
    let mut start = |expected: &str, change: &[(&str, &str)]| {
        formation.set_environment_of_all(keystore_variables(&store));
        let change = change.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned()));
        formation.set_environment_of_all(change.collect());
        formation.start("/whorl_1/driver");
        let process = formation.node("/whorl_1/driver");
        let status = process.wait(STARTUP);
        assert!(!status.success() && process.log().contains(expected), "{status}: {}", process.log());
    };
    let permissions = std::fs::read_to_string(driver.join("permissions.p7s")).unwrap();
    assert!(permissions.contains("rt/rosout"));
    std::fs::write(driver.join("permissions.p7s"), permissions.replacen("rt/rosout", "rt/rosinn", 1))
        .unwrap();
    start("joining domain", &[]);
    std::fs::remove_file(driver.join("permissions.p7s")).unwrap();
    start("permissions.p7s", &[]);
    start("ROS_SECURITY_KEYSTORE", &[("ROS_SECURITY_KEYSTORE", "")]);
    start("allowed: Enforce, Permissive", &[("ROS_SECURITY_STRATEGY", "enforce")]);
}

/// Datagrams that end an open node (`forged`), in the name of a participant that it has authenticated, to the built-in
/// readers that are secured and those that are not.
#[test]
fn a_forged_range_does_nothing_where_traffic_is_secured() {
    if !is_built("forged datagrams on a secured network") {
        return;
    }
    let mut formation = Formation::new(&["whorl_1"], &[LONG_HOLD_ALONE]).secured();
    let participant = Participant::new(&formation.network("/monitor")).unwrap();
    formation.start("/whorl_1/driver");
    wait_for("the driver on the network", STARTUP, || {
        let known = participant.discovered_writers();
        known.iter().any(|w| w.dds_topic == "rt/whorl_1/imu/data_raw").then_some(())
    });
    let socket = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let base = 7400 + 250 * formation.domain() + 10;
    // DDS Security 1.1, 7.4.5: publications, subscriptions, liveliness, volatile; RTPS 2.5, 9.3.1.3, the open ones.
    let pairs: [([u8; 4], [u8; 4]); 7] = [
        ([0, 0, 3, 0xc7], [0, 0, 3, 0xc2]),
        ([0, 0, 4, 0xc7], [0, 0, 4, 0xc2]),
        ([0, 2, 0, 0xc7], [0, 2, 0, 0xc2]),
        ([0xff, 0, 3, 0xc7], [0xff, 0, 3, 0xc2]),
        ([0xff, 0, 4, 0xc7], [0xff, 0, 4, 0xc2]),
        ([0xff, 2, 0, 0xc7], [0xff, 2, 0, 0xc2]),
        ([0xff, 2, 2, 0xc4], [0xff, 2, 2, 0xc3]),
    ];
    for (reader, writer) in pairs {
        let forged = heartbeat_of(reader, writer, participant.id().participant(), 1, 1 << 40);
        for number in (0..12).filter(|number| *number != participant.participant_number()) {
            socket.send_to(&forged, ("127.0.0.1", base + 2 * number)).unwrap();
        }
    }
    // An open node ends within a second.
    std::thread::sleep(Duration::from_secs(5));
    let driver = formation.node("/whorl_1/driver");
    let ended = driver.ended();
    assert!(ended.is_none(), "{ended:?}; its log:\n{}", driver.log());
}
