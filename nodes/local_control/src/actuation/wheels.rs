//! Wheels: what their motors can give, and what friction takes of it.

use nalgebra::Vector3;

use super::Actuation;

/// Share of its largest speed within which a wheel's torque outwards is tapered to zero.
const SPEED_TAPER_SHARE: f64 = 0.02;
/// Speed below which Coulomb friction is compensated in proportion \[rad/s\]: its sign is noise there.
const COULOMB_SPEED_RAD_S: f64 = 1.0;

impl Actuation {
    /// Bounds of the net torque on each wheel: motor limit less friction, tapered at top speed.
    pub(super) fn set_wheel_bounds(&mut self, wheel_speed_rad_s: &[f64]) {
        for (j, wheel) in self.wheels.iter().enumerate() {
            let speed = wheel_speed_rad_s.get(j).copied().unwrap_or(0.0);
            let coulomb = wheel.coulomb_friction_n_m * (speed / COULOMB_SPEED_RAD_S).clamp(-1.0, 1.0);
            let effects = self.wheel_effects_n_m.get(j).copied().unwrap_or(0.0);
            let friction = wheel.viscous_friction_n_m_s * speed + coulomb - effects;
            let limit = wheel.max_torque_n_m;
            let taper = |distance_rad_s: f64| {
                limit * (distance_rad_s / (SPEED_TAPER_SHARE * wheel.max_speed_rad_s)).clamp(0.0, 1.0)
            };
            // Friction beyond the motor's strength cannot be compensated.
            let friction = friction.clamp(-limit, limit);
            let most = (limit - friction).min(taper(wheel.max_speed_rad_s - speed));
            let least = (-limit - friction).max(-taper(wheel.max_speed_rad_s + speed));
            let slot = |values: &mut Vec<f64>, value: f64| {
                if let Some(slot) = values.get_mut(j) {
                    *slot = value;
                }
            };
            slot(&mut self.friction_n_m, friction);
            slot(&mut self.demand.wheel_motor_torque_max_n_m, most);
            slot(&mut self.demand.wheel_motor_torque_min_n_m, least.min(most));
        }
    }

    /// Torque of the model's effects on each wheel \[N m\], which the motors counter from now on.
    pub fn set_wheel_effects(&mut self, torque_n_m: &[f64]) {
        for (slot, torque) in self.wheel_effects_n_m.iter_mut().zip(torque_n_m) {
            *slot = *torque;
        }
    }

    /// Motor torque of each wheel \[N m\].
    pub fn wheel_torque_n_m(&self) -> &[f64] {
        &self.wheel_torque_n_m
    }

    /// Momentum of the wheels relative to the body, body axes \[N m s\].
    pub fn wheel_momentum_b_n_m_s(&self, wheel_speed_rad_s: &[f64]) -> Vector3<f64> {
        self.wheels.iter().zip(wheel_speed_rad_s).fold(Vector3::zeros(), |sum, (wheel, speed)| {
            sum + wheel.spin_axis_b.into_inner() * (wheel.spin_inertia_kg_m2 * speed)
        })
    }
}
