//! Synthetic residuals with a known answer.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::*;

const SIGMA_N_M: f64 = 1e-3;

/// 600 values of half a second, the platform turning about the vertical at a varying rate, slightly tilted.
struct Run {
    time_s: Vec<f64>,
    yaw_rad: Vec<f64>,
    yaw_rate_rad_s: Vec<f64>,
    random: Pcg64,
}

impl Run {
    fn new(seed: u64) -> Self {
        let time_s: Vec<f64> = (0..600).map(|k| 0.5 * k as f64).collect();
        // 0.15 sin(0.11 t) + 0.05 sin(0.37 t) + 0.03 and its integral.
        let rate = |t: &f64| 0.15 * (0.11 * t).sin() + 0.05 * (0.37 * t).sin() + 0.03;
        let angle = |t: &f64| {
            -0.15 / 0.11 * ((0.11 * t).cos() - 1.0) - 0.05 / 0.37 * ((0.37 * t).cos() - 1.0) + 0.03 * t
        };
        Self {
            yaw_rad: time_s.iter().map(angle).collect(),
            yaw_rate_rad_s: time_s.iter().map(rate).collect(),
            time_s,
            random: Pcg64::new(u128::from(seed), 1),
        }
    }

    fn residual(&mut self, torque_b: impl Fn(usize, &UnitQuaternion<f64>, f64) -> Vector3<f64>) -> Residual {
        let (mut torques, mut attitudes) = (Vec::new(), Vec::new());
        for k in 0..self.time_s.len() {
            let q = UnitQuaternion::from_euler_angles(0.03, -0.02, self.yaw_rad[k]);
            let noise = Vector3::from_fn(|_, _| StandardNormal.sample(&mut self.random));
            torques.push(torque_b(k, &q, self.yaw_rate_rad_s[k]) + noise * SIGMA_N_M);
            attitudes.push(q);
        }
        let noise = vec![Matrix3::identity() * SIGMA_N_M.powi(2); torques.len()];
        Residual::of_body(self.time_s.clone(), &torques, &noise, &attitudes)
    }

    fn variables(&self) -> Vec<Variable> {
        let angle = |yaw: &f64| (yaw + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0;
        let other = |t: &f64| (0.23 * t + 1.0).sin();
        vec![
            Variable::new("time", "s", 1.0, self.time_s.clone()),
            Variable::new("yaw_rate", "rad/s", 1e-3, self.yaw_rate_rad_s.clone()),
            Variable {
                period: Some(TAU),
                ..Variable::new("azimuth", "rad", 0.02, self.yaw_rad.iter().map(angle).collect())
            },
            Variable::new("unrelated", "1", 0.01, self.time_s.iter().map(other).collect()),
            Variable::new("constant", "V", 0.1, vec![24.0; self.time_s.len()]),
        ]
    }
}

/// Of one run.
fn dependences_of(residual: &Residual, variables: &[Variable]) -> Result<Dependences, DependenceError> {
    dependences(std::slice::from_ref(residual), &[variables.to_vec()])
}

#[test]
fn coulomb_friction_is_an_odd_saturating_function_of_yaw_rate() {
    let mut run = Run::new(1);
    let residual = run.residual(|_, _, rate| Vector3::new(0.0, 0.0, -5e-3 * (rate / 0.01).tanh()));
    let found = dependences_of(&residual, &run.variables()).unwrap();
    let top = &found.ranked[0];
    assert_eq!(top.variable, "yaw_rate");
    assert_eq!((top.frame, top.axis), (Frame::Body, 2));
    assert_eq!((top.parity, top.growth), (Parity::Odd, Growth::Saturates));
    assert!(top.share > 0.85, "{}", top.share);
    assert!(found.ranked.iter().all(|d| d.variable != "constant"));
    let unrelated = found.ranked.iter().find(|d| d.variable == "unrelated").unwrap();
    assert!(unrelated.share < 0.4, "{}", unrelated.share);
}

#[test]
fn the_curve_has_the_true_value_within_its_band() {
    let (mut inside, mut all) = (0, 0);
    for seed in 100..130 {
        let mut run = Run::new(seed);
        let residual = run.residual(|_, _, rate| Vector3::new(0.0, 0.0, -0.04 * rate));
        let found = dependences_of(&residual, &run.variables()).unwrap();
        let top = &found.ranked[0];
        let summary = (top.variable.as_str(), top.parity, top.growth);
        assert_eq!(summary, ("yaw_rate", Parity::Odd, Growth::Linear));
        let places = top.shape.x.iter().zip(&top.shape.torque_n_m[2]).zip(&top.shape.stddev_n_m[2]);
        for ((x, value), stddev) in places {
            inside += usize::from((value + 0.04 * x).abs() < 2.0 * stddev);
            all += 1;
            assert!(*stddev < SIGMA_N_M);
        }
    }
    assert!(inside * 100 >= all * 85, "{inside} of {all}");
}

#[test]
fn drag_grows_faster_than_the_rate() {
    let mut run = Run::new(3);
    let residual = run.residual(|_, _, rate| Vector3::new(0.0, 0.0, -0.5 * rate * rate.abs()));
    let found = dependences_of(&residual, &run.variables()).unwrap();
    let top = &found.ranked[0];
    assert_eq!(
        (top.variable.as_str(), top.parity, top.growth),
        ("yaw_rate", Parity::Odd, Growth::Superlinear)
    );
}

#[test]
fn a_draught_is_constant_in_the_room_and_a_turbine_on_the_platform() {
    let mut run = Run::new(4);
    let draught = run.residual(|_, q, _| q.inverse_transform_vector(&Vector3::new(4e-3, -3e-3, 0.0)));
    let found = dependences_of(&draught, &run.variables()).unwrap();
    assert!(found.constant_world_share > 0.95, "{}", found.constant_world_share);
    assert!(found.constant_body_share < 0.3, "{}", found.constant_body_share);
    assert!((found.mean_world_n_m[0] - 4e-3).abs() < 2e-4);
    let turbine = run.residual(|_, _, _| Vector3::new(2e-3, 0.0, 4e-3));
    let found = dependences_of(&turbine, &run.variables()).unwrap();
    assert!(found.constant_body_share > 0.95, "{}", found.constant_body_share);
}

#[test]
fn a_spring_in_yaw_is_seen_in_azimuth() {
    let mut run = Run::new(5);
    let residual = run.residual(|k, _, _| {
        let yaw = (0.11 * 0.5 * k as f64).cos();
        Vector3::new(0.0, 0.0, 5e-3 * yaw)
    });
    // The heading is only roughly periodic: a torque with a different period must not be attributed to the azimuth.
    let found = dependences_of(&residual, &run.variables()).unwrap();
    assert_ne!(found.ranked[0].variable, "azimuth");
    let heading = run.yaw_rad.clone();
    let residual = run.residual(|k, _, _| Vector3::new(0.0, 0.0, 5e-3 * (2.0 * heading[k]).sin()));
    let found = dependences_of(&residual, &run.variables()).unwrap();
    assert_eq!(found.ranked[0].variable, "azimuth");
    assert!(found.ranked[0].share > 0.9, "{}", found.ranked[0].share);
}

#[test]
fn noise_alone_depends_on_nothing() {
    for seed in 10..20 {
        let mut run = Run::new(seed);
        let residual = run.residual(|_, _, _| Vector3::zeros());
        let found = dependences_of(&residual, &run.variables()).unwrap();
        assert!((found.mean_square_whitened - 1.0).abs() < 0.15, "{}", found.mean_square_whitened);
        assert!(found.excess < 0.1, "{}", found.excess);
        assert_eq!(found.line, None);
    }
}

#[test]
fn a_line_is_found_at_its_frequency() {
    let mut run = Run::new(30);
    let residual = run.residual(|k, q, _| {
        q.inverse_transform_vector(&Vector3::new(0.0, 3e-3 * (TAU * 0.09 * 0.5 * k as f64).sin(), 0.0))
    });
    let line = dependences_of(&residual, &run.variables()).unwrap().line.unwrap();
    assert!((line.frequency_hz - 0.09).abs() < 0.004, "{}", line.frequency_hz);
    assert_eq!((line.frame, line.axis), (Frame::World, 1));
    assert!((line.amplitude_n_m - 3e-3).abs() < 3e-4, "{}", line.amplitude_n_m);
}

#[test]
fn unusable_residuals_are_refused() {
    let time_s: Vec<f64> = (0..50).map(f64::from).collect();
    let torques = vec![Vector3::zeros(); 50];
    let noise = vec![Matrix3::identity(); 50];
    let level = vec![UnitQuaternion::identity(); 50];
    let of = |torques: &[Vector3<f64>], noise: &[Matrix3<f64>]| {
        dependences_of(&Residual::of_body(time_s.clone(), torques, noise, &level), &[])
    };
    assert!(of(&torques, &noise).is_ok());
    let short = Residual::of_body(time_s[..5].to_vec(), &torques[..5], &noise[..5], &level[..5]);
    assert_eq!(dependences_of(&short, &[]), Err(DependenceError::TooFewValues { given: 5 }));
    let mut poisoned = torques.clone();
    poisoned[7].y = f64::NAN;
    assert!(matches!(of(&poisoned, &noise), Err(DependenceError::NotUsable(_))));
    let mut unknown = noise;
    unknown[0][(0, 0)] = f64::NAN;
    assert!(matches!(of(&torques, &unknown), Err(DependenceError::NotUsable(_))));
    let certain = vec![Matrix3::zeros(); 50];
    assert!(matches!(of(&torques, &certain), Err(DependenceError::NotUsable(_))));
}

/// A motor's torque over its speed, in the one direction that it has.
#[test]
fn a_motor_has_one_axis() {
    let mut run = Run::new(41);
    let residual = run.residual(|_, _, rate| Vector3::new(0.0, 0.0, -0.03 * rate));
    let (_, axes) = residual.frames().next().unwrap();
    let motor = Residual::of_motor(run.time_s.clone(), axes[2].clone());
    let found = dependences_of(&motor, &run.variables()).unwrap();
    let first = &found.ranked[0];
    assert_eq!((first.variable.as_str(), first.frame, first.axis), ("yaw_rate", Frame::Wheel, 0));
    assert!(first.share > 0.8 && first.parity == Parity::Odd && first.growth == Growth::Linear);
    assert_eq!((found.constant_world_share, found.mean_world_n_m), (0.0, [0.0; 3]));
}

/// Friction in two runs, one at rest and one that turns: together they show one curve, over the rates of both.
#[test]
fn runs_that_are_taken_together_share_one_curve() {
    let friction = |_: usize, _: &UnitQuaternion<f64>, rate: f64| Vector3::new(0.0, 0.0, -0.03 * rate);
    let (mut slow, mut fast) = (Run::new(50), Run::new(51));
    slow.yaw_rate_rad_s.iter_mut().for_each(|rate| *rate *= 0.1);
    let residuals = [slow.residual(friction), fast.residual(friction)];
    let mut lacking = slow.variables();
    lacking.retain(|v| v.name != "azimuth");
    let found = dependences(&residuals, &[lacking, fast.variables()]).unwrap();
    let alone = dependences_of(&residuals[0], &slow.variables()).unwrap();
    assert!(found.ranked.iter().all(|d| d.variable != "azimuth"), "not every run has it");
    let first = &found.ranked[0];
    assert_eq!((first.variable.as_str(), first.axis, first.parity), ("yaw_rate", 2, Parity::Odd));
    assert!(first.share > 0.8 && found.excess > alone.excess, "{} {}", first.share, alone.excess);
}
