//! What effects do to errors of the motion, against closed forms; and platforms that cannot exist.

use nalgebra::{Matrix3, Vector3};
use whorl_dynamics::{GyrostatError, ModelPrior, PlatformModel};

use super::generator::{map, record};
use crate::DiagnosisError;
use crate::evidence::problem::Problem;
use crate::parameters::Reference;
use crate::whitening::mechanics::{Mechanics, TorqueSlope};

/// Slopes in the first interval of a recording, at this rate.
fn slope(model: &PlatformModel, omega_b_rad_s: Vector3<f64>) -> (TorqueSlope, f64) {
    let runs = [record(model, 3, 11.0, None)];
    let reference = Reference::new(model, &ModelPrior::typical(model));
    let problem = Problem::new(&runs, reference, 11.0, 1).unwrap();
    let mechanics = Mechanics::new(model).unwrap();
    let (run, mut motion) = (&problem.runs[0], problem.motions[0].clone());
    motion.omega_mid[0] = omega_b_rad_s;
    let slopes = mechanics.torque_slopes(run, &motion, &mechanics.inputs(run));
    (slopes[0], run.noise.gyro.mean())
}

fn with(effect: &'static str, parameters: &'static [(&'static str, f64)]) -> PlatformModel {
    let mut model = PlatformModel::whorl_1_reference();
    model.effects = map(&[(effect, parameters)]);
    model
}

#[test]
fn viscous_friction_slows_every_axis_alike() {
    let model = with("bearing_viscous_friction", &[("c_n_m_s", 0.02)]);
    let (found, _) = slope(&model, Vector3::new(0.1, -0.2, 0.3));
    assert!((found.by_rate + Matrix3::identity() * 0.02).amax() < 1e-9, "{found:?}");
    assert!(found.by_attitude.amax() < 1e-9);
}

#[test]
fn a_cable_about_the_vertical_turns_back_with_its_stiffness() {
    // The recorded platform stands upright to a few degrees, so that its own z axis is nearly the vertical.
    let model = with("harness_spring", &[("k_n_m_rad", 0.03), ("yaw0_rad", 0.1), ("c_n_m_s", 0.0)]);
    let (found, _) = slope(&model, Vector3::zeros());
    assert!((found.by_attitude[(2, 2)] / -0.03 - 1.0).abs() < 0.02, "{found:?}");
    assert!(found.by_rate.amax() < 1e-9);
}

#[test]
fn dry_friction_is_as_steep_at_rest_as_the_gyro_lets_one_see() {
    let model = with("bearing_coulomb_friction", &[("torque_n_m", 2e-3)]);
    let (at_rest, noise) = slope(&model, Vector3::zeros());
    // T w / sqrt(w^2 + w0^2) over one standard deviation of a sample either way; w0 as the effect states it.
    let expected = 2e-3 / noise.hypot(5e-4);
    assert!((at_rest.by_rate + Matrix3::identity() * expected).amax() < 1e-9, "{at_rest:?} {expected}");
    // In motion only what turns its direction: T / w across it, nothing along it.
    let (moving, _) = slope(&model, Vector3::new(0.0, 0.0, 0.5));
    let across = 2e-3 / 0.5;
    assert!(
        (moving.by_rate + Matrix3::from_diagonal(&Vector3::new(across, across, 0.0))).amax() < 1e-4 * across
    );
}

#[test]
fn a_trial_at_a_platform_that_cannot_exist_is_no_error() {
    let model = PlatformModel::whorl_1_reference();
    let reference = Reference::new(&model, &ModelPrior::typical(&model));
    let mut point = reference.point();
    // A negative moment of inertia.
    point.moments = [-100.0, 0.0, 0.0];
    let tried = reference.model_at(&point).and_then(|model| Mechanics::new(&model));
    assert!(tried.is_err());
    assert!(matches!(DiagnosisError::possible(tried), Ok(None)));
    let other: Result<(), _> = Err(DiagnosisError::NoRecording);
    assert!(DiagnosisError::possible(other).is_err(), "other errors stay errors");
    let physical: Result<(), GyrostatError> = Ok(());
    assert!(matches!(DiagnosisError::possible(physical.map_err(DiagnosisError::from)), Ok(Some(()))));
}
