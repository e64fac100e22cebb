//! In what a varied model differs is told from the models, whatever their sensors' noise: what shows in the filter's state alone needs no
//! motion of its own, and a pass over hundreds of columns is several times as fast.

use std::collections::BTreeMap;

use super::generator::{Manoeuvre, platform, record};
use crate::other::Other;
use crate::perturbed::Differs;
use crate::prepared::Prepared;
use crate::settings::Settings;

#[test]
fn what_an_effect_changes_is_known_before_the_pass() {
    let model = platform();
    let is_noisy = model.sensors.gyro.errors.noise_stddev != nalgebra::Vector3::zeros();
    assert!(is_noisy, "the filter's plant has no noise, and the model must not differ by it");
    let recording = record(&model, &Manoeuvre { duration_s: 8.0, ..Manoeuvre::default() });
    let case = Prepared::new(&recording, &model, Settings::default()).unwrap();
    let differs = |id: &str| {
        let effect = whorl_dynamics::effects::find(id).unwrap();
        let mut values: BTreeMap<String, f64> = BTreeMap::new();
        for (i, spec) in effect.parameters(&model).into_iter().enumerate() {
            values.insert(spec.name, spec.neutral + if i == 0 { 1e-2 * spec.prior_stddev } else { 0.0 });
        }
        let mut varied = model.clone();
        varied.effects.insert(id.to_owned(), values);
        Other::new(&case, &varied, 1.0).unwrap().differs
    };
    for (id, expected) in [
        ("bearing_viscous_friction", Differs::InTorque),
        ("gravity_offset", Differs::InTorque),
        ("inertia_products", Differs::InTorque),
        ("gyro_scale", Differs::InReadings),
        ("thruster_strength", Differs::InJets),
        ("thruster_delay", Differs::WithinSteps),
    ] {
        assert_eq!(differs(id), expected, "{id}");
    }
}
