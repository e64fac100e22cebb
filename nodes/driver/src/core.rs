//! The driver's state machine.

use std::time::Duration;

use nalgebra::Vector3;
use whorl_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::{Message, Route, Topic};
use whorl_msgs::whorl::ActuatorCommand;
use whorl_node::{Configurable, Event, LogLevel, NodeCore, Outputs, Repeats, Timestamp};

use crate::arming::Arming;
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
    arming: Arming,
}

impl DriverCore {
    /// A driver of this hardware; [`Self::from_parameters`] makes the hardware too.
    #[must_use]
    pub fn new(parameters: Parameters, hardware: Box<dyn Hardware>) -> Self {
        Self {
            gate: Gate::new(&parameters.model.actuators),
            arming: Arming::new(parameters.armed, &parameters.backend),
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

    /// The same where traffic is secured, or not ([`Gate::secured`]).
    #[must_use]
    pub fn secured(self, secured: bool) -> Self {
        if secured { Self { gate: self.gate.secured(), ..self } } else { self }
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
        if let Some(hindrance) = self.hindrance() {
            self.gate.ignore();
            let text = || format!("{}: actuator commands are refused: {hindrance}", self.parameters.name);
            if let Some(text) = self.refusals.admit(now, text) {
                outputs.log(LogLevel::Warn, text);
            }
            return;
        }
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
        self.publish_measurements(now, outputs);
        if self.next_diagnostics.is_none_or(|due| due <= now) {
            self.next_diagnostics = Some(now + DIAGNOSTICS_PERIOD);
            outputs.publish(Route::shared(Topic::Diagnostics), self.diagnostics(now));
        }
    }

    fn publish_measurements(&mut self, now: Timestamp, outputs: &mut Outputs) {
        self.hardware.measurements(now, &self.frame_id, &mut self.measured);
        for (topic, message) in self.measured.drain(..) {
            outputs.publish(Route::platform(self.parameters.platform, topic), message);
        }
        for (warning, text) in self.hardware.take_news() {
            let level = if warning { LogLevel::Warn } else { LogLevel::Info };
            outputs.log(level, format!("{}: {text}", self.parameters.name));
        }
        if self.hardware.is_stopped() && self.arming.is_armed() {
            // What a person has stopped, a person lets go again.
            self.arming = Arming::Disarmed;
            outputs.log(LogLevel::Warn, format!("{}: disarmed by the emergency stop", self.parameters.name));
        }
        if let Some(text) = self.arming.look(|| self.hardware.not_ready()) {
            outputs.log(LogLevel::Info, format!("{}: {text}", self.parameters.name));
        }
        // Nothing moves on without what it needs.
        if self.gate.deadline().is_some()
            && let Some(hindrance) = self.hindrance()
        {
            let action = self.gate.close();
            self.hardware.apply(now, &action);
            let text = format!("{}: valves closed, wheel torque zero: {hindrance}", self.parameters.name);
            outputs.log(LogLevel::Error, text);
            self.publish_gate(now, outputs);
        }
    }

    /// Why the platform must not move now.
    fn hindrance(&self) -> Option<String> {
        if !self.arming.is_armed() {
            let name = &self.parameters.name;
            let reasons = self.not_ready();
            let armed = match self.arming {
                Arming::Waiting => "it is not armed yet".to_owned(),
                _ => format!("it is not armed (whorl arm {name})"),
            };
            return Some(if reasons.is_empty() { armed } else { format!("{armed}: {}", reasons.join("; ")) });
        }
        self.hardware.lost_needed().map(|device| format!("device {device} is lost"))
    }

    /// Why it is not armed, or would not be.
    fn not_ready(&self) -> Vec<String> {
        if self.arming.is_armed() { Vec::new() } else { self.hardware.not_ready() }
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
                    KeyValue { key: "armed".to_owned(), value: self.arming.words().to_owned() },
                    KeyValue { key: "not ready".to_owned(), value: self.not_ready().join("; ") },
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
            Event::Woken => {
                self.watch(now, outputs);
                self.publish_measurements(now, outputs);
            }
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

    /// Only faults and arming may change while the driver runs.
    fn reconfigure(&mut self, parameters: &Parameters) -> Result<(), String> {
        let mut changed = self.parameters.clone();
        changed.armed = parameters.armed;
        if let (Backend::Simulated { faults, .. }, Backend::Simulated { faults: new, .. }) =
            (&mut changed.backend, &parameters.backend)
        {
            faults.clone_from(new);
        }
        if changed != *parameters {
            let text = "only faults and armed can be changed while the driver runs; restart it for the rest";
            return Err(text.to_owned());
        }
        // Asked for again, it is an answer to what stopped it before.
        self.arming.ask(parameters.armed, || self.hardware.not_ready())?;
        if let Backend::Simulated { faults, .. } = &parameters.backend {
            self.hardware.set_faults(faults);
        }
        self.parameters = changed;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
