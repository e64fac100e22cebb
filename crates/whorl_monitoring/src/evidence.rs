//! The running evidence that the model has stopped being right, and which effect explains it best.
//!
//! While the model is right, innovations e over their deviations are independent with unit variance. If an effect with values phi ~ N(0, V)
//! has begun at a start, they have the mean -(de/dphi) phi. With G and g of the innovations since then ([`Since`]) the likelihood ratio is
//!
//! ```text
//! ln B = -1/2 ln |I + V^1/2 G V^1/2| + 1/2 q,    q = g^T V^1/2 (I + V^1/2 G V^1/2)^-1 V^1/2 g
//! ```
//!
//! exact for the linear filter, and with mean one while the model is right. So is any average of such ratios: over sizes V, over the ways in
//! which an effect enters, over effects. Their sum over starts is what is compared with the limit.
//!
//! No filter is tuned quite rightly: noise and background torque are stated as what they are at most, and where they are smaller
//! innovations follow a little from what was corrected before. Such a fault never grows, but its evidence does, with time
//! alone. So the model counts as right while every innovation is off by at most eps deviations, however
//! chosen ([`SYSTEMATIC`]). A likelihood ratio exp(phi^T g - phi^T G phi / 2) then grows by
//! exp(eps sum |d phi|) at most, and is divided by that: its mean is again at most one. For one column d that takes
//! eps sum |d| off |g|. For several the sum is taken as sqrt(n phi^T G phi), n = (sum |d_k|)^2 / G_kk being over how many readings the
//! column that is spread most is spread: what is left of q is (sqrt q - eps sqrt n)^2.
//!
//! What no rig can have (friction that drives, more than a tank holds) is no explanation: a ratio counts only where its estimate
//! is in the ranges of the catalogue's parameters, or no further beyond than chance.

use std::collections::BTreeMap;

use nalgebra::{SMatrix, SVector};
use whorl_prediction::Since;

use crate::directions::{Direction, Directions, MOST_DIRECTIONS};
use crate::fit::{Likeliest, Parameter};

/// Systematic error of a whitened reading, over its standard deviation: innovations of a filter whose background torque is there or not
/// correlate with what it corrected by as much (measured: 600 s of holding, wheels, no background torque at all). Twice that hides a jet
/// that was weak from the start.
const SYSTEMATIC: f64 = 0.11;
/// Prior sizes of an effect over the catalogue's, each as likely: those of the diagnosis that a run of minutes can tell.
const SIZES: [f64; 4] = [0.3, 1.0, 3.0, 10.0];
/// With less information than this over its prior nothing is known of a suspect: the ratio is one.
const NO_INFORMATION: f64 = 1e-5;
/// A ratio below this is nothing beside a limit [nats]: whether a rig can be like that does not matter.
const NO_EVIDENCE: f64 = 1.0;
/// Deviations beyond an end of a range that are no chance: a jet that is dead is at its end, and an estimate scatters about it.
const BEYOND_STDDEVS: f64 = 3.0;

type Matrix = SMatrix<f64, MOST_DIRECTIONS, MOST_DIRECTIONS>;
type Vector = SVector<f64, MOST_DIRECTIONS>;

/// One suspect: an effect in one of its ways.
#[derive(Debug, Clone)]
struct Suspect {
    effect: &'static str,
    /// Its parameters, each with its prior standard deviation and what a rig can have of it.
    columns: Vec<(usize, f64, (f64, f64))>,
    /// Where the products of its columns begin among the pairs: (0, 0), (0, 1), (1, 1), (0, 2) and so on.
    products: usize,
    ln_prior: f64,
}

/// All suspects: what makes evidence of sums since starts.
#[derive(Debug, Clone)]
pub(crate) struct Evidence(Vec<Suspect>);

impl Evidence {
    /// Of these directions, and the pairs of parameters of which a filter is to gather information.
    pub fn new(all: &Directions) -> (Self, Vec<(usize, usize)>) {
        // A torque that nothing explains is as likely as any effect, and each effect's ways are as likely.
        let mut effects: BTreeMap<&str, usize> = BTreeMap::new();
        all.ways.iter().for_each(|(effect, _)| *effects.entry(*effect).or_default() += 1);
        let (mut pairs, mut suspects) = (Vec::new(), Vec::new());
        for (effect, way) in &all.ways {
            let columns = way.iter().map(|k| (*k, all.all[*k].stddev, all.all[*k].range)).collect();
            let ln_prior = -((effects.len() * effects[effect]) as f64).ln();
            suspects.push(Suspect { effect, columns, products: pairs.len(), ln_prior });
            for (i, b) in way.iter().enumerate() {
                pairs.extend(way[..=i].iter().map(|a| (*a, *b)));
            }
        }
        (Self(suspects), pairs)
    }

    /// ln of the prior times the likelihood ratio of each suspect, over all sizes, since each start.
    pub fn terms(&self, starts: &[Since]) -> Vec<f64> {
        starts.iter().flat_map(|since| self.0.iter().map(|suspect| suspect.ln_term(since))).collect()
    }

    /// The effect for which most speaks, with these terms.
    pub fn likeliest(&self, terms: &[f64], starts: &[Since], all: &[Direction]) -> Option<Likeliest> {
        let (total, count) = (ln_sum(terms.iter().copied()), self.0.len());
        // Of each effect its share of all evidence, and its likeliest way and start.
        let mut effects: BTreeMap<&str, (f64, usize)> = BTreeMap::new();
        for (i, ln) in terms.iter().enumerate() {
            let best = effects.entry(self.0[i % count].effect).or_insert((0.0, i));
            best.0 += (ln - total).exp();
            best.1 = if *ln > terms[best.1] { i } else { best.1 };
        }
        let (probability, i) = effects.into_values().max_by(|a, b| a.0.total_cmp(&b.0))?;
        let (suspect, since) = (&self.0[i % count], starts.get(i / count)?);
        let ratio = |size: f64| suspect.posterior(since, size, SYSTEMATIC);
        let sizes = SIZES.into_iter().filter_map(ratio);
        let best = sizes.max_by(|a, b| a.ln_ratio.total_cmp(&b.ln_ratio))?;
        let own = suspect.columns.iter().zip(&best.numbers);
        let parameters = own.map(|((k, _, (low, high)), (estimate, stddev))| Parameter {
            name: all[*k].parameter.clone(),
            estimate: all[*k].origin + estimate.max(*low).min(*high) * all[*k].scale,
            stddev: stddev * all[*k].scale,
            unit: all[*k].unit,
        });
        Some(Likeliest {
            effect: suspect.effect.to_owned(),
            probability: probability.min(1.0),
            parameters: parameters.collect(),
            since_ns: since.start_ns,
        })
    }
}

/// What is known of a suspect if its effect has some size.
struct Posterior {
    ln_ratio: f64,
    /// Estimates of its columns and their standard deviations; none where the ratio is no evidence.
    numbers: Vec<(f64, f64)>,
}

impl Suspect {
    fn ln_term(&self, since: &Since) -> f64 {
        let known = self.columns.iter().enumerate().map(|(i, (_, s, _))| self.product(since, i, i) * s * s);
        if known.sum::<f64>() < NO_INFORMATION {
            return self.ln_prior;
        }
        let ratio =
            |size: &f64| self.posterior(since, *size, SYSTEMATIC).map_or(f64::NEG_INFINITY, |x| x.ln_ratio);
        self.ln_prior + ln_sum(SIZES.iter().map(ratio)) - (SIZES.len() as f64).ln()
    }

    /// G of two of its columns, the first of which is not before the other.
    fn product(&self, since: &Since, i: usize, j: usize) -> f64 {
        since.information[self.products + i * (i + 1) / 2 + j]
    }

    /// With an effect of this size, while readings that are off by so many standard deviations always are no news. `None`: numbers are not
    /// finite, or data put a column further beyond what a rig can have than chance does.
    fn posterior(&self, since: &Since, size: f64, systematic: f64) -> Option<Posterior> {
        // I + V^1/2 G V^1/2, and V^1/2 g; columns that it has not are those of the identity.
        let (mut information, mut score) = (Matrix::identity(), Vector::zeros());
        let mut spread = 0.0_f64;
        for (i, (column, stddev, _)) in self.columns.iter().enumerate() {
            score[i] = stddev * size * since.slope[*column];
            // Of a symmetric matrix the lower triangle is read.
            for (j, (_, other, _)) in self.columns[..=i].iter().enumerate() {
                information[(i, j)] += stddev * other * size * size * self.product(since, i, j);
            }
            // Over how many readings that column is spread that is spread most.
            let own = self.product(since, i, i).max(f64::MIN_POSITIVE);
            spread = spread.max(since.absolute[*column].powi(2) / own);
        }
        let factor = information.cholesky()?;
        let half = factor.l_dirty().solve_lower_triangular(&score)?;
        let left = (half.norm() - systematic * spread.sqrt()).max(0.0);
        let ln_ratio = 0.5 * left * left - factor.l_dirty().diagonal().product().ln();
        if ln_ratio < NO_EVIDENCE {
            return Some(Posterior { ln_ratio, numbers: Vec::new() });
        }
        let (mean, covariance) = (factor.solve(&score), factor.inverse());
        let mut possible = ln_ratio.is_finite();
        let numbers = self.columns.iter().enumerate().map(|(i, (_, unit, (low, high)))| {
            let (value, stddev) = (mean[i] * unit * size, covariance[(i, i)].sqrt() * unit * size);
            possible &= (low - value).max(value - high) <= BEYOND_STDDEVS * stddev;
            (value, stddev)
        });
        let numbers = numbers.collect();
        possible.then_some(Posterior { ln_ratio, numbers })
    }
}

/// ln sum exp; minus infinity of none.
pub(crate) fn ln_sum(terms: impl Iterator<Item = f64> + Clone) -> f64 {
    let most = terms.clone().fold(f64::NEG_INFINITY, f64::max);
    if most == f64::NEG_INFINITY { most } else { most + terms.map(|x| (x - most).exp()).sum::<f64>().ln() }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;

    const ANY: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);

    fn suspect(count: usize, stddev: f64) -> Suspect {
        let columns = (0..count).map(|k| (k, stddev, ANY)).collect();
        let products = 0;
        Suspect { effect: "drag", columns, products, ln_prior: 0.0 }
    }

    fn sums(slope: &[f64], pairs: &[f64]) -> Since {
        Since {
            start_ns: 0,
            slope: slope.to_vec(),
            information: pairs.to_vec(),
            absolute: vec![0.0; slope.len()],
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
        assert!((suspect.posterior(&sums, 3.0, 0.0).unwrap().ln_ratio - integral.ln()).abs() < 1e-9);
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
        assert!((suspect.posterior(&sums, 3.0, 0.0).unwrap().ln_ratio - expected).abs() < 1e-12);
    }

    /// What data put beyond a range is no explanation, unless it is so by chance.
    #[test]
    fn what_no_rig_can_have_is_no_explanation() {
        let sums = sums(&[100.0], &[50.0]);
        let of = |most: f64| {
            let suspect = Suspect { columns: vec![(0, 1.0, (-most, most))], ..suspect(1, 1.0) };
            suspect.posterior(&sums, 1.0, 0.0).map(|posterior| posterior.numbers[0].0)
        };
        // 100/(50 + 1) = 1.96 +- 0.14.
        for most in [3.0, 1.8] {
            assert!((of(most).unwrap() - 100.0 / 51.0).abs() < 1e-12);
        }
        assert_eq!(of(0.3), None);
    }

    /// Readings that are always off by less than what is allowed are no news, however many; a clear one is.
    #[test]
    fn a_small_error_that_lasts_is_no_evidence() {
        let suspect = suspect(1, 0.7);
        let ratio = |per_reading: f64, count: f64| {
            let sums = Since { absolute: vec![count], ..sums(&[per_reading * count], &[count]) };
            (
                suspect.posterior(&sums, 1.0, 0.2).unwrap().ln_ratio,
                suspect.posterior(&sums, 1.0, 0.0).unwrap().ln_ratio,
            )
        };
        for count in [1e2, 1e4, 1e6] {
            let (discounted, plain) = ratio(0.15, count);
            assert!(discounted < 0.0 && (count < 1e4 || plain > 50.0), "{discounted} {plain}");
            assert!(ratio(1.0, count).0 > 0.3 * count - 8.0);
        }
    }
}
