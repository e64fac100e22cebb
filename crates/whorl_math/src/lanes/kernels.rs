//! What is done to rows, compiled for each kind of processor and each width.

#![expect(clippy::needless_range_loop, reason = "rows and columns of the same matrix go by their index")]

use pulp::NullaryFnOnce;

use super::gain::{Gain, first_coupling};
use super::sparse::{Sparse, dot};

#[inline(always)]
fn add_scaled<const W: usize>(to: &mut [f64; W], x: f64, of: &[f64; W]) {
    for c in 0..W {
        to[c] += x * of[c];
    }
}

/// Adds a row's product with other rows.
#[inline(always)]
fn add_rows<const W: usize>(to: &mut [f64; W], row: &[(usize, f64)], of: &[[f64; W]]) {
    for (k, x) in row {
        add_scaled(to, *x, &of[*k]);
    }
}

/// F X of the rows that move, F one more than this.
#[inline(always)]
fn transitioned<const W: usize>(transition: &Sparse, x: &[[f64; W]], to: &mut [[f64; W]]) {
    for i in 0..transition.count() {
        let mut sum = x[i];
        add_rows(&mut sum, transition.row(i), x);
        to[i] = sum;
    }
}

/// See [`super::Lanes::carry`].
pub(super) struct Carry<'a, const W: usize> {
    pub data: &'a mut [f64],
    pub spare: &'a mut [f64],
    pub transition: &'a Sparse,
}

impl<const W: usize> NullaryFnOnce for Carry<'_, W> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (x, behind) = (self.data.as_chunks_mut::<W>().0, self.spare.as_chunks_mut::<W>().0);
        let moving = self.transition.count();
        transitioned(self.transition, x, behind);
        x[..moving].copy_from_slice(&behind[..moving]);
    }
}

/// See [`super::Lanes::multiply`].
pub(super) struct Multiply<'a, const W: usize> {
    pub data: &'a [f64],
    pub a: &'a Sparse,
    pub scale: f64,
    pub to: &'a mut [f64],
}

impl<const W: usize> NullaryFnOnce for Multiply<'_, W> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (x, to) = (self.data.as_chunks::<W>().0, self.to.as_chunks_mut::<W>().0);
        for i in 0..self.a.count() {
            let mut sum = [0.0; W];
            for (k, f) in self.a.row(i) {
                add_scaled(&mut sum, self.scale * f, &x[*k]);
            }
            to[i] = sum;
        }
    }
}

/// See [`super::Lanes::add`].
pub(super) struct Add<'a, const W: usize> {
    pub data: &'a mut [f64],
    pub other: &'a [f64],
}

impl<const W: usize> NullaryFnOnce for Add<'_, W> {
    type Output = f64;

    #[inline(always)]
    fn call(self) -> f64 {
        let rows = self.data.as_chunks_mut::<W>().0.iter_mut().zip(self.other.as_chunks::<W>().0);
        let mut most = [0.0; W];
        for (row, other) in rows {
            for i in 0..W {
                row[i] += other[i];
                let size = other[i].abs();
                // Unlike `max`, one instruction.
                most[i] = if size > most[i] { size } else { most[i] };
            }
        }
        most.into_iter().fold(0.0, f64::max)
    }
}

/// See [`super::Lanes::add_transposed`].
pub(super) struct AddTransposed<'a, const W: usize> {
    pub data: &'a [f64],
    pub size: usize,
    pub to: &'a mut [f64],
}

impl<const W: usize> NullaryFnOnce for AddTransposed<'_, W> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (x, to) = (self.data.as_chunks::<W>().0, self.to.as_chunks_mut::<W>().0);
        for i in 0..self.size {
            for k in 0..=i {
                let both = x[i][k] + x[k][i];
                (to[i][k], to[k][i]) = (both, both);
            }
        }
    }
}

/// See [`super::Lanes::grow`].
pub(super) struct Grow<'a, const W: usize> {
    pub data: &'a mut [f64],
    pub spare: &'a mut [f64],
    pub transition: &'a Sparse,
    pub noise: &'a [f64],
}

impl<const W: usize> NullaryFnOnce for Grow<'_, W> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (p, noise) = (self.data.as_chunks_mut::<W>().0, self.noise.as_chunks::<W>().0);
        let (behind, across) = self.spare.as_chunks_mut::<W>().0.split_at_mut(p.len());
        let (transition, moving) = (self.transition, self.transition.count());
        // F P, of what moves; what stays beside it is then as it should be.
        transitioned(transition, p, behind);
        for i in 0..moving {
            for k in 0..moving {
                across[k][i] = behind[i][k];
            }
        }
        // F (F P)^T.
        for i in 0..moving {
            let mut sum = across[i];
            add_rows(&mut sum, transition.row(i), across);
            p[i][..moving].copy_from_slice(&sum[..moving]);
            p[i][moving..].copy_from_slice(&behind[i][moving..]);
        }
        for i in moving..p.len() {
            for k in 0..moving {
                p[i][k] = p[k][i];
            }
        }
        // Rounding would add up.
        for i in 0..moving {
            for k in 0..i {
                let mean = 0.5 * (p[i][k] + p[k][i]);
                (p[i][k], p[k][i]) = (mean, mean);
            }
        }
        for i in 0..noise.len() {
            add_scaled(&mut p[i], 1.0, &noise[i]);
        }
    }
}

/// See [`super::Lanes::correct`].
pub(super) struct Correct<'a, const W: usize> {
    pub data: &'a mut [f64],
    pub spare: &'a mut [f64],
    pub readings: &'a Sparse,
    pub own: &'a [f64],
    pub gain: &'a mut Gain,
}

impl<const W: usize> NullaryFnOnce for Correct<'_, W> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        let (p, across) = (self.data.as_chunks_mut::<W>().0, self.spare.as_chunks_mut::<W>().0);
        let (gain, size) = (self.gain, p.len());
        let count = self.readings.count();
        gain.couplings.resize(count * count.saturating_sub(1) / 2, 0.0);
        gain.gains.resize(count * size, 0.0);
        for r in 0..count {
            // P h^T as the readings before have left P.
            let (by_state, mut a) = (self.readings.row(r), [0.0; W]);
            add_rows(&mut a, by_state, p);
            for q in 0..r {
                let coupling = dot(by_state, gain.of(q));
                gain.couplings[first_coupling(r) + q] = coupling;
                if coupling != 0.0 {
                    add_scaled(&mut a, -coupling, &across[q]);
                }
            }
            let variance = dot(by_state, &a) + self.own[r];
            if !(variance > 0.0 && variance.is_finite()) {
                return false;
            }
            let inverse = 1.0 / variance;
            for (gain, a) in gain.gains[r * size..(r + 1) * size].iter_mut().zip(&a) {
                *gain = a * inverse;
            }
            gain.variances.push(variance);
            across[r] = a;
        }
        for i in 0..size {
            let mut sum = p[i];
            for r in 0..count {
                add_scaled(&mut sum, -gain.gains[r * size + i], &across[r]);
            }
            p[i] = sum;
        }
        true
    }
}

/// See [`super::Lanes::take_in`].
pub(super) struct TakeIn<'a, const W: usize> {
    pub data: &'a mut [f64],
    pub readings: &'a Sparse,
    pub gain: &'a Gain,
    pub d: &'a mut [f64],
}

impl<const W: usize> NullaryFnOnce for TakeIn<'_, W> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (x, d) = (self.data.as_chunks_mut::<W>().0, self.d.as_chunks_mut::<W>().0);
        let count = self.readings.count();
        for r in 0..count {
            let mut sum = d[r];
            for (i, h) in self.readings.row(r) {
                add_scaled(&mut sum, -h, &x[*i]);
            }
            let couplings = self.gain.couplings(r);
            for q in 0..r {
                if couplings[q] != 0.0 {
                    add_scaled(&mut sum, -couplings[q], &d[q]);
                }
            }
            d[r] = sum;
        }
        let (size, gains) = (self.gain.size, &self.gain.gains);
        for i in 0..size {
            let mut sum = x[i];
            for r in 0..count {
                add_scaled(&mut sum, gains[r * size + i], &d[r]);
            }
            x[i] = sum;
        }
    }
}

/// What all readings say of the error of one of them.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Own {
    /// Its innovation; afterwards what all say of its own error, per variance of that.
    pub value: f64,
    /// The variance that this has with the levels of the filter.
    pub expected: f64,
}

/// See [`super::Lanes::take_out`].
pub(super) struct GoBack<'a, const W: usize> {
    pub data: &'a mut [f64],
    pub gradient: &'a mut [f64],
    pub readings: &'a Sparse,
    pub gain: &'a Gain,
    pub own: &'a mut [Own],
}

impl<const W: usize> NullaryFnOnce for GoBack<'_, W> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (n, gradient) = (self.data.as_chunks_mut::<W>().0, self.gradient);
        let size = n.len();
        for r in (0..self.own.len()).rev() {
            let (by_state, gain) = (self.readings.row(r), self.gain.of(r));
            let inverse = 1.0 / self.gain.variances[r];
            let mut u = [0.0; W];
            let (mut along, mut square) = (0.0, 0.0);
            for i in 0..size {
                add_scaled(&mut u, gain[i], &n[i]);
                along += gain[i] * gradient[i];
            }
            for i in 0..size {
                square += gain[i] * u[i];
            }
            let value = self.own[r].value * inverse - along;
            self.own[r] = Own { value, expected: inverse + square };
            for (i, h) in by_state {
                gradient[*i] += h * value;
                add_scaled(&mut n[*i], -h, &u);
            }
            for j in 0..size {
                for (i, h) in by_state {
                    n[j][*i] -= u[j] * h;
                }
            }
            for (i, h) in by_state {
                for (j, other) in by_state {
                    n[*i][*j] += h * other * (square + inverse);
                }
            }
        }
    }
}
