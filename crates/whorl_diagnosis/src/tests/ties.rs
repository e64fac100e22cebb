//! Explanations that data cannot tell apart are both kept.

use std::collections::BTreeMap;

use nalgebra::DVector;
use whorl_dynamics::{ModelPrior, PlatformModel};

use super::generator::{map, record, wrong_model};
use crate::evidence::problem::Problem;
use crate::evidence::regression::Normal;
use crate::parameters::Reference;
use crate::search::Search;
use crate::{Options, Verdict, diagnose};

/// Runs `test` on the search at the start of a run in which nothing is missing, with another held out.
fn with_search(test: impl FnOnce(&mut Search<'_>)) {
    let model = PlatformModel::whorl_1_reference();
    let runs = [record(&model, 8, 20.0, None), record(&model, 9, 20.0, None)];
    let reference = Reference::new(&model, &ModelPrior::typical(&model));
    let new = |run| Problem::new(std::slice::from_ref(run), reference.clone(), 40.0, 1).unwrap();
    let (mut problem, mut held) = (new(&runs[0]), new(&runs[1]));
    let options = Options::default();
    test(&mut Search::start(&mut problem, Some(&mut held), &options, &mut |_| {}).unwrap());
}

fn candidate(search: &Search<'_>, id: &str) -> usize {
    search.design.candidates.iter().position(|c| c.id == id).unwrap()
}

#[test]
#[ignore = "slow: a tie from one run"]
fn torques_that_no_motion_tells_apart_are_both_kept() {
    // A steady torque about the vertical: from the bearing or from the air of the room.
    let mut truth = PlatformModel::whorl_1_reference();
    truth.effects = map(&[("bearing_turbine", &[("vertical_n_m", 0.01)])]);
    let run = record(&truth, 41, 50.0, None);
    let (model, prior) = wrong_model(&truth, 41);
    let diagnosis =
        diagnose(std::slice::from_ref(&run), &[], &model, &prior, &Options::default(), &mut |_| {}).unwrap();
    let (effects, others) = (&diagnosis.effects, &diagnosis.confounded_with);
    assert_eq!(diagnosis.verdict, Verdict::Confounded, "{effects:?} {others:?}");
    for id in ["air_current", "bearing_turbine"] {
        assert!(
            effects.iter().chain(others.iter().flatten()).any(|e| e == id),
            "{id}: {effects:?} {others:?}"
        );
    }
}

#[test]
fn a_cable_without_stiffness_is_no_cable() {
    with_search(|search| {
        let cable = candidate(search, "harness_spring");
        let options = &search.design.candidates[cable].options;
        let damped = options.iter().find(|o| o.len() == 2).unwrap();
        // Parameters of the cable that explain this stiffness and this damping, in standard deviations, each with its value; `None`: none
        // is taken.
        let explained = |stiffness: f64, damping: f64| -> Option<BTreeMap<usize, f64>> {
            let mut signal = DVector::zeros(search.design.columns.len());
            for (column, size) in damped.iter().zip([stiffness, damping]) {
                signal[*column] = size / search.data.total.matrix[(*column, *column)].sqrt();
            }
            let mut shown: Normal = search.data.total.clone();
            shown.vector += &shown.matrix * &signal;
            let fit = search.base.with(&search.design, &shown, cable)?;
            let columns = fit.terms[0].columns.iter();
            Some(columns.map(|i| (search.design.columns[*i].index, fit.estimate.of(*i))).collect())
        };
        let whole = explained(20.0, 40.0).expect("a cable with stiffness and damping is one");
        assert!(whole[&0] > 0.0 && whole.len() == 2, "{whole:?}");
        // Damping beside a stiffness below zero: no cable, unless one that rests at another heading is stiff there.
        let none = explained(-20.0, 40.0);
        assert!(none.as_ref().is_none_or(|found| found.get(&0).is_some_and(|k| *k > 0.0)), "{none:?}");
    });
}
