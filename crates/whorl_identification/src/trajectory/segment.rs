//! One stretch between two states: its measurements, and the motion integrated to the next state.

use nalgebra::{DMatrix, DVector, SMatrix, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_math::{attitude_error, quaternion_exp};

use super::dynamics::{Motion, Physics};
use super::smoother::{CrossMatrix, STATE, StateMatrix, StateVector};
use super::unknowns::Unknowns;
use crate::data::AveragedSample;

/// Differences for derivatives by the state, small against its uncertainty.
const DIFFERENCE: f64 = 1e-6;
/// Residuals beyond this many standard deviations are left out once the fit is near.
const OUTLIER: f64 = 6.0;

/// A state: motion and sensor biases.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Node {
    pub motion: Motion,
    pub gyro_bias_rad_s: Vector3<f64>,
    pub accelerometer_bias_m_s2: Vector3<f64>,
}

impl Node {
    /// This state moved by a change in the order of the state vector.
    pub fn moved(&self, change: &StateVector, share: f64) -> Self {
        let part = |at: usize| Vector3::new(change[at], change[at + 1], change[at + 2]) * share;
        Self {
            motion: Motion {
                q_world_body: self.motion.q_world_body * quaternion_exp(&part(0)),
                omega_wb_b_rad_s: self.motion.omega_wb_b_rad_s + part(3),
            },
            gyro_bias_rad_s: self.gyro_bias_rad_s + part(6),
            accelerometer_bias_m_s2: self.accelerometer_bias_m_s2 + part(9),
        }
    }
}

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

/// What the measurements of a stretch say.
pub(crate) struct SegmentFit {
    /// Over state and unknowns.
    pub normal: DMatrix<f64>,
    pub right: DVector<f64>,
    /// Sum of squared residuals over their variances.
    pub cost: f64,
    /// Residuals counted.
    pub residuals: f64,
    /// Residuals left out as outliers.
    pub outliers: usize,
    /// Motion at the end.
    pub end: Motion,
    /// Derivative of the end's (attitude, rate) by the state.
    pub transition: StateMatrix,
    /// The same by the unknowns.
    pub by_unknowns: CrossMatrix,
}

/// The motion at each point that belongs to the stretch, and at its end.
fn carry(physics: &Physics, start: &Motion, points: &[AveragedSample], own: usize) -> Vec<Motion> {
    let mut motions = Vec::with_capacity(points.len());
    let mut motion = *start;
    motions.push(motion);
    for (at, next) in points.iter().zip(points.iter().skip(1)) {
        motion = physics.step(&motion, at, next);
        motions.push(motion);
    }
    motions.truncate(own + 1);
    motions
}

/// Ideal readings at the stretch's own points, one after the other: gyro, accelerometer, directions.
fn readings(
    physics: &Physics,
    motions: &[Motion],
    points: &[AveragedSample],
    own: usize,
    out: &mut Vec<f64>,
) {
    out.clear();
    for (motion, point) in motions.iter().zip(points).take(own) {
        let imu = physics.imu(motion, point);
        out.extend(&imu.angular_velocity_b_rad_s);
        if point.specific_force_b_m_s2.is_some() {
            out.extend(&imu.specific_force_b_m_s2);
        }
        for d in &point.directions {
            out.extend(&physics.seen(motion, &d.reference_world));
        }
    }
}

/// Fits one stretch. `points` holds the stretch's `own` points and, when another stretch follows, the
/// first point of that one. With `derivatives` off only `cost` and `end` are filled.
pub(crate) fn fit_segment(
    (unknowns, noise): (&Unknowns, &Noise),
    physics: &Physics,
    perturbed: &[Physics],
    node: &Node,
    points: &[AveragedSample],
    own: usize,
    options: (bool, bool),
) -> SegmentFit {
    let (derivatives, reject) = options;
    let motions = carry(physics, &node.motion, points, own);
    let mut base = Vec::new();
    readings(physics, &motions, points, own, &mut base);
    let end = motions.last().copied().unwrap_or(node.motion);
    let columns = STATE + if derivatives { unknowns.len() } else { 0 };
    let mut jacobian = DMatrix::zeros(if derivatives { base.len() } else { 0 }, columns);
    let mut transition = StateMatrix::identity();
    let mut by_unknowns = CrossMatrix::zeros(if derivatives { unknowns.len() } else { 0 });
    if derivatives {
        let mut changed = Vec::new();
        let mut column = |at: usize, motions: &[Motion], physics: &Physics, jacobian: &mut DMatrix<f64>| {
            readings(physics, motions, points, own, &mut changed);
            let difference = at.checked_sub(STATE).map_or(DIFFERENCE, |n| unknowns.difference(n));
            for (row, (b, a)) in changed.iter().zip(&base).enumerate() {
                jacobian[(row, at)] = (b - a) / difference;
            }
            motions.last().map(|m| end_difference(&end, m) / difference)
        };
        for at in 0..6 {
            let mut change = StateVector::zeros();
            change[at] = DIFFERENCE;
            let moved = carry(physics, &node.moved(&change, 1.0).motion, points, own);
            if let Some(d) = column(at, &moved, physics, &mut jacobian) {
                transition.fixed_view_mut::<6, 1>(0, at).copy_from(&d);
            }
        }
        for (n, physics) in perturbed.iter().enumerate() {
            let moved = carry(physics, &node.motion, points, own);
            if let Some(d) = column(STATE + n, &moved, physics, &mut jacobian) {
                by_unknowns.fixed_view_mut::<6, 1>(0, n).copy_from(&d);
            }
        }
    }
    let mut fit = SegmentFit {
        normal: DMatrix::zeros(columns, columns),
        right: DVector::zeros(columns),
        cost: 0.0,
        residuals: 0.0,
        outliers: 0,
        end,
        transition,
        by_unknowns,
    };
    let mut weighted = jacobian.clone();
    let mut residual = DVector::zeros(jacobian.nrows());
    let mut row = 0;
    let mut group = |measured: &Vector3<f64>,
                     bias: Option<(usize, &Vector3<f64>)>,
                     variance: &Vector3<f64>,
                     freedom: f64,
                     fit: &mut SegmentFit| {
        let predicted = base.get(row..row + 3).map_or_else(Vector3::zeros, Vector3::from_column_slice);
        let r = measured - predicted - bias.map_or_else(Vector3::zeros, |(_, b)| *b);
        let squared = r.component_mul(&r).component_div(variance).sum();
        let outlier = reject && squared > OUTLIER.powi(2);
        if outlier {
            fit.outliers += 1;
        } else {
            fit.cost += squared;
            fit.residuals += freedom;
        }
        if derivatives {
            if let Some((at, _)) = bias {
                for axis in 0..3 {
                    jacobian[(row + axis, at + axis)] = 1.0;
                }
            }
            for axis in 0..3 {
                let w = if outlier { 0.0 } else { 1.0 / variance[axis] };
                residual[row + axis] = r[axis];
                for c in 0..columns {
                    weighted[(row + axis, c)] = jacobian[(row + axis, c)] * w;
                }
            }
        }
        row += 3;
    };
    for point in points.iter().take(own) {
        let gyro = noise.gyro / point.gyro_samples;
        group(&point.gyro_b_rad_s, Some((6, &node.gyro_bias_rad_s)), &gyro, 3.0, &mut fit);
        if let Some((force, samples)) = &point.specific_force_b_m_s2 {
            let variance = noise.accelerometer / *samples;
            group(force, Some((9, &node.accelerometer_bias_m_s2)), &variance, 3.0, &mut fit);
        }
        for d in &point.directions {
            // Of three components of a unit vector two are free.
            group(&d.direction_b, None, &Vector3::repeat(noise.direction), 2.0, &mut fit);
        }
    }
    if derivatives {
        fit.normal = jacobian.tr_mul(&weighted);
        fit.right = weighted.tr_mul(&residual);
    }
    fit
}

/// Difference of two motions: rotation vector and rate.
pub(crate) fn end_difference(from: &Motion, to: &Motion) -> SMatrix<f64, 6, 1> {
    let turn = attitude_error(&from.q_world_body, &to.q_world_body);
    let rate = to.omega_wb_b_rad_s - from.omega_wb_b_rad_s;
    SMatrix::<f64, 6, 1>::new(turn.x, turn.y, turn.z, rate.x, rate.y, rate.z)
}

/// Perturbed platforms, one for each unknown; `None` if one is not possible.
pub(crate) fn perturbed(unknowns: &Unknowns, values: &DVector<f64>) -> Option<Vec<Physics>> {
    (0..unknowns.len())
        .map(|n| {
            let mut changed = values.clone();
            changed[n] += unknowns.difference(n);
            Physics::new(unknowns, &changed)
        })
        .collect()
}
