//! What was known of a start before a run, and what the run adds.

use nalgebra::DMatrix;

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
