//! Requirements on every filter, as functions that a test calls with its filter: converge from any attitude, follow a wheel,
//! be consistent. Truth and sensors share no code with the filters.

#![expect(clippy::expect_used, reason = "a test stops at a broken precondition")]

#[cfg_attr(not(test), allow(dead_code, reason = "the tests of this crate use more of it"))]
pub(crate) mod simulation;

use crate::consistency::{average_band, nees};
use crate::kernels::{FilterKind, Kernel};
use crate::{BodyModel, Estimator, ImuSample, Parameters};
use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3, Vector6};
use rand_core::SeedableRng;
use rand_pcg::Pcg64Mcg;
use simulation::{Motion, Simulation, normal3};
use whorl_math::{quaternion_exp, rotation_vector};

/// Interval of the inertial samples \[s\].
pub(crate) const DT_S: f64 = 0.01;

/// MotionPak II and a vector sensor that looks east.
#[must_use]
pub fn parameters() -> Parameters {
    Parameters::motion_pak_ii().with_vector(Vector3::x_axis())
}

/// An inertial sample, and at times a direction in body axes with its stamp \[ns\].
pub type SampleWithDirection = (ImuSample, Option<(i64, Vector3<f64>)>);

/// Samples of a platform at rest: inertial, and every tenth time with a direction.
#[must_use]
pub fn samples(count: usize) -> Vec<SampleWithDirection> {
    let parameters = parameters();
    let mut simulation = Simulation::new(Motion::still(), &parameters, 1);
    (0..count).map(|_| (simulation.imu(&parameters), simulation.vector(&parameters))).collect()
}

pub(crate) fn drive<K: Kernel>(
    simulation: &mut Simulation,
    parameters: &Parameters,
    estimator: &mut Estimator<K>,
) {
    let sample = simulation.imu(parameters);
    estimator.on_imu(&sample);
    if let Some((stamp_ns, direction)) = simulation.vector(parameters) {
        estimator.on_vector(stamp_ns, &direction);
    }
}

/// Missing wheel speeds stop only a filter that needs them.
pub fn waits_for_wheels_only_if_needed<K: Kernel>(kind: FilterKind<K>) {
    let parameters = parameters();
    let mut simulation = Simulation::new(Motion::still(), &parameters, 3);
    let inertia = Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0));
    let body = BodyModel::new(inertia, Vector3::zeros());
    let mut estimator = Estimator::new(kind, parameters, Some(body)).expect("allowed");
    for _ in 0..300 {
        drive(&mut simulation, &parameters, &mut estimator);
    }
    assert_eq!(estimator.chosen_filter_runs(), !kind.needs_body, "{}", kind.name);
}

/// A body whose motion is prescribed, so that its torque is practically unknown.
fn puppet() -> BodyModel {
    let inertia = Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0));
    let mut body = BodyModel::new(inertia, Vector3::zeros());
    body.stores_momentum = false;
    body.torque_sigma_n_m = 3.0;
    body.rate_sigma_rad_s = 0.05;
    body
}

/// From any attitude, half a turn included, with an honest covariance.
pub fn converges_from_any_attitude<K: Kernel>(kind: FilterKind<K>) {
    let name = kind.name;
    for axis in [Vector3::x(), Vector3::z(), Vector3::new(0.6, 0.0, 0.8)] {
        for angle_deg in [90.0_f64, 150.0, 180.0] {
            let parameters = parameters();
            let mut motion = Motion::still();
            motion.yaw_rate_rad_s = 0.1;
            let mut simulation = Simulation::new(motion, &parameters, 3);
            simulation.bias = Vector3::zeros();
            let wrong = simulation.motion.attitude(0.0) * quaternion_exp(&(axis * angle_deg.to_radians()));
            let covariance = Matrix6::from_diagonal(&Vector6::new(3.0, 3.0, 3.0, 1e-6, 1e-6, 1e-6));
            let body = kind.needs_body.then(puppet);
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

/// Time from which a filter by itself, without the supervision's gates and restarts, stays within a degree, at rest and from an
/// attitude that is wrong by this angle about this axis of the body with a stated deviation of 100 deg \[s\]; `None`: not
/// within a minute. The vertical and a direction east come ten times a second.
#[must_use]
pub fn own_convergence_s<K: Kernel>(
    kind: FilterKind<K>,
    axis: nalgebra::Unit<Vector3<f64>>,
    angle_deg: f64,
) -> Option<f64> {
    use crate::kernels::{DirectionMeasurement, FilterStep, KernelStart, Solution};
    let parameters = parameters();
    let solution = Solution {
        q_world_body: quaternion_exp(&(axis.into_inner() * angle_deg.to_radians())),
        omega_rad_s: Vector3::zeros(),
        gyro_bias_rad_s: Vector3::zeros(),
        covariance: Matrix6::from_diagonal(&Vector6::new(3.0, 3.0, 3.0, 1e-6, 1e-6, 1e-6)),
        wheel_momentum_b_n_m_s: Vector3::zeros(),
    };
    let mut kernel = kind.start?(&KernelStart { parameters: &parameters, body: None, solution: &solution })?;
    let mut rng = Pcg64Mcg::seed_from_u64(31);
    let sigma_rad = 3e-3;
    let step = FilterStep {
        dt_s: DT_S,
        gyro_rad_s: Vector3::zeros(),
        gyro_before_rad_s: Vector3::zeros(),
        force_b_m_s2: None,
        wheel_momentum_b_n_m_s: Vector3::zeros(),
        jet_impulse_b_n_m_s: Vector3::zeros(),
    };
    let mut within = None;
    for k in 0..6000 {
        kernel.step(&step);
        if k % 10 == 9 {
            for reference_w in [Vector3::z_axis(), Vector3::x_axis()] {
                let seen = reference_w.into_inner() + normal3(&mut rng) * sigma_rad;
                kernel.correct_direction(&DirectionMeasurement {
                    direction_b: nalgebra::Unit::new_normalize(seen),
                    reference_w,
                    variance: sigma_rad * sigma_rad,
                });
            }
        }
        let error = kernel.solution().q_world_body.angle().to_degrees();
        if error.is_nan() || error >= 1.0 {
            within = None;
        } else if within.is_none() {
            within = Some(f64::from(k + 1) * DT_S);
        }
    }
    within
}

/// A filter with dynamics on a gyrostat: closed-form truth is a spin about a principal axis with the wheel there speeding up.
pub fn follows_a_wheel<K: Kernel>(kind: FilterKind<K>) {
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
    assert!(error.to_degrees() < 0.1, "{}: {} deg", kind.name, error.to_degrees());
    // One gyro sample is wrong by 1.7e-3 rad/s.
    assert!(rate < 8e-4, "{}: {rate} rad/s", kind.name);
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

/// 100 runs of a filter with attitude and gyro bias on platform motion, judged at each instant.
pub fn is_consistent_with_a_bias<K: Kernel>(kind: FilterKind<K>) {
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
                    let value = nees(&simulation.error(&estimate), &estimate.covariance).expect("definite");
                    result.nees[step / 100 - 3] += value;
                }
            }
        }
    }
    result.judge(kind.name, 6, 0.4);
}

/// Runs of [`is_consistent_with_a_lever_arm`], each with a motion and noise of its own.
const LEVER_ARM_RUNS: u32 = 100;

/// NEES of the attitude (3 states) with the accelerometer 0.27 m off the pivot, where the vertical's noise differs between its
/// axes. At each instant the sum over the runs, which are independent, is chi-squared with three degrees of freedom for each
/// run: it must lie in the 95 % band of that distribution as often as such sums do.
pub fn is_consistent_with_a_lever_arm<K: Kernel>(kind: FilterKind<K>) {
    let mut parameters = parameters();
    parameters.accelerometer_position_b_m = Vector3::new(0.2, -0.1, 0.15);
    let mut sums = [0.0; 15];
    for run in 0..u64::from(LEVER_ARM_RUNS) {
        let mut rng = Pcg64Mcg::seed_from_u64(run + 1700);
        let mut simulation = Simulation::new(Motion::platform(&mut rng), &parameters, run);
        let mut estimator = Estimator::new(kind, parameters, None).expect("allowed");
        for step in 0..2000 {
            drive(&mut simulation, &parameters, &mut estimator);
            if step >= 500 && step % 100 == 99 {
                let estimate = estimator.estimate(simulation.stamp_ns());
                let error = simulation.error(&estimate).fixed_rows::<3>(0).into_owned();
                let covariance: Matrix3<f64> = estimate.covariance.fixed_view::<3, 3>(0, 0).into();
                sums[step / 100 - 5] += nees(&error, &covariance).expect("definite");
            }
        }
    }
    let means: Vec<f64> = sums.iter().map(|sum| sum / f64::from(LEVER_ARM_RUNS)).collect();
    let (low, high) = average_band(3, LEVER_ARM_RUNS, 0.95);
    let inside = means.iter().filter(|mean| (low..=high).contains(*mean)).count();
    let mean = means.iter().sum::<f64>() / means.len() as f64;
    println!(
        "{}: NEES {mean:.2} of 3 with a lever arm, {inside} of 15 instants in [{low:.2}, {high:.2}]",
        kind.name
    );
    // 15 in 15 are 0.46 of the cases, fewer than 12 are 0.005 of them were the instants independent; they are not quite.
    assert!(inside >= 12, "{}: {means:?}", kind.name);
    assert!((low..=high).contains(&mean), "{}: {mean}", kind.name);
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

/// 100 runs of a filter with dynamics on motion that obeys its own equations. Its attitude is judged: the gyro has no bias
/// here, and not every such filter has a state for it.
pub fn is_consistent_with_dynamics<K: Kernel>(kind: FilterKind<K>) {
    let inertia = Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0));
    let torque_noise = 0.02;
    let mut body = BodyModel::new(inertia, Vector3::zeros());
    body.stores_momentum = false;
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
        let q =
            UnitQuaternion::from_euler_angles(0.02, -0.03, 0.1 * f64::from(u32::try_from(run).expect("few")));
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
                specific_force_m_s2: force + normal3(&mut truth.rng) * parameters.accelerometer_noise_m_s2,
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
    result.judge(kind.name, 3, 0.3);
}
