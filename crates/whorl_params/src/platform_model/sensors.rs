//! Sensors and their errors. Only properties that every sensor has are required: a rate, a noise, the bias of a
//! turn-on. An error that is left out is zero.

use nalgebra::Vector3;
use whorl_dynamics::Freedom;
use whorl_dynamics::platform::{
    Accelerometer, RateGyro, ScalarSensor, SensorSuite, TriaxialErrors, VectorSensor, WheelSpeedSensor,
};

use crate::limits::{any, non_negative, positive, range};
use crate::reader::Reader;

/// 2000 deg/s and 16 g: the widest usual ranges, far beyond the motion of a platform.
const USUAL_GYRO_RANGE_RAD_S: f64 = 35.0;
const USUAL_ACCELEROMETER_RANGE_M_S2: f64 = 157.0;

/// Noise of a wheel's speed. Counting the 4096 edges a turn of a 1024-line encoder for 10 ms resolves 0.15 rad/s,
/// and the error of a count is a third of that. Zero noise would make every fit trust each reading exactly.
const USUAL_TACHOMETER_RAD_S: f64 = 0.05;

/// 20 degC.
pub(super) const ROOM_K: f64 = 293.15;

pub(super) fn read(r: &mut Reader<'_>, freedom: &Freedom) -> SensorSuite {
    r.group("sensors", |r| {
        let rate_hz = r.f64("rate_hz", rate(), "sample rate of gyro, accelerometer and wheel speed [Hz]");
        // A body that does not turn needs no gyro.
        let gyro = if freedom.turns() || r.has("gyro") {
            r.group("gyro", |r| RateGyro {
                axes: gyro_axes(r, freedom),
                errors: triaxial(r, "rad_s", "rad/s", USUAL_GYRO_RANGE_RAD_S),
            })
        } else {
            RateGyro { axes: [false; 3], errors: NO_ERRORS }
        };
        let accelerometer = if r.has("accelerometer") {
            r.group("accelerometer", |r| Accelerometer {
                fitted: true,
                errors: triaxial(r, "m_s2", "m/s^2", USUAL_ACCELEROMETER_RANGE_M_S2),
                lever_arm_b_m: r.vector3(
                    "lever_arm_m",
                    any(),
                    "position from the centre of rotation, body axes [m]",
                ),
            })
        } else {
            Accelerometer { fitted: false, errors: NO_ERRORS, lever_arm_b_m: Vector3::zeros() }
        };
        let sees_weight = accelerometer.fitted && freedom.has_weight();
        let vector = r.has("vector").then(|| r.group("vector", |r| vector(r, sees_weight)));
        let wheel_speed = r.group("wheel_speed", |r| {
            let ScalarSensor { noise_stddev, quantum } = scalar(r, "rad_s", "rad/s", USUAL_TACHOMETER_RAD_S);
            WheelSpeedSensor { noise_stddev_rad_s: noise_stddev, quantum_rad_s: quantum }
        });
        let bus_voltage = r.group("bus_voltage", |r| scalar(r, "v", "V", 0.0));
        let tank_pressure = r.group("tank_pressure", |r| scalar(r, "pa", "Pa", 0.0));
        let temperature = r.group("temperature", |r| scalar(r, "k", "K", 0.0));
        SensorSuite {
            rate_hz,
            gyro,
            accelerometer,
            vector,
            wheel_speed,
            bus_voltage,
            tank_pressure,
            temperature,
            ambient_temperature_k: r.f64_or(
                "ambient_temperature_k",
                ROOM_K,
                positive(),
                "temperature at the start of a run [K]",
            ),
            temperature_drift_k_s: r.f64_or(
                "temperature_drift_k_s",
                0.0,
                range(-1.0..=1.0),
                "drift of the temperature [K/s]",
            ),
        }
    })
}

/// Of a sensor that does not exist.
const NO_ERRORS: TriaxialErrors = TriaxialErrors {
    noise_stddev: Vector3::new(0.0, 0.0, 0.0),
    bias: Vector3::new(0.0, 0.0, 0.0),
    bias_turn_on_stddev: Vector3::new(0.0, 0.0, 0.0),
    bias_walk: Vector3::new(0.0, 0.0, 0.0),
    scale: Vector3::new(0.0, 0.0, 0.0),
    misalignment_rad: Vector3::new(0.0, 0.0, 0.0),
    skew_rad: Vector3::new(0.0, 0.0, 0.0),
    quantum: 0.0,
    range: f64::MAX,
    latency_s: 0.0,
    time_constant_s: 0.0,
    averaging_window_s: 0.0,
};

/// Which axes a gyro has: all, unless the file names them.
fn gyro_axes(r: &mut Reader<'_>, freedom: &Freedom) -> [bool; 3] {
    let names = ["x", "y", "z"];
    let doc = "body axes that it measures; a hinge needs one that sees its axis";
    let Some(given) = r.optional_string_array("axes", doc) else { return [true; 3] };
    let axes = names.map(|name| given.iter().any(|axis| axis == name));
    let count = axes.iter().filter(|axis| **axis).count();
    if count == 0 || count != given.len() {
        r.reject("axes", "allowed: a list of x, y, z, at least one and each at most once");
    } else if matches!(freedom, Freedom::Hinge { .. })
        && freedom.rate_from_gyro_b_rad_s(&Vector3::zeros(), axes).is_none()
    {
        r.reject(
            "axes",
            "none of them sees the turn about freedom.axis; allowed: an axis along it, among others",
        );
    }
    axes
}

fn rate() -> crate::Limits<f64> {
    range(1e-4..=1e5)
}

fn latency(r: &mut Reader<'_>) -> f64 {
    r.f64_or("latency_s", 0.0, range(0.0..=60.0), "age of the data when stamped [s]")
}

fn misalignment(r: &mut Reader<'_>) -> Vector3<f64> {
    r.per_axis_or(
        "misalignment_rad",
        0.0,
        range(-0.5..=0.5),
        "small rotation from body axes to the sensor's own axes [rad]",
    )
}

fn triaxial(r: &mut Reader<'_>, suffix: &str, unit: &str, usual_range: f64) -> TriaxialErrors {
    let errors = TriaxialErrors {
        noise_stddev: r.per_axis(
            &format!("noise_stddev_{suffix}"),
            non_negative(),
            &format!("white noise, standard deviation of one sample [{unit}]"),
        ),
        bias: r.per_axis_or(
            &format!("bias_{suffix}"),
            0.0,
            any(),
            &format!("constant part of the turn-on bias [{unit}]"),
        ),
        bias_turn_on_stddev: r.per_axis(
            &format!("bias_turn_on_stddev_{suffix}"),
            non_negative(),
            &format!("random part of the turn-on bias, standard deviation over runs [{unit}]"),
        ),
        bias_walk: r.per_axis_or(
            &format!("bias_walk_{suffix}_sqrt_s"),
            0.0,
            non_negative(),
            &format!("random walk of the bias [{unit}/sqrt(s)]"),
        ),
        scale: r.per_axis_or(
            "scale",
            0.0,
            range((std::ops::Bound::Excluded(-0.5), std::ops::Bound::Excluded(0.5))),
            "scale factor error [1]",
        ),
        misalignment_rad: misalignment(r),
        skew_rad: r.per_axis_or(
            "skew_rad",
            0.0,
            range(-0.5..=0.5),
            "axes that are not at right angles: what y sees of x, z of x, z of y [rad]",
        ),
        quantum: r.f64_or(
            &format!("quantum_{suffix}"),
            0.0,
            non_negative(),
            &format!("step of the digitised output, 0 = none [{unit}]"),
        ),
        range: r.f64_or(
            &format!("range_{suffix}"),
            usual_range,
            positive(),
            &format!("clips at +- this [{unit}]"),
        ),
        latency_s: latency(r),
        time_constant_s: r.f64_or(
            "time_constant_s",
            0.0,
            range(0.0..=1.0),
            "low-pass of the sensor: 1/(2 pi bandwidth) [s]",
        ),
        averaging_window_s: r.f64_or(
            "averaging_window_s",
            0.0,
            range(0.0..=1.0),
            "window over which a reading is the mean, its middle latency_s before the stamp: latency_s 0 is a stamp in the middle, half of the window one at the end [s]",
        ),
    };
    if errors.averaging_window_s > 0.0 && errors.time_constant_s > 0.0 {
        r.reject(
            "averaging_window_s",
            "stands beside a time_constant_s; allowed: one of the two, the other 0",
        );
    }
    errors
}

fn vector(r: &mut Reader<'_>, sees_weight: bool) -> VectorSensor {
    let reference_direction_world =
        r.direction("reference_direction", "direction the sensor sees, world axes (east, north, up)");
    // The accelerometer already measures the vertical: with a vertical reference yaw would not be observable.
    if sees_weight && reference_direction_world.xy().norm() < 0.1 {
        r.reject(
            "reference_direction",
            "is vertical, which leaves yaw unseen; allowed: at least 6 deg off the vertical",
        );
    }
    VectorSensor {
        reference_direction_world,
        noise_stddev_rad: r.f64(
            "noise_stddev_rad",
            range(0.0..=0.5),
            "white noise of one sample, across each of two axes [rad]",
        ),
        misalignment_rad: misalignment(r),
        rate_hz: r.f64("rate_hz", rate(), "sample rate [Hz]"),
        latency_s: latency(r),
    }
}

fn scalar(r: &mut Reader<'_>, suffix: &str, unit: &str, usual_noise: f64) -> ScalarSensor {
    ScalarSensor {
        noise_stddev: r.f64_or(
            &format!("noise_stddev_{suffix}"),
            usual_noise,
            non_negative(),
            &format!("white noise, standard deviation of one sample [{unit}]"),
        ),
        quantum: r.f64_or(
            &format!("quantum_{suffix}"),
            0.0,
            non_negative(),
            &format!("step of the digitised output, 0 = none [{unit}]"),
        ),
    }
}
