//! Sensors and their errors.
//!
//! Noise is given as the standard deviation of one sample at the sensor's rate, which is what a
//! still recording shows directly; the density is that times the square root of the sample time.

use nalgebra::{Unit, Vector3};

/// Errors common to three-axis sensors. y = (1 + scale) * skewed(misaligned(x)) + bias + noise, then
/// saturation, then quantisation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriaxialErrors {
    /// White noise, standard deviation of one sample, per axis, >= 0 (unit of the sensor).
    pub noise_stddev: Vector3<f64>,
    /// Turn-on bias: constant part per axis (unit of the sensor).
    pub bias: Vector3<f64>,
    /// Turn-on bias: standard deviation of a random part drawn once per run, per axis, >= 0.
    pub bias_turn_on_stddev: Vector3<f64>,
    /// Bias random walk intensity per axis, unit per sqrt(s), >= 0.
    pub bias_walk: Vector3<f64>,
    /// Scale factor error per axis, dimensionless, |x| < 0.5.
    pub scale: Vector3<f64>,
    /// Small rotation from body axes to the sensor's own axes \[rad\].
    pub misalignment_rad: Vector3<f64>,
    /// How much the y axis sees of x, and the z axis of x and of y: axes that are not at right angles \[rad\].
    pub skew_rad: Vector3<f64>,
    /// Step of the digitised output, >= 0; 0 = none (unit of the sensor).
    pub quantum: f64,
    /// Clips at +- this, > 0 (unit of the sensor).
    pub range: f64,
    /// Age of the data when stamped \[s\], >= 0.
    pub latency_s: f64,
    /// Time constant of a first-order low-pass between motion and output \[s\], >= 0: 1/(2 pi bandwidth).
    pub time_constant_s: f64,
    /// Length of the window over which the output is the mean of the motion \[s\], >= 0; the middle of the window is the instant that
    /// the output shows, `latency_s` before its stamp.
    pub averaging_window_s: f64,
}

impl TriaxialErrors {
    /// Age of the data for motion that is slow against the low-pass: latency and time constant \[s\].
    #[must_use]
    pub fn lag_s(&self) -> f64 {
        self.latency_s + self.time_constant_s
    }

    /// Standard deviation of one sample per axis: white noise, and the quantisation's share, a uniform error of one
    /// step (unit of the sensor).
    #[must_use]
    pub fn one_sample_stddev(&self) -> Vector3<f64> {
        self.noise_stddev.map(|noise| one_sample_stddev(noise, self.quantum))
    }
}

/// Standard deviation of one sample of a digitised sensor: white noise of `noise_stddev`, and a uniform error of one
/// step `quantum`, in the same unit.
fn one_sample_stddev(noise_stddev: f64, quantum: f64) -> f64 {
    noise_stddev.hypot(quantum / 12f64.sqrt())
}

impl WheelSpeedSensor {
    /// Standard deviation of one sample, the quantisation's share included [rad/s].
    #[must_use]
    pub fn one_sample_stddev_rad_s(&self) -> f64 {
        one_sample_stddev(self.noise_stddev_rad_s, self.quantum_rad_s)
    }
}

/// Rate gyro; unit rad/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RateGyro {
    /// Which body axes it measures.
    pub axes: [bool; 3],
    /// Its errors [rad/s].
    pub errors: TriaxialErrors,
}

/// Three-axis accelerometer; unit m/s^2, specific force (REP-145): +9.81 on z at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accelerometer {
    /// Whether the platform has one. The rest says nothing where it has not.
    pub fitted: bool,
    /// Its errors [m/s^2].
    pub errors: TriaxialErrors,
    /// Position from the centre of rotation, body axes \[m\].
    pub lever_arm_b_m: Vector3<f64>,
}

/// Measures the direction to a fixed target, in body axes (sun sensor, star, lamp, magnetometer).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VectorSensor {
    /// The direction it sees, world axes.
    pub reference_direction_world: Unit<Vector3<f64>>,
    /// White noise of one sample, standard deviation across each of two axes \[rad\], >= 0.
    pub noise_stddev_rad: f64,
    /// Small rotation from body axes to the sensor's own axes \[rad\].
    pub misalignment_rad: Vector3<f64>,
    /// Sample rate \[Hz\], > 0.
    pub rate_hz: f64,
    /// Age of the data when stamped \[s\], >= 0.
    pub latency_s: f64,
}

/// Wheel tachometer; unit rad/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WheelSpeedSensor {
    /// White noise of one sample [rad/s], >= 0.
    pub noise_stddev_rad_s: f64,
    /// Step of the output [rad/s], >= 0; 0 = none.
    pub quantum_rad_s: f64,
}

/// A slow scalar channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScalarSensor {
    /// White noise of one sample, >= 0.
    pub noise_stddev: f64,
    /// Step of the output, >= 0; 0 = none.
    pub quantum: f64,
}

/// The electrical bus of a platform on batteries.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BusVoltage {
    /// At the start of a run \[V\], > 0.
    pub initial_v: f64,
    /// Of a full battery, from which effects count the loss \[V\], > 0.
    pub full_v: f64,
    /// Fall over time [V/s], >= 0.
    pub discharge_v_s: f64,
    /// Drop per newton metre of total wheel torque [V/(N m)], >= 0.
    pub sag_v_n_m: f64,
}

/// The sensors of a platform.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorSuite {
    /// Sample rate of gyro, accelerometer and wheel speed \[Hz\], > 0.
    pub rate_hz: f64,
    /// Rate gyro.
    pub gyro: RateGyro,
    /// Accelerometer.
    pub accelerometer: Accelerometer,
    /// Vector sensor, if fitted.
    pub vector: Option<VectorSensor>,
    /// Tachometers.
    pub wheel_speed: WheelSpeedSensor,
    /// Bus voltage \[V\].
    pub bus_voltage: ScalarSensor,
    /// Tank pressure \[Pa\].
    pub tank_pressure: ScalarSensor,
    /// Temperature of the platform \[K\].
    pub temperature: ScalarSensor,
    /// Ambient temperature \[K\] and its drift [K/s] in simulation.
    pub ambient_temperature_k: f64,
    /// Drift of the temperature [K/s].
    pub temperature_drift_k_s: f64,
}

impl SensorSuite {
    /// Takes noise, biases that are drawn and steps of the digits off gyro, accelerometer and tachometers: what a model
    /// predicts of them.
    pub fn silence(&mut self) {
        for errors in [&mut self.gyro.errors, &mut self.accelerometer.errors] {
            errors.noise_stddev = Vector3::zeros();
            errors.bias_turn_on_stddev = Vector3::zeros();
            errors.bias_walk = Vector3::zeros();
            errors.quantum = 0.0;
        }
        self.wheel_speed.noise_stddev_rad_s = 0.0;
        self.wheel_speed.quantum_rad_s = 0.0;
    }
}
