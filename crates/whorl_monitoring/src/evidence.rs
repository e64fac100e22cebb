//! The running evidence that the model has stopped being right, and which effect explains it best: METHOD.md, "Evidence".

use std::collections::BTreeMap;

use nalgebra::{SMatrix, SVector};
use whorl_prediction::Since;

use crate::directions::{Direction, Directions, MOST_DIRECTIONS};
use crate::fit::Likeliest;

/// Systematic error of a whitened reading, over its standard deviation: innovations of a filter whose background torque is there or not correlate
/// so much with what it corrected (measured: 600 s of holding, wheels, no background torque). Twice that hides a jet that was always weak.
const SYSTEMATIC: f64 = 0.11;
/// Prior sizes of an effect over the catalogue's, each as likely: those of the diagnosis that a run of minutes can tell.
const SIZES: [f64; 4] = [0.3, 1.0, 3.0, 10.0];
/// With less information than this over its prior nothing is known of a suspect: the ratio is one.
const NO_INFORMATION: f64 = 1e-5;
/// A ratio below this is nothing beside a limit [nats]: whether a rig can be like that does not matter.
const NO_EVIDENCE: f64 = 1.0;
/// Deviations beyond an end of a range that are no chance: a jet that is dead is at its end, and an estimate scatters about it.
const BEYOND_STDDEVS: f64 = 3.0;

/// One suspect: an effect in one of its ways.
pub(crate) struct Suspect {
    pub effect: &'static str,
    /// Its parameters, each with its prior standard deviation and what a rig can have of it.
    pub columns: Vec<(usize, f64, (f64, f64))>,
    /// Where the products of its columns begin among the pairs: (0, 0), (0, 1), (1, 1), (0, 2) and so on.
    pub products: usize,
    pub ln_prior: f64,
}

/// All suspects: what makes evidence of sums since starts.
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
        let sizes = SIZES.into_iter().filter_map(|size| suspect.posterior(since, size, SYSTEMATIC));
        let best = sizes.max_by(|a, b| a.0.total_cmp(&b.0))?;
        let own = suspect.columns.iter().zip(&best.1);
        let parameters = own.map(|((k, _, (low, high)), (estimate, stddev))| {
            let Direction { parameter, origin, scale, unit, .. } = &all[*k];
            let value = origin + estimate.max(*low).min(*high) * scale;
            (parameter.clone(), [value, stddev * scale], *unit)
        });
        let (effect, probability) = (suspect.effect.to_owned(), probability.min(1.0));
        Some(Likeliest { effect, probability, parameters: parameters.collect(), since_ns: since.start_ns })
    }
}

impl Suspect {
    fn ln_term(&self, since: &Since) -> f64 {
        let known = self.columns.iter().enumerate().map(|(i, (_, s, _))| self.product(since, i, i) * s * s);
        if known.sum::<f64>() < NO_INFORMATION {
            return self.ln_prior;
        }
        let ratio = |size: &f64| self.posterior(since, *size, SYSTEMATIC).map_or(f64::NEG_INFINITY, |x| x.0);
        self.ln_prior + ln_sum(SIZES.iter().map(ratio)) - (SIZES.len() as f64).ln()
    }

    /// G of two of its columns, the first of which is not before the other.
    fn product(&self, since: &Since, i: usize, j: usize) -> f64 {
        since.information[self.products + i * (i + 1) / 2 + j]
    }

    /// ln of the likelihood ratio with an effect of this size, and estimates of its columns with their deviations, none where it is no evidence; readings
    /// that are always off by so many deviations are no news. `None`: not finite, or a column is further beyond its range than chance puts it.
    pub fn posterior(&self, since: &Since, size: f64, systematic: f64) -> Option<(f64, Vec<(f64, f64)>)> {
        // I + V^1/2 G V^1/2, and V^1/2 g; columns that it has not are those of the identity.
        let mut information = SMatrix::<f64, MOST_DIRECTIONS, MOST_DIRECTIONS>::identity();
        let (mut score, mut spread) = (SVector::<f64, MOST_DIRECTIONS>::zeros(), 0.0_f64);
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
            return Some((ln_ratio, Vec::new()));
        }
        let (mean, covariance) = (factor.solve(&score), factor.inverse());
        let mut possible = ln_ratio.is_finite();
        let numbers = self.columns.iter().enumerate().map(|(i, (_, unit, (low, high)))| {
            let (value, stddev) = (mean[i] * unit * size, covariance[(i, i)].sqrt() * unit * size);
            possible &= (low - value).max(value - high) <= BEYOND_STDDEVS * stddev;
            (value, stddev)
        });
        let numbers = numbers.collect();
        possible.then_some((ln_ratio, numbers))
    }
}

/// ln sum exp; minus infinity of none.
pub(crate) fn ln_sum(terms: impl Iterator<Item = f64> + Clone) -> f64 {
    let most = terms.clone().fold(f64::NEG_INFINITY, f64::max);
    if most == f64::NEG_INFINITY { most } else { most + terms.map(|x| (x - most).exp()).sum::<f64>().ln() }
}
