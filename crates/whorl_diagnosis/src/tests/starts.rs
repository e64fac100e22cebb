//! Where hidden states are when a recording begins.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use whorl_dynamics::{ModelPrior, PlatformModel};

use super::generator::{map, record};
use crate::evidence::problem::{Problem, ProcessNoise};
use crate::parameters::Reference;

/// An appendage that still swings from before the recording. Its equation is linear, so that it is one at rest, in the plant, and a
/// free swing beside it, by its closed form, that pushes from outside.
#[test]
fn an_appendage_that_swings_when_the_recording_begins_is_seen_to() {
    let (participation, hz, damping, eta_start) = (0.3, 1.5, 0.01, 0.02);
    let mut model = PlatformModel::whorl_1_reference();
    model.tilt_limit = whorl_dynamics::platform::TiltLimit::Cone { max_rad: 0.5 };
    let mode =
        [("participation_x_sqrt_kg_m", participation), ("frequency_hz", hz), ("damping_ratio", damping)];
    model.effects = map(&[("flexible_mode", &mode)]);
    let (w, decay) = (TAU * hz, damping * TAU * hz);
    let wd = w * f64::sqrt(1.0 - damping * damping);
    // From a deflection, at rest: g = d (2 zeta w eta' + w^2 eta).
    let push = |t: f64| {
        let envelope = eta_start * (-decay * t).exp();
        let eta = envelope * ((wd * t).cos() + decay / wd * (wd * t).sin());
        let eta_rate = -envelope * w * w / wd * (wd * t).sin();
        Vector3::x() * (participation * (2.0 * decay * eta_rate + w * w * eta))
    };
    // The plant holds the torque over each of its steps of 10 ms.
    let recording = record(&model, 8, 40.0, Some(&|t, _, _| push(t + 0.005)));
    let reference = Reference::new(&model, &ModelPrior::typical(&model));
    let mut problem = Problem::new(std::slice::from_ref(&recording), reference, 40.0, 1).unwrap();
    let point = problem.reference.point();
    for _ in 0..2 {
        problem.smooth(&point, ProcessNoise::Estimated).unwrap();
    }
    let [eta, eta_rate, ..] = problem.motions[0].hidden_start_of("flexible_mode");
    let wrong = f64::hypot(eta - eta_start, eta_rate / w);
    assert!(wrong < 0.1 * eta_start, "{eta} {eta_rate}");
}
