//! Effects that begin within a run, in the judge's own equations: a valve that clogs, a cable that snags.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test fails by panicking")]

use whorl_challenge::cases::build::{Stand, breaking, stand_key};
use whorl_challenge::cases::{Laboratory, Spec, all_specs};
use whorl_diagnosis::{Change, Diagnosis, Options, Verdict, diagnose};

/// A platform that breaks in its second run at this time.
fn broken(key: &str, effect: &str, values: &[(String, f64)], at_s: f64) -> (Diagnosis, Change) {
    let laboratory = Laboratory::whorl_1().unwrap();
    let spec: Spec = all_specs(1, false).into_iter().find(|s| s.key() == key).unwrap();
    let stand = Stand::new(&laboratory, &stand_key(&spec), &spec);
    let values = values.iter().cloned().collect();
    let (training, held_out) = breaking(&stand, &laboratory, key, (effect, values), 1, at_s).unwrap();
    let (model, prior) = (&laboratory.model, &laboratory.prior);
    let found = diagnose(&training, &held_out, model, prior, &Options::default(), &mut |_| {}).unwrap();
    println!("{:#?}", found.answer());
    assert_eq!(found.verdict, Verdict::Named, "{:?}", found.effects);
    assert_eq!(found.effects, [effect]);
    let change = found.changes[0].clone();
    assert_eq!(change.run, training[1].name, "{change:?}");
    assert!(change.in_later_runs, "{change:?}");
    (found, change)
}

#[test]
fn a_valve_that_clogs_is_named_with_its_onset() {
    if !whorl_tests::slow("the onset of a clogged valve, in the judge's equations") {
        return;
    }
    let key = "single/thruster_strength/100/0";
    let jet = 3;
    let (_, change) = broken(key, "thruster_strength", &[(format!("jet_{jet}"), -0.4)], 43.0);
    let onset = change.onset.unwrap();
    // It shows at the jet's next pulse only: the interval spans the pause before it.
    assert!((onset.from_s - 0.2..onset.to_s + 0.2).contains(&43.0), "{onset:?}");
    let own = change.parameters.iter().find(|p| p.name.contains(&jet.to_string())).unwrap();
    assert!((own.after + 0.4).abs() < 4.0 * own.after_stddev + 0.04, "{own:?}");
}

#[test]
fn a_cable_that_snags_is_named_with_its_onset() {
    if !whorl_tests::slow("the onset of a snagged cable, in the judge's equations") {
        return;
    }
    let key = "single/bearing_viscous_friction/100/0";
    let (_, change) = broken(key, "bearing_viscous_friction", &[("c_n_m_s".to_owned(), 0.06)], 31.5);
    let onset = change.onset.unwrap();
    assert!((onset.at_s - 31.5).abs() < 4.0 * onset.stddev_s + 0.1 && onset.stddev_s < 4.0, "{onset:?}");
}
