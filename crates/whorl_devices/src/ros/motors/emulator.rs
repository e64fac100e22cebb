//! A controller of motors as it looks from its topics.

use whorl_dynamics::actuators::Kind;
use whorl_msgs::sensor_msgs::JointState;
use whorl_msgs::topics::{Message, MessageType};

use super::RosMotors;
use crate::emulation::{Emulator, TopicEmulator, World};
use crate::ros::emulator::{Publisher, WATCHDOG_NS, header};

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
