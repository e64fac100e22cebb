//! Unbalanced wheels: what turns with a wheel and shakes the gyro.

use nalgebra::{Matrix2, Vector2, Vector3};
use whorl_dynamics::effects::Part;
use whorl_dynamics::{Effect, PlatformModel};
use whorl_math::unit_or;

use super::fast::{Fast, inverse_inertia, parameter, row};
use crate::verdict::diagnosis::Candidate;

/// Cycles a turn at which no imbalance is: what is there is noise.
const BESIDE: [f64; 4] = [0.79, 0.9, 1.11, 1.23];

/// An imbalance may be anything within this factor: from a balanced flywheel to a bent one.
const SIZES_OF_IMBALANCE: f64 = 1e4;

/// The wheel whose turning shows in the gyro, and the row that says so; what it explains is taken off the samples.
pub(super) fn imbalance(
    runs: &mut [Fast<'_>],
    model: &PlatformModel,
    effect: &dyn Effect,
) -> Option<(usize, Candidate)> {
    let settings = runs.first()?.settings;
    let wheels = model.wheels().len();
    let all_fits = |wheel: usize, order: f64| -> Vec<Fit> {
        runs.iter().flat_map(|fast| wheel_fits(fast, model, wheel, order)).collect()
    };
    let found = (0..wheels).filter_map(|wheel| {
        let mut fits = all_fits(wheel, 1.0);
        if one_size(&fits)?.0 > settings.window_nats {
            // The same test at an order that no imbalance has measures how much louder the noise is here than at high frequencies.
            let beside: Vec<f64> =
                BESIDE.iter().flat_map(|order| all_fits(wheel, *order)).map(|f| f.drop).collect();
            let level = (0.5 * beside.iter().sum::<f64>() / beside.len().max(1) as f64).max(1.0);
            for fit in &mut fits {
                fit.drop /= level;
                fit.information /= level;
            }
        }
        let (evidence, size) = one_size(&fits)?;
        Some((evidence - (wheels as f64).ln(), size, wheel, fits))
    });
    let (evidence, size, wheel, fits) = found.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let drop = fits.iter().map(|f| f.drop).sum::<f64>() - 2.0 * fits.len() as f64;
    if evidence < settings.window_nats || drop < settings.clear_misfit {
        return None;
    }
    let mut next = fits.iter();
    for fast in runs.iter_mut() {
        for stretch in stretches(fast) {
            let (Some(fit), signals) = (next.next(), wheel_signals(fast, model, wheel, 1.0, stretch)) else {
                break;
            };
            for (i, [a, b]) in signals.iter().enumerate() {
                for (at, (x, y)) in a.iter().zip(b).enumerate() {
                    if let Some(slot) = fast.channel[i].get_mut(stretch.0 + at) {
                        *slot -= fit.amplitude.x * x + fit.amplitude.y * y;
                    }
                }
            }
        }
    }
    let information: f64 = fits.iter().map(|f| f.information).sum();
    let spec = effect.parameters(model).into_iter().find(|s| s.part == Part::Wheel(wheel))?;
    let estimate = parameter(spec.name, spec.unit, size, (1.0 / information).sqrt());
    Some((wheel, row(effect, drop, evidence, vec![estimate])))
}

/// Log evidence and likeliest size of an imbalance that is the same in all stretches, its phase in each unknown: the
/// likelihood of a sine of known size and unknown phase in noise (Rice 1944), over sizes alike in their logarithm.
fn one_size(fits: &[Fit]) -> Option<(f64, f64)> {
    let information: f64 = fits.iter().map(|f| f.information).sum();
    let power: f64 = fits.iter().map(|f| f.drop).sum();
    if information <= 0.0 {
        return None;
    }
    let gain = |size: f64| -> f64 {
        fits.iter()
            .map(|f| {
                let expected = size * f.information.sqrt();
                log_bessel_0(expected * f.drop.max(0.0).sqrt()) - 0.5 * expected * expected
            })
            .sum()
    };
    // From what no data show to twice what would be all of the power; steps small against the likelihood's width.
    let largest = 2.0 * (power / information).sqrt().max(1.0 / information.sqrt());
    let smallest = 0.1 / information.sqrt();
    let steps = 400;
    let ratio = (largest / smallest).powf(1.0 / f64::from(steps));
    let gains: Vec<(f64, f64)> =
        (0..=steps).map(|i| smallest * ratio.powi(i)).map(|size| (gain(size), size)).collect();
    let best = gains.iter().copied().max_by(|a, b| a.0.total_cmp(&b.0))?;
    let sum: f64 = gains.iter().map(|g| (g.0 - best.0).exp()).sum();
    let density = ratio.ln() / SIZES_OF_IMBALANCE.ln();
    Some((best.0 + (sum * density).ln(), best.1))
}

/// Logarithm of the modified Bessel function of order 0 (Abramowitz and Stegun 1964, 9.8.1 and 9.8.2).
fn log_bessel_0(x: f64) -> f64 {
    if x < 3.75 {
        let t = (x / 3.75).powi(2);
        let series = [0.004_581_3, 0.036_076_8, 0.265_973_2, 1.206_749_2, 3.089_942_4, 3.515_622_9, 1.0];
        return series.iter().fold(0.0, |sum, c| sum * t + c).ln();
    }
    let t = 3.75 / x;
    let series = [
        0.003_923_77,
        -0.016_476_33,
        0.026_355_37,
        -0.020_577_06,
        0.009_162_81,
        -0.001_575_65,
        0.002_253_19,
        0.013_285_92,
        0.398_942_28,
    ];
    x - 0.5 * x.ln() + series.iter().fold(0.0, |sum, c| sum * t + c).ln()
}

/// Both phases of a wheel's imbalance over one stretch.
struct Fit {
    drop: f64,
    amplitude: Vector2<f64>,
    /// Inverse variance of one amplitude.
    information: f64,
}

fn stretches(fast: &Fast<'_>) -> Vec<(usize, usize)> {
    let length = (fast.settings.wheel_angle_s / fast.step_s) as usize;
    let count = (fast.len() as f64 / length.max(1) as f64).round().max(1.0) as usize;
    (0..count).map(|i| (i * fast.len() / count, (i + 1) * fast.len() / count)).collect()
}

/// What an imbalance of 1 kg m^2 adds to each gyro axis, at two phases a quarter turn apart; felt `order` times a turn.
fn wheel_signals(
    fast: &Fast<'_>,
    model: &PlatformModel,
    wheel: usize,
    order: f64,
    (from, to): (usize, usize),
) -> [[Vec<f64>; 2]; 3] {
    let mut signals: [[Vec<f64>; 2]; 3] =
        std::array::from_fn(|_| [vec![0.0; to - from], vec![0.0; to - from]]);
    let Some(w) = model.wheels().get(wheel) else { return signals };
    let axis = w.spin_axis_b.into_inner();
    let helper = if axis.z.abs() > 0.7 { Vector3::x() } else { Vector3::z() };
    let e1 = unit_or(axis.cross(&helper), Vector3::x_axis()).into_inner();
    let e2 = axis.cross(&e1);
    // The rate is the torque's integral over a turn: Om^2 becomes Om, a quarter turn later.
    let inverse = inverse_inertia(model);
    let (u1, u2) = (inverse * e1, inverse * e2);
    for index in from..to {
        let (speed, angle) = fast.run.motion.wheel_at(wheel, fast.time(index));
        let (s, c) = (order * angle).sin_cos();
        let first = (u1 * s - u2 * c) * speed;
        let second = (u1 * c + u2 * s) * speed;
        for i in 0..3 {
            signals[i][0][index - from] = first[i];
            signals[i][1][index - from] = second[i];
        }
    }
    for (i, pair) in signals.iter_mut().enumerate() {
        for signal in pair {
            fast.fast_part(signal, 0, from);
            signal.iter_mut().for_each(|x| *x /= fast.stddev[i]);
        }
    }
    signals
}

fn wheel_fits(fast: &Fast<'_>, model: &PlatformModel, wheel: usize, order: f64) -> Vec<Fit> {
    stretches(fast)
        .into_iter()
        .map(|(from, to)| {
            let signals = wheel_signals(fast, model, wheel, order, (from, to));
            let (mut matrix, mut vector) = (Matrix2::zeros(), Vector2::zeros());
            for (i, [a, b]) in signals.iter().enumerate() {
                for ((x, y), z) in a.iter().zip(b).zip(&fast.channel[i][from..to]) {
                    let g = Vector2::new(*x, *y);
                    matrix += g * g.transpose();
                    vector += g * *z;
                }
            }
            let amplitude = matrix.try_inverse().map_or_else(Vector2::zeros, |m| m * vector);
            Fit { drop: amplitude.dot(&vector), amplitude, information: 0.5 * matrix.trace() }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    use super::*;

    #[test]
    fn the_bessel_function_has_its_tabulated_values() {
        // Abramowitz and Stegun 1964, tables 9.8 and 9.11: I0(1), I0(5), e^-20 I0(20).
        for (x, expected) in [
            (1.0, 1.266_065_877_8_f64.ln()),
            (5.0, 27.239_871_823_6_f64.ln()),
            (20.0, 20.0 + 0.089_780_3_f64.ln()),
        ] {
            assert!((log_bessel_0(x) - expected).abs() < 1e-5, "{x}");
        }
    }

    /// Fits to noise and a sine of this size, in units of the noise of one phase.
    fn fits(size: f64, noise: &mut dyn FnMut() -> f64) -> Vec<Fit> {
        [1.0, 3.0, 0.3, 2.0, 5.0, 0.1]
            .into_iter()
            .map(|information: f64| {
                let turn = 3.0 * noise();
                let signal = size * information.sqrt();
                let (a, b) = (signal * turn.cos() + noise(), signal * turn.sin() + noise());
                let amplitude = Vector2::new(a, b) / information.sqrt();
                Fit { drop: a * a + b * b, amplitude, information }
            })
            .collect()
    }

    /// What noise makes of a Bayes factor on average is how often the effect makes such data (Turing): with sizes
    /// drawn from the prior, of data too weak to decide. (Over all data the mean is 1, but rests on the rarest.)
    #[test]
    fn evidence_of_an_imbalance_is_not_made_by_noise() {
        let mut random = Pcg64::new(9, 1);
        let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
        let count = 8000;
        let power = |fits: &[Fit]| fits.iter().map(|f| f.drop).sum::<f64>();
        let weak = |fits: &[Fit]| power(fits) < 20.0;
        let information: f64 = fits(0.0, &mut noise).iter().map(|f| f.information).sum();
        let by_noise = (0..count)
            .map(|_| fits(0.0, &mut noise))
            .filter(|f| weak(f))
            .map(|f| one_size(&f).unwrap().0.exp())
            .sum::<f64>()
            / f64::from(count);
        // From where the sizes begin that are considered, to where no data are weak.
        let (smallest, largest) = (0.1 / information.sqrt(), 12.0 / information.sqrt());
        let by_effect = (0..count)
            .filter(|i| {
                let size = smallest * f64::powf(largest / smallest, (f64::from(*i) + 0.5) / f64::from(count));
                let fits = fits(size, &mut noise);
                let considered = 2.0 * (power(&fits).sqrt().max(1.0) / information.sqrt());
                weak(&fits) && size < considered
            })
            .count() as f64
            / f64::from(count)
            * ((largest / smallest).ln() / SIZES_OF_IMBALANCE.ln());
        assert!((by_noise / by_effect - 1.0).abs() < 0.05, "{by_noise} {by_effect}");
        // An imbalance ten standard deviations large is found at its size.
        let strong: Vec<(f64, f64)> = (0..200).map(|_| one_size(&fits(3.0, &mut noise)).unwrap()).collect();
        let mean_size = strong.iter().map(|(_, size)| size).sum::<f64>() / 200.0;
        let plain = strong.iter().filter(|(evidence, _)| *evidence > 20.0).count();
        assert!((mean_size - 3.0).abs() < 0.1 && plain > 190, "{mean_size} {plain}");
    }
}
