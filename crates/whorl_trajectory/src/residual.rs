//! The unexplained torque of a model, smoothed from a whole recording.
//!
//! The measured change of rate minus the predicted one is the integral of the missing angular acceleration
//! plus white noise, so no noisy rate is differentiated. The acceleration is modelled as a random walk
//! (N. R. Kristensen, H. Madsen and S. B. Jorgensen, A method for systematic improvement of stochastic
//! grey-box models, Comp. Chem. Eng. 28, 2004), each body axis by itself, with the maximum-likelihood
//! intensity.

use nalgebra::{Matrix2, UnitQuaternion, Vector2, Vector3};
use whorl_dynamics::{Gyrostat, PlatformModel};
use whorl_recording::Recording;

use crate::bins::{Bins, Mean3};
use crate::commands::Commands;
use crate::noise::typical_step_s;
use crate::refusal::{Needs, Refusal, check};
use crate::smoothing::{back, smooth};

/// Averaging time of gyro samples \[s\], and of fast ones so many of them.
const BIN_S: f64 = 0.1;
const BIN_SAMPLES: f64 = 10.0;
/// Candidate intensities by decade, and between two decades: angular acceleration per root second [rad/s^2/sqrt(s)].
const DECADES: std::ops::RangeInclusive<i32> = -7..=3;
const BETWEEN: [f64; 2] = [1.0, 3.0];
/// Least prior standard deviation of the acceleration at the start [rad/s^2]; that of the data, if they change faster.
const FIRST_ACCELERATION: f64 = 0.05;
/// Requirements on a recording: a platform that can move.
const NEEDS: Needs = Needs { shortest_s: 0.0, free: true, accelerometer: false };

/// Unexplained torque over time, and the motion along which it acted.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ResidualTorque {
    /// Time since the start of the run \[s\], increasing.
    pub time_s: Vec<f64>,
    /// Residual torque, body axes [N m].
    pub torque_b_n_m: Vec<Vector3<f64>>,
    /// Its standard deviation from noise, body axes [N m]; zero on an axis about which the rig holds the body.
    pub stddev_b_n_m: Vec<Vector3<f64>>,
    /// Attitude, v_world = q v_body.
    pub q_world_body: Vec<UnitQuaternion<f64>>,
    /// Smoothed rate, body axes [rad/s].
    pub omega_wb_b_rad_s: Vec<Vector3<f64>>,
}

/// Estimates the torque that `model` does not explain from a recording of a free platform, ten times per second or every ten samples.
///
/// The model is not refitted: the error of a wrong inertia counts as torque unless the platform's own parameters were
/// refitted to the run before.
///
/// # Errors
/// As [`check`].
pub fn residual_torque(recording: &Recording, model: &PlatformModel) -> Result<ResidualTorque, Refusal> {
    check(recording, model, &NEEDS)?;
    let gyrostat = Gyrostat::new(model)?;
    let commands = Commands::of(recording, &gyrostat);
    let motion = smooth(recording, &gyrostat, &commands);
    let left = motion.rate_left();
    let bin_s = BIN_S.min(1.001 * BIN_SAMPLES * typical_step_s(&left.time_s));
    let Some(bins) = Bins::new(&left.time_s, bin_s) else { return Ok(ResidualTorque::default()) };
    let means = bins.means(left, 0.0);
    let filled = bins.times.node_s.iter().copied().zip(means).filter(|(_, mean)| mean.count > 0.0);
    let (time_s, means): (Vec<f64>, Vec<Mean3>) = filled.unzip();
    let one_sample = gyrostat.model().sensors.gyro.errors.one_sample_stddev();
    let axes = [0, 1, 2].map(|i| {
        let sigma = one_sample[i].max(1e-9);
        let values: Vec<f64> = means.iter().map(|mean| mean.value[i]).collect();
        let noise: Vec<f64> = means.iter().map(|mean| sigma / mean.count.sqrt()).collect();
        most_likely(&time_s, &values, &noise)
    });
    // Of a rig with fewer axes: what resists about those.
    let free = gyrostat.model().freedom.projection();
    let inertia = free * gyrostat.resisting_inertia_b_kg_m2() * free;
    let at = |axis: &[(f64, f64)], k: usize| axis.get(k).copied().unwrap_or((0.0, f64::INFINITY));
    let weight = gyrostat.model().mass_properties.gravity_offset_b_n_m();
    let tilt_stddev_rad = motion.attitude.tilt_stddev_rad;
    let mut torque = ResidualTorque::default();
    for (k, t) in time_s.iter().enumerate() {
        let of = |f: fn((f64, f64)) -> f64| Vector3::from_fn(|i, _| f(at(&axes[i], k)));
        let (acceleration, stddev) = (of(|x| x.0), of(|x| x.1));
        let now = motion.at(*t);
        // The uncertainty of tilt (accelerometer bias) is an uncertainty of the gravity torque.
        let up = whorl_math::vertical_b(&now.q_world_body);
        let lever =
            weight.cross(&up.cross(&Vector3::x())).abs() + weight.cross(&up.cross(&Vector3::y())).abs();
        let tilt =
            if tilt_stddev_rad.is_finite() { free.abs() * lever * tilt_stddev_rad } else { Vector3::zeros() };
        let squares =
            inertia.component_mul(&inertia) * stddev.component_mul(&stddev) + tilt.component_mul(&tilt);
        torque.time_s.push(*t);
        torque.torque_b_n_m.push(inertia * acceleration);
        torque.stddev_b_n_m.push(squares.map(f64::sqrt));
        torque.q_world_body.push(now.q_world_body);
        torque.omega_wb_b_rad_s.push(now.omega_wb_b_rad_s);
    }
    Ok(torque)
}

/// Acceleration and its standard deviation at each time, with the most likely intensity.
fn most_likely(time_s: &[f64], value: &[f64], noise: &[f64]) -> Vec<(f64, f64)> {
    let candidates = DECADES.flat_map(|power| BETWEEN.map(|share| share * 10f64.powi(power)));
    let judged = candidates.map(|q| (filtered(time_s, value, noise, q).1, q));
    let likeliest =
        judged.filter(|(likelihood, _)| likelihood.is_finite()).max_by(|a, b| a.0.total_cmp(&b.0));
    let best = likeliest.map_or(1e-7, |(_, q)| q);
    smoothed(&filtered(time_s, value, noise, best).0)
}

/// A step of the filter: (residual rate, acceleration) before and after its measurement, with the transition.
struct Step {
    predicted: (Vector2<f64>, Matrix2<f64>),
    updated: (Vector2<f64>, Matrix2<f64>),
    transition: Matrix2<f64>,
}

/// Values over which a change is taken: between neighbours most of it is noise.
const APART: usize = 10;

/// Root mean square of the change per second.
fn typical_change(time_s: &[f64], value: &[f64]) -> f64 {
    let later = time_s.iter().skip(APART).zip(value.iter().skip(APART));
    let slopes = time_s.iter().zip(value).zip(later).map(|((t0, y0), (t1, y1))| (y1 - y0) / (t1 - t0));
    let (squares, count) = slopes.fold((0.0, 0usize), |(sum, n), slope| (sum + slope * slope, n + 1));
    (squares / count.max(1) as f64).sqrt()
}

/// Filter steps and log likelihood.
fn filtered(time_s: &[f64], value: &[f64], noise: &[f64], intensity: f64) -> (Vec<Step>, f64) {
    let mut x = Vector2::new(value.first().copied().unwrap_or(0.0), 0.0);
    let mut p = Matrix2::new(1.0, 0.0, 0.0, FIRST_ACCELERATION.max(typical_change(time_s, value)).powi(2));
    let mut before = time_s.first().copied().unwrap_or(0.0);
    let mut log_likelihood = 0.0;
    let mut steps = Vec::with_capacity(time_s.len());
    for (k, ((t, y), sigma)) in time_s.iter().zip(value).zip(noise).enumerate() {
        let dt = t - before;
        before = *t;
        let transition = Matrix2::new(1.0, dt, 0.0, 1.0);
        let q = intensity * intensity;
        x = transition * x;
        p = transition * p * transition.transpose()
            + Matrix2::new(q * dt.powi(3) / 3.0, q * dt * dt / 2.0, q * dt * dt / 2.0, q * dt);
        let predicted = (x, p);
        let variance = p[(0, 0)] + sigma * sigma;
        let innovation = y - x[0];
        if k > 0 {
            log_likelihood -= 0.5 * (innovation * innovation / variance + variance.ln());
        }
        let gain = p.column(0) / variance;
        x += gain * innovation;
        p -= gain * p.row(0);
        p = (p + p.transpose()) * 0.5;
        steps.push(Step { predicted, updated: (x, p), transition });
    }
    (steps, log_likelihood)
}

/// Rauch-Tung-Striebel backward pass: acceleration and standard deviation.
fn smoothed(steps: &[Step]) -> Vec<(f64, f64)> {
    let Some(last) = steps.last() else { return Vec::new() };
    let (mut x, mut p) = last.updated;
    let mut found = vec![(x[1], p[(1, 1)].max(0.0).sqrt())];
    for (step, next) in steps.iter().zip(steps.iter().skip(1)).rev() {
        let (mean, covariance) = step.updated;
        (x, p) = match back(&covariance, &next.transition, &next.predicted.1, &p) {
            Some((gain, smoothed)) => (mean + gain * (x - next.predicted.0), smoothed),
            None => (mean, covariance),
        };
        found.push((x[1], p[(1, 1)].max(0.0).sqrt()));
    }
    found.reverse();
    found
}
