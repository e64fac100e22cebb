//! The classical fourth-order Runge-Kutta step.

use nalgebra::SVector;

/// From `state` at `t_s` over `dt_s` in equal steps of at most `step_s`.
pub(crate) fn integrate<const N: usize>(
    mut state: SVector<f64, N>,
    dt_s: f64,
    step_s: f64,
    derivative: impl Fn(&SVector<f64, N>) -> SVector<f64, N>,
) -> SVector<f64, N> {
    let steps = (dt_s.abs() / step_s).ceil().max(1.0);
    let h = dt_s / steps;
    for _ in 0..steps as u64 {
        let k1 = derivative(&state);
        let k2 = derivative(&(state + k1 * (0.5 * h)));
        let k3 = derivative(&(state + k2 * (0.5 * h)));
        let k4 = derivative(&(state + k3 * h));
        state += (k1 + (k2 + k3) * 2.0 + k4) * (h / 6.0);
    }
    state
}
