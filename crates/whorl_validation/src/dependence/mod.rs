//! Dependence of a residual torque on recorded quantities.
//!
//! The residual is regressed on a smooth curve of one recorded quantity at a time, once in body and
//! once in world axes, and cross-validated on stretches of time that were left out of the fit: the score
//! is the share of the excess (mean square beyond the noise) that the curve predicts there. Overfitting
//! therefore gains nothing, and quantities of different kinds can be ranked.
//!
//! Curves are penalised cubic B-splines (P. Eilers and B. Marx, Flexible smoothing with B-splines and
//! penalties, Statistical Science 11, 1996), periodic for angles.

mod basis;
mod line;
mod regression;
mod residual;
mod shape;
mod variable;

pub use line::{SpectralLine, spectral_line};
pub use residual::Residual;
pub use shape::{Growth, Parity, Shape};
pub use variable::{Variable, conditions};

use nalgebra::{Matrix3, Vector3};
use serde::Serialize;
use thiserror::Error;

use regression::{FOLDS, Fit, basis, constant_explains, fit};
use residual::Axes;
use variable::RATE_ABOUT_SAME_AXIS;

/// Minimum number of values of a residual.
pub const FEWEST_VALUES: usize = 20;
/// How much more a world-frame curve must explain than the body-frame one to be preferred.
const FRAME_MARGIN: f64 = 0.02;

/// How much more the rates about all axes must explain than any other quantity.
const OWN_AXES_MARGIN: f64 = 0.1;

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

impl Frame {
    /// In a word, for tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.words().0
    }

    /// Its axes, for tables and curves: three, or one.
    #[must_use]
    pub fn axes(self) -> &'static [&'static str] {
        self.words().1
    }

    /// What a torque about one of its axes is about, in a sentence.
    #[must_use]
    pub fn about(self, axis: usize) -> &'static str {
        let (.., about) = self.words();
        about.get(axis).or(about.last()).unwrap_or(&"")
    }

    fn words(self) -> (&'static str, &'static [&'static str], &'static [&'static str]) {
        match self {
            Self::Body => ("body", &["x", "y", "z"], &["body x", "body y", "body z"]),
            Self::World => ("world", &["east", "north", "up"], &["east", "north", "the vertical"]),
            Self::Wheel => ("wheel", &["axis"], &["the wheel's axis"]),
            Self::Hinge => ("hinge", &["axis"], &["the hinge"]),
        }
    }
}

/// Why a residual cannot be analysed.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum DependenceError {
    /// Too few values.
    #[error("{given} values of the residual torque; at least {FEWEST_VALUES} are needed")]
    TooFewValues {
        /// Values given.
        given: usize,
    },
    /// Lengths differ, or a number is not finite, or a standard deviation is not positive.
    #[error("the residual torque is not usable: {0}")]
    NotUsable(&'static str),
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
    /// Share of the excess that the curve predicts on data left out of its fit, 0..1.
    pub share: f64,
    /// The axis on which the curve is largest, as it is drawn: 0, 1, 2 for x, y, z.
    pub axis: usize,
    /// Share of the whole excess that each axis contributes.
    pub axis_share: [f64; 3],
    /// Symmetry of the curve on that axis.
    pub parity: Parity,
    /// Growth of the curve on that axis.
    pub growth: Growth,
    /// The curves with their bands.
    pub shape: Shape,
}

/// Dependence of a residual.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Dependences {
    /// Mean square of the whitened residual; 1 = noise.
    pub mean_square_whitened: f64,
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
    /// The strongest oscillation in time, if one stands out.
    pub line: Option<SpectralLine>,
}

/// Finds the quantities that a residual torque depends on, in one run or in several that are pooled: one curve for all.
/// Variables that hardly vary, that are missing in a run, or whose number of values differs from the residual's are
/// left out.
///
/// # Errors
/// See [`DependenceError`].
pub fn dependences(
    residuals: &[Residual],
    variables: &[Vec<Variable>],
) -> Result<Dependences, DependenceError> {
    let mut count = 0;
    for residual in residuals {
        count += residual.checked()?;
    }
    let frames = joined(residuals);
    let Some((first, body)) = frames.first() else { return Err(DependenceError::TooFewValues { given: 0 }) };
    let world = frames.iter().find(|(frame, _)| *frame == Frame::World).map(|(_, axes)| axes);
    let variables = together(variables);
    let total: f64 = body.iter().flatten().map(|(value, sigma)| (value / sigma).powi(2)).sum();
    let noise = body.iter().flatten().filter(|(_, sigma)| sigma.is_finite()).count().max(1) as f64;
    let folds = folds(count);

    let alone = |axis| constant_explains(&[axis], &|_, _| Vector3::x(), &folds).max(0.0);
    let constant_body: f64 = body.iter().map(alone).sum();
    // In body axes, where the noise is: about a horizontal axis it may be far smaller than about the vertical.
    let r_world_body: Vec<Matrix3<f64>> = residuals.iter().flat_map(|r| r.r_world_body.clone()).collect();
    let in_world =
        |i: usize, k: usize| r_world_body.get(k).map_or_else(Vector3::zeros, |r| r.column(i).into());
    let constant_world = constant_explains(&body.each_ref(), &in_world, &folds).max(0.0);

    let mut found = Vec::new();
    for variable in variables.iter().filter(|v| v.value.len() == count) {
        let Some(basis) = basis(variable) else { continue };
        let in_frame = |frame, axes| (frame, fit(basis, variable, axes, &folds));
        let explained = |(_, fit): &(Frame, Fit)| fit.explained.iter().sum::<f64>();
        let in_first = in_frame(*first, body);
        let in_world = world.map(|world| in_frame(Frame::World, world));
        let is_better = |found: &(Frame, Fit)| explained(found) > explained(&in_first) + FRAME_MARGIN * total;
        let (frame, fit) = in_world.filter(is_better).unwrap_or(in_first);
        found.push((variable, frame, fit.explained, Shape::of(&fit)));
    }

    // The explained part cannot exceed the total: an overestimated noise must not cause shares above one.
    let most = found
        .iter()
        .map(|(_, _, explained, _)| explained.iter().sum())
        .fold(constant_body.max(constant_world), f64::max);
    let excess = (total - noise).max(most).max(f64::MIN_POSITIVE);
    let mut ranked: Vec<Dependence> = found
        .into_iter()
        .map(|(variable, frame, explained, shape)| {
            let axis_share = explained.map(|e| (e / excess).clamp(-1.0, 1.0));
            let axis = shape.axis();
            Dependence {
                variable: variable.name.clone(),
                unit: variable.unit.to_owned(),
                frame,
                share: axis_share.iter().sum::<f64>().clamp(0.0, 1.0),
                axis,
                axis_share,
                parity: shape.parity(axis),
                growth: shape.growth(axis),
                shape,
            }
        })
        .collect();
    ranked.sort_by(|a, b| b.share.total_cmp(&a.share));
    // The rate about each axis' own is worth a word only where it explains more than the rate about one.
    let is_own = |d: &Dependence| d.variable == RATE_ABOUT_SAME_AXIS;
    let best = ranked.iter().filter(|d| !is_own(d)).map(|d| d.share).fold(0.0, f64::max);
    ranked.retain(|d| !is_own(d) || d.share > best + OWN_AXES_MARGIN);
    // The line with the largest share of its axis' power, among all runs.
    let lines = residuals.iter().filter_map(spectral_line);
    Ok(Dependences {
        mean_square_whitened: total / noise,
        excess: ((total - noise) / total.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0),
        frame: *first,
        constant_body_share: (constant_body / excess).min(1.0),
        constant_world_share: (constant_world / excess).min(1.0),
        mean_b_n_m: body.each_ref().map(|axis| mean(axis)),
        mean_world_n_m: world.map_or([0.0; 3], |axes| axes.each_ref().map(|axis| mean(axis))),
        ranked,
        line: lines.max_by(|a, b| a.share.total_cmp(&b.share)),
    })
}

/// All residuals one after the other, in each frame that they have in common with the first.
fn joined(residuals: &[Residual]) -> Vec<(Frame, Axes)> {
    let Some((first, others)) = residuals.split_first() else { return Vec::new() };
    let mut frames: Vec<(Frame, Axes)> = first.frames().map(|(frame, axes)| (frame, axes.clone())).collect();
    for other in others {
        frames.retain_mut(|(frame, axes)| {
            let Some((_, more)) = other.frames().find(|(of, _)| of == frame) else { return false };
            axes.iter_mut().zip(more).for_each(|(all, own)| all.extend(own));
            true
        });
    }
    frames
}

/// Variables of the same name of all runs, one after the other.
fn together(runs: &[Vec<Variable>]) -> Vec<Variable> {
    let Some((first, others)) = runs.split_first() else { return Vec::new() };
    let joined = first.iter().map(|variable| {
        let mut joined = variable.clone();
        for run in others {
            let more = run.iter().find(|v| v.name == variable.name)?;
            joined.value.extend(&more.value);
            if let Some((all, more)) = joined.of_other_axes.as_mut().zip(more.of_other_axes.as_ref()) {
                all.iter_mut().zip(more).for_each(|(all, more)| all.extend(more));
            }
        }
        Some(joined)
    });
    joined.flatten().collect()
}

/// The fold of each value: stretches of time, assigned in turn, so that each fold covers the whole run.
fn folds(count: usize) -> Vec<usize> {
    let stretches = (count / 4).clamp(FOLDS, 8 * FOLDS);
    (0..count).map(|i| (i * stretches / count) % FOLDS).collect()
}

fn mean(axis: &[(f64, f64)]) -> f64 {
    axis.iter().map(|(value, _)| value).sum::<f64>() / axis.len().max(1) as f64
}

#[cfg(test)]
mod tests;
