//! Mass properties by the likelihood of the readings.
//!
//! Every number that has a prior is fitted to every sample, as everything here fits it ([`crate::fit`] without an effect): the nine mass
//! properties, constants of the actuators, parameters of the model's effects. What is special is what is said of the nine: which of them
//! the motion determines, which combinations, and how well they would be known if the actuators were exact.
//!
//! The regressions of eqs. 4.77-4.91 put measured rates into the matrix, so noise there biases the result towards zero; a
//! likelihood does not.

mod conclusion;
mod contact;
mod findings;
mod wheels;

use thiserror::Error;
use whorl_dynamics::mass_parameters::{MASS_PARAMETERS, MassCovariance, MassVector};
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_prediction::{Followed, Needs, Refusal, Rival, Settings, check};
use whorl_recording::Recording;
use whorl_validation::{Comparison, compare, prediction_error};

use contact::{away_from_stop, between_touches};

use crate::case::Case;
use crate::fitting::refit::{Fit, FittedParameter, Refit};
use crate::signals::readings::usable;
use crate::{DiagnosisError, Options};
use whorl_recording::Finding;

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
    /// By its standard deviations after and before.
    #[must_use]
    pub fn of(stddev: f64, before: f64) -> Self {
        match stddev / before {
            share if share < 0.5 => Self::Yes,
            share if share < 0.9 => Self::Hardly,
            _ => Self::No,
        }
    }
}

/// Identified mass properties with their uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct Identification {
    /// The nine parameters. A correction of them that the model has as an effect is not among them but among `effects`.
    pub estimate: MassVector,
    /// Their covariance, including the uncertainty of the actuators. Where a torque remains that the model does not have, they keep the
    /// deviations that they had ([`FittedParameter::stddev`]).
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
    /// Parameters of the model's effects.
    pub effects: Vec<FittedParameter>,
    /// Constants of the actuators, as corrections of the model's.
    pub actuators: Vec<FittedParameter>,
    /// Prediction error with the given model, the same as `whorl compare` prints; 1 = as good as the model says. `None` if no
    /// run is long enough.
    pub error_before: Option<f64>,
    /// The same with what was identified.
    pub error_after: Option<f64>,
    /// By how much the recordings are likelier than with the given model [natural logarithm], not negative.
    pub gain_nats: f64,
    /// Time used \[s\].
    pub duration_s: f64,
    /// Notes for the user, most important first.
    pub findings: Vec<Finding>,
    fit: Fit,
}

/// Why a result cannot be put into a model.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("the result must not be used: {0}")]
pub struct UpdateError(String);

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

    /// The model and its prior with everything that was fitted, all together, since it was found together. Parameters that were not
    /// determined keep the prior's values. An effect that the model does not have is not added: adopting one is a decision of its own.
    ///
    /// # Errors
    /// When a finding is fatal.
    pub fn updated(&self) -> Result<(PlatformModel, ModelPrior), UpdateError> {
        match self.findings.iter().find(|finding| finding.fatal) {
            Some(finding) => Err(UpdateError(finding.text.clone())),
            None => Ok((self.fit.model.clone(), self.fit.prior.clone())),
        }
    }
}

/// Identifies mass properties from runs of one platform, starting from its model and prior. The runs are never less likely with what
/// is found than with the model as given.
///
/// # Errors
/// When runs cannot be used at all; a result that must not be used is returned with its reasons
/// ([`Identification::usable`]).
pub fn identify(
    runs: &[Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    options: &Options,
) -> Result<Identification, DiagnosisError> {
    let free = Away::new(runs, model)?;
    let case = Case::new(&free.pieces, &[], &free.model, prior, options)?;
    let settings = case.runs().prediction();
    let (refit, fitted) = fitted(&case, &settings)?;
    let mut fit = refit.described(&fitted)?;
    let (before, after) = (compared(&case, &free.model)?, compared(&case, &fit.model)?);
    fit.model.tilt_limit = model.tilt_limit;
    let mut findings = free.findings(&case);
    findings.extend(findings::of_fit(&after, &free.of_run, fit.is_explained, fitted.stands));
    if after.iter().any(|run| run.unexplained.is_some()) {
        let log_fitted = fitted.followed.iter().map(Followed::log_likelihood).sum();
        findings.extend(wheels::check(&case.training, &case.reference.model, log_fitted, &settings)?);
    }
    let errors = (prediction_error(&before), prediction_error(&after));
    Ok(conclusion::conclude(&case, &refit, &fitted, fit, errors, findings))
}

/// What recordings would determine if their motion were exactly the model's: the covariance that [`identify`] reaches, without
/// fitting. They are usually a simulation of a planned experiment with the model itself as truth.
///
/// # Errors
/// When the recordings cannot be used at all.
pub fn predict(
    runs: &[Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    options: &Options,
) -> Result<Identification, DiagnosisError> {
    let free = Away::new(runs, model)?;
    let as_stated = Options { delaying: Some(free.model.clone()), ..options.clone() };
    let case = Case::new(&free.pieces, &[], &free.model, prior, &as_stated)?;
    // No step is taken: the information is that at the model.
    let (refit, fitted) = fitted(&case, &Settings { fit_rounds: 0, ..case.runs().prediction() })?;
    let error = prediction_error(&compared(&case, &free.model)?);
    let findings = free.findings(&case);
    let fit = refit.described(&fitted)?;
    Ok(conclusion::conclude(&case, &refit, &fitted, fit, (error, error), findings))
}

/// Runs away from the stop of the bearing, and the model without it.
struct Away {
    pieces: Vec<Recording>,
    /// The run that each is a piece of, by name.
    of_run: Vec<String>,
    model: PlatformModel,
    remarks: Vec<String>,
}

impl Away {
    fn new(runs: &[Recording], model: &PlatformModel) -> Result<Self, DiagnosisError> {
        if runs.is_empty() {
            return Err(DiagnosisError::NoRecording);
        }
        for run in runs {
            check(run, model, &NEEDS)?;
        }
        let (usable, remarks) = usable(runs, model);
        let mut away = Self { pieces: Vec::new(), of_run: Vec::new(), model: away_from_stop(model), remarks };
        for run in &*usable {
            // What is left must do as well.
            check(run, model, &NEEDS)?;
            let pieces = between_touches(run, model, &mut away.remarks);
            let duration_s: f64 = pieces.iter().map(Recording::duration_s).sum();
            if duration_s < NEEDS.shortest_s {
                let run = format!("{}, away from the stop of the bearing", run.name);
                return Err(Refusal::TooShort { run, duration_s, needed_s: NEEDS.shortest_s }.into());
            }
            away.of_run.extend(pieces.iter().map(|_| run.name.clone()));
            away.pieces.extend(pieces);
        }
        Ok(away)
    }

    /// What was left out, and which low-passes do not delay as the model says.
    fn findings(&self, case: &Case<'_>) -> Vec<Finding> {
        self.remarks.iter().cloned().chain(case.remarks()).map(Finding::warning).collect()
    }
}

fn fitted<'a>(
    case: &'a Case<'_>,
    settings: &Settings,
) -> Result<(Refit<'a>, whorl_prediction::Fitted), DiagnosisError> {
    let refit = Refit::own(&case.reference, &case.available);
    let as_given = vec![0.0; refit.columns.len()];
    let fitted = refit.likeliest(&case.training, &[as_given], Rival::NONE, settings)?;
    Ok((refit, fitted))
}

fn compared(case: &Case<'_>, model: &PlatformModel) -> Result<Vec<Comparison>, DiagnosisError> {
    case.training.iter().map(|run| Ok(compare(run, model)?)).collect()
}
