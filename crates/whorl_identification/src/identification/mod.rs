//! Mass properties by the likelihood of the readings.
//!
//! Every number that has a prior is fitted to every sample, as everything here fits it ([`crate::fit`] without an effect): the nine mass
//! properties, constants of the actuators, parameters of the model's effects. What is special is what is said of the nine: which of them
//! the motion determines.
//!
//! The regressions of eqs. 4.77-4.91 put measured rates into the matrix, so noise there biases the result towards zero; a
//! likelihood does not.

mod conclusion;
mod contact;
mod wheels;

use whorl_dynamics::mass_parameters::{MASS_PARAMETERS, MassCovariance, MassVector};
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_prediction::{Followed, Needs, Refusal, Rival, Why, check};
use whorl_recording::{Finding, Recording};
use whorl_validation::{Comparison, compare, prediction_error};

use contact::{away_from_stop, between_touches};

use crate::case::Case;
use crate::fitting::refit::{Fit, FittedParameter, Refit};
use crate::signals::readings::usable;
use crate::{DiagnosisError, Options};

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
    /// The nine parameters. A correction of them that the model has as an effect is not among them but among `others`.
    pub estimate: MassVector,
    /// Their covariance, including the uncertainty of the actuators. Where a torque remains that the model does not have, they keep the
    /// deviations that they had ([`FittedParameter::stddev`]).
    pub covariance: MassCovariance,
    /// Standard deviations before the fit; zero: known exactly, and not fitted.
    pub prior_stddev: MassVector,
    /// Whether each was determined by these data.
    pub determined: [Determined; MASS_PARAMETERS],
    /// Parameters of the model's effects, and constants of the actuators as corrections of the model's.
    pub others: Vec<FittedParameter>,
    /// Prediction error with the given model, the same as `whorl compare` prints; 1 = as good as the model says. `None` if no
    /// run is long enough.
    pub error_before: Option<f64>,
    /// The same with what was identified.
    pub error_after: Option<f64>,
    /// Time used \[s\].
    pub duration_s: f64,
    /// Notes for the user, most important first.
    pub findings: Vec<Finding>,
    fit: Fit,
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

    /// The model and its prior with everything that was fitted, all together, since it was found together; `None` if a finding is fatal.
    /// Parameters that were not determined keep the prior's values. An effect that the model does not have is not added: adopting one
    /// is a decision of its own.
    #[must_use]
    pub fn updated(&self) -> Option<(PlatformModel, ModelPrior)> {
        self.usable().then(|| (self.fit.model.clone(), self.fit.prior.clone()))
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
    determine(runs, model, prior, options, false)
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
    let as_stated = Options { delaying: Some(away_from_stop(model)), ..options.clone() };
    determine(runs, model, prior, &as_stated, true)
}

fn determine(
    runs: &[Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    options: &Options,
    is_planned: bool,
) -> Result<Identification, DiagnosisError> {
    let (pieces, remarks) = pieces(runs, model)?;
    let free = away_from_stop(model);
    let case = Case::new(&pieces, &[], &free, prior, options)?;
    let compared = |model: &PlatformModel| -> Result<Vec<Comparison>, DiagnosisError> {
        case.training.iter().map(|run| Ok(compare(run, model)?)).collect()
    };
    let mut settings = case.runs().prediction();
    if is_planned {
        // No step is taken: the information is that at the model.
        settings.fit_rounds = 0;
    }
    let refit = Refit::own(&case.reference, &case.available);
    let as_given = vec![0.0; refit.columns.len()];
    let fitted = refit.likeliest(&case.training, &[as_given], Rival::NONE, &settings)?;
    let mut fit = refit.described(&fitted)?;
    let error = prediction_error(&compared(&free)?);
    let mut findings: Vec<Finding> =
        remarks.into_iter().chain(case.remarks()).map(Finding::warning).collect();
    let mut errors = (error, error);
    if !is_planned {
        let after = compared(&fit.model)?;
        errors.1 = prediction_error(&after);
        findings.extend(conclusion::of_fit(&after, fit.is_explained, fitted.stands));
        if after.iter().any(|run| run.unexplained.is_some()) {
            let log_fitted = fitted.followed.iter().map(Followed::log_likelihood).sum();
            findings.extend(wheels::check(&case.training, &case.reference.model, log_fitted, &settings)?);
        }
        fit.model.tilt_limit = model.tilt_limit;
    }
    Ok(conclusion::conclude(&case, &refit, &fitted, fit, errors, findings))
}

/// What runs hold away from the stop of the bearing, and what was left out, in sentences.
fn pieces(
    runs: &[Recording],
    model: &PlatformModel,
) -> Result<(Vec<Recording>, Vec<String>), DiagnosisError> {
    if runs.is_empty() {
        return Err(DiagnosisError::NoRecording);
    }
    for run in runs {
        check(run, model, &NEEDS)?;
    }
    let (usable, mut remarks) = usable(runs, model);
    let mut all = Vec::new();
    for run in &*usable {
        // What is left must do as well.
        check(run, model, &NEEDS)?;
        let pieces = between_touches(run, model, &mut remarks);
        let duration_s: f64 = pieces.iter().map(Recording::duration_s).sum();
        if duration_s < NEEDS.shortest_s {
            let run = format!("{}, away from the stop of the bearing", run.name);
            return Err(Refusal { run, why: Why::TooShort(duration_s, NEEDS.shortest_s) }.into());
        }
        all.extend(pieces);
    }
    Ok((all, remarks))
}
