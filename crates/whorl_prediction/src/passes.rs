//! Passes over recordings, and what they say of starts and parameters.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector, Vector3};
use whorl_math::lanes::Lanes;

use crate::columns::Columns;
use crate::filter::{Filter, Likelihood};
use crate::frozen::innovations_from;
use crate::innovations::Innovation;
use crate::laws::Laws;
use crate::noise::Noise;
use crate::other::Varied;
use crate::prepared::Prepared;
use crate::refusal::PredictionError;
use crate::start::Start;
use crate::trail::Trail;

/// Bytes that are kept at most of how innovations change: six minutes at 100 Hz of nine numbers and 70 parameters. Longer recordings are
/// gone through with columns each time.
const MOST_BYTES: usize = 96 << 20;

/// What a pass over a recording says.
pub(crate) struct Pass {
    pub likelihood: Likelihood,
    /// How the start moves that the run shows, from where it was given.
    pub shift: DVector<f64>,
    /// d log p / dtheta.
    pub slope: DVector<f64>,
    pub sums: Sums,
    /// For passes close by: innovations are white, so that where their changes are a little other than those that were kept, the slope errs by as
    /// small a share of a deviation.
    pub kept: Option<Arc<Kept>>,
}

/// What of a pass does not depend on its innovations.
#[derive(Debug, Clone)]
pub(crate) struct Sums {
    /// -d^2 log p / dtheta^2, Gauss and Newton's.
    pub information: DMatrix<f64>,
    /// How the start that the run shows moves with the parameters, and its covariance given the run.
    pub of_start: DMatrix<f64>,
    pub own: DMatrix<f64>,
    /// About which axis the attitude at the start is of no consequence.
    unseen_axis: Option<Vector3<f64>>,
}

/// How innovations change with the start and the parameters, and the gains with which they do.
#[derive(Debug, Clone)]
pub(crate) struct Kept {
    gains: Trail,
    /// Changes of the normalised innovations, one innovation after the other, each by the state at the start and then by the parameters; a share of
    /// 1e-7 is enough.
    design: Vec<f32>,
    sums: Sums,
    wider: Wider,
}

/// What it changes that a filter began with less than it was given.
#[derive(Debug, Clone)]
struct Wider {
    /// How the start moves by how it moved.
    of_shift: DMatrix<f64>,
    /// What is added to the slope by how the start moved.
    of_slope: DMatrix<f64>,
}

impl Pass {
    /// Over the first so many instants, without parameters.
    pub fn of_start(case: &Prepared<'_>, noise: &Noise, start: &Start, most: usize) -> Self {
        let filter = Filter::new(case, noise, start).about_known_biases(start);
        let mut filter = filter.varying(Columns::since_now(start.layout));
        let likelihood = filter.run(most, &mut |_| {});
        Self::behind(&mut filter, likelihood).0
    }

    /// Over a whole recording with columns of parameters and laws; `keeps`: what passes close by need.
    pub fn of(
        case: &Prepared<'_>,
        noise: &Noise,
        start: &Start,
        varied: &[Varied],
        laws: Option<&Laws<'_>>,
        keeps: bool,
    ) -> Result<Self, PredictionError> {
        let mut columns = Columns::new(case, start.layout, true, varied, laws)?;
        let changes = (start.layout.size() + columns.count()) * case.numbers();
        let mut filter = Filter::new(case, noise, start).about_known_biases(start);
        if keeps && changes * size_of::<f32>() <= MOST_BYTES {
            columns.blocks.design = Some(Vec::with_capacity(changes));
            filter = filter.keeping();
        }
        let mut filter = filter.varying(columns);
        let likelihood = filter.run(usize::MAX, &mut |_| {});
        let (mut pass, design) = Self::behind(&mut filter, likelihood);
        let wide = pass.sums.seen(&Start::wide(case, noise).covariance);
        let wider = pass.sums.widen(&filter.known, &wide);
        pass.slope += &wider.of_slope * &pass.shift;
        pass.shift = &wider.of_shift * pass.shift;
        let kept = design.zip(filter.kept());
        pass.kept = kept.map(|(design, gains)| {
            let sums = pass.sums.clone();
            Arc::new(Kept { gains, design, sums, wider })
        });
        Ok(pass)
    }

    /// Without columns; with those of another pass close by, and its gains, it shows the slope as well.
    pub fn near(case: &Prepared<'_>, noise: &Noise, start: &Start, kept: Option<&Arc<Kept>>) -> Self {
        kept.and_then(|kept| Self::with_gains(case, noise, start, kept))
            .unwrap_or_else(|| Self::of_start(case, noise, start, usize::MAX))
    }

    /// With the gains of another one; `None` where other readings are due than there.
    fn with_gains(case: &Prepared<'_>, noise: &Noise, start: &Start, kept: &Arc<Kept>) -> Option<Self> {
        let (states, parameters) = kept.sums.of_start.shape();
        let mut slope = DVector::zeros(states + parameters);
        let mut changes = kept.design.chunks_exact(states + parameters);
        let told = &mut |innovation: &crate::Innovation| {
            let normalised = innovation.normalised();
            let changes = changes.next().unwrap_or_default();
            slope.iter_mut().zip(changes).for_each(|(slope, d)| *slope -= normalised * f64::from(*d));
        };
        let (likelihood, begun) = innovations_from(case, noise, start, &kept.gains, told)?;
        let shift = begun + &kept.gains.known * slope.rows(0, states);
        let slope = slope.rows(states, parameters) + &kept.wider.of_slope * &shift;
        let shift = &kept.wider.of_shift * shift;
        Some(Self { likelihood, shift, slope, sums: kept.sums.clone(), kept: Some(Arc::clone(kept)) })
    }

    /// Of a filter that has columns of its start, which it gives away with the changes of its innovations, if it kept them. With P the covariance
    /// with which it began, g and G slope and information of the columns of the start and C what these have in common with those of the parameters,
    ///
    /// ```text
    /// shift = P g        own = P - P G P        d start/d parameters = -P C
    /// ```
    fn behind(filter: &mut Filter<'_>, likelihood: Likelihood) -> (Self, Option<Vec<f32>>) {
        let (known, unseen_axis) = (&filter.known, filter.gains.unseen_at_start);
        let states = known.nrows();
        let said = filter.columns.take().map(|columns| columns.blocks.said()).unwrap_or_default();
        let parameters = said.slope.len().saturating_sub(states);
        let block = |at, shape| said.information.view(at, shape);
        let (shift, own) = if likelihood.lost {
            // It says nothing of its start.
            (DVector::zeros(states), known.clone())
        } else {
            let own = known - known * block((0, 0), (states, states)) * known;
            (&filter.begun + known * said.slope.rows(0, states), own)
        };
        let of_start = -(known * block((0, states), (states, parameters)));
        let information = block((states, states), (parameters, parameters)).into_owned();
        let slope = said.slope.rows(states, parameters).into_owned();
        let sums = Sums { information, of_start, own, unseen_axis };
        (Self { likelihood, shift, slope, sums, kept: None }, said.design)
    }
}

impl Sums {
    /// A covariance of the start without what of its attitude is of no consequence.
    pub fn seen(&self, covariance: &DMatrix<f64>) -> DMatrix<f64> {
        let Some(axis) = &self.unseen_axis else { return covariance.clone() };
        let mut lanes = Lanes::of(covariance);
        lanes.level_covariance(axis);
        lanes.matrix(covariance.nrows(), covariance.ncols())
    }

    /// As if the filter had begun with what was known before the run, `wide`, and not with what the run made of it, `narrow`, which
    /// holds the start where parameters would move it; and what that does to how the start moves and to the slope (METHOD.md, "Fits").
    fn widen(&mut self, narrow: &DMatrix<f64>, wide: &DMatrix<f64>) -> Wider {
        let (size, parameters) = self.of_start.shape();
        let known = KnownBefore::new(wide);
        let n = known.back.nrows();
        let twice = known.units(narrow).try_inverse().map(|inverse| inverse - DMatrix::identity(n, n));
        let freed = twice.and_then(|twice| {
            let free = (DMatrix::identity(n, n) - known.units(&self.own) * &twice).lu().solve(&known.back)?;
            Some((twice, free))
        });
        let Some((twice, free)) = freed else {
            let of_slope = DMatrix::zeros(parameters, size);
            return Wider { of_shift: DMatrix::identity(size, size), of_slope };
        };
        let of_slope = (&known.back * &self.of_start).transpose() * twice * &free;
        let of_shift = &known.basis * free;
        self.information -= &of_slope * &self.of_start;
        self.of_start = &of_shift * &self.of_start;
        Wider { of_shift, of_slope }
    }
}

/// Share of a variance below which a direction counts as certain: rounding of a covariance.
const CERTAIN: f64 = 1e-14;

/// A covariance with this share of the information that a run adds to what was known before: `own` is what both say together.
/// Directions of which nothing was uncertain stay certain.
pub(crate) fn narrowed(before: &DMatrix<f64>, own: &DMatrix<f64>, share: f64) -> DMatrix<f64> {
    let known = KnownBefore::new(before);
    // own = B M B^T with M <= 1.
    let said = known.units(own).symmetric_eigen();
    let kept = said.eigenvalues.map(|mu| 1.0 / (1.0 + share * (1.0 / mu.clamp(CERTAIN, 1.0) - 1.0)));
    let turned = known.basis * said.eigenvectors;
    &turned * DMatrix::from_diagonal(&kept) * turned.transpose()
}

/// Coordinates in which what was known before a run is a unit matrix: before = B B^T, without directions of which nothing was
/// uncertain.
pub(crate) struct KnownBefore {
    /// B: uncertain directions by columns.
    pub basis: DMatrix<f64>,
    /// The change of each of those coordinates with the layout's.
    pub back: DMatrix<f64>,
}

impl KnownBefore {
    pub fn new(before: &DMatrix<f64>) -> Self {
        let n = before.nrows();
        let scale = before.diagonal().map(|p| p.max(0.0).sqrt());
        let unit = |i: usize| if scale[i] > 0.0 { 1.0 / scale[i] } else { 0.0 };
        let shape = DMatrix::from_fn(n, n, |i, j| before[(i, j)] * unit(i) * unit(j)).symmetric_eigen();
        let kept: Vec<usize> = (0..n).filter(|k| shape.eigenvalues[*k] > CERTAIN).collect();
        let root = |k: usize| shape.eigenvalues[kept[k]].sqrt();
        let basis =
            DMatrix::from_fn(n, kept.len(), |i, k| scale[i] * shape.eigenvectors[(i, kept[k])] * root(k));
        let back =
            DMatrix::from_fn(kept.len(), n, |k, i| unit(i) * shape.eigenvectors[(i, kept[k])] / root(k));
        Self { basis, back }
    }

    /// A covariance in these coordinates.
    pub fn units(&self, covariance: &DMatrix<f64>) -> DMatrix<f64> {
        &self.back * covariance * self.back.transpose()
    }
}

/// Each innovation of a recording, and how it changes with the parameters along which models were varied, per their units.
///
/// # Errors
/// A varied model that cannot be simulated.
pub fn sensitivities(
    case: &Prepared<'_>,
    noise: &Noise,
    start: &Start,
    varied: &[Varied],
    told: &mut dyn FnMut(&Innovation, &DVector<f64>),
) -> Result<(), PredictionError> {
    let columns = Columns::new(case, start.layout, false, varied, None)?;
    let mut filter = Filter::new(case, noise, start).varying(columns);
    let mut innovations = Vec::new();
    let mut latest = DVector::zeros(varied.len());
    while filter.step(&mut |innovation| innovations.push(*innovation)) {
        let Some(columns) = &filter.columns else { break };
        for (reading, innovation) in innovations.drain(..).enumerate() {
            columns.latest(reading, &mut latest);
            told(&innovation, &latest);
        }
    }
    Ok(())
}
