//! When two explanations are both kept, and when a member of a set is refuted.

use nalgebra::DVector;
use rand_pcg::Pcg64Mcg;
use whorl_dynamics::{ModelPrior, PlatformModel};

use super::generator::{map, normal, random, record, wrong_model};
use crate::parameters::Reference;
use crate::problem::Problem;
use crate::regression::Normal;
use crate::search::Search;
use crate::ties::systematic;
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
    search.layout.candidates.iter().position(|c| c.id == id).unwrap()
}

fn noise(rng: &mut Pcg64Mcg, size: usize) -> DVector<f64> {
    DVector::from_fn(size, |_, _| normal(rng))
}

#[test]
fn noise_rarely_lets_the_wrong_one_lead_by_a_tie() {
    with_search(|search| {
        let tie = search.tie(0.0);
        let mut rng = random(3);
        // Two signals that differ by so many standard deviations of the noise: how often the wrong one leads by more.
        for distance in [0.5, 1.0, 2.0, 3.0, 4.0, 6.0] {
            let difference = DVector::from_element(4, 0.5 * distance);
            let trials = 20_000;
            let wrong = (0..trials)
                .filter(|_| {
                    let noise = noise(&mut rng, 4);
                    0.5 * (noise.norm_squared() - (&noise + &difference).norm_squared()) > tie
                })
                .count();
            let share = wrong as f64 / f64::from(trials);
            assert!(share < 0.012, "{distance} standard deviations apart: {share}");
        }
    });
}

#[test]
fn an_error_of_the_formula_rarely_lets_the_wrong_one_lead_by_a_tie() {
    let mut rng = random(4);
    let (size, drop) = (40, 1e6_f64);
    for error in [0.001, 0.003, 0.01, 0.03] {
        for distance in [5.0, 20.0, 80.0] {
            let trials = 4000;
            let (mut wrong, mut told) = (0, 0);
            for _ in 0..trials {
                // In any direction of the space of motions.
                let direction = noise(&mut rng, size);
                let scale = error * drop.sqrt() / direction.norm();
                let left = direction * scale + noise(&mut rng, size);
                let mut of_rival = left.clone();
                of_rival[0] += distance;
                let lead = 0.5 * (of_rival.norm_squared() - left.norm_squared());
                let rest = left.norm_squared().min(of_rival.norm_squared()) - size as f64;
                let tie = 3.0 + systematic(drop, rest + 2.0 * (2.0 * size as f64).sqrt());
                wrong += i32::from(lead < -tie);
                told += i32::from(lead > tie);
            }
            let share = f64::from(wrong) / f64::from(trials);
            assert!(share < 0.02, "error {error}, {distance} apart: {share} wrong");
            // Far apart for so small an error, they are told from one another.
            if distance > 20.0 && error < 0.03 {
                assert!(told > 9 * trials / 10, "error {error}: {told} of {trials} told apart");
            }
        }
    }
}

#[test]
fn a_rival_is_refuted_by_a_worse_fit_and_not_by_its_price() {
    with_search(|search| {
        let small = search.tie(0.0);
        assert!(search.is_tie((-0.9 * small, -100.0), 0.0) && !search.is_tie((-1.1 * small, -100.0), 0.0));
        // As good a fit, with more parameters to pay for.
        assert!(search.is_tie((-2.0 * small, 0.0), 0.0) && !search.is_tie((-50.0, 0.0), 0.0));
        // Of a large effect a formula that is off by half a percent of it decides nothing: (0.5 %)^2 of the drop.
        let drop = 4e6;
        let half_a_percent = 0.5 * 0.005_f64.powi(2) * drop;
        assert!(search.is_tie((-half_a_percent, -1e3), drop) && !search.is_tie((-half_a_percent, -1e3), 0.0));
        // One that is off by a tenth does.
        assert!(!search.is_tie((-0.5 * 0.1_f64.powi(2) * drop, -1e4), drop));
        // Nor is a formula off by half a percent where all that it leaves is within noise.
        search.rest = 100.0;
        assert!(!search.is_tie((-half_a_percent, -1e3), drop));
    });
}

#[test]
fn torques_that_no_motion_tells_apart_are_both_kept() {
    if !whorl_tests::slow("a tie from one run") {
        return;
    }
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
fn a_member_that_does_in_no_other_run_what_it_promises_is_refuted() {
    with_search(|search| {
        // Training data that show a friction, and a steady torque beside it.
        let (first, second) =
            (candidate(search, "bearing_viscous_friction"), candidate(search, "bearing_turbine"));
        let mut signal = DVector::zeros(search.layout.columns.len());
        for c in [first, second] {
            let column = search.layout.candidates[c].options[0][0];
            // 400 units of misfit each in the training data.
            signal[column] = 20.0 / search.data.total.matrix[(column, column)].sqrt();
        }
        let mut shown: Normal = search.data.total.clone();
        shown.vector += &shown.matrix * &signal;
        let one = search.base.with(&search.layout, &shown, first).unwrap();
        let both = one.with(&search.layout, &shown, second).unwrap();
        // The held-out run shows neither.
        let gain = search.gain(&both, &one);
        assert!(search.falls_short(&both, &one, gain), "{gain}");
        // Now it shows both.
        let held = &mut search.held_data.as_mut().unwrap().total;
        held.vector += &held.matrix * &signal;
        let gain = search.gain(&both, &one);
        assert!(!search.falls_short(&both, &one, gain), "{gain}");
    });
}

#[test]
fn a_cable_without_stiffness_is_no_cable() {
    with_search(|search| {
        let cable = candidate(search, "harness_spring");
        let options = &search.layout.candidates[cable].options;
        let damped = options.iter().find(|o| o.len() == 2).unwrap();
        let mut signal = DVector::zeros(search.layout.columns.len());
        for (column, size) in damped.iter().zip([-20.0, 40.0]) {
            signal[*column] = size / search.data.total.matrix[(*column, *column)].sqrt();
        }
        // Damping beside a stiffness below zero, whatever heading the cable rests at.
        let mut shown: Normal = search.data.total.clone();
        shown.vector += &shown.matrix * &signal;
        if let Some(fit) = search.base.with(&search.layout, &shown, cable) {
            let columns = fit.members[0].columns.iter().map(|i| &search.layout.columns[*i]);
            assert!(columns.map(|c| c.index).any(|i| i == 0), "{:?}", fit.members);
        }
    });
}
