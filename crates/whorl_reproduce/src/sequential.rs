//! Convergence of the sequential filters of section 4.6.5, which the dissertation names and does not show.

use nalgebra::{Unit, Vector3};
use whorl_dynamics::ModelPrior;
use whorl_identification::data::prepare;
use whorl_identification::mass_parameters::{NAMES, mass_properties, mass_vector};
use whorl_identification::sequential::{JointFilter, JointUpdate, SequentialEstimate};
use whorl_math::attitude_from_vertical;
use whorl_report::{ReproducedPlot, Reproduction};

use crate::data::{measured, rigid_whorl_1};
use crate::identification::designed;
use crate::rigid_body::simulate_rigid_body;

/// Parameters that are shown: I_xx, I_zz, mgr_z.
const SHOWN: [usize; 3] = [0, 5, 8];

/// Error of the parameters over time, and three standard deviations, for each filter.
pub fn convergence() -> Reproduction {
    let model = rigid_whorl_1(true);
    let truth = mass_vector(&model.mass_properties);
    let up = Unit::new_normalize(-model.mass_properties.gravity_offset_b_n_m());
    let start = attitude_from_vertical(up, 0.0);
    let rest = (start, Vector3::zeros());
    // Yaw is not moved before 30 s: I_zz must wait for it.
    let torque = |t: f64| {
        let all = designed(t);
        if t < 30.0 { Vector3::new(all.x, all.y, 0.0) } else { all }
    };
    let exact = simulate_rigid_body(&model.mass_properties, rest, &torque, 0.01, 10_001, 1);
    let run = measured(&exact, &model, 51, 10);
    let mut off = model.clone();
    if let Ok(mass) = mass_properties(&(truth * 0.9), 110.0) {
        off.mass_properties = mass;
    }
    let mut prior = ModelPrior::typical(&off);
    prior.inertia_b_kg_m2 *= 3.0;
    let Ok(data) = prepare(&[&run], &off, 0.05) else { return Reproduction::default() };
    let filters = [
        ("extended", JointUpdate::Extended),
        ("iterated", JointUpdate::Iterated { iterations: 3 }),
        ("unscented", JointUpdate::Unscented),
    ];
    let traces: Vec<(&str, Vec<SequentialEstimate>)> = filters
        .into_iter()
        .map(|(name, update)| {
            let mut filter = JointFilter::new(&off, &prior, update, 1.0, start);
            let points = data.chains.iter().flat_map(|c| &c.points);
            (name, points.filter_map(|p| filter.step(p)).collect())
        })
        .collect();
    let plots = SHOWN.map(|i| {
        let curve = |of: &dyn Fn(&SequentialEstimate) -> f64, trace: &[SequentialEstimate]| {
            trace.iter().map(|e| (e.time_s, of(e))).collect::<Vec<_>>()
        };
        let percent = move |x: f64| 100.0 * x / truth[i].abs();
        let mut curves: Vec<_> = traces
            .iter()
            .map(|(name, t)| ((*name).to_owned(), curve(&|e| percent(e.estimate[i] - truth[i]), t)))
            .collect();
        if let Some((_, first)) = traces.first() {
            for sign in [1.0, -1.0] {
                curves
                    .push(("three sigma".to_owned(), curve(&|e| percent(3.0 * sign * e.stddev()[i]), first)));
            }
        }
        ReproducedPlot {
            title: format!("error of {}", NAMES[i]),
            caption: "Joint filters, started a tenth off; three standard deviations of the extended filter."
                .to_owned(),
            labels: ["time [s]".to_owned(), "error [%]".to_owned()],
            curves,
            ..ReproducedPlot::default()
        }
    });
    Reproduction {
        plots: plots.to_vec(),
        sentences: vec![
            "The dissertation gives the equations (4.92-4.105) and no result. Here the yaw torque begins at 30 s: until then I_zz keeps its value and its uncertainty, then it is found within seconds. The three filters agree: at these small angles the equations are nearly linear over a sample.".to_owned(),
        ],
        ..Reproduction::default()
    }
}
