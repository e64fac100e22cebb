//! The driver's state machine.

use std::time::Duration;

use nalgebra::Vector3;
use whorl_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::{Message, Route, Topic};
use whorl_node::{Configurable, Event, LogLevel, NodeCore, Outputs, Timestamp};

use crate::gate::{Action, Gate};
use crate::hardware::Hardware;
use crate::parameters::{Backend, Parameters};

const DIAGNOSTICS_PERIOD: Duration = Duration::from_secs(1);

/// The driver of one platform.
pub struct DriverCore {
    parameters: Parameters,
    frame_id: String,
    gate: Gate,
    hardware: Box<dyn Hardware>,
    next_diagnostics: Option<Timestamp>,
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
            measured: Vec::new(),
        }
    }

    fn tick(&mut self, now: Timestamp, outputs: &mut Outputs) {
        let deadline = self.gate.deadline();
        // The timeout acts at its own instant, not at the tick after it.
        if let Some((action, deadline)) = self.gate.watch(now).zip(deadline) {
            self.hardware.advance_to(deadline);
            self.hardware.apply(deadline, &action);
            outputs.log(
                LogLevel::Warn,
                format!(
                    "{}: no valid actuator command: valves closed, wheel torque zero",
                    self.parameters.name
                ),
            );
        }
        self.hardware.advance_to(now);
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
        measurements.into_iter().chain([Route::shared(Topic::Diagnostics)]).collect()
    }

    fn timer_period(&self) -> Option<Duration> {
        Some(self.parameters.period())
    }

    fn step(&mut self, now: Timestamp, event: Event<'_>, outputs: &mut Outputs) {
        match event {
            Event::Timer => self.tick(now, outputs),
            Event::Message { message: Message::ActuatorCommand(command), .. } => {
                match self.gate.command(now, command) {
                    Ok(actions) => {
                        self.hardware.advance_to(now);
                        actions.iter().for_each(|action| self.hardware.apply(now, action));
                    }
                    Err(refusal) => outputs.log(
                        LogLevel::Warn,
                        format!(
                            "{}: actuator command {} refused: {}",
                            self.parameters.name,
                            command.sequence,
                            refusal.reason()
                        ),
                    ),
                }
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
            Event::Shutdown => {
                self.hardware.advance_to(now);
                self.hardware.apply(now, &Action::AllOff);
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
    use whorl_msgs::whorl::{ActuatorCommand, ThrusterState};

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
        let parameters =
            Parameters { platform: PlatformId(0), name: "whorl_1".into(), model: model.clone(), backend };
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
