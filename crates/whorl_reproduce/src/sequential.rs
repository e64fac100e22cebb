//! Convergence of the sequential filters of section 4.6.5, which the dissertation names and does not show.

use nalgebra::{Unit, Vector3};
use whorl_dynamics::ModelPrior;
use whorl_dynamics::mass_parameters::{MassVector, NAMES, mass_properties, mass_vector};
use whorl_estimation::sequential::{JointFilter, JointUpdate, SequentialEstimate};
use whorl_math::attitude_from_vertical;
use whorl_report::{ReproducedPlot, Reproduction};

use crate::data::{measured, rigid_whorl_1};
use crate::identification::designed;
use crate::prepared::prepare;
use crate::rigid_body::simulate_rigid_body;

/// Parameters that are shown: I_xx, I_zz, mgr_z.
const SHOWN: [usize; 3] = [0, 5, 8];

/// Yaw is not moved before this \[s\].
const YAW_FROM_S: f64 = 30.0;
/// I_zz.
const YAW: usize = 5;
/// An error within this counts as found \[%\].
const FOUND_PERCENT: f64 = 1.0;

/// Error of the parameters over time, and three standard deviations, for each filter.
pub fn convergence() -> Reproduction {
    let model = rigid_whorl_1(true);
    let truth = mass_vector(&model.mass_properties);
    let up = Unit::new_normalize(-model.mass_properties.gravity_offset_b_n_m());
    let start = attitude_from_vertical(up, 0.0);
    let rest = (start, Vector3::zeros());
    // I_zz must wait for it.
    let torque = |t: f64| {
        let all = designed(t);
        if t < YAW_FROM_S { Vector3::new(all.x, all.y, 0.0) } else { all }
    };
    let exact = simulate_rigid_body(&model.mass_properties, rest, &torque, 0.01, 10_001, 1);
    let run = measured(&exact, &model, 51, 10);
    let mut off = model.clone();
    if let Ok(mass) = mass_properties(&(truth * 0.9), 110.0) {
        off.mass_properties = mass;
    }
    let mut prior = ModelPrior::typical(&off);
    prior.inertia_b_kg_m2 *= 3.0;
    let Ok(chains) = prepare(&[&run], &off, 0.05) else { return Reproduction::default() };
    let filters = [
        ("extended", JointUpdate::Extended),
        ("iterated", JointUpdate::Iterated { iterations: 3 }),
        ("unscented", JointUpdate::Unscented),
    ];
    let traces: Vec<(&str, Vec<SequentialEstimate>)> = filters
        .into_iter()
        .map(|(name, update)| {
            let mut filter = JointFilter::new(&off, &prior, update, 1.0, start);
            let points = chains.iter().flat_map(|c| &c.points);
            (name, points.filter_map(|p| filter.step(p)).collect())
        })
        .collect();
    let plots = SHOWN.map(|i| {
        let curve = |of: &dyn Fn(&SequentialEstimate) -> f64, trace: &[SequentialEstimate]| {
            trace.iter().map(|e| (e.time_s, of(e))).collect::<Vec<_>>()
        };
        let percent = move |x: f64| 100.0 * x / truth[i].abs();
        let curves: Vec<_> = traces
            .iter()
            .map(|(name, t)| ((*name).to_owned(), curve(&|e| percent(e.estimate[i] - truth[i]), t)))
            .collect();
        let of_first =
            |sign: f64, first: &[SequentialEstimate]| curve(&|e| percent(3.0 * sign * e.stddev()[i]), first);
        ReproducedPlot {
            title: format!("error of {}", NAMES[i]),
            caption:
                "Joint filters, started a tenth off; grey: three standard deviations of the extended filter."
                    .to_owned(),
            labels: ["time [s]".to_owned(), "error [%]".to_owned()],
            curves,
            band_of_all: traces.first().map(|(_, first)| [of_first(-1.0, first), of_first(1.0, first)]),
            ..ReproducedPlot::default()
        }
    });
    Reproduction { plots: plots.to_vec(), sentences: sentences(&traces, &truth), ..Reproduction::default() }
}

/// What the traces show of I_zz before and after yaw is moved, and how far the filters differ.
fn sentences(traces: &[(&str, Vec<SequentialEstimate>)], truth: &MassVector) -> Vec<String> {
    let percent = |x: f64, i: usize| 100.0 * x / truth[i].abs();
    let mut sentences =
        vec!["The dissertation gives the equations (4.92-4.105) and no result; the yaw torque begins late here, so that I_zz must wait.".to_owned()];
    for (name, trace) in traces {
        let waited = trace.iter().rfind(|e| e.time_s < YAW_FROM_S);
        let (Some(first), Some(waited)) = (trace.first(), waited) else { continue };
        let kept = 100.0 * waited.stddev()[YAW] / first.stddev()[YAW];
        let off = |e: &SequentialEstimate| percent(e.estimate[YAW] - truth[YAW], YAW);
        let last_off = trace.iter().rfind(|e| off(e).abs() > FOUND_PERCENT);
        let found = match last_off {
            Some(e) if trace.last().is_some_and(|last| last.time_s <= e.time_s) => {
                format!("it is not found within {FOUND_PERCENT} %")
            }
            Some(e) if e.time_s >= YAW_FROM_S => {
                format!("it stays within {FOUND_PERCENT} % from {:.1} s after that on", e.time_s - YAW_FROM_S)
            }
            _ => "it had been found before".to_owned(),
        };
        sentences.push(format!(
            "{name}: until yaw is moved at {YAW_FROM_S} s, I_zz keeps {kept:.0} % of its standard deviation and is {:+.1} % off (at first {:+.1} %); {found}.",
            off(waited),
            off(first)
        ));
    }
    let differ_percent = SHOWN
        .iter()
        .map(|i| {
            let ends = || traces.iter().filter_map(|(_, t)| t.last()).map(|e| percent(e.estimate[*i], *i));
            ends().fold(f64::NEG_INFINITY, f64::max) - ends().fold(f64::INFINITY, f64::min)
        })
        .fold(0.0, f64::max);
    let verdict = if differ_percent < 0.5 {
        "over a sample the equations are nearly linear at these angles"
    } else {
        "what the equations' curvature is worth shows"
    };
    sentences.push(format!(
        "In the end the filters differ by {differ_percent:.3} % of a parameter at most: {verdict}."
    ));
    sentences
}
