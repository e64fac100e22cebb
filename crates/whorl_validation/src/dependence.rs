//! Dependence of a residual torque on recorded quantities: regressed on one shape of one quantity ([`Quantity::shapes`]) and a constant, in body and
//! world axes. Quantities are ranked by the share of the excess (mean square beyond the noise) that this explains: two numbers do not overfit.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use serde::Serialize;
use whorl_math::statistics::quantile;

use crate::quantities::Quantity;
use crate::shapes::{Growth, Parity, Shape};

/// Points of a curve, and the share of values at either end that it leaves out.
const PLACES: usize = 41;
const OUTLIERS: f64 = 0.002;
/// How much more a world-frame curve must explain than the body-frame one to be preferred.
const MARGIN: f64 = 0.02;
/// How much more the rates about all axes must explain than any other quantity.
const OWN_AXES_MARGIN: f64 = 0.1;
/// Share of the largest standard deviation below which an axis is one about which the rig holds the body.
const HELD: f64 = 1e-9;
/// Of each axis the rate about it: friction that acts about all of them.
pub(crate) const RATE_ABOUT_SAME_AXIS: &str = "rate_about_the_same_axis";

/// Axes in which a torque is resolved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Frame {
    /// Fixed to the platform.
    Body,
    /// Fixed to the room: east, north, up.
    World,
    /// About a wheel's axis, the first of three; there are no others.
    Wheel,
    /// About the hinge on which the rig turns, likewise.
    Hinge,
}

/// Of each frame its name, and of each of its axes, three or one, the name and what a torque about it is about.
const FRAMES: [(&str, &[&str], &[&str]); 4] = [
    ("body", &["x", "y", "z"], &["body x", "body y", "body z"]),
    ("world", &["east", "north", "up"], &["east", "north", "the vertical"]),
    ("wheel", &["axis"], &["the wheel's axis"]),
    ("hinge", &["axis"], &["the hinge"]),
];

impl Frame {
    /// In a word, for tables.
    pub fn name(self) -> &'static str {
        FRAMES[self as usize].0
    }

    /// Its axes, for tables and curves: three, or one.
    pub fn axes(self) -> &'static [&'static str] {
        FRAMES[self as usize].1
    }

    /// What a torque about one of its axes is about, in a sentence.
    pub fn about(self, axis: usize) -> &'static str {
        FRAMES[self as usize].2.get(axis).unwrap_or(&"")
    }
}

/// A curve of the torque over a quantity, with its standard deviation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Curves {
    /// The quantity.
    pub x: Vec<f64>,
    /// Torque about each axis [N m].
    pub torque_n_m: [Vec<f64>; 3],
    /// Its standard deviation [N m].
    pub stddev_n_m: [Vec<f64>; 3],
}

/// The residual as a function of one quantity.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Dependence {
    /// The quantity.
    pub variable: String,
    /// Its unit.
    pub unit: String,
    /// The frame in which the curve explains most.
    pub frame: Frame,
    /// Share of the excess that the curve explains, 0..1.
    pub share: f64,
    /// The axis on which the curve is largest: 0, 1, 2 for x, y, z.
    pub axis: usize,
    /// Symmetry of the curve on that axis.
    pub parity: Parity,
    /// Growth of the curve on that axis.
    pub growth: Growth,
    /// The curves with their bands.
    pub shape: Curves,
}

/// Dependence of a residual.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Dependences {
    /// Excess over noise, as a share of the mean square, 0..1.
    pub excess: f64,
    /// The first frame: that of the platform, of a wheel or of a hinge.
    pub frame: Frame,
    /// Share of the excess that is a constant torque fixed to it.
    pub constant_body_share: f64,
    /// Share of the excess that is a constant torque fixed to the room.
    pub constant_world_share: f64,
    /// Mean residual in the first frame [N m].
    pub mean_b_n_m: [f64; 3],
    /// Mean residual, world axes [N m].
    pub mean_world_n_m: [f64; 3],
    /// The quantities by share, largest first.
    pub ranked: Vec<Dependence>,
}

/// A quantity at the residual's instants.
#[derive(Debug, Clone)]
pub(crate) struct Variable {
    pub quantity: Quantity,
    /// Its values, or those for each of three axes.
    pub values: Vec<Vec<f64>>,
    /// Where its shapes have their zero, and their unit ([`Quantity::scale`]).
    pub scale: (f64, f64),
}

impl Variable {
    fn of_axis(&self, axis: usize) -> &[f64] {
        self.values.get(axis).or(self.values.first()).map_or(&[], Vec::as_slice)
    }

    /// What the torque is a sum of at a value.
    fn functions(&self, shapes: &[Shape], x: f64) -> DVector<f64> {
        let of = shapes.iter().map(|shape| (shape.of)((x - self.scale.0) / self.scale.1));
        DVector::from_iterator(1 + shapes.len(), std::iter::once(1.0).chain(of))
    }
}

/// A torque about three axes with the standard deviation of its noise [N m]: infinite about an axis about which nothing can turn.
pub(crate) type Torque = [(f64, f64); 3];

/// Estimates of a torque: in the first frame and, on a body that turns freely, in world axes.
pub(crate) struct Residual {
    pub first: Frame,
    pub torques: Vec<Torque>,
    pub world: Vec<Torque>,
}

impl Residual {
    pub fn new(first: Frame) -> Self {
        Self { first, torques: Vec::new(), world: Vec::new() }
    }

    /// A torque on the body, body axes [N m], with the covariance of its noise [N^2 m^2]; `r` takes a body vector to the world.
    pub fn push_on_body(&mut self, torque: &Vector3<f64>, noise: &Matrix3<f64>, r: &Matrix3<f64>) {
        let resolved = |torque: Vector3<f64>, noise: Matrix3<f64>| -> Torque {
            let sigma = noise.diagonal().map(|x| x.max(0.0).sqrt());
            let held = HELD * sigma.amax();
            [0, 1, 2].map(|i| (torque[i], if sigma[i] <= held { f64::INFINITY } else { sigma[i] }))
        };
        self.torques.push(resolved(*torque, *noise));
        self.world.push(resolved(r * torque, r * noise * r.transpose()));
    }

    /// A torque about the only axis, with the standard deviation of its noise [N m].
    pub fn push_about_one(&mut self, torque: (f64, f64)) {
        self.torques.push([torque, (0.0, f64::INFINITY), (0.0, f64::INFINITY)]);
    }
}

/// A torque about one axis as a function of a quantity.
struct Curve {
    /// Drop of the whitened sum of squares, and what it is over the weights: mean square over the data [N^2 m^2].
    explained: f64,
    mean_square: f64,
    shapes: &'static [Shape],
    coefficients: DVector<f64>,
    covariance: DMatrix<f64>,
}

/// Finds the quantities that a residual torque depends on.
pub(crate) fn dependences(residual: &Residual, variables: &[Variable]) -> Dependences {
    let all = || residual.torques.iter().flatten();
    let total: f64 = all().map(|(value, sigma)| (value / sigma).powi(2)).sum();
    let noise = all().filter(|(_, sigma)| sigma.is_finite()).count().max(1) as f64;
    let explained = |curves: &[Option<Curve>; 3]| curves.iter().flatten().map(|c| c.explained).sum::<f64>();
    let in_best_frame = |variable: &Variable| {
        let in_frame = |torques: &[Torque]| [0, 1, 2].map(|axis| curve(variable, torques, axis));
        let (first, world) = (in_frame(&residual.torques), in_frame(&residual.world));
        let is_better = explained(&world) > explained(&first) + MARGIN * total;
        if is_better { (Frame::World, world) } else { (residual.first, first) }
    };
    let found: Vec<_> = variables.iter().map(in_best_frame).collect();
    let (of_first, mean_b_n_m) = constant(&residual.torques);
    let (of_world, mean_world_n_m) = constant(&residual.world);
    // The explained part cannot exceed the total: an overestimated noise must not cause shares above one.
    let most = found.iter().map(|(_, curves)| explained(curves)).fold(of_first.max(of_world), f64::max);
    let excess = (total - noise).max(most).max(f64::MIN_POSITIVE);
    let dependence = |(variable, (frame, curves)): (&Variable, (Frame, [Option<Curve>; 3]))| {
        let size = |i: &usize| curves[*i].as_ref().map_or(0.0, |curve| curve.mean_square);
        let axis = (0..3).max_by(|a, b| size(a).total_cmp(&size(b))).unwrap_or(0);
        let (parity, growth) = told(variable, axis, curves[axis].as_ref());
        Dependence {
            variable: variable.quantity.name.clone(),
            unit: variable.quantity.unit.to_owned(),
            frame,
            share: (explained(&curves) / excess).clamp(0.0, 1.0),
            axis,
            parity,
            growth,
            shape: drawn(variable, &curves),
        }
    };
    let mut ranked: Vec<Dependence> = variables.iter().zip(found).map(dependence).collect();
    ranked.sort_by(|a, b| b.share.total_cmp(&a.share));
    // The rate about each axis' own is worth a word only where it explains more than the rate about one.
    let is_own = |d: &Dependence| d.variable == RATE_ABOUT_SAME_AXIS;
    let best = ranked.iter().find(|d| !is_own(d)).map_or(0.0, |d| d.share);
    ranked.retain(|d| !is_own(d) || d.share > best + OWN_AXES_MARGIN);
    Dependences {
        excess: ((total - noise) / total.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0),
        frame: residual.first,
        constant_body_share: (of_first / excess).min(1.0),
        constant_world_share: (of_world / excess).min(1.0),
        mean_b_n_m,
        mean_world_n_m,
        ranked,
    }
}

/// What a constant torque explains, and the mean.
fn constant(torques: &[Torque]) -> (f64, [f64; 3]) {
    let sum =
        |of: &dyn Fn(&(f64, f64)) -> f64| [0, 1, 2].map(|i| torques.iter().map(|t| of(&t[i])).sum::<f64>());
    let (weights, weighted) = (sum(&|(_, s)| s.powi(-2)), sum(&|(x, s)| x * s.powi(-2)));
    let of_axis = |i: usize| if weights[i] > 0.0 { weighted[i].powi(2) / weights[i] } else { 0.0 };
    let mean = sum(&|(x, _)| *x).map(|x| x / torques.len().max(1) as f64);
    ((0..3).map(of_axis).sum(), mean)
}

/// The torque about an axis as the function of a quantity that explains most.
fn curve(variable: &Variable, torques: &[Torque], axis: usize) -> Option<Curve> {
    let xs = variable.of_axis(axis);
    let of_shapes = |shapes: &'static [Shape]| {
        let size = 1 + shapes.len();
        let (mut matrix, mut right, mut squares) = (DMatrix::zeros(size, size), DVector::zeros(size), 0.0);
        for (x, torque) in xs.iter().zip(torques) {
            let (value, weight) = (torque[axis].0, torque[axis].1.powi(-2));
            let functions = variable.functions(shapes, *x);
            matrix.ger(weight, &functions, &functions, 1.0);
            right.axpy(weight * value, &functions, 1.0);
            squares += weight * value * value;
        }
        let ridge = f64::EPSILON * matrix.trace();
        let weights = matrix[(0, 0)];
        let factor = (matrix + DMatrix::from_diagonal_element(size, size, ridge)).cholesky()?;
        let coefficients = factor.solve(&right);
        let explained = coefficients.dot(&right);
        // The covariance grows where the scatter is larger than the stated noise.
        let scatter = ((squares - explained) / xs.len() as f64).max(1.0);
        let (covariance, mean_square) = (factor.inverse() * scatter, explained / weights);
        Some(Curve { explained, mean_square, shapes, coefficients, covariance })
    };
    let all = variable.quantity.shapes().filter_map(of_shapes);
    all.max_by(|a, b| a.explained.total_cmp(&b.explained))
}

/// How a curve grows, and its symmetry, where the data reach to zero and to both of its sides.
fn told(variable: &Variable, axis: usize, curve: Option<&Curve>) -> (Parity, Growth) {
    let (low, high) = range(variable.of_axis(axis));
    let (reach, farthest) = (high.min(-low), high.max(-low));
    match curve.and_then(|curve| curve.shapes.first()).filter(|_| !variable.quantity.is_slow) {
        Some(shape) if reach >= 0.5 * farthest => (shape.parity, shape.growth),
        Some(shape) if reach > -0.2 * farthest => (Parity::None, shape.growth),
        _ => (Parity::None, Growth::Unclear),
    }
}

/// Least and largest value, but for the outermost 0.2 %: outliers must not stretch a curve.
pub(crate) fn range(values: &[f64]) -> (f64, f64) {
    let at = |share| quantile(values.iter().copied(), share);
    (at(OUTLIERS), at(1.0 - OUTLIERS))
}

fn drawn(variable: &Variable, curves: &[Option<Curve>; 3]) -> Curves {
    let (low, high) = range(&variable.values.concat());
    let x: Vec<f64> = (0..PLACES).map(|k| low + (high - low) * k as f64 / (PLACES - 1) as f64).collect();
    let of = |curve: &Option<Curve>| -> (Vec<f64>, Vec<f64>) {
        let Some(curve) = curve else { return (Vec::new(), Vec::new()) };
        let at = |x: &f64| {
            let functions = variable.functions(curve.shapes, *x);
            let variance = functions.dot(&(&curve.covariance * &functions));
            (functions.dot(&curve.coefficients), variance.max(0.0).sqrt())
        };
        x.iter().map(at).unzip()
    };
    let [a, b, c] = curves.each_ref().map(of);
    Curves { torque_n_m: [a.0, b.0, c.0], stddev_n_m: [a.1, b.1, c.1], x }
}
