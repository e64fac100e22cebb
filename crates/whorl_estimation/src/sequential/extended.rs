//! The extended step, and the iterated one, which linearises again about what it found.

use nalgebra::{Const, DMatrix, Dyn, OMatrix};
use whorl_math::covariance::correct;

use super::joint_model::{JointModel, Posterior, STATE, StateMatrix, StateVector};
use super::sample::AveragedSample;

/// One row for each reading.
type Jacobian = OMatrix<f64, Dyn, Const<STATE>>;

/// Differences for derivatives.
const DIFFERENCE: f64 = 1e-6;

/// From one sample to the next; `None` when that cannot be computed.
pub(super) fn step(
    model: &JointModel,
    before: &Posterior,
    last: &AveragedSample,
    point: &AveragedSample,
    iterations: usize,
) -> Option<Posterior> {
    let dt_s = point.time_s - last.time_s;
    let carried = model.carried(&before.mean, last, point)?;
    let mut transition = StateMatrix::identity();
    for n in (0..6).chain(9..STATE) {
        let change = StateVector::ith(n, DIFFERENCE);
        let moved = model.carried(&before.mean.moved(&change), last, point)?;
        transition.set_column(n, &(carried.to(&moved) / DIFFERENCE));
    }
    let mut covariance =
        model.with_process(&before.mean, &(transition * before.covariance * transition.transpose()), dt_s);
    let (z, variance) = model.measured(point);
    let noise = DMatrix::from_diagonal(&variance);
    let mut mean = carried.clone();
    let mut last_linearisation = None;
    let mut jacobian = Jacobian::zeros(z.len());
    for _ in 0..iterations {
        let base = model.readings(&mean, point)?;
        for n in 0..STATE {
            let moved = model.readings(&mean.moved(&StateVector::ith(n, DIFFERENCE)), point)?;
            jacobian.set_column(n, &((moved - &base) / DIFFERENCE));
        }
        let cross = covariance * jacobian.transpose();
        let spread = &jacobian * &cross + &noise;
        let gain = &cross * spread.clone().cholesky()?.inverse();
        // The iterated filter's innovation counts from the predicted state.
        let back = mean.to(&carried);
        let step = &gain * (&z - &base - &jacobian * back);
        mean = carried.moved(&step);
        last_linearisation = Some((gain, cross, spread));
    }
    let (gain, cross, spread) = last_linearisation?;
    correct(&mut covariance, &gain, &cross, &spread);
    Some(Posterior { mean, covariance })
}
