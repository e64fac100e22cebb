//! The first attitude: directions averaged over a window, in a frame carried by the gyro.
//!
//! During the window the gyro (less the bias known so far) turns a frame that starts with the
//! body: a rotating platform does not blur the averages. The bias error turns that frame too;
//! its effect on each average is kept to first order and becomes the initial correlation
//! of attitude and bias.

use crate::covariance::{Covariance, Measurement};
use crate::parameters::Parameters;
use crate::residual::{across, components, direction_residual};
use nalgebra::{Matrix2, Matrix3, Unit, UnitQuaternion, Vector3};
use whorl_math::{attitude_from_two_vectors, attitude_from_vertical, unit};

/// Fewest accelerometer samples for a start.
const MIN_SAMPLES: u32 = 5;

/// Attitude variance that leaves the averages alone to decide \[rad^2\].
const UNKNOWN_VARIANCE: f64 = 10.0;

/// Sums of one direction.
#[derive(Clone, Debug, PartialEq)]
struct Average {
    sum: Vector3<f64>,
    count: u32,
    /// Sum of the integrals of the rotation matrix up to each sample \[s\].
    lever_sum: Matrix3<f64>,
    /// Sums in body axes, first and second half of the window.
    body_halves: [(Vector3<f64>, u32); 2],
}

impl Average {
    fn new() -> Self {
        Self {
            sum: Vector3::zeros(),
            count: 0,
            lever_sum: Matrix3::zeros(),
            body_halves: [(Vector3::zeros(), 0); 2],
        }
    }

    fn add(&mut self, inertial: Vector3<f64>, body: Vector3<f64>, lever: &Matrix3<f64>, half: usize) {
        self.sum += inertial;
        self.count += 1;
        self.lever_sum += lever;
        if let Some((sum, count)) = self.body_halves.get_mut(half) {
            *sum += body;
            *count += 1;
        }
    }

    /// Whether the body-axes direction stayed within noise between the halves of the window.
    fn still(&self, noise_rad: f64) -> bool {
        let [(first, n1), (second, n2)] = self.body_halves;
        let (Ok(first), Ok(second)) = (unit(first), unit(second)) else {
            return false;
        };
        let variance = noise_rad * noise_rad * (1.0 / f64::from(n1) + 1.0 / f64::from(n2));
        // Chi-squared with two degrees of freedom at 0.999.
        first.cross(&second).norm_squared() < 13.8 * variance
    }
}

/// The running averages of the start.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Start {
    begin_ns: i64,
    gravity: Average,
    vector: Average,
    /// Integral of the rotation matrix since the begin \[s\], in the carried frame.
    lever: Matrix3<f64>,
    elapsed_s: f64,
    rate_sum: Vector3<f64>,
    rate_squares: Vector3<f64>,
    rate_count: u32,
}

/// The result: correction of the carried frame and covariance.
pub(crate) struct FirstAttitude {
    pub(crate) q_world_carried: UnitQuaternion<f64>,
    pub(crate) bias_change_rad_s: Vector3<f64>,
    pub(crate) covariance: Covariance,
    pub(crate) with_vector: bool,
}

impl Start {
    pub(crate) fn new(begin_ns: i64) -> Self {
        Self {
            begin_ns,
            gravity: Average::new(),
            vector: Average::new(),
            lever: Matrix3::zeros(),
            elapsed_s: 0.0,
            rate_sum: Vector3::zeros(),
            rate_squares: Vector3::zeros(),
            rate_count: 0,
        }
    }

    fn half(&self, parameters: &Parameters, stamp_ns: i64) -> usize {
        usize::from(seconds(stamp_ns - self.begin_ns) > 0.5 * parameters.start_window_s)
    }

    /// The carried frame turned; `mean_rotation` is that of the interval.
    pub(crate) fn advance(&mut self, mean_rotation: &Matrix3<f64>, dt_s: f64) {
        self.lever += mean_rotation * dt_s;
        self.elapsed_s += dt_s;
    }

    pub(crate) fn add_rate(&mut self, rate: &Vector3<f64>) {
        self.rate_sum += rate;
        self.rate_squares += rate.component_mul(rate);
        self.rate_count += 1;
    }

    /// A specific force without its lever-arm part, in body axes, and the carried frame's rotation.
    pub(crate) fn add_gravity(
        &mut self,
        parameters: &Parameters,
        stamp_ns: i64,
        specific_force_b: &Vector3<f64>,
        rotation: &Matrix3<f64>,
    ) {
        let half = self.half(parameters, stamp_ns);
        self.gravity.add(rotation * specific_force_b, *specific_force_b, &self.lever, half);
    }

    /// A direction of the vector sensor, in the carried frame and in body axes.
    pub(crate) fn add_vector(
        &mut self,
        parameters: &Parameters,
        stamp_ns: i64,
        inertial: Vector3<f64>,
        body: Vector3<f64>,
    ) {
        let half = self.half(parameters, stamp_ns);
        // A late sample belongs to an earlier lever; within a window of half a second and
        // a delay of some hundredths the difference is far below the sensor's noise.
        self.vector.add(inertial, body, &self.lever, half);
    }

    /// The first attitude, once there is enough; `bias` is the covariance block known so far and
    /// `rotation` the carried frame's rotation now.
    pub(crate) fn finish(
        &self,
        parameters: &Parameters,
        now_ns: i64,
        bias: &Matrix3<f64>,
        q_carried_body: &UnitQuaternion<f64>,
    ) -> Option<FirstAttitude> {
        let elapsed_s = seconds(now_ns - self.begin_ns);
        if elapsed_s < parameters.start_window_s || self.gravity.count < MIN_SAMPLES {
            return None;
        }
        let missing_vector = parameters.vector.is_some() && self.vector.count == 0;
        if missing_vector && elapsed_s < parameters.start_window_s + parameters.start_vector_wait_s {
            return None;
        }
        let up = unit(self.gravity.sum).ok()?;
        let seen = parameters.vector.zip(unit(self.vector.sum).ok());
        let q_world_carried = seen
            .and_then(|(vector, direction)| {
                attitude_from_two_vectors(&up, &Vector3::z_axis(), &direction, &vector.reference_w).ok()
            })
            .unwrap_or_else(|| {
                let vertical_b = q_carried_body.inverse() * up;
                attitude_from_vertical(vertical_b, parameters.initial_heading_rad) * q_carried_body.inverse()
            });
        let mut first = FirstAttitude {
            q_world_carried,
            bias_change_rad_s: Vector3::zeros(),
            covariance: Covariance::diagonal(Vector3::repeat(UNKNOWN_VARIANCE), 1.0),
            with_vector: false,
        };
        first.covariance.bias = *bias;
        let tilt_noise = parameters.accelerometer_noise_m_s2 / parameters.gravity_m_s2;
        self.correct(&mut first, &self.gravity, &Vector3::z_axis(), tilt_noise, f64::INFINITY);
        if let Some((vector, _)) = seen {
            let gate = -2.0 * parameters.outlier_probability.ln();
            first.with_vector =
                self.correct(&mut first, &self.vector, &vector.reference_w, vector.noise_rad, gate);
        }
        if !first.with_vector {
            let sigma = parameters.initial_heading_sigma_rad;
            first.covariance.forget_heading(sigma * sigma);
        }
        self.use_stillness(&mut first, parameters, q_carried_body);
        Some(first)
    }

    /// Kalman update with an average; returns whether it was inside the gate.
    fn correct(
        &self,
        first: &mut FirstAttitude,
        average: &Average,
        reference: &Unit<Vector3<f64>>,
        noise_rad: f64,
        gate: f64,
    ) -> bool {
        let Ok(mean) = unit(average.sum) else {
            return false;
        };
        let q = first.q_world_carried;
        let count = f64::from(average.count);
        let columns = across(reference);
        let residual = direction_residual(&(q * mean.into_inner()), reference);
        // The error when the samples were taken is that of now, less what the bias error
        // has turned since: delta(then) = delta(now) + integral(R) bias error.
        let since = q.to_rotation_matrix() * (self.lever - average.lever_sum / count);
        let measurement = Measurement {
            innovation: components(&columns, &residual),
            attitude: columns,
            bias: Some(since.tr_mul(&columns)),
            noise: Matrix2::identity() * (noise_rad * noise_rad / count),
        };
        match first.covariance.update(&measurement, gate) {
            Ok(correction) => {
                first.q_world_carried =
                    whorl_math::quaternion_exp(&correction.attitude_rad) * first.q_world_carried;
                first.bias_change_rad_s += correction.bias_rad_s;
                true
            }
            Err(_) => false,
        }
    }

    /// Takes the mean rate as bias where the window looks still: across the vertical if the
    /// accelerometer saw no motion, about it only if the vector sensor saw none either.
    fn use_stillness(
        &self,
        first: &mut FirstAttitude,
        parameters: &Parameters,
        q_carried_body: &UnitQuaternion<f64>,
    ) {
        let Some(sigma) = parameters.still_rate_sigma_rad_s else {
            return;
        };
        let count = f64::from(self.rate_count);
        if self.rate_count < MIN_SAMPLES || self.elapsed_s <= 0.0 {
            return;
        }
        let mean = self.rate_sum / count;
        let variance = self.rate_squares / count - mean.component_mul(&mean);
        let white = parameters.gyro_noise_rad_s_sqrt_hz.powi(2) * count / self.elapsed_s;
        let tilt_noise = parameters.accelerometer_noise_m_s2 / parameters.gravity_m_s2;
        let quiet = variance.max() < 4.0 * white && self.gravity.still(tilt_noise);
        if !quiet {
            return;
        }
        let heading_still =
            first.with_vector && parameters.vector.is_some_and(|vector| self.vector.still(vector.noise_rad));
        let q = first.q_world_carried * q_carried_body;
        let noise = sigma * sigma + white / count;
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        for axis_w in axes.iter().take(if heading_still { 3 } else { 2 }) {
            let axis_b = q.inverse() * axis_w;
            let measurement = crate::covariance::ScalarMeasurement {
                innovation: axis_b.dot(&(mean - first.bias_change_rad_s)),
                attitude: Vector3::zeros(),
                bias: axis_b,
                noise,
                corrects: Vector3::repeat(1.0),
            };
            if let Ok(correction) = first.covariance.update_scalar(&measurement, 30.0) {
                first.q_world_carried =
                    whorl_math::quaternion_exp(&correction.attitude_rad) * first.q_world_carried;
                first.bias_change_rad_s += correction.bias_rad_s;
            }
        }
    }
}

fn seconds(duration_ns: i64) -> f64 {
    duration_ns as f64 * 1e-9
}
