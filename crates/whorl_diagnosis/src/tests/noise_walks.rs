//! Walks of noise, against walks that the tests make themselves.

use nalgebra::Vector3;
use whorl_dynamics::{ModelPrior, PlatformModel};

use super::generator::{map, normal, random, record};
use crate::evidence::nuisance::Nuisance;
use crate::evidence::problem::{FREE_RATE_WALK, Problem, ProcessNoise};
use crate::parameters::Reference;
use crate::whitening::columns::predict;
use crate::whitening::filter::System;
use crate::whitening::mechanics::Mechanics;

fn problem_of(model: &PlatformModel, runs: &[whorl_recording::Recording]) -> Problem {
    let reference = Reference::new(model, &ModelPrior::typical(model));
    let total_s = runs.iter().map(whorl_recording::Recording::duration_s).sum();
    Problem::new(runs, reference, total_s, 1).unwrap()
}

/// A platform whose gyro is steady, by the model.
fn steady() -> PlatformModel {
    let mut model = PlatformModel::whorl_1_reference();
    model.sensors.gyro.errors.bias_walk = Vector3::zeros();
    model
}

#[test]
fn a_walk_of_the_gyros_bias_is_found_at_its_size() {
    let model = steady();
    let quiet = record(&model, 12, 60.0, None);
    // Independent steps of each sample, which grow as the square root of time.
    let drifting = |walk_rad_s_sqrt_s: f64| {
        let (mut run, mut rng, mut bias) = (quiet.clone(), random(5), Vector3::zeros());
        for value in &mut run.gyro_b_rad_s.value {
            bias += Vector3::from_fn(|_, _| normal(&mut rng)) * walk_rad_s_sqrt_s * 0.01_f64.sqrt();
            *value += bias;
        }
        run
    };
    let found = |run: whorl_recording::Recording| {
        let mut problem = problem_of(&model, &[run]);
        let point = problem.reference.point();
        problem.smooth(&point, ProcessNoise::Fixed(FREE_RATE_WALK)).unwrap();
        problem.nuisance = problem
            .likeliest_noise(&point, &[], crate::search::noise_optimisation::Sizes::Any)
            .unwrap()
            .sizes;
        (problem.nuisance, problem.settings(0).gyro_bias_walk)
    };
    assert_eq!(found(quiet.clone()).0, Nuisance::default());
    for walk in [3e-4, 1e-4] {
        // Sizes are steps of a factor of three: the nearest is off by half of one at most.
        let (nuisance, size) = found(drifting(walk));
        assert!(nuisance.torque == 0 && (size / walk).ln().abs() <= 3f64.ln() / 2.0, "{walk}: {size}");
    }
}

#[test]
fn a_slow_random_torque_is_found_at_its_size() {
    let model = steady();
    let (stddev_n_m, correlation_s) = (4e-3, 8.0_f64);
    // An Ornstein-Uhlenbeck torque about each axis, by its exact step.
    let mut rng = random(21);
    let kept = (-0.01 / correlation_s).exp();
    let mut torque = Vector3::zeros();
    let course: Vec<Vector3<f64>> = (0..6_001)
        .map(|_| {
            let step = Vector3::from_fn(|_, _| normal(&mut rng)) * (1.0 - kept * kept).sqrt();
            torque = torque * kept + step * stddev_n_m;
            torque
        })
        .collect();
    let run = record(&model, 13, 60.0, Some(&|t, _, _| course[(t * 100.0).round() as usize]));
    let mut problem = problem_of(&model, &[run]);
    let point = problem.reference.point();
    problem.smooth(&point, ProcessNoise::Fixed(FREE_RATE_WALK)).unwrap();
    let found = problem.background(
        problem.likeliest_noise(&point, &[], crate::search::noise_optimisation::Sizes::Any).unwrap().sizes,
    );
    // Of the torque that there was; sizes are steps of a factor of three, and the nearest is off by half of one at most.
    let squares: f64 = course.iter().map(|torque| torque.norm_squared()).sum();
    let there_was = (squares / (3.0 * course.len() as f64)).sqrt();
    assert!((found.stddev_n_m / there_was).ln().abs() <= 3f64.ln() / 2.0, "{there_was}: {found:?}");
}

#[test]
fn wheels_that_nobody_watches_may_drag_either_way() {
    let mut model = PlatformModel::whorl_1_reference();
    for wheel in model.wheels_mut() {
        (wheel.coulomb_friction_n_m, wheel.viscous_friction_n_m_s) = (0.0, 0.0);
    }
    // 4 mN m of one wheel and 0.1 mN m s of another at 30 rad/s: together 5 mN m, in the root of 20 s.
    model.wheels_mut()[0].coulomb_friction_n_m = 4e-3;
    let worn = &mut model.wheels_mut()[1];
    (worn.viscous_friction_n_m_s, worn.max_speed_rad_s) = (1e-4, 100.0);
    let watched = record(&PlatformModel::whorl_1_reference(), 3, 11.0, None);
    let mut unwatched = watched.clone();
    unwatched.wheel_speed_rad_s = whorl_recording::Series::default();
    let problem = problem_of(&model, &[watched, unwatched]);
    assert_eq!(problem.settings(0).torque_walk, 0.0);
    assert!((problem.settings(1).torque_walk - 1.118_034e-3).abs() < 1e-9, "{:?}", problem.settings(1));
}

#[test]
fn dry_friction_at_rest_moves_the_rate_as_a_torque_that_changes_its_mind() {
    const FRICTION_N_M: f64 = 2e-3;
    let mut model = PlatformModel::whorl_1_reference();
    model.effects = map(&[("bearing_coulomb_friction", &[("torque_n_m", FRICTION_N_M)])]);
    let problem = problem_of(&model, &[record(&model, 3, 11.0, None)]);
    let mechanics = Mechanics::new(&model).unwrap();
    let (run, mut motion) = (&problem.runs[0], problem.motions[0].clone());
    motion.omega_mid[0] = Vector3::zeros();
    motion.omega_mid[1] = Vector3::new(0.0, 0.0, 1.5e-3);
    motion.omega_mid[2] = Vector3::new(0.0, 0.0, 0.05);
    let (_, prediction) = predict(&mechanics, run, &motion);
    let settings = problem.settings(0);
    let system = System { run, motion: &motion, mechanics: &mechanics, prediction: &prediction, settings };

    // A torque of that size which forgets itself within a tenth of a second, on the mean resisting inertia.
    let inverse_inertia = mechanics.inverse_inertia().diagonal().mean();
    let (step_s, steps, correlation_s) = (0.01, 4_000, 0.1_f64);
    let kept = (-step_s / correlation_s).exp();
    let mut rng = random(9);
    let mut square = 0.0;
    let trials = 1_500;
    for _ in 0..trials {
        let (mut torque_n_m, mut rate_rad_s) = (FRICTION_N_M * normal(&mut rng), 0.0);
        for _ in 0..steps {
            rate_rad_s += torque_n_m * inverse_inertia * step_s;
            torque_n_m = kept * torque_n_m + FRICTION_N_M * (1.0 - kept * kept).sqrt() * normal(&mut rng);
        }
        square += rate_rad_s * rate_rad_s / f64::from(trials);
    }
    let simulated = (square / (f64::from(steps) * step_s)).sqrt();
    let at_rest = system.stiction_walk(0);
    assert!((at_rest / simulated - 1.0).abs() < 0.06, "{at_rest} against {simulated}");
    // Half-way to the speed at which a gyro sees it turn, half of it; then none.
    assert!((system.stiction_walk(1) / at_rest - 0.5).abs() < 1e-9);
    assert_eq!(system.stiction_walk(2), 0.0);
}

#[test]
fn a_gyro_whose_noise_is_coloured_is_no_torque() {
    let model = steady();
    let mut run = record(&model, 14, 60.0, None);
    // A first-order autoregressive process about each axis, three times as large as the white noise.
    let (kept, mut rng, mut noise) = (0.7_f64, random(9), Vector3::zeros());
    let size = 3.0 * model.sensors.gyro.errors.noise_stddev.mean() * (1.0 - kept * kept).sqrt();
    for value in &mut run.gyro_b_rad_s.value {
        noise = noise * kept + Vector3::from_fn(|_, _| normal(&mut rng)) * size;
        *value += noise;
    }
    let mut problem = problem_of(&model, &[run]);
    let point = problem.reference.point();
    problem.smooth(&point, ProcessNoise::Fixed(FREE_RATE_WALK)).unwrap();
    let found = problem.likeliest_noise(&point, &[], crate::search::noise_optimisation::Sizes::Any).unwrap();
    assert_eq!(found.sizes, Nuisance::default());
    // Of the sum with white noise: ten times the power at lag zero, 9 x 0.7 of it at lag one.
    let gyro = &found.ar_models[0][0];
    let correlation = gyro.coefficients.first().copied().unwrap_or(0.0);
    assert!(correlation > 0.3 && gyro.stddev > 1.05, "{gyro:?}");
}
