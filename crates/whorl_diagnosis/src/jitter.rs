//! What stamps that jitter cost: a command that changes has an impulse that is uncertain by the jitter.

use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_math::statistics::median;
use whorl_recording::{OnInterval, Series};

use crate::bins::median_step_s;
use crate::run::Wheels;

/// Stamps that scatter by more than this share of their step are no even samples with jitter.
const MOST: f64 = 0.2;

/// Standard deviation of stamps about even steps \[s\], from their second differences (whose variance is six
/// times as large); the median, since samples are lost. 0 where samples do not come evenly.
pub(crate) fn stamp_jitter_s(time_s: &[f64]) -> f64 {
    let seconds: Vec<f64> = time_s
        .windows(3)
        .filter_map(|w| if let [a, b, c] = w { Some((c - 2.0 * b + a).abs()) } else { None })
        .collect();
    if seconds.len() < 10 {
        return 0.0;
    }
    let jitter_s = median(seconds) / 0.6745 / 6f64.sqrt();
    if jitter_s < MOST * median_step_s(time_s) { jitter_s } else { 0.0 }
}

/// Noise that the jitter of the stamps makes of a command that changes [N m sqrt(s)], for each wheel.
pub(crate) fn command_jitter(commands: &Series<Vec<f64>>, jitter_s: f64) -> Wheels {
    let mut squares = [0.0; MAX_WHEELS];
    for pair in commands.value.windows(2) {
        let [before, after] = pair else { continue };
        for ((slot, a), b) in squares.iter_mut().zip(before).zip(after) {
            *slot += (b - a).powi(2);
        }
    }
    let span_s = match (commands.time_s.first(), commands.time_s.last()) {
        (Some(first), Some(last)) => (last - first).max(1e-3),
        _ => return [0.0; MAX_WHEELS],
    };
    squares.map(|x| jitter_s * (x / span_s).sqrt())
}

/// Times of all edges of all pulses, in order, with the jet of each \[s\].
pub(crate) fn edges(pulses: &[Vec<OnInterval>]) -> Vec<(f64, usize)> {
    let mut edges: Vec<(f64, usize)> = pulses
        .iter()
        .enumerate()
        .flat_map(|(j, list)| list.iter().flat_map(move |p| [(p.on_s, j), (p.off_s, j)]))
        .collect();
    edges.sort_by(|a, b| a.0.total_cmp(&b.0));
    edges
}

#[cfg(test)]
mod tests {
    use whorl_recording::Series;

    use super::{command_jitter, stamp_jitter_s};

    /// A generator of known spread: uniform in +-sqrt(3) sigma would have other tails, so a sum of twelve.
    fn scattered(sigma: f64) -> Vec<f64> {
        let mut seed = 7u64;
        let mut uniform = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..20_000)
            .map(|i| 0.005 * f64::from(i) + sigma * ((0..12).map(|_| uniform()).sum::<f64>() - 6.0))
            .collect()
    }

    #[test]
    fn jitter_is_found_and_even_stamps_have_none() {
        let found = stamp_jitter_s(&scattered(3e-4));
        assert!((found / 3e-4 - 1.0).abs() < 0.05, "{found}");
        assert!(stamp_jitter_s(&scattered(0.0)) < 1e-12);
        // Samples that come whenever they like are not late.
        assert_eq!(stamp_jitter_s(&scattered(2e-3)), 0.0);
    }

    #[test]
    fn a_command_that_steps_each_sample_has_an_impulse_as_uncertain_as_its_stamps() {
        // Steps of 0.01 N m a hundred times a second, 1 ms of jitter: sqrt(100) * 0.01 * 1e-3.
        let value = (0..1001).map(|i| vec![if i % 2 == 0 { 0.0 } else { 0.01 }]).collect();
        let commands = Series { time_s: (0..1001).map(|i| 0.01 * f64::from(i)).collect(), value };
        assert!((command_jitter(&commands, 1e-3)[0] - 1e-4).abs() < 1e-9);
    }
}
