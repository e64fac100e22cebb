//! What changed between runs, of runs whose change is known.

use std::collections::BTreeMap;

use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_identification::Options;

use super::generator::{Manoeuvre, platform, record, turning};
use crate::trends::trends;

/// A jet loses 30 % of its thrust between two pairs of runs, beside a random torque that no model has: the fits leave
/// something unexplained, and the size of the change must come out all the same.
#[test]
fn a_change_has_its_true_size_beside_what_no_fit_explains() {
    let model = platform();
    let mut sound = model.clone();
    let walk = [
        ("intensity_x_n_m_sqrt_s", 1e-2),
        ("intensity_y_n_m_sqrt_s", 1e-2),
        ("intensity_z_n_m_sqrt_s", 1e-2),
    ];
    let walk: BTreeMap<String, f64> = walk.iter().map(|(name, x)| ((*name).to_owned(), *x)).collect();
    sound.effects.insert("unmodelled_torque".to_owned(), walk);
    let mut weak = sound.clone();
    weak.jets_mut()[2].thrust_n *= 0.7;
    let run = |truth: &PlatformModel, seed| {
        record(truth, &Manoeuvre { seed, duration_s: 60.0, jet_period_s: 0.15, ..turning() })
    };
    let recordings = [run(&sound, 1), run(&sound, 2), run(&weak, 3), run(&weak, 4)];
    let runs: Vec<_> = recordings.iter().zip((0..4).map(|k| 3600.0 * f64::from(k))).collect();
    let prior = ModelPrior::typical(&model);
    let found = trends(&runs, &model, &prior, Some(2), &Options::default(), &mut |_, _| {}).unwrap();
    let first = &found.trends[0];
    assert_eq!(
        (first.group.as_str(), first.name.as_str()),
        ("thruster_strength", model.jets()[2].name.as_str())
    );
    let change = first.change.as_ref().unwrap();
    assert!(change.stddev < 0.1, "{change:?}");
    assert!((change.size + 0.3).abs() < 3.0 * change.stddev, "{change:?}");
}
