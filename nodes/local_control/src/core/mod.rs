//! The state machine.

mod feedforward;
mod safety;
mod tracking;

use std::time::Duration;

use thiserror::Error;
use whorl_control::mass_balancing::BalancingError;
use whorl_control::reference::{EnvelopeError, TiltEnvelope};
use whorl_control::safe_mode::{SafeMode, SafeModeError, SafeState};
use whorl_control::tracking::{TrackingError, TrackingLaw};
use whorl_dynamics::actuators::{ActuatorKind, Actuators};
use whorl_dynamics::effects::find;
use whorl_dynamics::{Gyrostat, GyrostatError};
use whorl_msgs::sensor_msgs::Imu;
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::{Message, Route, Topic};
use whorl_msgs::whorl::{AttitudeEstimate, ClockReply, ClockRequest, ControlStatus};
use whorl_node::{Configurable, Event, NodeCore, Outputs, SECURED_STALL, Timestamp};

use crate::actuation::{Actuation, ActuationError};
use crate::authority::{Authority, Heartbeat};
use crate::balancing::Balancing;
use crate::excitation::Excitations;
use crate::inputs::Inputs;
use crate::parameters::Parameters;
use crate::target::Target;

/// Upper limit of the time step [s].
const LONGEST_STEP_S: f64 = 0.1;

/// Why local control cannot start.
#[derive(Debug, Error)]
pub enum LocalControlError {
    /// The model is physically impossible.
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
    /// Reason of the current safe mode.
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
    /// How long messages of this platform's own nodes may be late beyond their parameters \[s\].
    pub(crate) stall_s: f64,
}

impl LocalControlCore {
    /// Local control as the parameters say.
    ///
    /// # Errors
    /// [`LocalControlError`] when model, gains, limits or actuators are not usable.
    pub fn new(parameters: Parameters) -> Result<Self, LocalControlError> {
        let mut model = parameters.model.clone();
        // Unknown effect names are refused by `Gyrostat`.
        model.effects.retain(|id, _| find(id).is_none_or(|effect| effect.is_fed_forward(&parameters.model)));
        let gyrostat = Gyrostat::new(&model)?;
        let adjusted = gyrostat.model();
        let inertia_b_kg_m2 = *adjusted.mass_properties.inertia_b_kg_m2();
        let limits = &parameters.limits;
        let gains = if parameters.actuators == whorl_allocation::Mode::Jets {
            parameters.jet_gains
        } else {
            parameters.gains
        };
        let envelope = TiltEnvelope::new(adjusted.tilt_limit, limits.reference_tilt_margin_rad)?;
        Ok(Self {
            law: TrackingLaw::new(inertia_b_kg_m2, &adjusted.actuators, gains)?,
            safe_mode: SafeMode::new(parameters.safe_mode)?,
            safe_envelope: TiltEnvelope::new(adjusted.tilt_limit, limits.safe_tilt_margin_rad)?,
            target: Target::new(parameters.rejoin, limits.deceleration_rad_s2, envelope),
            actuation: Actuation::new(&parameters, &gyrostat)?,
            excitations: Excitations::new(envelope, limits.max_rate_rad_s),
            balancing: parameters.balancing.map(|b| Balancing::new(b, &gyrostat)).transpose()?,
            inputs: Inputs::new(&adjusted.actuators, limits.max_message_age_s),
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
            stall_s: 0.0,
            gyrostat,
            parameters,
        })
    }

    /// The same where traffic is secured, or not: commands hold, and estimates and samples are fresh, for one stall of the DDS library
    /// longer ([`SECURED_STALL`]).
    #[must_use]
    pub fn secured(self, secured: bool) -> Self {
        Self { stall_s: if secured { SECURED_STALL.as_secs_f64() } else { 0.0 }, ..self }
    }

    /// The parameters in force.
    #[must_use]
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
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
            // A command must not be stamped later than the next measurements.
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

/// Topics of the joint states of every kind of actuator that has motors.
fn joint_topics() -> impl Iterator<Item = Topic> {
    let channels = Actuators::default().kinds().map(ActuatorKind::channel);
    channels.into_iter().flatten().filter_map(|channel| Topic::find(channel.state_topic, true))
}

impl NodeCore for LocalControlCore {
    fn subscriptions(&self) -> Vec<Route> {
        let own = [
            Topic::AttitudeEstimate,
            Topic::ImuRaw,
            Topic::ThrusterState,
            Topic::Battery,
            Topic::GateState,
            Topic::AttitudeReference,
            Topic::Excitation,
        ];
        let own = own.map(|topic| Route::platform(self.parameters.platform, topic));
        let states = joint_topics().map(|topic| Route::platform(self.parameters.platform, topic));
        own.into_iter()
            .chain(states)
            .chain([Topic::FormationCommand, Topic::FormationClock].map(Route::shared))
            .collect()
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
            Event::Message { route, message } => match message {
                Message::AttitudeEstimate(estimate) => self.on_estimate(now, estimate, outputs),
                Message::Imu(imu) => self.on_imu(now, imu, outputs),
                Message::JointState(joints) => {
                    self.inputs.joints_arrived(now, route.topic.info().name, joints);
                }
                Message::ThrusterState(thrusters) => self.inputs.thrusters_arrived(now, thrusters),
                Message::BatteryState(battery) => self.inputs.battery_arrived(now, battery),
                Message::GateState(state) => self.inputs.gate_arrived(now, state),
                Message::AttitudeReference(reference) => self.inputs.reference_arrived(now, reference),
                Message::Excitation(excitation) => self.inputs.excitation_arrived(now, excitation),
                // If every platform has its own coordinator, a command names the platform it is for.
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
            Event::Shutdown | Event::Interruption => {
                let stamp = self.latest_stamp.unwrap_or_default();
                self.idle(now, stamp, outputs);
            }
            Event::Request { .. } | Event::Woken => {}
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
