//! A simulated run, recorded and read back.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use whorl_bag::{BagError, BagOptions, RunDescription, RunWriter};
use whorl_dynamics::{InitialState, Plant, PlatformModel};
use whorl_msgs::{Message, PlatformId, Route, Topic};
use whorl_node::{LogLine, Timestamp};
use whorl_params::{ParameterTree, read_shared, standard_layers, truth_model};
use whorl_sim::{NodeSet, Observer};

use super::parameters;
use crate::{OnInterval, Recording, RecordingError, read_model, read_run};

struct Recorder {
    writer: RunWriter,
    messages: Vec<(Route, Message)>,
}

impl Observer for Recorder {
    type Error = BagError;

    fn published(&mut self, now: Timestamp, route: Route, message: &Arc<Message>) -> Result<(), BagError> {
        self.messages.push((route, Message::clone(message)));
        self.writer.write_message(route, now, message)
    }

    fn logged(&mut self, _now: Timestamp, _node: &str, _line: &LogLine) {}
}

struct Simulated {
    _directory: tempfile::TempDir,
    path: PathBuf,
    messages: Vec<(Route, Message)>,
    truth: PlatformModel,
}

fn simulate(experiment: &str, length_s: f64) -> Simulated {
    let folder = parameters();
    let experiment = folder.join("experiments").join(experiment);
    let layers = standard_layers(&folder, &["whorl_1", "whorl_2"], Some(&experiment));
    let tree = ParameterTree::load(&layers, &[]).unwrap();
    let mut set = NodeSet::build(&tree, 5, Timestamp(0)).unwrap();
    let directory = tempfile::tempdir().unwrap();
    let description = RunDescription { platforms: set.platforms.clone(), ..RunDescription::default() };
    let mut writer =
        RunWriter::create(directory.path(), description, Timestamp(0), BagOptions::default()).unwrap();
    layers.iter().for_each(|layer| writer.add_parameter_file(layer).unwrap());
    writer.add_parameters("effective.yaml", "in force", set.effective_parameters.as_bytes()).unwrap();
    let path = writer.path().to_owned();
    let mut recorder = Recorder { writer, messages: Vec::new() };
    whorl_sim::run(&mut set, Duration::from_secs_f64(length_s), &mut recorder, |_| {}).unwrap();
    recorder.writer.finish(Timestamp(0)).unwrap();
    let truth = read_shared(&tree.for_node("/whorl_1/driver"), truth_model).unwrap().unwrap();
    Simulated { _directory: directory, path, messages: recorder.messages, truth }
}

impl Simulated {
    fn of(&self, topic: Topic) -> impl Iterator<Item = &Message> {
        let route = Route::platform(PlatformId(0), topic);
        self.messages.iter().filter(move |(r, _)| *r == route).map(|(_, message)| message)
    }
}

/// The truth re-simulated from the recording's torques and pulses alone: late or lost ones would show.
fn resimulated(recording: &Recording, truth: &PlatformModel) -> Plant {
    let motion = recording.truth.as_ref().unwrap();
    let initial = InitialState {
        q_world_body: motion.q_world_body.value[0],
        omega_wb_b_rad_s: motion.omega_wb_b_rad_s.value[0],
        ..InitialState::default()
    };
    let mut plant = Plant::new(truth, &initial, 1).unwrap();
    let ns = |s: f64| (s * 1e9).round() as i64;
    enum Event<'a> {
        Pulse(usize, &'a OnInterval),
        Torque(&'a [f64]),
    }
    let pulses = recording.jet_pulses.iter().enumerate();
    let mut events: Vec<(i64, Event<'_>)> = pulses
        .flat_map(|(jet, pulses)| pulses.iter().map(move |p| (ns(p.on_s), Event::Pulse(jet, p))))
        .collect();
    let torque = &recording.wheel_torque_command_n_m;
    events.extend(torque.time_s.iter().zip(&torque.value).map(|(t, u)| (ns(*t), Event::Torque(u))));
    events.sort_by_key(|event| event.0);
    for (at, event) in events {
        plant.advance_to(at).unwrap();
        match event {
            Event::Pulse(jet, p) => {
                plant.command_jet_pulse(jet, at, p.off_s - p.on_s).unwrap();
            }
            Event::Torque(torque) => plant.command_wheels(torque).unwrap(),
        }
    }
    plant.advance_to(ns(*motion.q_world_body.time_s.last().unwrap())).unwrap();
    plant
}

#[test]
fn a_run_reads_back_what_was_measured_and_what_was_done() {
    let run = simulate("leader_follower_jets.yaml", 12.0);
    let recordings = read_run(&run.path, None).unwrap();
    let names: Vec<&str> = recordings.iter().map(|r| r.platform.as_str()).collect();
    assert_eq!(names, ["whorl_1", "whorl_2"]);
    let recording = &recordings[0];
    assert_eq!(recording.remarks, Vec::<String>::new());
    assert!(recording.closed_loop);

    // Every message is there.
    let imu: Vec<_> = run
        .of(Topic::ImuRaw)
        .map(|m| match m {
            Message::Imu(m) => (Timestamp::from(m.header.stamp).0 as f64 / 1e9, m.angular_velocity),
            _ => panic!(),
        })
        .collect();
    assert_eq!(recording.gyro_b_rad_s.len(), imu.len());
    for ((t, w), (time_s, rate)) in
        imu.iter().zip(recording.gyro_b_rad_s.time_s.iter().zip(&recording.gyro_b_rad_s.value))
    {
        assert_eq!((*t, (*w).into()), (*time_s, *rate));
    }
    let counts = [
        (recording.specific_force_b_m_s2.len(), run.of(Topic::ImuRaw).count()),
        (recording.wheel_speed_rad_s.len(), run.of(Topic::WheelState).count()),
        (recording.vectors[0].direction_b.len(), run.of(Topic::VectorDirection).count()),
        (recording.bus_voltage_v.len(), run.of(Topic::Battery).count()),
        (recording.tank_pressure_pa.len(), run.of(Topic::TankPressure).count()),
        (recording.temperature_k.len(), run.of(Topic::Temperature).count()),
    ];
    for (read, sent) in counts {
        assert_eq!(read, sent);
    }
    let mean_k = recording.temperature_k.value.iter().sum::<f64>() / recording.temperature_k.len() as f64;
    assert!((mean_k - run.truth.sensors.ambient_temperature_k).abs() < 0.3, "{mean_k}");

    // The gyro is the truth and noise.
    let motion = recording.truth.as_ref().unwrap();
    let sigma = run.truth.sensors.gyro.errors;
    let bound = 5.0 * (sigma.noise_stddev + sigma.bias_turn_on_stddev);
    for (t, rate) in recording.gyro_b_rad_s.time_s.iter().zip(&recording.gyro_b_rad_s.value) {
        let error = rate - motion.omega_wb_b_rad_s.held_at(*t).unwrap();
        assert!(error.abs() < bound, "{error:?}");
    }
    for (t, direction) in
        recording.vectors[0].direction_b.time_s.iter().zip(&recording.vectors[0].direction_b.value)
    {
        let q = motion.q_world_body.held_at(*t).unwrap();
        let error = (q * direction - *recording.vectors[0].reference_world).norm();
        assert!(error < 0.02, "{error}");
    }

    // On-times are the driver's own totals ...
    let Some(Message::ThrusterState(last)) = run.of(Topic::ThrusterState).last() else { panic!() };
    let totals: Vec<f64> =
        recording.jet_pulses.iter().map(|pulses| pulses.iter().map(|p| p.off_s - p.on_s).sum()).collect();
    assert!(totals.iter().sum::<f64>() > 0.3, "jets fired: {totals:?}");
    for (read, driven) in totals.iter().zip(&last.total_on_time_s) {
        assert!((read - driven).abs() < 1e-6, "{totals:?} {:?}", last.total_on_time_s);
    }
    // ... and torques and pulses, at the recording's times, make the same motion.
    let plant = resimulated(recording, &run.truth);
    let end = plant.truth();
    let rate_error = (end.omega_wb_b_rad_s - motion.omega_wb_b_rad_s.value.last().unwrap()).norm();
    let angle = end.q_world_body.angle_to(motion.q_world_body.value.last().unwrap());
    assert!(rate_error < 1e-5 && angle < 1e-4, "{rate_error} rad/s, {angle} rad");

    super::round_trip::survives(recording);

    let known = read_model(&run.path, Some("whorl_1")).unwrap();
    let of_file = read_model(&parameters().join("whorl_1.yaml"), None).unwrap();
    assert_eq!(known.model, of_file.model);
    assert_eq!(of_file.platform, "whorl_1");
    assert!(matches!(read_model(&run.path, None), Err(RecordingError::SeveralModels { .. })));
    assert!(matches!(read_run(&run.path, Some("whorl_3")), Err(RecordingError::NoSuchPlatform { .. })));
}
