use super::*;

fn weighted(effects: &[&str], probability: f64) -> FittedSet {
    FittedSet {
        effects: effects.iter().map(|e| (*e).to_owned()).collect(),
        log_posterior: probability.ln(),
        probability: 1.0,
        ..FittedSet::default()
    }
}

#[test]
fn a_verdict_is_read_off_the_probabilities() {
    let verdict = |list: &[(&[&str], f64)]| {
        let all = list.iter().map(|(set, p)| weighted(set, *p)).collect();
        Posterior::new(all, &Settings::default()).verdict(true)
    };
    assert_eq!(verdict(&[(&["a"], 0.97), (&["b"], 0.02), (&[], 0.01)]), Verdict::Named);
    assert_eq!(verdict(&[(&["a"], 0.70), (&["b"], 0.29), (&[], 0.01)]), Verdict::Confounded);
    assert_eq!(verdict(&[(&["a"], 0.20), (&[], 0.80)]), Verdict::NotEnoughInformation);
    assert_eq!(verdict(&[(&["a"], 0.03), (&[], 0.97)]), Verdict::NothingMissing);
    let posterior = Posterior::new(
        vec![weighted(&["b"], 0.3), weighted(&["a"], 0.6), weighted(&["c"], 0.1)],
        &Settings::default(),
    );
    assert_eq!(posterior.contenders(), [["a"], ["b"], ["c"]]);
    assert!((posterior.sets[0].probability - 0.6).abs() < 1e-12);
    // Something unknown beside a friction that is there in any case is said with it, not in its place.
    let with = |effects: &[&str], probability: f64| FittedSet {
        unmodelled: Some(Unknown::torque_in_time(1.0)),
        ..weighted(effects, probability)
    };
    let beside = Posterior::new(vec![with(&["a"], 0.9), weighted(&["a"], 0.1)], &Settings::default());
    assert_eq!((beside.verdict(true), beside.included()), (Verdict::Named, vec!["a".to_owned()]));
    let instead = Posterior::new(vec![with(&["a"], 0.5), with(&[], 0.5)], &Settings::default());
    assert_eq!(instead.verdict(true), Verdict::Unknown);
}
