//! Mass properties by the likelihood of the readings.
//! Every number that has a prior is fitted to every sample, as by [`crate::fit`] without an effect: the nine mass properties, constants of
//! the actuators, parameters of the model's effects. Of the nine it is said as well which of them the motion determines.
//! The regressions of eqs. 4.77-4.91 put measured rates into the matrix, so noise biases them towards zero; a likelihood does not.

pub(crate) mod contact;
mod findings;

use whorl_dynamics::effects::BasePrior;
use whorl_dynamics::mass_parameters::{
    MASS_PARAMETERS, MassCovariance, MassVector, mass_vector, prior_stddev,
};
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_prediction::{Followed, PredictionError, Rival, Settings, fit};
use whorl_recording::{Finding, Needs, Recording, Refusal, Why, check};
use whorl_validation::{Comparison, compare, prediction_error};

use contact::{away_from_stop, between_touches};

use crate::case::{Case, usable};
use crate::fitting::refit::{Fit, FittedParameter, Refit};
use crate::parameter_space::Column;
use crate::{DiagnosisError, Options, Outcome};

/// Mass properties show on the bearing only, and after ten seconds at the earliest.
const NEEDS: Needs = Needs { shortest_s: 10.0, free: true, accelerometer: true };
/// By how much likelier another sign must make the readings [natural logarithm]: a hundred thousand to one, as a wheel is accused.
const NEEDED_NATS: f64 = 11.5;

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
    /// Prediction error with the given model, as `whorl compare` prints it; 1 = as good as it says. `None` if no run is long enough.
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
    pub fn usable(&self) -> bool {
        !self.findings.iter().any(|f| f.fatal)
    }

    /// Standard deviations of the nine parameters.
    pub fn stddev(&self) -> MassVector {
        self.covariance.diagonal().map(f64::sqrt)
    }

    /// The model and its prior with everything that was fitted, all together, since it was found together; `None` if a finding is fatal.
    /// Parameters that were not determined keep the prior's values. An effect that the model does not have is not added: that is to be adopted.
    pub fn updated(&self) -> Option<(PlatformModel, ModelPrior)> {
        self.usable().then(|| (self.fit.model.clone(), self.fit.prior.clone()))
    }
}

/// Identifies mass properties from runs of one platform, starting from its model and prior. The runs are never less likely with what
/// is found than with the model as given.
///
/// # Errors
/// When runs cannot be used at all; a result that must not be used is returned with its reasons ([`Identification::usable`]).
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
    let compared = |model: &PlatformModel| -> Outcome<Vec<Comparison>> {
        case.training.iter().map(|run| Ok(compare(run, model, None)?)).collect()
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
    let error_before = prediction_error(&compared(&free)?);
    let mut error_after = error_before;
    let mut findings: Vec<Finding> =
        remarks.into_iter().chain(case.remarks.iter().cloned()).map(Finding::warning).collect();
    if !is_planned {
        let after = compared(&fit.model)?;
        error_after = prediction_error(&after);
        findings.extend(findings::of_fit(&after, fit.is_explained, fitted.stands));
        if after.iter().any(|run| run.unexplained.is_some()) {
            let log_fitted = fitted.followed.iter().map(Followed::log_likelihood).sum();
            findings.extend(reversed_wheel(&case.training, &case.reference.model, log_fitted, &settings)?);
        }
        fit.model.tilt_limit = model.tilt_limit;
    }
    // The others: parameters of an effect that the model has, and corrections of wheels, jets and gyros.
    let place = |(n, column): (usize, &Column)| {
        match column.base.filter(|_| !model.effects.contains_key(column.group))? {
            // Elements of a matrix with their row before their column.
            BasePrior::Inertia(row, column) => Some((n, row * (5 - row) / 2 + column)),
            BasePrior::GravityOffset(axis) => Some((n, 6 + axis)),
            _ => None,
        }
    };
    let nine: Vec<(usize, usize)> = refit.columns.iter().enumerate().filter_map(place).collect();
    let (mut covariance, mut prior_stddevs) = (MassCovariance::zeros(), MassVector::zeros());
    // The correlations of the fit with the deviations that are said of each.
    let share = |n: usize| fit.estimates[n].stddev / fitted.covariance[(n, n)].sqrt();
    for (n, i) in &nine {
        prior_stddevs[*i] = prior_stddev(prior)[*i];
        for (m, j) in &nine {
            covariance[(*i, *j)] = fitted.covariance[(*n, *m)] * share(*n) * share(*m);
        }
    }
    let is_other = |n: &usize| nine.iter().all(|(of_nine, _)| of_nine != n);
    let determined = |i: usize| Determined::of(covariance[(i, i)].sqrt(), prior_stddevs[i]);
    let mut found = Identification {
        estimate: mass_vector(&fit.model.mass_properties),
        determined: std::array::from_fn(determined),
        covariance,
        prior_stddev: prior_stddevs,
        others: (0..refit.columns.len()).filter(is_other).map(|n| fit.estimates[n].clone()).collect(),
        error_before,
        error_after,
        duration_s: case.training.iter().map(Recording::duration_s).sum(),
        findings,
        fit,
    };
    found.findings.extend(findings::of_values(&found, model));
    found.findings.sort_by_key(|finding| !finding.fatal);
    Ok(found)
}

/// What runs hold away from the stop of the bearing, and what was left out, in sentences.
fn pieces(runs: &[Recording], model: &PlatformModel) -> Outcome<(Vec<Recording>, Vec<String>)> {
    if runs.is_empty() {
        return Err(DiagnosisError::NoRecording);
    }
    runs.iter().try_for_each(|run| check(run, model, &NEEDS))?;
    let (usable, mut remarks) = usable(runs, model);
    let mut all = Vec::new();
    for run in &usable {
        // What is left must do as well.
        check(run, model, &NEEDS)?;
        let (pieces, left_out) = between_touches(run, model);
        remarks.extend(left_out);
        let duration_s: f64 = pieces.iter().map(Recording::duration_s).sum();
        if duration_s < NEEDS.shortest_s {
            let run = format!("{}, away from the stop of the bearing", run.name);
            return Err(Refusal { run, why: Why::TooShort(duration_s, NEEDS.shortest_s) }.into());
        }
        all.extend(pieces);
    }
    Ok((all, remarks))
}

/// The wheel whose other sign makes the readings likelier than all that was fitted, `log_fitted` [natural logarithm], and likelier than that of
/// the others: of its spin axis, or of its speeds alone. Another unit of them shows when a recording is read ([`Recording::contradictions`]).
fn reversed_wheel(
    recordings: &[Recording],
    model: &PlatformModel,
    log_fitted: f64,
    settings: &Settings,
) -> Result<Option<Finding>, PredictionError> {
    let log = |recordings: &[Recording], model: &PlatformModel| -> Result<f64, PredictionError> {
        let as_it_is = |_: &[f64]| Some(model.clone());
        Ok(fit(recordings, &[], &as_it_is, &[Vec::new()], Rival::NONE, settings)?.log_posterior)
    };
    let mut likeliest = (log_fitted + NEEDED_NATS, None);
    for (j, wheel) in model.wheels().iter().enumerate() {
        let mut turned = model.clone();
        turned.wheels_mut()[j].spin_axis_b = -wheel.spin_axis_b;
        let mut reversed = recordings.to_vec();
        let speeds = reversed.iter_mut().flat_map(|run| &mut run.wheel_speed_rad_s.value);
        speeds.filter_map(|speeds| speeds.get_mut(j)).for_each(|speed| *speed = -*speed);
        let log = log(recordings, &turned)?.max(log(&reversed, model)?);
        if log > likeliest.0 {
            likeliest = (log, Some(&wheel.name));
        }
    }
    Ok(likeliest.1.map(|name| {
        Finding::fatal(format!(
            "{name} turns the body the wrong way: the sign of its measured speed or of its spin axis in the model is wrong; nothing else can be trusted until that is corrected."
        ))
    }))
}
