//! Where models of simulated runs fail.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use whorl_dynamics::platform::{TiltLimit, Wheel};
use whorl_dynamics::{Freedom, PlatformModel};
use whorl_recording::{Mounting, Recording};

use super::generator::{platform, record, turning};
use crate::{Growth, Parity};
use crate::{Localisation, explain_where, unexplained_torques};

fn located(recording: &whorl_recording::Recording, model: &PlatformModel) -> Localisation {
    explain_where(&[(recording, &unexplained_torques(recording, model, None).unwrap())], model)
}

fn with_effect(model: &PlatformModel, id: &str, parameters: &[(&str, f64)]) -> PlatformModel {
    let mut truth = model.clone();
    let parameters = parameters.iter().map(|(name, value)| ((*name).to_owned(), *value));
    truth.effects.insert(id.to_owned(), parameters.collect::<BTreeMap<_, _>>());
    truth
}

/// It acts about every axis, and the curve is the law.
#[test]
fn friction_is_found_in_the_rates() {
    let model = platform();
    let c_n_m_s = 0.3;
    let truth = with_effect(&model, "bearing_viscous_friction", &[("c_n_m_s", c_n_m_s)]);
    let where_ = located(&record(&truth, &turning()), &model);
    let answer = where_.answer();
    let first = &where_.dependences.as_ref().unwrap().ranked[0];
    assert_eq!(
        (first.variable.as_str(), first.parity, first.growth),
        ("rate_about_the_same_axis", Parity::Odd, Growth::Linear),
        "{answer:?}"
    );
    assert!(first.share > 0.9, "{answer:?}");
    assert!(
        answer[1].contains("rate about the same axis") && answer[1].contains("in proportion"),
        "{answer:?}"
    );
    let (x, torque) = (&first.shape.x, &first.shape.torque_n_m[2]);
    let slope = (torque[30] - torque[10]) / (x[30] - x[10]);
    assert!((slope / -c_n_m_s - 1.0).abs() < 0.1, "{slope}");
    assert!(where_.motors.iter().all(|motor| motor.dependences.is_none()), "{answer:?}");
}

#[test]
fn the_right_model_leaves_nothing_to_locate() {
    let model = platform();
    let where_ = located(&record(&model, &turning()), &model);
    let answer = where_.answer();
    assert!(answer.len() == 1 && answer[0].contains("nothing to locate"), "{answer:?}");
}

/// A draught is constant in the room while the platform turns.
#[test]
fn a_draught_is_found_within_its_deviation() {
    let model = platform();
    let expected = Vector3::new(0.02, 0.0, -0.01);
    let truth = with_effect(&model, "air_current", &[("t_x_n_m", expected.x), ("t_z_n_m", expected.z)]);
    let recording = record(&truth, &turning());
    let found = unexplained_torques(&recording, &model, None).unwrap();
    let (mut inside, mut all, mut mean) = (0, 0, Vector3::zeros());
    for state in &found.states {
        let off = state.torque_b_n_m - state.q_world_body.inverse_transform_vector(&expected);
        inside += (0..3).filter(|i| off[*i].abs() < 2.0 * state.torque_covariance_b[(*i, *i)].sqrt()).count();
        all += 3;
        mean += state.q_world_body * state.torque_b_n_m / found.states.len() as f64;
    }
    assert!(inside * 100 > all * 90, "{inside} of {all}");
    assert!((mean - expected).norm() < 3e-3, "{mean}");
    let where_ = located(&recording, &model);
    assert!(where_.dependences.as_ref().unwrap().constant_world_share > 0.9, "{:?}", where_.answer());
}

/// A constant torque about the vertical has a name, and nothing is said to be a function of what merely moved meanwhile.
#[test]
fn a_constant_torque_has_a_name() {
    let model = platform();
    let truth = with_effect(&model, "bearing_turbine", &[("vertical_n_m", 0.03)]);
    let where_ = located(&record(&truth, &turning()), &model);
    let answer = where_.answer();
    assert!(answer[1].contains("a constant torque of ") && answer[1].contains("the vertical"), "{answer:?}");
    assert_eq!(answer.len(), 2, "{answer:?}");
    // Every curve is about the axis of which it is drawn largest.
    for d in &where_.dependences.as_ref().unwrap().ranked {
        assert!(d.axis == 2 || d.share < 0.5, "{} about axis {}", d.variable, d.axis);
    }
}

/// A wheel on a bench, whatever its size: what its motor loses depends on its speed, and what a wrong constant gives on its command.
#[test]
fn on_a_bench_the_motor_is_located() {
    for size in [1.0, 1e-4] {
        let wheel = Wheel {
            name: "rw_1".to_owned(),
            spin_axis_b: Vector3::x_axis(),
            spin_inertia_kg_m2: 4e-3 * size,
            max_torque_n_m: 0.05 * size,
            max_speed_rad_s: 1e4,
            viscous_friction_n_m_s: 0.0,
            coulomb_friction_n_m: 0.0,
        };
        let mut model = platform();
        model.freedom = Freedom::Clamped;
        model.jets_mut().clear();
        *model.wheels_mut() = vec![wheel];
        model.sensors.wheel_speed.noise_stddev_rad_s = 0.1;
        model.sensors.wheel_speed.quantum_rad_s = 0.0;
        for (loss_per_s, constant, named) in [
            (0.05, 1.0, "function of rw 1 speed"),
            (0.0, 1.3, "function of rw 1 torque command"),
            (0.0, 1.0, "nothing to locate"),
        ] {
            // J dw/dt = constant u - loss J w, by Euler's rule in steps of a tenth of a sample.
            let mut random = Pcg64::new(7, 3);
            let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
            let mut r =
                Recording { name: "bench".to_owned(), mounting: Mounting::Clamped, ..Recording::default() };
            let mut speed = 0.0;
            for k in 0..6000 {
                let t = f64::from(k) * 0.01;
                let command = 0.03 * size * ((0.9 * t).sin() + 0.5 * (2.3 * t).cos());
                r.wheel_speed_rad_s.time_s.push(t);
                r.wheel_speed_rad_s.value.push(vec![speed + 0.1 * normal()]);
                r.wheel_torque_command_n_m.time_s.push(t);
                r.wheel_torque_command_n_m.value.push(vec![command]);
                for _ in 0..10 {
                    speed += 1e-3 * (constant * command / (4e-3 * size) - loss_per_s * speed);
                }
            }
            let where_ = located(&r, &model);
            let answer = where_.answer();
            assert!(answer.iter().any(|sentence| sentence.contains(named)), "{size} {named}: {answer:?}");
            assert_eq!(where_.dependences, None);
            let Some(found) = &where_.motors[0].dependences else { continue };
            let first = &found.ranked[0];
            assert!(first.share > 0.9 && first.growth == Growth::Linear, "{answer:?}");
            let (x, torque) = (&first.shape.x, &first.shape.torque_n_m[0]);
            let slope = (torque[30] - torque[10]) / (x[30] - x[10]);
            let expected = if constant > 1.0 { constant - 1.0 } else { -loss_per_s * 4e-3 * size };
            assert!((slope / expected - 1.0).abs() < 0.1, "{slope} for {expected}: {answer:?}");
        }
    }
}

/// A rig that never moves, and one that was recorded for a moment.
#[test]
fn what_a_run_does_not_show_is_said() {
    let mut model = platform();
    (model.freedom, model.tilt_limit) = (Freedom::Free, TiltLimit::NONE);
    model.sensors.accelerometer.fitted = false;
    let mut random = Pcg64::new(9, 3);
    let mut still = |samples: i32| {
        let mut r = Recording { name: "still".to_owned(), ..Recording::default() };
        for k in 0..samples {
            let noise = Vector3::from_fn(|_, _| StandardNormal.sample(&mut random));
            r.gyro_b_rad_s.time_s.push(f64::from(k) * 0.01);
            r.gyro_b_rad_s.value.push(noise * model.sensors.gyro.errors.noise_stddev.x);
        }
        r
    };
    let where_ = located(&still(3000), &model);
    assert!(!where_.is_anything_left(), "{:?}", where_.answer());
    assert!(
        where_.remarks.iter().any(|remark| remark.contains("moves beyond its noise")),
        "{:?}",
        where_.remarks
    );
    let short = unexplained_torques(&still(40), &model, None).unwrap_err().to_string();
    assert_eq!(short, "still: 40 readings of the gyro are too few; record at least 50");
    let nothing = Recording { name: "empty".to_owned(), ..Recording::default() };
    let empty = unexplained_torques(&nothing, &model, None).unwrap_err().to_string();
    assert!(empty.starts_with("empty: there are no gyro data"), "{empty}");
}
