//! What the model learns of the platform is used at once: the pointing error falls with every effect that
//! the truth has and the model adopts.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::{UnitQuaternion, Vector3};
use whorl_control::Reference;
use whorl_dynamics::effects::{catalogue, find};
use whorl_dynamics::{Effect, InitialState, ParameterSpec};
use whorl_msgs::whorl::{ActuatorCommand, ControlStatus};

use super::rig::*;

/// Yaw of 20 degrees to both sides in 40 s, tilted by some degrees: 3.1 deg/s at most.
fn swing(time_s: f64) -> Reference {
    let (amplitude_rad, rate) = (0.35, TAU / 40.0);
    let tilted = balanced();
    let (sin, cos) = (rate * time_s).sin_cos();
    let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), amplitude_rad * (1.0 - cos));
    let axis_b = tilted.inverse_transform_vector(&Vector3::z());
    Reference {
        q_world_reference: turned * tilted,
        omega_wr_r_rad_s: axis_b * (amplitude_rad * rate * sin),
        omega_dot_wr_r_rad_s2: axis_b * (amplitude_rad * rate * rate * cos),
    }
}

/// RMS pointing error over a period of the swing [deg]; the truth has the effect, the model has adopted it or not.
fn pointing_error_deg(id: &str, parameters_of_effect: &[(&str, f64)], adopted: bool) -> f64 {
    // Without integral action, which would hide slow torques in the end.
    let mut parameters = parameters("whorl_1", &["actuators:=wheels", "tracking.integral_time_s:=0.0"]);
    let mut truth = parameters.model.clone();
    let values: BTreeMap<String, f64> =
        parameters_of_effect.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    truth.effects.insert(id.to_owned(), values.clone());
    if adopted {
        parameters.model.effects.insert(id.to_owned(), values);
    }
    let start = InitialState {
        q_world_body: balanced(),
        wheel_speed_rad_s: vec![60.0, -40.0, 5.0],
        ..InitialState::default()
    };
    let mut rig = Rig::new(parameters, &truth, start);
    rig.reference = Some(Box::new(swing));
    rig.run(40.0);
    let steps = rig.run(40.0);
    assert_eq!(rig.mode(), (ControlStatus::MODE_TRACK, ControlStatus::REASON_NONE), "{id}");
    rms_deg(&steps, |time_s| swing(time_s).q_world_reference)
}

/// Torques that change with the motion; a constant one, such as a leak's, is integrated away within the first
/// period. The third wheel changes its direction.
#[test]
fn every_adopted_effect_lowers_the_pointing_error() {
    let cases: [(&str, &[(&str, f64)]); 6] = [
        ("bearing_coulomb_friction", &[("torque_n_m", 0.02)]),
        ("bearing_viscous_friction", &[("c_n_m_s", 0.5)]),
        ("magnetic_torque", &[("dipole_x_a_m2", 400.0)]),
        ("wheel_misalignment", &[("wheel_z_a_rad", 0.1), ("wheel_z_b_rad", -0.1)]),
        ("wheel_friction", &[("wheel_z_coulomb_n_m", 0.02)]),
        ("wheel_windage", &[("wheel_z_n_m_s2", 5e-6)]),
    ];
    for (id, values) in cases {
        let before = pointing_error_deg(id, values, false);
        let after = pointing_error_deg(id, values, true);
        assert!(after < 0.5 * before, "{id}: {before} deg before, {after} deg after");
        assert!(after < 0.01, "{id}: {after}");
    }
}

/// Commands of a second with wheels turning fast; the model has adopted the effect at one prior standard deviation, or
/// nothing. The truth does not have it.
fn commands(effect: Option<&'static dyn Effect>) -> Vec<ActuatorCommand> {
    let mut parameters = parameters("whorl_1", &["actuators:=wheels"]);
    let truth = parameters.model.clone();
    if let Some(effect) = effect {
        let sized =
            |spec: ParameterSpec| (spec.name.clone(), (spec.neutral + spec.prior_stddev).min(spec.max));
        let fitted = effect.parameters(&truth).into_iter().filter(|spec| !spec.known).map(sized);
        parameters.model.effects.insert(effect.info().id.to_owned(), fitted.collect());
    }
    let start = InitialState {
        q_world_body: balanced(),
        wheel_speed_rad_s: vec![60.0, -40.0, 5.0],
        ..InitialState::default()
    };
    let mut rig = Rig::new(parameters, &truth, start);
    rig.reference = Some(Box::new(swing));
    rig.run(1.0);
    rig.commands
}

/// Control does not know the angle of a wheel, the place of a liquid or the phase of a draught: it must not counter
/// them as if they were zero.
#[test]
fn effects_whose_state_is_unknown_are_not_countered() {
    let without = commands(None);
    let model = parameters("whorl_1", &[]).model;
    let mut left_alone = Vec::new();
    for effect in catalogue().iter().copied() {
        if effect.hidden_states(&model) > 0 || !effect.is_fed_forward(&model) {
            let id = effect.info().id;
            assert!(commands(Some(effect)) == without, "{id}");
            left_alone.push(id);
        }
    }
    for id in ["wheel_imbalance", "slosh", "flexible_mode", "air_current_periodic", "tilt_stop_contact"] {
        assert!(left_alone.contains(&id), "{id}: {left_alone:?}");
    }
    assert!(commands(find("air_current")) != without, "a steady draught is countered");
}
