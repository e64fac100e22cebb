//! Tests of the driver with simulated hardware.

use super::*;
use crate::simulated::{SimulatedHardware, Start};
use whorl_dynamics::PlatformModel;
use whorl_msgs::topics::PlatformId;
use whorl_msgs::whorl::{GateState, ThrusterState};

use crate::faults::{Fault, FaultKind};

fn at(ms: i64) -> Timestamp {
    Timestamp(1_700_000_000_000_000_000 + ms * 1_000_000)
}

fn driver() -> (DriverCore, PlatformModel) {
    let model = PlatformModel::whorl_1_reference();
    let hardware = SimulatedHardware::new(model.clone(), Start::default(), 1, Vec::new()).unwrap();
    let backend = Backend::Simulated {
        truth: Box::new(model.clone()),
        start: Start::default(),
        seed: 1,
        faults: Vec::new(),
    };
    let parameters = Parameters {
        platform: PlatformId(0),
        name: "whorl_1".into(),
        model: model.clone(),
        watchdog_s: 0.2,
        backend,
        devices: Default::default(),
        supplies: crate::prearm::Supplies { bus_voltage_min_v: 0.0, tank_pressure_min_pa: 0.0 },
        armed: true,
        emulated_faults: Vec::new(),
    };
    (DriverCore::new(parameters, Box::new(hardware)), model)
}

fn thrusters(outputs: &Outputs) -> ThrusterState {
    let found = outputs.messages.iter().find_map(|p| match &*p.message {
        Message::ThrusterState(m) => Some(m.clone()),
        _ => None,
    });
    found.unwrap()
}

#[test]
fn silence_closes_the_valves_at_the_deadline_and_not_at_the_next_tick() {
    let (mut driver, model) = driver();
    let mut outputs = Outputs::default();
    let mut tick = |driver: &mut DriverCore, ms: i64| {
        outputs.clear();
        driver.step(at(ms), Event::Timer, &mut outputs);
        thrusters(&outputs)
    };
    tick(&mut driver, 0);
    let mut jet_on_time_s = vec![0.0; model.jets().len()];
    jet_on_time_s[2] = 0.2;
    let command = ActuatorCommand {
        header: Header { stamp: at(0).into(), frame_id: String::new() },
        valid_until: at(53).into(),
        wheel_torque_n_m: vec![0.0; model.wheels().len()],
        jet_slot_length_s: 0.2,
        jet_on_time_s,
        ..ActuatorCommand::default()
    };
    let message = Message::from(command);
    let route = Route::platform(PlatformId(0), Topic::ActuatorCommand);
    driver.step(at(3), Event::Message { route, message: &message }, &mut Outputs::default());
    assert!(tick(&mut driver, 50).valve_open[2]);
    let after = tick(&mut driver, 60);
    assert!(!after.valve_open[2]);
    // Opened at 3 ms, closed at 53 ms.
    assert!((after.total_on_time_s[2] - 0.050).abs() < 1e-9, "{}", after.total_on_time_s[2]);
}

#[test]
fn a_new_slot_replaces_what_is_left_of_the_one_before() {
    let (mut driver, model) = driver();
    let mut slot = |sequence: u64, now_ms: i64, on_time_s: [f64; 3]| {
        let mut jet_on_time_s = vec![0.0; model.jets().len()];
        jet_on_time_s[..3].copy_from_slice(&on_time_s);
        let command = ActuatorCommand {
            header: Header { stamp: at(now_ms).into(), frame_id: String::new() },
            sequence,
            valid_until: at(now_ms + 60).into(),
            wheel_torque_n_m: vec![0.0; model.wheels().len()],
            jet_slot: sequence,
            jet_slot_length_s: 0.1,
            jet_on_time_s,
            gimbal_rate_rad_s: Vec::new(),
        };
        let route = Route::platform(PlatformId(0), Topic::ActuatorCommand);
        driver.step(at(now_ms), Event::Message { route, message: &command.into() }, &mut Outputs::default());
    };
    slot(0, 0, [0.1, 0.1, 0.0]);
    slot(1, 30, [0.0, 0.05, 0.02]);
    let mut outputs = Outputs::default();
    driver.step(at(90), Event::Timer, &mut outputs);
    let total_on_time_s = thrusters(&outputs).total_on_time_s;
    for (jet, expected_s) in [0.03, 0.03 + 0.05, 0.02].into_iter().enumerate() {
        assert!((total_on_time_s[jet] - expected_s).abs() < 1e-9, "jet {jet}: {}", total_on_time_s[jet]);
    }
}

/// A command that opens jet 2 at 3 ms and would hold for 5 s.
fn obeying(driver: &mut DriverCore, model: &PlatformModel) {
    driver.step(at(0), Event::Timer, &mut Outputs::default());
    let mut jet_on_time_s = vec![0.0; model.jets().len()];
    jet_on_time_s[2] = 5.0;
    let command = ActuatorCommand {
        header: Header { stamp: at(0).into(), frame_id: String::new() },
        valid_until: at(60).into(),
        wheel_torque_n_m: vec![0.0; model.wheels().len()],
        jet_slot_length_s: 5.0,
        jet_on_time_s,
        ..ActuatorCommand::default()
    };
    let route = Route::platform(PlatformId(0), Topic::ActuatorCommand);
    driver.step(at(3), Event::Message { route, message: &command.into() }, &mut Outputs::default());
}

fn gate_states(outputs: &Outputs) -> Vec<GateState> {
    let of = |p: &whorl_node::Publication| match &*p.message {
        Message::GateState(state) => Some(state.clone()),
        _ => None,
    };
    outputs.messages.iter().filter_map(of).collect()
}

#[test]
fn a_driver_that_was_stopped_is_not_recorded_as_safe() {
    for (watchdog_s, open_s) in [(0.0, 0.997), (0.2, 0.197)] {
        let (driver, model) = driver();
        let hardware = SimulatedHardware::new(model.clone(), Start::default(), 1, Vec::new()).unwrap();
        let hardware = hardware.with_watchdog(watchdog_s);
        let mut driver = DriverCore::new(driver.parameters, Box::new(hardware));
        obeying(&mut driver, &model);
        // Stopped from the tick at 0 to 1 s: without a watchdog the valve stayed open all the time.
        let mut outputs = Outputs::default();
        driver.step(at(1000), Event::Timer, &mut outputs);
        let state = thrusters(&outputs);
        assert!((state.total_on_time_s[2] - open_s).abs() < 1e-9, "{}", state.total_on_time_s[2]);
        assert!(!state.valve_open[2]);
        // Commanded at 3 ms, to end at 60 ms; what ended it came 940 ms later.
        let gate = gate_states(&outputs).remove(0);
        assert_eq!(gate.state, GateState::STATE_OFF);
        assert_eq!(Timestamp::from(gate.applied_at), at(3));
        assert!((gate.switched_off_late_s - 0.94).abs() < 1e-9, "{}", gate.switched_off_late_s);
        let errors: Vec<_> = outputs.log.iter().filter(|line| line.level == LogLevel::Error).collect();
        assert!(errors.len() == 1 && errors[0].text.contains("0.940 s late"), "{errors:?}");
    }
}

#[test]
fn a_command_after_a_pause_does_not_hide_it() {
    let (mut driver, model) = driver();
    obeying(&mut driver, &model);
    let mut late = ActuatorCommand {
        header: Header { stamp: at(1000).into(), frame_id: String::new() },
        sequence: 9,
        valid_until: at(1060).into(),
        wheel_torque_n_m: vec![0.0; model.wheels().len()],
        jet_slot: 4,
        jet_slot_length_s: 0.1,
        jet_on_time_s: vec![0.0; model.jets().len()],
        gimbal_rate_rad_s: Vec::new(),
    };
    late.jet_on_time_s[2] = 0.05;
    // It is handled before the timer that is owed.
    let mut outputs = Outputs::default();
    let route = Route::platform(PlatformId(0), Topic::ActuatorCommand);
    driver.step(at(1000), Event::Message { route, message: &late.into() }, &mut outputs);
    let states: Vec<u8> = gate_states(&outputs).iter().map(|state| state.state).collect();
    assert_eq!(states, [GateState::STATE_OFF, GateState::STATE_OBEYING]);

    // Nor does joining the network anew, which comes first when a process goes on.
    let (mut driver, model) = self::driver();
    obeying(&mut driver, &model);
    outputs.clear();
    driver.step(at(1000), Event::Interruption, &mut outputs);
    assert!((gate_states(&outputs)[0].switched_off_late_s - 0.94).abs() < 1e-9, "{outputs:?}");
}

#[test]
fn refusals_are_logged_once_a_second_and_counted() {
    let (mut driver, model) = driver();
    obeying(&mut driver, &model);
    let mut outputs = Outputs::default();
    for k in 1..=250_i64 {
        let command = ActuatorCommand {
            header: Header { stamp: at(10 * k + 3_600_000).into(), frame_id: String::new() },
            sequence: 1,
            valid_until: at(10 * k + 60).into(),
            wheel_torque_n_m: vec![0.0; model.wheels().len()],
            jet_slot_length_s: 0.1,
            jet_on_time_s: vec![0.0; model.jets().len()],
            ..ActuatorCommand::default()
        };
        let route = Route::platform(PlatformId(0), Topic::ActuatorCommand);
        driver.step(at(10 * k), Event::Message { route, message: &command.into() }, &mut outputs);
    }
    let refusals = outputs.log.iter().filter(|line| line.text.contains("refused")).count();
    assert_eq!(refusals, 3, "{:?}", outputs.log);
    assert_eq!(driver.gate.state().refused, 250);
}

#[test]
fn measurements_come_at_their_rates() {
    let (mut driver, _) = driver();
    let mut outputs = Outputs::default();
    (0..100).for_each(|k| driver.step(at(10 * k), Event::Timer, &mut outputs));
    let count = |topic| outputs.messages.iter().filter(|p| p.route.topic == topic).count();
    let topics =
        [Topic::ImuRaw, Topic::TruthState, Topic::VectorDirection, Topic::Battery, Topic::Temperature];
    assert_eq!(topics.map(count), [100, 100, 10, 10, 1]);
}

#[test]
fn faults_can_be_injected_while_running_and_nothing_else_changed() {
    let (mut driver, _) = driver();
    let mut changed = driver.parameters.clone();
    let Backend::Simulated { faults, seed, .. } = &mut changed.backend else { panic!() };
    faults.push(Fault {
        kind: FaultKind::JetStuckClosed { jet: 1 },
        span: whorl_params::Span { start_s: 0.0, length_s: f64::INFINITY },
    });
    let seed_was = *seed;
    driver.reconfigure(&changed).unwrap();
    let mut outputs = Outputs::default();
    driver.step(at(0), Event::Timer, &mut outputs);
    assert_eq!(thrusters(&outputs).health[..3], [0, ThrusterState::HEALTH_FAILED, 0]);
    let Backend::Simulated { seed, .. } = &mut changed.backend else { panic!() };
    *seed = seed_was + 1;
    assert!(driver.reconfigure(&changed).is_err());
}
