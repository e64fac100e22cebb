//! The automatic balancing mode in the loop: truth plant, noisy estimates, linear actuators.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_control::Reference;
use whorl_dynamics::{InitialState, MassProperties};

use super::rig::*;

/// Whorl-I with its stable z, 30 N mm off in x and y, becomes less than 1 N mm off, through the nodes'
/// own messages; the model that the controller has does not know of the error.
#[test]
fn thirty_newton_millimetres_become_less_than_one() {
    let arguments =
        ["actuators:=wheels", "balancing.enabled:=true", "balancing.target_n_m:=[0.0, 0.0, -2.1]"];
    let parameters = parameters("whorl_1", &arguments);
    let mut truth = truth("whorl_1");
    let inertia = *truth.mass_properties.inertia_b_kg_m2();
    let off = Vector3::new(0.024, -0.018, -2.1);
    truth.mass_properties = MassProperties::new(inertia, off, truth.mass_properties.mass_kg()).unwrap();
    let q = UnitQuaternion::from_euler_angles(0.0, 0.0, 0.3);
    let start = InitialState { q_world_body: q, ..InitialState::default() };
    let mut rig = Rig::new(parameters, &truth, start);
    rig.reference = Some(Box::new(move |_| Reference::at_rest(q)));
    rig.noise = (3.5e-4, 1.745e-3);
    rig.run(240.0);
    let moment = rig.core.balancing.as_ref().map(|b| b.moment_b_n_m()).unwrap();
    let left = off + moment;
    println!("moment {moment:?} left {left:?} log {:?}", rig.log);
    assert!(left.xy().norm() < 1e-3, "{left}");
    // Balanced: the wheels no longer gather momentum.
    let before = rig.plant.truth().wheel_speed_rad_s;
    rig.run(30.0);
    let after = rig.plant.truth().wheel_speed_rad_s;
    let gathered: f64 = before.iter().zip(&after).map(|(a, b)| 0.02 * (b - a).abs()).fold(0.0, f64::max);
    assert!(gathered < 0.09, "{gathered} N m s in 30 s");
}

#[test]
fn balancing_needs_the_wheels_alone() {
    let node = tree(&["balancing.enabled:=true"]).for_node("/whorl_1/local_control");
    let errors = whorl_params::try_read(&node, crate::parameters::read).unwrap_err();
    assert!(errors.to_string().contains("balancing.enabled"), "{errors}");
}
