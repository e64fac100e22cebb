//! A joint refit of the base model and named effects.

use std::collections::BTreeMap;

use whorl_dynamics::Effect;

use crate::explanations::hypothesis::Hypothesis;
use crate::parameters::{Column, MASS_PROPERTIES, Target, is_base};
use crate::search::Search;
use crate::search::proposals::UNFINISHED;
use crate::search::step::point_of;
use crate::{DiagnosisError, Fit, FittedParameter};

/// Standard deviations of its prior beyond which no moment of inertia is,
const BEYOND_BELIEF: f64 = 5.0;
/// and the least that one counts for, as a share of the moment: what CAD is good for. Priors that an earlier fit has
/// left are tighter than what changes from day to day.
const LEAST_STDDEV: f64 = 0.05;

/// Error over noise up to which a fit has explained the data.
const EXPLAINED: f64 = 1.2;

/// Whether a column is a constant of the platform and not of an effect that was added.
fn is_of_platform(column: &Column) -> bool {
    column.group == MASS_PROPERTIES || is_base(column.group)
}

impl Search<'_> {
    /// Makes these effects, and only these, the best hypothesis, and converges on them.
    pub(crate) fn adopt(&mut self, effects: &[&'static dyn Effect]) -> Result<(), DiagnosisError> {
        for effect in effects {
            let id = effect.info().id;
            if self.problem.reference.model.effects.contains_key(id) {
                continue;
            }
            let found = self
                .layout
                .candidates
                .iter()
                .position(|c| c.id == id)
                .and_then(|c| self.best.with(&self.layout, &self.data.total, c));
            // Against its sign constraint it stays at its neutral value: there is nothing to adopt.
            let Some(next) = found else {
                return Err(DiagnosisError::NoEffect { id: id.to_owned() });
            };
            self.best = next;
        }
        // A second time where the first did not come to its minimum.
        if self.relinearise()?.promise > UNFINISHED {
            self.relinearise()?;
        }
        self.regress_held()
    }

    /// The fit at the present best.
    pub(crate) fn fit(&self) -> Result<Fit, DiagnosisError> {
        let reference = &self.problem.reference;
        let best: &Hypothesis = &self.best;
        let point = point_of(self.problem, &self.layout, &self.point, best);
        let model = self.folded(&point)?;
        let covariance = best.estimate.covariance();
        let slow_residual = self.slow_residual();
        let left = slow_residual.after.max(1.0);
        // While something else is missing, the constants bend to follow it, and how well they seem to be known
        // says nothing: they keep the given uncertainty, so that the next fit can bring them back.
        let noise = self.problem.nuisance;
        let is_explained = left < EXPLAINED && noise.torque == 0 && noise.wheel == 0;
        let mut prior = reference.prior.clone();
        let mut estimates = Vec::new();
        for (at, &i) in best.estimate.active.iter().enumerate() {
            let Some(column) = self.layout.columns.get(i) else { continue };
            let given = reference.given_stddev(column);
            let keeps = !is_explained && is_of_platform(column);
            let posterior_stddev = covariance[(at, at)].max(0.0).sqrt() * column.scale;
            let found = posterior_stddev * left;
            // Data do not take away what was known before them.
            let stddev = match (given > 0.0, keeps) {
                (true, true) => given,
                (true, false) => found.min(given),
                (false, _) => found,
            };
            let value = best.estimate.value[at];
            let (before, after) = match column.target {
                Target::Moment(axis) => {
                    let at =
                        |m: &whorl_dynamics::PlatformModel| m.mass_properties.inertia_b_kg_m2()[(axis, axis)];
                    if !keeps {
                        prior.inertia_b_kg_m2[(axis, axis)] = stddev;
                    }
                    (at(&reference.model), at(&model))
                }
                Target::Effect(effect) => {
                    let read = |values: Vec<f64>| values.get(column.index).copied().unwrap_or(0.0);
                    let before = read(reference.values(effect));
                    if !keeps {
                        self.tighten(&mut prior, column, stddev);
                    }
                    (before, read(reference.values_at(&point, effect)))
                }
            };
            estimates.push(FittedParameter {
                group: column.group.to_owned(),
                name: column.name.clone(),
                unit: column.unit.to_owned(),
                before,
                estimate: after,
                stddev,
                posterior_stddev,
                at_bound: column.is_at_bound(value),
            });
        }
        Ok(Fit { model, prior, estimates, slow_residual })
    }

    /// The moment of inertia that the best explanation has moved beyond belief, if one is: data of another platform
    /// bend the model until something is named, and whatever that is, it is not what the model lacks.
    pub(crate) fn beyond_belief(&self) -> Option<String> {
        let point = point_of(self.problem, &self.layout, &self.point, &self.best);
        let reference = &self.problem.reference;
        let inertia = reference.model.mass_properties.inertia_b_kg_m2();
        (0..3).zip(["xx", "yy", "zz"]).zip(point.moments).find_map(|((axis, name), moved)| {
            let given = inertia[(axis, axis)];
            let stddev = reference.prior.inertia_b_kg_m2[(axis, axis)].max(LEAST_STDDEV * given);
            (moved.abs() > BEYOND_BELIEF * stddev).then(|| {
                format!(
                    "the fit requires a moment of inertia {name} of {:.2} kg m^2, but the model says {given:.2} +- {stddev:.2}",
                    given + moved
                )
            })
        })
    }

    /// The model at a point, with the base effects folded into its constants.
    fn folded(
        &self,
        point: &crate::parameters::Point,
    ) -> Result<whorl_dynamics::PlatformModel, DiagnosisError> {
        let reference = &self.problem.reference;
        let mut constants = point.clone();
        constants.effects.retain(|id, _| is_base(id) && !reference.model.effects.contains_key(*id));
        let mut given = reference.clone();
        given.model.effects = BTreeMap::new();
        let adjusted = whorl_dynamics::Gyrostat::new(&given.model_at(&constants)?)?.model().clone();
        let mut model = adjusted;
        let mut rest = point.clone();
        rest.effects.retain(|id, _| !constants.effects.contains_key(id));
        rest.moments = [0.0; 3];
        let named = reference.model_at(&rest)?;
        model.effects = named.effects;
        // Neutral values need no mention.
        for (id, values) in &mut model.effects {
            if let Some(effect) = crate::explanations::candidates::effect(id) {
                let specs = effect.parameters(&reference.model);
                let was = reference.model.effects.get(id).cloned().unwrap_or_default();
                values.retain(|name, value| {
                    was.contains_key(name)
                        || specs.iter().any(|s| s.name == *name && (*value - s.neutral).abs() > 0.0)
                });
            }
        }
        Ok(model)
    }

    fn tighten(&self, prior: &mut whorl_dynamics::ModelPrior, column: &Column, stddev: f64) {
        let (id, model) = (column.group, &self.problem.reference.model);
        let spec = match column.target {
            Target::Effect(effect) if !model.effects.contains_key(id) => {
                effect.parameters(model).into_iter().nth(column.index)
            }
            _ => None,
        };
        if let Some((base, spec)) = spec.and_then(|spec| Some((spec.base?, spec))) {
            return base.set_stddev(prior, spec.part, stddev);
        }
        if !is_of_platform(column) {
            prior.effects.entry(id.to_owned()).or_default().insert(column.name.clone(), stddev);
        }
    }
}
