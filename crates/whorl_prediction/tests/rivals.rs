//! Models that compete with another one, whose states may be others.

#![expect(clippy::unwrap_used, reason = "a test stops at a broken precondition")]

mod rigs;
mod table;

use std::collections::BTreeMap;

use table::{TABLE, Table};
use whorl_dynamics::PlatformModel;
use whorl_prediction::{Fitted, Parameter, Rival, Settings, fit};
use whorl_recording::Recording;

/// The model with a sloshing mass of this share, which has hidden states, or with none of it.
fn sloshing(model: &PlatformModel, share: f64) -> PlatformModel {
    let mut model = model.clone();
    let values = [("mass_ratio", share), ("frequency_hz", 0.8), ("damping_ratio", 0.05)];
    let values: BTreeMap<String, f64> = values.map(|(name, x)| (name.to_owned(), x)).into();
    model.effects.insert("slosh".to_owned(), values);
    model
}

/// The torque of its friction, and with it the mass where `sloshes`.
fn fitted(run: &Recording, model: &PlatformModel, sloshes: bool, rival: Option<&Fitted>) -> Fitted {
    let model_at = |at: &[f64]| {
        let mut model = if sloshes { sloshing(model, 0.01 * at[1]) } else { model.clone() };
        let friction = [("c_n_m_s".to_owned(), 0.01 * at[0])];
        model.effects.insert("bearing_viscous_friction".to_owned(), friction.into());
        Some(model)
    };
    let count = if sloshes { 2 } else { 1 };
    let parameters = vec![Parameter { stddev: 1.0, range: (0.0, 10.0) }; count];
    let (starts, settings) = ([vec![0.5; count]], Settings::default());
    let found = match rival {
        Some(rival) => {
            let rival = Rival { followed: &rival.followed, ..Rival::NONE };
            fit(std::slice::from_ref(run), &parameters, &model_at, &starts, rival, &settings)
        }
        None => fit(std::slice::from_ref(run), &parameters, &model_at, &starts, Rival::NONE, &settings),
    };
    found.unwrap()
}

/// What is known of one rig's states and noise is of no use to the other: each is fitted as if it were alone.
#[test]
fn a_rival_may_have_other_states() {
    let bearings = (0..200).map(rigs::drawn).filter(|rig| {
        let model = &rig.model;
        model.freedom == whorl_dynamics::Freedom::OnBearing && model.sensors.rate_hz > 30.0
    });
    for rig in bearings.take(1) {
        let (run, model) = (&rig.recording, &rig.model);
        let [with, without] = [true, false].map(|sloshes| fitted(run, model, sloshes, None));
        for (sloshes, alone, rival) in [(true, &with, &without), (false, &without, &with)] {
            let beside = fitted(run, model, sloshes, Some(rival));
            let apart = (beside.log_posterior - alone.log_posterior).abs();
            assert!(apart < 0.5, "{}: {apart} nats", rig.what);
        }
    }
}

/// A drag that the model lacks is slow, and a random torque explains it as well. Beside a rival that has such a torque it is found where the fit begins
/// without: all of it, and no torque is left.
#[test]
fn what_random_torques_explain_of_a_rival_is_found_without_them() {
    let table = Table { drag_n_m_s2: 0.03, wave_rad_s: 0.3, ..TABLE };
    let run = [table.turned(5).0];
    let model_at = |at: &[f64]| {
        let mut model = table.model();
        let drag = [("dz_n_m_s2".to_owned(), 0.1 * at.first().unwrap_or(&0.0))];
        model.effects.insert("air_drag_quadratic".to_owned(), drag.into());
        Some(model)
    };
    let settings = Settings::default();
    let without = fit(&run, &[], &model_at, &[vec![]], Rival::NONE, &settings).unwrap();
    assert!(without.levels_nats > 0.0, "a random torque stands for the drag");
    let parameters = [Parameter { stddev: 1.0, range: (0.0, 10.0) }];
    let rival = Rival { followed: &without.followed, quiet: true, ..Rival::NONE };
    let with = fit(&run, &parameters, &model_at, &[vec![0.0]], rival, &settings).unwrap();
    let off = (0.1 * with.at[0] - table.drag_n_m_s2) / (0.1 * with.covariance[(0, 0)].sqrt());
    assert!(off.abs() < 3.0, "{off:.1} deviations off");
    assert_eq!(with.levels_nats, 0.0);
    let gained = with.log_evidence - without.log_evidence;
    println!("measured: {gained:.1} nats, the drag {off:.1} deviations off");
    assert!(gained > 5.0, "{gained:.1} nats");
}
