//! The lines of the platform's file.

mod body;
mod sensors;

use body::{weight, wheels};
use sensors::sensors;

use super::Preset;
use super::lines::{Lines, Origin, Sourced, list, number};
use super::measure::Measured;
use super::questions::{Ask, choice, moments, positive};

/// What stands for a body that nobody weighed: 1 kg, as wide as a loaf of bread \[kg, kg m^2\].
const MASS_KG: f64 = 1.0;
const INERTIA_KG_M2: f64 = 0.01;
/// Platforms on bearings stand with z up, and tilt by less than 60 deg \[rad, 1\].
const MOST_TILT_RAD: f64 = 1.05;
const UPRIGHT: f64 = 0.5;

/// What the map says that the platform's file depends on.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Parts {
    /// Which axes the gyro has; none: no gyro.
    pub gyro_axes: [bool; 3],
    /// Whether that is an encoder's angle.
    pub is_angle: bool,
    /// Which axes the accelerometer has; none: no accelerometer.
    pub force_axes: [bool; 3],
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
    /// Whether nobody said in which unit torques were commanded.
    pub torque_unit_is_assumed: bool,
    /// The kind of rig, if somebody said it.
    pub preset: Option<Preset>,
}

impl Parts {
    /// Whether an accelerometer shows the vertical.
    fn shows_vertical(&self) -> bool {
        self.force_axes == [true; 3]
    }
}

/// The motion that the rig leaves the body.
fn freedom(parts: &Parts, seen: &Measured, ask: &mut dyn Ask) -> Sourced<String> {
    if let Some(preset) = parts.preset {
        return Sourced::new(preset.freedom().to_owned(), Origin::Answered, "");
    }
    let count = parts.gyro_axes.iter().filter(|there| **there).count();
    let suggested = match count {
        0 if !parts.wheels.is_empty() => {
            Sourced::new("clamped", Origin::Assumed, "wheels alone were measured; check it")
        }
        1 => Sourced::new("hinge", Origin::Assumed, "one axis alone was measured; check it"),
        _ if parts.shows_vertical()
            && (seen.most_tilt_rad > MOST_TILT_RAD || seen.up_b.is_some_and(|up| up.z < UPRIGHT)) =>
        {
            Sourced::new(
                "free",
                Origin::Assumed,
                "no bearing lets it lie on its sides as here. What a hand turns has no model: for such recordings there are whorl estimate \
                 and whorl calibrate imu",
            )
        }
        _ if parts.shows_vertical() && seen.force_off < 0.05 => Sourced::new(
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
    // A body turns against its wheels: it is heavier than they are.
    let beside_wheels = seen.wheel_inertia_kg_m2.map_or(0.0, |wheel| wheel / body::WHEEL_SHARE);
    let mut inertia = Sourced::new(
        [INERTIA_KG_M2.max(beside_wheels); 3],
        Origin::Assumed,
        "weigh it, or take it from the drawings",
    );
    if kind != "clamped" {
        mass = positive(ask, "Mass of what turns [kg]", mass);
        inertia = moments(ask, "Its inertia about x, y, z [kg m^2]", inertia);
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
