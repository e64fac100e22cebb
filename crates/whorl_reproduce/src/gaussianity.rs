//! The dissertation's test of whether noise is normal (eqs. 4.41-4.43).

use whorl_math::statistics::{chi_squared_quantile, normal_probability};

/// Fewest expected counts in a bin.
const FEWEST: f64 = 5.0;
/// Width of a bin over the standard deviation (section 4.4).
const WIDTH: f64 = 0.4;

/// One class interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bin {
    /// From; minus infinity for the first.
    pub from: f64,
    /// To; infinity for the last.
    pub to: f64,
    /// Samples in it.
    pub observed: f64,
    /// Samples that a normal distribution would have there.
    pub expected: f64,
}

/// Result of the test.
#[derive(Debug, Clone, PartialEq)]
pub struct Gaussianity {
    /// Class intervals after merging.
    pub bins: Vec<Bin>,
    /// Test statistic (eq. 4.41).
    pub chi_squared: f64,
    /// Degrees of freedom: bins - 3.
    pub dof: u32,
    /// Upper limit of the statistic with probability 1 - alpha for normal data.
    pub limit: f64,
}

impl Gaussianity {
    /// Whether normal data would look like this.
    #[must_use]
    pub fn passes(&self) -> bool {
        self.chi_squared < self.limit
    }
}

/// The chi-squared test of goodness of fit with bins 0.4 standard deviations wide, the outer ones merged
/// until five samples are expected in each.
///
/// Eq. 4.42 is printed as the quantile but is the density of the chi-squared distribution; the limit here
/// is the quantile. Expected counts are differences of the distribution function, not the density at the
/// middle of a bin, and merging goes by expected counts, which do not depend on the data.
///
/// `None` for fewer than 50 samples, data without scatter, or digits coarser than a bin.
#[must_use]
pub fn chi_squared_test(samples: &[f64], alpha: f64) -> Option<Gaussianity> {
    let count = samples.len() as f64;
    let mean = samples.iter().sum::<f64>() / count;
    let stddev = (samples.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (count - 1.0)).sqrt();
    let is_scattered = stddev.is_finite() && stddev > 1e-12 * mean.abs().max(1e-12);
    if samples.len() < 50 || !is_scattered {
        return None;
    }
    // Edges from the middle outwards, as far as the tail beyond still expects five.
    let tail = |edge: f64| count * (1.0 - normal_probability(WIDTH * edge));
    let half = (0..100).find(|half| tail(f64::from(*half) + 1.5) < FEWEST).unwrap_or(100);
    let edges = (-half..=half + 1).map(|n| mean + stddev * WIDTH * (f64::from(n) - 0.5));
    let ends = std::iter::once(f64::NEG_INFINITY).chain(edges).chain([f64::INFINITY]);
    let below = |x: f64| normal_probability((x - mean) / stddev);
    let bin = |(from, to): (f64, f64)| {
        let observed = samples.iter().filter(|x| (from..to).contains(x)).count() as f64;
        Bin { from, to, observed, expected: count * (below(to) - below(from)) }
    };
    let bins: Vec<Bin> = ends.clone().zip(ends.skip(1)).map(bin).collect();
    let chi_squared = bins.iter().map(|b| (b.observed - b.expected).powi(2) / b.expected).sum();
    let dof = u32::try_from(bins.len().checked_sub(3)?).ok().filter(|d| *d > 0)?;
    Some(Gaussianity { chi_squared, dof, limit: chi_squared_quantile(1.0 - alpha, dof), bins })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, StandardNormal, Uniform};
    use rand_pcg::Pcg64;

    #[test]
    fn the_limit_is_the_printed_one() {
        // Section 4.4: chi^2_{0.01, 16} = 32.0; its own eq. 4.42 at x = 32 gives 0.0030 instead.
        assert!((chi_squared_quantile(0.99, 16) - 32.0).abs() < 0.01);
    }

    #[test]
    fn normal_noise_passes_and_uniform_noise_does_not() {
        let mut rng = Pcg64::new(1, 2);
        let mut failed = 0;
        for _ in 0..200 {
            let x: Vec<f64> = (0..2000)
                .map(|_| {
                    3.0 + 0.1 * {
                        let n: f64 = StandardNormal.sample(&mut rng);
                        n
                    }
                })
                .collect();
            failed += usize::from(!chi_squared_test(&x, 0.05).unwrap().passes());
        }
        // 5 % of 200 is 10; 99.9 % of binomials stay within 1 and 21.
        assert!((1..=21).contains(&failed), "{failed}");
        let uniform = Uniform::new(0.0, 1.0).unwrap();
        let x: Vec<f64> = (0..2000).map(|_| uniform.sample(&mut rng)).collect();
        assert!(!chi_squared_test(&x, 0.01).unwrap().passes());
        assert_eq!(chi_squared_test(&[1.0; 100], 0.01), None);
    }

    #[test]
    fn counts_add_up_and_no_bin_expects_less_than_five() {
        let mut rng = Pcg64::new(5, 2);
        let x: Vec<f64> = (0..500).map(|_| StandardNormal.sample(&mut rng)).collect();
        let test = chi_squared_test(&x, 0.01).unwrap();
        assert_eq!(test.bins.iter().map(|b| b.observed).sum::<f64>(), 500.0);
        assert!((test.bins.iter().map(|b| b.expected).sum::<f64>() - 500.0).abs() < 1e-9);
        assert!(test.bins.iter().all(|b| b.expected >= 5.0), "{:?}", test.bins);
    }
}
