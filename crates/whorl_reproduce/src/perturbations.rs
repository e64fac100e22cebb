//! Figure 4.4.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_math::GRAVITY_M_S2;
use whorl_report::{ReproducedPlot, Reproduction};

use crate::rotating_earth::{BLACKSBURG_RAD, Body, Laboratory, perturbation_b_n_m};

/// Density of air [kg/m^3].
const AIR_KG_M3: f64 = 1.2;
/// Areas of Whorl-I's outer parts across the motion of a flat spin [m^2] and their distance from the axis
/// \[m\], from its photograph: the rim of the deck (3 ft across), boxes on it.
const AREAS: [(f64, f64); 2] = [(0.05, 0.43), (0.12, 0.30)];
/// Assumed constant friction of the air bearing [N m].
const BEARING_N_M: f64 = 1e-4;

/// Torques over the rate of a flat spin.
pub fn magnitudes() -> Reproduction {
    let model = PlatformModel::whorl_1_reference();
    let body = Body {
        inertia_b_kg_m2: *model.mass_properties.inertia_b_kg_m2(),
        first_moment_b_kg_m: model.mass_properties.gravity_offset_b_n_m() / GRAVITY_M_S2,
    };
    let laboratory = Laboratory::at_latitude(BLACKSBURG_RAD);
    let rates: Vec<f64> = (0..=60).map(|n| 10f64.powf(-2.0 + f64::from(n) / 60.0 * 2.7)).collect();
    let largest = |rate: f64, plumb_line: bool| {
        let mut largest: f64 = 0.0;
        // Tilts of up to 60 deg in every direction, as section 4.3.3 supposes.
        for n in 0..72 {
            let azimuth = std::f64::consts::TAU * f64::from(n) / 36.0;
            let tilt = if n < 36 { 60.0_f64.to_radians() } else { 0.0 };
            let axis = Vector3::new(azimuth.cos(), azimuth.sin(), 0.0);
            let q = UnitQuaternion::from_scaled_axis(axis * tilt);
            let omega = Vector3::new(0.0, 0.0, rate);
            largest = largest.max(perturbation_b_n_m(&body, &laboratory, &q, &omega, plumb_line).norm());
        }
        largest
    };
    let curve = |name: &str, f: &dyn Fn(f64) -> f64| {
        (name.to_owned(), rates.iter().map(|r| (*r, f(*r))).collect::<Vec<_>>())
    };
    let drag = |rate: f64| -> f64 {
        AREAS.iter().map(|(area, arm)| 0.5 * AIR_KG_M3 * area * (rate * arm).powi(2) * arm).sum()
    };
    let crossing = rates.iter().find(|r| drag(**r) > largest(**r, true)).copied().unwrap_or(f64::NAN);
    let centrifugal = laboratory.rate_l_rad_s.cross(&laboratory.velocity_l_m_s).norm() / GRAVITY_M_S2;
    // What a gyro tells from its noise within a second: two means of half a second, a rate apart.
    let sensors = &model.sensors;
    let told_n_m = model.mass_properties.inertia_b_kg_m2()[(2, 2)]
        * sensors.gyro.errors.noise_stddev.amax()
        * (4.0 / sensors.rate_hz).sqrt()
        / 0.5;
    let plot = ReproducedPlot {
        title: "torques on Whorl-I in a flat spin".to_owned(),
        caption: "Drag in still air, constant bearing friction, and what eq. 4.25 adds for the rotation of the Earth (largest over tilts of up to 60 deg).".to_owned(),
        labels: ["rate of the spin [rad/s]".to_owned(), "torque [N m]".to_owned()],
        logarithmic: [true, true],
        curves: vec![
            curve("air drag", &drag),
            curve("bearing friction", &|_| BEARING_N_M),
            curve("rotation of the Earth (plumb line as vertical)", &|r| largest(r, true)),
            curve("rotation of the Earth, eq. 4.25 as printed", &|r| largest(r, false)),
        ],
        ..ReproducedPlot::default()
    };
    Reproduction {
        plots: vec![plot],
        sentences: vec![
            format!("{}: at 5 rad/s it is {:.3} N m against {:.1e} N m of the Earth. Areas and bearing friction are not printed and assumed here, so only orders of magnitude compare.", if drag(5.0) > largest(5.0, true) { "As printed, drag dominates in fast spins" } else { "Printed: drag dominates in fast spins. Here it does not" }, drag(5.0), largest(5.0, true)),
            slow_sentence(crossing, largest(crossing, true), told_n_m),
            format!("Eq. 4.25 as printed contains the centrifugal acceleration of the laboratory, a constant torque of {:.1} % of the gravity offset; a vertical taken from a plumb line or an accelerometer has it already.", 100.0 * centrifugal),
            "Tests of whorl_reproduce::rotating_earth compare eq. 4.25 with Lagrange's equations (4.26-4.38).".to_owned(),
        ],
        ..Reproduction::default()
    }
}

/// Whether the Earth may be left out where the platforms are slow: where drag becomes smaller than its torque, and against what
/// the gyro can tell.
pub fn slow_sentence(crossing_rad_s: f64, there_n_m: f64, told_n_m: f64) -> String {
    if !crossing_rad_s.is_finite() {
        return "The printed conclusion (never model the Earth) is not reached here: at no rate that is drawn is drag larger than the Earth's torque.".to_owned();
    }
    let verdict = if there_n_m < told_n_m {
        "so the decision stands for another reason: these sensors do not see it"
    } else {
        "which these sensors would see, so it belongs in the model"
    };
    format!(
        "The printed conclusion (never model the Earth) does not follow from drag in slow motion: below {crossing_rad_s:.2} rad/s drag in still air is smaller than the Earth's torque. Both are then about {there_n_m:.0e} N m; a second of the gyro tells {told_n_m:.0e} N m from its noise, {verdict}."
    )
}
