//! All filters on the same runs: convergence, dynamics.

use super::{FilterKind, FilterStep};
use crate::tests::simulation::{Motion, Simulation};
use crate::{BodyModel, Estimator, Parameters};
use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3, Vector6};
use whorl_math::quaternion_exp;

pub(super) const BIAS_FILTERS: [FilterKind; 4] =
    [FilterKind::AttitudeBias, FilterKind::Iterated, FilterKind::Unscented, FilterKind::Invariant];

pub(super) fn drive(simulation: &mut Simulation, parameters: &Parameters, estimator: &mut Estimator) {
    let sample = simulation.imu(parameters);
    estimator.on_imu(&sample);
    if let Some((stamp_ns, direction)) = simulation.vector(parameters) {
        estimator.on_vector(stamp_ns, &direction);
    }
}

pub(super) fn parameters() -> Parameters {
    Parameters::motion_pak_ii().with_vector(Vector3::x_axis())
}

/// A body that follows no law (the motion is prescribed): the torque is as good as unknown.
fn puppet() -> BodyModel {
    let inertia = Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0));
    let mut body = BodyModel::new(inertia, Vector3::zeros());
    body.has_wheels = false;
    body.torque_sigma_n_m = 3.0;
    body.rate_sigma_rad_s = 0.05;
    body
}

#[test]
fn names_are_found_again() {
    for (name, kind) in FilterKind::ALL {
        assert_eq!(FilterKind::find(name), Some(kind));
        assert_eq!(kind.name(), name);
        assert_eq!(Estimator::new(kind, parameters(), None).is_err(), kind.needs_body());
    }
}

/// A body with wheels of which nothing is heard stops only the filters that compute with them.
#[test]
fn filters_that_need_no_wheels_do_not_wait_for_them() {
    for (name, kind) in FilterKind::ALL {
        let parameters = parameters();
        let mut simulation = Simulation::new(Motion::still(), &parameters, 3);
        let inertia = Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0));
        let body = BodyModel::new(inertia, Vector3::zeros());
        let mut estimator = Estimator::new(kind, parameters, Some(body)).expect("allowed");
        for _ in 0..300 {
            drive(&mut simulation, &parameters, &mut estimator);
        }
        assert_eq!(estimator.chosen_filter_runs(), !kind.needs_body(), "{name}");
    }
}

/// From any attitude, half a turn included, with an honest covariance.
#[test]
fn all_filters_converge_from_any_attitude() {
    // The free-motion filter finds its own first attitude.
    for (name, kind) in FilterKind::ALL.into_iter().filter(|(_, kind)| *kind != FilterKind::FreeMotion) {
        for axis in [Vector3::x(), Vector3::z(), Vector3::new(0.6, 0.0, 0.8)] {
            for angle_deg in [90.0_f64, 150.0, 180.0] {
                let parameters = parameters();
                let mut motion = Motion::still();
                motion.yaw_rate_rad_s = 0.1;
                let mut simulation = Simulation::new(motion, &parameters, 3);
                simulation.bias = Vector3::zeros();
                let wrong =
                    simulation.motion.attitude(0.0) * quaternion_exp(&(axis * angle_deg.to_radians()));
                let covariance = Matrix6::from_diagonal(&Vector6::new(3.0, 3.0, 3.0, 1e-6, 1e-6, 1e-6));
                let body = kind.needs_body().then(puppet);
                let mut estimator =
                    Estimator::with_attitude(kind, parameters, body, 0, wrong, Vector3::zeros(), &covariance)
                        .expect("allowed");
                for _ in 0..2000 {
                    drive(&mut simulation, &parameters, &mut estimator);
                }
                let estimate = estimator.estimate(simulation.stamp_ns());
                let truth = simulation.motion.attitude(simulation.time_s());
                let error = estimate.q_world_body.angle_to(&truth).to_degrees();
                assert!(error < 0.5, "{name}, {angle_deg} deg about {axis}: {error} deg");
            }
        }
    }
}

/// The filters with dynamics on a gyrostat: closed-form truth is a spin about a principal axis with the wheel there speeding up.
#[test]
fn filters_with_dynamics_follow_a_wheel() {
    for kind in [FilterKind::Gyrostat, FilterKind::AttitudeRate, FilterKind::QuaternionRate] {
        let inertia = Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0));
        let mut body = BodyModel::new(inertia, Vector3::zeros());
        body.torque_sigma_n_m = 1e-3;
        let mut parameters = parameters();
        parameters.outlier_probability = 1e-9;
        let mut simulation = Simulation::new(Motion::still(), &parameters, 9);
        simulation.bias = Vector3::zeros();
        let mut estimator = Estimator::new(kind, parameters, Some(body)).expect("allowed");
        let (mut errors, mut rates, mut count) = (0.0, 0.0, 0.0);
        for step in 1..6000_i64 {
            // The wheel takes 0.6 N m s sin(t/2); yaw rate and angle follow.
            let t = step as f64 * 0.01;
            let momentum = 0.6 * (0.5 * t).sin();
            let (rate, yaw) = (-momentum / 12.0, -0.05 * 2.0 * (1.0 - (0.5 * t).cos()));
            let truth = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw);
            let mut sample = simulation.imu(&parameters);
            sample.gyro_rad_s.z += rate;
            estimator.on_imu(&sample);
            let torque = Vector3::z() * (0.3 * (0.5 * t).cos());
            estimator.on_wheels(sample.stamp_ns, Vector3::z() * momentum, torque);
            if let Some((stamp_ns, direction)) = simulation.vector(&parameters) {
                estimator.on_vector(stamp_ns, &(truth.inverse() * direction));
            }
            if step > 2000 {
                let estimate = estimator.estimate(sample.stamp_ns);
                errors += estimate.q_world_body.angle_to(&truth).powi(2);
                rates += (estimate.omega_wb_b_rad_s.z - rate).powi(2);
                count += 1.0;
            }
        }
        let (error, rate): (f64, f64) = ((errors / count).sqrt(), (rates / count).sqrt());
        assert!(error.to_degrees() < 0.1, "{}: {} deg", kind.name(), error.to_degrees());
        // One gyro sample is wrong by 1.7e-3 rad/s.
        assert!(rate < 8e-4, "{}: {rate} rad/s", kind.name());
    }
}

/// The step's data type is plain: nothing in it may be left out by mistake.
#[test]
fn a_step_is_complete() {
    let step = FilterStep {
        dt_s: 0.01,
        gyro_rad_s: Vector3::zeros(),
        gyro_before_rad_s: Vector3::zeros(),
        force_b_m_s2: None,
        wheel_momentum_b_n_m_s: Vector3::zeros(),
        jet_impulse_b_n_m_s: Vector3::zeros(),
    };
    assert_eq!(super::bias_state::mean_turn(&Vector3::x(), &step), Vector3::x() * -0.01);
}
