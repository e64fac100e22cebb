//! Drivers with backend hardware, over the bytes of emulated devices: pointing, arming, and devices that are lost.

use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use whorl_msgs::sensor_msgs::{Imu, JointState};
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{ActuatorCommand, AttitudeEstimate, GateState};
use whorl_node::Timestamp;
use whorl_ros::{EndpointQos, Participant, RawWriter};

use crate::support::formation::{Formation, LONG_HOLD_ALONE, STARTUP};
use crate::support::simulation::encoded;
use crate::support::watch::{Log, Watch, route};
use crate::support::{binaries, measured, root, wait_for};

/// `whorl` in the formation's domain, with the formation's folder for what runs on this machine.
fn whorl(formation: &Formation) -> Command {
    let mut command = Command::new(binaries::path("whorl"));
    command.env("ROS_DOMAIN_ID", formation.domain().to_string()).env("XDG_RUNTIME_DIR", formation.folder());
    command.env_remove("ROS_AUTOMATIC_DISCOVERY_RANGE");
    command
}

/// Starts emulators of Whorl-I and waits until they are there. Returns the arguments of a driver for them.
fn emulate(formation: &mut Formation, parameters: &[&str]) -> Vec<String> {
    let experiment = formation.folder().join("hold.yaml");
    std::fs::write(&experiment, LONG_HOLD_ALONE).unwrap();
    let mut command = whorl(formation);
    command.args(["emulators", "whorl_1", "--root"]).arg(root()).arg("--experiment").arg(&experiment);
    parameters.iter().for_each(|parameter| _ = command.args(["-p", parameter]));
    formation.adopt("emulators", command);
    let folder = formation.folder().to_owned();
    let found: PathBuf = wait_for("the emulators", STARTUP, || {
        let mut domains =
            std::fs::read_dir(&folder).unwrap().flatten().map(|entry| entry.path().join("emulators/whorl_1"));
        domains.find(|root| root.join("dev/whorl/whorl_1_imu").exists() && root.join("hosts").exists())
    });
    vec!["backend:=hardware".to_owned(), format!("hardware.root:={}", found.display())]
}

struct Sender {
    _participant: Participant,
    writer: RawWriter,
    sequence: u64,
}

impl Sender {
    fn new(formation: &Formation) -> Self {
        let info = Topic::ActuatorCommand.info();
        let name = route(0, Topic::ActuatorCommand).name(&["whorl_1"]).unwrap();
        let qos = EndpointQos::from(info.qos);
        let participant = formation.participant();
        let writer = participant.writer(&name, info.message_type.name(), qos).unwrap();
        Self { _participant: participant, writer, sequence: 0 }
    }

    /// Asks for these torques until `done`.
    fn until(&mut self, watch: &Watch, torques: [f64; 3], what: &str, done: impl Fn(&Log) -> bool) {
        wait_for(what, STARTUP, || {
            let now = whorl_ros::wall_clock();
            let command = ActuatorCommand {
                header: Header { stamp: now.into(), frame_id: String::new() },
                sequence: self.sequence,
                valid_until: (now + Duration::from_secs(1)).into(),
                wheel_torque_n_m: torques.to_vec(),
                jet_slot: 0,
                jet_slot_length_s: 1.0,
                jet_on_time_s: vec![0.0; 12],
                gimbal_rate_rad_s: Vec::new(),
            };
            self.writer.publish(&encoded(&command.into())).unwrap();
            self.sequence += 1;
            done(&watch.log()).then_some(())
        });
    }
}

fn speeds(log: &Log) -> Option<Vec<f64>> {
    log.latest::<JointState>(route(0, Topic::WheelState)).map(|(_, state)| state.velocity.clone())
}

#[test]
fn a_platform_points_over_the_bytes_of_its_devices() {
    let mut formation = Formation::new(&["whorl_1"], &[LONG_HOLD_ALONE]);
    let watch = formation.watch();
    let overrides = emulate(&mut formation, &[]);
    formation.start_with("/whorl_1/driver", &overrides);
    for node in ["/whorl_1/estimator", "/whorl_1/local_control", "/coordinator"] {
        formation.start(node);
    }
    formation.wait_for_step(&watch, "hold");
    watch.during(Duration::from_secs(3));
    let since = whorl_ros::wall_clock();
    watch.during(Duration::from_secs(6));
    let log = watch.log();
    let target =
        nalgebra::UnitQuaternion::from_euler_angles(2.0_f64.to_radians(), (-0.6_f64).to_radians(), 0.0);
    let truth = log.after::<AttitudeEstimate>(route(0, Topic::TruthState), since);
    let errors: Vec<f64> = truth
        .map(|(_, truth)| truth.q_world_body.to_unit().unwrap().angle_to(&target).to_degrees())
        .collect();
    let rms_deg = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
    measured(&format!("pointing over emulated devices: {rms_deg:.4} deg RMS, {} samples", errors.len()));
    assert!(errors.len() > 300, "{} samples of the truth", errors.len());
    // Twice what simulated hardware gives; the emulators' truth is that of simulated hardware.
    assert!(rms_deg < 0.2, "{rms_deg} deg\n{}", watch.summary());
    drop(log);
    formation.stop();
}

#[test]
fn nothing_moves_before_it_is_armed_nor_after_it_is_disarmed() {
    let mut formation = Formation::new(&["whorl_1"], &[LONG_HOLD_ALONE]);
    let watch = formation.watch();
    let mut overrides = emulate(&mut formation, &[]);
    overrides.push("armed:=false".to_owned());
    formation.start_with("/whorl_1/driver", &overrides);
    let mut sender = Sender::new(&formation);
    watch.wait("wheel speeds", STARTUP, speeds);
    let refused = |log: &Log| {
        log.latest::<GateState>(route(0, Topic::GateState)).is_some_and(|(_, state)| state.refused > 50)
    };
    sender.until(&watch, [0.2, -0.2, 0.2], "commands to be refused", refused);
    assert!(
        speeds(&watch.log()).unwrap().iter().all(|speed| speed.abs() < 0.5),
        "a wheel turned before it was armed"
    );

    let answer = whorl(&formation).args(["arm", "whorl_1"]).output().unwrap();
    assert!(answer.status.success(), "{answer:?}\n{}", formation.node("/whorl_1/driver").log());
    // The middle motor is wired the other way round, as the file says.
    let turns = |log: &Log| speeds(log).is_some_and(|s| s[0] > 3.0 && s[1] < -3.0 && s[2] > 3.0);
    sender.until(&watch, [0.2, -0.2, 0.2], "the wheels to turn", turns);

    let answer = whorl(&formation).args(["disarm", "whorl_1"]).output().unwrap();
    assert!(answer.status.success(), "{answer:?}");
    watch.during(Duration::from_millis(500));
    let before = speeds(&watch.log()).unwrap();
    let again = watch.log().latest::<GateState>(route(0, Topic::GateState)).unwrap().1.refused + 50;
    let refused = |log: &Log| {
        log.latest::<GateState>(route(0, Topic::GateState)).is_some_and(|(_, s)| s.refused > again)
    };
    sender.until(&watch, [0.2, -0.2, 0.2], "commands to be refused again", refused);
    let after = speeds(&watch.log()).unwrap();
    for (before, after) in before.iter().zip(&after) {
        assert!(
            (after.abs() - before.abs()) < 0.5,
            "a wheel was driven after it was disarmed: {before} to {after}"
        );
    }
    formation.stop();
}

#[test]
fn a_sensor_that_is_unplugged_stops_the_wheels_and_comes_back_by_itself() {
    let mut formation = Formation::new(&["whorl_1"], &[LONG_HOLD_ALONE]);
    let watch = formation.watch();
    let faults = ["kind:=unplugged", "device:=imu", "start_s:=12.0", "length_s:=3.0"]
        .map(|f| format!("emulation.faults.a.{f}"));
    let overrides = emulate(&mut formation, &faults.each_ref().map(String::as_str));
    formation.start_with("/whorl_1/driver", &overrides);
    let mut sender = Sender::new(&formation);
    let said = |formation: &mut Formation, text: &str| formation.node("/whorl_1/driver").log().contains(text);
    let obeyed = |log: &Log| speeds(log).is_some_and(|s| s[0] > 1.0);
    sender.until(&watch, [0.1, 0.0, 0.0], "the driver to obey", obeyed);
    // Commands go on; the driver refuses them while the sensor is away.
    while !said(&mut formation, "device imu is lost") {
        sender.until(&watch, [0.01, 0.0, 0.0], "a command to be sent", |_| true);
        std::thread::sleep(Duration::from_millis(20));
    }
    watch.during(Duration::from_millis(300));
    let gate = watch.log().latest::<GateState>(route(0, Topic::GateState)).unwrap().1.state;
    assert_eq!(gate, GateState::STATE_OFF, "the gate is open without a sensor");
    wait_for("the sensor", STARTUP, || said(&mut formation, "device imu is back").then_some(()));
    let back: Timestamp = whorl_ros::wall_clock();
    let measures = |log: &Log| (log.after::<Imu>(route(0, Topic::ImuRaw), back).count() > 20).then_some(());
    watch.wait("measurements", STARTUP, measures);
    sender.until(&watch, [0.1, 0.0, 0.0], "the driver to obey again", |log| {
        log.latest::<GateState>(route(0, Topic::GateState))
            .is_some_and(|(_, s)| s.state == GateState::STATE_OBEYING)
    });
    formation.stop();
}

#[test]
fn checkout_finds_a_motor_that_turns_the_other_way_and_valves_that_are_exchanged() {
    let mut formation = Formation::new(&["whorl_1"], &[LONG_HOLD_ALONE]);
    let faults = ["a.kind:=reversed", "a.wheel:=wheel_x", "b.kind:=swapped", "b.jet:=jet_3", "b.with:=jet_7"];
    let faults = faults.map(|fault| format!("emulation.faults.{fault}"));
    emulate(&mut formation, &faults.each_ref().map(String::as_str));
    let answer = whorl(&formation).args(["checkout", "whorl_1", "--root"]).arg(root()).output().unwrap();
    let text =
        [answer.stdout, answer.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
    assert_eq!(answer.status.code(), Some(1), "{text}");
    let line = |part: &str| {
        let found = text.lines().find(|line| line.split_whitespace().next() == Some(part));
        found.unwrap_or_else(|| panic!("nothing is said of {part}\n{text}"))
    };
    assert!(line("wheel_x").contains("turns the other way"), "{text}");
    for part in ["wheel_y", "wheel_z", "jet_1", "jet_2", "jet_4", "jet_9", "jet_12"] {
        assert!(line(part).contains("right, "), "{text}");
    }
    // jet_3 pushes about +z, as jet_9 does; jet_7 about +y, as jet_2.
    assert!(line("jet_3").contains("jet_7") && line("jet_7").contains("jet_3"), "{text}");
    formation.stop();
}
