//! Six positions and more (Figures 4.5 and 4.7).
//!
//! In each position the sensor reads `y = (1 + s) T f + b` with a specific force of length g, whatever its direction. `T` is lower
//! triangular with ones on the diagonal: the x axis of the sensor is where its case says (that is the misalignment's affair),
//! y sees `T_yx` of x, z sees `T_zx` of x and `T_zy` of y. Positions on the six faces show bias and scale; `T` needs
//! oblique ones. Local gravity is a tenth unknown, with its range over the Earth as what is known of it, unless it is given:
//! it cannot be told from a scale error that all axes have.

use nalgebra::{SVector, Vector1, Vector3};
use whorl_math::{GRAVITY_M_S2, unit_or};
use whorl_recording::Finding;

use crate::fit::fit;
use crate::still::Still;
use crate::{CalibrationSettings, SensorCalibration, straightened};

/// Largest plausible values: bias [m/s^2], scale \[1\] and angles between the axes \[rad\].
const WIDEST: [f64; 3] = [2.0, 0.2, 0.1];
/// Gravity at sea level is 9.780 m/s^2 at the equator and 9.832 m/s^2 at the poles (WGS 84) [m/s^2].
const GRAVITY_STDDEV_M_S2: f64 = 0.02;
/// A position belongs to a face when gravity is within this of an axis, as a cosine.
const ON_FACE: f64 = 0.95;
/// Every misalignment is small against this \[rad\].
const ANY_RAD: f64 = 10.0;

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
    faces(still, settings, &mut sensor);
    let advice = "lay it with each of these axes up once and down once";
    findings.extend(sensor.bias.missing("Accelerometer bias", advice));
    findings.extend(sensor.scale.missing("Accelerometer scale", advice));
    let advice = "lay its case on three of its faces";
    findings.extend(sensor.misalignment_rad.missing("Accelerometer misalignment", advice));
    sensor
}

/// Bias, scale and the angles between the axes from |T^-1 ((y - b) / (1 + s))| = g, each position once; level or not does not matter.
fn lengths(
    still: &[Still],
    settings: &CalibrationSettings,
    sensor: &mut SensorCalibration,
    findings: &mut Vec<Finding>,
) {
    /// Bias, scale, angles, gravity.
    type Unknowns = SVector<f64, 10>;
    let known = settings.gravity_m_s2;
    let of_gravity = if known.is_some() { 1e-9 } else { GRAVITY_STDDEV_M_S2 };
    let prior = Unknowns::from_fn(|i, _| WIDEST.get(i / 3).copied().unwrap_or(of_gravity));
    let three = |p: &Unknowns, first: usize| p.fixed_rows::<3>(first).into_owned();
    let force = |s: &Still, p: &Unknowns| {
        straightened(&(s.specific_force_m_s2 - three(p, 0)), &three(p, 3), &three(p, 6))
    };
    // How much longer it is than gravity.
    let excess = |s: &Still, p: &Unknowns| force(s, p).norm() - (known.unwrap_or(GRAVITY_M_S2) + p[9]);
    // Noise of the mean, and a floor for errors beyond these.
    let variance = |s: &Still, p: &Unknowns| {
        let along = unit_or(force(s, p), Vector3::z_axis());
        s.specific_force_stddev_m_s2.component_mul(&*along).norm_squared() + 1e-8
    };
    let residual =
        |s: &Still, p: &Unknowns, about: &Unknowns| Vector1::new(excess(s, p) / variance(s, about).sqrt());
    let Some(fitted) = fit(prior, still, still.len() as f64, residual) else { return };
    findings.extend(fitted.misfit.finding("accelerometer", "lengths of gravity that are off by"));
    sensor.misfit = Some(fitted.misfit);
    (sensor.bias, sensor.scale, sensor.skew_rad) = (fitted.three(0), fitted.three(3), fitted.three(6));
}

/// Misalignment from the faces that the case lay on: y / g = R(m)^T u, u the axis that points up, so that y / g - u = u x m across u. Where
/// the faces lay less level than stated, their scatter about the fit counts.
fn faces(still: &[Still], settings: &CalibrationSettings, sensor: &mut SensorCalibration) {
    let on_face = |s: &Still| {
        let seen = unit_or(sensor.corrected(&s.specific_force_m_s2), Vector3::z_axis()).into_inner();
        let up = Vector3::ith(seen.iamax(), seen[seen.iamax()].signum());
        (up.dot(&seen) > ON_FACE).then(|| (up, seen - up * up.dot(&seen)))
    };
    let rows: Vec<(Vector3<f64>, Vector3<f64>)> = still.iter().filter_map(on_face).collect();
    let residual = |(up, across): &(Vector3<f64>, Vector3<f64>), m: &Vector3<f64>, _: &Vector3<f64>| {
        (across - up.cross(m)) / settings.level_stddev_rad
    };
    // Of the three numbers of a direction two are free.
    if let Some(fitted) = fit(Vector3::repeat(ANY_RAD), &rows, 2.0 * rows.len() as f64, residual) {
        sensor.misalignment_rad = fitted.three(0);
    }
}
