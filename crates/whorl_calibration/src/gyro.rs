//! Turns (Figures 4.6 and 4.8).

use std::f64::consts::TAU;

use nalgebra::{SVector, UnitQuaternion, Vector3, Vector4};
use whorl_math::{GRAVITY_M_S2, integrate_rate, quaternion_exp, rotation_vector, unit_or};
use whorl_recording::{Finding, Recording};

use crate::fit::fit;
use crate::still::Still;
use crate::{CalibrationSettings, PerAxis, SensorCalibration, straightened};

/// Widest scale error \[1\] and misalignment \[rad\] that are considered.
const WIDEST: f64 = 0.1;
/// What is known of what the axes see of each other: data sheets state one or two percent \[rad\].
const SKEW_RAD: f64 = 0.02;
/// Every bias is small against this, and no mean is known better than to that [rad/s].
const ANY_BIAS_RAD_S: f64 = 100.0;
const LEAST_BIAS_STDDEV_RAD_S: f64 = 1e-8;
/// Smaller turns count as none \[rad\].
const SMALLEST_TURN_RAD: f64 = 0.3;
/// Gravity moved by less than this during a turn: it was about the vertical \[rad\].
const ABOUT_VERTICAL_RAD: f64 = 0.1;
/// The remaining error of the accelerometer's calibration \[rad\].
const LEAST_DIRECTION_STDDEV_RAD: f64 = 1e-3;

/// A turn between two still stretches: the gyro's samples, gravity before and after.
struct Turn<'a> {
    time_s: &'a [f64],
    rate: &'a [Vector3<f64>],
    /// Gyro bias about, from the still stretches around.
    bias: Vector3<f64>,
    before: Vector3<f64>,
    after: Vector3<f64>,
    /// Standard deviation of the direction of gravity \[rad\].
    direction_stddev_rad: f64,
    /// Known angle about the vertical \[rad\], if so.
    angle_rad: Option<f64>,
}

/// Scale, misalignment, and what y sees of x, z of x and z of y.
type Errors = SVector<f64, 9>;

impl Turn<'_> {
    /// The rotation that the gyro measured with these errors, and its angle about the vertical before, whole turns counted \[rad\].
    fn rotation(&self, errors: &Errors) -> (UnitQuaternion<f64>, f64) {
        let three = |first: usize| errors.fixed_rows::<3>(first).into_owned();
        let (scale, from_sensor, skew) = (three(0), quaternion_exp(&three(3)), three(6));
        let (mut q, mut angle_rad) = (UnitQuaternion::identity(), 0.0);
        let samples = self.time_s.iter().zip(self.rate);
        for ((t0, w0), (t1, w1)) in samples.clone().zip(samples.skip(1)) {
            let rate = from_sensor * straightened(&(0.5 * (w0 + w1) - self.bias), &scale, &skew);
            q = integrate_rate(&q, &rate, t1 - t0);
            angle_rad += rate.dot(&self.before) * (t1 - t0);
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

pub(super) fn calibrate(
    runs: &[&Recording],
    still: &[Still],
    accelerometer: &SensorCalibration,
    settings: &CalibrationSettings,
    findings: &mut Vec<Finding>,
) -> SensorCalibration {
    let mut sensor = SensorCalibration::default();
    if still.is_empty() {
        return sensor;
    }
    // The scatter of still stretches counts where it is larger than their noise.
    let bias = |s: &Still, bias: &Vector3<f64>, _: &Vector3<f64>| {
        (s.gyro_rad_s - bias).component_div(&s.gyro_stddev_rad_s.add_scalar(LEAST_BIAS_STDDEV_RAD_S))
    };
    let fitted = fit(Vector3::repeat(ANY_BIAS_RAD_S), still, 3.0 * still.len() as f64, bias);
    sensor.bias = fitted.map_or_else(PerAxis::default, |fitted| fitted.three(0));
    let turns = turns(runs, still, accelerometer, settings);
    let prior = Errors::from_fn(|n, _| if n < 6 { WIDEST } else { SKEW_RAD });
    // Of the three numbers of a direction two are free, and one of a known angle.
    let free: f64 = turns.iter().map(|turn| if turn.angle_rad.is_some() { 3.0 } else { 2.0 }).sum();
    let residual = |turn: &Turn<'_>, errors: &Errors, _: &Errors| turn.residuals(errors, settings);
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
    findings.extend(
        sensor.misalignment_rad.missing("Gyro misalignment", "turns about the other axes are needed"),
    );
    sensor
}

fn turns<'a>(
    runs: &[&'a Recording],
    still: &[Still],
    accelerometer: &SensorCalibration,
    settings: &CalibrationSettings,
) -> Vec<Turn<'a>> {
    let from_sensor = quaternion_exp(&accelerometer.misalignment_rad.value);
    let direction = |s: &Still| {
        unit_or(from_sensor * accelerometer.corrected(&s.specific_force_m_s2), Vector3::z_axis()).into_inner()
    };
    let mut turns = Vec::new();
    for (a, b) in still.iter().zip(still.iter().skip(1)) {
        let Some(run) = runs.get(a.run).filter(|_| a.run == b.run) else { continue };
        let series = &run.gyro_b_rad_s;
        let first = series.time_s.partition_point(|t| *t < a.to_s);
        let within = first..series.time_s.partition_point(|t| *t <= b.from_s).max(first);
        let noise = 0.5 * (a.specific_force_stddev_m_s2.norm() + b.specific_force_stddev_m_s2.norm());
        let mut turn = Turn {
            time_s: &series.time_s[within.clone()],
            rate: &series.value[within],
            bias: 0.5 * (a.gyro_rad_s + b.gyro_rad_s),
            before: direction(a),
            after: direction(b),
            direction_stddev_rad: (noise / GRAVITY_M_S2).hypot(LEAST_DIRECTION_STDDEV_RAD),
            angle_rad: None,
        };
        let (q, total) = turn.rotation(&Errors::zeros());
        if q.angle() < SMALLEST_TURN_RAD && total.abs() < SMALLEST_TURN_RAD {
            continue;
        }
        let is_vertical = turn.before.angle(&turn.after) < ABOUT_VERTICAL_RAD;
        if let Some(unit) = settings.known_turn_rad.filter(|unit| is_vertical && *unit > 0.0) {
            let known = (total / unit).round() * unit;
            turn.angle_rad = (known != 0.0 && (known - total).abs() < 0.15 * known.abs()).then_some(known);
        }
        turns.push(turn);
    }
    turns
}
