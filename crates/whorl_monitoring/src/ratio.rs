//! How much speaks for one suspect: its likelihood ratio, as far as a rig can be like that.

use nalgebra::{Cholesky, Const, SMatrix, SVector};
use whorl_math::statistics::normal_probability;

use crate::directions::MOST_DIRECTIONS;
use crate::sums::Marginal;

/// One suspect: its columns among those that are followed.
#[derive(Debug, Clone)]
pub(crate) struct Suspect {
    pub effect: &'static str,
    pub columns: Vec<usize>,
    /// Places of the products of its columns among those that are summed: (0, 0), (0, 1), (1, 1), (0, 2) and so on.
    pub products: Vec<usize>,
    /// Prior standard deviation of each column.
    pub stddev: Vec<f64>,
    /// What a rig can have of each column.
    pub range: Vec<(f64, f64)>,
    pub sizes: &'static [f64],
    pub ln_prior: f64,
}

/// A ratio below this is nothing beside a limit [nats]: whether a rig can be like that does not matter.
const NO_EVIDENCE: f64 = 1.0;
/// Of a size with less information than this over its prior nothing is known: the ratio is one.
const NO_INFORMATION: f64 = 1e-3;

type Matrix = SMatrix<f64, MOST_DIRECTIONS, MOST_DIRECTIONS>;
type Vector = SVector<f64, MOST_DIRECTIONS>;

/// The factor of I + V^1/2 G V^1/2, and V^1/2 g; columns that a suspect has not are those of the identity. `None` where numbers are not
/// finite.
fn scaled(
    suspect: &Suspect,
    sums: &Marginal,
    size: f64,
) -> Option<(Cholesky<f64, Const<MOST_DIRECTIONS>>, Vector)> {
    let (mut information, mut score) = (Matrix::identity(), Vector::zeros());
    let mut products = suspect.products.iter();
    for (i, column) in suspect.columns.iter().enumerate().take(MOST_DIRECTIONS) {
        let s_i = suspect.stddev[i] * size;
        score[i] = s_i * sums.slope[*column];
        for (j, place) in products.by_ref().take(i + 1).enumerate() {
            // Of a symmetric matrix the lower triangle is read.
            information[(i, j)] += s_i * sums.pairs[*place] * suspect.stddev[j] * size;
        }
    }
    Some((information.cholesky()?, score))
}

/// ln of a suspect's likelihood ratio if its effect has this size, while readings that are off by so many standard deviations
/// always are no news.
pub(crate) fn ln_ratio(suspect: &Suspect, sums: &Marginal, size: f64, systematic_sigma: f64) -> f64 {
    ln_ratio_from(NO_EVIDENCE, suspect, sums, size, systematic_sigma)
}

/// The same, with what a rig can have regarded from a ratio on.
fn ln_ratio_from(least: f64, suspect: &Suspect, sums: &Marginal, size: f64, systematic_sigma: f64) -> f64 {
    let known = |(column, stddev): (&usize, &f64)| sums.information[*column] * (stddev * size).powi(2);
    if suspect.columns.iter().zip(&suspect.stddev).map(known).sum::<f64>() < NO_INFORMATION {
        return 0.0;
    }
    // Numbers that are not finite speak for nothing.
    let Some((factor, score)) = scaled(suspect, sums, size) else { return f64::NEG_INFINITY };
    let lower = factor.l_dirty();
    let Some(half) = lower.solve_lower_triangular(&score) else { return f64::NEG_INFINITY };
    let left = (half.norm() - systematic_sigma * spread(suspect, sums).sqrt()).max(0.0);
    let ln = 0.5 * left * left - lower.diagonal().product().ln();
    if !ln.is_finite() {
        return f64::NEG_INFINITY;
    }
    if ln < least { ln } else { ln + ln_possible(suspect, &factor, &score, size) }
}

/// ln of the chance that what was found is what a rig can have, of the parameter with the smallest. With one parameter over the
/// chance that it had before: the ratio of a prior that ends there. With several the ratio is a little smaller than that.
fn ln_possible(
    suspect: &Suspect,
    factor: &Cholesky<f64, Const<MOST_DIRECTIONS>>,
    score: &Vector,
    size: f64,
) -> f64 {
    let (mean, covariance) = (factor.solve(score), factor.inverse());
    let within = |(low, high): (f64, f64), mean: f64, stddev: f64| {
        // From the nearer end: a difference of two chances near one has no digits.
        let (below, above) =
            (normal_probability((low - mean) / stddev), normal_probability((mean - high) / stddev));
        let (inside_low, inside_high) =
            (normal_probability((mean - low) / stddev), normal_probability((high - mean) / stddev));
        let inside = if below > 0.5 { inside_low - above } else { inside_high - below };
        inside.max(f64::MIN_POSITIVE)
    };
    let count = suspect.columns.len().min(MOST_DIRECTIONS);
    let mut ln = 0.0;
    for (i, range) in suspect.range.iter().enumerate().take(count) {
        let unit = suspect.stddev[i] * size;
        let range = (range.0 / unit, range.1 / unit);
        let now = within(range, mean[i], covariance[(i, i)].sqrt());
        if count == 1 {
            return (now / within(range, 0.0, 1.0)).ln();
        }
        ln = f64::min(ln, now.ln());
    }
    ln
}

/// Over how many readings that column of a suspect is spread that is spread most.
fn spread(suspect: &Suspect, sums: &Marginal) -> f64 {
    suspect.columns.iter().map(|column| sums.spread[*column]).fold(0.0, f64::max)
}

/// Deviations beyond an end of a range that are no chance: a jet that is dead is at its end, and an estimate scatters about it.
const BEYOND_STDDEVS: f64 = 3.0;

/// Estimates of a suspect's columns and their standard deviations, and whether data put one of them further beyond what a rig can
/// have than chance does.
pub(crate) fn estimate(suspect: &Suspect, sums: &Marginal) -> Option<(Vec<(f64, f64)>, bool)> {
    let ratio = |size: f64| ln_ratio(suspect, sums, size, 0.0);
    let best = suspect.sizes.iter().copied().max_by(|a, b| ratio(*a).total_cmp(&ratio(*b)))?;
    let (factor, score) = scaled(suspect, sums, best)?;
    let (mean, covariance) = (factor.solve(&score), factor.inverse());
    let mut is_beyond = false;
    let of = suspect.stddev.iter().zip(&suspect.range).enumerate().take(MOST_DIRECTIONS);
    let numbers = of.map(|(i, (stddev, (low, high)))| {
        let (value, stddev) = (mean[i] * stddev * best, covariance[(i, i)].sqrt() * stddev * best);
        is_beyond |= (low - value).max(value - high) > BEYOND_STDDEVS * stddev;
        (value.max(*low).min(*high), stddev)
    });
    Some((numbers.collect(), is_beyond))
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;

    const ANY: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);

    fn suspect(count: usize, stddev: f64) -> Suspect {
        let columns: Vec<usize> = (0..count).collect();
        let products = (0..count * (count + 1) / 2).collect();
        Suspect {
            effect: "drag",
            columns,
            products,
            stddev: vec![stddev; count],
            range: vec![ANY; count],
            sizes: &[1.0],
            ln_prior: 0.0,
        }
    }

    fn sums(slope: &[f64], pairs: &[f64]) -> Marginal {
        Marginal {
            slope: slope.to_vec(),
            pairs: pairs.to_vec(),
            spread: vec![0.0; slope.len()],
            information: vec![1.0; slope.len()],
        }
    }

    /// One column: the integral of the likelihood over the prior, by the trapezoidal rule.
    #[test]
    fn the_ratio_is_the_likelihood_integrated_over_the_prior() {
        let suspect = suspect(1, 0.7);
        let (x, y) = ([0.3, -1.0, 2.0, 0.4], [0.5, -0.2, 1.7, 0.1]);
        let information: f64 = x.iter().map(|x| x * x).sum();
        let score: f64 = x.iter().zip(y).map(|(x, y)| x * y).sum();
        let sums = sums(&[score], &[information]);
        let sigma = 0.7 * 3.0;
        let density = |phi: f64| {
            let misfit: f64 = x.iter().zip(y).map(|(x, y)| (y - x * phi).powi(2) - y * y).sum();
            (-0.5 * misfit - 0.5 * (phi / sigma).powi(2)).exp() / (sigma * std::f64::consts::TAU.sqrt())
        };
        let step = 1e-3;
        let integral: f64 = (-20_000..20_000).map(|k| density(f64::from(k) * step) * step).sum();
        assert!((ln_ratio(&suspect, &sums, 3.0, 0.0) - integral.ln()).abs() < 1e-9);
    }

    /// Three columns, against the formula at the head of this file in matrices.
    #[test]
    fn the_ratio_of_several_columns_is_the_formula() {
        let suspect = suspect(3, 0.7);
        let x = DMatrix::from_fn(5, 3, |i, j| ((i * 3 + j) as f64).sin());
        let y = DVector::from_fn(5, |i, _| (i as f64).cos());
        let (a, z) = (x.transpose() * &x, x.transpose() * &y);
        let products = [a[(0, 0)], a[(0, 1)], a[(1, 1)], a[(0, 2)], a[(1, 2)], a[(2, 2)]];
        let sums = sums(z.as_slice(), &products);
        let s = 0.7 * 3.0;
        let inner = DMatrix::identity(3, 3) + &a * (s * s);
        let quadratic = (z.transpose() * inner.clone().try_inverse().unwrap() * &z)[0] * s * s;
        let expected = 0.5 * (quadratic - inner.determinant().ln());
        assert!((ln_ratio(&suspect, &sums, 3.0, 0.0) - expected).abs() < 1e-12);
    }

    /// What data put beyond a range is kept at its end, and told where that is no chance.
    #[test]
    fn an_estimate_beyond_its_range_is_told() {
        let sums = sums(&[100.0], &[50.0]);
        let of = |most: f64| {
            let (numbers, is_beyond) =
                estimate(&Suspect { range: vec![(-most, most)], ..suspect(1, 1.0) }, &sums).unwrap();
            (numbers[0].0, is_beyond)
        };
        // 100/(50 + 1) = 1.96 +- 0.14.
        let (free, close, kept) = (of(3.0), of(1.8), of(0.3));
        assert!(!free.1 && (free.0 - 100.0 / 51.0).abs() < 1e-12);
        assert!(close == (1.8, false));
        assert!(kept == (0.3, true));
    }

    /// One column with a range: the integral over the part of the prior that a rig can have.
    #[test]
    fn what_no_rig_can_have_is_not_integrated_over() {
        let (x, y) = ([0.3, -1.0, 2.0, 0.4], [0.5, -0.2, 1.7, 0.1]);
        let information: f64 = x.iter().map(|x| x * x).sum();
        let sigma = 0.7 * 3.0;
        for (score_sign, range) in
            [(1.0, (-0.2, 5.0)), (-1.0, (-0.2, 5.0)), (1.0, (-9.0, 0.1)), (1.0, (0.0, f64::INFINITY))]
        {
            let score: f64 = score_sign * x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
            let suspect = Suspect { range: vec![range], ..suspect(1, 0.7) };
            let sums = sums(&[score], &[information]);
            let (mut integral, mut mass) = (0.0, 0.0);
            for k in -200_000..200_000 {
                let phi = (f64::from(k) + 0.5) * 1e-4;
                if phi < range.0 || phi > range.1 {
                    continue;
                }
                let prior = (-0.5 * (phi / sigma).powi(2)).exp();
                mass += prior;
                integral += prior * (phi * score - 0.5 * phi * phi * information).exp();
            }
            let found = ln_ratio_from(f64::NEG_INFINITY, &suspect, &sums, 3.0, 0.0);
            let expected = (integral / mass).ln();
            assert!((found - expected).abs() < 1e-3, "{score_sign} {range:?}: {found}, not {expected}");
        }
    }

    /// Readings that are always off by less than what is allowed are no news, however many; a clear one is.
    #[test]
    fn a_small_error_that_lasts_is_no_evidence() {
        let suspect = suspect(1, 0.7);
        let ratio = |per_reading: f64, count: f64| {
            let sums = Marginal { spread: vec![count], ..sums(&[per_reading * count], &[count]) };
            (ln_ratio(&suspect, &sums, 1.0, 0.2), ln_ratio(&suspect, &sums, 1.0, 0.0))
        };
        for count in [1e2, 1e4, 1e6] {
            let (discounted, plain) = ratio(0.15, count);
            assert!(discounted < 0.0 && (count < 1e4 || plain > 50.0), "{discounted} {plain}");
            assert!(ratio(1.0, count).0 > 0.3 * count - 8.0);
        }
    }
}
