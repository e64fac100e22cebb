//! Laws that a plant was given in closed form, to be found again.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::Effect;
use whorl_dynamics::effects::catalogue;
use whorl_dynamics::{InitialState, ModelPrior, Plant, PlatformModel};
use whorl_recording::{Recording, Series, VectorChannel};

use super::*;
use crate::Options;

/// A run of 40 s at 100 Hz: yaw swings by its wheel, the rest hangs freely; `torque` acts besides, body axes [N m].
fn recorded(
    model: &PlatformModel,
    seed: u64,
    torque: impl Fn(&Vector3<f64>, &Vector3<f64>) -> Vector3<f64>,
) -> Recording {
    let initial = InitialState {
        q_world_body: UnitQuaternion::from_euler_angles(0.02, -0.015, 0.3 * seed as f64),
        omega_wb_b_rad_s: Vector3::new(0.004, -0.006, 0.02),
        wheel_speed_rad_s: vec![5.0, -8.0, 30.0],
        ..InitialState::default()
    };
    let mut plant = Plant::new(model, &initial, seed).unwrap();
    let mut run = Recording {
        name: format!("run_{seed}"),
        platform: "whorl_1".to_owned(),
        jet_pulses: vec![Vec::new(); model.jets().len()],
        vectors: model
            .sensors
            .vector
            .iter()
            .map(|v| VectorChannel {
                reference_world: v.reference_direction_world,
                direction_b: Series::default(),
            })
            .collect(),
        ..Recording::default()
    };
    for k in 0..4000_i64 {
        let t = 0.01 * k as f64;
        plant.advance_to(k * 10_000_000).unwrap();
        let state = *plant.state();
        let vertical_b = state.q_world_body.inverse_transform_vector(&Vector3::z());
        plant.set_body_torque(torque(&state.omega_wb_b_rad_s, &vertical_b));
        let imu = plant.sample_imu();
        let push3 = |series: &mut Series<Vector3<f64>>, value| {
            series.time_s.push(t);
            series.value.push(value);
        };
        push3(&mut run.gyro_b_rad_s, imu.angular_velocity_rad_s);
        push3(&mut run.specific_force_b_m_s2, imu.specific_force_m_s2);
        run.wheel_speed_rad_s.time_s.push(t);
        run.wheel_speed_rad_s.value.push(plant.sample_wheels().iter().map(|s| s.speed_rad_s).collect());
        if k % 10 == 0
            && let Some(sample) = plant.sample_vector()
        {
            push3(&mut run.vectors[0].direction_b, sample.direction.into_inner());
        }
        let swing = 0.25 * (0.45 * t + seed as f64).sin() + 0.12 * (1.3 * t).sin();
        let command = vec![0.01 * (0.7 * t).sin(), -0.01 * (0.5 * t).cos(), swing];
        plant.command_wheels(&command).unwrap();
        run.wheel_torque_command_n_m.time_s.push(t);
        run.wheel_torque_command_n_m.value.push(command);
    }
    run
}

/// `id`: each test has its own, as the catalogue is one for the process.
fn found(id: &str, torque: impl Fn(&Vector3<f64>, &Vector3<f64>) -> Vector3<f64> + Copy) -> Discovery {
    let model = PlatformModel::whorl_1_reference();
    let training = [recorded(&model, 1, torque), recorded(&model, 2, torque)];
    let held_out = [recorded(&model, 3, torque)];
    let prior = ModelPrior::typical(&model);
    let named = [vec!["bearing_viscous_friction".to_owned()]];
    let is_done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        // What is only tried is in the catalogue at no time: who diagnoses meanwhile would take it for an effect.
        let listed = scope.spawn(|| {
            let is_tried = |effect: &&dyn Effect| effect.info().id.starts_with(&format!("{id}_candidate_"));
            while !is_done.load(Ordering::Relaxed) {
                assert!(!catalogue().iter().any(is_tried));
                std::thread::sleep(Duration::from_millis(20));
            }
        });
        let options = Options::default();
        let found = discover(&training, &held_out, &model, &prior, &named, id, &options, &mut |_, _| {});
        is_done.store(true, Ordering::Relaxed);
        listed.join().unwrap();
        found.unwrap()
    })
}

#[test]
fn a_torque_with_the_square_of_the_yaw_rate_is_found() {
    let discovery = found("t_found", |rate, vertical_b| vertical_b * (3.0 * rate.z * rate.z));
    let best = discovery.best().unwrap_or_else(|| panic!("{:#?}", discovery.laws));
    assert!(best.equation.starts_with("k * rate.z^2 * "), "{:#?}", discovery.laws);
    let k = best.parameters.iter().find(|p| p.name == "k").unwrap();
    assert!((k.value - 3.0).abs() < 0.15 && k.unit == "N m s^2", "{k:?}");
    assert!(best.held_out_gain.unwrap() > 10.0 && best.probability > 0.5, "{best:?}");
    // What was only tried is no part of the catalogue.
    assert!(whorl_dynamics::effects::find("t_found").is_none());
    // It can be written, read and registered.
    let definition = best.definition.clone().unwrap();
    let folder = std::env::temp_dir().join(format!("whorl_identification_{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("t_found.yaml");
    std::fs::write(&path, whorl_params::effect_yaml(&definition, "a test")).unwrap();
    let read = whorl_params::read_effect(&path);
    std::fs::remove_dir_all(&folder).unwrap();
    assert_eq!(read.unwrap().definition(), &definition);
}

#[test]
fn no_law_is_invented_where_nothing_is_missing() {
    let discovery = found("t_nothing", |_, _| Vector3::zeros());
    assert!(discovery.best().is_none(), "{:#?}", discovery.laws);
    assert_eq!(discovery.laws.first().map(|law| law.kind), Some("nothing"));
}
