//! Parameters of effects that recordings do not tell apart.

use whorl_dynamics::Effect;
use whorl_dynamics::effects::{Role, find};
use whorl_prediction::{Fitted, Rival, Settings};
use whorl_recording::Recording;

use crate::DiagnosisError;
use crate::fitting::refit::{Fit, Refit};
use crate::fitting::tie::Tie;

/// Deviations of both parameters of a tie are at least so many times that of their combination.
const TIED: f64 = 10.0;

/// Finds pairs of parameters of these effects of which a combination is known at least [`TIED`] times as well as either. Amplitudes of an effect
/// that took no part in the fit are asked about as well, as large as those that did: they need not be zero. What is not told apart is left
/// open, also for a fit that comes after: of each no more is known than that, and the second is in the model, if only as neutral.
pub(crate) fn leave_open_what_is_tied(
    fit: &mut Fit,
    (refit, fitted): (&Refit<'_>, &Fitted),
    recordings: &[Recording],
    effects: &[&'static dyn Effect],
    threads: usize,
) -> Result<(), DiagnosisError> {
    let mut wide = refit.clone();
    // Constants of the platform are not effects of the model.
    let effects: Vec<_> = effects.iter().filter(|effect| !effect.is_base()).collect();
    for effect in &effects {
        let own = refit.columns.iter().zip(&refit.stddevs).filter(|(c, _)| c.group == effect.info().id);
        let size = own.map(|(column, stddev)| stddev / column.catalogue_stddev).fold(1.0, f64::max);
        let mut further = refit.reference.parameter_columns(**effect);
        further.retain(|c| c.role == Role::Amplitude && !refit.columns.iter().any(|own| own.is(c)));
        wide.stddevs.extend(further.iter().map(|column| size * column.catalogue_stddev));
        wide.columns.extend(further);
    }
    let mut at = fitted.at.clone();
    at.resize(wide.columns.len(), 0.0);
    let covariance = if wide.columns.len() == refit.columns.len() {
        fitted.covariance.clone()
    } else {
        let settings = Settings { threads, ..refit.reference.settings.prediction };
        wide.likeliest(recordings, std::slice::from_ref(&at), Rival::NONE, &settings)?.covariance
    };
    let is_asked = |i: &usize| effects.iter().any(|effect| effect.info().id == wide.columns[*i].group);
    let asked: Vec<usize> = (0..wide.columns.len()).filter(is_asked).collect();
    let in_units = |i: usize, j: usize| covariance[(i, j)] * wide.columns[i].scale * wide.columns[j].scale;
    for (k, &first) in asked.iter().enumerate() {
        for &second in &asked[k + 1..] {
            let variances = [first, second].map(|i| in_units(i, i));
            let ratio = -in_units(first, second) / variances[1];
            let variance = (variances[0] + ratio * in_units(first, second)).max(0.0);
            let least = TIED * TIED * variance;
            if variances[0] > least && ratio * ratio * variances[1] > least {
                let of = |i: usize| (wide.columns[i].group.to_owned(), wide.columns[i].name.clone());
                fit.ties.push(Tie {
                    parameters: [first, second].map(of),
                    unit: wide.columns[first].unit.to_owned(),
                    ratio,
                    value: at[first] * wide.columns[first].scale
                        + ratio * at[second] * wide.columns[second].scale,
                    stddev: variance.sqrt(),
                    stddevs: variances.map(f64::sqrt),
                });
            }
        }
    }
    for tie in &fit.ties {
        for ((effect, name), stddev) in tie.parameters.iter().zip(tie.stddevs) {
            let specs = find(effect).map(|of| of.parameters(&fit.model)).unwrap_or_default();
            let neutral = specs.iter().find(|spec| spec.name == *name).map_or(0.0, |spec| spec.neutral);
            fit.model.effects.entry(effect.clone()).or_default().entry(name.clone()).or_insert(neutral);
            let known = fit.prior.effects.entry(effect.clone()).or_default().entry(name.clone());
            known.and_modify(|known| *known = known.max(stddev)).or_insert(stddev);
        }
    }
    Ok(())
}
