//! Order statistics and the distributions that tests refer to, each defined once.
//!
//! Distributions are those of [`statrs`]. A quantile of a sample has nine common definitions (R. J. Hyndman and
//! Y. Fan, Sample quantiles in statistical packages, The American Statistician 50, 1996); here it is their seventh,
//! the default of NumPy, R and Julia, which agrees with the ordinary median.

use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};

/// The value that a share `share` (0..1) of the values does not exceed, linear between the two nearest of them
/// (Hyndman and Fan's definition 7). NaN does not count; NaN without any other.
#[must_use]
pub fn quantile(values: impl IntoIterator<Item = f64>, share: f64) -> f64 {
    let mut values: Vec<f64> = values.into_iter().filter(|x| !x.is_nan()).collect();
    let Some(last) = values.len().checked_sub(1) else { return f64::NAN };
    let place = share.clamp(0.0, 1.0) * last as f64;
    let below = (place.floor() as usize).min(last);
    let (_, low, above) = values.select_nth_unstable_by(below, f64::total_cmp);
    let low = *low;
    let high = above.iter().copied().min_by(f64::total_cmp).unwrap_or(low);
    let part = place - below as f64;
    if part > 0.0 { low + (high - low) * part } else { low }
}

/// The middle value; of an even number the mean of the two in the middle. NaN does not count; NaN without any
/// other.
#[must_use]
pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    quantile(values, 0.5)
}

/// The value that a chi-squared variable of `dof` degrees of freedom stays below with `probability`.
///
/// NaN for a probability outside `[0, 1]` or no degree of freedom; 0 and infinity at the ends.
#[must_use]
pub fn chi_squared_quantile(probability: f64, dof: u32) -> f64 {
    if !(0.0..=1.0).contains(&probability) {
        return f64::NAN;
    }
    ChiSquared::new(f64::from(dof)).map_or(f64::NAN, |law| law.inverse_cdf(probability))
}

/// The probability that a chi-squared variable of `dof` degrees of freedom stays below `value`; NaN for no degree of
/// freedom.
#[must_use]
pub fn chi_squared_probability(value: f64, dof: u32) -> f64 {
    ChiSquared::new(f64::from(dof)).map_or(f64::NAN, |law| law.cdf(value))
}

/// The probability that a standard normal variable stays below `z`.
#[must_use]
pub fn normal_probability(z: f64) -> f64 {
    Normal::standard().cdf(z)
}

/// The value that a standard normal variable stays below with `probability`; NaN outside `[0, 1]`.
#[must_use]
pub fn normal_quantile(probability: f64) -> f64 {
    if (0.0..=1.0).contains(&probability) { Normal::standard().inverse_cdf(probability) } else { f64::NAN }
}

/// Autocorrelations about the mean at lags 0, 1 and so on; `None` for values that do not vary.
#[must_use]
pub fn autocorrelations(values: &[f64]) -> Option<impl Iterator<Item = f64>> {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    let centred: Vec<f64> = values.iter().map(|x| x - mean).collect();
    let power: f64 = centred.iter().map(|x| x * x).sum();
    let at = move |k: usize| centred.iter().zip(&centred[k..]).map(|(a, b)| a * b).sum::<f64>() / power;
    (power > 0.0 && power.is_finite()).then(|| (0..values.len()).map(at))
}

/// Whether the first autocorrelations of values are zero: Q = n (n + 2) sum r_k^2 / (n - k), chi-squared with as many degrees of freedom as
/// lags if they are white, and the probability of a Q this large if so (G. Ljung and G. Box, On a measure of lack of fit in time series
/// models, Biometrika 65 (1978) 297). `None` for fewer than twice as many values as lags, or values that do not vary.
#[must_use]
pub fn ljung_box(values: &[f64], lags: u32) -> Option<(f64, f64)> {
    let n = values.len() as f64;
    if lags == 0 || values.len() < 2 * lags as usize {
        return None;
    }
    let r = autocorrelations(values)?.take(lags as usize + 1).enumerate().skip(1);
    let statistic = n * (n + 2.0) * r.map(|(k, r)| r * r / (n - k as f64)).sum::<f64>();
    Some((statistic, (1.0 - chi_squared_probability(statistic, lags)).clamp(0.0, 1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `numpy.quantile` and `numpy.median` of the same numbers.
    #[test]
    fn order_statistics_are_those_of_numpy() {
        let values = [7.0, 1.0, f64::NAN, 3.0, 10.0];
        assert_eq!(median(values), 5.0);
        assert_eq!(median([3.0, 1.0, 2.0]), 2.0);
        assert_eq!(quantile(values, 0.0), 1.0);
        assert_eq!(quantile(values, 1.0), 10.0);
        assert!((quantile(values, 0.9) - 9.1).abs() < 1e-12);
        assert!((quantile((1..=100).map(f64::from), 0.99) - 99.01).abs() < 1e-12);
        assert_eq!(quantile([4.0], 0.3), 4.0);
        assert_eq!(median([1.0, 2.0, f64::INFINITY]), 2.0);
        assert!(median([]).is_nan());
    }

    #[test]
    fn quantiles_match_printed_tables() {
        // Abramowitz and Stegun, table 26.8 (upper tails), and NIST/SEMATECH 1.3.6.7.4.
        let table = [
            (0.95, 1, 3.841),
            (0.99, 1, 6.635),
            (0.999, 1, 10.828),
            (0.95, 2, 5.991),
            (0.95, 3, 7.815),
            (0.99, 3, 11.345),
            (0.95, 6, 12.592),
            (0.025, 6, 1.237),
            (0.975, 6, 14.449),
            (0.95, 10, 18.307),
            (0.05, 10, 3.940),
            (0.95, 30, 43.773),
            (0.025, 30, 16.791),
            (0.95, 100, 124.342),
            (0.05, 100, 77.929),
            (0.999, 100, 149.449),
        ];
        for (probability, dof, printed) in table {
            let value = chi_squared_quantile(probability, dof);
            assert!((value - printed).abs() < 6e-4, "{probability} {dof}: {value} {printed}");
        }
    }

    #[test]
    fn two_degrees_of_freedom_have_a_closed_form() {
        for probability in [1e-6, 0.01, 0.5, 0.99, 1.0 - 1e-6] {
            let value = chi_squared_quantile(probability, 2);
            let exact = -2.0 * f64::ln_1p(-probability);
            assert!((value - exact).abs() < 1e-8 * exact, "{probability}");
        }
    }

    /// Wilson and Hilferty (1931): (1 - 2/9n + z sqrt(2/9n))^3 per degree, good to 3e-6 here.
    #[test]
    fn as_many_degrees_of_freedom_as_a_recording_has_samples() {
        for (dof, z) in [(2_000, 2.575_829), (60_000, -2.575_829), (1_000_000, 2.575_829)] {
            let per_degree = chi_squared_quantile(normal_probability(z), dof) / f64::from(dof);
            let spread = 2.0 / (9.0 * f64::from(dof));
            let expected = (1.0 - spread + z * spread.sqrt()).powi(3);
            assert!((per_degree - expected).abs() < 5e-6, "{dof}: {per_degree} {expected}");
        }
    }

    #[test]
    fn probability_has_its_limits() {
        assert!(chi_squared_quantile(0.5, 0).is_nan());
        assert!(chi_squared_quantile(1.5, 3).is_nan());
        assert_eq!(chi_squared_quantile(0.0, 3), 0.0);
        assert_eq!(chi_squared_quantile(1.0, 3), f64::INFINITY);
        assert_eq!(chi_squared_probability(-1.0, 3), 0.0);
        assert!(normal_quantile(-0.1).is_nan());
    }

    /// The normal distribution is that of the tables.
    #[test]
    fn the_normal_law_is_that_of_the_tables() {
        for (z, below) in [(0.0, 0.5), (1.0, 0.841_344_746), (-1.959_963_985, 0.025), (3.0, 0.998_650_102)] {
            assert!((normal_probability(z) - below).abs() < 1e-9, "{z}");
            assert!((normal_quantile(below) - z).abs() < 1e-6, "{z}");
        }
        assert_eq!((normal_probability(f64::NEG_INFINITY), normal_probability(f64::INFINITY)), (0.0, 1.0));
    }
}
