//! Noise from the Allan deviation, with its uncertainty.

use whorl_math::{AllanPoint, NoiseDensities, allan_deviation, noise_densities};

/// Points of the curve in a decade of averaging times.
const PER_DECADE: usize = 8;
/// Neighbouring points share most of their samples, and a walk's averages hang together: standard deviations of a fit that takes
/// points for independent grow by these, of the white noise and of the walk (scatter of 60 simulated records each, of 100 to
/// 700 s, over what the fit stated: 1.6 to 1.8 and 1.6 to 2.9) \[1\].
const SHARED: [f64; 2] = [1.8, 3.0];
/// The weights follow from the fit, and the fit from the weights.
const ROUNDS: usize = 10;
/// Points with a larger relative error, of fewer than nine averages, may be low by chance \[1\].
const UNKNOWN: f64 = 0.25;

/// Noise of one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseFit {
    /// The densities.
    pub densities: NoiseDensities,
    /// Standard deviation of `densities.white`.
    pub white_stddev: f64,
    /// Of `densities.walk`, where that was seen; else infinite.
    pub walk_stddev: f64,
    /// Bias instability: the lowest Allan deviation among those that enough averages support.
    pub floor: f64,
    /// Its standard deviation.
    pub floor_stddev: f64,
    /// Whether averaging longer does not help any more: the curve's lowest point is not its last. The floor is only then that of the
    /// sensor.
    pub floor_seen: bool,
}

/// Noise of evenly spaced samples: of one sample with its standard deviation, and the densities where the record is long enough.
pub(super) fn fit(samples: &[f64], sample_time_s: f64) -> ([f64; 2], Option<NoiseFit>) {
    let curve = allan_deviation(samples, sample_time_s, PER_DECADE);
    // From neighbours, so that a drifting bias does not count as noise.
    let sample = curve.first().map_or([0.0; 2], |p| [p.deviation, p.deviation * p.relative_error]);
    (sample, noise_densities(&curve).map(|densities| uncertain(&curve, densities)))
}

/// sigma^2(tau) = N^2 / tau + K^2 tau / 3 by least squares. The weights are those of the fitted curve: measured points that are low by
/// chance would count for more than those that are high.
fn uncertain(curve: &[AllanPoint], mut densities: NoiseDensities) -> NoiseFit {
    let mut squares = [densities.white.powi(2), densities.walk.powi(2)];
    let mut stddevs = [f64::INFINITY; 2];
    for _ in 0..if densities.walk_seen { ROUNDS } else { 1 } {
        let (mut normal, mut right) = ([0.0; 3], [0.0; 2]);
        for p in curve.iter().filter(|p| p.deviation > 0.0) {
            let row = [1.0 / p.tau_s, p.tau_s / 3.0];
            let model = squares[0] * row[0] + squares[1] * row[1];
            let weight = (2.0 * p.relative_error * model).powi(-2);
            normal[0] += weight * row[0] * row[0];
            normal[1] += weight * row[0] * row[1];
            normal[2] += weight * row[1] * row[1];
            right[0] += weight * row[0] * p.deviation.powi(2);
            right[1] += weight * row[1] * p.deviation.powi(2);
        }
        let determinant = normal[0] * normal[2] - normal[1] * normal[1];
        let found = [
            (right[0] * normal[2] - right[1] * normal[1]) / determinant,
            (right[1] * normal[0] - right[0] * normal[1]) / determinant,
        ];
        stddevs = [normal[2], normal[0]].map(|other| (other / determinant).max(0.0).sqrt());
        if !densities.walk_seen || found.iter().any(|square| square.is_nan() || *square <= 0.0) {
            break;
        }
        squares = found;
    }
    if densities.walk_seen {
        (densities.white, densities.walk) = (squares[0].sqrt(), squares[1].sqrt());
    }
    let of = |which: usize, value: f64| {
        let stddev = SHARED[which] * stddevs[which] / (2.0 * value);
        if stddev.is_finite() { stddev } else { f64::INFINITY }
    };
    let known: Vec<&AllanPoint> = curve.iter().filter(|p| p.relative_error < UNKNOWN).collect();
    let lowest = known.iter().enumerate().min_by(|(_, a), (_, b)| a.deviation.total_cmp(&b.deviation));
    let last = known.len().saturating_sub(1);
    NoiseFit {
        white_stddev: of(0, densities.white),
        walk_stddev: if densities.walk_seen { of(1, densities.walk) } else { f64::INFINITY },
        floor: lowest.map_or(0.0, |(_, p)| p.deviation),
        floor_stddev: lowest.map_or(f64::INFINITY, |(_, p)| p.deviation * p.relative_error),
        floor_seen: lowest.is_some_and(|(index, _)| index < last),
        densities,
    }
}

#[cfg(test)]
mod tests {
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    use super::*;

    /// White noise and a walk of known size, many records: the stated deviations are those of the results, within a factor.
    #[test]
    fn stated_deviations_are_those_of_many_records() {
        let (dt, white, walk) = (0.05_f64, 0.001, 2e-4);
        let (mut squares, mut beyond, mut floors, count) = ([0.0; 2], 0, 0, 60);
        for seed in 0..count {
            let mut rng = Pcg64::new(seed, 3);
            let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
            let mut bias = 0.0;
            let samples: Vec<f64> = (0..14_000)
                .map(|_| {
                    bias += walk * dt.sqrt() * normal();
                    bias + white * normal()
                })
                .collect();
            let ([sample, sample_stddev], found) = fit(&samples, dt);
            let found = found.unwrap();
            assert!((sample - white).abs() < 5.0 * sample_stddev + 0.01 * white, "{sample}");
            let off = [
                (found.densities.white - white * dt.sqrt()) / found.white_stddev,
                (found.densities.walk - walk) / found.walk_stddev,
            ];
            for (sum, off) in squares.iter_mut().zip(off) {
                *sum += off * off / f64::from(count as u32);
                beyond += usize::from(off.abs() > 3.0);
            }
            // The lowest point of N^2 / tau + K^2 tau / 3.
            let lowest = (2.0 * white * dt.sqrt() * walk / 3_f64.sqrt()).sqrt();
            floors += usize::from(found.floor_seen && (found.floor / lowest - 1.0).abs() < 0.25);
        }
        assert!(squares.iter().all(|mean| (0.2..2.5).contains(mean)), "{squares:?}");
        assert!(floors >= 55, "{floors} of {count}");
        assert!(beyond <= 4, "{beyond} of 120 beyond three deviations");
    }
}
