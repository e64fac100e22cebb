//! The lines of the platform's file.

use nalgebra::Vector3;
use whorl_math::GRAVITY_M_S2;

use super::lines::{Lines, Origin, Sourced, list, number};
use super::measure::{Measured, Noise};
use super::questions::{Ask, choice, positive, three};

/// What stands for a body that nobody weighed: 1 kg, as wide as a loaf of bread \[kg, kg m^2\].
const MASS_KG: f64 = 1.0;
const INERTIA_KG_M2: f64 = 0.01;
/// A wheel that nobody weighed: its share of the body's inertia \[1\].
const WHEEL_SHARE: f64 = 0.01;
/// Turn-on biases of MEMS sensors: 0.5 deg/s, 10 mg [rad/s, m/s^2].
const GYRO_BIAS_RAD_S: f64 = 0.01;
const FORCE_BIAS_M_S2: f64 = 0.1;
/// The rate of an encoder has none: a small number that no fit divides by [rad/s].
const ENCODER_BIAS_RAD_S: f64 = 1e-6;
/// A centre of mass that nobody measured is this far off, standard deviation \[m\].
const ARM_M: f64 = 0.01;
/// A hinge this close to level or upright is so \[1\].
const LEVEL: f64 = 0.3;
/// Platforms on bearings stand with z up, and tilt by less than 60 deg \[rad, 1\].
const MOST_TILT_RAD: f64 = 1.05;
const UPRIGHT: f64 = 0.5;
/// Tilt of a bearing without a stop \[rad\].
const NO_STOP_RAD: f64 = 3.1;

/// What the map says that the platform's file depends on.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Parts {
    /// Which axes the gyro has; none: no gyro.
    pub gyro_axes: [bool; 3],
    /// Whether that is an encoder's angle.
    pub is_angle: bool,
    /// Whether there is an accelerometer.
    pub accelerometer: bool,
    /// Vector sensors.
    pub vectors: usize,
    /// Names of the wheels.
    pub wheels: Vec<String>,
    /// Whether wheels' columns are called x, y, z.
    pub wheels_are_axes: bool,
    /// Whether wheels' speeds are measured.
    pub tachometer: bool,
    /// Whether the bus voltage is.
    pub bus: bool,
}

/// The motion that the rig leaves the body.
fn freedom(parts: &Parts, seen: &Measured, ask: &mut dyn Ask) -> Sourced<String> {
    let count = parts.gyro_axes.iter().filter(|there| **there).count();
    let suggested = match count {
        0 if !parts.wheels.is_empty() => {
            Sourced::new("clamped", Origin::Assumed, "wheels alone were measured; check it")
        }
        1 => Sourced::new("hinge", Origin::Assumed, "one axis alone was measured; check it"),
        _ if parts.accelerometer
            && (seen.most_tilt_rad > MOST_TILT_RAD || seen.up_b.is_some_and(|up| up.z < UPRIGHT)) =>
        {
            Sourced::new(
                "free",
                Origin::Assumed,
                "no bearing lets it lie on its sides as here. What a hand turns has no model: for such recordings there are whorl estimate \
                 and whorl calibrate imu",
            )
        }
        _ if parts.accelerometer && seen.force_off < 0.05 => Sourced::new(
            "on_bearing",
            Origin::Assumed,
            "what was measured is gravity all the time, so the sensor turns about a point; else: free, hinge, clamped",
        ),
        _ => Sourced::new("on_bearing", Origin::Assumed, "check it; else: free, hinge, clamped"),
    };
    let suggested = Sourced::new(suggested.value.to_owned(), suggested.origin, suggested.words);
    choice(
        ask,
        "How may the body move? on_bearing: about three axes, with weight; hinge: about one; clamped: not; free: a spacecraft",
        &["on_bearing", "hinge", "clamped", "free"],
        suggested,
    )
}

/// The platform's file of what was seen and said.
pub fn lines(name: &str, parts: &Parts, seen: &Measured, ask: &mut dyn Ask) -> Lines {
    let mut lines = Lines::default();
    lines.open(0, format!("/{name}/**:"));
    lines.open(1, "ros__parameters:");
    lines.open(2, "model:");
    let freedom = freedom(parts, seen, ask);
    let kind = freedom.value.as_str();
    let hinge = hinge_axis(parts);
    let (axis, letter) = (hinge.map_or(2, |(axis, _)| axis), hinge.map_or('z', |(_, letter)| letter));
    let mut mass = Sourced::new(MASS_KG, Origin::Assumed, "weigh it");
    let mut inertia =
        Sourced::new([INERTIA_KG_M2; 3], Origin::Assumed, "weigh it, or take it from the drawings");
    if kind != "clamped" {
        mass = positive(ask, "Mass of what turns [kg]", mass);
        inertia = three(ask, "Its inertia about x, y, z [kg m^2]", inertia);
        lines.add(3, format!("mass_kg: {}", number(mass.value)), mass.origin, mass.words.clone());
        let [x, y, z] = inertia.value.map(number);
        let text = format!("inertia_kg_m2: {{xx: {x}, xy: 0.0, xz: 0.0, yy: {y}, yz: 0.0, zz: {z}}}");
        lines.add(3, text, inertia.origin, inertia.words.clone());
    }
    let mut of_freedom = freedom.words.clone();
    let text = if kind == "hinge" {
        let mut direction = [0.0; 3];
        if let Some(component) = direction.get_mut(axis) {
            *component = 1.0;
        }
        if hinge.is_some() {
            of_freedom = format!("{of_freedom}; its axis is the one of the gyro, {letter}")
                .trim_start_matches("; ")
                .to_owned();
        }
        format!("freedom: {{kind: hinge, axis: {}}}", list(&direction))
    } else {
        format!("freedom: {{kind: {kind}}}")
    };
    lines.add(3, text, freedom.origin, of_freedom);
    let offset_stddev = weight(&mut lines, kind, axis, seen, mass.value, &inertia);
    wheels(
        &mut lines,
        parts,
        seen,
        kind,
        axis,
        inertia.value.iter().fold(f64::INFINITY, |a, b| a.min(*b)),
        ask,
    );
    if let Some(volt) = seen.bus_v.filter(|_| parts.bus) {
        let words = "the first reading; fall over time and under load are taken as none";
        lines.add(3, format!("bus: {{initial_v: {}}}", number(volt)), Origin::Measured, words);
    }
    sensors(&mut lines, parts, seen);
    priors(&mut lines, kind, axis, &mass, &inertia, offset_stddev);
    lines
}

fn hinge_axis(parts: &Parts) -> Option<(usize, char)> {
    let one = parts.gyro_axes.iter().filter(|there| **there).count() == 1;
    let axis = parts.gyro_axes.iter().position(|there| *there).filter(|_| one)?;
    Some((axis, ['x', 'y', 'z'].get(axis).copied().unwrap_or('z')))
}

/// Where the weight acts, and where the rig stops; returns how well the first is known [N m].
fn weight(
    lines: &mut Lines,
    kind: &str,
    axis: usize,
    seen: &Measured,
    mass_kg: f64,
    inertia: &Sourced<[f64; 3]>,
) -> Option<f64> {
    let stddev = mass_kg * GRAVITY_M_S2 * ARM_M;
    if kind == "hinge" {
        let up = seen.up_b?;
        // About an upright hinge weight has no moment.
        let across = Vector3::from_fn(|k, _| if k == axis { 0.0 } else { up[k] });
        if across.norm() < 1.0 - LEVEL {
            return None;
        }
        let Some(swing_hz) = seen.swing_hz else {
            let words = "the hinge is level and nothing swings freely; weigh it";
            lines.add(3, "gravity_offset_n_m: [0.0, 0.0, 0.0]", Origin::Assumed, words);
            return Some(stddev);
        };
        // Of small swings: (2 pi f)^2 = m g r / J. The centre of mass hangs below the hinge.
        let about = inertia.value.get(axis).copied().unwrap_or(INERTIA_KG_M2);
        let moment_n_m = about * (std::f64::consts::TAU * swing_hz).powi(2);
        let offset = -moment_n_m * across.try_normalize(1e-9)?;
        let origin = if inertia.origin == Origin::Answered { Origin::Measured } else { Origin::Assumed };
        let words = format!(
            "hangs where it rests and swings at {} Hz, measured, with the inertia above: if that is wrong, so is this, in proportion",
            number(swing_hz)
        );
        lines.add(3, format!("gravity_offset_n_m: {}", list(offset.as_slice())), origin, words);
        return Some(0.2 * moment_n_m);
    }
    if kind != "on_bearing" {
        return None;
    }
    let words = "weight times the centre of mass from the bearing's centre: balanced; weigh it";
    lines.add(3, "gravity_offset_n_m: [0.0, 0.0, 0.0]", Origin::Assumed, words);
    let tilted = format!("no stop; it tilts by up to {} deg here", number(seen.most_tilt_rad.to_degrees()));
    let text = format!("tilt_limit: {{kind: cone, max_rad: {}}}", number(NO_STOP_RAD));
    lines.add(3, text, Origin::Assumed, tilted);
    Some(stddev)
}

fn wheels(
    lines: &mut Lines,
    parts: &Parts,
    seen: &Measured,
    kind: &str,
    axis: usize,
    least_inertia: f64,
    ask: &mut dyn Ask,
) {
    if parts.wheels.is_empty() {
        return;
    }
    let suggested = match seen.wheel_inertia_kg_m2 {
        Some(measured) => Sourced::new(
            measured,
            Origin::Measured,
            "commanded torque over what it does to the speed; as right as the torque's unit",
        ),
        None => Sourced::new(WHEEL_SHARE * least_inertia, Origin::Assumed, "weigh it"),
    };
    let inertia = positive(ask, "Inertia of a wheel about its axis [kg m^2]", suggested);
    lines.open(3, "wheel_defaults:");
    let text = format!("spin_inertia_kg_m2: {}", number(inertia.value));
    lines.add(4, text, inertia.origin, inertia.words);
    let (torque, from) = match seen.most_torque_n_m.filter(|torque| *torque > 0.0) {
        Some(torque) => (torque, "the largest that was commanded; see the motor's data sheet"),
        None => (0.1, "see the motor's data sheet"),
    };
    lines.add(4, format!("max_torque_n_m: {}", number(1.2 * torque)), Origin::Assumed, from);
    let (speed, from) = match seen.wheels.filter(|(_, most)| *most > 0.0) {
        Some((_, most)) => (most, "a fifth above the largest measured; see the motor's data sheet"),
        None => (500.0, "see the motor's data sheet"),
    };
    lines.add(4, format!("max_speed_rad_s: {}", number(1.2 * speed)), Origin::Assumed, from);
    lines.open(3, "wheels:");
    for (j, name) in parts.wheels.iter().enumerate() {
        let mut direction = [0.0; 3];
        let along = if parts.wheels.len() == 3 {
            j
        } else if kind == "hinge" {
            axis
        } else {
            j.min(2)
        };
        if let Some(component) = direction.get_mut(along) {
            *component = 1.0;
        }
        let (origin, words) = if parts.wheels_are_axes {
            (Origin::Stated, "by its name")
        } else {
            (Origin::Assumed, "look where it stands and which way round it turns")
        };
        lines.add(4, format!("{name}: {{spin_axis: {}}}", list(&direction)), origin, words);
    }
}

fn sensors(lines: &mut Lines, parts: &Parts, seen: &Measured) {
    lines.open(3, "sensors:");
    if let Some(rate_hz) = seen.rate_hz {
        let words = "one over the usual time between samples";
        lines.add(4, format!("rate_hz: {}", number(rate_hz)), Origin::Measured, words);
    }
    if parts.gyro_axes != [false; 3] {
        lines.open(4, "gyro:");
        if parts.gyro_axes != [true; 3] {
            let names = ["x", "y", "z"].into_iter().zip(parts.gyro_axes).filter(|(_, there)| *there);
            let names: Vec<&str> = names.map(|(name, _)| name).collect();
            lines.add(5, format!("axes: [{}]", names.join(", ")), Origin::Stated, "those in the map");
        }
        if let Some(noise) = &seen.gyro {
            let bias = if parts.is_angle { ENCODER_BIAS_RAD_S } else { GYRO_BIAS_RAD_S };
            triaxial(lines, noise, seen.rest_s, parts.gyro_axes, ("rad_s", "rad/s"), bias);
        }
        if let Some(rate_hz) = seen.rate_hz.filter(|_| parts.is_angle) {
            let words = "half the time over which a rate is taken, at whose end it is stamped";
            lines.add(5, format!("time_constant_s: {}", number(0.5 / rate_hz)), Origin::Measured, words);
        }
    }
    if let Some(noise) = seen.force.as_ref().filter(|_| parts.accelerometer) {
        lines.open(4, "accelerometer:");
        triaxial(lines, noise, seen.rest_s, [true; 3], ("m_s2", "m/s^2"), FORCE_BIAS_M_S2);
        let words = "from the centre of rotation; measure it with a ruler";
        lines.add(5, "lever_arm_m: [0.0, 0.0, 0.0]", Origin::Assumed, words);
    }
    vector(lines, parts, seen);
    if let Some((noise, _)) = seen.wheels.filter(|(noise, _)| parts.tachometer && *noise > 0.0) {
        let text = format!("wheel_speed: {{noise_stddev_rad_s: {}}}", number(noise));
        lines.add(4, text, Origin::Measured, "from differences of neighbouring samples");
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
    match first.world.filter(|_| parts.accelerometer) {
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

/// How well what was assumed is known: hardly.
fn priors(
    lines: &mut Lines,
    kind: &str,
    axis: usize,
    mass: &Sourced<f64>,
    inertia: &Sourced<[f64; 3]>,
    offset_stddev: Option<f64>,
) {
    if kind == "clamped" || inertia.origin == Origin::Answered && mass.origin == Origin::Answered {
        return;
    }
    lines.open(2, "model_prior:");
    let words =
        "standard deviations of what is assumed above, so that fits may move it; smaller once it is weighed";
    let each: Vec<String> = ["xx", "yy", "zz"]
        .into_iter()
        .zip(inertia.value)
        .enumerate()
        .filter(|(k, _)| kind != "hinge" || *k == axis)
        .map(|(_, (key, value))| format!("{key}: {}", number(0.5 * value)))
        .collect();
    lines.add(3, format!("inertia_kg_m2: {{{}}}", each.join(", ")), Origin::Assumed, words);
    if let Some(stddev) = offset_stddev {
        lines.add(3, format!("gravity_offset_n_m: {}", list(&[stddev; 3])), Origin::Assumed, words);
    }
}
