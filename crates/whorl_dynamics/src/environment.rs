//! Inputs of a physical effect at one instant.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_math::{GRAVITY_M_S2, azimuth_rad, vertical_b};

use crate::PlatformModel;
use crate::actuators::wheels::available_motor_torque_n_m;
use crate::effects::Touching;

/// The state of a platform and its surroundings at one instant, as effects see it.
///
/// Filled by the truth plant from its state, and by estimator, controller and diagnosis from
/// measurements and commands; slices may be shorter than the platform has wheels or jets, what is
/// missing counts as zero.
#[derive(Debug, Clone, Copy)]
pub struct Environment<'a> {
    /// The platform, effects that correct its constants already applied.
    pub model: &'a PlatformModel,
    /// Time since the start of the run \[s\].
    pub time_s: f64,
    /// Attitude, v_world = q v_body.
    pub q_world_body: UnitQuaternion<f64>,
    /// The vertical (world z) in body axes, k_b = R^T k.
    pub vertical_b: Vector3<f64>,
    /// Rate of the body seen from the world, body axes [rad/s].
    pub omega_wb_b_rad_s: Vector3<f64>,
    /// Its derivative [rad/s^2]. Known only in [`crate::Effect::hidden_derivative`] and
    /// [`crate::Effect::measure_imu`]; zero where torques are being summed, because it follows from them.
    pub omega_dot_wb_b_rad_s2: Vector3<f64>,
    /// Wheel speeds relative to the body [rad/s].
    pub wheel_speed_rad_s: &'a [f64],
    /// Torques the wheel motors make [N m], friction not included.
    pub wheel_motor_torque_n_m: &'a [f64],
    /// Gimbal angles of control moment gyros \[rad\].
    pub gimbal_angle_rad: &'a [f64],
    /// Gimbal rates [rad/s].
    pub gimbal_rate_rad_s: &'a [f64],
    /// Gimbal accelerations [rad/s^2]. Known only from measurements of the gimbals' motion.
    pub gimbal_acceleration_rad_s2: &'a [f64],
    /// Share of each valve's flow that passes now, 0..1.
    pub valve_fraction: &'a [f64],
    /// Tank pressure \[Pa\].
    pub tank_pressure_pa: f64,
    /// Gas used since the tank was as the model has it \[kg\].
    pub gas_used_kg: f64,
    /// Bus voltage \[V\].
    pub bus_voltage_v: f64,
    /// Temperature of the platform \[K\].
    pub temperature_k: f64,
    /// Sense of the last travel of the linear mass actuators along body x, y, z: -1, 0 (never moved), 1.
    pub ballast_direction: Vector3<f64>,
    /// Which branch of a contact's law holds; integrators set it.
    pub touching: Touching,
}

impl<'a> Environment<'a> {
    /// A platform in this attitude and motion with wheels stopped, valves shut, a full tank and a
    /// full battery, at the start of a run.
    #[must_use]
    #[inline]
    pub fn new(
        model: &'a PlatformModel,
        q_world_body: UnitQuaternion<f64>,
        omega_wb_b_rad_s: Vector3<f64>,
    ) -> Self {
        Self {
            model,
            time_s: 0.0,
            q_world_body,
            vertical_b: vertical_b(&q_world_body),
            omega_wb_b_rad_s,
            omega_dot_wb_b_rad_s2: Vector3::zeros(),
            wheel_speed_rad_s: &[],
            wheel_motor_torque_n_m: &[],
            gimbal_angle_rad: &[],
            gimbal_rate_rad_s: &[],
            gimbal_acceleration_rad_s2: &[],
            valve_fraction: &[],
            tank_pressure_pa: model.tank().initial_pressure_pa,
            gas_used_kg: 0.0,
            bus_voltage_v: model.bus.initial_v,
            temperature_k: model.sensors.ambient_temperature_k,
            ballast_direction: Vector3::zeros(),
            touching: Touching::AsItIs,
        }
    }

    /// Expresses a world vector in body axes.
    #[must_use]
    pub fn to_body(&self, v_world: &Vector3<f64>) -> Vector3<f64> {
        self.q_world_body.inverse_transform_vector(v_world)
    }

    /// Specific force at the centre of rotation, body axes [m/s^2], with which a loose mass must be held to stay in its place:
    /// g k_b where the rig is held up, in free fall the acceleration that the jets give.
    #[must_use]
    #[inline]
    pub fn specific_force_b_m_s2(&self) -> Vector3<f64> {
        if self.model.freedom.has_weight() {
            GRAVITY_M_S2 * self.vertical_b
        } else {
            self.jet_force_b_n() / self.model.mass_properties.mass_kg()
        }
    }

    /// Tank pressure over the pressure at which jets give their nominal thrust.
    #[must_use]
    pub fn pressure_ratio(&self) -> f64 {
        self.tank_pressure_pa / self.model.tank().reference_pressure_pa
    }

    /// Speed of a wheel relative to the body [rad/s].
    #[must_use]
    pub fn wheel_speed(&self, wheel: usize) -> f64 {
        self.wheel_speed_rad_s.get(wheel).copied().unwrap_or(0.0)
    }

    /// Gimbal angle of a gyro \[rad\].
    #[must_use]
    pub fn gimbal_angle(&self, gyro: usize) -> f64 {
        self.gimbal_angle_rad.get(gyro).copied().unwrap_or(0.0)
    }

    /// Gimbal rate of a gyro [rad/s].
    #[must_use]
    pub fn gimbal_rate(&self, gyro: usize) -> f64 {
        self.gimbal_rate_rad_s.get(gyro).copied().unwrap_or(0.0)
    }

    /// Gimbal acceleration of a gyro [rad/s^2].
    #[must_use]
    pub fn gimbal_acceleration(&self, gyro: usize) -> f64 {
        self.gimbal_acceleration_rad_s2.get(gyro).copied().unwrap_or(0.0)
    }

    /// Torque of a wheel's motor [N m].
    #[must_use]
    pub fn wheel_motor_torque(&self, wheel: usize) -> f64 {
        self.wheel_motor_torque_n_m.get(wheel).copied().unwrap_or(0.0)
    }

    /// What of that torque the motor can give at the wheel's speed \[N m\]: near its largest speed none that would exceed it.
    /// What makes motors stronger or weaker acts on this part.
    #[must_use]
    pub fn available_motor_torque(&self, wheel: usize) -> f64 {
        let asked_n_m = self.wheel_motor_torque(wheel);
        self.model.wheels().get(wheel).map_or(asked_n_m, |of| {
            available_motor_torque_n_m(asked_n_m, self.wheel_speed(wheel), of.max_speed_rad_s)
        })
    }

    /// Heading: the angle of body x about the vertical, from world x towards world y \[rad\], -pi..pi.
    #[must_use]
    pub fn yaw_rad(&self) -> f64 {
        azimuth_rad(&self.q_world_body)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn yaw_of_a_tilted_body_is_the_first_euler_angle() {
        let model = PlatformModel::whorl_1_reference();
        let q = UnitQuaternion::from_euler_angles(0.03, -0.05, 2.1);
        let environment = Environment::new(&model, q, Vector3::zeros());
        assert!((environment.yaw_rad() - 2.1).abs() < 1e-14);
    }
}
