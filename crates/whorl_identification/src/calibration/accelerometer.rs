//! Six positions (Figures 4.5 and 4.7).

use nalgebra::{DMatrix, DVector, SMatrix, SVector, Vector3};
use whorl_math::GRAVITY_M_S2;

use super::still::Still;
use super::{CalibrationSettings, SensorCalibration};
use crate::data::Finding;

/// Largest plausible values: bias [m/s^2] and scale \[1\].
const WIDEST: [f64; 2] = [2.0, 0.2];
/// An uncertainty above this share of the widest is "not determined".
const DETERMINED: f64 = 0.2;
/// A position belongs to a face when gravity is within this of an axis, as a cosine.
const ON_FACE: f64 = 0.95;

pub(super) fn calibrate(
    still: &[Still],
    settings: &CalibrationSettings,
    findings: &mut Vec<Finding>,
) -> SensorCalibration {
    let mut sensor = super::gyro::empty();
    if still.is_empty() {
        return sensor;
    }
    lengths(still, &mut sensor);
    faces(still, settings, &mut sensor, findings);
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let (bias, scale) = (sensor.bias.stddev[axis].is_finite(), sensor.scale.stddev[axis].is_finite());
        if !(bias && scale) {
            let seen = |sign: f64| still.iter().any(|s| sign * s.specific_force_m_s2[axis] > 5.0);
            let missing = match (seen(1.0), seen(-1.0)) {
                (true, false) => format!("the position with {name} down"),
                (false, true) => format!("the position with {name} up"),
                _ => format!("positions with {name} up and down"),
            };
            let what = match (bias, scale) {
                (false, false) => "bias and scale",
                (false, true) => "bias",
                _ => "scale",
            };
            findings.push(Finding::warning(format!(
                "Accelerometer {name}: {what} not determined; {missing} is missing."
            )));
        }
    }
    sensor
}

/// Bias and scale from |(y - b) / (1 + s)| = g, each position once; level or not does not matter.
fn lengths(still: &[Still], sensor: &mut SensorCalibration) {
    type V6 = SVector<f64, 6>;
    let mut p = V6::zeros();
    let prior = V6::from_fn(|i, _| WIDEST[i / 3]);
    let mut information = SMatrix::<f64, 6, 6>::zeros();
    for _ in 0..20 {
        information = SMatrix::from_diagonal(&prior.map(|s| s.powi(-2)));
        let mut right = -information * p;
        for s in still {
            let x = Vector3::from_fn(|i, _| (s.specific_force_m_s2[i] - p[i]) / (1.0 + p[3 + i]));
            let length = x.norm();
            let row = V6::from_fn(|i, _| {
                let axis = i % 3;
                let by = -x[axis] / length / (1.0 + p[3 + axis]);
                if i < 3 { by } else { by * x[axis] }
            });
            let direction = x / length;
            // Noise of the mean, and a floor for errors beyond scale and bias.
            let variance = s.specific_force_stddev_m_s2.component_mul(&direction).norm_squared() + 1e-8;
            information += row * row.transpose() / variance;
            right += row * ((GRAVITY_M_S2 - length) / variance);
        }
        let Some(factor) = information.cholesky() else { return };
        let step = factor.solve(&right);
        p += step;
        if step.amax() < 1e-12 {
            break;
        }
    }
    let Some(factor) = information.cholesky() else { return };
    let covariance = factor.inverse();
    for axis in 0..3 {
        for (at, slot) in [(axis, &mut sensor.bias), (3 + axis, &mut sensor.scale)] {
            let stddev = covariance[(at, at)].sqrt();
            let known = stddev < DETERMINED * WIDEST[at / 3];
            slot.value[axis] = if known { p[at] } else { 0.0 };
            slot.stddev[axis] = if known { stddev } else { f64::INFINITY };
        }
    }
}

/// Misalignment from the faces that the case lay on: y / g = R(m)^T u, u the axis that points up.
fn faces(
    still: &[Still],
    settings: &CalibrationSettings,
    sensor: &mut SensorCalibration,
    findings: &mut Vec<Finding>,
) {
    let mut rows = Vec::new();
    for s in still {
        let x =
            (s.specific_force_m_s2 - sensor.bias.value).component_div(&sensor.scale.value.add_scalar(1.0));
        let seen = x / x.norm();
        let axis = seen.iamax();
        if seen[axis].abs() > ON_FACE {
            let up = Vector3::ith(axis, seen[axis].signum());
            rows.push((up, seen - up));
        }
    }
    let distinct = {
        let mut all: Vec<String> = rows.iter().map(|(u, _)| format!("{u:?}")).collect();
        all.sort();
        all.dedup();
        all.len()
    };
    if distinct < 3 {
        findings.push(Finding::warning(format!(
            "Accelerometer misalignment not determined: the case lay on {distinct} of its faces, at least three are needed."
        )));
        return;
    }
    // seen - u = -m x u = u x m: three linear equations each; those across u count.
    let mut matrix = DMatrix::zeros(3 * rows.len(), 3);
    let mut right = DVector::zeros(3 * rows.len());
    for (n, (up, difference)) in rows.iter().enumerate() {
        matrix.fixed_view_mut::<3, 3>(3 * n, 0).copy_from(&whorl_math::skew(up));
        right.fixed_rows_mut::<3>(3 * n).copy_from(&(difference - up * up.dot(difference)));
    }
    let normal = matrix.tr_mul(&matrix);
    let normal = nalgebra::Matrix3::from_fn(|i, j| normal[(i, j)]);
    let Some(inverse) = normal.try_inverse() else { return };
    let product = matrix.tr_mul(&right);
    let m = inverse * Vector3::new(product[0], product[1], product[2]);
    sensor.misalignment_rad.value = m;
    // Where the faces lay less level than stated, their scatter about the fit counts: two angles each, three unknowns.
    let rest = &right - &matrix * m;
    let freedom = (2 * rows.len()).saturating_sub(3).max(1) as f64;
    let level_rad = (rest.norm_squared() / freedom).sqrt().max(settings.level_stddev_rad);
    sensor.misalignment_rad.stddev = inverse.diagonal().map(|v| v.sqrt() * level_rad);
}
