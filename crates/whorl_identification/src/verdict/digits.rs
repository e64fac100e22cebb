//! The effect of the numbers in which the gyro reads.

use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::{Signature, catalogue};
use whorl_recording::{Digits, Recording, digits_of_gyro};

use crate::verdict::diagnosis::{Candidate, ParameterEstimate};

/// Clipping and coarse steps of the gyro beyond what the model has, which the readings themselves show.
pub(crate) fn row(
    (training, held_out): (&[Recording], &[Recording]),
    model: &PlatformModel,
    is_excluded: impl Fn(&str) -> bool,
) -> Option<Candidate> {
    let (effect, range_name, step_name) = catalogue().iter().find_map(|effect| match effect.signature() {
        Some(Signature::GyroDigits { range, step }) => Some((effect.info().id, range, step)),
        _ => None,
    })?;
    let errors = &model.sensors.gyro.errors;
    let of = |runs: &[Recording]| -> Vec<Digits> {
        runs.iter().filter(|run| !run.is_clamped(model)).map(|run| digits_of_gyro(run, model)).collect()
    };
    let digits = of(training);
    let clips_at = digits.iter().filter_map(|of_run| of_run.clips_at_rad_s);
    let range = clips_at.filter(|limit| *limit < 0.98 * errors.range).min_by(f64::total_cmp);
    let step = digits.iter().map(|of_run| of_run.step_rad_s).min_by(f64::total_cmp).unwrap_or(f64::INFINITY);
    let coarse = step.is_finite() && step > 1.5 * errors.quantum && step > 0.3 * errors.noise_stddev.amin();
    if is_excluded(effect) || range.is_none() && !coarse {
        return None;
    }
    let stddev = 0.5 * step.clamp(1e-6, 1e-3);
    let of_range = range.map(|range| ParameterEstimate::new(range_name, "rad/s", range, stddev));
    let of_step = coarse.then(|| ParameterEstimate::new(step_name, "rad/s", step, 1e-3 * step));
    let parameters = of_range.into_iter().chain(of_step).collect();
    let seen_nats = |of_run: &Digits| {
        of_run.clips_nats * f64::from(range.is_some()) + of_run.step_nats * f64::from(coarse)
    };
    let log_evidence: f64 = digits.iter().map(seen_nats).sum();
    Some(Candidate {
        held_out_gain: (!held_out.is_empty()).then(|| of(held_out).iter().map(seen_nats).sum()),
        // Readings that are rounded or cut off are no torque.
        share_of_excess: 0.0,
        ..Candidate::seen(effect, 2.0 * log_evidence, log_evidence, parameters)
    })
}
