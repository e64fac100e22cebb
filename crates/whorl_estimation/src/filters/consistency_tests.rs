//! Steady state against the Riccati optimum, NEES and NIS of every filter.

use super::tests::{BIAS_FILTERS, drive, parameters};
use super::{Estimator, FilterKind};
use crate::consistency::{average_band, nees};
use crate::tests::simulation::{Motion, Simulation, normal3};
use crate::{BodyModel, ImuSample, Parameters};
use nalgebra::{Matrix3, Matrix6, SMatrix, UnitQuaternion, Vector3, Vector6};
use rand_core::SeedableRng;
use rand_pcg::Pcg64Mcg;
use whorl_math::{quaternion_exp, rotation_vector, skew};

const DT_S: f64 = 0.01;

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

/// F and Q of the attitude and bias error in body axes (eq. 4.70, exact for a constant rate but for the bias's small turn).
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
                println!("{} {rate_deg_s} deg/s {part}: {ratio:.4} of the optimum", kind.name());
                assert!((ratio - 1.0).abs() < 0.01, "{} {rate_deg_s} deg/s {part}: {ratio}", kind.name());
            }
        }
    }
}

/// Average over the runs of NEES and NIS at each instant, the share of instants at which NEES lies within its 95 % band, and
/// both means over all.
struct Consistency {
    nees: Vec<f64>,
    nis: f64,
    nis_dof: f64,
    runs: u32,
}

impl Consistency {
    fn new(instants: usize, runs: u32) -> Self {
        Self { nees: vec![0.0; instants], nis: 0.0, nis_dof: 0.0, runs }
    }

    fn judge(&self, name: &str, states: u32, nees_tolerance: f64) {
        let runs = f64::from(self.runs);
        let (low, high) = average_band(states, self.runs, 0.95);
        let inside = self.nees.iter().filter(|n| (low..=high).contains(&(**n / runs))).count();
        let share = inside as f64 / self.nees.len() as f64;
        let mean = self.nees.iter().sum::<f64>() / self.nees.len() as f64 / runs;
        let nis = self.nis / self.nis_dof;
        println!(
            "{name}: NEES {mean:.2} of {states}, in its band at {:.0} %, NIS per dof {nis:.3}",
            100.0 * share
        );
        assert!(share >= 0.85, "{name}: NEES in its band at {share} of the instants");
        assert!((mean - f64::from(states)).abs() < nees_tolerance, "{name}: mean NEES {mean}");
        assert!((nis - 1.0).abs() < 0.1, "{name}: NIS {nis}");
    }
}

/// 100 runs of each bias filter, judged at each instant.
#[test]
fn bias_filters_are_consistent_at_each_instant() {
    if !whorl_tests::slow("NEES of every filter with a bias") {
        return;
    }
    for kind in BIAS_FILTERS {
        let mut result = Consistency::new(30, 100);
        for run in 0..100 {
            let mut rng = Pcg64Mcg::seed_from_u64(run + 700);
            let parameters = parameters();
            let mut simulation = Simulation::new(Motion::platform(&mut rng), &parameters, run);
            let mut estimator = Estimator::new(kind, parameters, None).expect("allowed");
            for step in 0..3300 {
                drive(&mut simulation, &parameters, &mut estimator);
                let estimate = estimator.estimate(simulation.stamp_ns());
                if step >= 300 {
                    result.nis += estimate.nis.unwrap_or(0.0);
                    result.nis_dof += f64::from(estimate.nis_dof);
                    if step % 100 == 99 {
                        let value =
                            nees(&simulation.error(&estimate), &estimate.covariance).expect("definite");
                        result.nees[step / 100 - 3] += value;
                    }
                }
            }
        }
        result.judge(kind.name(), 6, 0.4);
    }
}

/// A rigid body that obeys Euler's equation under white torque noise, integrated at 1 kHz.
struct Body {
    q: UnitQuaternion<f64>,
    omega: Vector3<f64>,
    inertia: Matrix3<f64>,
    torque_noise: f64,
    rng: Pcg64Mcg,
}

impl Body {
    fn advance(&mut self) {
        let h = 1e-3;
        let inverse = self.inertia.try_inverse().expect("regular");
        for _ in 0..10 {
            let acceleration = |w: &Vector3<f64>| inverse * (self.inertia * w).cross(w);
            let half = self.omega + acceleration(&self.omega) * (0.5 * h);
            self.q *= quaternion_exp(&(half * h));
            let kick = inverse * normal3(&mut self.rng) * (self.torque_noise * h.sqrt());
            self.omega += acceleration(&half) * h + kick;
        }
    }
}

/// The filters with dynamics on motion that obeys their own equations. Their attitude is judged: the gyro has no bias here,
/// and two of them have no state for it.
#[test]
fn filters_with_dynamics_are_consistent() {
    if !whorl_tests::slow("NEES of the filters with dynamics") {
        return;
    }
    let inertia = Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0));
    let torque_noise = 0.02;
    for kind in [FilterKind::QuaternionRate, FilterKind::AttitudeRate, FilterKind::Gyrostat] {
        let mut body = BodyModel::new(inertia, Vector3::zeros());
        body.has_wheels = false;
        body.wheel_momentum_noise_n_m_s = 0.0;
        body.torque_noise_n_m_sqrt_hz = torque_noise;
        (body.torque_sigma_n_m, body.torque_walk_n_m_sqrt_s) = (0.0, 0.0);
        (body.inertia_relative_sigma, body.gyro_scale_sigma) = (0.0, 0.0);
        (body.accelerometer_bias_sigma_m_s2, body.accelerometer_bias_walk_m_s2_sqrt_s) = (0.0, 0.0);
        let mut parameters = parameters();
        parameters.initial_bias_sigma_rad_s = 1e-9;
        parameters.gyro_bias_walk_rad_s2_sqrt_hz = 1e-9;
        let mut result = Consistency::new(30, 100);
        for run in 0..100 {
            let mut rng = Pcg64Mcg::seed_from_u64(run + 900);
            let q = UnitQuaternion::from_euler_angles(
                0.02,
                -0.03,
                0.1 * f64::from(u32::try_from(run).expect("few")),
            );
            let omega = normal3(&mut rng) * 0.05;
            let mut truth = Body { q, omega, inertia, torque_noise, rng };
            let mut estimator = Estimator::new(kind, parameters, Some(body)).expect("allowed");
            for step in 1..3300_i64 {
                truth.advance();
                let gyro_sigma = parameters.gyro_noise_rad_s_sqrt_hz / DT_S.sqrt();
                let force = truth.q.inverse() * Vector3::z() * parameters.gravity_m_s2;
                let stamp_ns = step * 10_000_000;
                estimator.on_imu(&ImuSample {
                    stamp_ns,
                    gyro_rad_s: truth.omega + normal3(&mut truth.rng) * gyro_sigma,
                    specific_force_m_s2: force
                        + normal3(&mut truth.rng) * parameters.accelerometer_noise_m_s2,
                });
                let estimate = estimator.estimate(stamp_ns);
                let mut updates = vec![(estimate.nis, estimate.nis_dof)];
                if step % 10 == 0 {
                    let seen = truth.q.inverse() * Vector3::x();
                    let noise = normal3(&mut truth.rng) * 3e-3;
                    estimator.on_vector(stamp_ns, &(seen + noise - seen * seen.dot(&noise)));
                    let estimate = estimator.estimate(stamp_ns);
                    updates.push((estimate.nis, estimate.nis_dof));
                }
                if step >= 300 {
                    for (nis, dof) in updates {
                        result.nis += nis.unwrap_or(0.0);
                        result.nis_dof += f64::from(dof);
                    }
                    if step % 100 == 99 {
                        let estimate = estimator.estimate(stamp_ns);
                        let error = rotation_vector(&(estimate.q_world_body.inverse() * truth.q));
                        let covariance: Matrix3<f64> = estimate.covariance.fixed_view::<3, 3>(0, 0).into();
                        let at = usize::try_from(step / 100 - 3).expect("later");
                        result.nees[at] += nees(&error, &covariance).expect("definite");
                    }
                }
            }
        }
        result.judge(kind.name(), 3, 0.3);
    }
}

/// Nothing is allocated once a filter runs.
#[test]
fn filters_do_not_allocate() {
    let inertia = Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0));
    for (name, kind) in FilterKind::ALL {
        let parameters = parameters();
        let mut simulation = Simulation::new(Motion::still(), &parameters, 1);
        let body = BodyModel::new(inertia, Vector3::zeros());
        let mut estimator = Estimator::new(kind, parameters, Some(body)).expect("allowed");
        let samples: Vec<_> =
            (0..1000).map(|_| (simulation.imu(&parameters), simulation.vector(&parameters))).collect();
        let counted = allocation_counter::measure(|| {
            for (imu, vector) in &samples {
                estimator.on_wheels(imu.stamp_ns, Vector3::zeros(), Vector3::zeros());
                estimator.on_imu(imu);
                if let Some((stamp_ns, direction)) = vector {
                    estimator.on_vector(*stamp_ns, direction);
                }
                std::hint::black_box(estimator.estimate(imu.stamp_ns));
            }
        });
        assert_eq!(counted.count_total, 0, "{name}");
    }
}
