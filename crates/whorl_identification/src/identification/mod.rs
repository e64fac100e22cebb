//! Mass properties by the likelihood of the readings.
//!
//! The nine parameters, the constants of the actuators that a run used, and the parameters of the model's effects are fitted
//! together by [`whorl_prediction::fit`], each within what its prior knows: a filter carries the model from reading to reading
//! with the recorded commands, and the likeliest values are those with which it predicts the readings best. Sensor biases,
//! noise, and torque that the model does not have are found on the way, so the uncertainty of the result includes theirs. How
//! well a model predicts before and after is said by [`whorl_validation::compare`], as everywhere.
//!
//! The regressions of eqs. 4.77-4.91 put measured rates into the matrix, so noise there biases the result towards zero; a
//! likelihood does not.

mod conclusion;
mod contact;
mod findings;
mod parameters;
mod readings;
mod updated;
mod wheels;

use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_prediction::{Followed, Settings, fit};
use whorl_prediction::{Needs, Refusal, check};
use whorl_recording::Recording;
use whorl_validation::{Comparison, ValidationError, compare, prediction_error};

use crate::finding::{DataError, Finding};
use conclusion::{Fit, conclude};
use contact::{away_from_stop, between_touches};
use parameters::Parameters;
pub use readings::usable_readings;
pub use updated::UpdateError;
use whorl_dynamics::mass_parameters::{MASS_PARAMETERS, MassCovariance, MassVector};

/// Mass properties show on the bearing only, and after ten seconds at the earliest.
const NEEDS: Needs = Needs { shortest_s: 10.0, free: true, accelerometer: true };

/// Whether and how well a parameter was determined.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Determined {
    /// Determined by the data: uncertainty below half the prior's.
    Yes,
    /// A little: below 0.9 of the prior's.
    Hardly,
    /// The value is the prior's.
    No,
}

impl Determined {
    pub(crate) fn of(stddev: f64, before: f64) -> Self {
        match stddev / before {
            share if share < 0.5 => Self::Yes,
            share if share < 0.9 => Self::Hardly,
            _ => Self::No,
        }
    }
}

/// A parameter that was fitted beside the mass properties.
#[derive(Debug, Clone, PartialEq)]
pub struct IdentifiedParameter {
    /// Id of the effect; of a constant of an actuator, of the effect that corrects it.
    pub effect: &'static str,
    /// Name of the parameter.
    pub name: String,
    /// Its unit.
    pub unit: &'static str,
    /// Value in the given model.
    pub before: f64,
    /// Value, within the parameter's range.
    pub value: f64,
    /// Standard deviation.
    pub stddev: f64,
    /// Standard deviation before the fit.
    pub prior_stddev: f64,
    /// Whether it was determined by these data.
    pub determined: Determined,
    /// Whether the fit has driven it to an end of its range, from which the data would lead it on.
    pub at_bound: bool,
}

/// Identified mass properties with their uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct Identification {
    /// The nine parameters, realisable.
    pub estimate: MassVector,
    /// Their covariance, including the uncertainty of the actuators.
    pub covariance: MassCovariance,
    /// Standard deviations if wheels and jets were exactly as the model says.
    pub stddev_known_actuators: MassVector,
    /// Standard deviations before the fit; zero: known exactly, and not fitted.
    pub prior_stddev: MassVector,
    /// Whether each was determined by these data.
    pub determined: [Determined; MASS_PARAMETERS],
    /// Singular values of the data's information in units of the prior's: below one, that combination of
    /// parameters is known from the prior rather than from the data. Descending.
    pub singular_values: MassVector,
    /// The combinations that belong to the singular values, as columns, in units of the prior's
    /// standard deviations.
    pub combinations: MassCovariance,
    /// Parameters of effects: those of the model, and those that every fit includes.
    pub effects: Vec<IdentifiedParameter>,
    /// Constants of the actuators, as corrections of the model's.
    pub actuators: Vec<IdentifiedParameter>,
    /// Prediction error with the given model, the same as `whorl compare` prints, away from the bearing's stop; 1 = as good as the model says. `None` if no
    /// run is long enough.
    pub error_before: Option<f64>,
    /// The same with what was identified.
    pub error_after: Option<f64>,
    /// By how much the recordings are likelier than with the given model [natural logarithm], not negative.
    pub gain_nats: f64,
    /// Time used \[s\].
    pub duration_s: f64,
    /// Whether the likeliest inertia is impossible for a rigid body, and the nearest possible one was taken.
    pub moved_to_realisable: bool,
    /// Notes for the user, most important first.
    pub findings: Vec<Finding>,
    updated: Option<(PlatformModel, ModelPrior)>,
}

impl Identification {
    /// Whether the result may be used, that is, no finding is fatal.
    #[must_use]
    pub fn usable(&self) -> bool {
        !self.findings.iter().any(|f| f.fatal)
    }

    /// Standard deviations of the nine parameters.
    #[must_use]
    pub fn stddev(&self) -> MassVector {
        self.covariance.diagonal().map(f64::sqrt)
    }
}

/// Identifies mass properties from runs of one platform, starting from its model and prior. The runs are never less likely with what
/// is found than with the model as given.
///
/// # Errors
/// When runs cannot be used at all; a result that must not be used is returned with its reasons
/// ([`Identification::usable`]).
pub fn identify(
    runs: &[&Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    settings: &Settings,
) -> Result<Identification, DataError> {
    let Usable { pieces: recordings, of_run, mut findings } = usable(runs, model)?;
    let before = compared(&recordings, model)?;
    let parameters = Parameters::new(model, prior, &recordings);
    let fitted = fitted(&recordings, &parameters, settings)?;
    let after = match parameters.written(&fitted.at) {
        Some(model) => compared(&recordings, &model)?,
        None => before.clone(),
    };
    findings.extend(findings::of_fit(&after, &of_run));
    if after.iter().any(|run| run.unexplained.is_some()) {
        let log_fitted = fitted.followed.iter().map(Followed::log_likelihood).sum();
        findings.extend(wheels::check(&recordings, &away_from_stop(model), log_fitted, settings)?);
    }
    let errors = (prediction_error(&before), prediction_error(&after));
    Ok(conclude(&Fit { parameters, prior, fitted, errors, recordings: &recordings, findings }))
}

/// What recordings would determine if their motion were exactly the model's: the covariance that [`identify`] reaches, without
/// fitting. They are usually a simulation of a planned experiment with the model itself as truth.
///
/// # Errors
/// When the recordings cannot be used at all.
pub fn predict(
    runs: &[&Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    settings: &Settings,
) -> Result<Identification, DataError> {
    let Usable { pieces: recordings, findings, .. } = usable(runs, model)?;
    let parameters = Parameters::new(model, prior, &recordings);
    // No step is taken: the information is that at the model.
    let fitted = fitted(&recordings, &parameters, &Settings { fit_rounds: 0, ..*settings })?;
    let error = prediction_error(&compared(&recordings, model)?);
    Ok(conclude(&Fit {
        parameters,
        prior,
        fitted,
        errors: (error, error),
        recordings: &recordings,
        findings,
    }))
}

/// Runs without readings that say nothing.
struct Usable {
    /// Away from the bearing's stop.
    pieces: Vec<Recording>,
    /// The run that each is a piece of, by name.
    of_run: Vec<String>,
    findings: Vec<Finding>,
}

fn usable(runs: &[&Recording], model: &PlatformModel) -> Result<Usable, DataError> {
    let mut usable = Usable { pieces: Vec::new(), of_run: Vec::new(), findings: Vec::new() };
    for run in runs {
        check(run, model, &NEEDS)?;
        let whole = usable_readings(run, model, &mut usable.findings);
        // What is left must do as well.
        check(&whole, model, &NEEDS)?;
        let pieces = between_touches(whole, model, &mut usable.findings);
        let duration_s: f64 = pieces.iter().map(Recording::duration_s).sum();
        if duration_s < NEEDS.shortest_s {
            let run = format!("{}, away from the stop of the bearing", run.name);
            return Err(Refusal::TooShort { run, duration_s, needed_s: NEEDS.shortest_s }.into());
        }
        usable.of_run.extend(pieces.iter().map(|_| run.name.clone()));
        usable.pieces.extend(pieces);
    }
    Ok(usable)
}

fn fitted(
    recordings: &[Recording],
    parameters: &Parameters<'_>,
    settings: &Settings,
) -> Result<whorl_prediction::Fitted, DataError> {
    let model_at = |units: &[f64]| parameters.model_at(units).map(|model| away_from_stop(&model));
    let as_given = vec![0.0; parameters.free.len()];
    Ok(fit(recordings, &parameters.known(), &model_at, &[as_given], settings)?)
}

fn compared(recordings: &[Recording], model: &PlatformModel) -> Result<Vec<Comparison>, ValidationError> {
    let model = away_from_stop(model);
    recordings.iter().map(|run| compare(run, &model)).collect()
}
