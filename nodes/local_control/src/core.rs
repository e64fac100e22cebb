//! The state machine.

use std::time::Duration;

use nalgebra::Vector3;
use thiserror::Error;
use whorl_control::mass_balancing::BalancingError;
use whorl_control::reference::{EnvelopeError, Reference, TiltEnvelope};
use whorl_control::safe_mode::{SafeMode, SafeModeError, SafeState};
use whorl_control::tracking::{GyrostatInertia, TrackingError, TrackingInput, TrackingLaw};
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_dynamics::{Environment, Gyrostat, GyrostatError};
use whorl_msgs::sensor_msgs::Imu;
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::{Message, Route, Topic};
use whorl_msgs::whorl::{AttitudeEstimate, AttitudeReference, ClockReply, ClockRequest, ControlStatus};
use whorl_node::{Configurable, Event, NodeCore, Outputs, Timestamp};

use crate::actuation::{Actuated, Actuation, ActuationError};
use crate::authority::{Authority, Heartbeat};
use crate::balancing::Balancing;
use crate::excitation::{Drive, Excitations, Played, tilted_as};
use crate::inputs::{Estimate, Inputs};
use crate::parameters::{Hold, Parameters};
use crate::publishing::Report;
use crate::target::{Goal, Target};

/// Effects whose torque depends on what the controller does not know (phase, hidden states), or
/// must not be countered (contact).
const NOT_COMPENSATED: [&str; 5] =
    ["air_current_periodic", "tilt_stop_contact", "slosh", "flexible_mode", "unmodelled_torque"];
/// Longest time that one step may count for [s].
const LONGEST_STEP_S: f64 = 0.1;
/// Share of a limit below which a tilt or rate fault ends.
const FAULT_RELEASE: f64 = 0.95;

/// Why local control cannot start.
#[derive(Debug, Error)]
pub enum LocalControlError {
    /// The model is not a possible platform.
    #[error("model: {0}")]
    Gyrostat(#[from] GyrostatError),
    /// Gains.
    #[error("tracking law: {0}")]
    Tracking(#[from] TrackingError),
    /// Safe mode.
    #[error(transparent)]
    SafeMode(#[from] SafeModeError),
    /// Tilt margins.
    #[error("limits: {0}")]
    Envelope(#[from] EnvelopeError),
    /// Actuators.
    #[error(transparent)]
    Actuation(#[from] ActuationError),
    /// Mass balancing.
    #[error(transparent)]
    Balancing(#[from] BalancingError),
}

/// Local control of one platform.
pub struct LocalControlCore {
    pub(crate) parameters: Parameters,
    pub(crate) frame_id: String,
    pub(crate) gyrostat: Gyrostat,
    pub(crate) inertia: GyrostatInertia,
    pub(crate) law: TrackingLaw,
    pub(crate) safe_mode: SafeMode,
    pub(crate) safe_envelope: TiltEnvelope,
    pub(crate) target: Target,
    pub(crate) actuation: Actuation,
    pub(crate) excitations: Excitations,
    /// `None`: the mass actuators are left alone.
    pub(crate) balancing: Option<Balancing>,
    pub(crate) inputs: Inputs,
    pub(crate) heartbeat: Heartbeat,
    pub(crate) mode: u8,
    pub(crate) reason: u8,
    /// Reason of the present safe episode.
    pub(crate) fault: Option<u8>,
    /// Authority was lost and the platform has come to rest since.
    pub(crate) released: bool,
    /// Stamp and time of the latest step.
    pub(crate) latest_stamp: Option<Timestamp>,
    pub(crate) latest_step: Option<Timestamp>,
    pub(crate) command_sequence: u64,
    pub(crate) status_sequence: u64,
    pub(crate) clock_sequence: u64,
    pub(crate) next_status: Option<Timestamp>,
    pub(crate) next_diagnostics: Option<Timestamp>,
}

impl LocalControlCore {
    /// Local control as the parameters say.
    ///
    /// # Errors
    /// [`LocalControlError`] when model, gains, limits or actuators are not usable.
    pub fn new(parameters: Parameters) -> Result<Self, LocalControlError> {
        let mut model = parameters.model.clone();
        model.effects.retain(|id, _| !NOT_COMPENSATED.contains(&id.as_str()));
        let gyrostat = Gyrostat::new(&model)?;
        let adjusted = gyrostat.model();
        let inertia = GyrostatInertia::new(*adjusted.mass_properties.inertia_b_kg_m2(), &adjusted.wheels);
        let limits = &parameters.limits;
        let gains = if parameters.actuators == whorl_allocation::Mode::Jets {
            parameters.jet_gains
        } else {
            parameters.gains
        };
        let envelope = TiltEnvelope::new(adjusted.tilt_limit, limits.reference_tilt_margin_rad)?;
        Ok(Self {
            law: TrackingLaw::new(inertia, gains)?,
            safe_mode: SafeMode::new(parameters.safe_mode)?,
            safe_envelope: TiltEnvelope::new(adjusted.tilt_limit, limits.safe_tilt_margin_rad)?,
            target: Target::new(parameters.rejoin, limits.deceleration_rad_s2, envelope),
            actuation: Actuation::new(&parameters, &gyrostat)?,
            excitations: Excitations::new(envelope, limits.max_rate_rad_s),
            balancing: parameters.balancing.map(|b| Balancing::new(b, &gyrostat)).transpose()?,
            inputs: Inputs::new(adjusted.wheels.len(), adjusted.jets.len(), limits.max_message_age_s),
            frame_id: format!("{}/base_link", parameters.name),
            heartbeat: Heartbeat::default(),
            mode: ControlStatus::MODE_IDLE,
            reason: ControlStatus::REASON_NO_AUTHORITY,
            fault: None,
            released: false,
            latest_stamp: None,
            latest_step: None,
            command_sequence: 0,
            status_sequence: 0,
            clock_sequence: 0,
            next_status: None,
            next_diagnostics: None,
            inertia,
            gyrostat,
            parameters,
        })
    }

    /// The parameters in force.
    #[must_use]
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// Whether actuators may be used now, and how.
    fn authority(&self, now: Timestamp) -> Authority {
        match self.heartbeat.authority(now) {
            Authority::Lost(for_s) if self.released || for_s > self.parameters.limits.authority_grace_s => {
                Authority::None
            }
            authority => authority,
        }
    }

    fn fresh_estimate(&self, now: Timestamp) -> Option<&Estimate> {
        let fresh = |e: &&Estimate| now.seconds_since(e.stamp) <= self.parameters.limits.estimate_timeout_s;
        self.inputs.estimate().filter(fresh)
    }

    /// Why the platform may not point now.
    fn find_fault(&self, now: Timestamp, authority: Authority) -> Option<u8> {
        if authority == Authority::Abort {
            return Some(ControlStatus::REASON_ABORT);
        }
        let Some(estimate) = self.fresh_estimate(now) else {
            return Some(ControlStatus::REASON_ESTIMATE_STALE);
        };
        if !estimate.usable {
            return Some(ControlStatus::REASON_ESTIMATE_UNHEALTHY);
        }
        // A fault of this kind ends only clearly inside its limit.
        let limit = |reason: u8, limit: f64| {
            if self.fault == Some(reason) { limit * FAULT_RELEASE } else { limit }
        };
        let tilt = self.safe_envelope.angle_rad(&estimate.q_world_body);
        if tilt > limit(ControlStatus::REASON_TILT_LIMIT, self.safe_envelope.max_rad()) {
            return Some(ControlStatus::REASON_TILT_LIMIT);
        }
        let max_rate = self.parameters.limits.max_rate_rad_s;
        if estimate.omega_wb_b_rad_s.norm() > limit(ControlStatus::REASON_RATE_LIMIT, max_rate) {
            return Some(ControlStatus::REASON_RATE_LIMIT);
        }
        None
    }

    /// A step on a new estimate: the normal case.
    fn on_estimate(&mut self, now: Timestamp, message: &AttitudeEstimate, outputs: &mut Outputs) {
        if !self.inputs.estimate_arrived(now, message) {
            return;
        }
        let Some(estimate) = self.inputs.estimate().copied() else { return };
        if !self.due(estimate.stamp) {
            return;
        }
        let authority = self.authority(now);
        if authority == Authority::None {
            self.idle(now, estimate.stamp, outputs);
        } else if self.safe_mode.state() == SafeState::Nominal && self.find_fault(now, authority).is_none() {
            self.track(now, &estimate, authority, outputs);
        } else if self.safe_mode.state() == SafeState::Nominal {
            self.safe(now, estimate.stamp, authority, outputs);
        }
        // In safe mode the gyro's own samples trigger the steps.
    }

    fn on_imu(&mut self, now: Timestamp, message: &Imu, outputs: &mut Outputs) {
        let Some(stamp) = self.inputs.imu_arrived(now, message) else { return };
        let authority = self.authority(now);
        let estimates = self.fresh_estimate(now).is_some();
        if authority == Authority::None {
            if !estimates && self.due(stamp) {
                self.idle(now, stamp, outputs);
            }
        } else if (self.safe_mode.state() != SafeState::Nominal || !estimates) && self.due(stamp) {
            self.safe(now, stamp, authority, outputs);
        }
    }

    /// The watchdog: acts only when no message has triggered a step for a while.
    fn on_timer(&mut self, now: Timestamp, outputs: &mut Outputs) {
        let quiet_s = self.parameters.limits.estimate_timeout_s.min(0.05);
        if self.latest_step.is_none_or(|at| now.seconds_since(at) >= quiet_s) {
            let authority = self.authority(now);
            // A command must not be stamped later than the measurements to come.
            let stamp = self.latest_stamp.unwrap_or_default();
            if authority == Authority::None {
                self.idle(now, stamp, outputs);
            } else {
                self.safe(now, stamp, authority, outputs);
            }
        }
        self.publish_diagnostics(now, outputs);
    }

    /// Whether a step is due for a measurement of this stamp.
    fn due(&self, stamp: Timestamp) -> bool {
        let period_s = 0.9 / self.parameters.control_rate_hz;
        self.latest_stamp.is_none_or(|latest| stamp.seconds_since(latest) >= period_s)
    }

    fn idle(&mut self, now: Timestamp, stamp: Timestamp, outputs: &mut Outputs) {
        self.leave_tracking();
        self.safe_mode.reset();
        self.fault = None;
        let actuated = self.actuation.off();
        let report = Report {
            mode: ControlStatus::MODE_IDLE,
            reason: ControlStatus::REASON_NO_AUTHORITY,
            tracking: None,
            asked_b_n_m: Vector3::zeros(),
            actuated,
        };
        self.finish(now, stamp, report, outputs);
    }

    fn leave_tracking(&mut self) {
        self.law.reset();
        self.target.reset();
        if self.excitations.interrupt() {
            self.actuation.end_excitation();
        }
        if let Some(balancing) = &mut self.balancing {
            balancing.interrupt();
        }
    }

    /// What is to be played in this step, if anything, and the number of its pulse.
    fn played(&mut self, estimate: &Estimate, authority: Authority) -> (Played, Option<u64>) {
        let asked = self.inputs.excitation(estimate.stamp).filter(|_| authority == Authority::Track);
        let Some((name, elapsed_s)) = asked else {
            if self.excitations.stop() {
                self.actuation.end_excitation();
            }
            return (Played::Nothing, None);
        };
        let wheels = &self.gyrostat.model().wheels;
        let speeds = self.inputs.wheel_speed_rad_s();
        let known = &self.parameters.excitations;
        let played = self.excitations.play((&name, elapsed_s), known, wheels, speeds, estimate);
        if matches!(played, (Played::Refused(_), _)) {
            self.actuation.end_excitation();
        }
        played
    }

    fn excite(
        &mut self,
        estimate: &Estimate,
        torque_b_n_m: Option<&Vector3<f64>>,
        drive: &Drive,
        pulse: Option<u64>,
    ) -> Actuated {
        let speeds = self.inputs.wheel_speed_rad_s();
        let failed = self.inputs.jet_failed();
        let (actuated, slot_began) =
            self.actuation.excite(estimate.stamp, torque_b_n_m, drive, speeds, failed);
        if slot_began {
            self.excitations.fired(pulse);
        }
        actuated
    }

    /// An excitation that leaves the reference, or its yaw, alone.
    fn let_go(
        &mut self,
        now: Timestamp,
        estimate: &Estimate,
        drive: &Drive,
        pulse: Option<u64>,
        outputs: &mut Outputs,
    ) {
        // Afterwards the reference is joined from where the body then is.
        self.target.reset();
        if let Some(balancing) = &mut self.balancing {
            balancing.interrupt();
        }
        let tracking = match drive.hold {
            Hold::Tilt => {
                let wheel_momentum = self.actuation.wheel_momentum_b_n_m_s(self.inputs.wheel_speed_rad_s());
                let mut output = self.law.torque(&TrackingInput {
                    q_world_body: &estimate.q_world_body,
                    omega_wb_b_rad_s: &estimate.omega_wb_b_rad_s,
                    reference: &tilted_as(&drive.start, estimate),
                    wheel_momentum_b_n_m_s: &wheel_momentum,
                    modelled_torque_b_n_m: &self.modelled_torque(estimate),
                    dt_s: self.step_length_s(now),
                });
                // Yaw gets nothing but the excitation, not even what the model would counter.
                let up = estimate.q_world_body.inverse() * Vector3::z();
                output.torque_b_n_m -= up * up.dot(&output.torque_b_n_m);
                Some(output)
            }
            Hold::Attitude | Hold::Nothing => {
                self.law.reset();
                None
            }
        };
        let effects = self.wheel_effects_n_m(estimate);
        self.actuation.set_wheel_effects(&effects);
        let asked = tracking.as_ref().map(|output| output.torque_b_n_m);
        let actuated = self.excite(estimate, asked.as_ref(), drive, pulse);
        let report = Report {
            mode: ControlStatus::MODE_EXCITE,
            reason: ControlStatus::REASON_NONE,
            tracking,
            asked_b_n_m: asked.unwrap_or_default(),
            actuated,
        };
        self.finish(now, estimate.stamp, report, outputs);
    }

    fn track(&mut self, now: Timestamp, estimate: &Estimate, authority: Authority, outputs: &mut Outputs) {
        self.fault = None;
        let (played, pulse) = self.played(estimate, authority);
        if let Played::Drive(drive) = &played
            && drive.hold != Hold::Attitude
        {
            return self.let_go(now, estimate, drive, pulse, outputs);
        }
        let dt_s = self.step_length_s(now);
        // An excitation that came to a limit ends as hard as control can: its reference stands at once.
        let from_rate = if matches!(played, Played::Refused(_)) { 0.0 } else { 1.0 };
        let body = Reference {
            q_world_reference: estimate.q_world_body,
            omega_wr_r_rad_s: estimate.omega_wb_b_rad_s * from_rate,
            omega_dot_wr_r_rad_s2: Vector3::zeros(),
        };
        let received = self.inputs.reference();
        let goal = match (authority, received) {
            _ if matches!(played, Played::Refused(_)) => Goal::Hold,
            (Authority::Track, Some((stamp, valid_for_s, reference, _))) => {
                Goal::Follow(*stamp, *valid_for_s, reference)
            }
            _ => Goal::Hold,
        };
        let source_stale = received.is_none_or(|(_, _, _, mode)| *mode == AttitudeReference::MODE_HOLD);
        let aim = self.target.step(estimate.stamp, goal, &body);
        let (mode, reason) = match (authority, &played) {
            (_, Played::Refused(reason)) => (ControlStatus::MODE_HOLD, *reason),
            (Authority::Lost(_), _) => (ControlStatus::MODE_HOLD, ControlStatus::REASON_NO_AUTHORITY),
            (Authority::Hold, _) => (ControlStatus::MODE_HOLD, ControlStatus::REASON_NONE),
            _ if aim.stale || source_stale => {
                (ControlStatus::MODE_HOLD, ControlStatus::REASON_REFERENCE_STALE)
            }
            _ => (ControlStatus::MODE_TRACK, ControlStatus::REASON_NONE),
        };

        let wheel_speed = self.inputs.wheel_speed_rad_s();
        let wheel_momentum = self.actuation.wheel_momentum_b_n_m_s(wheel_speed);
        let output = self.law.torque(&TrackingInput {
            q_world_body: &estimate.q_world_body,
            omega_wb_b_rad_s: &estimate.omega_wb_b_rad_s,
            reference: &aim.reference,
            wheel_momentum_b_n_m_s: &wheel_momentum,
            modelled_torque_b_n_m: &(self.modelled_torque(estimate) + self.balancing_torque(estimate)),
            dt_s,
        });
        let effects = self.wheel_effects_n_m(estimate);
        self.actuation.set_wheel_effects(&effects);
        let actuated = match &played {
            Played::Drive(drive) => self.excite(estimate, Some(&output.torque_b_n_m), drive, pulse),
            _ => {
                let failed = self.inputs.jet_failed();
                self.actuation.apply(estimate.stamp, &output.torque_b_n_m, wheel_speed, failed)
            }
        };
        self.law.integrate(dt_s, actuated.alpha > 0.999);

        // After authority was lost: once at rest, let go.
        let still_rad_s = self.parameters.safe_mode.coast_rate_rad_s;
        self.released = matches!(authority, Authority::Lost(_))
            && aim.reference.omega_wr_r_rad_s.norm() < 1e-9
            && estimate.omega_wb_b_rad_s.norm() < still_rad_s;

        self.balance(now, estimate, &wheel_momentum, outputs);
        let asked_b_n_m = output.torque_b_n_m;
        let report = Report { mode, reason, tracking: Some(output), asked_b_n_m, actuated };
        self.finish(now, estimate.stamp, report, outputs);
    }

    fn balancing_torque(&self, estimate: &Estimate) -> Vector3<f64> {
        self.balancing.as_ref().map_or_else(Vector3::zeros, |b| b.torque_b_n_m(estimate))
    }

    fn modelled_torque(&self, estimate: &Estimate) -> Vector3<f64> {
        let model = self.gyrostat.model();
        let mut environment = Environment::new(model, estimate.q_world_body, estimate.omega_wb_b_rad_s);
        if !self.parameters.compensate_effects {
            return -model.mass_properties.gravity_offset_b_n_m().cross(&environment.vertical_b);
        }
        environment.wheel_speed_rad_s = self.inputs.wheel_speed_rad_s();
        self.set_supplies(&mut environment);
        self.gyrostat.modelled_torque_b_n_m(&environment, &[])
    }

    /// Gas and its pressure, by the model.
    fn set_supplies(&self, environment: &mut Environment<'_>) {
        let used_kg = self.actuation.gas_used_kg();
        environment.gas_used_kg = used_kg;
        environment.tank_pressure_pa = self.gyrostat.pressure_pa(self.gyrostat.initial_gas_kg() - used_kg);
    }

    /// Torque of the model's effects on each wheel besides bearing friction, for the motors to counter \[N m\].
    fn wheel_effects_n_m(&self, estimate: &Estimate) -> [f64; MAX_WHEELS] {
        let mut torque_n_m = [0.0; MAX_WHEELS];
        if self.parameters.compensate_effects {
            let model = self.gyrostat.model();
            let mut environment = Environment::new(model, estimate.q_world_body, estimate.omega_wb_b_rad_s);
            environment.wheel_speed_rad_s = self.inputs.wheel_speed_rad_s();
            environment.wheel_motor_torque_n_m = self.actuation.wheel_torque_n_m();
            self.set_supplies(&mut environment);
            if let Some(wheels) = torque_n_m.get_mut(..model.wheels.len()) {
                self.gyrostat.effects().add_wheel_torque_n_m(&environment, wheels);
            }
        }
        torque_n_m
    }

    fn safe(&mut self, now: Timestamp, stamp: Timestamp, authority: Authority, outputs: &mut Outputs) {
        let dt_s = self.step_length_s(now);
        let fault = self.find_fault(now, authority);
        let tracked = self.safe_mode.state() == SafeState::Nominal;
        let gyro = self.inputs.gyro_rate(now, self.parameters.limits.imu_timeout_s);
        let state = self.safe_mode.step(dt_s, fault.is_some(), gyro.as_ref());
        if state == SafeState::Nominal {
            // Recovered, or only a short silence: the next estimate tracks.
            return;
        }
        if tracked {
            self.leave_tracking();
        }
        // The reason stays until tracking resumes, also while recovery is being waited for.
        let reason = fault.or(self.fault).unwrap_or(ControlStatus::REASON_NONE);
        self.fault = Some(reason);
        let (mode, asked_b_n_m, actuated) = match (state, gyro) {
            (SafeState::Damping, Some(omega)) => {
                let torque = self.safe_mode.damping_torque_b_n_m(&self.inertia.resisting_b_kg_m2, &omega);
                let actuated = self.actuation.apply(
                    stamp,
                    &torque,
                    self.inputs.wheel_speed_rad_s(),
                    self.inputs.jet_failed(),
                );
                (ControlStatus::MODE_SAFE_DAMPING, torque, actuated)
            }
            _ => (ControlStatus::MODE_SAFE_COAST, Vector3::zeros(), self.actuation.off()),
        };
        let report = Report { mode, reason, tracking: None, asked_b_n_m, actuated };
        self.finish(now, stamp, report, outputs);
    }

    /// Lets a coordinator find the offset between its clock and this one.
    fn tell_time(&mut self, now: Timestamp, request: &ClockRequest, outputs: &mut Outputs) {
        let header = Header { stamp: now.into(), frame_id: request.header.frame_id.clone() };
        let reply = ClockReply { header, sequence: self.clock_sequence, asked: request.header.stamp };
        self.clock_sequence += 1;
        outputs.publish(Route::platform(self.parameters.platform, Topic::Clock), reply);
    }

    fn step_length_s(&self, now: Timestamp) -> f64 {
        self.latest_step.map_or(0.0, |at| now.seconds_since(at).clamp(0.0, LONGEST_STEP_S))
    }
}

impl NodeCore for LocalControlCore {
    fn subscriptions(&self) -> Vec<Route> {
        let own = [
            Topic::AttitudeEstimate,
            Topic::ImuRaw,
            Topic::WheelState,
            Topic::ThrusterState,
            Topic::AttitudeReference,
            Topic::Excitation,
        ];
        let own = own.map(|topic| Route::platform(self.parameters.platform, topic));
        own.into_iter().chain([Topic::FormationCommand, Topic::FormationClock].map(Route::shared)).collect()
    }

    fn publications(&self) -> Vec<Route> {
        vec![
            Route::platform(self.parameters.platform, Topic::ActuatorCommand),
            Route::platform(self.parameters.platform, Topic::ControlStatus),
            Route::platform(self.parameters.platform, Topic::BallastMoment),
            Route::platform(self.parameters.platform, Topic::Clock),
            Route::shared(Topic::Diagnostics),
        ]
    }

    fn timer_period(&self) -> Option<Duration> {
        Some(self.parameters.timer_period())
    }

    fn step(&mut self, now: Timestamp, event: Event<'_>, outputs: &mut Outputs) {
        match event {
            Event::Message { message, .. } => match message {
                Message::AttitudeEstimate(estimate) => self.on_estimate(now, estimate, outputs),
                Message::Imu(imu) => self.on_imu(now, imu, outputs),
                Message::JointState(wheels) => self.inputs.wheels_arrived(now, wheels),
                Message::ThrusterState(thrusters) => self.inputs.thrusters_arrived(now, thrusters),
                Message::AttitudeReference(reference) => self.inputs.reference_arrived(now, reference),
                Message::Excitation(excitation) => self.inputs.excitation_arrived(now, excitation),
                // Where every platform has a coordinator of its own, a command names whom it is for.
                Message::FormationCommand(command)
                    if !["", self.parameters.name.as_str()].contains(&command.header.frame_id.as_str()) => {}
                Message::FormationCommand(command) => {
                    let max_age_s = self.parameters.limits.max_message_age_s;
                    self.heartbeat.arrived(now, command, max_age_s, self.inputs.refused_mut());
                    self.released = false;
                }
                Message::ClockRequest(request) => self.tell_time(now, request, outputs),
                _ => {}
            },
            Event::Timer => self.on_timer(now, outputs),
            Event::Shutdown => {
                let stamp = self.latest_stamp.unwrap_or_default();
                self.idle(now, stamp, outputs);
            }
            Event::Request { .. } => {}
        }
    }
}

impl Configurable for LocalControlCore {
    type Parameters = Parameters;

    fn reconfigure(&mut self, parameters: &Parameters) -> Result<(), String> {
        if parameters.model != self.parameters.model {
            return Err("the platform's model cannot change while the node runs".into());
        }
        if (parameters.platform, &parameters.name) != (self.parameters.platform, &self.parameters.name) {
            return Err("the platform cannot change while the node runs".into());
        }
        let fresh = Self::new(parameters.clone()).map_err(|error| error.to_string())?;
        let gains_changed = parameters.gains != self.parameters.gains
            || parameters.jet_gains != self.parameters.jet_gains
            || parameters.actuators != self.parameters.actuators;
        if gains_changed {
            let integral = self.law.integral_b_n_m();
            self.law = fresh.law;
            self.law.restore_integral(integral);
        }
        self.actuation = fresh.actuation.continuing(&self.actuation);
        self.safe_mode.reconfigure(&fresh.safe_mode);
        self.safe_envelope = fresh.safe_envelope;
        self.target.reconfigure(fresh.target);
        self.excitations.reconfigure(fresh.excitations);
        self.inputs.set_max_age(parameters.limits.max_message_age_s);
        self.parameters = parameters.clone();
        Ok(())
    }
}
