//! Attitude of any vehicle from a gyro and directions: a satellite with magnetometer and sun sensor, a probe, a ship.
//!
//! # Equations
//!
//! Multiplicative filter with six states, attitude error and gyro bias, body axes (F. L. Markley, J. L. Crassidis,
//! *Fundamentals of Spacecraft Attitude Determination and Control*, Springer 2014, section 6.2):
//!
//! ```text
//! q+ = q exp( (w_mean - b) dt )         w_mean: mean of the gyro's samples at both ends of the interval
//! d(theta)/dt = -(w - b) x theta - d(b) - n_v,    d(d(b))/dt = n_u
//! Q = [ (sv^2 dt + su^2 dt^3/3) 1   -(su^2 dt^2/2) 1 ;  -(su^2 dt^2/2) 1   (su^2 dt) 1 ]        (6.93)
//! u_b = R^T r_w + noise,   d(u_b) = (R^T r_w) x theta
//! ```
//!
//! Each direction has its own noise and its own reference in the world, which may differ from sample to sample (a magnetic
//! field along an orbit). No accelerometer is needed, none is used; the world's axes are whatever the references are in.
//!
//! # Start, gaps and faults
//! The first attitude is the least-squares solution (TRIAD, weighted by the noises) of the first two directions at least 5
//! degrees apart that a sample, or two samples with the gyro between them, gives: from any attitude the error is that of the
//! sensors at once. A gap in the gyro of more than a second and ten usual intervals says nothing of the turn meanwhile: the
//! attitude starts anew and the bias is kept with the walk of the gap. Over shorter gaps the rate is taken as linear, and half
//! of its change counts as noise. A direction beyond five standard deviations is
//! refused; after five of them in a row the attitude starts anew.

use nalgebra::{Matrix3, Matrix6, SMatrix, Unit, UnitQuaternion, Vector3};
use whorl_math::{attitude_from_two_vectors, covariance, quaternion_exp, skew};

use crate::clipping::Clipping;
use crate::orientation::{Observed, Orientation, OrientationFilter, Sample};

/// Directions closer than this do not fix an attitude together \[rad\]: 5 degrees, where an error of one is twelve times
/// larger in the rotation about the other.
const LEAST_ANGLE_RAD: f64 = 0.087;
/// Normalised innovation squared, of three numbers of which two are free, beyond which a direction is refused: 5 sigma.
const GATE: f64 = 25.0;
/// Refused directions in a row after which the attitude starts anew.
const REFUSALS: u32 = 5;
/// So many usual intervals, and at least [`GAP_S`], without a sample of the gyro are a gap.
const GAP_INTERVALS: f64 = 10.0;
/// See above \[s\].
const GAP_S: f64 = 1.0;
/// A first direction waits at most so many samples of the gyro for a second one.
const WAITS: u32 = 200;

/// Noises of the sensors; all sigmas are standard deviations.
#[derive(Clone, Debug, PartialEq)]
pub struct DirectionParameters {
    /// Gyro white noise [rad/s/sqrt(Hz)], > 0.
    pub gyro_noise_rad_s_sqrt_hz: f64,
    /// Random walk of its bias [rad/s/sqrt(s)].
    pub gyro_bias_walk_rad_s_sqrt_s: f64,
    /// Bias at the start [rad/s].
    pub gyro_bias_sigma_rad_s: f64,
    /// Of each direction sensor, in the order of [`Sample::vectors`] \[rad\], > 0; the last stands for all further ones.
    pub direction_sigma_rad: Vec<f64>,
}

impl Default for DirectionParameters {
    /// A MEMS gyro and sensors of a degree.
    fn default() -> Self {
        Self {
            gyro_noise_rad_s_sqrt_hz: 3e-4,
            gyro_bias_walk_rad_s_sqrt_s: 3e-5,
            gyro_bias_sigma_rad_s: 0.02,
            direction_sigma_rad: vec![1_f64.to_radians()],
        }
    }
}

/// A direction that waits for a second one: turned into the current body axes as the gyro goes on.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Waiting {
    sensor: usize,
    body: Unit<Vector3<f64>>,
    reference_w: Unit<Vector3<f64>>,
    sigma_rad: f64,
    samples: u32,
}

/// The filter: a pure state machine, `Clone` is the save and the restore.
#[derive(Clone, Debug, PartialEq)]
pub struct DirectionFilter {
    parameters: DirectionParameters,
    previous: Option<(i64, Vector3<f64>)>,
    /// Usual interval between samples of the gyro; 0: none yet \[s\].
    usual_s: f64,
    q_world_body: Option<UnitQuaternion<f64>>,
    bias_rad_s: Vector3<f64>,
    covariance: Matrix6<f64>,
    waiting: Option<Waiting>,
    refusals: u32,
    clipping: Clipping,
}

impl DirectionFilter {
    /// A filter without an attitude.
    #[must_use]
    pub fn new(parameters: DirectionParameters) -> Self {
        let mut covariance = Matrix6::zeros();
        let variance = parameters.gyro_bias_sigma_rad_s.powi(2);
        covariance.fixed_view_mut::<3, 3>(3, 3).fill_diagonal(variance);
        Self {
            parameters,
            previous: None,
            usual_s: 0.0,
            q_world_body: None,
            bias_rad_s: Vector3::zeros(),
            covariance,
            waiting: None,
            refusals: 0,
            clipping: Clipping::default(),
        }
    }

    /// Samples at the end of the gyro's range.
    #[must_use]
    pub fn clipping(&self) -> &Clipping {
        &self.clipping
    }

    fn sigma_rad(&self, sensor: usize) -> f64 {
        let all = &self.parameters.direction_sigma_rad;
        all.get(sensor).or(all.last()).copied().unwrap_or(0.02)
    }

    fn forget_attitude(&mut self) {
        self.q_world_body = None;
        self.waiting = None;
        self.refusals = 0;
        self.covariance.fixed_view_mut::<3, 6>(0, 0).fill(0.0);
        self.covariance.fixed_view_mut::<3, 3>(3, 0).fill(0.0);
    }

    fn grow_bias(&mut self, dt_s: f64) {
        let walk = self.parameters.gyro_bias_walk_rad_s_sqrt_s.powi(2) * dt_s;
        for axis in 3..6 {
            self.covariance[(axis, axis)] += walk;
        }
    }

    fn propagate(&mut self, dt_s: f64, rate_rad_s: &Vector3<f64>) {
        let turn = (rate_rad_s - self.bias_rad_s) * dt_s;
        let step = quaternion_exp(&turn);
        if let Some(waiting) = &mut self.waiting {
            waiting.body = Unit::new_normalize(step.inverse() * waiting.body.into_inner());
            waiting.samples += 1;
            // The gyro's own noise and bias meanwhile.
            let bias = self.parameters.gyro_bias_sigma_rad_s * dt_s;
            waiting.sigma_rad = waiting.sigma_rad.hypot(bias);
            if waiting.samples > WAITS {
                self.waiting = None;
            }
        }
        let Some(q) = &mut self.q_world_body else {
            self.grow_bias(dt_s);
            return;
        };
        *q *= step;
        q.renormalize_fast();
        let back: Matrix3<f64> = *step.inverse().to_rotation_matrix().matrix();
        // Integral of exp(-[w] s) over the interval, to third order of the turn.
        let cross = skew(&turn);
        let integral = (Matrix3::identity() - cross * 0.5 + cross * cross / 6.0) * dt_s;
        let mut f = Matrix6::identity();
        f.fixed_view_mut::<3, 3>(0, 0).copy_from(&back);
        f.fixed_view_mut::<3, 3>(0, 3).copy_from(&-integral);
        let p = &self.parameters;
        let (noise, walk) = (p.gyro_noise_rad_s_sqrt_hz.powi(2), p.gyro_bias_walk_rad_s_sqrt_s.powi(2));
        let mut q_noise = Matrix6::zeros();
        for axis in 0..3 {
            q_noise[(axis, axis)] = noise * dt_s + walk * dt_s.powi(3) / 3.0;
            q_noise[(axis, axis + 3)] = -walk * dt_s * dt_s / 2.0;
            q_noise[(axis + 3, axis)] = q_noise[(axis, axis + 3)];
            q_noise[(axis + 3, axis + 3)] = walk * dt_s;
        }
        covariance::propagate(&mut self.covariance, &f, &q_noise);
    }

    /// The first attitude from two directions.
    fn start(&mut self, sensor: usize, body: Unit<Vector3<f64>>, reference_w: Unit<Vector3<f64>>) {
        let sigma_rad = self.sigma_rad(sensor);
        let now = Waiting { sensor, body, reference_w, sigma_rad, samples: 0 };
        let Some(first) = self.waiting else {
            self.waiting = Some(now);
            return;
        };
        let apart =
            |a: &Unit<Vector3<f64>>, b: &Unit<Vector3<f64>>| a.cross(b).norm() > LEAST_ANGLE_RAD.sin();
        if !apart(&first.body, &now.body) || !apart(&first.reference_w, &now.reference_w) {
            // The younger of two that are one.
            self.waiting = Some(now);
            return;
        }
        // The better of both is met exactly, the other in its plane.
        let (a, b) = if first.sigma_rad <= now.sigma_rad { (first, now) } else { (now, first) };
        let Ok(q) = attitude_from_two_vectors(&a.body, &a.reference_w, &b.body, &b.reference_w) else {
            return;
        };
        // Information of both directions: sum of (1 - u u^T) / sigma^2.
        let information = [a, b].iter().fold(Matrix3::zeros(), |sum, w| {
            let u = w.body.into_inner();
            sum + (Matrix3::identity() - u * u.transpose()) / w.sigma_rad.powi(2)
        });
        let Some(attitude) = information.try_inverse() else { return };
        self.q_world_body = Some(q);
        self.covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&attitude);
        self.waiting = None;
    }

    fn update(&mut self, sensor: usize, body: &Unit<Vector3<f64>>, reference_w: &Unit<Vector3<f64>>) {
        let Some(q) = self.q_world_body else { return };
        let predicted = q.inverse() * reference_w.into_inner();
        let mut h = SMatrix::<f64, 3, 6>::zeros();
        h.fixed_view_mut::<3, 3>(0, 0).copy_from(&skew(&predicted));
        let r = Matrix3::identity() * self.sigma_rad(sensor).powi(2);
        let innovation = body.into_inner() - predicted;
        let Some(update) = covariance::update(&mut self.covariance, &h, &r, &innovation, |nis| nis < GATE)
        else {
            self.refusals += 1;
            if self.refusals >= REFUSALS {
                self.forget_attitude();
            }
            return;
        };
        self.refusals = 0;
        covariance::symmetrise(&mut self.covariance);
        let theta = Vector3::from(update.correction.fixed_rows::<3>(0));
        self.q_world_body = Some(q * quaternion_exp(&theta));
        self.bias_rad_s += Vector3::from(update.correction.fixed_rows::<3>(3));
    }
}

impl OrientationFilter for DirectionFilter {
    const IS_COMPLETE: bool = true;
    const INTERVAL_MEANS: bool = false;

    fn on_imu(&mut self, stamp_ns: i64, sample: &Sample) {
        let gyro = sample.gyro_rad_s;
        if !gyro.sum().is_finite() {
            return;
        }
        let Some((before_ns, before)) = self.previous else {
            self.previous = Some((stamp_ns, gyro));
            return;
        };
        let dt_s = stamp_ns.saturating_sub(before_ns) as f64 * 1e-9;
        if dt_s <= 0.0 {
            return;
        }
        self.previous = Some((stamp_ns, gyro));
        if self.usual_s > 0.0 && dt_s > (GAP_INTERVALS * self.usual_s).max(GAP_S) {
            self.forget_attitude();
            self.grow_bias(dt_s);
            return;
        }
        self.propagate(dt_s, &((before + gyro) * 0.5));
        if let Some(variance) = self.clipping.add(dt_s, &gyro) {
            for axis in 0..3 {
                self.covariance[(axis, axis)] += variance[axis];
            }
        }
        if self.usual_s > 0.0 && dt_s > 2.0 * self.usual_s {
            let unknown = (gyro - before).norm_squared() * dt_s * dt_s / 4.0;
            for axis in 0..3 {
                self.covariance[(axis, axis)] += unknown;
            }
        } else {
            self.usual_s += (dt_s - self.usual_s) * if self.usual_s > 0.0 { 0.1 } else { 1.0 };
        }
    }

    fn on_vector(&mut self, sensor: usize, seen: &Observed) {
        let Some(body) = Unit::try_new(seen.body, 1e-12).filter(|u| u.sum().is_finite()) else { return };
        let Some(reference_w) = seen.reference_w else { return };
        if self.q_world_body.is_none() {
            self.start(sensor, body, reference_w);
        } else {
            self.update(sensor, &body, &reference_w);
        }
    }

    fn orientation(&self) -> Option<Orientation> {
        self.q_world_body.map(|q_world_body| Orientation {
            q_world_body,
            gyro_bias_rad_s: self.bias_rad_s,
            covariance: self.covariance,
        })
    }
}
