//! Products of the filter's small square matrices.
//!
//! They have the same dozen of rows from interval to interval and are mostly zero or unity, which a library's
//! general product makes no use of.

/// A square matrix with room for `S` states, what is not used being zero; the compiler unrolls its rows.
pub(super) type Square<const S: usize> = [[f64; S]; S];

/// `a b`, of `a` the columns of each row that are not zero, and what stands there.
#[inline(always)]
fn sparse_product<'a, const S: usize>(
    a: impl Iterator<Item = (&'a [usize], &'a [f64])>,
    b: &Square<S>,
) -> Square<S> {
    let mut product = [[0.0; S]; S];
    for (slot, (columns, row)) in product.iter_mut().zip(a) {
        for (m, x) in columns.iter().zip(row) {
            slot.iter_mut().zip(&b[*m]).for_each(|(s, y)| *s += x * y);
        }
    }
    product
}

#[inline(always)]
fn transposed<const S: usize>(a: &Square<S>) -> Square<S> {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

/// `f p f^T` for a symmetric `p`, `f` by its rows.
#[inline(always)]
pub(super) fn congruence<'a, const S: usize, R: Iterator<Item = (&'a [usize], &'a [f64])>>(
    f: impl Fn() -> R,
    p: &Square<S>,
) -> Square<S> {
    // (F P)^T = P F^T.
    sparse_product(f(), &transposed(&sparse_product(f(), p)))
}

/// Takes the rounding error off a symmetric matrix.
#[inline(always)]
pub(super) fn symmetrise<const S: usize>(p: &mut Square<S>) {
    let mirrored = transposed(p);
    for (row, other) in p.iter_mut().zip(&mirrored) {
        row.iter_mut().zip(other).for_each(|(x, y)| *x = 0.5 * (*x + y));
    }
}
