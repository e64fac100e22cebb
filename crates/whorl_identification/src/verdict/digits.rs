//! What the gyro's own digits show, as a row of the answer.

use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::{Signature, catalogue};
use whorl_recording::Recording;

use crate::signals::clamped::is_clamped;
use crate::signals::digits::{Digits, digits_of_gyro};
use crate::verdict::diagnosis::{Candidate, ParameterEstimate};

/// Clipping and coarse steps of the gyro beyond what the model has, which the readings themselves show.
pub(super) fn digits_row(
    training: &[Recording],
    held_out: &[Recording],
    model: &PlatformModel,
    is_excluded: impl Fn(&str) -> bool,
) -> Option<Candidate> {
    let (effect, range_name, step_name) = catalogue().iter().find_map(|effect| match effect.signature() {
        Some(Signature::GyroDigits { range, step }) => Some((effect.info().id, range, step)),
        _ => None,
    })?;
    if is_excluded(effect) {
        return None;
    }
    let errors = &model.sensors.gyro.errors;
    let of = |runs: &[Recording]| -> Vec<Digits> {
        runs.iter().filter(|run| !is_clamped(run, model)).map(|run| digits_of_gyro(run, model)).collect()
    };
    let digits = of(training);
    let range = digits
        .iter()
        .filter_map(|of_run| of_run.clips_at_rad_s)
        .filter(|limit| *limit < 0.98 * errors.range)
        .fold(f64::INFINITY, f64::min);
    let step = digits.iter().map(|of_run| of_run.step_rad_s).fold(f64::INFINITY, f64::min);
    let coarse = step.is_finite() && step > 1.5 * errors.quantum && step > 0.3 * errors.noise_stddev.amin();
    if !range.is_finite() && !coarse {
        return None;
    }
    let parameter = |name: &str, estimate: f64, stddev: f64| ParameterEstimate {
        name: name.to_owned(),
        unit: "rad/s".to_owned(),
        estimate,
        stddev,
        at_bound: false,
        smallest_detectable: 5.0 * stddev,
    };
    let mut parameters = Vec::new();
    if range.is_finite() {
        parameters.push(parameter(range_name, range, 0.5 * step.clamp(1e-6, 1e-3)));
    }
    if coarse {
        parameters.push(parameter(step_name, step, 1e-3 * step));
    }
    let seen_nats = |of_run: &Digits| {
        of_run.clips_nats * f64::from(range.is_finite()) + of_run.step_nats * f64::from(coarse)
    };
    let log_evidence: f64 = digits.iter().map(seen_nats).sum();
    let held = of(held_out);
    Some(Candidate {
        effect: effect.to_owned(),
        delta_log_evidence: log_evidence,
        held_out_gain: (!held.is_empty()).then(|| held.iter().map(seen_nats).sum()),
        // Readings that are rounded or cut off are no torque, and no other constant absorbs them.
        share_of_excess: 0.0,
        swallowed_by_base: 0.0,
        detectability: 2.0 * log_evidence,
        indistinguishable_from: Vec::new(),
        parameters,
    })
}
