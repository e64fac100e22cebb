//! The unique solution when the free effectors are linearly independent.
//!
//! With at most three independent columns a_k, sum a_k v_k + o = alpha t has at most one solution
//! for each alpha, linear in it: v = p + alpha r. The largest alpha in 0..=1 that keeps every v_k in
//! 0..=1 is the smallest of the ratios. Three wheels, the usual case, take this path and need no
//! program.

use nalgebra::{Matrix3, Vector3};

use crate::allocation::FallbackReason;
use crate::problem::Problem;

/// Smallest sine, or volume of unit columns, that counts as independent.
const INDEPENDENT: f64 = 1e-6;
/// Residual below which a vector counts as lying in the span.
const IN_SPAN: f64 = 1e-9;

pub(crate) enum ClosedForm {
    /// Scaled values and alpha.
    Solution(Vec<f64>, f64),
    /// No alpha in 0..=1 fits.
    Unattainable(FallbackReason),
    /// More than three free effectors, or dependent ones: a program is needed.
    NotUnique,
}

pub(crate) fn solve(problem: &Problem) -> ClosedForm {
    let mut index = [0; 3];
    let mut count = 0;
    for k in (0..problem.len()).filter(|&k| problem.free[k]) {
        if count == 3 {
            return ClosedForm::NotUnique;
        }
        index[count] = k;
        count += 1;
    }
    let index = &index[..count];
    let Some(left_inverse) = left_inverse(problem, index) else {
        return ClosedForm::NotUnique;
    };
    let span_error = |rows: Vector3<f64>, target: Vector3<f64>| {
        let sum = index.iter().zip(rows.iter()).fold(-target, |sum, (&k, &x)| sum + problem.columns[k] * x);
        sum.norm()
    };

    let constant = left_inverse * -problem.offset;
    let slope = left_inverse * problem.torque;
    let torque_norm = problem.torque.norm();
    if span_error(constant, -problem.offset) > IN_SPAN {
        return ClosedForm::Unattainable(FallbackReason::BoundsExcludeDemand);
    }
    if span_error(slope, problem.torque) > IN_SPAN * torque_norm {
        return ClosedForm::Unattainable(if count == 0 {
            FallbackReason::NoEffector
        } else {
            FallbackReason::DirectionUnattainable
        });
    }

    let (mut least, mut most) = (0.0_f64, 1.0_f64);
    for (&p, &r) in constant.iter().zip(slope.iter()).take(count) {
        // 0 <= p + alpha r <= 1, with a little room for rounding.
        let (low, high) = (-1e-12 - p, 1.0 + 1e-12 - p);
        if r.abs() <= 1e-15 * (1.0 + torque_norm) {
            if low > 0.0 || high < 0.0 {
                return ClosedForm::Unattainable(FallbackReason::BoundsExcludeDemand);
            }
        } else {
            let (a, b) = (low / r, high / r);
            least = least.max(a.min(b));
            most = most.min(a.max(b));
        }
    }
    if least > most {
        return ClosedForm::Unattainable(FallbackReason::BoundsExcludeDemand);
    }
    if most * torque_norm < 1e-9 && torque_norm > 1e-6 {
        return ClosedForm::Unattainable(FallbackReason::DirectionUnattainable);
    }
    let mut v = vec![0.0; problem.len()];
    for (row, &k) in index.iter().enumerate() {
        v[k] = (constant[row] + most * slope[row]).clamp(0.0, 1.0);
    }
    ClosedForm::Solution(v, most)
}

/// Rows that recover the coordinates of a vector in the span of the columns; `None` when they are
/// dependent. Rows beyond the number of columns are zero.
fn left_inverse(problem: &Problem, index: &[usize]) -> Option<Matrix3<f64>> {
    let column = |i: usize| problem.columns[index[i]];
    let mut inverse = Matrix3::zeros();
    match index.len() {
        0 => {}
        1 => {
            let a = column(0);
            if a.norm_squared() == 0.0 {
                return None;
            }
            inverse.set_row(0, &(a / a.norm_squared()).transpose());
        }
        2 => {
            let (a, b) = (column(0), column(1));
            let normal = a.cross(&b);
            let area = normal.norm_squared();
            if area <= (INDEPENDENT * a.norm() * b.norm()).powi(2) {
                return None;
            }
            inverse.set_row(0, &(b.cross(&normal) / area).transpose());
            inverse.set_row(1, &(normal.cross(&a) / area).transpose());
        }
        _ => {
            let (a, b, c) = (column(0), column(1), column(2));
            let volume = a.dot(&b.cross(&c));
            if volume.abs() <= INDEPENDENT * a.norm() * b.norm() * c.norm() {
                return None;
            }
            inverse.set_row(0, &(b.cross(&c) / volume).transpose());
            inverse.set_row(1, &(c.cross(&a) / volume).transpose());
            inverse.set_row(2, &(a.cross(&b) / volume).transpose());
        }
    }
    Some(inverse)
}
