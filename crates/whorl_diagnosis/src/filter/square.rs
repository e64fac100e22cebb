//! Products of the filter's small square matrices.
//!
//! They have the same dozen of rows from interval to interval and are mostly zero or unity, which a library's
//! general product makes no use of.

/// A square matrix with room for `S` states, what is not used being zero; the compiler unrolls its rows.
pub(super) type Square<const S: usize> = [[f64; S]; S];

/// `a b`, where `pattern` holds the columns of each row of `a` that are not zero.
fn sparse_product<const S: usize>(a: &[f64], pattern: &[Vec<usize>], b: &Square<S>) -> Square<S> {
    let mut product = [[0.0; S]; S];
    let rows = a.chunks_exact(pattern.len().max(1));
    for ((slot, row), columns) in product.iter_mut().zip(rows).zip(pattern) {
        for &m in columns {
            let x = row[m];
            slot.iter_mut().zip(&b[m]).for_each(|(s, y)| *s += x * y);
        }
    }
    product
}

fn transposed<const S: usize>(a: &Square<S>) -> Square<S> {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

/// `f p f^T` for a symmetric `p`.
pub(super) fn congruence<const S: usize>(f: &[f64], pattern: &[Vec<usize>], p: &Square<S>) -> Square<S> {
    // (F P)^T = P F^T.
    sparse_product(f, pattern, &transposed(&sparse_product(f, pattern, p)))
}

/// Takes the rounding error off a symmetric matrix.
pub(super) fn symmetrise<const S: usize>(p: &mut Square<S>) {
    let mirrored = transposed(p);
    for (row, other) in p.iter_mut().zip(&mirrored) {
        row.iter_mut().zip(other).for_each(|(x, y)| *x = 0.5 * (*x + y));
    }
}
