//! Every set that was fitted, as it is written.

use whorl_dynamics::PlatformModel;
use whorl_dynamics::platform::TiltLimit;
use whorl_prediction::instants_on_this_thread;

use super::generator::{map, record, wrong_model};
use crate::{FittedSet, Options, Settings, Termination, Verdict, diagnose};

/// Passes over its recordings that a diagnosis of one effect may take: it takes 157, in which some eight sets are fitted to every sample.
const MOST_PASSES: f64 = 170.0;

#[test]
fn sets_that_were_fitted_are_read_back_with_their_worth() {
    // It swings freely: log p jumps where a touch of a stop comes or goes with a parameter, and a fit ends where it should not.
    let mut truth = PlatformModel { tilt_limit: TiltLimit::NONE, ..PlatformModel::whorl_1_reference() };
    truth.effects = map(&[("bearing_viscous_friction", &[("c_n_m_s", 0.05)])]);
    let run = |seed| record(&truth, seed, 50.0, None);
    let (model, prior) = wrong_model(&truth, 3);
    // On one thread, which counts how often it went through the recordings.
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let (diagnosis, instants) = alone.install(|| {
        let before = instants_on_this_thread();
        let found =
            diagnose(&[run(30)], &[run(31)], &model, &prior, &Options::default(), &mut |_| {}).unwrap();
        (found, instants_on_this_thread() - before)
    });
    let passes = instants as f64 / (2.0 * run(30).gyro_b_rad_s.time_s.len() as f64);
    println!("measured: {passes:.0} passes over both recordings");
    assert!(passes < MOST_PASSES, "{passes}");
    assert_eq!(diagnosis.verdict, Verdict::Named, "{:?}", diagnosis.explanations);
    let text: String =
        diagnosis.fitted.iter().map(|set| serde_json::to_string(set).unwrap() + "\n").collect();
    let read: Vec<FittedSet> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(read.len(), diagnosis.fitted.len());

    let sum: f64 = read.iter().map(|set| set.probability).sum();
    assert!((sum - 1.0).abs() < 1e-9, "{sum}");
    let (first, base) =
        (&read[0], read.iter().find(|set| set.effects.is_empty() && set.termination.is_some()).unwrap());
    assert_eq!(first.effects, diagnosis.effects);
    assert!((first.probability - diagnosis.explanations[0].probability).abs() < 1e-9);
    // The order is that of the probabilities, and these follow from log posteriors.
    assert!(read.windows(2).all(|pair| pair[0].probability >= pair[1].probability));
    let odds = (base.log_posterior - first.log_posterior).exp();
    assert!((base.probability / first.probability - odds).abs() < 1e-9 * (1.0 + odds));
    // Held-out runs count as far as the friction brings what they gain.
    let held_out = first.log_posterior - first.log_evidence - first.log_prior;
    assert!(held_out > 0.0 && held_out <= first.held_out_gain.unwrap() + 1e-6, "{held_out}");
    assert!((base.log_evidence + base.log_prior - base.log_posterior).abs() < 1e-6);
    let present = Settings::default().present;
    assert!((first.log_prior - (present / (1.0 - present)).ln()).abs() < 1e-12 && base.log_prior == 0.0);
    // The friction makes the samples likelier, held-out ones too.
    assert!(first.log_evidence > base.log_evidence + 10.0);
    assert!(first.termination == Some(Termination::Converged) && first.seconds > 0.0);
    assert!(first.held_out_gain.unwrap() > 0.0);
    assert_eq!(base.held_out_gain, Some(0.0));
    // The truth is within what is said of it.
    let friction = first.parameters.iter().find(|p| p.name == "c_n_m_s").unwrap();
    assert!((friction.value - 0.05).abs() < 4.0 * friction.stddev.unwrap(), "{friction:?}");
    let moment = base.parameters.iter().find(|p| p.group == "mass_properties").unwrap();
    assert!((1.0..20.0).contains(&moment.value) && moment.stddev.unwrap() > 0.0, "{moment:?}");
    // What was fitted and did not win is not lost.
    assert!(read.len() > 2 && read.iter().all(|set| set.log_posterior.is_finite()));
}
