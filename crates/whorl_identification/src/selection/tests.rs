use std::collections::BTreeMap;

use nalgebra::DMatrix;
use whorl_dynamics::effects::find;
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_prediction::Fitted;

use super::hypothesis::starts;
use super::{Evaluated, Hypothesis, Selection};
use crate::case::Case;
use crate::fitting::refit::{Entered, Refit};
use crate::parameter_space::Reference;
use crate::parameter_space::available::Available;
use crate::tests::diagnoses::generator::{map, record, wrong_model};
use crate::{Options, Settings};

fn is_borne_out(own: f64, held: f64, expected: impl Into<Option<f64>>) -> bool {
    super::is_borne_out(own, held, expected.into(), &Settings::default())
}

#[test]
fn held_out_data_must_gain_what_they_would_if_the_effect_were_there() {
    // Twenty nats are expected, with a deviation of the root of forty.
    assert!(is_borne_out(100.0, 20.0, 20.0) && is_borne_out(100.0, 1.0, 20.0));
    assert!(!is_borne_out(100.0, -1.0, 20.0));
    // Of a strong effect whose formula is another it is enough that half of its size is there.
    assert!(is_borne_out(1000.0, 10.0, 250.0) && !is_borne_out(1000.0, -10.0, 250.0));
    // Runs that do not excite it say nothing,
    assert!(is_borne_out(100.0, -1.0, 0.5) && is_borne_out(100.0, -0.4, 0.0));
    // unless they are much less likely with it.
    assert!(!is_borne_out(100.0, -15.0, 0.5));
    // Where nobody knows what to expect, only that counts.
    assert!(is_borne_out(100.0, -10.0, None) && !is_borne_out(100.0, -15.0, None));
}

/// A panel on a slant that has nine tenths of the inertia: beside the given one there is room for it, and beside one that a model without it
/// was bent to there is none.
#[test]
fn a_fit_of_hidden_states_begins_where_a_platform_can_be() {
    let model = PlatformModel::whorl_1_reference();
    let available = Available::of(&[record(&model, 1, 2.0, None)], &model);
    let inertia_kg_m2 = model.mass_properties.inertia_b_kg_m2()[(0, 0)];
    let (prior, settings) = (ModelPrior::typical(&model), Settings::default());
    let reference = Reference { model, prior, settings };
    let effect = find("flexible_mode").unwrap();
    let participation = (0.45 * inertia_kg_m2).sqrt();
    let values = vec![participation, participation, 0.0, 1.5, 0.01];
    let entered = BTreeMap::from([(
        "flexible_mode",
        Entered { indices: vec![0, 1, 3, 4], size: 1.0, choice_nats: 0.0 },
    )]);
    let mut point = reference.point();
    point.insert("flexible_mode", values);
    let hypothesis = Hypothesis { effects: vec!["flexible_mode"], point, entered, ..Hypothesis::default() };
    let own = Refit::own(&reference, &available);
    let mut refit = own.clone();
    refit.add(effect, &hypothesis.point, hypothesis.entered.get("flexible_mode"));
    let of_share = |share: f64| {
        let mut at = vec![0.0; own.columns.len()];
        at[0] = (share - 1.0) * inertia_kg_m2 / own.columns[0].scale;
        assert!(own.model_at(&at).is_some(), "the platform without the panel");
        let n = at.len();
        let fitted = Fitted {
            at,
            covariance: DMatrix::identity(n, n),
            at_bound: vec![false; n],
            followed: Vec::new(),
            log_posterior: 0.0,
            log_posterior_before: 0.0,
            log_evidence: 0.0,
            levels_nats: 0.0,
            stands: true,
        };
        let base = Evaluated {
            hypothesis: Hypothesis::default(),
            fitted,
            columns: own.columns.clone(),
            stddevs: own.stddevs.clone(),
            held_out: Vec::new(),
            log_evidence: 0.0,
            quiet_log_posterior: 0.0,
            held_out_log: 0.0,
            held_out_expected: None,
            gains_at_levels: Vec::new(),
            seconds: 0.0,
        };
        let starts = starts(&refit, &hypothesis, &[&base]);
        assert!(starts.len() == 1 && refit.model_at(&starts[0]).is_some(), "{share}: {starts:?}");
        (starts[0][0], base.fitted.at[0])
    };
    // Beside the other set where that can be; else as proposed.
    let (begins, of_base) = of_share(0.98);
    assert_eq!(begins, of_base);
    let (begins, of_base) = of_share(0.8);
    assert!(begins == 0.0 && of_base < 0.0, "{begins}");
}

/// Readings that are late look like jets that are. Beside jets that are late the samples say that the readings are, in their place.
#[test]
fn what_stood_in_for_another_effect_is_exchanged_for_it() {
    let mut truth = PlatformModel::whorl_1_reference();
    truth.effects = map(&[("imu_latency", &[("t_s", 0.03)])]);
    let runs = [record(&truth, 7, 30.0, None)];
    let (model, prior) = wrong_model(&truth, 7);
    let options = Options::default();
    let case = Case::new(&runs, &[], &model, &prior, &options).unwrap();
    let mut selection = Selection::begun(case.runs(), &options).unwrap();
    let asked = ["imu_latency", "thruster_rise", "mass_shift"].map(|id| find(id).unwrap()).to_vec();
    let late_jets = selection.with(&["thruster_delay"]).unwrap().unwrap();
    let beside = selection.beside_of(&late_jets, asked).unwrap().unwrap();
    selection.evaluated.push(late_jets);
    let proposals = beside.proposals(false, &selection.evaluated);
    let exchanged = proposals.iter().find(|of| of.hypothesis.effects == ["imu_latency"]).unwrap();
    let late_s = exchanged.hypothesis.point["imu_latency"][0];
    assert!((late_s - 0.03).abs() < 0.01, "{late_s}");
    assert!(!exchanged.hypothesis.point.contains_key("thruster_delay"));
}
