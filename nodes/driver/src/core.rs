//! The driver's state machine.

use std::time::Duration;

use nalgebra::Vector3;
use whorl_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::{Message, Route, Topic};
use whorl_msgs::whorl::ActuatorCommand;
use whorl_node::{Configurable, Event, LogLevel, NodeCore, Outputs, Repeats, Timestamp};

use crate::gate::Gate;
use crate::hardware::Hardware;
use crate::parameters::{Backend, Parameters};

const DIAGNOSTICS_PERIOD: Duration = Duration::from_secs(1);
const GATE_PERIOD: Duration = Duration::from_millis(100);
/// A timeout that is noticed within this many ticks acted at its own instant: it fell between two of them. One that is
/// noticed later acts when it is noticed, because this process was stopped or starved, and did nothing meanwhile.
const TICKS_IN_TIME: u32 = 2;

/// The driver of one platform.
pub struct DriverCore {
    parameters: Parameters,
    frame_id: String,
    gate: Gate,
    hardware: Box<dyn Hardware>,
    next_diagnostics: Option<Timestamp>,
    next_gate: Option<Timestamp>,
    gate_sequence: u64,
    refusals: Repeats,
    measured: Vec<(Topic, Message)>,
}

impl DriverCore {
    /// A driver of this hardware; [`Self::from_parameters`] makes the hardware too.
    #[must_use]
    pub fn new(parameters: Parameters, hardware: Box<dyn Hardware>) -> Self {
        Self {
            gate: Gate::new(&parameters.model.actuators),
            frame_id: format!("{}/base_link", parameters.name),
            parameters,
            hardware,
            next_diagnostics: None,
            next_gate: None,
            gate_sequence: 0,
            refusals: Repeats::default(),
            measured: Vec::new(),
        }
    }

    /// Switches everything off when commands have stopped coming, and says so.
    fn watch(&mut self, now: Timestamp, outputs: &mut Outputs) {
        let deadline = self.gate.deadline();
        let Some((action, deadline)) = self.gate.watch(now).zip(deadline) else { return };
        let in_time = now <= deadline + self.parameters.period() * TICKS_IN_TIME;
        let at = if in_time { deadline } else { now };
        self.hardware.advance_to(at);
        self.hardware.apply(at, &action);
        let name = &self.parameters.name;
        if in_time {
            let text = format!("{name}: no valid actuator command: valves closed, wheel torque zero");
            outputs.log(LogLevel::Warn, text);
        } else {
            let late_s = now.seconds_since(deadline);
            let text = format!(
                "{name}: this process did not run when the commands ended: valves closed and wheel torque zero \
                 {late_s:.3} s late, unless the hardware's own watchdog acted"
            );
            outputs.log(LogLevel::Error, text);
        }
        self.publish_gate(now, outputs);
    }

    fn publish_gate(&mut self, now: Timestamp, outputs: &mut Outputs) {
        self.next_gate = Some(now + GATE_PERIOD);
        let mut state = self.gate.state();
        state.header = Header { stamp: now.into(), frame_id: self.frame_id.clone() };
        state.sequence = self.gate_sequence;
        self.gate_sequence += 1;
        outputs.publish(Route::platform(self.parameters.platform, Topic::GateState), state);
    }

    fn command(&mut self, now: Timestamp, command: &ActuatorCommand, outputs: &mut Outputs) {
        // First: what this process slept through has happened before this command.
        self.watch(now, outputs);
        let was_open = self.gate.deadline().is_some();
        match self.gate.command(now, command) {
            Ok(actions) => {
                self.hardware.advance_to(now);
                actions.iter().for_each(|action| self.hardware.apply(now, action));
                if !was_open {
                    self.publish_gate(now, outputs);
                }
            }
            Err(refusal) => {
                let text = || {
                    let (name, number) = (&self.parameters.name, command.sequence);
                    format!("{name}: actuator command {number} refused: {}", refusal.reason())
                };
                if let Some(text) = self.refusals.admit(now, text) {
                    outputs.log(LogLevel::Warn, text);
                }
            }
        }
    }

    fn tick(&mut self, now: Timestamp, outputs: &mut Outputs) {
        self.watch(now, outputs);
        self.hardware.advance_to(now);
        self.hardware.heartbeat(now);
        if self.next_gate.is_none_or(|due| due <= now) {
            self.publish_gate(now, outputs);
        }
        self.hardware.measurements(now, &self.frame_id, &mut self.measured);
        for (topic, message) in self.measured.drain(..) {
            outputs.publish(Route::platform(self.parameters.platform, topic), message);
        }
        if self.next_diagnostics.is_none_or(|due| due <= now) {
            self.next_diagnostics = Some(now + DIAGNOSTICS_PERIOD);
            outputs.publish(Route::shared(Topic::Diagnostics), self.diagnostics(now));
        }
    }

    fn diagnostics(&self, now: Timestamp) -> DiagnosticArray {
        let status = self.hardware.status();
        let counts = self.gate.counts();
        let value = |key: &str, value: u64| KeyValue { key: key.to_owned(), value: value.to_string() };
        DiagnosticArray {
            header: Header { stamp: now.into(), frame_id: String::new() },
            status: vec![DiagnosticStatus {
                level: if status.warning { DiagnosticStatus::WARN } else { DiagnosticStatus::OK },
                name: format!("{}: driver", self.parameters.name),
                message: status.text,
                hardware_id: self.parameters.name.clone(),
                values: vec![
                    value("commands accepted", counts.accepted),
                    value("commands refused", counts.refused),
                    value("command timeouts", counts.timeouts),
                ],
            }],
        }
    }
}

impl NodeCore for DriverCore {
    fn subscriptions(&self) -> Vec<Route> {
        vec![
            Route::platform(self.parameters.platform, Topic::ActuatorCommand),
            Route::platform(self.parameters.platform, Topic::BallastMoment),
        ]
    }

    fn publications(&self) -> Vec<Route> {
        let measurements = Topic::FROM_DRIVER.map(|topic| Route::platform(self.parameters.platform, topic));
        let gate = Route::platform(self.parameters.platform, Topic::GateState);
        measurements.into_iter().chain([gate, Route::shared(Topic::Diagnostics)]).collect()
    }

    fn timer_period(&self) -> Option<Duration> {
        Some(self.parameters.period())
    }

    fn step(&mut self, now: Timestamp, event: Event<'_>, outputs: &mut Outputs) {
        match event {
            Event::Timer => self.tick(now, outputs),
            Event::Message { message: Message::ActuatorCommand(command), .. } => {
                self.command(now, command, outputs);
            }
            // Without commands the masses keep their position: no timeout is needed.
            Event::Message { route, message: Message::Vector3Stamped(moment) }
                if route.topic == Topic::BallastMoment =>
            {
                let moment_b_n_m: Vector3<f64> = moment.vector.into();
                if moment_b_n_m.iter().all(|x| x.is_finite()) {
                    self.hardware.advance_to(now);
                    self.hardware.move_ballast(now, moment_b_n_m);
                }
            }
            Event::Shutdown | Event::Interruption => {
                // First what is overdue: the process may have been stopped until now.
                self.watch(now, outputs);
                let action = self.gate.close();
                self.hardware.advance_to(now);
                self.hardware.apply(now, &action);
                self.publish_gate(now, outputs);
            }
            Event::Message { .. } | Event::Request { .. } => {}
        }
    }

    fn finished(&self) -> bool {
        self.hardware.ended()
    }
}

impl Configurable for DriverCore {
    type Parameters = Parameters;

    /// Only faults may change while the driver runs.
    fn reconfigure(&mut self, parameters: &Parameters) -> Result<(), String> {
        let mut with_new_faults = self.parameters.clone();
        if let (Backend::Simulated { faults, .. }, Backend::Simulated { faults: new, .. }) =
            (&mut with_new_faults.backend, &parameters.backend)
        {
            faults.clone_from(new);
            if with_new_faults == *parameters {
                self.hardware.set_faults(new);
                self.parameters = with_new_faults;
                return Ok(());
            }
        }
        Err("only faults can be changed while the driver runs; restart it for the rest".to_owned())
    }
}

#[cfg(test)]
mod tests {
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
        };
        (DriverCore::new(parameters, Box::new(hardware)), model)
    }

    fn thrusters(outputs: &Outputs) -> ThrusterState {
        let found = outputs.messages.iter().find_map(|p| match &p.message {
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
            };
            let route = Route::platform(PlatformId(0), Topic::ActuatorCommand);
            driver.step(
                at(now_ms),
                Event::Message { route, message: &command.into() },
                &mut Outputs::default(),
            );
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
        let of = |p: &whorl_node::Publication| match &p.message {
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
            start_s: 0.0,
            length_s: f64::INFINITY,
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
}
