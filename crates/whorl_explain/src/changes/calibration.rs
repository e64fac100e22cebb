//! A calibration of sensors, as entries of the platform's parameter file.

use nalgebra::Vector3;
use whorl_calibration::{ImuCalibration, PerAxis, SensorCalibration};
use whorl_math::three_digits;
use whorl_params::Value;

use super::Change;

/// Entries for every quantity that was determined on all axes: bias, scale, misalignment, skew, noise of a sample, random
/// walk.
#[must_use]
pub fn of_calibration(found: &ImuCalibration) -> Vec<Change> {
    let mut all = Vec::new();
    of_sensor(&mut all, "gyro", ("rad_s", "rad/s"), &found.gyro, found.rate_hz);
    of_sensor(&mut all, "accelerometer", ("m_s2", "m/s^2"), &found.accelerometer, found.rate_hz);
    all
}

fn of_sensor(
    all: &mut Vec<Change>,
    name: &str,
    (suffix, unit): (&str, &str),
    sensor: &SensorCalibration,
    rate_hz: f64,
) {
    let mut add = |key: String, value: Value, comment: String| {
        all.push(Change { key: format!("model.sensors.{name}.{key}"), value, comment });
    };
    let errors: [(String, &PerAxis, &str); 4] = [
        (format!("bias_{suffix}"), &sensor.bias, unit),
        ("scale".to_owned(), &sensor.scale, "1"),
        ("misalignment_rad".to_owned(), &sensor.misalignment_rad, "rad"),
        ("skew_rad".to_owned(), &sensor.skew_rad, "rad"),
    ];
    for (key, found, unit) in errors {
        if found.determined() == [true; 3] {
            let stddev: Vec<String> = found.stddev.iter().map(|x| three_digits(*x)).collect();
            let comment = format!("[{unit}] calibrated, +- {}", stddev.join(", "));
            add(key, array(&found.value, &found.stddev), comment);
        }
    }
    let sample = &sensor.noise_stddev;
    if sample.min() > 0.0 {
        let comment = format!("[{unit}] per sample, calibrated at {rate_hz:.1} Hz");
        add(format!("noise_stddev_{suffix}"), array(sample, &(sample * 0.01)), comment);
    }
    let walk = sensor.noise.map(|n| n.filter(|n| n.walk_seen).map(|n| n.walk));
    if let [Some(x), Some(y), Some(z)] = walk {
        let walk = Vector3::new(x, y, z);
        let comment = format!("[{unit}/sqrt(s)] calibrated from the Allan deviation");
        add(format!("bias_walk_{suffix}_sqrt_s"), array(&walk, &(walk * 0.05)), comment);
    }
}

/// Digits down to a tenth of the standard deviation.
fn array(value: &Vector3<f64>, stddev: &Vector3<f64>) -> Value {
    let rounded = |i: usize| {
        let digits = (1.0 - stddev[i].max(1e-12).log10().floor()).clamp(0.0, 12.0) as usize;
        format!("{:.digits$}", value[i]).parse().unwrap_or(value[i])
    };
    Value::DoubleArray((0..3).map(rounded).collect())
}
