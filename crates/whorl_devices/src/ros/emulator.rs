//! Nodes of other people as they look from their topics.

use nalgebra::UnitQuaternion;
use whorl_dynamics::actuators::Kind;
use whorl_msgs::builtin_interfaces::Time;
use whorl_msgs::geometry_msgs::PoseStamped;
use whorl_msgs::sensor_msgs::{Imu, JointState, MagneticField};
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::{Message, MessageType};
use whorl_node::Timestamp;

use super::direction::{RosDirection, Source};
use super::imu::RosImu;
use super::motors::RosMotors;
use super::valves::RosValves;
use crate::emulation::{Emulator, TopicEmulator, World};

/// The field at the laboratory \[T\]; its direction is that of the model's vector sensor.
const FIELD_T: f64 = 5e-5;
/// A motor's or valve's node switches off so long after the last message \[ns\]; assumed.
const WATCHDOG_NS: i64 = 200_000_000;

fn header(at_ns: i64) -> Header {
    Header { stamp: Time::from(Timestamp(at_ns)), frame_id: "emulated".to_owned() }
}

/// What is published at a fixed rate.
struct Publisher<F> {
    period_ns: i64,
    next_ns: Option<i64>,
    sample: F,
}

impl<F: FnMut(i64, &mut World) -> Option<Message> + Send> TopicEmulator for Publisher<F> {
    fn message(&mut self, _: i64, _: &Message, _: &mut World) {}

    fn due_ns(&self) -> Option<i64> {
        Some(self.next_ns.unwrap_or(i64::MIN))
    }

    fn act(&mut self, now_ns: i64, world: &mut World) -> Option<(i64, Message)> {
        // Begins when it is first asked.
        let at_ns = self.next_ns.unwrap_or(now_ns);
        self.next_ns = Some(at_ns + self.period_ns);
        world.advance_to(at_ns);
        Some((at_ns, (self.sample)(at_ns, world)?))
    }
}

fn publisher(
    topic: &str,
    message_type: MessageType,
    rate_hz: f64,
    sample: impl FnMut(i64, &mut World) -> Option<Message> + Send + 'static,
) -> Emulator {
    let device = Publisher { period_ns: (1e9 / rate_hz) as i64, next_ns: None, sample };
    Emulator::Topics { read: None, write: Some((topic.to_owned(), message_type)), device: Box::new(device) }
}

pub(super) fn imu(imu: &RosImu) -> Emulator {
    let q_sensor_body = imu.q_body_sensor.inverse();
    publisher(&imu.topic, MessageType::Imu, imu.rate_hz * f64::from(imu.mean_of), move |at_ns, world| {
        let sample = world.plant.sample_imu();
        world.sampled_ns = Some(at_ns);
        let mut message = Imu {
            header: header(at_ns),
            angular_velocity: (q_sensor_body * sample.angular_velocity_rad_s).into(),
            linear_acceleration: (q_sensor_body * sample.specific_force_m_s2).into(),
            ..Imu::default()
        };
        message.orientation_covariance[0] = -1.0;
        Some(message.into())
    })
}

pub(super) fn direction(direction: &RosDirection) -> Emulator {
    let RosDirection { topic, source, period_s, .. } = direction;
    let message_type = source.message_type();
    match source.clone() {
        Source::Field { q_body_sensor } => {
            publisher(topic, message_type, 1.0 / period_s, move |at_ns, world| {
                let direction_b = world.plant.sample_vector()?.direction.into_inner();
                let field = q_body_sensor.inverse() * direction_b * FIELD_T;
                let magnetic_field = field.into();
                let header = header(at_ns);
                Some(MagneticField { header, magnetic_field, ..MagneticField::default() }.into())
            })
        }
        // Without noise: a tracker's is small against that of other sensors.
        Source::Pose { q_body_tracked, q_world_tracker, .. } => {
            publisher(topic, message_type, 1.0 / period_s, move |at_ns, world| {
                let q_world_body = world.plant.truth().q_world_body;
                let q: UnitQuaternion<f64> = q_world_tracker.inverse() * q_world_body * q_body_tracked;
                let mut message = PoseStamped { header: header(at_ns), ..PoseStamped::default() };
                message.pose.orientation = q.into();
                Some(message.into())
            })
        }
    }
}

/// Reads the states of motors in a world.
type ReadStates = Box<dyn FnMut(i64, &mut World) -> Option<Message> + Send>;

/// A controller of motors.
struct Controller {
    motors: RosMotors,
    states: Publisher<ReadStates>,
    off_ns: Option<i64>,
}

impl Controller {
    fn drive(&self, values: &[f64], world: &mut World) {
        for (place, motor) in self.motors.motors.iter().enumerate() {
            let value = values.get(place).copied().filter(|value| value.is_finite()).unwrap_or(0.0);
            let wired = if self.motors.kind == Kind::Wheels { world.sign_of_wheel(motor.index) } else { 1.0 };
            world.set_motor(self.motors.kind, motor.index, value * motor.sign * wired);
        }
    }
}

pub(super) fn motors(motors: &RosMotors) -> Emulator {
    let own = motors.clone();
    let sample = move |at_ns: i64, world: &mut World| {
        let joints = world.plant.sample_joints(own.kind);
        let mut message = JointState { header: header(at_ns), ..JointState::default() };
        for motor in &own.motors {
            let wired = if own.kind == Kind::Wheels { world.sign_of_wheel(motor.index) } else { 1.0 };
            let sign = motor.sign * wired;
            message.name.push(motor.joint.clone());
            message.position.push(sign * joints.position_rad.get(motor.index).copied().unwrap_or(0.0));
            message.velocity.push(sign * joints.velocity_rad_s.get(motor.index).copied().unwrap_or(0.0));
            message.effort.push(sign * joints.effort_n_m.get(motor.index).copied().unwrap_or(0.0));
        }
        Some(message.into())
    };
    let period_ns = (1e9 / motors.rate_hz) as i64;
    let states = Publisher { period_ns, next_ns: None, sample: Box::new(sample) as Box<_> };
    Emulator::Topics {
        read: Some((motors.command.clone(), MessageType::Float64MultiArray)),
        write: Some((motors.state.clone(), MessageType::JointState)),
        device: Box::new(Controller { motors: motors.clone(), states, off_ns: None }),
    }
}

impl TopicEmulator for Controller {
    fn message(&mut self, at_ns: i64, message: &Message, world: &mut World) {
        let Message::Float64MultiArray(command) = message else { return };
        self.off_ns = Some(at_ns + WATCHDOG_NS);
        world.advance_to(at_ns);
        self.drive(&command.data, world);
        if self.motors.kind == Kind::Wheels {
            world.torque_arrived(at_ns);
        }
    }

    fn due_ns(&self) -> Option<i64> {
        [self.states.due_ns(), self.off_ns].into_iter().flatten().min()
    }

    fn act(&mut self, now_ns: i64, world: &mut World) -> Option<(i64, Message)> {
        if self.off_ns.is_some_and(|at| at <= now_ns) {
            self.off_ns = None;
            world.advance_to(now_ns);
            self.drive(&[], world);
        }
        let is_due = self.states.due_ns().is_some_and(|due| due <= now_ns);
        if is_due { self.states.act(now_ns, world) } else { None }
    }
}

/// A node of valves.
struct Node {
    valves: RosValves,
    closes_ns: Option<i64>,
}

impl Node {
    fn switch(&self, at_ns: i64, data: &[u8], world: &mut World) {
        world.advance_to(at_ns);
        for (place, element) in self.valves.elements.iter().enumerate() {
            let open = data.get(place).is_some_and(|value| *value != 0);
            world.set_valve(world.jet_on_wire(element.jet), open, at_ns);
        }
    }
}

pub(super) fn valves(valves: &RosValves) -> Emulator {
    Emulator::Topics {
        read: Some((valves.command.clone(), MessageType::UInt8MultiArray)),
        write: None,
        device: Box::new(Node { valves: valves.clone(), closes_ns: None }),
    }
}

impl TopicEmulator for Node {
    fn message(&mut self, at_ns: i64, message: &Message, world: &mut World) {
        let Message::UInt8MultiArray(command) = message else { return };
        self.closes_ns = Some(at_ns + WATCHDOG_NS);
        self.switch(at_ns, &command.data, world);
    }

    fn due_ns(&self) -> Option<i64> {
        self.closes_ns
    }

    fn act(&mut self, now_ns: i64, world: &mut World) -> Option<(i64, Message)> {
        if self.closes_ns.is_some_and(|at| at <= now_ns) {
            self.closes_ns = None;
            self.switch(now_ns, &[], world);
        }
        None
    }
}
