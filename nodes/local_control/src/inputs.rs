//! Inputs from the subscriptions: the latest valid message of each kind, and how many
//! were refused.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_control::Reference;
use whorl_dynamics::actuators::{ActuatorKind, Actuators, Joints, KINDS, Kind, MotorChannel};
use whorl_msgs::sensor_msgs::{BatteryState, Imu, JointState};
use whorl_msgs::std_msgs::Header;
use whorl_msgs::whorl::{AttitudeEstimate, AttitudeReference, Excitation, GateState, ThrusterState};
use whorl_node::Timestamp;

/// Equal consecutive gyro samples that count as a frozen sensor: with noise, every sample of a
/// working sensor differs.
const FROZEN_SAMPLES: u32 = 10;

/// Longest validity that a reference or an excitation may claim \[s\]. Coordinators renew both fifty times a second.
const LONGEST_VALIDITY_S: f64 = 5.0;

/// How long the driver's gate may be closed although commands are sent \[s\]: three of its messages.
const CLOSED_FOR_S: f64 = 0.3;

/// Counts of messages that were not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Refused {
    /// A value was NaN, infinite, or no rotation.
    pub not_finite: u64,
    /// Not newer than the one before.
    pub out_of_order: u64,
    /// Older than allowed on arrival.
    pub late: u64,
    /// The number of wheels or jets differs from the platform's.
    pub wrong_size: u64,
}

/// Lets a stamp pass only once and only forwards.
#[derive(Debug, Clone, Copy, Default)]
pub struct Order {
    latest: Option<Timestamp>,
}

impl Order {
    /// Whether a message with this stamp may be used. A sender that restarted counts its messages
    /// from zero again; its stamps still grow, so stamps alone decide.
    pub fn admit(
        &mut self,
        header: &Header,
        now: Timestamp,
        max_age_s: f64,
        refused: &mut Refused,
    ) -> Option<Timestamp> {
        let stamp = Timestamp::from(header.stamp);
        let age_s = now.seconds_since(stamp);
        if age_s > max_age_s || age_s < -max_age_s {
            refused.late += 1;
            return None;
        }
        if self.latest.is_some_and(|latest| stamp <= latest) {
            refused.out_of_order += 1;
            return None;
        }
        self.latest = Some(stamp);
        Some(stamp)
    }
}

/// An attitude estimate.
#[derive(Debug, Clone, Copy)]
pub struct Estimate {
    /// Stamp of the measurement.
    pub stamp: Timestamp,
    /// Attitude.
    pub q_world_body: UnitQuaternion<f64>,
    /// Body rate [rad/s].
    pub omega_wb_b_rad_s: Vector3<f64>,
    /// Whether it may be used for control.
    pub usable: bool,
}

/// The latest of everything.
#[derive(Debug, Clone)]
pub struct Inputs {
    estimate: Option<Estimate>,
    estimate_order: Order,
    /// Gyro bias of the latest usable estimate [rad/s].
    gyro_bias_b_rad_s: Vector3<f64>,
    gyro: Option<(Timestamp, Vector3<f64>)>,
    gyro_order: Order,
    equal_samples: u32,
    reference: Option<(Timestamp, f64, Reference, u8)>,
    reference_order: Order,
    /// Stamp, validity after it [s], name, time since its start [s].
    excitation: Option<(Timestamp, f64, String, f64)>,
    excitation_order: Order,
    /// By kind of actuator: how each is measured, and what was measured last.
    channels: [Option<MotorChannel>; KINDS],
    joint_orders: [Order; KINDS],
    joints: [Joints; KINDS],
    thruster_order: Order,
    jet_failed: Vec<bool>,
    battery_order: Order,
    /// Latest bus voltage \[V\].
    bus_voltage_v: Option<f64>,
    gate_order: Order,
    /// Since when the driver's gate has been closed, and when it was said last.
    gate_closed: Option<(Timestamp, Timestamp)>,
    refused: Refused,
    max_age_s: f64,
}

impl Inputs {
    /// Nothing known yet.
    pub fn new(actuators: &Actuators, max_age_s: f64) -> Self {
        let at_rest = |kind: &dyn ActuatorKind| {
            let parts = if kind.channel().is_some() { kind.names().len() } else { 0 };
            Joints { position_rad: vec![0.0; parts], velocity_rad_s: vec![0.0; parts] }
        };
        Self {
            estimate: None,
            estimate_order: Order::default(),
            gyro_bias_b_rad_s: Vector3::zeros(),
            gyro: None,
            gyro_order: Order::default(),
            equal_samples: 0,
            reference: None,
            reference_order: Order::default(),
            excitation: None,
            excitation_order: Order::default(),
            channels: actuators.kinds().map(ActuatorKind::channel),
            joint_orders: [Order::default(); KINDS],
            joints: actuators.kinds().map(at_rest),
            thruster_order: Order::default(),
            jet_failed: vec![false; actuators.jets.list.len()],
            battery_order: Order::default(),
            bus_voltage_v: None,
            gate_order: Order::default(),
            gate_closed: None,
            refused: Refused::default(),
            max_age_s,
        }
    }

    /// Changes the age beyond which messages are refused [s].
    pub fn set_max_age(&mut self, max_age_s: f64) {
        self.max_age_s = max_age_s;
    }

    /// Counts of refused messages.
    pub fn refused(&self) -> Refused {
        self.refused
    }

    /// The counts, for the authority's messages.
    pub fn refused_mut(&mut self) -> &mut Refused {
        &mut self.refused
    }

    /// Takes an estimate; true when it is good and new.
    pub fn estimate_arrived(&mut self, now: Timestamp, message: &AttitudeEstimate) -> bool {
        let omega = Vector3::from(message.omega_wb_b_rad_s);
        let bias = Vector3::from(message.gyro_bias_b_rad_s);
        // An estimator that is not ready may send invalid numbers: only its health is used.
        let q = message.q_world_body.to_unit().filter(|_| finite(&omega) && finite(&bias));
        if message.usable() && q.is_none() {
            self.refused.not_finite += 1;
            return false;
        }
        let admitted = self.estimate_order.admit(&message.header, now, self.max_age_s, &mut self.refused);
        let Some(stamp) = admitted else { return false };
        if message.usable() {
            self.gyro_bias_b_rad_s = bias;
        }
        self.estimate = Some(Estimate {
            stamp,
            q_world_body: q.unwrap_or_else(UnitQuaternion::identity),
            omega_wb_b_rad_s: if finite(&omega) { omega } else { Vector3::zeros() },
            usable: message.usable(),
        });
        true
    }

    /// The latest estimate, whatever its age.
    pub fn estimate(&self) -> Option<&Estimate> {
        self.estimate.as_ref()
    }

    /// Takes a sample of the inertial unit; its stamp when it is good and new.
    pub fn imu_arrived(&mut self, now: Timestamp, message: &Imu) -> Option<Timestamp> {
        let rate = Vector3::from(message.angular_velocity);
        if !finite(&rate) {
            self.refused.not_finite += 1;
            return None;
        }
        let stamp = self.gyro_order.admit(&message.header, now, self.max_age_s, &mut self.refused)?;
        let same = self.gyro.is_some_and(|(_, previous)| previous == rate);
        self.equal_samples = if same { self.equal_samples.saturating_add(1) } else { 0 };
        self.gyro = Some((stamp, rate));
        Some(stamp)
    }

    /// Gyro rate less the last known bias [rad/s]; `None` when stale or frozen.
    pub fn gyro_rate(&self, now: Timestamp, timeout_s: f64) -> Option<Vector3<f64>> {
        let (stamp, rate) = self.gyro?;
        let fresh = now.seconds_since(stamp) <= timeout_s && self.equal_samples < FROZEN_SAMPLES;
        fresh.then(|| rate - self.gyro_bias_b_rad_s)
    }

    /// Takes a reference.
    pub fn reference_arrived(&mut self, now: Timestamp, message: &AttitudeReference) {
        let reference = message.q_world_reference.to_unit().map(|q_world_reference| Reference {
            q_world_reference,
            omega_wr_r_rad_s: message.omega_wr_r_rad_s.into(),
            omega_dot_wr_r_rad_s2: message.omega_dot_wr_r_rad_s2.into(),
        });
        let Some(reference) = reference.filter(Reference::is_finite) else {
            self.refused.not_finite += 1;
            return;
        };
        let admitted = self.reference_order.admit(&message.header, now, self.max_age_s, &mut self.refused);
        let Some(stamp) = admitted else { return };
        let valid_for_s =
            Timestamp::from(message.valid_until).seconds_since(stamp).clamp(0.0, LONGEST_VALIDITY_S);
        self.reference = Some((stamp, valid_for_s, reference, message.mode));
    }

    /// The latest reference: stamp, validity after it [s], value, mode.
    pub fn reference(&self) -> Option<&(Timestamp, f64, Reference, u8)> {
        self.reference.as_ref()
    }

    /// Takes a request to play an excitation.
    pub fn excitation_arrived(&mut self, now: Timestamp, message: &Excitation) {
        if !message.elapsed_s.is_finite() {
            self.refused.not_finite += 1;
            return;
        }
        let admitted = self.excitation_order.admit(&message.header, now, self.max_age_s, &mut self.refused);
        let Some(stamp) = admitted else { return };
        let valid_for_s = Timestamp::from(message.valid_until).seconds_since(stamp).min(LONGEST_VALIDITY_S);
        self.excitation = Some((stamp, valid_for_s, message.name.clone(), message.elapsed_s));
    }

    /// The excitation to play at this instant: name, and time since its start [s].
    pub fn excitation(&self, at: Timestamp) -> Option<(String, f64)> {
        let (stamp, valid_for_s, name, elapsed_s) = self.excitation.as_ref()?;
        let since_s = at.seconds_since(*stamp);
        (since_s < *valid_for_s).then(|| (name.clone(), elapsed_s + since_s))
    }

    /// Takes the joint states that arrived on a topic of the platform.
    pub fn joints_arrived(&mut self, now: Timestamp, topic: &str, message: &JointState) {
        let measured = |channel: &Option<MotorChannel>| channel.is_some_and(|c| c.state_topic == topic);
        let Some(kind) = self.channels.iter().position(measured) else { return };
        let needs_position = self.channels[kind].is_some_and(|channel| channel.needs_position);
        let joints = &mut self.joints[kind];
        let parts = joints.velocity_rad_s.len();
        let position: &[f64] = if needs_position { &message.position } else { &[] };
        if message.velocity.len() != parts || (needs_position && position.len() != parts) {
            self.refused.wrong_size += 1;
        } else if !message.velocity.iter().chain(position).all(|x| x.is_finite()) {
            self.refused.not_finite += 1;
        } else if self.joint_orders[kind]
            .admit(&message.header, now, self.max_age_s, &mut self.refused)
            .is_some()
        {
            joints.velocity_rad_s.copy_from_slice(&message.velocity);
            for (slot, position) in joints.position_rad.iter_mut().zip(position) {
                *slot = *position;
            }
        }
    }

    /// Latest joint states by kind of actuator; zero before the first message.
    pub fn joints(&self) -> &[Joints; KINDS] {
        &self.joints
    }

    /// Latest wheel speeds [rad/s]; zero before the first message.
    pub fn wheel_speed_rad_s(&self) -> &[f64] {
        &self.joints[Kind::Wheels as usize].velocity_rad_s
    }

    /// Takes the health of the jets.
    pub fn thrusters_arrived(&mut self, now: Timestamp, message: &ThrusterState) {
        if message.health.len() != self.jet_failed.len() {
            self.refused.wrong_size += 1;
        } else if self.thruster_order.admit(&message.header, now, self.max_age_s, &mut self.refused).is_some()
        {
            for (failed, health) in self.jet_failed.iter_mut().zip(&message.health) {
                *failed = *health == ThrusterState::HEALTH_FAILED;
            }
        }
    }

    /// Takes the voltage of the power bus.
    pub fn battery_arrived(&mut self, now: Timestamp, message: &BatteryState) {
        let volt = f64::from(message.voltage);
        // Drivers of batteries say NaN for what they do not measure; a bus without voltage runs no computer.
        if !(volt.is_finite() && volt > 0.0) {
            self.refused.not_finite += 1;
        } else if self.battery_order.admit(&message.header, now, self.max_age_s, &mut self.refused).is_some()
        {
            self.bus_voltage_v = Some(volt);
        }
    }

    /// Latest measured bus voltage \[V\], whatever its age: a battery does not recover when its sensor falls silent.
    pub fn bus_voltage_v(&self) -> Option<f64> {
        self.bus_voltage_v
    }

    /// Takes the state of the driver's gate.
    pub fn gate_arrived(&mut self, now: Timestamp, message: &GateState) {
        if self.gate_order.admit(&message.header, now, self.max_age_s, &mut self.refused).is_none() {
            return;
        }
        let since = self.gate_closed.map_or(now, |(since, _)| since);
        self.gate_closed = (message.state == GateState::STATE_OFF).then_some((since, now));
    }

    /// Whether the driver does not carry out what it is commanded: its gate stays closed although commands are sent,
    /// because it refuses them or they do not reach it. A driver that says nothing about its gate is believed.
    pub fn disobeyed(&self, now: Timestamp) -> bool {
        self.gate_closed.is_some_and(|(since, last)| {
            now.seconds_since(since) > CLOSED_FOR_S && now.seconds_since(last) <= CLOSED_FOR_S
        })
    }

    /// Jets that the driver reports as failed.
    pub fn jet_failed(&self) -> &[bool] {
        &self.jet_failed
    }
}

fn finite(v: &Vector3<f64>) -> bool {
    v.iter().all(|x| x.is_finite())
}
