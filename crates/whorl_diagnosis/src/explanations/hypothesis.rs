//! Sets of effects as explanations: evidence, constraints, prediction of other data.

use crate::Settings;
use crate::evidence::regression::{Estimate, Normal};
use crate::explanations::candidates::Design;
use crate::parameters::Column;

/// Prior sizes of an effect that are tried, in units of its catalogue prior. A ball bearing has a thousand times the friction
/// of an air bearing, and no file states the kind of bearing.
const SIZES: [f64; 10] = [0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0, 1000.0];

/// Minus the logarithm of a size's prior probability.
fn prior_penalty_of_size(size: f64, settings: &Settings) -> f64 {
    (SIZES.len() as f64).ln() + rarity_nats(size, settings)
}

/// Log-prior penalty of an unusual size.
pub(crate) fn rarity_nats(size: f64, settings: &Settings) -> f64 {
    if size >= settings.unusual_size { settings.unusual_odds.ln() } else { 0.0 }
}

/// Sizes that are tried first, with every option.
const COARSE_SIZES: [f64; 3] = [0.01, 0.3, 30.0];

/// The same where the column goes with the value's square: a hundredth of a prior shows nothing of it.
const COARSE_ROOTS: [f64; 3] = [0.3, 3.0, 30.0];

/// One effect of a hypothesis and how it enters.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Term {
    pub candidate: usize,
    pub columns: Vec<usize>,
    /// Prior size, in units of the catalogue's prior.
    pub size: f64,
    /// Number of ways in which it could have entered: the prior is shared among them.
    pub options: usize,
}

impl Term {
    /// The same effect as columns of another design matrix.
    pub fn carried(&self, from: &Design, to: &Design) -> Option<Self> {
        let id = from.candidates.get(self.candidate)?.id;
        let candidate = to.candidates.iter().position(|c| c.id == id)?;
        let old: Vec<_> = self.columns.iter().filter_map(|i| from.columns.get(*i)).collect();
        let special = old.iter().any(|c| c.origin.is_some());
        let mut columns: Vec<usize> = to.candidates[candidate]
            .options
            .iter()
            .flatten()
            .copied()
            .filter(|i| special || to.columns.get(*i).is_some_and(|c| old.iter().any(|o| o.index == c.index)))
            .collect();
        columns.sort_unstable();
        columns.dedup();
        // Columns that had to leave a fit elsewhere, against their sign, may have theirs here.
        let options = &to.candidates[candidate].options;
        if !columns.is_empty() && !options.contains(&columns) {
            let holds = |option: &&Vec<usize>| columns.iter().all(|i| option.contains(i));
            if let Some(whole) = options.iter().filter(holds).min_by_key(|option| option.len()) {
                columns.clone_from(whole);
            }
        }
        // The choice of a grid point has its penalty in the prior of the value that it became.
        let was_place = special && old.iter().all(|c| c.step.iter().all(|s| *s == 0.0));
        let is_paid = was_place || (special && columns.iter().any(|i| to.columns[*i].is_shape));
        let options = if is_paid { 1 } else { self.options };
        Some(Self { candidate, columns, size: self.size, options })
    }

    /// Prior standard deviation of one of its columns, in the column's units.
    fn prior_stddev(&self, column: &Column) -> f64 {
        if column.is_shape {
            1.0
        } else if column.quadratic {
            // The square of a value of this size.
            (self.size * column.catalogue_stddev).powi(2)
        } else {
            self.size * column.catalogue_stddev
        }
    }
}

/// A set of effects, fitted jointly with the base model.
#[derive(Debug, Clone)]
pub(crate) struct Hypothesis {
    pub terms: Vec<Term>,
    pub estimate: Estimate,
    /// Log evidence, with the log-prior penalty of the choices.
    pub log_evidence: f64,
}

impl Hypothesis {
    /// The base model alone.
    pub fn base(design: &Design, normal: &Normal) -> Option<Self> {
        Self::of(design, normal, Vec::new())
    }

    /// Fits a set of terms; columns against their sign constraint leave the fit. `None` when a parameter
    /// would have a value that no such platform can have.
    pub fn of(design: &Design, normal: &Normal, terms: Vec<Term>) -> Option<Self> {
        Self::fitted(design, normal, terms, true)
    }

    /// As [`Self::of`], with no limit on any value.
    pub fn free(design: &Design, normal: &Normal, terms: Vec<Term>) -> Option<Self> {
        Self::fitted(design, normal, terms, false)
    }

    fn fitted(design: &Design, normal: &Normal, mut terms: Vec<Term>, limited: bool) -> Option<Self> {
        for _ in 0..8 {
            let mut active = design.base.clone();
            let mut variance: Vec<f64> = (0..design.columns.len()).map(|i| design.base_variance(i)).collect();
            for term in &terms {
                for i in &term.columns {
                    let column = &design.columns[*i];
                    variance[*i] += term.prior_stddev(column).powi(2);
                    if column.base_stddev == 0.0 && !active.contains(i) {
                        active.push(*i);
                    }
                }
            }
            let estimate = Estimate::new(normal, &active, |i| variance[i].max(1e-12))?;
            // Only columns that are no part of the base obey their range here.
            let mut worst: Option<(usize, f64)> = None;
            for term in terms.iter().filter(|_| limited) {
                for i in &term.columns {
                    let column = &design.columns[*i];
                    let value = estimate.of(*i);
                    // A shape that is at the end of its range stays there.
                    let against = if column.base_stddev == 0.0 && column.range.0 > -1e-9 {
                        -value
                    } else if column.floats && column.range.1 < 1e-9 {
                        value
                    } else {
                        0.0
                    };
                    if against > 0.0 && worst.is_none_or(|(_, w)| against > w) {
                        worst = Some((*i, against));
                    }
                }
            }
            let Some((out, _)) = worst else {
                // A size that no such platform can have explains nothing.
                let implausible = limited
                    && terms.iter().flat_map(|m| &m.columns).any(|i| {
                        let column = &design.columns[*i];
                        let value = estimate.of(*i);
                        let slack = 1e-6 * (1.0 + column.range.0.abs().min(column.range.1.abs()));
                        !column.quadratic
                            && !column.is_shape
                            && (value < column.range.0 - slack || value > column.range.1 + slack)
                    });
                if implausible {
                    return None;
                }
                let signs = terms
                    .iter()
                    .flat_map(|m| &m.columns)
                    .filter(|i| design.columns[**i].base_stddev == 0.0 && design.columns[**i].range.0 > -1e-9)
                    .count();
                let choices: f64 = terms
                    .iter()
                    .map(|m| (m.options as f64).ln() + prior_penalty_of_size(m.size, &design.settings))
                    .sum();
                let log_evidence = estimate.log_evidence - choices + signs as f64 * 2f64.ln();
                return Some(Self { terms, estimate, log_evidence });
            };
            for term in &mut terms {
                // Without this column the effect would be another one.
                let column = design.columns.get(out).filter(|_| term.columns.contains(&out));
                if column.is_some_and(|c| c.essential) {
                    term.columns.clear();
                }
                term.columns.retain(|i| *i != out);
            }
            terms.retain(|m| !m.columns.is_empty());
            if terms.is_empty() {
                return None;
            }
        }
        None
    }

    /// Prior variance of every column under this hypothesis.
    pub fn variances(&self, design: &Design) -> Vec<f64> {
        let mut variance: Vec<f64> = (0..design.columns.len()).map(|i| design.base_variance(i)).collect();
        for term in &self.terms {
            for i in &term.columns {
                if let (Some(slot), Some(column)) = (variance.get_mut(*i), design.columns.get(*i)) {
                    *slot += term.prior_stddev(column).powi(2);
                }
            }
        }
        variance
    }

    /// The best way for one more effect to enter; `None` if it would have to act against its sign.
    pub fn with(&self, design: &Design, normal: &Normal, candidate: usize) -> Option<Self> {
        let options = &design.candidates.get(candidate)?.options;
        let wanted = self.terms.len() + 1;
        let try_one = |columns: &[usize], size: f64| {
            let mut terms = self.terms.clone();
            terms.push(Term { candidate, columns: columns.to_vec(), size, options: options.len() });
            Self::of(design, normal, terms).filter(|h| h.terms.len() == wanted)
        };
        let better = |best: Option<Self>, found: Option<Self>| match (best, found) {
            (Some(a), Some(b)) => Some(if b.log_evidence > a.log_evidence { b } else { a }),
            (a, b) => a.or(b),
        };
        // Sizes first at a coarse step for every option, then finely for the best.
        let mut best: Option<Self> = None;
        for columns in options {
            let of_squares = columns.iter().all(|i| design.columns.get(*i).is_some_and(|c| c.quadratic));
            for size in if of_squares { COARSE_ROOTS } else { COARSE_SIZES } {
                best = better(best, try_one(columns, size));
            }
        }
        let columns = best.as_ref()?.terms.last()?.columns.clone();
        let full = options.first().cloned().unwrap_or_default();
        for size in SIZES {
            best = better(best, try_one(&columns, size));
            best = better(best, try_one(&full, size));
        }
        best
    }

    /// The same terms, the last of them at the prior size that the data support best.
    pub fn resized(self, design: &Design, normal: &Normal) -> Self {
        let mut best = self;
        for size in SIZES {
            let mut terms = best.terms.clone();
            if let Some(last) = terms.last_mut() {
                last.size = size;
            }
            if let Some(other) = Self::of(design, normal, terms)
                && other.terms.len() == best.terms.len()
                && other.log_evidence > best.log_evidence
            {
                best = other;
            }
        }
        best
    }

    /// Without one of its terms.
    pub fn without(&self, design: &Design, normal: &Normal, term: usize) -> Option<Self> {
        let mut terms = self.terms.clone();
        if term >= terms.len() {
            return None;
        }
        terms.remove(term);
        Self::of(design, normal, terms)
    }

    /// Its terms' ids, in alphabetical order.
    pub fn names(&self, design: &Design) -> Vec<String> {
        let mut names: Vec<String> = self
            .terms
            .iter()
            .filter_map(|m| design.candidates.get(m.candidate).map(|c| c.id.to_owned()))
            .collect();
        names.sort();
        names
    }

    /// Fits the same terms to other data.
    pub fn refitted(&self, design: &Design, normal: &Normal) -> Option<Self> {
        Self::of(design, normal, self.terms.clone())
    }
}

#[cfg(test)]
mod tests {
    use whorl_dynamics::{ModelPrior, PlatformModel};

    use super::*;
    use crate::explanations::lines::{Lines, Mode};
    use crate::parameters::Reference;
    use crate::parameters::available::Available;

    /// A boom whose participation is six times what the catalogue expects: its square, in which the regression is
    /// linear, is forty times.
    #[test]
    fn a_resonance_far_larger_than_expected_is_found() {
        let model = PlatformModel::whorl_1_reference();
        let reference = Reference::new(&model, &ModelPrior::typical(&model));
        let axis_b = nalgebra::Vector3::new(0.6, 0.0, 0.8);
        let lines = Lines {
            modes: vec![Mode { hz: 2.5, damping_ratio: 0.01, axis_b, significance: 6.0 }],
            ..Lines::default()
        };
        let available = Available { body: true, bin_s: 0.04, ..Available::default() };
        let design =
            Design::of_effects(&reference, &reference.point(), &available, &["flexible_mode"], &lines);
        let own = design.candidates[0]
            .options
            .iter()
            .flatten()
            .copied()
            .find(|i| design.columns[*i].origin.as_ref().is_some_and(|o| (o[3] - 2.5).abs() < 1e-9))
            .unwrap();
        // The data know the square to +-6.
        let mut normal = Normal::zeros(design.columns.len());
        normal.matrix[(own, own)] = 1.0 / 36.0;
        normal.vector[own] = 40.0 / 36.0;
        let base = Hypothesis::base(&design, &normal).unwrap();
        let found = base.with(&design, &normal, 0).unwrap();
        assert_eq!(found.terms[0].columns, [own]);
        assert!((found.estimate.of(own) - 40.0).abs() < 6.0, "{}", found.estimate.of(own));
        assert!(found.log_evidence - base.log_evidence > 10.0);
    }
}
