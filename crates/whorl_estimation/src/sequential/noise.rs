//! Noise of the sensors, as a joint filter weighs it.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;

/// Variances of one sample per axis.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Noise {
    pub gyro: Vector3<f64>,
    pub accelerometer: Vector3<f64>,
    pub direction: f64,
}

impl Noise {
    pub fn new(model: &PlatformModel) -> Self {
        let sensors = &model.sensors;
        // A sensor without noise still has its quantum, and never less than a millionth of a unit.
        let variance = |stddev: f64, quantum: f64| stddev.powi(2) + quantum.powi(2) / 12.0 + 1e-12;
        let gyro = &sensors.gyro.errors;
        // The rate is momentum less the wheels' share, so the noise of their speeds enters it.
        let inertia = model.mass_properties.inertia_b_kg_m2();
        let tachometer = variance(sensors.wheel_speed.noise_stddev_rad_s, sensors.wheel_speed.quantum_rad_s);
        let mut wheels = Vector3::zeros();
        for wheel in model.wheels() {
            let share = wheel.spin_axis_b.into_inner() * wheel.spin_inertia_kg_m2;
            let share = share.component_div(&inertia.diagonal());
            // Smoothing leaves a fifth of it.
            wheels += share.component_mul(&share) * (0.2 * tachometer);
        }
        let accelerometer = &sensors.accelerometer.errors;
        Self {
            gyro: gyro.noise_stddev.map(|s| variance(s, gyro.quantum)) + wheels,
            accelerometer: accelerometer.noise_stddev.map(|s| variance(s, accelerometer.quantum)),
            direction: variance(sensors.vector.map_or(1.0, |v| v.noise_stddev_rad), 0.0),
        }
    }
}
