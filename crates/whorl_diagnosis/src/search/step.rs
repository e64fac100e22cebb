//! One Gauss-Newton step: the regression at a point, and the point to which it leads. The base model is fitted by such
//! steps before anything is searched.

use std::collections::BTreeMap;

use whorl_dynamics::Effect;
use whorl_dynamics::effects::Contribution;

use crate::DiagnosisError;
use crate::evidence::ar_noise::ArModels;
use crate::evidence::problem::{Dataset, FREE_RATE_WALK, Problem, ProcessNoise};
use crate::explanations::candidates::Design;
use crate::explanations::hypothesis::Hypothesis;
use crate::parameters::available::Available;
use crate::parameters::{Point, Target};
use crate::search::noise_optimisation::Sizes;

pub(crate) const NO_FIT: DiagnosisError =
    DiagnosisError::NoTrajectory { run: String::new(), what: "the regression has no solution" };

/// Regression of a problem at a point with the columns of a design matrix. Without given AR models those of the residual of all columns
/// together are used.
pub(crate) fn dataset(
    problem: &Problem,
    point: &Point,
    design: &Design,
    ar_models: Option<ArModels>,
) -> Result<Dataset, DiagnosisError> {
    let linearised = problem.linearise(point)?;
    let log_density: f64 = linearised.iter().flat_map(|l| &l.gains.inverse_stddev).map(|s| s.ln()).sum();
    let whitened = problem.respond(&linearised, point, &design.columns)?;
    // As large as some dozen columns.
    drop(linearised);
    let wide: Vec<f64> = design
        .columns
        .iter()
        .map(|c| if c.base_stddev > 0.0 { 2.0 * c.catalogue_stddev } else { design.settings.unusual_size })
        .map(|stddev| stddev * stddev)
        .collect();
    let data = problem.dataset(whitened, design.columns.len(), &wide, ar_models);
    Ok(Dataset { log_density: data.log_density + log_density, ..data })
}

/// As [`dataset`], with errors of formulas of this relative size integrated out.
pub(crate) fn regression_at(
    problem: &Problem,
    point: &Point,
    design: &Design,
    relative_error: f64,
) -> Result<Dataset, DiagnosisError> {
    let mut data = dataset(problem, point, design, None)?;
    let (total, log_density) = problem.integrated(&data, point, design, relative_error);
    data.total = total;
    data.log_density += log_density;
    Ok(data)
}

/// Values of effects whose directions lead to them together.
fn joined(design: &Design, fit: &Hypothesis) -> Vec<(&'static str, Vec<f64>)> {
    let mut of_effect: BTreeMap<&'static str, (&'static dyn Effect, Vec<Contribution<'_>>)> = BTreeMap::new();
    for &i in &fit.estimate.active {
        let Some(column) = design.columns.get(i) else { continue };
        if let (Target::Effect(effect), Some(origin)) = (column.target, column.origin.as_deref()) {
            let amount = fit.estimate.of(i) * column.scale;
            let contribution = Contribution { name: &column.name, origin, amount };
            of_effect.entry(column.group).or_insert((effect, Vec::new())).1.push(contribution);
        }
    }
    let values = |(id, (effect, all)): (_, (&'static dyn Effect, Vec<_>))| Some((id, effect.joined(&all)?));
    of_effect.into_iter().filter_map(values).collect()
}

/// The point of a fit.
pub(crate) fn point_of(problem: &Problem, design: &Design, from: &Point, fit: &Hypothesis) -> Point {
    let mut point = from.clone();
    // Effects that start from an origin of their own come first, then all else moves from there.
    for &i in &fit.estimate.active {
        let Some(column) = design.columns.get(i) else { continue };
        let value = fit.estimate.of(i);
        let distance = problem.reference.distance(from, column);
        let units = match column.quadratic {
            true => value.max(0.0).sqrt(),
            false => value - distance,
        };
        point = problem.reference.moved(&point, column, units);
    }
    point.effects.extend(joined(design, fit));
    problem.reference.towards(from, point)
}

pub(crate) fn base_point_with(
    problem: &mut Problem,
    held_out: &mut Option<&mut Problem>,
) -> Result<Point, DiagnosisError> {
    let available = Available::of(&problem.runs);
    let mut point = problem.reference.point();
    smooth_all(problem, held_out, &point, ProcessNoise::Fixed(FREE_RATE_WALK))?;
    smooth_all(problem, held_out, &point, ProcessNoise::Fixed(5e-3))?;
    for process_noise in [ProcessNoise::Fixed(2e-3), ProcessNoise::Estimated] {
        // A missing effect must not bias the platform's constants: it counts as process noise until it is found.
        problem.nuisance = problem.likeliest_noise(&point, &[], Sizes::Any)?.sizes;
        if let Some(held) = held_out {
            held.nuisance = problem.nuisance;
        }
        let design = base_design(problem, &available);
        let data = dataset(problem, &point, &design, None)?;
        let base = Hypothesis::base(&design, &data.total).ok_or(NO_FIT)?;
        point = point_of(problem, &design, &point, &base);
        smooth_all(problem, held_out, &point, process_noise)?;
    }
    problem.settle_stops()?;
    if let Some(held) = held_out {
        held.settle_stops()?;
    }
    Ok(point)
}

fn base_design(problem: &Problem, available: &Available) -> Design {
    let columns = problem.reference.base_columns(available);
    let columns: Vec<_> = columns.into_iter().filter(|c| c.base_stddev > 0.0).collect();
    let base = (0..columns.len()).collect();
    Design { columns, base, candidates: Vec::new(), settings: problem.reference.settings }
}

pub(crate) fn smooth_all(
    problem: &mut Problem,
    held_out: &mut Option<&mut Problem>,
    point: &Point,
    process_noise: ProcessNoise,
) -> Result<(), DiagnosisError> {
    problem.smooth(point, process_noise)?;
    if let Some(held) = held_out {
        held.smooth(point, process_noise)?;
    }
    Ok(())
}
