//! Parameters of a platform and its effects fitted by the predictor: the likelihood of the readings themselves.

use std::collections::BTreeMap;

use whorl_dynamics::effects::{Role, find};
use whorl_dynamics::{Effect, Gyrostat, ModelPrior, PlatformModel};
use whorl_math::normal_equations::Normal;
use whorl_prediction::{Fitted, Followed, Hints, Parameter, Rival, Settings, fit};
use whorl_recording::Recording;

use crate::DiagnosisError;
use crate::fitting::tie::Tie;
use crate::parameter_space::available::Available;
use crate::parameter_space::{Column, Point, Reference};

/// A model refitted jointly with effects.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// The platform with base parameters and effects at their estimates.
    pub model: PlatformModel,
    /// Standard deviations after the fit.
    pub prior: ModelPrior,
    /// Every fitted parameter of the base model and of the effects.
    pub estimates: Vec<FittedParameter>,
    /// Whether the model explains the recordings: with a torque that it does not have they are hardly likelier.
    pub is_explained: bool,
    /// Pairs of parameters of the effects that the recordings do not tell apart.
    pub ties: Vec<Tie>,
    /// Each recording as the filter follows it with the model: training runs, then those held out that the fit was tried on.
    pub followed: Vec<Followed>,
}

/// One fitted parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedParameter {
    /// Effect id; `mass_properties` for the moments of inertia.
    pub group: String,
    /// Name within the group.
    pub name: String,
    /// Unit, "1" for none.
    pub unit: String,
    /// Value in the given model (for an effect that it does not have: the neutral value).
    pub before: f64,
    /// Estimate.
    pub estimate: f64,
    /// Standard deviation before the fit; of an effect that the given model does not have the catalogue's, times the size with which it enters.
    pub prior_stddev: f64,
    /// Standard deviation of the estimate: not above that of the prior; of the platform's constants that one where something is left unexplained.
    pub stddev: f64,
    /// Standard deviation of the posterior itself.
    pub posterior_stddev: f64,
    /// Whether the estimate lies at a bound of its plausible range.
    pub at_bound: bool,
}

/// How an effect enters a fit.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Entered {
    /// Its parameters that are fitted.
    pub indices: Vec<usize>,
    /// Prior size, in units of the catalogue's prior.
    pub size: f64,
    /// Minus the logarithm of the prior probability of that size, and of the way in which it enters.
    pub choice_nats: f64,
}

/// What a refit changes, with what is known of it before.
#[derive(Clone)]
pub(crate) struct Refit<'a> {
    pub reference: &'a Reference,
    /// Each parameter once, counted from the given model.
    pub columns: Vec<Column>,
    /// Standard deviation of each, in its units.
    pub stddevs: Vec<f64>,
}

impl<'a> Refit<'a> {
    /// The platform's own parameters that its prior leaves open.
    pub fn own(reference: &'a Reference, available: &Available) -> Self {
        let mut columns = reference.base_columns(available);
        columns.retain(|column| column.given_stddev > 0.0);
        Self { reference, stddevs: vec![1.0; columns.len()], columns }
    }

    /// Leaves out those of its parameters that are not `kept`: they stay as given.
    pub fn keep(&mut self, kept: &[bool]) {
        let all = self.columns.drain(..).zip(self.stddevs.drain(..)).zip(kept);
        (self.columns, self.stddevs) = all.filter(|(_, kept)| **kept).map(|(own, _)| own).unzip();
    }

    /// Adds an effect: the parameters that a point has moved, and those that entered.
    pub fn add(&mut self, effect: &'static dyn Effect, point: &Point, entered: Option<&Entered>) {
        for column in self.reference.parameter_columns(effect) {
            let has_entered = entered.is_some_and(|entered| entered.indices.contains(&column.index));
            if !has_entered && column.units_at(point) == 0.0 {
                continue;
            }
            let is_amplitude = column.role == Role::Amplitude;
            let size = entered.filter(|_| is_amplitude).map_or(1.0, |entered| entered.size);
            let stddev = size * column.catalogue_stddev;
            if let Some(own) = self.columns.iter().position(|own| own.is(&column)) {
                self.stddevs[own] = self.stddevs[own].hypot(stddev);
            } else {
                self.columns.push(column);
                self.stddevs.push(stddev);
            }
        }
    }

    pub fn units_of(&self, point: &Point) -> Vec<f64> {
        self.columns.iter().map(|of| of.units_at(point).max(of.range.0).min(of.range.1)).collect()
    }

    pub fn point(&self, units: &[f64]) -> Point {
        let moved = |point: Point, (column, to): (&Column, &f64)| self.reference.moved(&point, column, *to);
        self.columns.iter().zip(units).fold(self.reference.point(), moved)
    }

    pub fn likeliest(
        &self,
        recordings: &[Recording],
        starts: &[Vec<f64>],
        rival: Rival<'_>,
        settings: &Settings,
    ) -> Result<Fitted, DiagnosisError> {
        Ok(fit(recordings, &self.parameters(), &|units| self.model_at(units), starts, rival, settings)?)
    }

    pub fn parameters(&self) -> Vec<Parameter> {
        let of = |(column, stddev): (&Column, &f64)| Parameter { stddev: *stddev, range: column.range };
        self.columns.iter().zip(&self.stddevs).map(of).collect()
    }

    /// The model with these values, in units; `None` where no platform is so.
    pub fn model_at(&self, units: &[f64]) -> Option<PlatformModel> {
        self.reference.possible_model_at(&self.point(units))
    }

    /// The model with fitted values, and what they are worth.
    pub fn described(&self, fitted: &Fitted) -> Result<Fit, DiagnosisError> {
        let reference = self.reference;
        let point = self.point(&fitted.at);
        let model = self.folded(&point)?;
        // While another effect is missing, the constants are biased by it, and their posterior deviations mean nothing: they
        // keep the given uncertainty, so that the next fit can correct them.
        let is_explained = fitted.followed.iter().all(|run| !run.noise.disturbance.is_some());
        let mut prior = reference.prior.clone();
        let mut estimates = Vec::new();
        for (i, column) in self.columns.iter().enumerate() {
            let given = column.given_stddev;
            let keeps = !is_explained && is_of_platform(column);
            let posterior_stddev = fitted.covariance[(i, i)].max(0.0).sqrt() * column.scale;
            // Data do not take away what was known before them.
            let is_prior = given > 0.0 && (keeps || posterior_stddev > given);
            let stddev = if is_prior { given } else { posterior_stddev };
            if !keeps {
                self.tighten(&mut prior, column, stddev);
            }
            // Base effects are folded into the moments of inertia as well.
            let moment = model.mass_properties.inertia_b_kg_m2().diagonal().get(column.index).copied();
            estimates.push(FittedParameter {
                group: column.group.to_owned(),
                name: column.name.clone(),
                unit: column.unit.to_owned(),
                before: column.given,
                estimate: moment
                    .filter(|_| column.effect.is_none())
                    .unwrap_or_else(|| column.value_at(&point)),
                prior_stddev: if given > 0.0 { given } else { self.stddevs[i] * column.scale },
                stddev,
                posterior_stddev,
                at_bound: fitted.at_bound.get(i) == Some(&true),
            });
        }
        Ok(Fit { model, prior, estimates, is_explained, ties: Vec::new(), followed: fitted.followed.clone() })
    }

    /// The model at a point, with the base effects folded into its constants.
    fn folded(&self, point: &Point) -> Result<PlatformModel, DiagnosisError> {
        let reference = self.reference;
        let is_constant = |id: &str| {
            find(id).is_none_or(|effect| effect.is_base()) && !reference.model.effects.contains_key(id)
        };
        let (constants, rest) = point.clone().into_iter().partition(|(id, _)| is_constant(id));
        let mut given = reference.clone();
        given.model.effects = BTreeMap::new();
        let mut model = Gyrostat::new(&given.model_at(&constants)?)?.model().clone();
        model.effects = reference.model_at(&rest)?.effects;
        // Neutral values need no mention.
        for (id, values) in &mut model.effects {
            let specs = find(id).map(|effect| effect.parameters(&reference.model)).unwrap_or_default();
            let was = reference.model.effects.get(id);
            let is_neutral = |name: &str, x: f64| specs.iter().any(|of| of.name == *name && of.neutral == x);
            values.retain(|name, value| {
                was.is_some_and(|was| was.contains_key(name)) || !is_neutral(name, *value)
            });
        }
        Ok(model)
    }

    fn tighten(&self, prior: &mut ModelPrior, column: &Column, stddev: f64) {
        let is_given = self.reference.model.effects.contains_key(column.group);
        if let Some(base) = column.base.filter(|_| !is_given) {
            base.set_stddev(prior, column.part, stddev);
        } else if is_given || !is_of_platform(column) {
            prior.effects.entry(column.group.to_owned()).or_default().insert(column.name.clone(), stddev);
        }
    }
}

/// Whether a column is a constant of the platform and not of an effect that was added.
fn is_of_platform(column: &Column) -> bool {
    column.effect.is_none_or(|effect| effect.is_base())
}

/// What recordings say about parameters at these values, the slope of their priors included: priors of changes are about no change.
pub(crate) fn about<'h>(
    hints: impl IntoIterator<Item = &'h Hints>,
    at: &[f64],
    priors: &[Parameter],
) -> Normal {
    let mut normal = Normal::zeros(0);
    for of_run in hints {
        if normal.vector.is_empty() {
            normal = Normal::zeros(of_run.slope.len());
        }
        normal.matrix += &of_run.information;
        normal.vector += &of_run.slope;
    }
    for ((slope, units), prior) in normal.vector.iter_mut().zip(at).zip(priors) {
        *slope -= units / prior.stddev.powi(2);
    }
    normal
}
