//! The numbers in which the gyro reads: where its readings pile up, and the steps of its output.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;

use crate::recording::Recording;

/// How far a reading may be from a whole multiple of a step, in steps.
const OFF_GRID: f64 = 0.02;
/// How far readings at the end of a range may be apart, as a share of it.
pub(crate) const AT_END: f64 = 1e-9;

/// Where the readings of a run pile up, and their steps.
#[derive(Debug, Clone, Copy, Default)]
pub struct Digits {
    /// Where readings pile up at their largest [rad/s].
    pub clips_at_rad_s: Option<f64>,
    /// Log evidence of that: noise hardly repeats its largest value.
    pub clips_nats: f64,
    /// Step of its output [rad/s]; 0 = none found.
    pub step_rad_s: f64,
    /// Log evidence of that: of readings without steps few are close to multiples of one.
    pub step_nats: f64,
}

/// What a run shows of them, beside the noise of its model.
#[must_use]
pub fn digits_of_gyro(recording: &Recording, model: &PlatformModel) -> Digits {
    let values = &recording.gyro_b_rad_s.value;
    let largest = values.iter().map(Vector3::amax).fold(0.0, f64::max);
    let from = |least: f64| values.iter().filter(|v| v.amax() >= least).count();
    let at_largest = from(largest * (1.0 - AT_END));
    // Noise never repeats its largest value many times unless the output has coarse steps.
    let axis = recording.gyro_axes().iter().position(|has| *has).unwrap_or(0);
    let (step, on_grid) = step_of(values.iter().map(|v| v[axis]));
    let noise = model.sensors.gyro.errors.noise_stddev.amax();
    let coarse = step > 0.2 * noise;
    // With steps, a clipped reading piles up in one step only.
    let piles_up = !coarse || at_largest * 2 > from(largest - 3.0 * step.max(1e-12));
    let is_clipped = at_largest >= if coarse { 60 } else { 12 } && largest > 0.0 && piles_up;
    // A normal variable is within w of one number with a probability below 2 w / (sqrt(2 pi) sigma).
    let within = (AT_END * largest).max(0.5 * step);
    let rare = (0.5 * std::f64::consts::TAU.sqrt() * noise / within).ln().max(0.0);
    Digits {
        clips_at_rad_s: is_clipped.then_some(largest),
        clips_nats: if is_clipped { at_largest as f64 * rare } else { 0.0 },
        step_rad_s: step,
        step_nats: -(on_grid as f64) * (2.0 * OFF_GRID).ln(),
    }
}

/// Smallest nonzero difference that all readings are whole multiples of, and how many are; 0 = none found.
fn step_of(values: impl Iterator<Item = f64>) -> (f64, usize) {
    let mut sorted: Vec<f64> = values.take(20_000).collect();
    sorted.sort_by(f64::total_cmp);
    let (Some(first), Some(last)) = (sorted.first(), sorted.last()) else { return (0.0, 0) };
    let smallest = sorted.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 1e-9).fold(f64::INFINITY, f64::min);
    // Over a wide span it is known better.
    let count = ((last - first) / smallest).round();
    let step = (last - first) / count;
    let is_off = |multiple: f64| (multiple - multiple.round()).abs() >= OFF_GRID;
    let on_grid = sorted.iter().filter(|x| !is_off((*x - first) / step)).count();
    let is_step = (1.0..1e6).contains(&count) && on_grid * 1000 >= sorted.len() * 998;
    if is_step { (step, on_grid) } else { (0.0, 0) }
}
