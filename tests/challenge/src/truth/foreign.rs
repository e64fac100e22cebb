//! Effects that no library has.

use nalgebra::{Matrix3, Vector3};

use super::law::DrawnLaw;

/// Effects outside the library.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Foreign {
    /// Torque about body z, cubic in the yaw rate, driving [N m s^3].
    pub cubic_yaw_n_m_s3: f64,
    /// Torque about body x, cubic in the yaw rate (a vane) [N m s^3].
    pub vane_n_m_s3: f64,
    /// Torque about the vertical, sin(3 yaw): an oval bearing [N m].
    pub oval_n_m: f64,
    /// m g r_cg moves with temperature [N m/K].
    pub warm_cg_n_m_k: Vector3<f64>,
    /// m g r_cg moves with time [N m/s].
    pub drift_cg_n_m_s: Vector3<f64>,
    /// Pump on board: periodic torque in body axes [N m], at `pump_hz`.
    pub pump_b_n_m: Vector3<f64>,
    pub pump_hz: f64,
    /// Torque about body z as a wheel's teeth mesh: reaction ripple of wheel z, this many a turn [N m].
    pub gear_n_m: f64,
    pub gear_teeth: f64,
    /// A jet that leaks only now and then: thrust, jet, and from-to times.
    pub burst_leak_n: f64,
    pub burst_jet: usize,
    pub burst_s: Vec<(f64, f64)>,
    /// Stick-slip: friction of the bearing that falls with speed [N m].
    pub stick_slip_n_m: f64,
    /// Gyro outputs x and y exchanged.
    pub gyro_xy_swapped: bool,
    /// Gyro output z has the wrong sign.
    pub gyro_z_reversed: bool,
    /// Torque about body z that follows the bus voltage's drop [N m/V].
    pub voltage_torque_n_m_v: f64,
    /// A fan on board that a thermostat switches: torque while it runs [N m], and from-to times \[s\].
    pub fan_b_n_m: Vector3<f64>,
    pub fan_s: Vec<(f64, f64)>,
    /// A cable that creeps: torque about the vertical that grows with the logarithm of time [N m].
    pub creep_n_m: f64,
    /// A battery that slides once and stays there: m g r_cg moves [N m], and when \[s\].
    pub battery_n_m: Vector3<f64>,
    pub battery_s: f64,
    /// Grease of wheel x: drag that a cold bearing has and one that has run for a while has not [N m s].
    pub grease_n_m_s: f64,
    /// A draught through a door: world torque while the platform faces it [N m], and where the door is \[rad\].
    pub door_world_n_m: Vector3<f64>,
    pub door_rad: f64,
    /// Viscous friction about body z in one sense of turning only [N m s].
    pub ratchet_n_m_s: f64,
    /// A gyro that is still below this rate [rad/s].
    pub dead_rad_s: f64,
    /// Iron near the vector sensor: its direction turns about the vertical with twice the heading \[rad\].
    pub iron_rad: f64,
    /// A law that was drawn.
    pub law: Option<DrawnLaw>,
}

/// Time in which grease warms \[s\].
const GREASE_S: f64 = 25.0;

impl Foreign {
    /// Drag of wheel x at this speed [N m].
    #[must_use]
    pub fn grease(&self, speed_rad_s: f64, time_s: f64) -> f64 {
        self.grease_n_m_s * (-time_s / GREASE_S).exp() * speed_rad_s
    }

    /// Torque on the body [N m], body axes, that no actuator and no moved mass makes.
    #[must_use]
    pub fn torque(&self, bn: &Matrix3<f64>, omega: &Vector3<f64>, time_s: f64) -> Vector3<f64> {
        let k = bn.column(2).into_owned();
        let yaw = bn[(0, 1)].atan2(bn[(0, 0)]);
        let rate = omega.norm();
        let mut torque = k * (self.oval_n_m * (3.0 * yaw).sin());
        torque.z += self.cubic_yaw_n_m_s3 * omega.z.powi(3) - self.ratchet_n_m_s * omega.z.max(0.0);
        torque.x += self.vane_n_m_s3 * omega.z.powi(3);
        if self.pump_hz > 0.0 {
            torque += self.pump_b_n_m * (std::f64::consts::TAU * self.pump_hz * time_s).sin();
        }
        if self.stick_slip_n_m != 0.0 {
            let size = self.stick_slip_n_m * (0.3 + 0.7 * (-rate / 0.02).exp());
            torque -= omega * (size / rate.hypot(6e-4));
        }
        if self.fan_s.iter().any(|(from, to)| (*from..*to).contains(&time_s)) {
            torque += self.fan_b_n_m;
        }
        torque += k * (self.creep_n_m * (time_s / 8.0).max(0.0).ln_1p());
        if let Some(law) = &self.law {
            torque += law.torque(bn, omega);
        }
        torque += k.cross(&self.battery_n_m) * f64::from(u8::from(time_s > self.battery_s));
        // A sector of some 45 deg to both sides.
        torque + bn * self.door_world_n_m * (3.0 * ((yaw - self.door_rad).cos() - 1.0)).exp()
    }
}
