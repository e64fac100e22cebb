//! The first attitude: directions averaged over a window, in a frame carried by the gyro.
//!
//! During the window the gyro (less the bias known so far) turns a frame that starts with the
//! body: a rotating platform does not blur the averages. The bias error turns that frame too;
//! its effect on each average is kept to first order and becomes the initial correlation
//! of attitude and bias.

use super::gravity_window::GravityWindow;
use crate::kernels::attitude_bias::covariance::{Correction, Covariance, Measurement, ScalarMeasurement};
use crate::parameters::{Parameters, VectorParameters, VectorUse};
use crate::residual::{across, components, direction_residual, heading_residual};
use nalgebra::{Matrix2, Matrix3, UnitQuaternion, Vector3};
use whorl_math::{attitude_from_two_vectors, attitude_from_vertical, quaternion_exp, unit};

/// Fewest accelerometer intervals for a start.
const MIN_INTERVALS: u32 = 5;

/// Attitude variance that leaves the averages alone to decide \[rad^2\].
const UNKNOWN_VARIANCE: f64 = 10.0;

/// Sums of the vector sensor.
#[derive(Clone, Debug, PartialEq)]
struct VectorAverage {
    /// Carried frame.
    sum: Vector3<f64>,
    count: u32,
    /// Sum of the integrals of the rotation matrix up to each sample \[s\].
    lever_sum: Matrix3<f64>,
}

/// Sums in body axes over the first and the second half of the window: did the body move?
#[derive(Clone, Debug, PartialEq)]
struct Halves([(Vector3<f64>, u32); 2]);

impl Halves {
    fn new() -> Self {
        Self([(Vector3::zeros(), 0); 2])
    }

    fn add(&mut self, second: bool, direction_b: &Vector3<f64>) {
        let [first_half, second_half] = &mut self.0;
        let (sum, count) = if second { second_half } else { first_half };
        *sum += direction_b;
        *count += 1;
    }

    /// Whether the direction stayed within noise between the halves.
    fn still(&self, noise_rad: f64) -> bool {
        let [(first, n1), (second, n2)] = self.0;
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
    q_carried_body_begin: UnitQuaternion<f64>,
    gravity: Option<GravityWindow>,
    vector: VectorAverage,
    force_halves: Halves,
    vector_halves: Halves,
    rate_sum: Vector3<f64>,
    rate_squares: Vector3<f64>,
    rate_count: u32,
}

/// The result: how to turn the carried frame into the world, and the covariance.
pub(crate) struct FirstAttitude {
    pub(crate) q_world_carried: UnitQuaternion<f64>,
    pub(crate) bias_change_rad_s: Vector3<f64>,
    pub(crate) covariance: Covariance,
    pub(crate) with_vector: bool,
}

/// The filter's state that the start needs.
pub(crate) struct Carried<'a> {
    pub(crate) q_carried_body: UnitQuaternion<f64>,
    pub(crate) omega: Vector3<f64>,
    pub(crate) bias_covariance: &'a Matrix3<f64>,
}

impl Start {
    pub(crate) fn new(begin_ns: i64, q_carried_body: UnitQuaternion<f64>) -> Self {
        Self {
            begin_ns,
            q_carried_body_begin: q_carried_body,
            gravity: None,
            vector: VectorAverage { sum: Vector3::zeros(), count: 0, lever_sum: Matrix3::zeros() },
            force_halves: Halves::new(),
            vector_halves: Halves::new(),
            rate_sum: Vector3::zeros(),
            rate_squares: Vector3::zeros(),
            rate_count: 0,
        }
    }

    fn second_half(&self, parameters: &Parameters, stamp_ns: i64) -> bool {
        seconds(stamp_ns - self.begin_ns) > 0.5 * parameters.start_window_s
    }

    pub(crate) fn add_rate(&mut self, omega: &Vector3<f64>) {
        self.rate_sum += omega;
        self.rate_squares += omega.component_mul(omega);
        self.rate_count += 1;
    }

    /// The gravity window, whose first sample restarts the averages.
    pub(crate) fn gravity_mut(&mut self) -> &mut Option<GravityWindow> {
        &mut self.gravity
    }

    pub(crate) fn add_force(&mut self, parameters: &Parameters, stamp_ns: i64, force_b: &Vector3<f64>) {
        let second = self.second_half(parameters, stamp_ns);
        self.force_halves.add(second, force_b);
    }

    /// A direction of the vector sensor, in the carried frame and in body axes.
    pub(crate) fn add_vector(
        &mut self,
        parameters: &Parameters,
        stamp_ns: i64,
        carried: &Vector3<f64>,
        body: &Vector3<f64>,
    ) {
        let Some(gravity) = &self.gravity else {
            return;
        };
        let second = self.second_half(parameters, stamp_ns);
        self.vector_halves.add(second, body);
        self.vector.sum += carried;
        self.vector.count += 1;
        // A late sample belongs to an earlier lever; the difference (bias error times delay)
        // is far below the sensor's noise.
        self.vector.lever_sum += gravity.lever();
    }

    /// The first attitude, once there is enough.
    pub(crate) fn finish(
        &self,
        parameters: &Parameters,
        now_ns: i64,
        carried: &Carried<'_>,
    ) -> Option<FirstAttitude> {
        let gravity = self.gravity.as_ref()?;
        if gravity.elapsed_s() < parameters.start_window_s || gravity.intervals() < MIN_INTERVALS {
            return None;
        }
        let waited_s = seconds(now_ns - self.begin_ns) - parameters.start_window_s;
        if parameters.vector.is_some() && self.vector.count == 0 && waited_s < parameters.start_vector_wait_s
        {
            return None;
        }
        let rotation = *carried.q_carried_body.to_rotation_matrix().matrix();
        let up = unit(gravity.mean_force(&rotation, &carried.omega, parameters)).ok()?;
        let seen = parameters.vector.zip(unit(self.vector.sum).ok());
        let q_world_carried = seen
            .and_then(|(vector, direction)| {
                attitude_from_two_vectors(&up, &Vector3::z_axis(), &direction, &vector.reference_w).ok()
            })
            .unwrap_or_else(|| {
                let carried_to_body = self.q_carried_body_begin.inverse();
                attitude_from_vertical(carried_to_body * up, parameters.initial_heading_rad) * carried_to_body
            });
        let mut first = FirstAttitude {
            q_world_carried,
            bias_change_rad_s: Vector3::zeros(),
            covariance: Covariance::diagonal(Vector3::repeat(UNKNOWN_VARIANCE), 1.0),
            with_vector: false,
        };
        first.covariance.bias = *carried.bias_covariance;

        let mut turned = gravity.clone();
        turned.change_frame(first.q_world_carried.to_rotation_matrix().matrix());
        let rotation = *(first.q_world_carried * carried.q_carried_body).to_rotation_matrix().matrix();
        // The initial attitude is unknown, so the growth within the window is not part
        // of the covariance set up here.
        let mut vertical = turned.vertical(&rotation, &carried.omega, parameters);
        vertical.lag_variance = 0.0;
        if let Ok(correction) = first.covariance.update(&vertical, f64::INFINITY) {
            first.apply(&correction);
        }
        if let Some((vector, _)) = seen {
            first.with_vector = self.correct_with_vector(&mut first, gravity, &vector, parameters);
        }
        if !first.with_vector {
            let sigma = parameters.initial_heading_sigma_rad;
            first.covariance.forget_heading(sigma * sigma);
        }
        self.use_stillness(&mut first, parameters, gravity, &carried.q_carried_body);
        Some(first)
    }

    /// Kalman update with the vector average; returns whether it was inside the gate.
    fn correct_with_vector(
        &self,
        first: &mut FirstAttitude,
        gravity: &GravityWindow,
        vector: &VectorParameters,
        parameters: &Parameters,
    ) -> bool {
        let count = f64::from(self.vector.count);
        let q = first.q_world_carried;
        let mean = q * unit(self.vector.sum).unwrap_or(vector.reference_w).into_inner();
        let variance = vector.noise_rad * vector.noise_rad / count;
        // delta(then) = delta(now) + integral(R) bias error.
        let since = q.to_rotation_matrix() * (gravity.lever() - self.vector.lever_sum / count);
        let result = match vector.usage {
            VectorUse::Heading => {
                let (innovation, attitude) = heading_residual(&mean, &vector.reference_w);
                let horizontal = vector.reference_w.x.powi(2) + vector.reference_w.y.powi(2);
                let measurement = ScalarMeasurement {
                    innovation,
                    attitude,
                    bias: since.tr_mul(&attitude),
                    noise: variance / horizontal,
                    lag_variance: 0.0,
                    corrects: Vector3::z(),
                };
                // The heading was taken from this average, so there is nothing to gate.
                first.covariance.update_scalar(&measurement, f64::INFINITY)
            }
            VectorUse::Direction => {
                let columns = across(&vector.reference_w);
                let measurement = Measurement {
                    innovation: components(&columns, &direction_residual(&mean, &vector.reference_w)),
                    attitude: columns,
                    bias: Some(since.tr_mul(&columns)),
                    noise: Matrix2::identity() * variance,
                    lag_variance: 0.0,
                };
                // The angle between the two directions must be the one in the world.
                let gate = -2.0 * parameters.outlier_probability.ln();
                first.covariance.update(&measurement, gate)
            }
        };
        result.map(|correction| first.apply(&correction)).is_ok()
    }

    /// Takes the mean rate as bias where the window looks still: across the vertical if the
    /// accelerometer saw no motion, about it only if the vector sensor saw none either.
    fn use_stillness(
        &self,
        first: &mut FirstAttitude,
        parameters: &Parameters,
        gravity: &GravityWindow,
        q_carried_body: &UnitQuaternion<f64>,
    ) {
        let Some(sigma) = parameters.still_rate_sigma_rad_s else {
            return;
        };
        let count = f64::from(self.rate_count.max(1));
        let mean = self.rate_sum / count;
        let variance = self.rate_squares / count - mean.component_mul(&mean);
        let white = parameters.gyro_noise_rad_s_sqrt_hz.powi(2) * count / gravity.elapsed_s();
        let tilt_noise = parameters.accelerometer_noise_m_s2 / parameters.gravity_m_s2;
        if variance.max() > 4.0 * white || !self.force_halves.still(tilt_noise) {
            return;
        }
        let heading_still = first.with_vector
            && parameters.vector.is_some_and(|vector| self.vector_halves.still(vector.noise_rad));
        let q = first.q_world_carried * q_carried_body;
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        for axis_w in axes.iter().take(if heading_still { 3 } else { 2 }) {
            let axis_b = q.inverse() * axis_w;
            let measurement = ScalarMeasurement {
                innovation: axis_b.dot(&(mean - first.bias_change_rad_s)),
                attitude: Vector3::zeros(),
                bias: axis_b,
                noise: sigma * sigma + white / count,
                lag_variance: 0.0,
                corrects: Vector3::repeat(1.0),
            };
            if let Ok(correction) = first.covariance.update_scalar(&measurement, 30.0) {
                first.apply(&correction);
            }
        }
    }
}

impl FirstAttitude {
    fn apply(&mut self, correction: &Correction) {
        self.q_world_carried = quaternion_exp(&correction.attitude_rad) * self.q_world_carried;
        self.bias_change_rad_s += correction.bias_rad_s;
    }
}

fn seconds(duration_ns: i64) -> f64 {
    duration_ns as f64 * 1e-9
}
