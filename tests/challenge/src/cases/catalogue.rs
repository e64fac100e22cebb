//! Which effects can be hidden, their size, and the names of their parameters in the library.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use nalgebra::Vector3;
use rand_pcg::Pcg64;

use crate::scenario::{between, index, normal, sign};
use crate::truth::Hidden;
use crate::truth::filter::Filters;

/// Parameter name -> value.
pub type Values = BTreeMap<String, f64>;

/// What sizes depend on.
#[derive(Debug, Clone)]
pub struct Stage {
    pub wheels: Vec<String>,
    pub jets: Vec<String>,
    /// Jets that fire often enough to be seen.
    pub firing: Vec<usize>,
    pub largest_tilt_rad: f64,
    pub largest_rate_rad_s: f64,
    pub mean_yaw_rad: f64,
}

/// An effect drawn at random: values as a function of its size.
pub struct Drawn {
    pub id: &'static str,
    /// Scale with size.
    scaled: Values,
    /// Do not.
    fixed: Values,
    pub largest_size: f64,
}

impl Drawn {
    /// Values at a size; 0 = absent.
    #[must_use]
    pub fn at(&self, size: f64, stage: &Stage) -> Values {
        let mut values = self.fixed.clone();
        for (name, value) in &self.scaled {
            values.insert(name.clone(), value * size);
        }
        match self.id {
            "tilt_stop_contact" => {
                let angle = stage.largest_tilt_rad * (1.0 - 0.02 * size).max(0.1);
                values.insert("angle_rad".into(), angle);
                values.remove("depth");
            }
            "gyro_saturation" => {
                let range = stage.largest_rate_rad_s * (1.0 - 0.02 * size).max(0.05);
                values.insert("range_rad_s".into(), range);
                values.remove("depth");
            }
            _ => {}
        }
        values
    }
}

/// Every effect of the catalogue that can be detected in principle, with the group of its kind. Pairs are drawn of the
/// first [`PAIRED`].
/// Not here: `gravity_offset`, `inertia_products`, `gyro_bias` (in every base model, so in every case),
/// `earth_rotation` and `gravity_gradient` (below noise), `unmodelled_torque` (a stand-in).
pub const SINGLES: [&str; 44] = [
    "bearing_viscous_friction",
    "bearing_coulomb_friction",
    "air_drag_quadratic",
    "air_current",
    "air_current_periodic",
    "bearing_turbine",
    "magnetic_torque",
    "harness_spring",
    "anisoelastic_sag",
    "mass_shift",
    "moving_ballast_backlash",
    "tilt_stop_contact",
    "thruster_strength",
    "thruster_misalignment",
    "thruster_delay",
    "thruster_rise",
    "thruster_leak",
    "thruster_pressure",
    "supply_voltage",
    "wheel_friction",
    "wheel_misalignment",
    "wheel_inertia",
    "wheel_imbalance",
    "wheel_windage",
    "gyro_scale",
    "gyro_misalignment",
    "gyro_temperature",
    "gyro_g_sensitivity",
    "gyro_saturation",
    "accel_bias",
    "accel_scale",
    "accel_lever_arm",
    "imu_latency",
    "vector_sensor_misalignment",
    "vibration_alias",
    "slosh",
    "flexible_mode",
    "periodic_torque",
    "air_drag_power",
    "winding_cable",
    "thruster_voltage",
    "wheel_motor_bias",
    "wheel_motor_constant",
    "imu_bandwidth",
];

/// Effects of which pairs are drawn.
pub const PAIRED: usize = 37;

/// Effects that may be confused with each other, whichever of the two is present.
const ALIKE: [(&str, &str); 43] = [
    ("bearing_viscous_friction", "bearing_coulomb_friction"),
    ("bearing_viscous_friction", "air_drag_quadratic"),
    ("bearing_coulomb_friction", "air_drag_quadratic"),
    ("air_current", "bearing_turbine"),
    ("air_current", "magnetic_torque"),
    ("air_current", "harness_spring"),
    ("air_current", "thruster_leak"),
    ("air_current", "mass_shift"),
    ("bearing_turbine", "thruster_leak"),
    ("bearing_turbine", "magnetic_torque"),
    ("magnetic_torque", "thruster_leak"),
    ("magnetic_torque", "harness_spring"),
    // A leak whose thrust falls with the tank pressure drifts as the mass does.
    ("mass_shift", "thruster_leak"),
    ("mass_shift", "thruster_pressure"),
    ("thruster_strength", "thruster_pressure"),
    ("thruster_strength", "thruster_misalignment"),
    ("thruster_strength", "thruster_delay"),
    ("thruster_strength", "thruster_rise"),
    ("thruster_delay", "thruster_rise"),
    ("wheel_friction", "wheel_windage"),
    ("wheel_inertia", "wheel_misalignment"),
    ("wheel_inertia", "gyro_scale"),
    ("wheel_misalignment", "gyro_misalignment"),
    ("gyro_g_sensitivity", "gyro_temperature"),
    ("accel_bias", "vector_sensor_misalignment"),
    ("accel_bias", "accel_scale"),
    ("accel_scale", "vector_sensor_misalignment"),
    ("slosh", "flexible_mode"),
    ("imu_bandwidth", "imu_latency"),
    ("imu_bandwidth", "thruster_rise"),
    ("periodic_torque", "air_current_periodic"),
    ("air_drag_power", "bearing_viscous_friction"),
    ("air_drag_power", "bearing_coulomb_friction"),
    ("air_drag_power", "air_drag_quadratic"),
    ("winding_cable", "harness_spring"),
    ("winding_cable", "air_current"),
    ("thruster_voltage", "thruster_pressure"),
    ("thruster_voltage", "thruster_strength"),
    ("thruster_voltage", "supply_voltage"),
    ("wheel_motor_bias", "wheel_friction"),
    ("wheel_motor_constant", "wheel_inertia"),
    ("wheel_motor_constant", "supply_voltage"),
    ("wheel_motor_constant", "wheel_friction"),
];

/// Effects that may be confused with this one: the oracle checks whether the data separate them.
#[must_use]
pub fn rivals(id: &str) -> Vec<&'static str> {
    ALIKE.iter().filter_map(|(a, b)| if *a == id { Some(*b) } else { (*b == id).then_some(*a) }).collect()
}

/// Parameters that scale with the effect, with a step that is small but shows (for sensitivities).
#[must_use]
pub fn parameters(id: &str, stage: &Stage) -> Vec<(String, f64)> {
    let axes = |prefix: &str, suffix: &str, size: f64| -> Vec<(String, f64)> {
        ["x", "y", "z"].iter().map(|a| (format!("{prefix}{a}{suffix}"), size)).collect()
    };
    let one = |name: &str, size: f64| vec![(name.to_owned(), size)];
    let per = |names: &[String], suffixes: &[(&str, f64)]| -> Vec<(String, f64)> {
        names.iter().flat_map(|n| suffixes.iter().map(move |(s, size)| (format!("{n}{s}"), *size))).collect()
    };
    let firing: Vec<String> = stage.firing.iter().map(|j| stage.jets[*j].clone()).collect();
    match id {
        "bearing_viscous_friction" => one("c_n_m_s", 0.01),
        "bearing_coulomb_friction" => one("torque_n_m", 1e-3),
        "air_drag_quadratic" => axes("d", "_n_m_s2", 0.05),
        "air_current" => axes("t", "_n_m", 2e-3),
        "air_current_periodic" => axes("amplitude_", "_n_m", 2e-3),
        "bearing_turbine" => vec![("body_z_n_m".into(), 1e-3), ("vertical_n_m".into(), 1e-3)],
        "magnetic_torque" => axes("dipole_", "_a_m2", 30.0),
        "harness_spring" => one("k_n_m_rad", 2e-3),
        "anisoelastic_sag" => {
            ["cxx", "cyy", "czz", "cxy", "cxz", "cyz"].iter().map(|c| (format!("{c}_m_n"), 2e-7)).collect()
        }
        "mass_shift" => axes("shift_", "_n_m_kg", 0.5),
        "moving_ballast_backlash" => vec![("gap_x_n_m".into(), 0.01), ("gap_y_n_m".into(), 0.01)],
        "tilt_stop_contact" | "gyro_saturation" => one("depth", 1.0),
        "thruster_strength" => {
            let mut list = one("all", 0.05);
            list.extend(per(&firing, &[("", 0.05)]));
            list
        }
        "thruster_misalignment" => per(&firing, &[("_a_rad", 0.03), ("_b_rad", 0.03)]),
        "thruster_delay" => vec![("t_on_s".into(), 0.01), ("t_off_s".into(), 0.01)],
        "thruster_rise" => one("tau_s", 0.01),
        "thruster_leak" => per(&stage.jets, &[("_n", 4e-3)]),
        "thruster_pressure" => one("exponent", 0.2),
        "supply_voltage" => vec![("wheel_torque_per_v".into(), 0.01), ("valve_delay_s_v".into(), 0.002)],
        "wheel_friction" => per(&stage.wheels, &[("_viscous_n_m_s", 2e-5), ("_coulomb_n_m", 1e-3)]),
        "wheel_misalignment" => per(&stage.wheels, &[("_a_rad", 5e-3), ("_b_rad", 5e-3)]),
        "wheel_inertia" => per(&stage.wheels, &[("", 0.01)]),
        "wheel_imbalance" => per(&stage.wheels, &[("_kg_m2", 2e-6)]),
        "wheel_windage" => per(&stage.wheels, &[("_n_m_s2", 2e-7)]),
        "gyro_scale" => axes("scale_", "", 0.005),
        "gyro_misalignment" => {
            ["xy", "xz", "yx", "yz", "zx", "zy"].iter().map(|e| (format!("{e}_rad"), 0.005)).collect()
        }
        "gyro_temperature" => axes("slope_", "_rad_s_k", 1e-4),
        "gyro_g_sensitivity" => {
            ["xx", "xy", "yx", "yy", "zx", "zy"].iter().map(|e| (format!("{e}_s_m"), 2e-4)).collect()
        }
        "accel_bias" => axes("bias_", "_m_s2", 0.01),
        "accel_scale" => axes("scale_", "", 0.01),
        "accel_lever_arm" => axes("d_", "_m", 0.02),
        "imu_latency" => one("t_s", 0.004),
        "imu_bandwidth" => vec![("gyro_s".into(), 0.004), ("accel_s".into(), 0.004)],
        "vector_sensor_misalignment" => axes("m_", "_rad", 2e-3),
        "vibration_alias" => {
            let mut list = axes("gyro_", "_rad_s", 5e-4);
            list.extend(axes("accel_", "_m_s2", 5e-3));
            list
        }
        "slosh" => one("mass_ratio", 2e-3),
        "flexible_mode" => axes("participation_", "_sqrt_kg_m", 0.05),
        "periodic_torque" => {
            let mut list = axes("sine_", "_n_m", 2e-3);
            list.extend(axes("cosine_", "_n_m", 2e-3));
            list
        }
        "air_drag_power" => one("d_n_m", 1e-3),
        "winding_cable" => one("k_n_m_rad", 2e-3),
        "thruster_voltage" => one("thrust_per_v", 0.03),
        "wheel_motor_bias" => per(&stage.wheels, &[("_n_m", 1e-3)]),
        "wheel_motor_constant" => per(&stage.wheels, &[("", 0.02)]),
        _ => Vec::new(),
    }
}

/// Parameters that shape the effect without scaling it.
fn shape(id: &str, stage: &Stage, rng: &mut Pcg64) -> Values {
    let list: Vec<(&str, f64)> = match id {
        "air_current_periodic" => {
            vec![
                ("frequency_hz", 0.15 * 8.0_f64.powf(between(rng, 0.0, 1.0))),
                ("phase_rad", between(rng, -PI, PI)),
            ]
        }
        "periodic_torque" => vec![("frequency_hz", 0.15 * 8.0_f64.powf(between(rng, 0.0, 1.0)))],
        // Half of the units average over a window.
        "imu_bandwidth" => vec![("window", f64::from(u8::from(between(rng, 0.0, 1.0) < 0.5)))],
        "air_drag_power" => vec![("exponent", between(rng, 1.3, 1.7))],
        "harness_spring" | "winding_cable" => {
            let yaw = stage.mean_yaw_rad + between(rng, -1.0, 1.0);
            vec![("yaw0_rad", yaw.sin().atan2(yaw.cos())), ("c_n_m_s", 0.0)]
        }
        "tilt_stop_contact" => {
            vec![("k_n_m_rad", between(rng, 40.0, 200.0)), ("c_n_m_s", between(rng, 2.0, 10.0))]
        }
        "vibration_alias" => vec![
            ("frequency_hz", between(rng, 110.0, 440.0)),
            ("background", if between(rng, 0.0, 1.0) < 0.5 { 1.0 } else { 0.0 }),
        ],
        "slosh" => vec![
            ("frequency_hz", between(rng, 0.3, 1.6)),
            ("damping_ratio", between(rng, 0.008, 0.04)),
            ("height_m", between(rng, 0.1, 0.3)),
        ],
        "flexible_mode" => {
            vec![("frequency_hz", between(rng, 0.8, 3.0)), ("damping_ratio", between(rng, 0.003, 0.012))]
        }
        _ => Vec::new(),
    };
    list.into_iter().map(|(n, v)| (n.to_owned(), v)).collect()
}

/// Draws direction and shape of an effect.
pub fn draw(id: &'static str, stage: &Stage, rng: &mut Pcg64) -> Drawn {
    let all = parameters(id, stage);
    let mut scaled = Values::new();
    // One actuator is bad, not all; a positive quantity stays positive.
    let only_one = |rng: &mut Pcg64, scaled: &mut Values, signed: bool| {
        let (name, size) = all[index(rng, all.len())].clone();
        scaled.insert(name, size * if signed { sign(rng) } else { 1.0 });
    };
    let each = |rng: &mut Pcg64, scaled: &mut Values, signed: bool| {
        for (name, size) in &all {
            let n: f64 = normal(rng);
            scaled.insert(name.clone(), size * if signed { n } else { n.abs().max(0.1) });
        }
    };
    match id {
        "thruster_strength" => {
            // Half the cases are all jets weak, half are one jet.
            if between(rng, 0.0, 1.0) < 0.5 {
                scaled.insert("all".into(), -0.05);
            } else {
                let jet = stage.firing[index(rng, stage.firing.len())];
                scaled.insert(stage.jets[jet].clone(), -0.05);
            }
        }
        "thruster_leak"
        | "wheel_imbalance"
        | "wheel_windage"
        | "bearing_viscous_friction"
        | "bearing_coulomb_friction"
        | "harness_spring"
        | "thruster_rise"
        | "imu_latency"
        | "slosh"
        | "tilt_stop_contact"
        | "gyro_saturation"
        | "air_drag_power"
        | "winding_cable"
        | "thruster_voltage" => only_one(rng, &mut scaled, false),
        "bearing_turbine"
        | "wheel_inertia"
        | "thruster_pressure"
        | "wheel_motor_bias"
        | "wheel_motor_constant" => {
            only_one(rng, &mut scaled, true);
        }
        "thruster_misalignment" | "wheel_misalignment" | "wheel_friction" => {
            let units = all.len() / 2;
            let unit = index(rng, units);
            for (name, size) in &all[2 * unit..2 * unit + 2] {
                let n: f64 = normal(rng);
                scaled.insert(name.clone(), size * if id == "wheel_friction" { n.abs().max(0.2) } else { n });
            }
        }
        "air_drag_quadratic"
        | "thruster_delay"
        | "supply_voltage"
        | "moving_ballast_backlash"
        | "imu_bandwidth" => {
            each(rng, &mut scaled, false);
        }
        _ => each(rng, &mut scaled, true),
    }
    let largest_size = match id {
        // The library's bounds, with room to spare.
        "thruster_strength" => 12.0,
        "thruster_misalignment" => 12.0,
        "wheel_inertia" => 40.0,
        "wheel_misalignment" => 25.0,
        "tilt_stop_contact" => 25.0,
        "gyro_saturation" => 40.0,
        "thruster_delay" => 20.0,
        "thruster_rise" => 15.0,
        "imu_latency" => 40.0,
        "thruster_pressure" => 8.0,
        "supply_voltage" => 7.0,
        "thruster_leak" => 50.0,
        "gyro_scale" | "gyro_misalignment" | "gyro_temperature" | "gyro_g_sensitivity" | "accel_scale" => {
            15.0
        }
        "moving_ballast_backlash" => 6.0,
        "slosh" => 40.0,
        "flexible_mode" => 20.0,
        "wheel_imbalance" => 100.0,
        "accel_lever_arm" => 12.0,
        "thruster_voltage" => 6.0,
        "imu_bandwidth" => 10.0,
        _ => 30.0,
    };
    Drawn { id, scaled, fixed: shape(id, stage, rng), largest_size }
}

/// Builds an effect into the hidden platform.
pub fn install(hidden: &mut Hidden, id: &str, values: &Values, stage: &Stage, weight_n: f64) {
    let get = |name: &str| values.get(name).copied().unwrap_or(0.0);
    let axes = |prefix: &str, suffix: &str| {
        Vector3::new(
            get(&format!("{prefix}x{suffix}")),
            get(&format!("{prefix}y{suffix}")),
            get(&format!("{prefix}z{suffix}")),
        )
    };
    let wheel = |w: usize, suffix: &str| get(&format!("{}{suffix}", stage.wheels[w]));
    let jet = |j: usize, suffix: &str| get(&format!("{}{suffix}", stage.jets[j]));
    let (wheels, jets) = (stage.wheels.len(), stage.jets.len());
    match id {
        "bearing_viscous_friction" => hidden.viscous_n_m_s += get("c_n_m_s"),
        "bearing_coulomb_friction" => hidden.coulomb_n_m += get("torque_n_m"),
        "air_drag_quadratic" => hidden.drag_n_m_s2 += axes("d", "_n_m_s2"),
        "air_current" => hidden.air_current_world_n_m += axes("t", "_n_m"),
        "air_current_periodic" => {
            hidden.periodic_world_n_m = axes("amplitude_", "_n_m");
            hidden.periodic_hz = get("frequency_hz");
            hidden.periodic_phase_rad = get("phase_rad");
        }
        "bearing_turbine" => {
            hidden.turbine_body_n_m += get("body_z_n_m");
            hidden.turbine_vertical_n_m += get("vertical_n_m");
        }
        "magnetic_torque" => hidden.dipole_b_a_m2 += axes("dipole_", "_a_m2"),
        "harness_spring" => {
            hidden.cable_n_m_rad = get("k_n_m_rad");
            hidden.cable_yaw_rad = get("yaw0_rad");
            hidden.cable_n_m_s = get("c_n_m_s");
        }
        "anisoelastic_sag" => {
            for (i, j, name) in
                [(0, 0, "cxx"), (1, 1, "cyy"), (2, 2, "czz"), (0, 1, "cxy"), (0, 2, "cxz"), (1, 2, "cyz")]
            {
                let value = get(&format!("{name}_m_n"));
                hidden.compliance_m_n[(i, j)] = value;
                hidden.compliance_m_n[(j, i)] = value;
            }
        }
        "mass_shift" => hidden.mass_shift_n_m_kg += axes("shift_", "_n_m_kg"),
        "moving_ballast_backlash" => hidden.ballast_gap_n_m += axes("gap_", "_n_m"),
        "tilt_stop_contact" => {
            hidden.contact_n_m_rad = get("k_n_m_rad");
            hidden.contact_n_m_s = get("c_n_m_s");
            hidden.contact_rad = get("angle_rad");
        }
        "thruster_strength" => {
            hidden.jet_strength_all += get("all");
            (0..jets).for_each(|j| hidden.jet_strength[j] += jet(j, ""));
        }
        "thruster_misalignment" => (0..jets).for_each(|j| {
            hidden.jet_tilt_rad[j][0] += jet(j, "_a_rad");
            hidden.jet_tilt_rad[j][1] += jet(j, "_b_rad");
        }),
        "thruster_delay" => {
            hidden.valve_on_s += get("t_on_s");
            hidden.valve_off_s += get("t_off_s");
        }
        "thruster_rise" => hidden.plenum_s += get("tau_s"),
        "thruster_leak" => (0..jets).for_each(|j| hidden.leak_n[j] += jet(j, "_n")),
        "thruster_pressure" => hidden.pressure_exponent += get("exponent"),
        "supply_voltage" => {
            hidden.wheel_torque_per_v += get("wheel_torque_per_v");
            hidden.valve_delay_s_v += get("valve_delay_s_v");
        }
        "wheel_friction" => (0..wheels).for_each(|w| {
            hidden.wheel_viscous_n_m_s[w] += wheel(w, "_viscous_n_m_s");
            hidden.wheel_coulomb_n_m[w] += wheel(w, "_coulomb_n_m");
        }),
        "wheel_misalignment" => (0..wheels).for_each(|w| {
            hidden.wheel_tilt_rad[w][0] += wheel(w, "_a_rad");
            hidden.wheel_tilt_rad[w][1] += wheel(w, "_b_rad");
        }),
        "wheel_inertia" => (0..wheels).for_each(|w| hidden.wheel_inertia[w] += wheel(w, "")),
        "wheel_imbalance" => (0..wheels).for_each(|w| hidden.wheel_imbalance_kg_m2[w] += wheel(w, "_kg_m2")),
        "wheel_windage" => (0..wheels).for_each(|w| hidden.wheel_windage_n_m_s2[w] += wheel(w, "_n_m_s2")),
        "gyro_scale" => hidden.gyro_scale += axes("scale_", ""),
        "gyro_misalignment" => {
            for (i, a) in ["x", "y", "z"].iter().enumerate() {
                for (j, b) in ["x", "y", "z"].iter().enumerate() {
                    hidden.gyro_cross[(i, j)] += get(&format!("{a}{b}_rad"));
                }
            }
        }
        "gyro_temperature" => hidden.gyro_per_k += axes("slope_", "_rad_s_k"),
        "gyro_g_sensitivity" => {
            for (i, a) in ["x", "y", "z"].iter().enumerate() {
                for (j, b) in ["x", "y", "z"].iter().enumerate() {
                    hidden.gyro_per_g[(i, j)] += get(&format!("{a}{b}_s_m"));
                }
            }
        }
        "gyro_saturation" => hidden.gyro_range_rad_s = get("range_rad_s"),
        "accel_bias" => hidden.accel_bias_m_s2 += axes("bias_", "_m_s2"),
        "accel_scale" => hidden.accel_scale += axes("scale_", ""),
        "accel_lever_arm" => hidden.accel_arm_m += axes("d_", "_m"),
        "imu_latency" => hidden.imu_late_s += get("t_s"),
        "imu_bandwidth" => {
            hidden.imu_filters =
                Filters { delay_s: [get("gyro_s"), get("accel_s")], windows: get("window") > 0.0 };
        }
        "vector_sensor_misalignment" => hidden.vector_turn_rad += axes("m_", "_rad"),
        "vibration_alias" => {
            hidden.alias_gyro_rad_s = axes("gyro_", "_rad_s");
            hidden.alias_accel_m_s2 = axes("accel_", "_m_s2");
            hidden.alias_hz = get("frequency_hz");
            hidden.alias_background = get("background");
        }
        "periodic_torque" => {
            let (sine, cosine) = (axes("sine_", "_n_m"), axes("cosine_", "_n_m"));
            hidden.cycle_b_n_m = sine.zip_map(&cosine, f64::hypot);
            hidden.cycle_phase_rad = cosine.zip_map(&sine, f64::atan2);
            hidden.cycle_hz = get("frequency_hz");
        }
        "air_drag_power" => {
            hidden.power_drag_n_m += get("d_n_m");
            hidden.power_drag_exponent = values.get("exponent").copied().unwrap_or(1.5);
        }
        "winding_cable" => {
            hidden.winding_n_m_rad = get("k_n_m_rad");
            hidden.winding_yaw_rad = get("yaw0_rad");
            hidden.winding_n_m_s = get("c_n_m_s");
        }
        // The same slope near a full battery of 25.2 V.
        "thruster_voltage" => hidden.thrust_voltage_exponent += 25.2 * get("thrust_per_v"),
        "wheel_motor_bias" => (0..wheels).for_each(|w| hidden.wheel_bias_n_m[w] += wheel(w, "_n_m")),
        "wheel_motor_constant" => (0..wheels).for_each(|w| hidden.wheel_constant[w] += wheel(w, "")),
        "slosh" => {
            hidden.slosh_kg = get("mass_ratio") * weight_n / crate::truth::G_M_S2;
            hidden.slosh_hz = get("frequency_hz");
            hidden.slosh_damping = get("damping_ratio");
            hidden.slosh_height_m = get("height_m");
        }
        "flexible_mode" => {
            hidden.flexible_sqrt_kg_m = axes("participation_", "_sqrt_kg_m");
            hidden.flexible_hz = get("frequency_hz");
            hidden.flexible_damping = get("damping_ratio");
        }
        _ => {}
    }
}

/// Whether the true value means the same in the library, so that its interval must cover it: the formula
/// is the same and no other effect can imitate it.
#[must_use]
pub fn is_comparable(id: &str, name: &str) -> bool {
    match id {
        "bearing_viscous_friction"
        | "air_current"
        | "magnetic_torque"
        | "mass_shift"
        | "thruster_delay"
        | "thruster_leak"
        | "wheel_misalignment"
        | "wheel_inertia"
        | "gyro_scale"
        | "gyro_misalignment"
        | "gyro_temperature"
        | "gyro_g_sensitivity"
        | "accel_scale"
        | "accel_lever_arm"
        | "imu_latency"
        | "thruster_misalignment"
        | "wheel_friction" => !name.starts_with("field"),
        "air_current_periodic" | "slosh" | "flexible_mode" => name == "frequency_hz",
        "periodic_torque" | "wheel_motor_bias" | "wheel_motor_constant" => true,
        "air_drag_power" => name == "d_n_m",
        "moving_ballast_backlash" => name != "gap_z_n_m",
        _ => false,
    }
}
