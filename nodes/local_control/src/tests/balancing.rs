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

/// Masses of 4 kg, at 2 mm/s, with 0.1 mm of play, which is 4 N mm from flank to flank: the platform is balanced as well
/// as with ideal ones, what is sent never runs ahead of what the spindles can do, and the plant is where it says.
#[test]
fn masses_with_speed_travel_and_play_balance_as_well() {
    let masses = [
        "actuators:=wheels",
        "balancing.enabled:=true",
        "balancing.target_n_m:=[0.0, 0.0, -2.1]",
        "model.moving_mass_defaults.mass_kg:=4.0",
        "model.moving_mass_defaults.travel_m:=0.1",
        "model.moving_mass_defaults.max_speed_m_s:=0.002",
        "model.moving_mass_defaults.backlash_m:=0.0001",
        "model.moving_masses.mass_x.axis:=[1.0, 0.0, 0.0]",
        "model.moving_masses.mass_y.axis:=[0.0, 1.0, 0.0]",
        "model.moving_masses.mass_z.axis:=[0.0, 0.0, 1.0]",
    ];
    let parameters = parameters("whorl_1", &masses);
    let mut truth = truth("whorl_1");
    truth.actuators.moving_masses = parameters.model.moving_masses().clone();
    let inertia = *truth.mass_properties.inertia_b_kg_m2();
    let off = Vector3::new(0.024, -0.018, -2.1);
    truth.mass_properties = MassProperties::new(inertia, off, truth.mass_properties.mass_kg()).unwrap();
    let start = InitialState::default();
    let mut rig = Rig::new(parameters, &truth, start);
    rig.reference = Some(Box::new(move |_| Reference::at_rest(UnitQuaternion::identity())));
    rig.noise = (3.5e-4, 1.745e-3);
    let mut latest = Vector3::zeros();
    for _ in 0..240 {
        rig.run(1.0);
        let moment = rig.plant.ballast_moment_b_n_m();
        // 4 kg at 2 mm/s: 78 N mm a second.
        assert!((moment - latest).amax() < 0.0785 + 0.008, "{latest} to {moment}");
        latest = moment;
    }
    let left = off + latest;
    println!("left {left:?} log {:?}", rig.log);
    assert!(left.xy().norm() < 1.5e-3, "{left}");
    let wanted = rig.core.balancing.as_ref().map(|b| b.moment_b_n_m()).unwrap();
    assert!((latest - wanted).amax() < 0.5 * 0.0001 * 4.0 * 9.81 + 1e-6, "{latest} is not {wanted}");
}

/// A mass that has not the travel for the offset goes to its end stop, and that is said with what is left.
#[test]
fn an_end_stop_is_said() {
    let masses = [
        "actuators:=wheels",
        "balancing.enabled:=true",
        "balancing.target_n_m:=[0.0, 0.0, -2.1]",
        "model.moving_mass_defaults.mass_kg:=1.0",
        "model.moving_mass_defaults.travel_m:=0.001",
        "model.moving_mass_defaults.max_speed_m_s:=0.002",
        "model.moving_masses.mass_x.axis:=[1.0, 0.0, 0.0]",
        "model.moving_masses.mass_y.axis:=[0.0, 1.0, 0.0]",
    ];
    let parameters = parameters("whorl_1", &masses);
    let mut truth = truth("whorl_1");
    truth.actuators.moving_masses = parameters.model.moving_masses().clone();
    let inertia = *truth.mass_properties.inertia_b_kg_m2();
    let off = Vector3::new(0.05, 0.0, -2.1);
    truth.mass_properties = MassProperties::new(inertia, off, truth.mass_properties.mass_kg()).unwrap();
    let mut rig = Rig::new(parameters, &truth, InitialState::default());
    rig.reference = Some(Box::new(move |_| Reference::at_rest(UnitQuaternion::identity())));
    rig.run(60.0);
    assert!((rig.plant.ballast_moment_b_n_m().x + 0.001 * 9.81).abs() < 1e-9);
    let said = rig.log.iter().any(|line| format!("{line:?}").contains("end of their travel"));
    assert!(said, "{:?}", rig.log);
}

#[test]
fn balancing_needs_the_wheels_alone() {
    let node = tree(&["balancing.enabled:=true"]).for_node("/whorl_1/local_control");
    let errors = whorl_params::try_read(&node, crate::parameters::read).unwrap_err();
    assert!(errors.to_string().contains("balancing.enabled"), "{errors}");
}
