//! Wheels as control sees them: available motor torque, less friction.

use nalgebra::Vector3;

use super::Wheels;
use crate::actuators::{Joints, Motor};

/// Share of its largest speed within which a wheel's torque outwards is tapered to zero.
const SPEED_TAPER_SHARE: f64 = 0.02;
/// Speed below which Coulomb friction is compensated in proportion \[rad/s\]: its sign is noise there.
const COULOMB_SPEED_RAD_S: f64 = 1.0;

impl Wheels {
    /// Commands are motor torques [N m]. Bounds of the net torque on each wheel: motor limit less friction, tapered at
    /// top speed.
    pub(super) fn motors_now(&self, joints: &Joints, effects_n_m: &[f64], motors: &mut [Motor]) {
        for (j, (wheel, motor)) in self.0.iter().zip(motors).enumerate() {
            let speed = joints.velocity(j);
            let coulomb = wheel.coulomb_friction_n_m * (speed / COULOMB_SPEED_RAD_S).clamp(-1.0, 1.0);
            let effects = effects_n_m.get(j).copied().unwrap_or(0.0);
            let friction = wheel.viscous_friction_n_m_s * speed + coulomb - effects;
            let limit = wheel.max_torque_n_m;
            let taper = |distance_rad_s: f64| {
                limit * (distance_rad_s / (SPEED_TAPER_SHARE * wheel.max_speed_rad_s)).clamp(0.0, 1.0)
            };
            // Friction beyond the motor's strength cannot be compensated.
            let friction = friction.clamp(-limit, limit);
            let most = (limit - friction).min(taper(wheel.max_speed_rad_s - speed));
            let least = (-limit - friction).max(-taper(wheel.max_speed_rad_s + speed));
            *motor = Motor {
                // A motor that accelerates its wheel turns the body the other way.
                torque_b: -wheel.spin_axis_b.into_inner(),
                limit,
                min: least.min(most),
                max: most,
                feedforward: friction,
            };
        }
    }

    /// Momentum of the wheels relative to the body, body axes \[N m s\].
    pub(super) fn stored_b_n_m_s(&self, joints: &Joints) -> Vector3<f64> {
        self.0.iter().zip(&joints.velocity_rad_s).fold(Vector3::zeros(), |sum, (wheel, speed)| {
            sum + wheel.spin_axis_b.into_inner() * (wheel.spin_inertia_kg_m2 * speed)
        })
    }
}
