//! Messages of one platform, sorted into channels.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_bag::RecordedMessage;
use whorl_msgs::sensor_msgs::JointState;
use whorl_msgs::whorl::{ControlStatus, ThrusterState};
use whorl_msgs::{Message, geometry_msgs};
use whorl_node::Timestamp;

use super::commands::Sent;
use super::roles::Role;
use crate::Series;

/// 0 degrees Celsius [K]: `sensor_msgs/Temperature` is in Celsius.
const CELSIUS_ZERO_K: f64 = 273.15;
/// Clocks that differ by more are two clocks, and not one and a delay \[ns\].
const OTHER_CLOCK_NS: i64 = 10_000_000_000;

/// Values with their stamps \[ns\], in order of arrival.
pub(super) type Samples<T> = Vec<(i64, T)>;

/// What was gathered, by measurement stamp \[ns\].
#[derive(Debug, Default)]
pub(super) struct Gathered {
    pub gyro: Samples<Vector3<f64>>,
    pub force: Samples<Vector3<f64>>,
    pub vectors: Vec<Samples<Vector3<f64>>>,
    pub references: Vec<Option<Vector3<f64>>>,
    pub wheel_names: Vec<String>,
    pub wheel_speed: Samples<Vec<f64>>,
    pub wheel_effort: Samples<Vec<f64>>,
    pub wheel_command: Samples<Vec<f64>>,
    pub thrusters: Samples<ThrusterState>,
    pub commands: Vec<Sent>,
    pub bus_voltage_v: Samples<f64>,
    pub tank_pressure_pa: Samples<f64>,
    pub temperature_k: Samples<f64>,
    pub body_torque: Samples<Vector3<f64>>,
    pub ballast: Samples<Vector3<f64>>,
    pub true_attitude: Samples<UnitQuaternion<f64>>,
    pub true_rate: Samples<Vector3<f64>>,
    /// Whether any controller said that it was controlling; `None`: none said anything.
    pub controlled: Option<bool>,
    /// Messages of gyro, accelerometer and wheels.
    pub motion_messages: usize,
    /// Values that were not finite, by channel.
    pub not_finite: Vec<(Role, usize)>,
    /// Messages that do not decode.
    pub undecodable: usize,
    /// Joints that are the wheels, in their order; empty: all joints of a message.
    pub wheel_joints: Vec<String>,
    /// The same for commands; empty: as there.
    pub command_joints: Vec<String>,
    /// A wheel that the map names and no message of state, or of commands, has had yet, and what the latest had:
    /// several senders may share a topic.
    pub missing_joints: [Option<(String, String)>; 2],
    /// Whether efforts are measured and say nothing of commands.
    pub efforts_are_measured: bool,
    pub clocks: Option<Clocks>,
}

/// How stamps and log times go together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Clocks {
    One,
    /// Stamps of another clock than log times.
    Two,
    /// Stamps that nobody set.
    LogOnly,
}

impl Gathered {
    pub fn add(&mut self, role: Role, recorded: &RecordedMessage) {
        // By the role's type: a MagneticField is read as the Vector3Stamped that it begins with.
        match Message::decode(role.message_type(), &recorded.cdr) {
            Ok(message) => self.add_message(role, recorded.log_time.0, message),
            Err(_) => self.undecodable += 1,
        }
    }

    fn add_message(&mut self, role: Role, log_ns: i64, message: Message) {
        let stamp_ns = whorl_bag::stamp_of(&message).map_or(log_ns, |stamp| stamp.0);
        let clocks = *self.clocks.get_or_insert_with(|| match stamp_ns {
            0 if log_ns > OTHER_CLOCK_NS => Clocks::LogOnly,
            _ if stamp_ns.abs_diff(log_ns) > OTHER_CLOCK_NS.unsigned_abs() => Clocks::Two,
            _ => Clocks::One,
        });
        let at = if clocks == Clocks::LogOnly { log_ns } else { stamp_ns };
        self.motion_messages += usize::from(role.is_measured_motion());
        match (role, message) {
            (Role::Imu, Message::Imu(m)) => {
                // A first covariance of -1 says that there is none (sensor_msgs/Imu).
                let given = |covariance: &[f64; 9]| covariance.first() != Some(&-1.0);
                if given(&m.angular_velocity_covariance) {
                    let kept = push(&mut self.gyro, at, m.angular_velocity);
                    self.count(role, kept);
                }
                if given(&m.linear_acceleration_covariance) {
                    let kept = push(&mut self.force, at, m.linear_acceleration);
                    self.count(role, kept);
                }
            }
            (Role::Vector(n), Message::Vector3Stamped(m)) => {
                let kept = push(grown(&mut self.vectors, n), at, m.vector);
                self.count(role, kept);
            }
            (Role::VectorReference(n), Message::Vector3Stamped(m)) => {
                *grown(&mut self.references, n) = Some(m.vector.into());
            }
            (Role::WheelState, Message::JointState(m)) => self.wheels(at, m),
            (Role::WheelCommand, Message::JointState(m)) => {
                let own =
                    if self.command_joints.is_empty() { &self.wheel_joints } else { &self.command_joints };
                if self.wheel_command.is_empty() {
                    self.missing_joints[1] = missing(own, &m.name);
                }
                let effort = picked(own, &m.name, m.effort);
                if !effort.is_empty() {
                    let kept = push_list(&mut self.wheel_command, at, effort);
                    self.count(role, kept);
                }
            }
            (Role::Thrusters, Message::ThrusterState(m)) => self.thrusters.push((at, m)),
            (Role::ActuatorCommand, Message::ActuatorCommand(command)) => {
                // It takes effect when it arrives; its stamp is that of the estimate behind it.
                let arrived_ns = if clocks == Clocks::Two { stamp_ns } else { log_ns };
                self.commands.push(Sent { at_ns: arrived_ns, command });
            }
            (Role::ControlStatus, Message::ControlStatus(m)) => {
                let active = matches!(
                    m.mode,
                    ControlStatus::MODE_TRACK | ControlStatus::MODE_HOLD | ControlStatus::MODE_SAFE_DAMPING
                );
                self.controlled = Some(self.controlled.unwrap_or(false) || active);
            }
            (Role::BusVoltage, Message::BatteryState(m)) => {
                let kept = push_scalar(&mut self.bus_voltage_v, at, f64::from(m.voltage));
                self.count(role, kept);
            }
            (Role::TankPressure, Message::FluidPressure(m)) => {
                let kept = push_scalar(&mut self.tank_pressure_pa, at, m.fluid_pressure);
                self.count(role, kept);
            }
            (Role::Temperature, Message::Temperature(m)) => {
                let kept = push_scalar(&mut self.temperature_k, at, m.temperature + CELSIUS_ZERO_K);
                self.count(role, kept);
            }
            (Role::BodyTorque, Message::Vector3Stamped(m)) => {
                let kept = push(&mut self.body_torque, at, m.vector);
                self.count(role, kept);
            }
            (Role::BallastMoment, Message::Vector3Stamped(m)) => {
                let kept = push(&mut self.ballast, at, m.vector);
                self.count(role, kept);
            }
            (Role::Truth, Message::AttitudeEstimate(m)) => {
                if let Some(q) = m.q_world_body.to_unit() {
                    self.true_attitude.push((at, q));
                }
                push(&mut self.true_rate, at, m.omega_wb_b_rad_s);
            }
            // The reader takes only topics whose type is the role's.
            _ => self.undecodable += 1,
        }
    }

    fn wheels(&mut self, at: i64, mut m: JointState) {
        if self.wheel_speed.is_empty() {
            self.missing_joints[0] = missing(&self.wheel_joints, &m.name);
        }
        m.velocity = picked(&self.wheel_joints, &m.name, m.velocity);
        m.effort = if self.efforts_are_measured {
            Vec::new()
        } else {
            picked(&self.wheel_joints, &m.name, m.effort)
        };
        if !self.wheel_joints.is_empty() {
            m.name.clone_from(&self.wheel_joints);
        }
        if self.wheel_names.is_empty() {
            self.wheel_names = m.name;
        }
        if !m.velocity.is_empty() {
            let kept = push_list(&mut self.wheel_speed, at, m.velocity);
            self.count(Role::WheelState, kept);
        }
        if !m.effort.is_empty() {
            push_list(&mut self.wheel_effort, at, m.effort);
        }
    }

    fn count(&mut self, role: Role, kept: bool) {
        if kept {
            return;
        }
        match self.not_finite.iter_mut().find(|(known, _)| *known == role) {
            Some((_, count)) => *count += 1,
            None => self.not_finite.push((role, 1)),
        }
    }

    /// The earliest stamp of all.
    pub fn first_stamp(&self) -> Option<Timestamp> {
        let first = |times: &mut dyn Iterator<Item = i64>| times.min();
        [
            first(&mut self.gyro.iter().map(|s| s.0)),
            first(&mut self.force.iter().map(|s| s.0)),
            first(&mut self.vectors.iter().flatten().map(|s| s.0)),
            first(&mut self.wheel_speed.iter().map(|s| s.0)),
            first(&mut self.wheel_effort.iter().map(|s| s.0)),
            first(&mut self.wheel_command.iter().map(|s| s.0)),
            first(&mut self.thrusters.iter().map(|s| s.0)),
            first(&mut self.bus_voltage_v.iter().map(|s| s.0)),
            first(&mut self.tank_pressure_pa.iter().map(|s| s.0)),
            first(&mut self.temperature_k.iter().map(|s| s.0)),
            first(&mut self.body_torque.iter().map(|s| s.0)),
            first(&mut self.ballast.iter().map(|s| s.0)),
            first(&mut self.true_attitude.iter().map(|s| s.0)),
        ]
        .into_iter()
        .flatten()
        .min()
        .map(Timestamp)
    }

    /// Whether log times are of the clock of the stamps.
    pub fn one_clock(&self) -> bool {
        self.clocks == Some(Clocks::One)
    }
}

/// In order of their stamps, each stamp once; returns how many were left out as doubles.
pub(super) fn in_order<T>(samples: &mut Samples<T>) -> usize {
    let before = samples.len();
    samples.sort_by_key(|(at, _)| *at);
    samples.dedup_by_key(|(at, _)| *at);
    before - samples.len()
}

/// As a series over seconds since `start`.
pub(super) fn series<T>(samples: Samples<T>, start: Timestamp) -> Series<T> {
    samples.into_iter().map(|(at, value)| (crate::series::seconds(at - start.0), value)).collect()
}

fn push(samples: &mut Samples<Vector3<f64>>, at: i64, v: geometry_msgs::Vector3) -> bool {
    let v = Vector3::from(v);
    let finite = v.iter().copied().all(f64::is_finite);
    if finite {
        samples.push((at, v));
    }
    finite
}

fn push_list(samples: &mut Samples<Vec<f64>>, at: i64, values: Vec<f64>) -> bool {
    // Lists of one length: the first says which.
    let fits = samples.first().is_none_or(|(_, first)| first.len() == values.len());
    let finite = fits && values.iter().copied().all(f64::is_finite);
    if finite {
        samples.push((at, values));
    }
    finite
}

fn push_scalar(samples: &mut Samples<f64>, at: i64, value: f64) -> bool {
    if value.is_finite() {
        samples.push((at, value));
    }
    value.is_finite()
}

/// The element at `index`, with empty ones before it if need be.
fn grown<T: Default>(list: &mut Vec<T>, index: usize) -> &mut T {
    while list.len() <= index {
        list.push(T::default());
    }
    #[expect(clippy::indexing_slicing, reason = "made so long above")]
    &mut list[index]
}

/// The first of these joints that a message does not have, with those that it has.
fn missing(joints: &[String], names: &[String]) -> Option<(String, String)> {
    let joint = joints.iter().find(|joint| !names.contains(joint))?;
    Some((joint.clone(), names.join(", ")))
}

/// The wheels' part of a message about many joints; empty where one of them is missing.
fn picked(joints: &[String], names: &[String], values: Vec<f64>) -> Vec<f64> {
    if joints.is_empty() {
        return values;
    }
    let place = |joint: &String| names.iter().position(|name| name == joint);
    let value = |joint: &String| place(joint).and_then(|place| values.get(place)).copied();
    joints.iter().map(value).collect::<Option<_>>().unwrap_or_default()
}
