//! Parameters of a platform and its effects fitted by the predictor: the likelihood of the readings themselves.

use std::collections::BTreeMap;

use whorl_dynamics::effects::{Role, find};
use whorl_dynamics::{Effect, Gyrostat, ModelPrior, PlatformModel};
use whorl_prediction::{Fitted, Followed, Parameter, Rival, Settings, fit};
use whorl_recording::Recording;

use crate::fitting::ties::{Tie, ties};
use crate::parameter_space::available::Available;
use crate::parameter_space::{Column, MASS_PROPERTIES, Point, Reference, is_base};
use crate::{DiagnosisError, Options};

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
    /// Each recording as the filter follows it with the model, training runs first; of those that were held out as many as the fit was
    /// tried on.
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
    /// Standard deviation of the estimate: not above that of the prior; of a constant of the platform that of the prior, where the
    /// fit leaves something unexplained.
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
        columns.retain(|column| column.base_stddev > 0.0);
        let stddevs = columns.iter().map(|column| column.base_stddev).collect();
        Self { reference, columns, stddevs }
    }

    /// Leaves out those of its parameters that are not `kept`: they stay as given.
    pub fn keep(&mut self, kept: &[bool]) {
        let is_kept = |i: usize| kept.get(i).copied().unwrap_or(true);
        let (mut of_columns, mut of_stddevs) = (0.., 0..);
        self.columns.retain(|_| of_columns.next().is_none_or(is_kept));
        self.stddevs.retain(|_| of_stddevs.next().is_none_or(is_kept));
    }

    /// Adds an effect: the parameters that a point has moved, and those that entered.
    pub fn add(&mut self, effect: &'static dyn Effect, point: &Point, entered: Option<&Entered>) {
        let reference = self.reference;
        for column in reference.parameter_columns(effect) {
            let has_entered = entered.is_some_and(|entered| entered.indices.contains(&column.index));
            if !has_entered && reference.distance(point, &column) == 0.0 {
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

    /// The place of a point, in units.
    pub fn units_of(&self, point: &Point) -> Vec<f64> {
        let within =
            |column: &Column| self.reference.distance(point, column).max(column.range.0).min(column.range.1);
        self.columns.iter().map(within).collect()
    }

    pub fn point(&self, units: &[f64]) -> Point {
        let moved =
            |point: Point, (column, units): (&Column, &f64)| self.reference.moved(&point, column, *units);
        self.columns.iter().zip(units).fold(self.reference.point(), moved)
    }

    /// The likeliest values alone, as [`fit`] finds them.
    pub fn likeliest(
        &self,
        recordings: &[Recording],
        starts: &[Vec<f64>],
        rival: Rival<'_>,
        settings: &Settings,
    ) -> Result<Fitted, DiagnosisError> {
        let parameters = self.parameters();
        let model_at = |units: &[f64]| self.model_at(units);
        Ok(fit(recordings, &parameters, &model_at, starts, rival, settings)?)
    }

    /// What is fitted, with what is known of it before.
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
        let after = Reference { model: model.clone(), ..reference.clone() };
        let mut estimates = Vec::new();
        for (i, column) in self.columns.iter().enumerate() {
            let given = reference.given_stddev(column);
            let keeps = !is_explained && is_of_platform(column);
            let posterior_stddev = fitted.covariance[(i, i)].max(0.0).sqrt() * column.scale;
            // Data do not take away what was known before them.
            let stddev = match (given > 0.0, keeps) {
                (true, true) => given,
                (true, false) => posterior_stddev.min(given),
                (false, _) => posterior_stddev,
            };
            if !keeps {
                self.tighten(&mut prior, column, stddev);
            }
            let of_effect = |_| reference.value_at(&point, column);
            estimates.push(FittedParameter {
                group: column.group.to_owned(),
                name: column.name.clone(),
                unit: column.unit.to_owned(),
                before: reference.given(column),
                // Base effects are folded into the moments of inertia as well.
                estimate: reference.spec(column).map_or_else(|| after.given(column), of_effect),
                prior_stddev: if given > 0.0 { given } else { self.stddevs[i] * column.scale },
                stddev,
                posterior_stddev,
                at_bound: fitted.at_bound.get(i).copied().unwrap_or(false),
            });
        }
        Ok(Fit { model, prior, estimates, is_explained, ties: Vec::new(), followed: fitted.followed.clone() })
    }

    /// The model at a point, with the base effects folded into its constants.
    fn folded(&self, point: &Point) -> Result<PlatformModel, DiagnosisError> {
        let reference = self.reference;
        let mut constants = point.clone();
        constants.effects.retain(|id, _| is_base(id) && !reference.model.effects.contains_key(*id));
        let mut given = reference.clone();
        given.model.effects = BTreeMap::new();
        let mut model = Gyrostat::new(&given.model_at(&constants)?)?.model().clone();
        let mut rest = point.clone();
        rest.effects.retain(|id, _| !constants.effects.contains_key(id));
        rest.moments = [0.0; 3];
        model.effects = reference.model_at(&rest)?.effects;
        // Neutral values need no mention.
        for (id, values) in &mut model.effects {
            if let Some(effect) = find(id) {
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

    fn tighten(&self, prior: &mut ModelPrior, column: &Column, stddev: f64) {
        let Some((_, spec)) = self.reference.spec(column) else {
            prior.inertia_b_kg_m2[(column.index, column.index)] = stddev;
            return;
        };
        let is_given = self.reference.model.effects.contains_key(column.group);
        if let Some(base) = spec.base.filter(|_| !is_given) {
            base.set_stddev(prior, spec.part, stddev);
        } else if is_given || !is_of_platform(column) {
            prior.effects.entry(column.group.to_owned()).or_default().insert(column.name.clone(), stddev);
        }
    }

    /// Parameters of these effects that the recordings do not tell apart. Amplitudes of an effect that took no part in the fit are
    /// asked about as well, as large as those that did: that they were not needed does not mean that they are zero.
    pub fn ties(
        &self,
        recordings: &[Recording],
        fitted: &Fitted,
        effects: &[&'static dyn Effect],
        options: &Options,
    ) -> Result<Vec<Tie>, DiagnosisError> {
        let mut wide = self.clone();
        // Constants of the platform are not effects of the model.
        for effect in effects.iter().filter(|effect| !effect.is_base()) {
            let own = self.columns.iter().zip(&self.stddevs).filter(|(c, _)| c.group == effect.info().id);
            let size = own.map(|(column, stddev)| stddev / column.catalogue_stddev).fold(1.0, f64::max);
            let mut further = self.reference.parameter_columns(*effect);
            further.retain(|c| c.role == Role::Amplitude && !self.columns.iter().any(|own| own.is(c)));
            wide.stddevs.extend(further.iter().map(|column| size * column.catalogue_stddev));
            wide.columns.extend(further);
        }
        let covariance = if wide.columns.len() == self.columns.len() {
            fitted.covariance.clone()
        } else {
            let mut start = fitted.at.clone();
            start.resize(wide.columns.len(), 0.0);
            let settings = Settings { threads: options.threads, ..self.reference.settings.prediction };
            wide.likeliest(recordings, &[start], Rival::NONE, &settings)?.covariance
        };
        let is_asked = |column: &Column| {
            !is_base(column.group) && effects.iter().any(|effect| effect.info().id == column.group)
        };
        Ok(ties(&wide.columns, &fitted.at, &covariance, is_asked))
    }
}

/// Whether a column is a constant of the platform and not of an effect that was added.
fn is_of_platform(column: &Column) -> bool {
    column.group == MASS_PROPERTIES || is_base(column.group)
}
