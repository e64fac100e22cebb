//! Synthetic residuals with a known answer.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use crate::dependence::*;
use crate::{Growth, Parity, quantities};
use whorl_dynamics::PlatformModel;

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
        let mut residual = Residual::new(Frame::Body);
        for k in 0..self.time_s.len() {
            let q = UnitQuaternion::from_euler_angles(0.03, -0.02, self.yaw_rad[k]);
            let noise = Vector3::from_fn(|_, _| StandardNormal.sample(&mut self.random));
            let torque = torque_b(k, &q, self.yaw_rate_rad_s[k]) + noise * SIGMA_N_M;
            let covariance = Matrix3::identity() * SIGMA_N_M.powi(2);
            residual.push_on_body(&torque, &covariance, q.to_rotation_matrix().matrix());
        }
        residual
    }

    fn variables(&self) -> Vec<Variable> {
        let all = quantities(&PlatformModel::whorl_1_reference(), []);
        let variable = |name: &str, values: Vec<f64>| {
            let quantity = all.iter().find(|of| of.name == name).unwrap().clone();
            let scale = quantity.scale(range(&values)).unwrap();
            Variable { quantity, values: vec![values], scale }
        };
        let angle = |yaw: &f64| (yaw + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0;
        let other = |t: &f64| (0.23 * t + 1.0).sin();
        vec![
            variable("time", self.time_s.clone()),
            variable("yaw_rate", self.yaw_rate_rad_s.clone()),
            variable("yaw", self.yaw_rad.iter().map(angle).collect()),
            variable("bus_voltage", self.time_s.iter().map(other).collect()),
        ]
    }
}

#[test]
fn coulomb_friction_is_an_odd_saturating_function_of_yaw_rate() {
    let mut run = Run::new(1);
    let residual = run.residual(|_, _, rate| Vector3::new(0.0, 0.0, -5e-3 * (rate / 0.01).tanh()));
    let found = dependences(&residual, &run.variables());
    let top = &found.ranked[0];
    assert_eq!(top.variable, "yaw_rate");
    assert_eq!((top.frame, top.axis), (Frame::Body, 2));
    assert_eq!((top.parity, top.growth), (Parity::Odd, Growth::Saturates));
    assert!(top.share > 0.85, "{}", top.share);
    let unrelated = found.ranked.iter().find(|d| d.variable == "bus_voltage").unwrap();
    assert!(unrelated.share < 0.4, "{}", unrelated.share);
}

#[test]
fn the_curve_has_the_true_value_within_its_band() {
    let (mut inside, mut all) = (0, 0);
    for seed in 100..130 {
        let mut run = Run::new(seed);
        let residual = run.residual(|_, _, rate| Vector3::new(0.0, 0.0, -0.04 * rate));
        let found = dependences(&residual, &run.variables());
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
    let found = dependences(&residual, &run.variables());
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
    let found = dependences(&draught, &run.variables());
    assert!(found.constant_world_share > 0.95, "{}", found.constant_world_share);
    assert!(found.constant_body_share < 0.3, "{}", found.constant_body_share);
    assert!((found.mean_world_n_m[0] - 4e-3).abs() < 2e-4);
    let turbine = run.residual(|_, _, _| Vector3::new(2e-3, 0.0, 4e-3));
    let found = dependences(&turbine, &run.variables());
    assert!(found.constant_body_share > 0.95, "{}", found.constant_body_share);
}

#[test]
fn a_spring_in_yaw_is_seen_in_the_heading() {
    let mut run = Run::new(5);
    let heading = run.yaw_rad.clone();
    let residual = run.residual(|k, _, _| Vector3::new(0.0, 0.0, 5e-3 * (2.0 * heading[k]).sin()));
    let found = dependences(&residual, &run.variables());
    assert_eq!(found.ranked[0].variable, "yaw");
    assert!(found.ranked[0].share > 0.9, "{}", found.ranked[0].share);
}

#[test]
fn noise_alone_depends_on_nothing() {
    for seed in 10..20 {
        let mut run = Run::new(seed);
        let residual = run.residual(|_, _, _| Vector3::zeros());
        let found = dependences(&residual, &run.variables());
        assert!(found.excess < 0.1, "{}", found.excess);
    }
}

/// A motor's torque over its speed, in the one direction that it has.
#[test]
fn a_motor_has_one_axis() {
    let mut run = Run::new(41);
    let residual = run.residual(|_, _, rate| Vector3::new(0.0, 0.0, -0.03 * rate));
    let mut motor = Residual::new(Frame::Wheel);
    residual.torques.iter().for_each(|torque| motor.push_about_one(torque[2]));
    let found = dependences(&motor, &run.variables());
    let first = &found.ranked[0];
    assert_eq!((first.variable.as_str(), first.frame, first.axis), ("yaw_rate", Frame::Wheel, 0));
    assert!(first.share > 0.8 && first.parity == Parity::Odd && first.growth == Growth::Linear);
    assert_eq!((found.constant_world_share, found.mean_world_n_m), (0.0, [0.0; 3]));
}
