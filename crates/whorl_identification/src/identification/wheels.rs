//! Wheels whose measured speeds turn the body the wrong way, or by another share than the model's.

use whorl_dynamics::PlatformModel;
use whorl_prediction::{Parameter, Settings, fit};
use whorl_recording::{Recording, Series};

use crate::finding::Finding;

/// Freedom of a wheel's strength over the model's, one standard deviation: the sign may be wrong, and a unit.
const LOOSE_STRENGTH: f64 = 2.0;
/// Least strength that a model is made with: a wheel has some inertia.
const LEAST_STRENGTH: f64 = 1e-3;
/// Strengths that are known worse than this say nothing.
const KNOWN: f64 = 0.3;
/// Shares that are as close to one as this are the platform's inertia as well as the wheel's.
const FAR_OFF: f64 = 0.3;

/// Fits the wheels' strengths alone, as multiples of the model's, with the wheels driven along their measured speeds. Where one
/// has the wrong sign no start close to the model leads there, so each sign is tried.
pub(super) fn check(recordings: &[Recording], model: &PlatformModel, settings: &Settings) -> Vec<Finding> {
    let along_speeds: Vec<Recording> = recordings
        .iter()
        .filter(|run| !run.wheel_speed_rad_s.is_empty())
        .map(|run| Recording { wheel_torque_command_n_m: Series::default(), ..run.clone() })
        .collect();
    let wheels = model.wheels().len();
    if along_speeds.is_empty() || wheels == 0 {
        return Vec::new();
    }
    let known = Parameter { stddev: 1.0, range: (-2.0, 2.0) };
    let model_at = |units: &[f64]| Some(with_strengths(model, units));
    let given = vec![0.0; wheels];
    let turned = |j: usize| {
        let mut start = given.clone();
        if let Some(slot) = start.get_mut(j) {
            *slot = -2.0 / LOOSE_STRENGTH;
        }
        start
    };
    let starts: Vec<Vec<f64>> = std::iter::once(given.clone()).chain((0..wheels).map(turned)).collect();
    let Ok(found) = fit(&along_speeds, &vec![known; wheels], &model_at, &starts, settings) else {
        return Vec::new();
    };
    let judged = model.wheels().iter().zip(&found.at).enumerate().filter_map(|(j, (wheel, units))| {
        let stddev = LOOSE_STRENGTH * found.covariance[(j, j)].sqrt();
        judge(&wheel.name, 1.0 + LOOSE_STRENGTH * units, stddev)
    });
    judged.collect()
}

fn judge(name: &str, share: f64, stddev: f64) -> Option<Finding> {
    if stddev.is_nan() || stddev > KNOWN {
        return None;
    }
    if share < -3.0 * stddev {
        return Some(Finding::fatal(format!(
            "{name} turns the body the wrong way: its strength comes out as {share:.2} +- {stddev:.2} of the model's. The sign of its measured speed or of its spin axis in the model is wrong; nothing else can be trusted until that is mended."
        )));
    }
    let is_far = (share - 1.0).abs() > (5.0 * stddev).max(FAR_OFF);
    is_far.then(|| {
        Finding::fatal(format!(
            "{name} has {share:.2} +- {stddev:.2} of the strength that the model gives it: its spin inertia, the unit of its speed, or the platform's inertia is far off."
        ))
    })
}

fn with_strengths(model: &PlatformModel, units: &[f64]) -> PlatformModel {
    let mut model = model.clone();
    for (wheel, units) in model.wheels_mut().iter_mut().zip(units) {
        let share = 1.0 + LOOSE_STRENGTH * units;
        wheel.spin_inertia_kg_m2 *= share.abs().max(LEAST_STRENGTH);
        if share < 0.0 {
            wheel.spin_axis_b = -wheel.spin_axis_b;
        }
    }
    model
}
