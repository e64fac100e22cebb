//! The unscented step: 2 n points of equal weight (S. J. Julier and J. K. Uhlmann, Proc. IEEE 92(3), 2004,
//! with kappa = 0).

use nalgebra::{Const, DMatrix, DVector, Dyn, OMatrix};
use whorl_math::covariance::correct;

use super::joint_model::{JointModel, Mean, Posterior, STATE, StateMatrix, StateVector};
use super::sample::AveragedSample;

/// From one sample to the next; `None` when that cannot be computed.
pub(super) fn step(
    model: &JointModel,
    before: &Posterior,
    last: &AveragedSample,
    point: &AveragedSample,
) -> Option<Posterior> {
    let dt_s = point.time_s - last.time_s;
    let points: Vec<Mean> = spread(&before.mean, &before.covariance)?
        .iter()
        .map(|p| model.carried(p, last, point))
        .collect::<Option<_>>()?;
    let centre = model.carried(&before.mean, last, point)?;
    let (mean, covariance) = gathered(&centre, &points);
    let mut covariance = model.with_process(&before.mean, &covariance, dt_s);

    let points = spread(&mean, &covariance)?;
    let readings: Vec<DVector<f64>> =
        points.iter().map(|p| model.readings(p, point)).collect::<Option<_>>()?;
    let (z, variance) = model.measured(point);
    let weight = 1.0 / (2.0 * STATE as f64);
    let expected = readings.iter().fold(DVector::zeros(z.len()), |sum, r| sum + r) * weight;
    let mut spread = DMatrix::from_diagonal(&variance);
    let mut cross = OMatrix::<f64, Const<STATE>, Dyn>::zeros(z.len());
    for (p, r) in points.iter().zip(&readings) {
        let difference = r - &expected;
        spread += &difference * difference.transpose() * weight;
        let change = mean.to(p);
        cross += change * difference.transpose() * weight;
    }
    let gain = &cross * spread.clone().cholesky()?.inverse();
    let step = &gain * (z - expected);
    correct(&mut covariance, &gain, &cross, &spread);
    Some(Posterior { mean: mean.moved(&step), covariance })
}

/// Points as far from the mean as the covariance says.
fn spread(mean: &Mean, covariance: &StateMatrix) -> Option<Vec<Mean>> {
    let root = covariance.cholesky()?.l() * (STATE as f64).sqrt();
    let columns = (0..STATE).map(|n| root.column(n).into_owned());
    Some(columns.flat_map(|c| [mean.moved(&c), mean.moved(&-c)]).collect())
}

/// Mean and covariance of points around a centre.
fn gathered(centre: &Mean, points: &[Mean]) -> (Mean, StateMatrix) {
    let weight = 1.0 / points.len().max(1) as f64;
    let changes: Vec<StateVector> = points.iter().map(|p| centre.to(p)).collect();
    let shift = changes.iter().sum::<StateVector>() * weight;
    let covariance =
        changes.iter().map(|c| (c - shift) * (c - shift).transpose()).sum::<StateMatrix>() * weight;
    (centre.moved(&shift), covariance)
}
