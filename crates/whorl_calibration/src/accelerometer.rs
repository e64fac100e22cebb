//! Six positions and more (Figures 4.5 and 4.7).
//!
//! In each position the sensor reads `y = (1 + s) T f + b` with a specific force of length g, whatever its direction. `T` is lower
//! triangular with ones on the diagonal: the x axis of the sensor is where its case says (that is the misalignment's affair),
//! y sees `T_yx` of x, z sees `T_zx` of x and `T_zy` of y. Positions on the six faces show bias and scale; `T` needs
//! oblique ones. Local gravity is a tenth unknown, with its range over the Earth as what is known of it, unless it is given:
//! it cannot be told from a scale error that all axes have.

use std::collections::BTreeSet;

use nalgebra::{Matrix3, SVector, Vector1, Vector3};
use whorl_dynamics::sensing::untangled;
use whorl_math::GRAVITY_M_S2;

use crate::fit::{fit, said};
use crate::still::Still;
use crate::{CalibrationSettings, SensorCalibration};
use whorl_recording::Finding;

/// Largest plausible values: bias [m/s^2], scale \[1\] and angles between the axes \[rad\].
const WIDEST: [f64; 3] = [2.0, 0.2, 0.1];
/// Gravity at sea level is 9.780 m/s^2 at the equator and 9.832 m/s^2 at the poles (WGS 84) [m/s^2].
const GRAVITY_STDDEV_M_S2: f64 = 0.02;
/// Bias, scale, angles, gravity.
type Unknowns = SVector<f64, 10>;
/// A position belongs to a face when gravity is within this of an axis, as a cosine.
const ON_FACE: f64 = 0.95;

pub(super) fn calibrate(
    still: &[Still],
    settings: &CalibrationSettings,
    findings: &mut Vec<Finding>,
) -> SensorCalibration {
    let mut sensor = SensorCalibration::default();
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
    let known = settings.gravity_m_s2;
    let of_gravity = if known.is_some() { 1e-9 } else { GRAVITY_STDDEV_M_S2 };
    let prior = Unknowns::from_fn(|i, _| WIDEST.get(i / 3).copied().unwrap_or(of_gravity));
    // The specific force by unknowns, and how much longer it is than gravity.
    let force = |s: &Still, p: &Unknowns| {
        let x = Vector3::from_fn(|i, _| (s.specific_force_m_s2[i] - p[i]) / (1.0 + p[3 + i]));
        untangled(&x, &Vector3::new(p[6], p[7], p[8]))
    };
    let excess = |s: &Still, p: &Unknowns| force(s, p).norm() - (known.unwrap_or(GRAVITY_M_S2) + p[9]);
    // Noise of the mean, and a floor for errors beyond these.
    let variance = |s: &Still, p: &Unknowns| {
        let force = force(s, p);
        s.specific_force_stddev_m_s2.component_mul(&(force / force.norm())).norm_squared() + 1e-8
    };
    let residual = |k: usize, p: &Unknowns, about: &Unknowns| {
        Vector1::new(still.get(k).map_or(0.0, |s| excess(s, p) / variance(s, about).sqrt()))
    };
    let Some(fitted) = fit(prior, (still.len(), still.len() as f64), residual) else { return };
    let squares = still.iter().map(|s| excess(s, &fitted.at).powi(2)).sum::<f64>();
    let rms = (squares / still.len().max(1) as f64).sqrt();
    let what = format!("lengths that are {rms:.2e} m/s^2 off, root mean square,");
    findings.extend(said("accelerometer", &fitted.misfit, &what));
    sensor.misfit = Some(fitted.misfit);
    let alone = Vector3::zeros();
    (sensor.bias, sensor.scale) = (fitted.three(0, &alone), fitted.three(3, &alone));
    sensor.skew_rad = fitted.three(6, &alone);
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
    let faces: BTreeSet<String> = rows.iter().map(|(up, _)| format!("{up:?}")).collect();
    let distinct = faces.len();
    if distinct < 3 {
        findings.push(Finding::warning(format!(
            "Accelerometer misalignment not determined: the case lay on {distinct} of its faces, at least three are needed."
        )));
        return;
    }
    // seen - u = -m x u = u x m: three linear equations each; those across u count.
    let across = |up: &Vector3<f64>, difference: &Vector3<f64>| difference - up * up.dot(difference);
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (up, difference) in &rows {
        normal += whorl_math::skew(up).tr_mul(&whorl_math::skew(up));
        right += whorl_math::skew(up).tr_mul(&across(up, difference));
    }
    let Some(inverse) = normal.try_inverse() else { return };
    let m = inverse * right;
    sensor.misalignment_rad.value = m;
    // Where the faces lay less level than stated, their scatter about the fit counts: two angles each, three unknowns.
    let rest = rows.iter().map(|(up, difference)| (across(up, difference) - up.cross(&m)).norm_squared());
    let freedom = (2 * rows.len()).saturating_sub(3).max(1) as f64;
    let level_rad = (rest.sum::<f64>() / freedom).sqrt().max(settings.level_stddev_rad);
    sensor.misalignment_rad.stddev = inverse.diagonal().map(|v| v.sqrt() * level_rad);
}
