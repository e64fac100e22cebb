//! The evidence of every step of an amplitude, from the normal equations of stretches of time.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::diagnosis::Onset;
use crate::evidence::regression::Normal;
use crate::explanations::candidates::Layout;
use crate::parameters::{Column, Point};
use crate::search::Search;
use crate::search::changes::stage::{Grid, Stage};
use crate::search::changes::suspects::Suspect;
use crate::search::standing::Converged;

/// Prior sizes of an amplitude, in units of its catalogue prior: as for effects that do not change, in coarser steps.
const SIZES: [f64; 7] = [0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0];

/// An interval that holds this much of the posterior is reported.
const REPORTED: f64 = 0.95;

/// Weights below this share of the likeliest do not count.
const NO_WEIGHT: f64 = -25.0;

/// Normal equations of one run: the set's columns, then each amplitude's stretches.
pub(crate) struct Cut {
    pub normal: Normal,
    pub stretches: usize,
}

/// Where the amplitude steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Place {
    pub run: usize,
    /// Bound of the grid; 0 is the run's beginning.
    pub bound: usize,
    /// The runs that follow are like the end of this one, and not like its beginning.
    pub onward: bool,
}

/// Where there is an amplitude that is not zero.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Side {
    Before,
    After,
    Both,
}

const SIDES: [Side; 3] = [Side::Before, Side::After, Side::Both];

/// One step with its values.
#[derive(Debug, Clone)]
pub(crate) struct Best {
    pub place: Place,
    /// Log posterior mass, up to a constant.
    log_mass: f64,
    value: DVector<f64>,
    variance: DVector<f64>,
    /// Values of the set's columns, in the order of its active ones.
    of_set: Vec<(usize, f64)>,
}

/// All steps of an amplitude on a grid.
pub(crate) struct Steps {
    /// Log evidence of a step anywhere on the grid, the set and the data included.
    pub log_evidence: f64,
    /// The same of an amplitude that does not change.
    pub constant: f64,
    pub best: Best,
    /// Log mass of each bound of each run.
    log_mass: Vec<Vec<f64>>,
    bounds: Vec<Vec<usize>>,
}

/// What all runs say of the set and of the stretches.
pub(crate) struct Regression {
    pub active: Vec<usize>,
    /// Which of the active columns are the changing effect's amplitudes.
    pub own: Vec<bool>,
    pub variances: Vec<f64>,
    pub cuts: Vec<Cut>,
    pub log_density: f64,
    /// Log prior of choices, with and without the effect as a member.
    pub choices: [f64; 2],
}

impl Suspect {
    /// Whether a column of a set is one of the amplitudes that change, and not one of the base model, which stays.
    pub fn is_amplitude_of(&self, layout: &Layout, column: usize) -> bool {
        let is_same = |c: &Column| c.group == self.id && self.columns.iter().any(|own| own.index == c.index);
        !self.is_base && layout.columns.get(column).is_some_and(is_same)
    }
}

/// Sums over the stretches from each bound to the end of a run.
struct Suffixes {
    /// Rows: the set's columns; of each amplitude, of each bound.
    with_set: Vec<Vec<DVector<f64>>>,
    with_data: Vec<Vec<f64>>,
    /// Of two amplitudes, each from a bound.
    products: DMatrix<f64>,
    bounds: usize,
}

impl Suffixes {
    fn of(cut: &Cut, kept: &[usize], first: usize, amplitudes: usize) -> Self {
        let m = cut.stretches;
        let at = |q: usize, k: usize| first + q * m + k;
        let normal = &cut.normal;
        let (mut with_set, mut with_data) = (Vec::new(), Vec::new());
        for q in 0..amplitudes {
            let mut sums = vec![DVector::zeros(kept.len()); m + 1];
            let mut data = vec![0.0; m + 1];
            for k in (0..m).rev() {
                let own =
                    DVector::from_iterator(kept.len(), kept.iter().map(|i| normal.matrix[(at(q, k), *i)]));
                sums[k] = &sums[k + 1] + own;
                data[k] = data[k + 1] + normal.vector[at(q, k)];
            }
            with_set.push(sums);
            with_data.push(data);
        }
        let bounds = m + 1;
        let mut products = DMatrix::zeros(amplitudes * bounds, amplitudes * bounds);
        for q in 0..amplitudes {
            for p in 0..amplitudes {
                for k in (0..m).rev() {
                    for l in (0..m).rev() {
                        let (row, column) = (q * bounds + k, p * bounds + l);
                        products[(row, column)] = normal.matrix[(at(q, k), at(p, l))]
                            + products[(row + 1, column)]
                            + products[(row, column + 1)]
                            - products[(row + 1, column + 1)];
                    }
                }
            }
        }
        Self { with_set, with_data, products, bounds }
    }

    fn product(&self, a: (usize, usize), b: (usize, usize)) -> f64 {
        self.products[(a.0 * self.bounds + a.1, b.0 * self.bounds + b.1)]
    }
}

/// The set's columns without the changing ones, fitted.
struct OfSet {
    kept: Vec<usize>,
    factor: Cholesky<f64, Dyn>,
    vector: DVector<f64>,
    value: DVector<f64>,
    log_evidence: f64,
}

impl Regression {
    fn of_set(&self, keeps: impl Fn(usize) -> bool) -> Option<OfSet> {
        let kept: Vec<usize> = (0..self.active.len()).filter(|i| keeps(*i)).collect();
        let mut matrix = DMatrix::zeros(kept.len(), kept.len());
        let mut vector = DVector::zeros(kept.len());
        let (mut squares, mut log_determinant) = (0.0, 0.0);
        for cut in &self.cuts {
            squares += cut.normal.sum_of_squares;
            for (a, i) in kept.iter().enumerate() {
                vector[a] += cut.normal.vector[*i];
                for (b, j) in kept.iter().enumerate() {
                    matrix[(a, b)] += cut.normal.matrix[(*i, *j)];
                }
            }
        }
        for (a, i) in kept.iter().enumerate() {
            let variance = self.variances.get(*i).copied().unwrap_or(1.0);
            matrix[(a, a)] += 1.0 / variance;
            log_determinant += variance.ln();
        }
        let factor = Cholesky::new(matrix)?;
        let value: DVector<f64> = factor.solve(&vector);
        log_determinant += factor.l_dirty().diagonal().iter().map(|d: &f64| 2.0 * d.ln()).sum::<f64>();
        let log_evidence =
            0.5 * value.dot(&vector) - 0.5 * log_determinant - 0.5 * squares + self.log_density;
        Some(OfSet { kept, factor, vector, value, log_evidence })
    }

    /// All steps on a grid. `None`: the regression has no solution, or no step has values that a platform can have.
    pub fn steps(&self, suspect: &Suspect, grid: &Grid) -> Option<Steps> {
        let constant = self.of_set(|_| true)?.log_evidence + self.choices[0];
        let set = self.of_set(|i| !self.own.get(i).is_some_and(|own| *own))?;
        let amplitudes = suspect.columns.len();
        let suffixes: Vec<Suffixes> =
            self.cuts.iter().map(|cut| Suffixes::of(cut, &set.kept, self.active.len(), amplitudes)).collect();
        let sides: &[Side] = if suspect.is_base { &[Side::After] } else { &SIDES };
        let mut log_mass: Vec<Vec<f64>> =
            grid.mass.iter().map(|m| vec![f64::NEG_INFINITY; m.len()]).collect();
        let mut best: Option<Best> = None;
        for (run, masses) in grid.mass.iter().enumerate() {
            for (bound, mass) in masses.iter().enumerate() {
                if *mass <= 0.0 || suffixes.get(run).is_none_or(|s| bound + 1 >= s.bounds) {
                    continue;
                }
                for onward in [false, true] {
                    // The last run has none that follows; from the first run's beginning on, nothing changes.
                    if onward && (run + 1 == self.cuts.len() || (run, bound) == (0, 0)) {
                        continue;
                    }
                    let ways = if run + 1 == self.cuts.len() || (run, bound) == (0, 0) { 1.0 } else { 2.0 };
                    let place = Place { run, bound, onward };
                    let joint = self.joint(&suffixes, place, amplitudes, &set);
                    let price = (mass / ways / (sides.len() * SIZES.len()) as f64).ln();
                    for side in sides {
                        for size in SIZES {
                            let Some(found) = joint.fitted(suspect, *side, size) else { continue };
                            let weight = found.log_evidence + price;
                            let slot = &mut log_mass[run][bound];
                            *slot = add_logs(*slot, weight);
                            if best.as_ref().is_none_or(|b| weight > b.log_mass) {
                                best = Some(joint.best(self, &set, place, weight, &found));
                            }
                        }
                    }
                }
            }
        }
        let best = best?;
        let gain = log_mass.iter().flatten().copied().fold(f64::NEG_INFINITY, add_logs);
        Some(Steps {
            log_evidence: set.log_evidence + self.choices[1] + gain,
            constant,
            best,
            log_mass,
            bounds: grid.bounds.clone(),
        })
    }

    /// The amplitudes before and after a step beside the set: what is left when the set's columns follow them.
    fn joint(&self, suffixes: &[Suffixes], place: Place, amplitudes: usize, set: &OfSet) -> Joint {
        let size = 2 * amplitudes;
        let mut products = DMatrix::zeros(size, size);
        let mut data = DVector::zeros(size);
        let mut with_set = DMatrix::zeros(set.kept.len(), size);
        for (r, run) in suffixes.iter().enumerate() {
            // From which bound on this run is "after".
            let from = match r.cmp(&place.run) {
                std::cmp::Ordering::Equal => place.bound,
                std::cmp::Ordering::Greater if place.onward => 0,
                _ => run.bounds - 1,
            };
            for q in 0..amplitudes {
                let after = &run.with_set[q][from];
                let before = &run.with_set[q][0] - after;
                with_set.column_mut(amplitudes + q).axpy(1.0, after, 1.0);
                with_set.column_mut(q).axpy(1.0, &before, 1.0);
                data[amplitudes + q] += run.with_data[q][from];
                data[q] += run.with_data[q][0] - run.with_data[q][from];
                for p in 0..amplitudes {
                    let of = |k: usize, l: usize| run.product((q, k), (p, l));
                    let (all, mixed, late) = (of(0, 0), of(from, 0), of(from, from));
                    products[(amplitudes + q, amplitudes + p)] += late;
                    products[(amplitudes + q, p)] += mixed - late;
                    products[(q, amplitudes + p)] += of(0, from) - late;
                    products[(q, p)] += all - mixed - of(0, from) + late;
                }
            }
        }
        let follows = set.factor.solve(&with_set);
        let own = &products - with_set.transpose() * &follows;
        let left = &data - follows.transpose() * &set.vector;
        Joint { own, left, follows, amplitudes }
    }
}

/// Amplitudes before and after a step, what the set's columns explain taken off.
struct Joint {
    own: DMatrix<f64>,
    left: DVector<f64>,
    /// Change of the set's values per unit of each amplitude, with the sign reversed.
    follows: DMatrix<f64>,
    amplitudes: usize,
}

/// Values of the amplitudes of one step.
struct Fitted {
    log_evidence: f64,
    /// Before, then after; zero where there is none.
    value: DVector<f64>,
    variance: DVector<f64>,
}

impl Joint {
    fn fitted(&self, suspect: &Suspect, side: Side, size: f64) -> Option<Fitted> {
        let n = self.amplitudes;
        let chosen: Vec<usize> = match side {
            Side::Before => (0..n).collect(),
            Side::After => (n..2 * n).collect(),
            Side::Both => (0..2 * n).collect(),
        };
        let column = |i: usize| suspect.columns.get(i % n);
        let mut matrix = DMatrix::zeros(chosen.len(), chosen.len());
        let mut vector = DVector::zeros(chosen.len());
        let (mut log_determinant, mut signs) = (0.0, 0);
        for (a, i) in chosen.iter().enumerate() {
            let column = column(*i)?;
            let variance = (size * column.catalogue_stddev).powi(2).max(1e-12);
            for (b, j) in chosen.iter().enumerate() {
                matrix[(a, b)] = self.own[(*i, *j)];
            }
            matrix[(a, a)] += 1.0 / variance;
            vector[a] = self.left[*i];
            log_determinant += variance.ln();
            signs += usize::from(!suspect.is_base && column.range.0 > -1e-9);
        }
        let factor = Cholesky::new(matrix)?;
        let found = factor.solve(&vector);
        for (a, i) in chosen.iter().enumerate() {
            let column = column(*i)?;
            let slack = 1e-6 * (1.0 + column.range.0.abs().min(column.range.1.abs()));
            if !suspect.is_base && (found[a] < column.range.0 - slack || found[a] > column.range.1 + slack) {
                return None;
            }
        }
        log_determinant += factor.l_dirty().diagonal().iter().map(|d: &f64| 2.0 * d.ln()).sum::<f64>();
        let log_evidence =
            0.5 * found.dot(&vector) - 0.5 * log_determinant + signs as f64 * std::f64::consts::LN_2;
        let covariance = factor.inverse();
        let (mut value, mut variance) = (DVector::zeros(2 * n), DVector::zeros(2 * n));
        for (a, i) in chosen.iter().enumerate() {
            value[*i] = found[a];
            variance[*i] = covariance[(a, a)].max(0.0);
        }
        log_evidence.is_finite().then_some(Fitted { log_evidence, value, variance })
    }

    fn best(
        &self,
        regression: &Regression,
        set: &OfSet,
        place: Place,
        log_mass: f64,
        found: &Fitted,
    ) -> Best {
        let values = &set.value - &self.follows * &found.value;
        let column = |i: &usize| regression.active.get(*i).copied().unwrap_or(usize::MAX);
        let of_set = set.kept.iter().zip(values.iter()).map(|(i, value)| (column(i), *value)).collect();
        Best { place, log_mass, value: found.value.clone(), variance: found.variance.clone(), of_set }
    }
}

impl Steps {
    /// The point at which the set's columns have their values beside the likeliest step.
    pub fn point(&self, search: &Search<'_>, at: &Converged) -> Point {
        let reference = &search.problem.reference;
        let mut point = at.point.clone();
        for (i, value) in &self.best.of_set {
            let Some(column) = at.layout.columns.get(*i) else { continue };
            if column.quadratic || column.origin.is_some() {
                continue;
            }
            let units = value - reference.distance(&at.point, column);
            point = reference.moved(&point, column, units);
        }
        reference.towards(&at.point, point)
    }

    /// Values of an amplitude before and after, and their standard deviations, in units of its column. What the base model
    /// holds is there before.
    pub fn values(&self, suspect: &Suspect, layout: &Layout, amplitude: usize) -> ([f64; 2], [f64; 2]) {
        let n = self.best.value.len() / 2;
        let of = |i: usize| (self.best.value[i], self.best.variance[i].sqrt());
        let ((before, s), (after, t)) = (of(amplitude), of(n + amplitude));
        if !suspect.is_base {
            return ([before, after], [s, t]);
        }
        let is_same = |i: usize| {
            let (own, other) = (suspect.columns.get(amplitude), layout.columns.get(i));
            own.zip(other).is_some_and(|(a, b)| (a.group, a.index) == (b.group, b.index))
        };
        let from = self.best.of_set.iter().find(|(i, _)| is_same(*i)).map_or(0.0, |(_, value)| *value);
        ([from, from + after], [0.0, t])
    }

    /// First and last bound of a run between which this share of its mass lies.
    pub fn span(&self, run: usize, share: f64) -> Option<(usize, usize)> {
        let weights = self.weights(run)?;
        let total: f64 = weights.iter().sum();
        let mut sum = 0.0;
        let (mut from, mut to) = (None, None);
        for (k, weight) in weights.iter().enumerate() {
            sum += weight;
            if from.is_none() && sum > 0.5 * (1.0 - share) * total {
                from = Some(k);
            }
            if to.is_none() && sum >= (0.5 + 0.5 * share) * total {
                to = Some(k);
            }
        }
        Some((from?, to?))
    }

    /// Relative mass of steps within a run.
    fn weights(&self, run: usize) -> Option<Vec<f64>> {
        let masses = self.log_mass.get(run)?;
        let most = masses.iter().skip(1).copied().fold(f64::NEG_INFINITY, f64::max);
        let relative = |(k, mass): (usize, &f64)| {
            let below = mass - most;
            if k == 0 || below < NO_WEIGHT { 0.0 } else { below.exp() }
        };
        most.is_finite().then(|| masses.iter().enumerate().map(relative).collect())
    }

    /// When the step is: mean, standard deviation and the interval that holds 95 %. Between bounds it may be anywhere.
    pub fn onset(&self, stage: &Stage) -> Option<Onset> {
        let run = self.best.place.run;
        let (weights, bounds) = (self.weights(run)?, self.bounds.get(run)?);
        let time = |bound: usize| bounds.get(bound).map_or(0.0, |node| stage.runs[run].time(*node));
        let total: f64 = weights.iter().sum();
        let mean = weights.iter().enumerate().map(|(k, w)| w * time(k)).sum::<f64>() / total;
        let cell = |k: usize| 0.5 * (time(k + 1) - time(k - 1));
        let square: f64 = weights
            .iter()
            .enumerate()
            .filter(|(_, w)| **w > 0.0)
            .map(|(k, w)| w * ((time(k) - mean).powi(2) + cell(k).powi(2) / 12.0))
            .sum();
        let (from, to) = self.span(run, REPORTED)?;
        Some(Onset {
            at_s: mean,
            stddev_s: (square / total).sqrt(),
            from_s: 0.5 * (time(from) + time(from.max(1) - 1)).max(0.0),
            to_s: 0.5 * (time(to) + time(to + 1)),
        })
    }
}

/// Logarithm of the sum of what two numbers are the logarithms of.
pub(crate) fn add_logs(a: f64, b: f64) -> f64 {
    let most = a.max(b);
    if most == f64::NEG_INFINITY { most } else { most + ((a - most).exp() + (b - most).exp()).ln() }
}
