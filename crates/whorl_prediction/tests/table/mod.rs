//! A table on a shaft, integrated here by its own equations and not by the plant, under torques that no model has.

use nalgebra::{Matrix3, Unit, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use whorl_dynamics::platform::{TiltLimit, Wheel};
use whorl_dynamics::{Freedom, MassProperties, PlatformModel};
use whorl_recording::{Mounting, Recording};

/// A table on a shaft along z with a wheel, or that wheel alone on a bench.
#[derive(Debug, Clone, Copy)]
pub struct Table {
    pub inertia_kg_m2: f64,
    pub spin_inertia_kg_m2: f64,
    /// Torque on the table that the model lacks, -c w |w| [N m s^2].
    pub drag_n_m_s2: f64,
    /// The same, first-order Markov: standard deviation [N m] and correlation time \[s\].
    pub random_n_m: f64,
    pub correlation_s: f64,
    /// Torque of the motor that the model lacks, -c times the wheel's speed [N m s].
    pub loss_n_m_s: f64,
    pub gyro_rad_s: f64,
    pub tachometer_rad_s: f64,
    /// Amplitude of the wheel's torque [N m] and its rate [rad/s].
    pub torque_n_m: f64,
    pub wave_rad_s: f64,
    /// Of the wheel's axis against the table's.
    pub sign: f64,
    pub clamped: bool,
    /// How often everything is read, and how many times.
    pub sample_s: f64,
    pub samples: u32,
}

pub const TABLE: Table = Table {
    inertia_kg_m2: 2.0,
    spin_inertia_kg_m2: 0.05,
    drag_n_m_s2: 0.0,
    random_n_m: 0.0,
    correlation_s: 1.0,
    loss_n_m_s: 0.0,
    gyro_rad_s: 2e-3,
    tachometer_rad_s: 0.05,
    torque_n_m: 0.5,
    wave_rad_s: 0.8,
    sign: 1.0,
    clamped: false,
    sample_s: 0.01,
    samples: 3000,
};

impl Table {
    pub fn model(&self) -> PlatformModel {
        let mut model = PlatformModel::whorl_1_reference();
        let inertia = Matrix3::identity() * self.inertia_kg_m2;
        model.mass_properties = MassProperties::new(inertia, Vector3::zeros(), 10.0).unwrap();
        model.freedom =
            if self.clamped { Freedom::Clamped } else { Freedom::Hinge { axis_b: Vector3::z_axis() } };
        model.tilt_limit = TiltLimit::NONE;
        model.jets_mut().clear();
        *model.wheels_mut() = vec![Wheel {
            name: "wheel".to_owned(),
            spin_axis_b: Unit::new_normalize(Vector3::z() * self.sign),
            spin_inertia_kg_m2: self.spin_inertia_kg_m2,
            max_torque_n_m: 10.0,
            max_speed_rad_s: 1e6,
            viscous_friction_n_m_s: 0.0,
            coulomb_friction_n_m: 0.0,
        }];
        let sensors = &mut model.sensors;
        sensors.accelerometer.fitted = false;
        let gyro = &mut sensors.gyro.errors;
        (gyro.bias_turn_on_stddev, gyro.bias_walk) = (Vector3::zeros(), Vector3::zeros());
        (gyro.noise_stddev, gyro.range) = (Vector3::repeat(self.gyro_rad_s), 1e3);
        sensors.wheel_speed.noise_stddev_rad_s = self.tachometer_rad_s;
        sensors.wheel_speed.quantum_rad_s = 0.0;
        model
    }

    /// A run of it: what was recorded, and at each sample the torques that the model lacks, on table and motor.
    pub fn turned(&self, seed: u64) -> (Recording, Vec<[f64; 2]>) {
        let mut random = Pcg64::new(u128::from(seed).wrapping_mul(0x9e37_79b9_7f4a_7c15_f39c), 8);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let mut r = Recording { name: "table".to_owned(), ..Recording::default() };
        r.no_gyro_axis = [true, true, false];
        if self.clamped {
            r.mounting = Mounting::Clamped;
        }
        let (body, spin) = (self.inertia_kg_m2 - self.spin_inertia_kg_m2, self.spin_inertia_kg_m2);
        let (mut rate, mut speed) = (if self.clamped { 0.0 } else { 0.1 }, 5.0);
        let mut pushes = self.random_n_m * normal();
        let mut lacking = Vec::new();
        for k in 0..self.samples {
            let t = f64::from(k) * self.sample_s;
            if !self.clamped {
                r.gyro_b_rad_s.time_s.push(t);
                r.gyro_b_rad_s.value.push(Vector3::new(0.0, 0.0, rate + self.gyro_rad_s * normal()));
            }
            r.wheel_speed_rad_s.time_s.push(t);
            r.wheel_speed_rad_s.value.push(vec![speed + self.tachometer_rad_s * normal()]);
            let command = self.torque_n_m * (self.wave_rad_s * t).sin();
            r.wheel_torque_command_n_m.time_s.push(t);
            r.wheel_torque_command_n_m.value.push(vec![command]);
            let of_table = |w: f64| pushes - self.drag_n_m_s2 * w * w.abs();
            let of_motor = |speed: f64| -self.loss_n_m_s * speed;
            lacking.push([of_table(rate), of_motor(speed)]);
            for _ in 0..10 {
                let h = 0.1 * self.sample_s;
                let slopes = |w: f64, speed: f64| {
                    let motor = command + of_motor(speed);
                    let table = if self.clamped { 0.0 } else { (of_table(w) - self.sign * motor) / body };
                    [table, motor / spin - self.sign * table]
                };
                // Heun's rule.
                let [a, b] = slopes(rate, speed);
                let [c, d] = slopes(rate + h * a, speed + h * b);
                rate += 0.5 * h * (a + c);
                speed += 0.5 * h * (b + d);
            }
            let kept = (-self.sample_s / self.correlation_s).exp();
            pushes = kept * pushes + self.random_n_m * (1.0 - kept * kept).sqrt() * normal();
        }
        (r, lacking)
    }
}
