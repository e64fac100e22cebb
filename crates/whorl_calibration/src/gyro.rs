//! Turns (Figures 4.6 and 4.8).

use nalgebra::{SVector, UnitQuaternion, Vector3};
use whorl_math::{integrate_rate, quaternion_exp, rotation_vector, unit_or};
use whorl_recording::Recording;

use crate::fit::{fit, said};
use crate::still::Still;
use crate::{CalibrationSettings, PerAxis, SensorCalibration};
use whorl_recording::Finding;

/// Widest scale error \[1\] and misalignment \[rad\] that are considered.
const WIDEST: f64 = 0.1;
/// Smaller turns count as none \[rad\].
const SMALLEST_TURN_RAD: f64 = 0.3;
/// Gravity moved by less than this during a turn: it was about the vertical \[rad\].
const ABOUT_VERTICAL_RAD: f64 = 0.1;

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

/// What is known of the last three: data sheets state one or two percent \[rad\].
const SKEW_RAD: f64 = 0.02;

/// What a rate without bias says of the true one.
fn truth(y: &Vector3<f64>, errors: &Errors) -> Vector3<f64> {
    let scaled = y.component_div(&Vector3::new(errors[0], errors[1], errors[2]).add_scalar(1.0));
    let straight =
        whorl_dynamics::sensing::untangled(&scaled, &Vector3::new(errors[6], errors[7], errors[8]));
    quaternion_exp(&Vector3::new(errors[3], errors[4], errors[5])) * straight
}

impl Turn<'_> {
    /// The rotation that the gyro measured, with scale (first three) and misalignment removed.
    fn rotation(&self, errors: &Errors) -> UnitQuaternion<f64> {
        let truth = |y: &Vector3<f64>| truth(&(y - self.bias), errors);
        let mut q = UnitQuaternion::identity();
        let samples = self.time_s.iter().zip(self.rate);
        for ((t0, w0), (t1, w1)) in samples.clone().zip(samples.skip(1)) {
            q = integrate_rate(&q, &(0.5 * (truth(w0) + truth(w1))), t1 - t0);
        }
        q
    }

    /// Residuals over their standard deviations: gravity (three), angle (one).
    fn residuals(&self, errors: &Errors, settings: &CalibrationSettings) -> SVector<f64, 4> {
        let q = self.rotation(errors);
        // A body that turned by q sees the vertical turned back.
        let gravity = (self.after - q.inverse_transform_vector(&self.before)) / self.direction_stddev_rad;
        let angle = self.angle_rad.map_or(0.0, |known| {
            let about = rotation_along(&q, &self.before, self.angle_of(errors));
            (known - about) / settings.turn_stddev_rad
        });
        SVector::<f64, 4>::new(gravity.x, gravity.y, gravity.z, angle)
    }

    /// Angle about the vertical before, whole turns counted.
    fn angle_of(&self, errors: &Errors) -> f64 {
        let samples = self.time_s.iter().zip(self.rate);
        samples
            .clone()
            .zip(samples.skip(1))
            .map(|((t0, w0), (t1, w1))| {
                let mean = 0.5 * (w0 + w1) - self.bias;
                truth(&mean, errors).dot(&self.before) * (t1 - t0)
            })
            .sum()
    }
}

/// The angle of `q` about `axis` nearest to `expected`.
fn rotation_along(q: &UnitQuaternion<f64>, axis: &Vector3<f64>, expected: f64) -> f64 {
    let angle = rotation_vector(q).dot(axis);
    angle + std::f64::consts::TAU * ((expected - angle) / std::f64::consts::TAU).round()
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
    bias(still, &mut sensor);
    let turns = turns(runs, still, accelerometer, settings);
    let prior = Errors::from_fn(|n, _| if n < 6 { WIDEST } else { SKEW_RAD });
    // Of the three numbers of a direction two are free, and one of a known angle.
    let free: f64 = turns.iter().map(|turn| if turn.angle_rad.is_some() { 3.0 } else { 2.0 }).sum();
    let residual = |k: usize, errors: &Errors, _: &Errors| {
        turns.get(k).map_or_else(SVector::zeros, |turn: &Turn<'_>| turn.residuals(errors, settings))
    };
    if let Some(fitted) = fit(prior, (turns.len(), free), residual) {
        if !turns.is_empty() {
            let what = "directions of gravity after the turns that are off by";
            findings.extend(said("gyro", &fitted.misfit, what));
            sensor.misfit = Some(fitted.misfit);
        }
        // Gravity in the body comes from the accelerometer; the gyro cannot show how that is turned in its case.
        let shared = accelerometer.misalignment_rad.stddev.map(|x| if x.is_finite() { x } else { 0.0 });
        let alone = Vector3::zeros();
        (sensor.scale, sensor.misalignment_rad) = (fitted.three(0, &alone), fitted.three(3, &shared));
        sensor.skew_rad = fitted.three(6, &alone);
    }
    let missing = |of: &PerAxis| -> Vec<&str> {
        let axes = ["x", "y", "z"].into_iter().zip(of.determined());
        axes.filter(|(_, is_known)| !is_known).map(|(axis, _)| axis).collect()
    };
    let (scale, misalignment) = (missing(&sensor.scale), missing(&sensor.misalignment_rad));
    if !scale.is_empty() {
        findings.push(Finding::warning(format!(
            "Gyro scale not determined about {}: turn the sensor from face to face about {}, or give the angle of turns about the vertical (--known-turn-deg).",
            scale.join(", "),
            if scale.len() == 1 { "that axis" } else { "those axes" }
        )));
    }
    if !misalignment.is_empty() {
        findings.push(Finding::warning(format!(
            "Gyro misalignment not determined about {}: turns about the other axes are needed.",
            misalignment.join(", ")
        )));
    }
    sensor
}

/// Weighted mean over the still stretches; their scatter counts where it is larger than their noise.
fn bias(still: &[Still], sensor: &mut SensorCalibration) {
    for axis in 0..3 {
        let of = |s: &Still| (s.gyro_rad_s[axis], (s.gyro_stddev_rad_s[axis].powi(2) + 1e-16).recip());
        let total: f64 = still.iter().map(|s| of(s).1).sum();
        let mean = still.iter().map(|s| of(s).0 * of(s).1).sum::<f64>() / total;
        let squares: f64 = still.iter().map(|s| of(s).1 * (of(s).0 - mean).powi(2)).sum();
        let scatter = squares / (still.len().max(2) - 1) as f64;
        sensor.bias.value[axis] = mean;
        sensor.bias.stddev[axis] = (scatter.max(1.0) / total).sqrt();
    }
}

fn turns<'a>(
    runs: &[&'a Recording],
    still: &[Still],
    accelerometer: &SensorCalibration,
    settings: &CalibrationSettings,
) -> Vec<Turn<'a>> {
    let direction = |s: &Still| {
        let x = super::accelerometer::corrected(&s.specific_force_m_s2, accelerometer);
        let m = quaternion_exp(&accelerometer.misalignment_rad.value);
        unit_or(m * x, Vector3::z_axis()).into_inner()
    };
    let mut turns = Vec::new();
    for (a, b) in still.iter().zip(still.iter().skip(1)) {
        let Some(run) = runs.get(a.run).filter(|_| a.run == b.run) else { continue };
        let series = &run.gyro_b_rad_s;
        let first = series.time_s.partition_point(|t| *t < a.to_s);
        let last = series.time_s.partition_point(|t| *t <= b.from_s);
        let (Some(time_s), Some(rate)) = (series.time_s.get(first..last), series.value.get(first..last))
        else {
            continue;
        };
        let noise = 0.5 * (a.specific_force_stddev_m_s2.norm() + b.specific_force_stddev_m_s2.norm()) / 9.81;
        let mut turn = Turn {
            time_s,
            rate,
            bias: 0.5 * (a.gyro_rad_s + b.gyro_rad_s),
            before: direction(a),
            after: direction(b),
            // The remaining error of the accelerometer's calibration.
            direction_stddev_rad: noise.hypot(1e-3),
            angle_rad: None,
        };
        let total = turn.angle_of(&Errors::zeros());
        let vertical = turn.before.angle(&turn.after) < ABOUT_VERTICAL_RAD;
        if turn.rotation(&Errors::zeros()).angle() < SMALLEST_TURN_RAD && total.abs() < SMALLEST_TURN_RAD {
            continue;
        }
        if let Some(unit) = settings.known_turn_rad.filter(|u| vertical && *u > 0.0) {
            let known = (total / unit).round() * unit;
            turn.angle_rad = (known != 0.0 && (known - total).abs() < 0.15 * known.abs()).then_some(known);
        }
        turns.push(turn);
    }
    turns
}
