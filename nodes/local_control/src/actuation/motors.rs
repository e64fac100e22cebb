//! Motors of every kind: their bounds and commands.

use nalgebra::Vector3;
use whorl_dynamics::actuators::{Joints, KINDS, Kind};

use super::Actuation;

impl Actuation {
    /// Bounds, torque and feed-forward of every motor in its current state.
    pub(super) fn set_motors(&mut self, joints: &[Joints; KINDS]) {
        self.actuators.motors(joints, &self.effects, &mut self.motors);
        self.actuators.prefer(joints, &mut self.preferred);
        let bounds = self.demand.motor_min.iter_mut().zip(&mut self.demand.motor_max);
        for (j, (motor, (min, max))) in self.motors.iter().zip(bounds).enumerate() {
            self.allocator.set_motor_torque(j, &motor.torque_b);
            *min = motor.min;
            *max = motor.max;
        }
    }

    /// Gives every motor its net command plus compensation of friction and effects.
    pub(super) fn tell_motors(&mut self, net: &[f64]) {
        for ((command, net), motor) in self.command.iter_mut().zip(net).zip(&self.motors) {
            *command = net + motor.feedforward;
        }
    }

    /// Torque of the model's effects on each wheel \[N m\], which the motors counter from now on.
    pub fn set_wheel_effects(&mut self, torque_n_m: &[f64]) {
        let wheels = self.ranges[Kind::Wheels as usize].clone();
        for (slot, torque) in self.effects.iter_mut().skip(wheels.start).take(wheels.len()).zip(torque_n_m) {
            *slot = *torque;
        }
    }

    /// Commands of the motors of one kind, in the unit of its commands.
    pub fn commands(&self, kind: usize) -> &[f64] {
        self.ranges.get(kind).and_then(|range| self.command.get(range.clone())).unwrap_or(&[])
    }

    /// Momentum of all moving parts relative to the body, body axes \[N m s\].
    pub fn stored_momentum_b_n_m_s(&self, joints: &[Joints; KINDS]) -> Vector3<f64> {
        self.actuators.momentum_b_n_m_s(joints)
    }
}
