//! Six positions and more (Figures 4.5 and 4.7).
//!
//! In each position the sensor reads `y = (1 + s) T f + b` with a specific force of length g, whatever its direction. `T` is lower
//! triangular with ones on the diagonal: the x axis of the sensor is where its case says (that is the misalignment's affair),
//! y sees `T_yx` of x, z sees `T_zx` of x and `T_zy` of y. Positions on the six faces show bias and scale; `T` needs
//! oblique ones. Local gravity is a tenth unknown, with its range over the Earth as what is known of it, unless it is given:
//! it cannot be told from a scale error that all axes have.

use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, SVector, Vector3};
use whorl_dynamics::sensing::untangled;
use whorl_math::GRAVITY_M_S2;

use crate::misfit::{Misfit, said};
use crate::still::Still;
use crate::{CalibrationSettings, SensorCalibration};
use whorl_recording::Finding;

/// Largest plausible values: bias [m/s^2], scale \[1\] and angles between the axes \[rad\].
const WIDEST: [f64; 3] = [2.0, 0.2, 0.1];
/// Gravity at sea level is 9.780 m/s^2 at the equator and 9.832 m/s^2 at the poles (WGS 84) [m/s^2].
const GRAVITY_STDDEV_M_S2: f64 = 0.02;
/// Bias, scale, angles, gravity.
const UNKNOWNS: usize = 10;
/// An uncertainty above this share of the widest is "not determined".
const DETERMINED: f64 = 0.2;
/// A position belongs to a face when gravity is within this of an axis, as a cosine.
const ON_FACE: f64 = 0.95;

pub(super) fn calibrate(
    still: &[Still],
    settings: &CalibrationSettings,
    findings: &mut Vec<Finding>,
) -> SensorCalibration {
    let mut sensor = SensorCalibration::empty();
    if still.is_empty() {
        return sensor;
    }
    lengths(still, settings, &mut sensor, findings);
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

/// What a reading says of the specific force, in axes at right angles.
pub(super) fn corrected(reading: &Vector3<f64>, sensor: &SensorCalibration) -> Vector3<f64> {
    let scaled = (reading - sensor.bias.value).component_div(&sensor.scale.value.add_scalar(1.0));
    untangled(&scaled, &sensor.skew_rad.value)
}

/// Bias, scale and the angles between the axes from |T^-1 ((y - b) / (1 + s))| = g, each position once; level or not does not matter.
fn lengths(
    still: &[Still],
    settings: &CalibrationSettings,
    sensor: &mut SensorCalibration,
    findings: &mut Vec<Finding>,
) {
    type V = SVector<f64, UNKNOWNS>;
    let mut p = V::zeros();
    let known = settings.gravity_m_s2;
    let gravity = |p: &V| known.unwrap_or(GRAVITY_M_S2) + p[9];
    let of_gravity = if known.is_some() { 1e-9 } else { GRAVITY_STDDEV_M_S2 };
    let prior = V::from_fn(|i, _| WIDEST.get(i / 3).copied().unwrap_or(of_gravity));
    let length = |p: &V, s: &Still| {
        let x = Vector3::from_fn(|i, _| (s.specific_force_m_s2[i] - p[i]) / (1.0 + p[3 + i]));
        untangled(&x, &Vector3::new(p[6], p[7], p[8]))
    };
    // Noise of the mean, and a floor for errors beyond these.
    let variance = |direction: &Vector3<f64>, s: &Still| {
        s.specific_force_stddev_m_s2.component_mul(direction).norm_squared() + 1e-8
    };
    let of_prior = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::from_diagonal(&prior.map(|s| s.powi(-2)));
    let mut information = of_prior;
    for _ in 0..20 {
        information = of_prior;
        let mut right = -information * p;
        for s in still {
            let f = length(&p, s);
            let direction = f / f.norm();
            let mut row = V::from_fn(|i, _| {
                let mut moved = p;
                moved[i] += STEP;
                (length(&moved, s).norm() - f.norm()) / STEP
            });
            row[9] = -1.0;
            let variance = variance(&direction, s);
            information += row * row.transpose() / variance;
            right += row * ((gravity(&p) - f.norm()) / variance);
        }
        let Some(factor) = information.cholesky() else { return };
        let step = factor.solve(&right);
        p += step;
        if step.amax() < 1e-12 {
            break;
        }
    }
    let Some(factor) = information.cholesky() else { return };
    let mut covariance = factor.inverse();
    // How many unknowns the data determine: the rest is the prior's.
    let used = (covariance * (information - of_prior)).trace();
    let squares = still.iter().map(|s| {
        let f = length(&p, s);
        (gravity(&p) - f.norm()).powi(2) / variance(&(f / f.norm()), s)
    });
    let misfit = Misfit { chi_squared: squares.sum(), dof: still.len() as f64 - used };
    covariance *= misfit.inflation();
    let residuals = still.iter().map(|s| (gravity(&p) - length(&p, s).norm()).powi(2));
    let rms = (residuals.sum::<f64>() / still.len().max(1) as f64).sqrt();
    findings.extend(said(
        "accelerometer",
        &misfit,
        &format!("lengths that are {rms:.2e} m/s^2 off, root mean square,"),
    ));
    sensor.misfit = Some(misfit);
    for axis in 0..3 {
        for (at, slot) in
            [(axis, &mut sensor.bias), (3 + axis, &mut sensor.scale), (6 + axis, &mut sensor.skew_rad)]
        {
            let stddev = covariance[(at, at)].sqrt();
            let known = stddev < DETERMINED * WIDEST.get(at / 3).copied().unwrap_or_default();
            slot.value[axis] = if known { p[at] } else { 0.0 };
            slot.stddev[axis] = if known { stddev } else { f64::INFINITY };
        }
    }
    let clear = |axis: usize| sensor.skew_rad.value[axis].abs() > 5.0 * sensor.skew_rad.stddev[axis];
    let seen = [(0, "y sees", "x"), (1, "z sees", "x"), (2, "z sees", "y")]
        .into_iter()
        .filter(|(axis, ..)| clear(*axis));
    let seen: Vec<String> = seen
        .map(|(axis, who, whom)| format!("{who} {:.2} % of {whom}", 100.0 * sensor.skew_rad.value[axis]))
        .collect();
    if !seen.is_empty() {
        findings.push(Finding::warning(format!(
            "The accelerometer's axes are not at right angles: {}. That is `skew_rad` of the platform's file; bias, scale and \
             misalignment are free of it.",
            seen.join(", ")
        )));
    }
}

/// Step of numerical derivatives.
const STEP: f64 = 1e-6;

/// Misalignment from the faces that the case lay on: y / g = R(m)^T u, u the axis that points up.
fn faces(
    still: &[Still],
    settings: &CalibrationSettings,
    sensor: &mut SensorCalibration,
    findings: &mut Vec<Finding>,
) {
    let mut rows = Vec::new();
    for s in still {
        let x = corrected(&s.specific_force_m_s2, sensor);
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
    let normal = Matrix3::from_fn(|i, j| normal[(i, j)]);
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
