//! The sensors of the platform's file: axes, noise, biases, windows.

use nalgebra::Vector3;

use super::Parts;
use crate::new_rig::lines::{Lines, Origin, list, number};
use crate::new_rig::measure::{Measured, Noise};

/// Turn-on biases of MEMS sensors: 0.5 deg/s, 10 mg [rad/s, m/s^2].
const GYRO_BIAS_RAD_S: f64 = 0.01;
const FORCE_BIAS_M_S2: f64 = 0.1;
/// Noise of a sample of such a gyro: 0.1 deg/s [rad/s].
const GYRO_NOISE_RAD_S: f64 = 0.002;
/// The rate of an encoder has none: a small number that no fit divides by [rad/s].
const ENCODER_BIAS_RAD_S: f64 = 1e-6;

pub(super) fn sensors(lines: &mut Lines, parts: &Parts, seen: &Measured) {
    lines.open(3, "sensors:");
    if let Some(rate_hz) = seen.rate_hz {
        let words = "one over the usual time between samples";
        lines.add(4, format!("rate_hz: {}", number(rate_hz)), Origin::Measured, words);
    }
    if parts.gyro_axes != [false; 3] {
        lines.open(4, "gyro:");
        axes(lines, parts.gyro_axes);
        if let Some(noise) = &seen.gyro {
            let bias = if parts.is_angle { ENCODER_BIAS_RAD_S } else { GYRO_BIAS_RAD_S };
            triaxial(lines, noise, seen.rest_s, parts.gyro_axes, ("rad_s", "rad/s"), bias);
        }
        if let Some(rate_hz) = seen.rate_hz.filter(|_| parts.is_angle) {
            let words = "the time over which a rate is the mean: from one angle to the next";
            lines.add(5, format!("averaging_window_s: {}", number(1.0 / rate_hz)), Origin::Measured, words);
            let words = "half of it, as a rate is stamped at its end";
            lines.add(5, format!("latency_s: {}", number(0.5 / rate_hz)), Origin::Measured, words);
        }
    }
    if parts.gyro_axes == [false; 3] {
        let words = "no gyro was recorded; this stands for one";
        lines.open(4, "gyro:");
        lines.add(5, format!("noise_stddev_rad_s: {}", number(GYRO_NOISE_RAD_S)), Origin::Assumed, words);
        lines.add(
            5,
            format!("bias_turn_on_stddev_rad_s: {}", number(GYRO_BIAS_RAD_S)),
            Origin::Assumed,
            words,
        );
    }
    if let Some(noise) = seen.force.as_ref().filter(|_| parts.force_axes != [false; 3]) {
        lines.open(4, "accelerometer:");
        axes(lines, parts.force_axes);
        triaxial(lines, noise, seen.rest_s, parts.force_axes, ("m_s2", "m/s^2"), FORCE_BIAS_M_S2);
        let words = "from the centre of rotation; measure it with a ruler";
        lines.add(5, "lever_arm_m: [0.0, 0.0, 0.0]", Origin::Assumed, words);
    }
    vector(lines, parts, seen);
    if let Some((noise, _)) = seen.wheels.filter(|(noise, _)| parts.tachometer && *noise > 0.0) {
        let text = format!("wheel_speed: {{noise_stddev_rad_s: {}}}", number(noise));
        lines.add(4, text, Origin::Measured, "from differences of neighbouring samples");
    }
}

/// Says which axes a sensor has, where it lacks some.
fn axes(lines: &mut Lines, there: [bool; 3]) {
    if there != [true; 3] {
        let names = ["x", "y", "z"].into_iter().zip(there).filter(|(_, there)| *there);
        let names: Vec<&str> = names.map(|(name, _)| name).collect();
        lines.add(5, format!("axes: [{}]", names.join(", ")), Origin::Stated, "those that were recorded");
    }
}

fn triaxial(
    lines: &mut Lines,
    noise: &Noise,
    rest_s: f64,
    axes: [bool; 3],
    (suffix, unit): (&str, &str),
    usual_bias: f64,
) {
    // A sensor that never scatters would be trusted without bound: what its digits hide is at least a third of a step.
    let least = noise.quantum.unwrap_or_default() / 3.0;
    let there =
        |v: &Vector3<f64>| (0..3).filter(|k| axes.get(*k) == Some(&true)).map(|k| v[k]).fold(0.0, f64::max);
    let largest = there(&noise.stddev).max(least);
    let stddev = noise.stddev.map(|x| if x > 0.0 { x.max(least) } else { largest });
    let text = if axes == [true; 3] { list(stddev.as_slice()) } else { number(largest) };
    let words = match noise.mean_at_rest {
        Some(_) => format!("from {} s of rest", number(rest_s)),
        None => "from differences of neighbouring samples, as nothing rests for a second".to_owned(),
    };
    if largest > 0.0 {
        lines.add(5, format!("noise_stddev_{suffix}: {text}"), Origin::Measured, words);
    } else {
        let text = format!("noise_stddev_{suffix}: {}", number(0.1 * usual_bias));
        lines.add(5, text, Origin::Assumed, "the readings do not scatter at all; see its data sheet");
    }
    let (bias, words) = match noise.mean_at_rest.filter(|_| suffix == "rad_s") {
        Some(mean) => {
            let most = there(&mean.abs());
            let read = format!(
                "one run cannot say how it scatters from run to run; here {} {unit} at rest",
                list(mean.as_slice())
            );
            (usual_bias.max(most), read)
        }
        None => (usual_bias, "as of usual MEMS sensors; see its data sheet".to_owned()),
    };
    lines.add(5, format!("bias_turn_on_stddev_{suffix}: {}", number(bias)), Origin::Assumed, words);
    if let Some(step) = noise.quantum {
        let words = "all readings are multiples of it";
        lines.add(5, format!("quantum_{suffix}: {}", number(step)), Origin::Measured, words);
    }
    if let Some((end, count)) = noise.end.filter(|_| suffix == "rad_s") {
        let words = format!("{count} readings stand there");
        lines.add(5, format!("range_{suffix}: {}", number(end)), Origin::Measured, words);
    }
}

fn vector(lines: &mut Lines, parts: &Parts, seen: &Measured) {
    let Some(first) = seen.vectors.first().filter(|_| parts.vectors > 0) else { return };
    lines.open(4, "vector:");
    match first.world.filter(|_| parts.shows_vertical()) {
        Some(world) => {
            let words = format!(
                "{} deg above the horizon, by the accelerometer; north is where it points",
                number(world.z.clamp(-1.0, 1.0).asin().to_degrees())
            );
            lines.add(5, format!("reference_direction: {}", list(world.as_slice())), Origin::Measured, words);
        }
        None => {
            let words =
                "east: without an accelerometer nothing says where it points; write it as east, north, up";
            lines.add(5, "reference_direction: [1.0, 0.0, 0.0]", Origin::Assumed, words);
        }
    }
    let noise = format!("noise_stddev_rad: {}", number(first.noise_rad.clamp(1e-5, 0.5)));
    lines.add(5, noise, Origin::Measured, "from differences of neighbouring samples");
    if let Some(rate_hz) = first.rate_hz {
        let words = "one over the usual time between new values";
        lines.add(5, format!("rate_hz: {}", number(rate_hz)), Origin::Measured, words);
    }
}
