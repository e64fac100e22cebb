//! The numbers in which the gyro reads: where its readings pile up, and the steps of its output.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_recording::Recording;

/// How far a reading may be from a whole multiple of a step, in steps.
const OFF_GRID: f64 = 0.02;
/// How far readings at the end of a range may be apart, as a share of it.
pub(super) const AT_END: f64 = 1e-9;

/// What the gyro's readings show of the numbers in which it reads.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Digits {
    /// Where readings pile up at their largest [rad/s].
    pub clips_at_rad_s: Option<f64>,
    /// Log evidence of that: noise hardly repeats its largest value.
    pub clips_nats: f64,
    /// Step of its output [rad/s]; 0 = none found.
    pub step_rad_s: f64,
    /// Log evidence of that: of readings without steps few are close to multiples of one.
    pub step_nats: f64,
}

/// Where the gyro's readings pile up at their largest, and the step of its output.
pub(crate) fn digits_of_gyro(recording: &Recording, model: &PlatformModel) -> Digits {
    let values = &recording.gyro_b_rad_s.value;
    let largest = values.iter().map(Vector3::amax).fold(0.0, f64::max);
    let at_largest = values.iter().filter(|v| v.amax() >= largest * (1.0 - AT_END)).count();
    // Noise never repeats its largest value many times unless the output has coarse steps.
    let axis = recording.gyro_axes().iter().position(|has| *has).unwrap_or(0);
    let (step, on_grid) = step_of(values.iter().map(|v| v[axis]));
    let noise = model.sensors.gyro.errors.noise_stddev.amax();
    let coarse = step > 0.2 * noise;
    let clips = at_largest >= if coarse { 60 } else { 12 } && largest > 0.0;
    let near = values.iter().filter(|v| v.amax() >= largest - 3.0 * step.max(1e-12)).count();
    // With steps, a clipped reading piles up in one step only.
    let piles_up = !coarse || at_largest * 2 > near;
    // A normal variable is within w of one number with a probability below 2 w / (sqrt(2 pi) sigma).
    let within = (AT_END * largest).max(0.5 * step);
    let rare = (0.5 * std::f64::consts::TAU.sqrt() * noise / within).ln().max(0.0);
    let is_clipped = clips && piles_up;
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
    let smallest = sorted.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 1e-9).fold(f64::INFINITY, f64::min);
    if !smallest.is_finite() {
        return (0.0, 0);
    }
    // Refine the step over a wide span, then test that readings are multiples of it.
    let (Some(first), Some(last)) = (sorted.first(), sorted.last()) else { return (0.0, 0) };
    let count = ((last - first) / smallest).round();
    if !(1.0..1e6).contains(&count) {
        return (0.0, 0);
    }
    let step = (last - first) / count;
    let fits = |x: &f64| {
        let multiple = (x - first) / step;
        (multiple - multiple.round()).abs() < OFF_GRID
    };
    let on_grid = sorted.iter().filter(|x| fits(x)).count();
    if on_grid * 1000 >= sorted.len() * 998 { (step, on_grid) } else { (0.0, 0) }
}

#[cfg(test)]
mod tests {
    use rand_distr::{Distribution, Normal};
    use rand_pcg::Pcg64;
    use whorl_recording::Series;

    use super::*;

    /// Readings on a grid of their own are no chance, and each says so as much as it is unlikely; of others nothing is said.
    #[test]
    fn steps_of_a_gyro_are_as_sure_as_readings_are_many() {
        let model = PlatformModel::whorl_1_reference();
        let mut random = Pcg64::new(3, 5);
        let normal = Normal::new(0.0, 1e-3).unwrap();
        let values: Vec<Vector3<f64>> =
            (0..500).map(|_| Vector3::from_fn(|_, _| normal.sample(&mut random))).collect();
        let digits = |value: Vec<Vector3<f64>>| {
            let time_s = (0..value.len()).map(|i| i as f64 * 0.01).collect();
            let recording = Recording { gyro_b_rad_s: Series { time_s, value }, ..Recording::default() };
            digits_of_gyro(&recording, &model)
        };
        let free = digits(values.clone());
        assert!(free.clips_at_rad_s.is_none() && free.step_nats == 0.0, "{free:?}");
        let step = 1e-3;
        let coarse = digits(values.iter().map(|v| v.map(|x| (x / step).round() * step)).collect());
        assert!((coarse.step_rad_s - step).abs() < 1e-9, "{coarse:?}");
        assert!((coarse.step_nats - 500.0 * 25f64.ln()).abs() < 1e-6, "{coarse:?}");
        let limit = 1.2e-3;
        let clipped = digits(values.iter().map(|v| v.map(|x| x.clamp(-limit, limit))).collect());
        assert_eq!(clipped.clips_at_rad_s, Some(limit));
        assert!(clipped.clips_nats > 100.0, "{clipped:?}");
    }
}
