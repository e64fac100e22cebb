//! Momentum stored in what moves on the platform, from the states of its joints.

use nalgebra::Vector3;
use whorl_dynamics::actuators::{ActuatorKind, Actuators, Joints};
use whorl_msgs::sensor_msgs::JointState;
use whorl_msgs::topics::Topic;

/// What each kind of actuator with motors stores, as last measured.
#[derive(Debug)]
pub struct Stored {
    kinds: Vec<OfKind>,
}

#[derive(Debug)]
struct OfKind {
    /// Its place in the table of kinds.
    kind: usize,
    topic: Topic,
    needs_position: bool,
    parts: usize,
    /// Body axes [N m s].
    momentum_b_n_m_s: Vector3<f64>,
    /// Body axes [N m].
    rate_b_n_m: Vector3<f64>,
}

impl Stored {
    /// At rest.
    pub fn new(actuators: &Actuators) -> Self {
        let of_kind = |(kind, of): (usize, &dyn ActuatorKind)| {
            let channel = of.channel()?;
            Some(OfKind {
                kind,
                topic: Topic::find(channel.state_topic, true)?,
                needs_position: channel.needs_position,
                parts: of.names().len(),
                momentum_b_n_m_s: Vector3::zeros(),
                rate_b_n_m: Vector3::zeros(),
            })
        };
        let kinds = actuators.kinds().into_iter().enumerate().filter_map(of_kind);
        Self { kinds: kinds.filter(|of| of.parts > 0).collect() }
    }

    /// The topics on which the states of joints arrive.
    pub fn topics(&self) -> impl Iterator<Item = Topic> {
        self.kinds.iter().map(|of| of.topic)
    }

    /// Takes the states of one kind's joints: momentum of all kinds relative to the body [N m s] and its rate [N m],
    /// body axes. `None` when the message is not about these actuators.
    pub fn arrived(
        &mut self,
        actuators: &Actuators,
        topic: Topic,
        state: &JointState,
    ) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let of = self.kinds.iter_mut().find(|of| of.topic == topic)?;
        if state.velocity.len() != of.parts || (of.needs_position && state.position.len() != of.parts) {
            return None;
        }
        let kind = *actuators.kinds().get(of.kind)?;
        let joints = Joints { position_rad: state.position.clone(), velocity_rad_s: state.velocity.clone() };
        of.momentum_b_n_m_s = kind.momentum_b_n_m_s(&joints);
        of.rate_b_n_m = kind.momentum_rate_b_n_m(&joints, &state.effort);
        let sum = |part: fn(&OfKind) -> Vector3<f64>| self.kinds.iter().map(part).sum();
        Some((sum(|of| of.momentum_b_n_m_s), sum(|of| of.rate_b_n_m)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_dynamics::PlatformModel;

    /// Three wheels of 0.02 kg m^2 along the body axes, by hand.
    #[test]
    fn wheels_store_inertia_times_speed_and_change_it_by_their_torque() {
        let mut actuators = PlatformModel::whorl_1_reference().actuators;
        for (wheel, axis) in actuators.wheels.0.iter_mut().zip([Vector3::x(), Vector3::y(), Vector3::z()]) {
            wheel.spin_axis_b = nalgebra::Unit::new_normalize(axis);
            wheel.spin_inertia_kg_m2 = 0.02;
        }
        let mut stored = Stored::new(&actuators);
        assert_eq!(stored.topics().collect::<Vec<_>>(), [Topic::WheelState]);
        let state = JointState {
            velocity: vec![100.0, -50.0, 0.0],
            effort: vec![0.0, 0.1, -0.2],
            ..JointState::default()
        };
        let (momentum, rate) = stored.arrived(&actuators, Topic::WheelState, &state).unwrap();
        assert!((momentum - Vector3::new(2.0, -1.0, 0.0)).norm() < 1e-12, "{momentum}");
        assert!((rate - Vector3::new(0.0, 0.1, -0.2)).norm() < 1e-12, "{rate}");
    }

    #[test]
    fn messages_about_other_joints_are_left_alone() {
        let actuators = PlatformModel::whorl_1_reference().actuators;
        let mut stored = Stored::new(&actuators);
        let two = JointState { velocity: vec![1.0; 2], ..JointState::default() };
        assert_eq!(stored.arrived(&actuators, Topic::WheelState, &two), None);
        let three = JointState { velocity: vec![1.0; 3], ..JointState::default() };
        assert_eq!(stored.arrived(&actuators, Topic::ImuRaw, &three), None);
    }
}
