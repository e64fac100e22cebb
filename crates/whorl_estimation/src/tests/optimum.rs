//! Steady state of the filters with attitude and gyro bias against the Riccati optimum.

use crate::conformance::simulation::{Motion, Simulation};
use crate::conformance::{DT_S, drive, parameters};
use crate::{Estimator, FilterKind, Parameters};
use nalgebra::{Matrix3, Matrix6, SMatrix, UnitQuaternion, Vector3, Vector6};
use whorl_math::{quaternion_exp, skew};

pub(super) const BIAS_FILTERS: [FilterKind; 4] =
    [FilterKind::ATTITUDE_BIAS, FilterKind::ITERATED, FilterKind::UNSCENTED, FilterKind::INVARIANT];

/// Covariance updated by a direction seen in body axes.
fn use_direction(p: &mut Matrix6<f64>, seen_b: &Vector3<f64>, sigma: f64) {
    let mut h = SMatrix::<f64, 3, 6>::zeros();
    h.fixed_view_mut::<3, 3>(0, 0).copy_from(&skew(seen_b));
    use_rows(p, &h, sigma * sigma);
}

fn use_rows(p: &mut Matrix6<f64>, h: &SMatrix<f64, 3, 6>, variance: f64) {
    let s = h * *p * h.transpose() + Matrix3::identity() * variance;
    let gain = *p * h.transpose() * s.try_inverse().expect("positive");
    *p -= gain * h * *p;
    *p = (*p + p.transpose()) * 0.5;
}

/// Mean over one second of the covariance that the Riccati recursion settles at, with every sample of every sensor used
/// when it comes: body axes, a spin about the vertical with a roll, noise densities of the parameters. `transition` gives
/// F and Q of a step.
fn optimum(
    parameters: &Parameters,
    rate_rad_s: f64,
    roll_rad: f64,
    gyro_variance: Option<f64>,
    (f, q): (Matrix6<f64>, Matrix6<f64>),
    settle_steps: u32,
) -> Matrix6<f64> {
    let vector = parameters.vector.expect("has a vector sensor");
    let gravity_sigma = parameters.accelerometer_noise_m_s2 / parameters.gravity_m_s2;
    let mut p = Matrix6::from_diagonal(&Vector6::repeat(1e-4));
    let mut mean = Matrix6::zeros();
    for step in 1..=settle_steps + 100 {
        p = f * p * f.transpose() + q;
        let attitude = UnitQuaternion::from_euler_angles(roll_rad, 0.0, rate_rad_s * f64::from(step) * DT_S);
        use_direction(&mut p, &(attitude.inverse() * Vector3::z()), gravity_sigma);
        if let Some(variance) = gyro_variance {
            let mut h = SMatrix::<f64, 3, 6>::zeros();
            h.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
            use_rows(&mut p, &h, variance);
        }
        if step % 10 == 0 {
            use_direction(&mut p, &(attitude.inverse() * vector.reference_w.into_inner()), vector.noise_rad);
        }
        if step > settle_steps {
            mean += p / 100.0;
        }
    }
    mean
}

/// F and Q of the attitude and bias error in body axes (eq. 4.70, exact for a constant rate except for the small rotation by the bias).
fn bias_process(parameters: &Parameters, omega: &Vector3<f64>) -> (Matrix6<f64>, Matrix6<f64>) {
    let turn = |dt: f64| *quaternion_exp(&(omega * -dt)).to_rotation_matrix().matrix();
    let mut f = Matrix6::identity();
    f.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn(DT_S));
    f.fixed_view_mut::<3, 3>(0, 3).copy_from(&(turn(0.5 * DT_S) * -DT_S));
    let (v, u) =
        (parameters.gyro_noise_rad_s_sqrt_hz.powi(2), parameters.gyro_bias_walk_rad_s2_sqrt_hz.powi(2));
    let mut q = Matrix6::zeros();
    for axis in 0..3 {
        q[(axis, axis)] = v * DT_S + u * DT_S.powi(3) / 3.0;
        q[(axis + 3, axis + 3)] = u * DT_S;
        q[(axis, axis + 3)] = -u * DT_S * DT_S / 2.0;
        q[(axis + 3, axis)] = q[(axis, axis + 3)];
    }
    (f, q)
}

#[test]
fn steady_states_are_within_a_per_cent_of_the_riccati_optimum() {
    for rate_deg_s in [0.0_f64, 1.0, 10.0, 30.0] {
        let rate = rate_deg_s.to_radians();
        let (roll, mut parameters) = (0.05, parameters());
        // A walk that lets the bias settle within the test.
        parameters.gyro_bias_walk_rad_s2_sqrt_hz = 1e-4;
        let omega = UnitQuaternion::from_euler_angles(roll, 0.0, 0.0).inverse() * (Vector3::z() * rate);
        let best = optimum(&parameters, rate, roll, None, bias_process(&parameters, &omega), 20_000);
        for kind in BIAS_FILTERS {
            let mut motion = Motion::still();
            (motion.yaw_rate_rad_s, motion.roll_offset_rad) = (rate, roll);
            let mut simulation = Simulation::new(motion, &parameters, 5);
            let mut estimator = Estimator::new(kind, parameters, None).expect("allowed");
            let mut settled = Matrix6::zeros();
            for step in 0..20_100 {
                drive(&mut simulation, &parameters, &mut estimator);
                if step >= 20_000 {
                    settled += estimator.estimate(simulation.stamp_ns()).covariance / 100.0;
                }
            }
            for (part, at) in [("attitude", 0), ("bias", 3)] {
                let trace = |p: &Matrix6<f64>| p.fixed_view::<3, 3>(at, at).trace().sqrt();
                let ratio = trace(&settled) / trace(&best);
                println!("{} {rate_deg_s} deg/s {part}: {ratio:.4} of the optimum", kind.name);
                assert!((ratio - 1.0).abs() < 0.01, "{} {rate_deg_s} deg/s {part}: {ratio}", kind.name);
            }
        }
    }
}
