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
use crate::refusal::{Needs, Refusal, check};
use crate::smoothing::{back, smooth};

/// Averaging time of gyro samples \[s\].
const BIN_S: f64 = 0.1;
/// Candidate intensities: angular acceleration per root second [rad/s^2/sqrt(s)].
const INTENSITIES: [f64; 11] = [1e-7, 3e-7, 1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2];
/// Prior standard deviation of the acceleration at the start [rad/s^2].
const FIRST_ACCELERATION: f64 = 0.05;
/// Requirements on a recording: a platform that is free to move, for a few seconds.
const NEEDS: Needs = Needs { shortest_s: 5.0, free: true, accelerometer: false };

/// Unexplained torque over time, and the motion along which it acted.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ResidualTorque {
    /// Time since the start of the run \[s\], increasing.
    pub time_s: Vec<f64>,
    /// Residual torque, body axes [N m].
    pub torque_b_n_m: Vec<Vector3<f64>>,
    /// Its standard deviation from noise, body axes [N m], > 0.
    pub stddev_b_n_m: Vec<Vector3<f64>>,
    /// Attitude, v_world = q v_body.
    pub q_world_body: Vec<UnitQuaternion<f64>>,
    /// Smoothed rate, body axes [rad/s].
    pub omega_wb_b_rad_s: Vec<Vector3<f64>>,
}

/// Estimates the torque that `model` does not explain from a recording of a free platform, ten times per second.
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
    let Some(bins) = Bins::new(&left.time_s, BIN_S) else { return Ok(ResidualTorque::default()) };
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
    let inertia = gyrostat.resisting_inertia_b_kg_m2();
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
        let tilt = if tilt_stddev_rad.is_finite() { lever * tilt_stddev_rad } else { Vector3::zeros() };
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
    let best = INTENSITIES
        .iter()
        .map(|q| (filtered(time_s, value, noise, *q).1, *q))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map_or(INTENSITIES[0], |(_, q)| q);
    smoothed(&filtered(time_s, value, noise, best).0)
}

/// A step of the filter: (residual rate, acceleration) before and after its measurement, with the transition.
struct Step {
    predicted: (Vector2<f64>, Matrix2<f64>),
    updated: (Vector2<f64>, Matrix2<f64>),
    transition: Matrix2<f64>,
}

/// Filter steps and log likelihood.
fn filtered(time_s: &[f64], value: &[f64], noise: &[f64], intensity: f64) -> (Vec<Step>, f64) {
    let mut x = Vector2::new(value.first().copied().unwrap_or(0.0), 0.0);
    let mut p = Matrix2::new(1.0, 0.0, 0.0, FIRST_ACCELERATION.powi(2));
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
