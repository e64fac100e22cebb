//! Fault rows: single messages that no node would send.

use std::time::Duration;

use whorl_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus};
use whorl_msgs::sensor_msgs::Imu;
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::{Message, Topic};
use whorl_msgs::whorl::{
    ActuatorCommand, AttitudeEstimate, AttitudeReference, ControlStatus, FormationCommand, GateState,
};
use whorl_node::Timestamp;
use whorl_ros::{EndpointQos, Participant, RawWriter, wall_clock};

use crate::support::formation::{Formation, STARTUP};
use crate::support::simulation::encoded;
use crate::support::wait_for;
use crate::support::watch::{Watch, route};

const HOUR: Duration = Duration::from_secs(3600);

fn writer(participant: &Participant, topic: Topic) -> RawWriter {
    let info = topic.info();
    let name = route(0, topic).name(&["whorl_1"]).unwrap();
    participant.writer(&name, info.message_type.name(), EndpointQos::from(info.qos)).unwrap()
}

fn header(stamp: Timestamp) -> Header {
    Header { stamp: stamp.into(), frame_id: String::new() }
}

/// A command that is valid now, with one wheel turning.
fn command() -> ActuatorCommand {
    let now = wall_clock();
    ActuatorCommand {
        header: header(now),
        sequence: 1,
        valid_until: (now + Duration::from_millis(60)).into(),
        wheel_torque_n_m: vec![0.01, 0.0, 0.0],
        jet_slot: 1,
        jet_slot_length_s: 0.1,
        jet_on_time_s: vec![0.0; 12],
        gimbal_rate_rad_s: Vec::new(),
    }
}

/// The platform tracks, and its driver obeys: what is locked out for an hour never does.
fn assert_tracks_again(formation: &mut Formation, watch: &Watch, after: &str) {
    formation.check_alive();
    let since = wall_clock();
    let what = format!("the platform to track and obey after {after}");
    watch.wait(&what, STARTUP, |log| {
        let tracks = log.after::<ControlStatus>(route(0, Topic::ControlStatus), since);
        let tracks = tracks.filter(|(_, m)| m.mode == ControlStatus::MODE_TRACK).count();
        let gate: Vec<&GateState> =
            log.after::<GateState>(route(0, Topic::GateState), since).map(|(_, m)| m).collect();
        let obeyed = gate.last().map_or(0, |s| s.accepted) - gate.first().map_or(0, |s| s.accepted);
        (tracks > 20 && obeyed > 20).then_some(())
    });
    formation.check_alive();
}

#[test]
fn no_single_message_ends_a_node_or_locks_its_platform_out() {
    let jets = "/**/local_control: {ros__parameters: {actuators: both}}";
    let (mut formation, watch) = Formation::holding_alone(&[jets]);
    let participant = formation.participant();
    let commands = writer(&participant, Topic::ActuatorCommand);
    let estimates = writer(&participant, Topic::AttitudeEstimate);
    let references = writer(&participant, Topic::AttitudeReference);
    let authority = writer(&participant, Topic::FormationCommand);
    let measurements = writer(&participant, Topic::ImuRaw);
    watch.during(Duration::from_secs(2));

    let ahead = || header(wall_clock() + HOUR);
    type Forged<'w> = (&'static str, &'w RawWriter, Box<dyn Fn() -> Message>);
    let forged: [Forged<'_>; 9] = [
        (
            "a pulse of 1e20 s",
            &commands,
            Box::new(|| {
                let mut m = command();
                m.jet_slot_length_s = 1e20;
                m.jet_on_time_s[0] = 1e20;
                m.into()
            }),
        ),
        ("slot 2^64-1", &commands, Box::new(|| ActuatorCommand { jet_slot: u64::MAX, ..command() }.into())),
        ("slot 2^53", &commands, Box::new(|| ActuatorCommand { jet_slot: 1 << 53, ..command() }.into())),
        ("sequence 2^53", &commands, Box::new(|| ActuatorCommand { sequence: 1 << 53, ..command() }.into())),
        (
            "a command an hour ahead",
            &commands,
            Box::new(move || ActuatorCommand { header: ahead(), ..command() }.into()),
        ),
        (
            "an estimate an hour ahead",
            &estimates,
            Box::new(move || AttitudeEstimate { header: ahead(), health: 1, ..Default::default() }.into()),
        ),
        (
            "a reference an hour ahead",
            &references,
            Box::new(move || AttitudeReference { header: ahead(), ..Default::default() }.into()),
        ),
        (
            "an authority an hour ahead",
            &authority,
            Box::new(move || FormationCommand { header: ahead(), ..Default::default() }.into()),
        ),
        (
            "a measurement an hour ahead",
            &measurements,
            Box::new(move || Imu { header: ahead(), ..Default::default() }.into()),
        ),
    ];
    for (what, writer, make) in &forged {
        writer.publish(&encoded(&make())).unwrap();
        assert_tracks_again(&mut formation, &watch, what);
    }
    // What was refused is told.
    for words in ["messages out of bounds on /whorl_1/actuators/command", "samples ahead of the clock"] {
        watch.wait(&format!("somebody to say '{words}'"), STARTUP, |log| {
            let diagnostics = log.of::<DiagnosticArray>(route(0, Topic::Diagnostics));
            let mut told = diagnostics.flat_map(|(_, m)| &m.status);
            let is_said = |s: &DiagnosticStatus| {
                s.message.contains(words) || s.values.iter().any(|v| v.key.contains(words) && v.value != "0")
            };
            told.any(is_said).then_some(())
        });
    }
}

/// Somebody else's program, or a second node set, commands the same platform.
#[test]
fn a_second_publisher_is_refused_and_reported() {
    let (mut formation, watch) = Formation::holding_alone(&[]);
    let participant = formation.participant();
    let topics = [Topic::ActuatorCommand, Topic::AttitudeReference, Topic::AttitudeEstimate];
    let writers = topics.map(|topic| (topic, writer(&participant, topic)));
    let status = route(0, Topic::ControlStatus);
    watch.wait_next::<ControlStatus>("the platform to track", status, STARTUP, |m| {
        m.mode == ControlStatus::MODE_TRACK
    });
    let since = wall_clock();
    // A wheel at full torque, a turn by 180 deg, an estimate that says it is upside down: 50 times a second.
    for sequence in 0..250 {
        for (topic, writer) in &writers {
            let header = header(wall_clock());
            let turned = whorl_msgs::geometry_msgs::Quaternion { x: 0.0, y: 0.0, z: 1.0, w: 0.0 };
            let message: Message = match topic {
                // A driver that listened to it would refuse it, and count: it is for one wheel.
                Topic::ActuatorCommand => {
                    ActuatorCommand { wheel_torque_n_m: vec![0.01], ..command() }.into()
                }
                Topic::AttitudeReference => {
                    AttitudeReference { header, sequence, q_world_reference: turned, ..Default::default() }
                        .into()
                }
                _ => {
                    AttitudeEstimate { header, health: 1, q_world_body: turned, ..Default::default() }.into()
                }
            };
            writer.publish(&encoded(&message)).unwrap();
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    formation.check_alive();
    {
        let log = watch.log();
        // A busy machine makes it refuse commands of its own local control, which come late, for another reason.
        let heard = log
            .after::<GateState>(route(0, Topic::GateState), since)
            .filter(|(_, m)| m.refusal == GateState::REFUSAL_WRONG_SIZE);
        assert_eq!(heard.count(), 0, "the driver listened to it");
        // It never turns toward the reference of another, which is half a turn away.
        let errors = log
            .after::<ControlStatus>(status, since)
            .map(|(_, m)| nalgebra::Vector3::from(m.attitude_error_b_rad).norm());
        let worst = errors.fold(0.0, f64::max);
        assert!(worst < 1.0, "error {worst} rad");
    }
    for topic in topics {
        let name = route(0, topic).name(&["whorl_1"]).unwrap();
        let said = |text: &str| text.contains(whorl_ros::SECOND_PUBLISHER) && text.contains(&name);
        watch.wait(&format!("a report of the second publisher of {name}"), STARTUP, |log| {
            let mut told = log.of::<DiagnosticArray>(route(0, Topic::Diagnostics));
            let is = |m: &DiagnosticArray| {
                m.status.iter().any(|s| s.level == DiagnosticStatus::ERROR && said(&s.message))
            };
            told.any(|(_, m)| is(m)).then_some(())
        });
    }
    wait_for("the driver to log it", STARTUP, || {
        formation.node("/whorl_1/driver").log().contains("REFUSED").then_some(())
    });
}
