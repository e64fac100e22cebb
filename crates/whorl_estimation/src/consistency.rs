//! Is a filter as good as it says? NEES, NIS and their chi-squared bands.
//!
//! Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and
//! Navigation*, Wiley, 2001, section 5.4.

use nalgebra::{SMatrix, SVector};

/// Normalised estimation error squared `e^T P^-1 e`; `None` if `P` is not positive definite.
#[must_use]
pub fn nees<const N: usize>(error: &SVector<f64, N>, covariance: &SMatrix<f64, N, N>) -> Option<f64> {
    let factor = covariance.cholesky()?;
    Some(error.dot(&factor.solve(error)))
}

/// Two-sided band that the average of `runs` independent NEES (or NIS) values of `dof` degrees of
/// freedom keeps with the given probability.
#[must_use]
pub fn average_band(dof: u32, runs: u32, probability: f64) -> (f64, f64) {
    let total = dof.saturating_mul(runs);
    let tail = 0.5 * (1.0 - probability);
    let scale = f64::from(runs.max(1));
    (chi_squared_quantile(tail, total) / scale, chi_squared_quantile(1.0 - tail, total) / scale)
}

/// The value that a chi-squared variable of `dof` degrees of freedom stays below with `probability`.
///
/// NaN for a probability outside `[0, 1]` or no degree of freedom; 0 and infinity at the ends.
#[must_use]
pub fn chi_squared_quantile(probability: f64, dof: u32) -> f64 {
    if dof == 0 || !(0.0..=1.0).contains(&probability) {
        return f64::NAN;
    }
    if probability == 0.0 {
        return 0.0;
    }
    if probability == 1.0 {
        return f64::INFINITY;
    }
    // Bracket, then bisect in the logarithm: slow and certain.
    let dof_f = f64::from(dof);
    let (mut low, mut high) = (dof_f, dof_f);
    while chi_squared_probability(low, dof) > probability {
        low *= 0.5;
        if low < 1e-300 {
            return 0.0;
        }
    }
    while chi_squared_probability(high, dof) < probability && high < 1e12 {
        high *= 2.0;
    }
    for _ in 0..200 {
        let middle = (low * high).sqrt();
        if middle <= low || middle >= high {
            break;
        }
        if chi_squared_probability(middle, dof) < probability {
            low = middle;
        } else {
            high = middle;
        }
    }
    (low * high).sqrt()
}

/// The probability that a chi-squared variable of `dof` degrees of freedom stays below `value`.
#[must_use]
pub fn chi_squared_probability(value: f64, dof: u32) -> f64 {
    if value <= 0.0 {
        return 0.0;
    }
    regularised_gamma(0.5 * f64::from(dof), 0.5 * value)
}

/// Lower regularised incomplete gamma function P(a, x): series below a + 1, continued fraction
/// (modified Lentz) above. Abramowitz and Stegun 6.5.29 and 6.5.31.
fn regularised_gamma(a: f64, x: f64) -> f64 {
    const ITERATIONS: u32 = 10_000;
    let front = (a * x.ln() - x - ln_gamma(a)).exp();
    if x < a + 1.0 {
        let (mut term, mut sum) = (1.0 / a, 1.0 / a);
        for n in 1..ITERATIONS {
            term *= x / (a + f64::from(n));
            sum += term;
            if term < sum * 1e-17 {
                break;
            }
        }
        return (front * sum).min(1.0);
    }
    let tiny = 1e-300;
    let mut b = x + 1.0 - a;
    let mut c = 1.0 / tiny;
    let mut d = 1.0 / b;
    let mut fraction = d;
    for n in 1..ITERATIONS {
        let n = f64::from(n);
        let numerator = -n * (n - a);
        b += 2.0;
        d = numerator * d + b;
        d = 1.0 / if d.abs() < tiny { tiny } else { d };
        c = b + numerator / c;
        c = if c.abs() < tiny { tiny } else { c };
        fraction *= d * c;
        if (d * c - 1.0).abs() < 1e-16 {
            break;
        }
    }
    (1.0 - front * fraction).max(0.0)
}

/// Logarithm of the gamma function for positive arguments: Stirling's series after raising the
/// argument to at least 10 (Abramowitz and Stegun 6.1.41), good to rounding.
fn ln_gamma(x: f64) -> f64 {
    let mut shifted = x;
    let mut product = 1.0;
    while shifted < 10.0 {
        product *= shifted;
        shifted += 1.0;
    }
    let inverse = 1.0 / shifted;
    let square = inverse * inverse;
    let series = inverse
        * (1.0 / 12.0
            - square * (1.0 / 360.0 - square * (1.0 / 1260.0 - square * (1.0 / 1680.0 - square / 1188.0))));
    (shifted - 0.5) * shifted.ln() - shifted + 0.5 * std::f64::consts::TAU.ln() + series - f64::ln(product)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};

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

    #[test]
    fn bands_match_published_figures() {
        // 6 states: 100 runs [5.34, 6.70], 1000 runs [5.79, 6.22].
        for (runs, low, high) in [(100, 5.34, 6.70), (1000, 5.79, 6.22)] {
            let band = average_band(6, runs, 0.95);
            assert!((band.0 - low).abs() < 0.006 && (band.1 - high).abs() < 0.006, "{band:?}");
        }
    }

    #[test]
    fn probability_has_its_limits() {
        assert!(chi_squared_quantile(0.5, 0).is_nan());
        assert!(chi_squared_quantile(1.5, 3).is_nan());
        assert_eq!(chi_squared_quantile(0.0, 3), 0.0);
        assert_eq!(chi_squared_quantile(1.0, 3), f64::INFINITY);
        assert_eq!(chi_squared_probability(-1.0, 3), 0.0);
    }

    #[test]
    fn nees_of_a_known_case() {
        let covariance = Matrix2::new(4.0, 0.0, 0.0, 0.25);
        assert_eq!(nees(&Vector2::new(2.0, 1.0), &covariance), Some(5.0));
        assert_eq!(nees(&Vector2::new(2.0, 1.0), &-covariance), None);
    }
}
