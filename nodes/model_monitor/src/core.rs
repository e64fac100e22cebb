//! The model monitor's state machine: measurements in, how well the model fits out.

use std::time::Duration;

use nalgebra::Vector3;

use whorl_dynamics::PlantError;
use whorl_dynamics::actuators::Kind;
use whorl_monitoring::{Channel, Fit, Monitor, State};
use whorl_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::{Message, Route, Topic};
use whorl_msgs::whorl::{ControlStatus, ModelFit};
use whorl_node::{Configurable, Event, LogLevel, NodeCore, Outputs, Timestamp};

use crate::Parameters;

const DIAGNOSTICS_PERIOD: Duration = Duration::from_secs(1);
/// A message stamped further ahead of this computer's clock is refused \[s\].
const AHEAD_S: f64 = 1.0;
/// Without authority for this long hands may be on the platform \[s\].
const CONTROL_STALE_S: f64 = 1.0;

/// The model monitor of one platform.
pub struct ModelMonitorCore {
    parameters: Parameters,
    /// Else why there is none: disabled, or of a kind that is not watched.
    monitor: Result<Monitor, String>,
    controlled_at: Option<Timestamp>,
    state: State,
    sequence: u64,
    next_diagnostics: Option<Timestamp>,
}

/// A monitor; else why there is none.
fn monitor_of(parameters: &Parameters) -> Result<Result<Monitor, String>, PlantError> {
    if !parameters.enabled {
        return Ok(Err("switched off by `enabled`".to_owned()));
    }
    let motors = Kind::ALL.into_iter().zip(parameters.model.actuators.motor_ranges());
    let mut others = motors.filter(|(kind, range)| *kind != Kind::Wheels && !range.is_empty());
    if let Some((kind, _)) = others.next() {
        return Ok(Err(format!(
            "the model has motors of another kind ({kind:?}): only wheels and jets are watched"
        )));
    }
    Monitor::new(&parameters.model, &parameters.prior, &parameters.settings).map(Ok)
}

impl ModelMonitorCore {
    /// A monitor before its first message.
    ///
    /// # Errors
    /// When the model cannot be simulated.
    pub fn new(parameters: Parameters) -> Result<Self, PlantError> {
        Ok(Self {
            monitor: monitor_of(&parameters)?,
            parameters,
            controlled_at: None,
            state: State::Waiting,
            sequence: 0,
            next_diagnostics: None,
        })
    }

    fn route(&self, topic: Topic) -> Route {
        Route::platform(self.parameters.platform, topic)
    }

    fn take(&mut self, now: Timestamp, route: Route, message: &Message) {
        let stamp = message.header().map(|header| Timestamp::from(header.stamp));
        if stamp.is_some_and(|stamp| stamp.seconds_since(now) > AHEAD_S) {
            return;
        }
        let stamp_ns = stamp.unwrap_or(now).0;
        let Ok(monitor) = &mut self.monitor else { return };
        let model = &self.parameters.model;
        let (wheels, jets) = (model.wheels().len(), model.jets().len());
        let fits = |numbers: &[f64], count| numbers.len() == count && numbers.iter().all(|x| x.is_finite());
        match message {
            Message::ControlStatus(status) => {
                if status.mode == ControlStatus::MODE_IDLE || status.mode == ControlStatus::MODE_SAFE_COAST {
                    self.controlled_at = None;
                    monitor.pause();
                } else {
                    self.controlled_at = Some(now);
                    monitor.on_controlled(stamp_ns);
                }
            }
            _ if self.controlled_at.is_none() => {}
            Message::Imu(imu) => monitor.on_gyro(stamp_ns, &imu.angular_velocity.into()),
            Message::JointState(state)
                if route.topic == Topic::WheelState
                    && fits(&state.velocity, wheels)
                    && fits(&state.effort, wheels) =>
            {
                monitor.on_wheels(stamp_ns, &state.velocity, &state.effort);
            }
            Message::ThrusterState(state)
                if fits(&state.total_on_time_s, jets) && state.valve_open.len() == jets =>
            {
                monitor.on_valves(stamp_ns, &state.valve_open, &state.total_on_time_s);
            }
            Message::Vector3Stamped(moment) if route.topic == Topic::BallastMoment => {
                monitor.on_ballast(stamp_ns, &moment.vector.into());
            }
            Message::AttitudeEstimate(estimate) => {
                let rate = Vector3::from(estimate.omega_wb_b_rad_s);
                match estimate.q_world_body.to_unit().filter(|_| estimate.usable()) {
                    Some(q_world_body) => monitor.on_attitude(stamp_ns, &q_world_body, &rate),
                    None => monitor.pause(),
                }
            }
            Message::FluidPressure(pressure) if pressure.fluid_pressure.is_finite() => {
                monitor.on_pressure(pressure.fluid_pressure);
            }
            _ => {}
        }
    }

    fn publish(&mut self, now: Timestamp, outputs: &mut Outputs) {
        let stale = |since: Timestamp| now.seconds_since(since) > CONTROL_STALE_S;
        if self.controlled_at.is_some_and(stale) {
            self.controlled_at = None;
            if let Ok(monitor) = &mut self.monitor {
                monitor.pause();
            }
        }
        let name = &self.parameters.name;
        let mut message = ModelFit {
            header: Header { stamp: now.into(), frame_id: format!("{name}/base_link") },
            sequence: self.sequence,
            gyro_whitened: Vector3::repeat(f64::NAN).into(),
            ln_evidence: f64::NEG_INFINITY,
            ln_limit: self.parameters.settings.limit_nats(),
            probability: f64::NAN,
            ..ModelFit::default()
        };
        self.sequence += 1;
        let (mut hole, mut holes) = (None, 0);
        if let Ok(monitor) = &mut self.monitor {
            let fit = monitor.fit();
            fill(&mut message, &fit, self.parameters.model.wheels().len());
            (hole, holes) = (fit.hole, fit.holes);
            if fit.state != self.state {
                let level = if fit.state == State::Mismatch { LogLevel::Warn } else { LogLevel::Info };
                if fit.state == State::Mismatch || self.state == State::Mismatch {
                    outputs.log(level, format!("{name}: {}", message.in_words()));
                }
                self.state = fit.state;
            }
        }
        if self.next_diagnostics.is_none_or(|due| now >= due) {
            self.next_diagnostics = Some(now + DIAGNOSTICS_PERIOD);
            outputs.publish(Route::shared(Topic::Diagnostics), self.diagnostics(now, &message, hole, holes));
        }
        outputs.publish(self.route(Topic::ModelFit), message);
    }

    fn diagnostics(
        &self,
        now: Timestamp,
        fit: &ModelFit,
        hole: Option<String>,
        holes: u64,
    ) -> DiagnosticArray {
        let waits = hole.map(|hole| format!("{}: {hole}", fit.in_words()));
        let values = [
            ("evidence against the model [nats]", fit.ln_evidence),
            ("evidence that is a mismatch [nats]", fit.ln_limit),
            ("times that data were late, lost or in disorder", holes as f64),
        ];
        let status = DiagnosticStatus {
            level: if self.state == State::Mismatch { DiagnosticStatus::WARN } else { DiagnosticStatus::OK },
            name: format!("{}: model_monitor", self.parameters.name),
            message: self.monitor.as_ref().err().cloned().or(waits).unwrap_or_else(|| fit.in_words()),
            hardware_id: self.parameters.name.clone(),
            values: values
                .iter()
                .map(|(key, value)| KeyValue { key: (*key).to_owned(), value: format!("{value:.1}") })
                .collect(),
        };
        let header = Header { stamp: now.into(), frame_id: String::new() };
        DiagnosticArray { header, status: vec![status] }
    }
}

fn fill(message: &mut ModelFit, fit: &Fit, wheels: usize) {
    if let Some(stamp_ns) = fit.stamp_ns {
        message.header.stamp = Timestamp(stamp_ns).into();
    }
    message.state = match fit.state {
        State::Waiting => ModelFit::STATE_WAITING,
        State::Agrees => ModelFit::STATE_AGREES,
        State::Doubt => ModelFit::STATE_DOUBT,
        State::Mismatch => ModelFit::STATE_MISMATCH,
    };
    let mut gyro = Vector3::repeat(f64::NAN);
    message.wheel_speed_whitened = vec![f64::NAN; wheels];
    for (component, whitened) in &fit.whitened {
        let wheel = message.wheel_speed_whitened.get_mut(component.index());
        match (component.channel, wheel) {
            (Channel::Gyro, _) => gyro[component.index()] = *whitened,
            (_, Some(wheel)) => *wheel = *whitened,
            (_, None) => {}
        }
    }
    message.gyro_whitened = gyro.into();
    (message.squares, message.squares_dof) = fit.squares;
    message.ln_evidence = fit.ln_evidence;
    let Some(likeliest) = &fit.likeliest else { return };
    message.effect.clone_from(&likeliest.effect);
    message.probability = likeliest.probability;
    message.since = Timestamp(likeliest.since_ns).into();
    for (name, [value, stddev], unit) in &likeliest.parameters {
        message.parameter.push(name.clone());
        message.unit.push((*unit).to_owned());
        message.estimate.push(*value);
        message.stddev.push(*stddev);
    }
}

impl NodeCore for ModelMonitorCore {
    fn subscriptions(&self) -> Vec<Route> {
        if self.monitor.is_err() {
            return Vec::new();
        }
        let topics = [
            Topic::ImuRaw,
            Topic::WheelState,
            Topic::ThrusterState,
            Topic::AttitudeEstimate,
            Topic::ControlStatus,
            Topic::TankPressure,
            Topic::BallastMoment,
        ];
        topics.into_iter().map(|topic| self.route(topic)).collect()
    }

    fn publications(&self) -> Vec<Route> {
        vec![self.route(Topic::ModelFit), Route::shared(Topic::Diagnostics)]
    }

    fn timer_period(&self) -> Option<Duration> {
        Some(Duration::from_secs_f64(1.0 / self.parameters.rate_hz))
    }

    fn step(&mut self, now: Timestamp, event: Event<'_>, outputs: &mut Outputs) {
        match event {
            Event::Message { route, message } => self.take(now, route, message),
            Event::Timer => self.publish(now, outputs),
            Event::Interruption => {
                if let Ok(monitor) = &mut self.monitor {
                    monitor.pause();
                }
            }
            Event::Request { .. } | Event::Woken | Event::Shutdown => {}
        }
    }
}

impl Configurable for ModelMonitorCore {
    type Parameters = Parameters;

    fn reconfigure(&mut self, parameters: &Parameters) -> Result<(), String> {
        let own = &self.parameters;
        if (parameters.platform, &parameters.name) != (own.platform, &own.name) {
            return Err("the platform cannot be changed while the monitor runs".to_owned());
        }
        if parameters.rate_hz != own.rate_hz {
            return Err("the rate cannot be changed while the monitor runs".to_owned());
        }
        if parameters.enabled != own.enabled {
            return Err("the monitor cannot be switched on or off while it runs".to_owned());
        }
        if (&parameters.model, &parameters.prior, &parameters.settings, parameters.forget)
            != (&own.model, &own.prior, &own.settings, own.forget)
        {
            self.monitor = monitor_of(parameters).map_err(|error| error.to_string())?;
        }
        self.parameters = parameters.clone();
        Ok(())
    }
}
