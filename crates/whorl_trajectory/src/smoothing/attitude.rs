//! Attitude and biases by a forward filter and a backward smoother, gyro-driven.
//!
//! Error state: rotation (body axes), gyro bias, accelerometer bias. The backward pass is a Rauch-Tung-Striebel smoother
//! on the error state. Nodes lie a fifth of a second apart; each takes the mean of the samples around it.

use nalgebra::{Matrix3, SMatrix, SVector, Unit, UnitQuaternion, Vector3};
use whorl_dynamics::platform::TiltLimit;
use whorl_dynamics::{Freedom, PlatformModel};
use whorl_math::covariance;
use whorl_math::{
    GRAVITY_M_S2, attitude_from_two_vectors, quaternion_exp, rotation_vector, skew, unit_or, vertical_b,
};
use whorl_recording::Recording;

use super::backward::back;
use super::sensors::{NODE_S, Sensors, one_sample, rate_between};
use super::start::start_attitude;
use crate::noise::typical_step_s;

/// A gap between gyro samples beyond this, and beyond so many usual steps, adds uncertainty \[s\].
const GAP_S: f64 = 0.05;
const GAP_STEPS: f64 = 4.0;
/// Standard deviation of what a rig does not allow, instead of zero [rad], [rad/s]: covariances stay regular.
const NOTHING: f64 = 1e-9;
/// Without an accelerometer, tilt is modelled as a random process about balance with this correlation time \[s\].
const BALANCE_S: f64 = 20.0;

type Matrix9 = SMatrix<f64, 9, 9>;
type Vector9 = SVector<f64, 9>;

/// Smoothed attitude and biases.
#[derive(Debug, Clone, PartialEq)]
pub struct Attitudes {
    /// Nodes \[s\].
    time_s: Vec<f64>,
    q_world_body: Vec<UnitQuaternion<f64>>,
    bias_rad_s: Vec<Vector3<f64>>,
    /// Rates corrected for the model's gyro errors but not for the bias, at `rate_time_s` [rad/s].
    rate_rad_s: Vec<Vector3<f64>>,
    rate_time_s: Vec<f64>,
    /// Gyro bias beyond the model's, mean of the run [rad/s].
    pub gyro_bias_rad_s: Vector3<f64>,
    /// Accelerometer bias beyond the model's [m/s^2].
    pub accelerometer_bias_m_s2: Vector3<f64>,
    /// Standard deviation of the tilt, typical of the run \[rad\].
    pub tilt_stddev_rad: f64,
    /// Whether heading was measured, by a vector sensor; if not it starts at zero and follows the gyro.
    pub heading_measured: bool,
    /// Whether tilt was measured; if not, the platform is assumed to stay near balance.
    pub tilt_measured: bool,
}

impl Attitudes {
    /// Attitude at any time: from the previous node, integrating the gyro.
    #[must_use]
    pub fn at(&self, time_s: f64) -> UnitQuaternion<f64> {
        let after = self.time_s.partition_point(|t| *t <= time_s);
        let node = after.saturating_sub(1);
        let (Some(t0), Some(q0), Some(bias)) =
            (self.time_s.get(node), self.q_world_body.get(node), self.bias_rad_s.get(node))
        else {
            return UnitQuaternion::identity();
        };
        let turn = turn_between(&self.rate_time_s, &self.rate_rad_s, bias, *t0, time_s);
        q0 * turn
    }

    /// Gyro bias beyond the model's at a time [rad/s].
    #[must_use]
    pub fn gyro_bias_at(&self, time_s: f64) -> Vector3<f64> {
        let node = self.time_s.partition_point(|t| *t <= time_s).saturating_sub(1);
        self.bias_rad_s.get(node).copied().unwrap_or_default()
    }

    /// Measured rates corrected for the model's gyro errors and the bias, at their (latency-free) times.
    pub fn rates(&self) -> impl Iterator<Item = (f64, Vector3<f64>)> + '_ {
        let raw = self.rate_time_s.iter().zip(&self.rate_rad_s);
        raw.map(|(t, rate)| (*t, rate - self.gyro_bias_at(*t)))
    }
}

/// Rotation from the body at `from_s` to the body at `to_s` (either may be later).
fn turn_between(
    times_s: &[f64],
    rates_rad_s: &[Vector3<f64>],
    bias_rad_s: &Vector3<f64>,
    from_s: f64,
    to_s: f64,
) -> UnitQuaternion<f64> {
    if to_s < from_s {
        return turn_between(times_s, rates_rad_s, bias_rad_s, to_s, from_s).inverse();
    }
    let mut turn = UnitQuaternion::identity();
    let mut now = from_s;
    let mut k = times_s.partition_point(|t| *t <= from_s);
    while now < to_s {
        let end = times_s.get(k).copied().unwrap_or(f64::INFINITY).min(to_s);
        let rate = rate_between(times_s, rates_rad_s, k, 0.5 * (now + end));
        turn *= quaternion_exp(&((rate - bias_rad_s) * (end - now)));
        now = end;
        k += 1;
    }
    turn
}

/// Smooths attitude and biases; `model` is the platform with its effects applied. With no gyro samples the
/// result is empty.
#[must_use]
pub fn smooth_attitude(recording: &Recording, model: &PlatformModel) -> Attitudes {
    let sensors = Sensors::new(recording, model);
    let mut result = Attitudes {
        time_s: Vec::new(),
        q_world_body: Vec::new(),
        bias_rad_s: Vec::new(),
        rate_rad_s: Vec::new(),
        rate_time_s: Vec::new(),
        gyro_bias_rad_s: Vector3::zeros(),
        accelerometer_bias_m_s2: Vector3::zeros(),
        tilt_stddev_rad: f64::NAN,
        heading_measured: sensors
            .vectors
            .iter()
            .any(|v| !v.time_s.is_empty() && v.reference_world.z.abs() < 0.99),
        tilt_measured: model.freedom.has_weight() && !sensors.force.0.is_empty()
            || sensors.vectors.iter().any(|v| !v.time_s.is_empty()),
    };
    let (Some(first), Some(last)) = (sensors.gyro.0.first().copied(), sensors.gyro.0.last().copied()) else {
        return result;
    };
    let count = ((last - first) / NODE_S).floor().max(0.0) as usize + 1;
    let times: Vec<f64> = (0..count).map(|k| first + NODE_S * k as f64).collect();
    let filtered = forward(&sensors, &times, result.heading_measured, result.tilt_measured);
    let smoothed = backward(&filtered);
    let mean = |f: &dyn Fn(&Node) -> Vector3<f64>| {
        smoothed.iter().map(f).sum::<Vector3<f64>>() / smoothed.len().max(1) as f64
    };
    result.gyro_bias_rad_s = mean(&|n| n.bias) + bias_across(recording, model);
    result.accelerometer_bias_m_s2 = mean(&|n| n.force_bias);
    let tilt_variance: f64 = smoothed.iter().map(|n| 0.5 * (n.p[(0, 0)] + n.p[(1, 1)])).sum();
    result.tilt_stddev_rad = (tilt_variance / smoothed.len().max(1) as f64).sqrt();
    result.q_world_body = smoothed.iter().map(|n| n.q).collect();
    result.bias_rad_s = smoothed.iter().map(|n| n.bias).collect();
    result.time_s = times;
    (result.rate_time_s, result.rate_rad_s) = sensors.gyro;
    result
}

/// What the gyro reads about axes that the rig holds [rad/s]: nothing but bias.
fn bias_across(recording: &Recording, model: &PlatformModel) -> Vector3<f64> {
    let rates = &recording.gyro_b_rad_s.value;
    if model.freedom.axes() == 3 || !recording.has_whole_gyro() || rates.is_empty() {
        return Vector3::zeros();
    }
    let errors = &model.sensors.gyro.errors;
    let mean = rates.iter().map(|y| errors.corrected(y)).sum::<Vector3<f64>>() / rates.len() as f64;
    mean - model.freedom.share(&mean)
}

/// State and covariance at a node.
#[derive(Debug, Clone, Copy)]
struct Node {
    q: UnitQuaternion<f64>,
    bias: Vector3<f64>,
    force_bias: Vector3<f64>,
    p: Matrix9,
}

impl Node {
    fn moved(mut self, dx: &Vector9) -> Self {
        self.q *= quaternion_exp(&Vector3::new(dx[0], dx[1], dx[2]));
        self.bias += Vector3::new(dx[3], dx[4], dx[5]);
        self.force_bias += Vector3::new(dx[6], dx[7], dx[8]);
        self
    }

    /// The error state from here to `other`.
    fn to(&self, other: &Self) -> Vector9 {
        let turn = rotation_vector(&(self.q.inverse() * other.q));
        let (bias, force) = (other.bias - self.bias, other.force_bias - self.force_bias);
        Vector9::from_row_slice(&[turn.x, turn.y, turn.z, bias.x, bias.y, bias.z, force.x, force.y, force.z])
    }
}

/// A node before and after its measurements, with the transition from the node before.
struct Step {
    predicted: Node,
    updated: Node,
    transition: Matrix9,
}

/// The attitude at the first node by the first readings of two vector sensors, turned back by the gyro; with one sensor
/// the rest is as level as it allows. `None` without a direction.
fn by_directions(sensors: &Sensors<'_>, time_s: f64) -> Option<UnitQuaternion<f64>> {
    let zero = Vector3::zeros();
    let mut first = (0..sensors.vectors.len()).filter_map(|j| {
        let seen_s = *sensors.vectors.get(j)?.time_s.first()?;
        let (direction_b, reference, _) = sensors.direction(j, seen_s, &zero)?;
        let turn = turn_between(&sensors.gyro.0, &sensors.gyro.1, &zero, time_s, seen_s);
        Some((Unit::try_new(turn * direction_b, 1e-9)?, reference))
    });
    let (a_b, a_w) = first.next()?;
    let two = first.next().and_then(|(b_b, b_w)| attitude_from_two_vectors(&a_b, &a_w, &b_b, &b_w).ok());
    // The sensor's direction holds exactly: what is left of the vertical only fills the turn about it.
    let up = Vector3::z_axis();
    two.or_else(|| attitude_from_two_vectors(&a_b, &a_w, &up, &up).ok())
        .or_else(|| UnitQuaternion::rotation_between(&a_b, &a_w))
}

fn first_node(sensors: &Sensors<'_>, time_s: f64, heading: bool, tilt: bool) -> Node {
    let zero = Vector3::zeros();
    // The first second, node by node.
    let nodes: Vec<f64> = (0..5).map(|k| time_s + NODE_S * f64::from(k)).collect();
    let down = nodes.iter().filter_map(|t| sensors.gravity(*t, &zero)).map(|(g, _)| g).sum::<Vector3<f64>>();
    let seen = (0..sensors.vectors.len()).find_map(|j| {
        nodes.iter().find_map(|t| sensors.direction(j, *t, &zero)).map(|(d, reference, _)| (d, reference))
    });
    let (balanced, tilt_stddev_rad) = balance(sensors.model);
    let freedom = &sensors.model.freedom;
    let by_directions = match freedom {
        Freedom::OnBearing => None,
        _ if down != zero => None,
        _ => by_directions(sensors, time_s),
    };
    let start = by_directions.unwrap_or_else(|| start_attitude(unit_or(down, balanced), seen));
    let errors = &sensors.model.sensors;
    let mut p = Matrix9::zeros();
    let up = vertical_b(&start);
    let heading_variance: f64 = if heading { 0.1 } else { 1e-8 };
    let tilt_variance: f64 = if tilt { 0.01 } else { tilt_stddev_rad * tilt_stddev_rad };
    let about_vertical = up * up.transpose();
    p.fixed_view_mut::<3, 3>(0, 0).copy_from(
        &(about_vertical * heading_variance + (Matrix3::identity() - about_vertical) * tilt_variance),
    );
    let bias = errors.gyro.errors.bias_turn_on_stddev.map(|s| s.max(1e-5).powi(2));
    p.fixed_view_mut::<3, 3>(3, 3).copy_from(&allowed(freedom, &Matrix3::from_diagonal(&bias)));
    for i in 0..3 {
        p[(6 + i, 6 + i)] = errors.accelerometer.errors.bias_turn_on_stddev[i].max(1e-5).powi(2);
    }
    Node { q: start, bias: zero, force_bias: zero, p }
}

/// The part of a covariance along the axes that are free, and next to nothing along the others.
fn allowed(freedom: &Freedom, covariance: &Matrix3<f64>) -> Matrix3<f64> {
    if freedom.axes() == 3 {
        return *covariance;
    }
    let along = freedom.projection();
    along * covariance * along + (Matrix3::identity() - along) * NOTHING.powi(2)
}

fn forward(sensors: &Sensors<'_>, times: &[f64], heading: bool, tilt: bool) -> Vec<Step> {
    let Some(first) = times.first() else { return Vec::new() };
    let mut steps = Vec::with_capacity(times.len());
    let mut node = first_node(sensors, *first, heading, tilt);
    let mut before = *first;
    let errors = &sensors.model.sensors;
    let sample_s = 1.0 / errors.rate_hz.max(1e-3);
    let noise = one_sample(&errors.gyro.errors).powi(2) * sample_s;
    let freedom = &sensors.model.freedom;
    let longest_s = GAP_S.max(GAP_STEPS * typical_step_s(&sensors.gyro.0));
    for &time_s in times {
        let dt_s = time_s - before;
        let mut transition = Matrix9::identity();
        if dt_s > 0.0 {
            let turn = turn_between(&sensors.gyro.0, &sensors.gyro.1, &node.bias, before, time_s);
            let back = turn.inverse().to_rotation_matrix().into_inner();
            transition.fixed_view_mut::<3, 3>(0, 0).copy_from(&back);
            transition.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-Matrix3::identity() * dt_s));
            node.q *= turn;
            node.p = transition * node.p * transition.transpose();
            let gap_s = longest_gap(&sensors.gyro.0, before, time_s);
            let lost = if gap_s > longest_s { (0.1 * gap_s).powi(2) } else { 0.0 };
            let walk = Matrix3::from_diagonal(&errors.gyro.errors.bias_walk.map(|s| s * s * dt_s));
            let turned = Matrix3::identity() * (noise * dt_s + lost);
            for (first, added) in [(0, turned), (3, walk)] {
                let mut block = node.p.fixed_view_mut::<3, 3>(first, first);
                block += allowed(freedom, &added);
            }
            for i in 0..3 {
                node.p[(6 + i, 6 + i)] += errors.accelerometer.errors.bias_walk[i].powi(2) * dt_s;
            }
        }
        let predicted = node;
        if let Some(measured) = gravity_measurement(sensors, time_s, &node) {
            node = updated(node, &measured);
        }
        if sensors.force.0.is_empty() && *freedom == Freedom::OnBearing {
            node = updated(node, &balance_measurement(sensors.model, &node));
        }
        for j in 0..sensors.vectors.len() {
            if let Some(measured) = direction_measurement(sensors, j, time_s, &node) {
                node = updated(node, &measured);
            }
        }
        steps.push(Step { predicted, updated: node, transition });
        before = time_s;
    }
    steps
}

/// A mean measurement at a node: expected value, H and R.
struct Measured {
    innovation: Vector3<f64>,
    h: SMatrix<f64, 3, 9>,
    r: Matrix3<f64>,
}

fn longest_gap(times_s: &[f64], from_s: f64, to_s: f64) -> f64 {
    let first = times_s.partition_point(|t| *t <= from_s).saturating_sub(1);
    let end = (times_s.partition_point(|t| *t < to_s) + 1).min(times_s.len());
    let gaps = times_s.get(first..end).unwrap_or(&[]).windows(2).map(|pair| match pair {
        [a, b] => b - a,
        _ => 0.0,
    });
    gaps.fold(0.0, f64::max)
}

fn gravity_measurement(sensors: &Sensors<'_>, time_s: f64, node: &Node) -> Option<Measured> {
    let (force, variance) = sensors.gravity(time_s, &node.bias)?;
    let expected = vertical_b(&node.q) * GRAVITY_M_S2;
    let mut h = SMatrix::<f64, 3, 9>::zeros();
    h.fixed_view_mut::<3, 3>(0, 0).copy_from(&skew(&expected));
    h.fixed_view_mut::<3, 3>(0, 6).copy_from(&Matrix3::identity());
    Some(Measured { innovation: force - expected - node.force_bias, h, r: Matrix3::identity() * variance })
}

/// The vertical in body axes where the platform balances, and how far it may tilt from there in either direction:
/// the only information on tilt without an accelerometer.
fn balance(model: &PlatformModel) -> (Unit<Vector3<f64>>, f64) {
    let mgr = model.mass_properties.gravity_offset_b_n_m();
    let up = if mgr.z < 0.0 { unit_or(-mgr, Vector3::z_axis()) } else { Vector3::z_axis() };
    match model.tilt_limit {
        TiltLimit::Cone { max_rad } => (up, 0.5 * max_rad),
        // The other axis is free.
        TiltLimit::Pitch { max_rad } => (up, max_rad),
    }
}

/// Without this, tilt would drift with the gyro's bias far beyond the limits of the bearing.
fn balance_measurement(model: &PlatformModel, node: &Node) -> Measured {
    let (up, stddev_rad) = balance(model);
    let expected = vertical_b(&node.q);
    let mut h = SMatrix::<f64, 3, 9>::zeros();
    h.fixed_view_mut::<3, 3>(0, 0).copy_from(&skew(&expected));
    let r = Matrix3::identity() * (stddev_rad * stddev_rad * BALANCE_S / NODE_S);
    Measured { innovation: up.into_inner() - expected, h, r }
}

fn direction_measurement(sensors: &Sensors<'_>, j: usize, time_s: f64, node: &Node) -> Option<Measured> {
    let (direction, reference, variance) = sensors.direction(j, time_s, &node.bias)?;
    let expected = node.q.inverse_transform_vector(&reference);
    let mut h = SMatrix::<f64, 3, 9>::zeros();
    h.fixed_view_mut::<3, 3>(0, 0).copy_from(&skew(&expected));
    Some(Measured { innovation: direction - expected, h, r: Matrix3::identity() * variance })
}

/// Kalman update; skipped if the innovation covariance is singular or the innovation is an outlier.
fn updated(node: Node, measured: &Measured) -> Node {
    let mut p = node.p;
    // Outliers: 100 is far beyond any quantile of three degrees of freedom, and harmless during start-up.
    let accept = |nis| nis <= 100.0;
    match covariance::update(&mut p, &measured.h, &measured.r, &measured.innovation, accept) {
        Some(update) => Node { p, ..node.moved(&update.correction) },
        None => node,
    }
}

fn backward(steps: &[Step]) -> Vec<Node> {
    let Some(last) = steps.last() else { return Vec::new() };
    let mut smoothed = vec![last.updated];
    for (step, next) in steps.iter().zip(steps.iter().skip(1)).rev() {
        let Some(after) = smoothed.last().copied() else { break };
        smoothed.push(match back(&step.updated.p, &next.transition, &next.predicted.p, &after.p) {
            Some((gain, p)) => Node { p, ..step.updated.moved(&(gain * next.predicted.to(&after))) },
            None => step.updated,
        });
    }
    smoothed.reverse();
    smoothed
}
