//! Figures and tables of the dissertation, computed again, beside the printed values.
//!
//! J. L. Schwartz, *The Distributed Spacecraft Attitude Control System Simulator*, Ph.D. dissertation,
//! Virginia Tech, 2004, chapter 4. [`reproduce`] makes one item, [`ITEMS`] lists them. Everything is
//! computed on the spot from simulated data with fixed seeds; nothing is stored.
//!
//! The methods of the dissertation that better ones supersede are here as well: its regressions ([`regression`]), the
//! filter of parameters alone ([`dual`]) and attitude filters ([`comparison`]).

pub mod comparison;
mod data;
pub mod dual;
mod filters;
mod gaussianity;
mod identification;
mod identification_sentences;
mod noise_map;
mod perturbations;
pub mod prepared;
mod printed_tables;
pub mod regression;
pub mod rigid_body;
pub mod rotating_earth;
mod sensors;
mod sequential;
#[cfg(test)]
#[path = "../../whorl_identification/src/tests/simulation.rs"]
mod simulated_runs;
mod spin;
mod spin_sentences;
mod study;
#[cfg(test)]
mod tests;

use whorl_report::Reproduction;

/// Name and contents of everything that can be reproduced, in the order of the dissertation.
pub const ITEMS: [(&str, &str); 22] = [
    ("fig_4_4", "Magnitude of perturbation torques"),
    ("fig_4_7", "Accelerometer calibration data"),
    ("fig_4_8", "Rate gyro calibration data"),
    ("fig_4_9", "Histogram of sensor data and ideal normal distribution"),
    ("fig_4_10", "Estimated attitude and rate, nominal Whorl-I manoeuvre"),
    ("fig_4_11", "Filter error and covariance envelope"),
    ("fig_4_13", "Two-angle attitude"),
    ("fig_4_14", "Two-angle attitude error"),
    ("fig_4_15", "Two-angle attitude error: poor vector sensor, no vector sensor"),
    ("fig_4_16", "Effect of spin rate on the two-angle attitude error, no vector sensor"),
    ("fig_4_17", "Effect of large out-of-plane motion, no vector sensor"),
    ("fig_4_18", "Out-of-plane manoeuvres of Whorl-I and Whorl-II, no vector sensor"),
    ("fig_4_19", "Platform that does not move"),
    ("fig_4_20", "Small x-rotation with a period of 4 s, then 6 s"),
    ("filters", "All filters on the same runs"),
    ("table_4_1", "Parameters from the CAD model"),
    ("fig_4_21", "Natural and integrated form: median error over period and noise"),
    ("table_4_2", "Parameters from perfect data"),
    ("table_4_3", "Parameters from filtered data, two vector sensors"),
    ("table_4_4", "Parameters from filtered data, accelerometer alone"),
    ("manoeuvre", "A designed manoeuvre and the likelihood method"),
    ("sequential", "Convergence of the joint filters"),
];

/// Makes one item; `None` for a name that is not in [`ITEMS`].
#[must_use]
pub fn reproduce(name: &str) -> Option<Reproduction> {
    let (name, title) = ITEMS.iter().find(|(n, _)| *n == name)?;
    let mut item = match *name {
        "fig_4_4" => perturbations::magnitudes(),
        "fig_4_7" => sensors::accelerometer(),
        "fig_4_8" => sensors::gyro(),
        "fig_4_9" => sensors::histogram(),
        "table_4_1" => identification::cad(),
        "table_4_2" => identification::perfect_data(),
        "table_4_3" => identification::filtered(true),
        "table_4_4" => identification::filtered(false),
        "manoeuvre" => identification::manoeuvre(),
        "filters" => filters::comparison(),
        "sequential" => sequential::convergence(),
        "fig_4_21" => noise_map::map(),
        filter => spin::figure(filter)?,
    };
    item.name = (*name).to_owned();
    item.title = format!("{}: {title}", display_name(name));
    Some(item)
}

/// "Figure 4.16" of `fig_4_16`.
fn display_name(name: &str) -> String {
    match name.split_once('_') {
        Some(("fig", number)) => format!("Figure {}", number.replace('_', ".")),
        Some(("table", number)) => format!("Table {}", number.replace('_', ".")),
        _ if name == "filters" => "Section 4.5".to_owned(),
        _ if name == "sequential" => "Section 4.6.5".to_owned(),
        _ => "Beyond Table 4.3".to_owned(),
    }
}
