//! Effects outside the library.

use nalgebra::Vector3;
use rand_pcg::Pcg64;

use super::catalogue::Stage;
use crate::scenario::{between, index, normal, sign};
use crate::truth::law::{Shape, Variable};
use crate::truth::{DrawnLaw, Foreign, Plan};

/// Their names.
pub const FOREIGN: [&str; 18] = [
    "vane",
    "oval_bearing",
    "warm_cg",
    "drifting_cg",
    "pump",
    "gear",
    "bursting_leak",
    "stick_slip",
    "swapped_axes",
    "voltage_torque",
    "switched_fan",
    "creeping_cable",
    "sliding_battery",
    "warming_grease",
    "draughty_door",
    "one_way_friction",
    "dead_gyro",
    "iron",
];

/// What an answer may say.
#[derive(Debug, Clone, Copy)]
pub struct Expected {
    /// Driving variables that are right; an answer need only contain one of these words.
    pub variables: &'static [&'static str],
    /// Names from the catalogue that are not wrong: they describe the same thing well enough.
    pub names: &'static [&'static str],
    /// Effects of the catalogue that may imitate it; its size is set by what they leave.
    pub imitators: &'static [&'static str],
}

/// What is right for each.
#[must_use]
pub fn expected(name: &str) -> Expected {
    let (variables, names, imitators): (&[_], &[_], &[_]) = match name {
        "vane" => (
            &["yaw_rate", "rate_z", "omega_z", "rate"],
            &[],
            &["gyro_misalignment", "air_drag_quadratic", "wheel_misalignment", "bearing_viscous_friction"],
        ),
        "oval_bearing" => {
            (&["yaw", "azimuth", "heading"], &[], &["magnetic_torque", "air_current", "bearing_turbine"])
        }
        "warm_cg" => {
            (&["temperature", "time"], &["mass_shift"], &["mass_shift", "air_current", "accel_bias"])
        }
        "drifting_cg" => (&["time", "temperature"], &[], &["mass_shift", "air_current", "accel_bias"]),
        "pump" => (
            &["time", "frequency", "periodic"],
            &["air_current_periodic", "periodic_torque"],
            &["air_current", "magnetic_torque", "flexible_mode"],
        ),
        "gear" => (&["wheel"], &[], &["wheel_friction", "wheel_windage", "bearing_turbine"]),
        "bursting_leak" => (
            &["time"],
            &["thruster_leak"],
            &["thruster_leak", "air_current", "bearing_turbine", "magnetic_torque"],
        ),
        "stick_slip" => (
            &["rate"],
            &["bearing_coulomb_friction"],
            &["bearing_viscous_friction", "bearing_coulomb_friction", "air_drag_quadratic"],
        ),
        "swapped_axes" => (&["rate", "gyro", "omega"], &["gyro_misalignment"], &[]),
        "switched_fan" => (
            &["time", "frequency", "periodic"],
            &[],
            &["air_current", "bearing_turbine", "thruster_leak", "magnetic_torque"],
        ),
        "creeping_cable" => {
            (&["time"], &[], &["bearing_turbine", "air_current", "thruster_leak", "harness_spring"])
        }
        "sliding_battery" => (&["time"], &[], &["mass_shift", "anisoelastic_sag", "air_current"]),
        "warming_grease" => {
            (&["wheel_x", "time"], &[], &["wheel_friction", "wheel_windage", "wheel_inertia"])
        }
        "draughty_door" => (
            &["yaw", "azimuth", "heading"],
            &[],
            &["air_current", "magnetic_torque", "harness_spring", "bearing_turbine"],
        ),
        "one_way_friction" => (
            &["yaw_rate", "rate"],
            &[],
            &[
                "bearing_viscous_friction",
                "bearing_coulomb_friction",
                "air_drag_quadratic",
                "bearing_turbine",
                "air_current",
            ],
        ),
        "dead_gyro" => (&["rate", "gyro"], &[], &["gyro_scale", "gyro_misalignment"]),
        DRAWN_LAW => (
            &["rate", "tilt", "yaw", "heading"],
            &[],
            &[
                "bearing_viscous_friction",
                "bearing_coulomb_friction",
                "air_drag_quadratic",
                "bearing_turbine",
                "air_current",
                "magnetic_torque",
                "harness_spring",
                "anisoelastic_sag",
            ],
        ),
        "iron" => (
            &["yaw", "azimuth", "heading"],
            &[],
            &["vector_sensor_misalignment", "gyro_scale", "gyro_misalignment"],
        ),
        _ => (&["voltage"], &[], &["air_current", "bearing_turbine", "magnetic_torque", "thruster_leak"]),
    };
    Expected { variables, names, imitators }
}

/// From-to times, with the ranges of how long it lasts and how long it pauses \[s\].
fn now_and_then(rng: &mut Pcg64, plans: &[Plan], lasts: (f64, f64), pauses: (f64, f64)) -> Vec<(f64, f64)> {
    let longest = plans.iter().map(|p| p.duration_s).fold(0.0, f64::max);
    let mut times = Vec::new();
    let mut time_s = between(rng, 2.0, 10.0);
    while time_s < longest {
        let length = between(rng, lasts.0, lasts.1);
        times.push((time_s, time_s + length));
        time_s += length + between(rng, pauses.0, pauses.1);
    }
    times
}

/// Name of a law that is drawn; no case of the usual cells.
pub const DRAWN_LAW: &str = "drawn_law";

/// Draws a law that the catalogue does not have: no line, no friction that it knows.
fn drawn_law(stage: &Stage, rng: &mut Pcg64) -> DrawnLaw {
    let variables = [
        Variable::RollRate,
        Variable::PitchRate,
        Variable::YawRate,
        Variable::YawRate,
        Variable::Rate,
        Variable::TiltX,
        Variable::TiltY,
        Variable::Heading,
    ];
    let variable = variables[index(rng, variables.len())];
    let shapes = [Shape::Square, Shape::Cube, Shape::SignedSquare, Shape::DeadZone, Shape::Saturation];
    let shape = match variable {
        Variable::Heading => Shape::Sine(2 + index(rng, 2) as u8),
        // The square along the rate has a name.
        Variable::Rate => [Shape::Cube, Shape::DeadZone][index(rng, 2)],
        _ => shapes[index(rng, shapes.len())],
    };
    let axis = (variable != Variable::Rate).then(|| (index(rng, 2) == 1, index(rng, 3)));
    let scale = match variable {
        Variable::TiltX | Variable::TiltY => stage.largest_tilt_rad,
        Variable::RollRate | Variable::PitchRate => 0.3 * stage.largest_rate_rad_s,
        _ => stage.largest_rate_rad_s,
    };
    let sign = if axis.is_none() { 1.0 } else { sign(rng) };
    DrawnLaw { variable, shape, axis, scale: scale.max(1e-3), size_n_m: 1e-3 * sign }
}

/// Draws one: at size 1, and how large it may be.
pub fn draw(name: &str, stage: &Stage, plans: &[Plan], rng: &mut Pcg64) -> Foreign {
    let mut foreign = Foreign::default();
    match name {
        "vane" => foreign.vane_n_m_s3 = sign(rng),
        "oval_bearing" => foreign.oval_n_m = 1e-3 * sign(rng),
        "warm_cg" => foreign.warm_cg_n_m_k = Vector3::new(normal(rng), normal(rng), 0.0) * 2e-3,
        "drifting_cg" => foreign.drift_cg_n_m_s = Vector3::new(normal(rng), normal(rng), 0.0) * 1e-4,
        "pump" => {
            foreign.pump_b_n_m = Vector3::new(normal(rng), normal(rng), normal(rng)) * 2e-3;
            foreign.pump_hz = between(rng, 0.3, 1.2);
        }
        "gear" => {
            foreign.gear_n_m = 5e-3;
            // A few hertz at most at usual speeds: harmonic drives and belts have such.
            foreign.gear_teeth = between(rng, 0.05, 0.12);
        }
        "bursting_leak" => {
            foreign.burst_leak_n = 0.01;
            foreign.burst_jet = index(rng, stage.jets.len());
            foreign.burst_s = now_and_then(rng, plans, (3.0, 9.0), (4.0, 12.0));
        }
        "stick_slip" => foreign.stick_slip_n_m = 3e-3,
        "swapped_axes" => foreign.gyro_xy_swapped = true,
        "switched_fan" => {
            foreign.fan_b_n_m = Vector3::new(normal(rng), normal(rng), normal(rng)) * 1e-3;
            foreign.fan_s = now_and_then(rng, plans, (5.0, 16.0), (5.0, 18.0));
        }
        "creeping_cable" => foreign.creep_n_m = 1e-3 * sign(rng),
        "sliding_battery" => {
            foreign.battery_n_m = Vector3::new(normal(rng), normal(rng), 0.0) * 2e-3;
            foreign.battery_s = between(rng, 30.0, 60.0);
        }
        "warming_grease" => foreign.grease_n_m_s = 1e-4,
        "draughty_door" => {
            foreign.door_world_n_m = Vector3::new(normal(rng), normal(rng), normal(rng)) * 1e-3;
            foreign.door_rad = stage.mean_yaw_rad + between(rng, -0.8, 0.8);
        }
        "one_way_friction" => foreign.ratchet_n_m_s = 0.02,
        "dead_gyro" => foreign.dead_rad_s = 1e-3,
        "iron" => foreign.iron_rad = 0.02 * sign(rng),
        DRAWN_LAW => foreign.law = Some(drawn_law(stage, rng)),
        _ => foreign.voltage_torque_n_m_v = 2e-3 * sign(rng),
    }
    foreign
}

/// The same at another size.
#[must_use]
pub fn scaled(foreign: &Foreign, size: f64) -> Foreign {
    Foreign {
        cubic_yaw_n_m_s3: foreign.cubic_yaw_n_m_s3 * size,
        vane_n_m_s3: foreign.vane_n_m_s3 * size,
        oval_n_m: foreign.oval_n_m * size,
        warm_cg_n_m_k: foreign.warm_cg_n_m_k * size,
        drift_cg_n_m_s: foreign.drift_cg_n_m_s * size,
        pump_b_n_m: foreign.pump_b_n_m * size,
        gear_n_m: foreign.gear_n_m * size,
        burst_leak_n: foreign.burst_leak_n * size,
        stick_slip_n_m: foreign.stick_slip_n_m * size,
        voltage_torque_n_m_v: foreign.voltage_torque_n_m_v * size,
        fan_b_n_m: foreign.fan_b_n_m * size,
        creep_n_m: foreign.creep_n_m * size,
        battery_n_m: foreign.battery_n_m * size,
        grease_n_m_s: foreign.grease_n_m_s * size,
        door_world_n_m: foreign.door_world_n_m * size,
        ratchet_n_m_s: foreign.ratchet_n_m_s * size,
        dead_rad_s: foreign.dead_rad_s * size,
        iron_rad: foreign.iron_rad * size,
        law: foreign.law.clone().map(|law| DrawnLaw { size_n_m: law.size_n_m * size, ..law }),
        ..foreign.clone()
    }
}
