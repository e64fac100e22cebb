//! Errors of both sensors from still stretches and the turns between them.

use std::f64::consts::TAU;

use nalgebra::{SVector, UnitQuaternion, Vector1, Vector3, Vector4};
use whorl_dynamics::sensing::untangled;
use whorl_math::{GRAVITY_M_S2, integrate_rate, quaternion_exp, rotation_vector, unit_or};
use whorl_recording::{Finding, Still};

use crate::fit::{fit, three};
use crate::{CalibrationSettings, PerAxis, SensorCalibration};

/// Largest plausible values of an accelerometer: bias [m/s^2], scale \[1\] and angles between the axes \[rad\].
const WIDEST_OF_FORCE: [f64; 3] = [2.0, 0.2, 0.1];
/// Gravity at sea level is 9.780 m/s^2 at the equator and 9.832 m/s^2 at the poles (WGS 84) [m/s^2].
const GRAVITY_STDDEV_M_S2: f64 = 0.02;
/// A position belongs to a face when gravity is within this of an axis, as a cosine.
const ON_FACE: f64 = 0.95;
/// Every misalignment \[rad\] and every bias of a gyro [rad/s] is small against this.
const ANY: f64 = 100.0;
/// Largest scale error \[1\] and misalignment \[rad\] of a gyro, and what is known of what its axes see of each other: data sheets state one or two
/// percent \[rad\].
const WIDEST_OF_RATE: [f64; 3] = [0.1, 0.1, 0.02];
/// No mean of a gyro is known better than to that [rad/s].
const LEAST_BIAS_STDDEV_RAD_S: f64 = 1e-8;
/// Smaller turns count as none \[rad\].
const SMALLEST_TURN_RAD: f64 = 0.3;
/// Gravity moved by less than this during a turn: it was about the vertical \[rad\].
const ABOUT_VERTICAL_RAD: f64 = 0.1;
/// The remaining error of the accelerometer's calibration \[rad\].
const LEAST_DIRECTION_STDDEV_RAD: f64 = 1e-3;

/// A reading without bias free of scale errors and of what its axes see of each other.
fn straightened(reading: &Vector3<f64>, scale: &Vector3<f64>, skew_rad: &Vector3<f64>) -> Vector3<f64> {
    untangled(&reading.component_div(&scale.add_scalar(1.0)), skew_rad)
}

/// Where gravity points, by a calibrated accelerometer, in axes at right angles that may be turned in the body.
fn up(still: &Still<'_>, sensor: &SensorCalibration) -> Vector3<f64> {
    let unbiased = still.force.mean - sensor.bias.value;
    unit_or(straightened(&unbiased, &sensor.scale.value, &sensor.skew_rad.value), Vector3::z_axis())
        .into_inner()
}

/// Six positions and more (Figures 4.5 and 4.7).
/// In each position the sensor reads `y = (1 + s) T f + b` with a specific force of length g, whatever its direction: level or not does not matter. `T`
/// is lower triangular with ones on the diagonal: the x axis of the sensor is where its case says (that is the misalignment's affair),
/// y sees `T_yx` of x, z sees `T_zx` of x and `T_zy` of y. Positions on the six faces show bias and scale; `T` needs
/// oblique ones. Local gravity is a tenth unknown, with its range over the Earth as what is known of it, unless it is given:
/// it cannot be told from a scale error that all axes have. Misalignment is that of the faces that the case lay on: y / g = R(m)^T u, u the
/// axis that points up, so that y / g - u = u x m across u.
pub(super) fn accelerometer(
    still: &[Still<'_>],
    settings: &CalibrationSettings,
    findings: &mut Vec<Finding>,
) -> SensorCalibration {
    let mut sensor = SensorCalibration::default();
    let known = settings.gravity_m_s2;
    let of_gravity = if known.is_some() { 1e-9 } else { GRAVITY_STDDEV_M_S2 };
    let prior = SVector::<f64, 10>::from_fn(|i, _| *WIDEST_OF_FORCE.get(i / 3).unwrap_or(&of_gravity));
    let length = |s: &Still<'_>, p: &SVector<f64, 10>| {
        let force = straightened(&(s.force.mean - three(p, 0)), &three(p, 3), &three(p, 6));
        let along = unit_or(s.force.mean, Vector3::z_axis());
        // Noise of the mean, and a floor for errors beyond these.
        let stddev = (s.force.stddev.component_mul(&along).norm_squared() + 1e-8).sqrt();
        Vector1::new((force.norm() - known.unwrap_or(GRAVITY_M_S2) - p[9]) / stddev)
    };
    if let Some(fitted) = fit(prior, still, still.len() as f64, length) {
        findings.extend(fitted.misfit.finding("accelerometer", "lengths of gravity that are off by"));
        sensor.misfit = Some(fitted.misfit);
        (sensor.bias, sensor.scale, sensor.skew_rad) = (fitted.three(0), fitted.three(3), fitted.three(6));
    }
    let on_face = |s: &Still<'_>| {
        let seen = up(s, &sensor);
        let face = Vector3::ith(seen.iamax(), seen[seen.iamax()].signum());
        (face.dot(&seen) > ON_FACE).then(|| (face, seen - face * face.dot(&seen)))
    };
    let faces: Vec<(Vector3<f64>, Vector3<f64>)> = still.iter().filter_map(on_face).collect();
    let tilt = |(face, across): &(Vector3<f64>, Vector3<f64>), m: &Vector3<f64>| {
        (across - face.cross(m)) / settings.level_stddev_rad
    };
    // Of the three numbers of a direction two are free. Where the faces lay less level than stated, their scatter about the fit counts.
    let fitted = fit(Vector3::repeat(ANY), &faces, 2.0 * faces.len() as f64, tilt);
    sensor.misalignment_rad = fitted.map_or_else(PerAxis::default, |fitted| fitted.three(0));
    let once_each = "lay it with each of these axes up once and down once";
    findings.extend(sensor.bias.missing("Accelerometer bias", once_each));
    findings.extend(sensor.scale.missing("Accelerometer scale", once_each));
    let faces = "lay its case on three of its faces";
    findings.extend(sensor.misalignment_rad.missing("Accelerometer misalignment", faces));
    sensor
}

/// A turn between two still stretches.
struct Turn {
    /// Times from one sample to the next \[s\], and the mean rate in each, free of the bias of the still stretches around [rad/s].
    steps: Vec<(f64, Vector3<f64>)>,
    /// Where gravity points before and after, with the standard deviation of its direction \[rad\].
    before: Vector3<f64>,
    after: Vector3<f64>,
    direction_stddev_rad: f64,
    /// Known angle about the vertical \[rad\], if so.
    angle_rad: Option<f64>,
}

/// Scale, misalignment, and what y sees of x, z of x and z of y.
type Errors = SVector<f64, 9>;

impl Turn {
    fn between(
        (a, b): (&Still<'_>, &Still<'_>),
        accelerometer: &SensorCalibration,
        settings: &CalibrationSettings,
    ) -> Option<Self> {
        let (series, bias) = (&a.run.gyro_b_rad_s, 0.5 * (a.gyro.mean + b.gyro.mean));
        let first = series.time_s.partition_point(|t| *t < a.to_s);
        let last = series.time_s.partition_point(|t| *t <= b.from_s);
        let step = |k: usize| {
            let mean = 0.5 * (series.value[k - 1] + series.value[k]);
            (series.time_s[k] - series.time_s[k - 1], mean - bias)
        };
        let from_sensor = quaternion_exp(&accelerometer.misalignment_rad.value);
        let noise = 0.5 * (a.force.stddev.norm() + b.force.stddev.norm());
        let mut turn = Self {
            steps: (first + 1..last).map(step).collect(),
            before: from_sensor * up(a, accelerometer),
            after: from_sensor * up(b, accelerometer),
            direction_stddev_rad: (noise / GRAVITY_M_S2).hypot(LEAST_DIRECTION_STDDEV_RAD),
            angle_rad: None,
        };
        let (q, total) = turn.rotation(&Errors::zeros());
        let is_vertical = turn.before.angle(&turn.after) < ABOUT_VERTICAL_RAD;
        if let Some(unit) = settings.known_turn_rad.filter(|unit| is_vertical && *unit > 0.0) {
            let known = (total / unit).round() * unit;
            turn.angle_rad = (known != 0.0 && (known - total).abs() < 0.15 * known.abs()).then_some(known);
        }
        (q.angle().max(total.abs()) >= SMALLEST_TURN_RAD).then_some(turn)
    }

    /// The rotation that the gyro measured with these errors, and its angle about the vertical before, whole turns counted \[rad\].
    fn rotation(&self, errors: &Errors) -> (UnitQuaternion<f64>, f64) {
        let (scale, rotation, skew) = (three(errors, 0), quaternion_exp(&three(errors, 3)), three(errors, 6));
        let (mut q, mut angle_rad) = (UnitQuaternion::identity(), 0.0);
        for (step_s, rate) in &self.steps {
            let rate = rotation * straightened(rate, &scale, &skew);
            q = integrate_rate(&q, &rate, *step_s);
            angle_rad += rate.dot(&self.before) * step_s;
        }
        (q, angle_rad)
    }

    /// Residuals over their standard deviations: gravity (three), angle (one).
    fn residuals(&self, errors: &Errors, settings: &CalibrationSettings) -> Vector4<f64> {
        let (q, expected) = self.rotation(errors);
        // A body that turned by q sees the vertical turned back.
        let gravity = (self.after - q.inverse_transform_vector(&self.before)) / self.direction_stddev_rad;
        let angle = self.angle_rad.map_or(0.0, |known| {
            let about = rotation_vector(&q).dot(&self.before);
            let about = about + TAU * ((expected - about) / TAU).round();
            (known - about) / settings.turn_stddev_rad
        });
        gravity.push(angle)
    }
}

/// Turns (Figures 4.6 and 4.8).
pub(super) fn gyro(
    still: &[Still<'_>],
    accelerometer: &SensorCalibration,
    settings: &CalibrationSettings,
    findings: &mut Vec<Finding>,
) -> SensorCalibration {
    let mut sensor = SensorCalibration::default();
    // The scatter of still stretches counts where it is larger than their noise.
    let bias = |s: &Still<'_>, bias: &Vector3<f64>| {
        (s.gyro.mean - bias).component_div(&s.gyro.stddev.add_scalar(LEAST_BIAS_STDDEV_RAD_S))
    };
    let fitted = fit(Vector3::repeat(ANY), still, 3.0 * still.len() as f64, bias);
    sensor.bias = fitted.map_or_else(PerAxis::default, |fitted| fitted.three(0));
    let pairs = still.iter().zip(still.iter().skip(1)).filter(|(a, b)| std::ptr::eq(a.run, b.run));
    let turns: Vec<Turn> = pairs.filter_map(|pair| Turn::between(pair, accelerometer, settings)).collect();
    let prior = Errors::from_fn(|n, _| WIDEST_OF_RATE[n / 3]);
    // Of the three numbers of a direction two are free, and one of a known angle.
    let free: f64 = turns.iter().map(|turn| if turn.angle_rad.is_some() { 3.0 } else { 2.0 }).sum();
    let residual = |turn: &Turn, errors: &Errors| turn.residuals(errors, settings);
    if let Some(fitted) = fit(prior, &turns, free, residual).filter(|_| !turns.is_empty()) {
        let what = "directions of gravity after the turns that are off by";
        findings.extend(fitted.misfit.finding("gyro", what));
        sensor.misfit = Some(fitted.misfit);
        (sensor.scale, sensor.skew_rad) = (fitted.three(0), fitted.three(6));
        // Gravity in the body comes from the accelerometer; the gyro cannot show how that is turned in its case.
        let shared = accelerometer.misalignment_rad.stddev.map(|x| if x.is_finite() { x } else { 0.0 });
        sensor.misalignment_rad = fitted.three(3);
        sensor.misalignment_rad.stddev.zip_apply(&shared, |stddev, shared| *stddev = stddev.hypot(shared));
    }
    let advice = "turn the sensor from face to face about them, or give the angle of turns about the vertical (--known-turn-deg)";
    findings.extend(sensor.scale.missing("Gyro scale", advice));
    let others = "turns about the other axes are needed";
    findings.extend(sensor.misalignment_rad.missing("Gyro misalignment", others));
    sensor
}
