//! Truth and sensors, independent of the filter and of `whorl_math`: attitude as
//! yaw-pitch-roll angles that are sums of sines, rates by the textbook formula, acceleration by
//! central differences.

use crate::{AttitudeBiasEstimator, Estimate, ImuSample, Parameters};
use nalgebra::{UnitQuaternion, Vector3, Vector6};
use rand_core::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal, StandardUniform};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{PI, TAU};

pub(crate) const IMU_PERIOD_NS: i64 = 10_000_000;

/// A sine: amplitude, angular frequency, phase.
type Sine = (f64, f64, f64);

#[derive(Clone, Debug)]
pub(crate) struct Motion {
    pub(crate) yaw_rate_rad_s: f64,
    pub(crate) yaw_start_rad: f64,
    pub(crate) roll_offset_rad: f64,
    roll: [Sine; 3],
    pitch: [Sine; 3],
    yaw: [Sine; 3],
}

fn normal(rng: &mut Pcg64Mcg) -> f64 {
    StandardNormal.sample(rng)
}

fn uniform(rng: &mut Pcg64Mcg, low: f64, high: f64) -> f64 {
    let unit: f64 = StandardUniform.sample(rng);
    low + (high - low) * unit
}

pub(crate) fn normal3(rng: &mut Pcg64Mcg) -> Vector3<f64> {
    Vector3::new(normal(rng), normal(rng), normal(rng))
}

impl Motion {
    pub(crate) fn still() -> Self {
        let none = [(0.0, 0.0, 0.0); 3];
        Self {
            yaw_rate_rad_s: 0.0,
            yaw_start_rad: 0.0,
            roll_offset_rad: 0.0,
            roll: none,
            pitch: none,
            yaw: none,
        }
    }

    /// Tilt within +-5 deg, any heading, yaw spin up to 30 deg/s with swings.
    pub(crate) fn platform(rng: &mut Pcg64Mcg) -> Self {
        let mut sines = |amplitude: f64| {
            [(); 3].map(|()| {
                (
                    uniform(rng, 0.2, 1.0) * amplitude / 3.0,
                    uniform(rng, 0.1, 0.5) * TAU,
                    uniform(rng, 0.0, TAU),
                )
            })
        };
        let (roll, pitch, yaw) = (sines(0.06), sines(0.06), sines(0.5));
        let yaw_start_rad = uniform(rng, -PI, PI);
        Self {
            yaw_rate_rad_s: uniform(rng, -0.5, 0.5),
            yaw_start_rad,
            roll_offset_rad: 0.0,
            roll,
            pitch,
            yaw,
        }
    }

    pub(crate) fn attitude(&self, t: f64) -> UnitQuaternion<f64> {
        let [roll, pitch, yaw] = self.angles(t);
        UnitQuaternion::from_euler_angles(roll, pitch, yaw)
    }

    fn angles(&self, t: f64) -> [f64; 3] {
        let sum = |sines: &[Sine; 3]| sines.iter().map(|(a, w, p)| a * (w * t + p).sin()).sum::<f64>();
        [
            sum(&self.roll) + self.roll_offset_rad,
            sum(&self.pitch),
            sum(&self.yaw) + self.yaw_start_rad + self.yaw_rate_rad_s * t,
        ]
    }

    /// Body rates of the yaw-pitch-roll sequence (Stevens and Lewis, eq. 1.3-21).
    pub(crate) fn rate(&self, t: f64) -> Vector3<f64> {
        let slope = |sines: &[Sine; 3]| sines.iter().map(|(a, w, p)| a * w * (w * t + p).cos()).sum::<f64>();
        let [roll, pitch, _] = self.angles(t);
        let (roll_rate, pitch_rate) = (slope(&self.roll), slope(&self.pitch));
        let yaw_rate = slope(&self.yaw) + self.yaw_rate_rad_s;
        Vector3::new(
            roll_rate - yaw_rate * pitch.sin(),
            pitch_rate * roll.cos() + yaw_rate * roll.sin() * pitch.cos(),
            -pitch_rate * roll.sin() + yaw_rate * roll.cos() * pitch.cos(),
        )
    }

    pub(crate) fn angular_acceleration(&self, t: f64) -> Vector3<f64> {
        (self.rate(t + 1e-5) - self.rate(t - 1e-5)) / 2e-5
    }
}

/// One platform with its sensors, stepped at 100 Hz.
pub(crate) struct Simulation {
    pub(crate) motion: Motion,
    pub(crate) bias: Vector3<f64>,
    pub(crate) rng: Pcg64Mcg,
    pub(crate) step: i64,
    /// 0 takes the noise away.
    pub(crate) noise_scale: f64,
    /// The vector sensor's sample is delivered this many IMU samples late.
    pub(crate) vector_delay_steps: i64,
    waiting: Vec<(i64, i64, Vector3<f64>)>,
}

impl Simulation {
    pub(crate) fn new(motion: Motion, parameters: &Parameters, seed: u64) -> Self {
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let _ = rng.next_u64();
        let bias = normal3(&mut rng) * parameters.initial_bias_sigma_rad_s;
        Self { motion, bias, rng, step: 0, noise_scale: 1.0, vector_delay_steps: 0, waiting: Vec::new() }
    }

    pub(crate) fn time_s(&self) -> f64 {
        (self.step * IMU_PERIOD_NS) as f64 * 1e-9
    }

    pub(crate) fn stamp_ns(&self) -> i64 {
        self.step * IMU_PERIOD_NS
    }

    /// The next IMU sample; the bias walks by one interval.
    pub(crate) fn imu(&mut self, parameters: &Parameters) -> ImuSample {
        self.step += 1;
        let (t, dt) = (self.time_s(), IMU_PERIOD_NS as f64 * 1e-9);
        let scale = self.noise_scale;
        self.bias += normal3(&mut self.rng) * (scale * parameters.gyro_bias_walk_rad_s2_sqrt_hz * dt.sqrt());
        let omega = self.motion.rate(t);
        let r = parameters.accelerometer_position_b_m;
        let force = self.motion.attitude(t).inverse() * Vector3::new(0.0, 0.0, parameters.gravity_m_s2)
            + self.motion.angular_acceleration(t).cross(&r)
            + omega.cross(&omega.cross(&r));
        let gyro_noise = scale * parameters.gyro_noise_rad_s_sqrt_hz / dt.sqrt();
        ImuSample {
            stamp_ns: self.stamp_ns(),
            gyro_rad_s: omega + self.bias + normal3(&mut self.rng) * gyro_noise,
            specific_force_m_s2: force
                + normal3(&mut self.rng) * (scale * parameters.accelerometer_noise_m_s2),
        }
    }

    /// The vector sample now taken (every tenth step), stamped now, with noise across.
    pub(crate) fn vector(&mut self, parameters: &Parameters) -> Option<(i64, Vector3<f64>)> {
        let vector = parameters.vector?;
        if self.step % 10 == 0 {
            let truth = self.motion.attitude(self.time_s()).inverse() * vector.reference_w.into_inner();
            let noise = normal3(&mut self.rng) * (self.noise_scale * vector.noise_rad);
            let across = noise - truth * truth.dot(&noise);
            self.waiting.push((self.step + self.vector_delay_steps, self.stamp_ns(), truth + across));
        }
        let due = self.waiting.iter().position(|(step, ..)| *step <= self.step)?;
        let (_, stamp_ns, direction) = self.waiting.remove(due);
        Some((stamp_ns, direction))
    }

    /// Steps the filter once with all sensors.
    pub(crate) fn drive(&mut self, filter: &mut AttitudeBiasEstimator) {
        let parameters = *filter.parameters();
        let sample = self.imu(&parameters);
        filter.on_imu(&sample);
        if let Some((stamp_ns, direction)) = self.vector(&parameters) {
            filter.on_vector(stamp_ns, &direction);
        }
    }

    /// Attitude error (body axes) and bias error of an estimate made now.
    pub(crate) fn error(&self, estimate: &Estimate) -> Vector6<f64> {
        let attitude = (estimate.q_world_body.inverse() * self.motion.attitude(self.time_s())).scaled_axis();
        let bias = self.bias - estimate.gyro_bias_b_rad_s;
        Vector6::new(attitude.x, attitude.y, attitude.z, bias.x, bias.y, bias.z)
    }
}
