//! Covariance of an estimate: its growth over a step, and its reduction by a measurement.
//!
//! A measurement `z` of the state `x` has an innovation of covariance `S` that covaries with the state's error by `A`;
//! for `z = H x + v` with `v` of covariance `R`, `A = P H^T` and `S = H P H^T + R`. A correction `K z` leaves
//!
//! ```text
//! P - K A^T - A K^T + K S K^T
//! ```
//!
//! whatever the gain `K`. For such a `z` this is Joseph's form `(1 - K H) P (1 - K H)^T + K R K^T` multiplied out; it
//! also holds where `A` and `S` come from sigma points or where noise and state are correlated. The optimal gain is
//! `K = A S^-1`. Source: A. Gelb (editor), *Applied Optimal Estimation*, 1974, eqs. 4.2-12 to 4.2-18.
//!
//! This is the only implementation of the update; the whitening filter of the diagnosis, which takes in thousands of
//! scalars with the optimal gain, has its own loop over rows.

use nalgebra::allocator::Allocator;
use nalgebra::{DMatrix, DefaultAllocator, Dim, OMatrix, OVector, SMatrix, SVector};

/// `P <- F P F^T + Q`: transition `F` of the error over a step and covariance `Q` that the step adds.
pub fn propagate<const N: usize>(p: &mut SMatrix<f64, N, N>, f: &SMatrix<f64, N, N>, q: &SMatrix<f64, N, N>) {
    *p = f * *p * f.transpose() + q;
    symmetrise(p);
}

/// Covariance after a correction: `P <- P - K A^T - A K^T + K S K^T` for any gain, symmetric.
///
/// Evaluated as `P - K A^T - W K^T`: for the optimal gain `W = A - K S` vanishes but for the gain's rounding, whose
/// effect it takes out again.
pub fn correct<N: Dim, M: Dim>(
    p: &mut OMatrix<f64, N, N>,
    gain: &OMatrix<f64, N, M>,
    a: &OMatrix<f64, N, M>,
    s: &OMatrix<f64, M, M>,
) where
    DefaultAllocator: Allocator<N, N> + Allocator<N, M> + Allocator<M, N> + Allocator<M, M>,
{
    let mut w = a.clone_owned();
    w.gemm(-1.0, gain, s, 1.0);
    p.gemm(-1.0, gain, &a.transpose(), 1.0);
    p.gemm(-1.0, &w, &gain.transpose(), 1.0);
    symmetrise(p);
}

/// A scalar measurement with the optimal gain `A / s`, which is returned: `P <- P - A A^T / s`, to which the form for
/// any gain reduces.
pub fn correct_scalar<N: Dim>(p: &mut OMatrix<f64, N, N>, a: &OVector<f64, N>, s: f64) -> OVector<f64, N>
where
    DefaultAllocator: Allocator<N, N> + Allocator<N>,
{
    let gain = a / s;
    p.ger(-1.0, &gain, a, 1.0);
    gain
}

/// What a measurement changes.
#[derive(Debug, Clone, PartialEq)]
pub struct Update<const N: usize> {
    /// Correction of the state.
    pub correction: SVector<f64, N>,
    /// Normalised innovation squared, chi-squared distributed with as many degrees of freedom as `z` has independent
    /// components.
    pub nis: f64,
}

/// A measurement `z = H x + v`, `v` of covariance `R`, with the optimal gain. `None`, and nothing changed, if the
/// innovation's covariance is not positive definite or `accept` does not take the normalised innovation squared.
pub fn update<const N: usize, const M: usize>(
    p: &mut SMatrix<f64, N, N>,
    h: &SMatrix<f64, M, N>,
    r: &SMatrix<f64, M, M>,
    innovation: &SVector<f64, M>,
    accept: impl FnOnce(f64) -> bool,
) -> Option<Update<N>> {
    let a = *p * h.transpose();
    let s = h * a + r;
    let factor = s.cholesky()?;
    let nis = innovation.dot(&factor.solve(innovation));
    if !accept(nis) {
        return None;
    }
    let gain = factor.solve(&a.transpose()).transpose();
    correct(p, &gain, &a, &s);
    Some(Update { correction: gain * innovation, nis })
}

/// The mean of a matrix and its transpose: rounding must not make the two halves drift apart.
pub fn symmetrise<N: Dim>(p: &mut OMatrix<f64, N, N>)
where
    DefaultAllocator: Allocator<N, N>,
{
    for column in 1..p.ncols() {
        for row in 0..column {
            let mean = 0.5 * (p[(row, column)] + p[(column, row)]);
            p[(row, column)] = mean;
            p[(column, row)] = mean;
        }
    }
}

/// Share of a variance below which a direction counts as certain: rounding of a covariance.
const CERTAIN: f64 = 1e-14;

/// A covariance with this share of the information that data add to what was known before: `own` is what both say together.
/// Directions of which nothing was uncertain stay certain.
#[must_use]
pub fn narrowed(before: &DMatrix<f64>, own: &DMatrix<f64>, share: f64) -> DMatrix<f64> {
    let known = Whitened::by(before);
    // own = B M B^T with M <= 1.
    let said = known.units(own).symmetric_eigen();
    let kept = said.eigenvalues.map(|mu| 1.0 / (1.0 + share * (1.0 / mu.clamp(CERTAIN, 1.0) - 1.0)));
    let turned = known.basis * said.eigenvectors;
    &turned * DMatrix::from_diagonal(&kept) * turned.transpose()
}

/// Coordinates in which a covariance is a unit matrix, P = B B^T, without directions of which nothing is uncertain.
pub struct Whitened {
    /// B: uncertain directions by columns.
    pub basis: DMatrix<f64>,
    /// The change of each of those coordinates with the others.
    pub back: DMatrix<f64>,
}

impl Whitened {
    /// Of a covariance in any units.
    #[must_use]
    pub fn by(before: &DMatrix<f64>) -> Self {
        let n = before.nrows();
        let scale = before.diagonal().map(|p| p.max(0.0).sqrt());
        let unit = |i: usize| if scale[i] > 0.0 { 1.0 / scale[i] } else { 0.0 };
        let shape = DMatrix::from_fn(n, n, |i, j| before[(i, j)] * unit(i) * unit(j)).symmetric_eigen();
        let kept: Vec<usize> = (0..n).filter(|k| shape.eigenvalues[*k] > CERTAIN).collect();
        let root = |k: usize| shape.eigenvalues[kept[k]].sqrt();
        let along = |i: usize, k: usize| shape.eigenvectors[(i, kept[k])];
        let basis = DMatrix::from_fn(n, kept.len(), |i, k| scale[i] * along(i, k) * root(k));
        let back = DMatrix::from_fn(kept.len(), n, |k, i| unit(i) * along(i, k) / root(k));
        Self { basis, back }
    }

    /// Another covariance in these coordinates.
    #[must_use]
    pub fn units(&self, covariance: &DMatrix<f64>) -> DMatrix<f64> {
        &self.back * covariance * self.back.transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, Matrix2, Matrix6, SMatrix, Vector2, Vector6};

    type Sensitivity = SMatrix<f64, 2, 6>;

    fn prior() -> Matrix6<f64> {
        let seed = Matrix6::from_fn(|i, j| ((i * 7 + j * 3) as f64).sin());
        seed * seed.transpose() + Matrix6::identity() * 0.1
    }

    fn sensitivity() -> Sensitivity {
        Sensitivity::new(1.0, 0.0, -0.3, 0.01, 0.03, 0.0, 0.2, 1.0, 0.1, 0.0, -0.02, 0.05)
    }

    fn noise() -> Matrix2<f64> {
        Matrix2::new(0.02, 0.005, 0.005, 0.03)
    }

    /// The textbook's information form: P^-1 + H^T R^-1 H.
    #[test]
    fn update_adds_information() {
        let (mut p, h, r, z) = (prior(), sensitivity(), noise(), Vector2::new(0.1, -0.2));
        let inverse = r.try_inverse().unwrap();
        let expected = (prior().try_inverse().unwrap() + h.transpose() * inverse * h).try_inverse().unwrap();
        let update = update(&mut p, &h, &r, &z, |_| true).unwrap();
        assert!((p - expected).amax() < 1e-12);
        assert!((update.correction - expected * h.transpose() * inverse * z).norm() < 1e-12);
    }

    /// Joseph's form, of a gain that is far from optimal; fixed and dynamic sizes.
    #[test]
    fn any_gain_leaves_josephs_form() {
        let (h, r) = (sensitivity(), noise());
        let gain = SMatrix::<f64, 6, 2>::from_fn(|i, j| 0.1 * ((i + 5 * j) as f64).cos());
        let keep = Matrix6::identity() - gain * h;
        let expected = keep * prior() * keep.transpose() + gain * r * gain.transpose();
        let mut p = prior();
        let a = p * h.transpose();
        let s = h * a + r;
        correct(&mut p, &gain, &a, &s);
        assert!((p - expected).amax() < 1e-12);
        let dynamic = |m: &[f64], rows, columns| DMatrix::from_column_slice(rows, columns, m);
        let mut p = dynamic(prior().as_slice(), 6, 6);
        let (gain, a) = (dynamic(gain.as_slice(), 6, 2), dynamic(a.as_slice(), 6, 2));
        correct(&mut p, &gain, &a, &dynamic(s.as_slice(), 2, 2));
        assert!((p - dynamic(expected.as_slice(), 6, 6)).amax() < 1e-12);
    }

    /// Two independent scalars one after the other are the two together.
    #[test]
    fn scalars_in_turn_are_the_vector_at_once() {
        let (h, r) = (sensitivity(), Matrix2::from_diagonal(&Vector2::new(0.02, 0.03)));
        let (mut together, mut in_turn) = (prior(), prior());
        update(&mut together, &h, &r, &Vector2::zeros(), |_| true).unwrap();
        for row in 0..2 {
            let h = h.row(row).transpose();
            let a: Vector6<f64> = in_turn * h;
            correct_scalar(&mut in_turn, &a, h.dot(&a) + r[(row, row)]);
        }
        assert!((together - in_turn).amax() < 1e-12);
    }

    #[test]
    fn what_is_not_accepted_changes_nothing() {
        let mut p = prior();
        let z = Vector2::new(3.0, 0.0);
        assert_eq!(update(&mut p, &sensitivity(), &noise(), &z, |nis| nis < 1e-3), None);
        let indefinite = Matrix2::from_diagonal(&Vector2::new(-100.0, 1.0));
        assert_eq!(update(&mut p, &sensitivity(), &indefinite, &z, |_| true), None);
        assert_eq!(p, prior());
    }

    #[test]
    fn propagation_carries_the_error_and_adds_noise() {
        // x' = x + v dt, v' = v with white acceleration: by hand.
        let mut p = Matrix2::new(2.0, 0.5, 0.5, 1.0);
        propagate(&mut p, &Matrix2::new(1.0, 0.1, 0.0, 1.0), &Matrix2::new(0.0, 0.0, 0.0, 0.3));
        assert!((p - Matrix2::new(2.11, 0.6, 0.6, 1.3)).amax() < 1e-15);
    }
}
