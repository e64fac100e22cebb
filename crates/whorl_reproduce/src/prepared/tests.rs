//! Joint filters on prepared runs.

use whorl_dynamics::PlatformModel;
use whorl_dynamics::mass_parameters::{MASS_PARAMETERS, NAMES, mass_vector};
use whorl_estimation::sequential::{JointFilter, JointUpdate, SequentialEstimate};
use whorl_recording::Recording;

use super::prepare;
use crate::simulated_runs::{at_balance, prior, record, swinging, truth, wrong_model};

fn joint(
    truth: &PlatformModel,
    run: &Recording,
    update: JointUpdate,
    forgetting: f64,
) -> Vec<SequentialEstimate> {
    let model = wrong_model(truth);
    let chains = prepare(&[run], &model, 0.05).unwrap();
    let mut filter = JointFilter::new(&model, &prior(&model), update, forgetting, at_balance(truth));
    chains.iter().flat_map(|c| &c.points).filter_map(|p| filter.step(p)).collect()
}

#[test]
fn joint_filters_converge_to_the_truth() {
    let truth = truth();
    let run = record(&truth, at_balance(&truth), 100.0, 1, &swinging);
    let t = mass_vector(&truth.mass_properties);
    for update in [JointUpdate::Extended, JointUpdate::Iterated { iterations: 3 }, JointUpdate::Unscented] {
        let all = joint(&truth, &run, update, 1.0);
        let last = all.last().unwrap();
        for i in 0..MASS_PARAMETERS {
            println!(
                "{update:?} {} {:.4} true {:.4} +- {:.4}",
                NAMES[i],
                last.estimate[i],
                t[i],
                last.stddev()[i]
            );
            let allowed = (0.05 * t[i].abs()).max(if i < 6 { 0.03 } else { 0.004 });
            assert!((last.estimate[i] - t[i]).abs() < allowed, "{update:?} {}", NAMES[i]);
        }
    }
}

/// Only roll moves, and lambda is small: I_zz must keep its value and its uncertainty.
#[test]
fn an_unexcited_parameter_does_not_wander() {
    let truth = truth();
    let roll = |t: f64| vec![0.03 * (1.1 * t).sin(), 0.0, 0.0];
    let run = record(&truth, at_balance(&truth), 100.0, 2, &roll);
    let before = mass_vector(&wrong_model(&truth).mass_properties)[5];
    let all = joint(&truth, &run, JointUpdate::Extended, 0.98);
    for e in &all {
        let sigma = e.prior_stddev[5];
        assert!((e.estimate[5] - before).abs() < 0.6 * sigma, "{} s: {}", e.time_s, e.estimate[5]);
        assert!(e.stddev()[5] <= 1.001 * sigma, "{}", e.stddev()[5]);
    }
    let last = all.last().unwrap();
    assert!(last.stddev()[5] > 0.7 * last.prior_stddev[5]);
    // Roll itself was identified.
    assert!(last.stddev()[0] < 0.3 * last.prior_stddev[0]);
}
