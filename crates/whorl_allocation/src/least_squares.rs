//! The fallback: bounded least squares by cyclic coordinate descent.
//!
//! minimise 1/2 |sum a_k v_k + o - t|^2 + w c'v, 0 <= v <= 1, with a gas price w so small that it
//! only decides between equals. Each step minimises exactly over one v_k and clips; for a convex
//! quadratic over a box this converges (Tseng, J. Optim. Theory Appl. 109, 2001). It needs no
//! factorisation, cannot fail, and every intermediate value is admissible.

use crate::problem::Problem;

const GAS_PRICE: f64 = 1e-6;
const SWEEPS: usize = 500;
const STEP_TOLERANCE: f64 = 1e-11;

/// Scaled values, each in 0..=1.
pub(crate) fn solve(problem: &Problem) -> Vec<f64> {
    let mut v: Vec<f64> = (0..problem.len()).map(|k| problem.rest(k)).collect();
    let mut error = problem.torque_of(&v) - problem.torque;
    for _ in 0..SWEEPS {
        let mut largest = 0.0_f64;
        for (k, a) in problem.columns.iter().enumerate() {
            let square = a.norm_squared();
            if !problem.free[k] || square < 1e-24 {
                continue;
            }
            let price = if k < problem.jets { GAS_PRICE * problem.linear[k] } else { 0.0 };
            let next = (v[k] - (a.dot(&error) + price) / square).clamp(0.0, 1.0);
            let step = next - v[k];
            v[k] = next;
            error += a * step;
            largest = largest.max(step.abs() * square.sqrt());
        }
        if largest < STEP_TOLERANCE {
            break;
        }
    }
    v
}
