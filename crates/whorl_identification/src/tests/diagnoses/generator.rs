//! Recordings of simulated runs for tests: wheels by multisine, pulses of jets, free swing.

use nalgebra::{UnitQuaternion, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeMap;
use whorl_dynamics::actuators::Kind;
use whorl_dynamics::{InitialState, MassProperties, ModelPrior, Plant, PlatformModel};
use whorl_recording::{OnInterval, Recording, Series, VectorChannel};

pub(crate) fn map(effects: &[(&str, &[(&str, f64)])]) -> BTreeMap<String, BTreeMap<String, f64>> {
    effects
        .iter()
        .map(|(id, values)| {
            ((*id).to_owned(), values.iter().map(|(name, x)| ((*name).to_owned(), *x)).collect())
        })
        .collect()
}

pub(crate) fn normal(rng: &mut Pcg64Mcg) -> f64 {
    StandardNormal.sample(rng)
}

pub(crate) fn random(seed: u64) -> Pcg64Mcg {
    Pcg64Mcg::new(u128::from(seed).wrapping_mul(0x9e37_79b9_7f4a_7c15_f39c_c060_5ced_c835) | 1)
}

/// The model that a user would have of this truth: every constant wrong within its prior.
pub(crate) fn wrong_model(truth: &PlatformModel, seed: u64) -> (PlatformModel, ModelPrior) {
    let mut rng = random(seed ^ 0xabcd);
    let prior = ModelPrior::typical(truth);
    let mut model = truth.clone();
    model.effects.clear();
    let properties = &truth.mass_properties;
    loop {
        let mut inertia = *properties.inertia_b_kg_m2();
        for i in 0..3 {
            for j in 0..=i {
                let error = prior.inertia_b_kg_m2[(i, j)] * normal(&mut rng) * if i == j { 1.0 } else { 0.3 };
                inertia[(i, j)] += error;
                inertia[(j, i)] = inertia[(i, j)];
            }
        }
        let offset =
            properties.gravity_offset_b_n_m() + prior.gravity_offset_b_n_m.map(|s| s * normal(&mut rng));
        if let Ok(made) = MassProperties::new(inertia, offset, properties.mass_kg()) {
            model.mass_properties = made;
            break;
        }
    }
    for (wheel, s) in model.wheels_mut().iter_mut().zip(&prior.actuators.wheels.spin_inertia) {
        wheel.spin_inertia_kg_m2 *= 1.0 + s * normal(&mut rng);
    }
    for (jet, s) in model.jets_mut().iter_mut().zip(&prior.actuators.jets.thrust) {
        jet.thrust_n *= 1.0 + s * normal(&mut rng);
    }
    (model, prior)
}

/// A torque outside the catalogue, body axes, as function of time, attitude, rate.
pub(crate) type Extra<'a> = &'a dyn Fn(f64, &UnitQuaternion<f64>, &Vector3<f64>) -> Vector3<f64>;

/// Simulates a run of `duration_s` at 100 Hz.
pub(crate) fn record(
    truth: &PlatformModel,
    seed: u64,
    duration_s: f64,
    extra: Option<Extra<'_>>,
) -> Recording {
    let mut rng = random(seed);
    let tilt = Vector3::new(normal(&mut rng), normal(&mut rng), 0.0) * 0.02;
    let yaw = normal(&mut rng) * 1.5;
    let q = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw) * UnitQuaternion::from_scaled_axis(tilt);
    let spin = if normal(&mut rng) > 0.0 { 1.0 } else { -1.0 };
    let omega = Vector3::new(normal(&mut rng) * 0.01, normal(&mut rng) * 0.01, spin * 0.1);
    let wheels = truth.wheels().len();
    let bias: Vec<f64> =
        (0..wheels).map(|j| if j == 2 { 40.0 } else { 8.0 } * (1.0 + 0.3 * normal(&mut rng))).collect();
    let initial = InitialState {
        q_world_body: q,
        omega_wb_b_rad_s: omega,
        wheel_speed_rad_s: bias.clone(),
        ..InitialState::default()
    };
    let mut plant = Plant::new(truth, &initial, seed).unwrap();
    // Multisines for each wheel.
    let tones: Vec<Vec<(f64, f64, f64)>> = (0..wheels)
        .map(|j| {
            (0..5)
                .map(|i| {
                    let f = 0.03 * 1.9_f64.powi(i) * (1.0 + 0.11 * j as f64);
                    let size = if j == 2 { 0.08 } else { 0.02 };
                    (size * (0.6 + 0.4 * normal(&mut rng).abs()), f, std::f64::consts::TAU * normal(&mut rng))
                })
                .collect()
        })
        .collect();
    let steps = (duration_s * 100.0) as i64;
    let mut recording = Recording {
        name: format!("run_{seed}"),
        platform: "whorl_1".to_owned(),
        jet_pulses: vec![Vec::new(); truth.jets().len()],
        vectors: truth
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
    let mut next_pulse = 1.0;
    for k in 0..steps {
        let t = k as f64 * 0.01;
        plant.advance_to(k * 10_000_000).unwrap();
        if let Some(extra) = extra {
            let state = *plant.state();
            let torque = extra(t, &state.q_world_body, &state.omega_wb_b_rad_s);
            plant.set_body_torque(torque);
        }
        let imu = plant.sample_imu();
        recording.gyro_b_rad_s.time_s.push(t);
        recording.gyro_b_rad_s.value.push(imu.angular_velocity_rad_s);
        recording.specific_force_b_m_s2.time_s.push(t);
        recording.specific_force_b_m_s2.value.push(imu.specific_force_m_s2);
        let samples = plant.sample_wheels();
        recording.wheel_speed_rad_s.time_s.push(t);
        recording.wheel_speed_rad_s.value.push(samples.iter().map(|s| s.speed_rad_s).collect());
        if !truth.gyros().is_empty() {
            let gimbals = plant.sample_joints(Kind::ControlMomentGyros);
            for (series, numbers) in [
                (&mut recording.gimbal_angle_rad, gimbals.position_rad),
                (&mut recording.gimbal_rate_rad_s, gimbals.velocity_rad_s),
                (&mut recording.gimbal_torque_n_m, gimbals.effort_n_m),
            ] {
                series.time_s.push(t);
                series.value.push(numbers);
            }
            // Each gimbal swings at its own frequency.
            let swing = |j: usize| 0.4 * (0.4 * (1.0 + 0.37 * j as f64) * t + j as f64).sin();
            let rates: Vec<f64> = (0..truth.gyros().len()).map(swing).collect();
            plant.command_motors(Kind::ControlMomentGyros, &rates).unwrap();
        }
        if k % 10 == 0 {
            if let Some(sample) = plant.sample_vector() {
                recording.vectors[0].direction_b.time_s.push(t);
                recording.vectors[0].direction_b.value.push(sample.direction.into_inner());
            }
            recording.bus_voltage_v.time_s.push(t);
            recording.bus_voltage_v.value.push(plant.sample_bus_voltage_v());
            recording.tank_pressure_pa.time_s.push(t);
            recording.tank_pressure_pa.value.push(plant.sample_tank_pressure_pa());
            recording.temperature_k.time_s.push(t);
            recording.temperature_k.value.push(plant.sample_temperature_k());
        }
        let torque: Vec<f64> = tones
            .iter()
            .map(|list| list.iter().map(|(a, f, p)| a * (std::f64::consts::TAU * f * t + p).sin()).sum())
            .collect();
        plant.command_wheels(&torque).unwrap();
        recording.wheel_torque_command_n_m.time_s.push(t);
        recording.wheel_torque_command_n_m.value.push(torque);
        if t > next_pulse && t < duration_s - 2.0 {
            // Keep the platform about upright and its yaw rate bounded: pulses against the motion, mostly.
            let state = *plant.state();
            let rate = state.omega_wb_b_rad_s;
            let up = state.q_world_body.inverse_transform_vector(&Vector3::z());
            let wish = Vector3::new(-rate.x * 3.0 - up.y, -rate.y * 3.0 + up.x, 0.0) * 20.0
                + Vector3::new(
                    normal(&mut rng),
                    normal(&mut rng),
                    normal(&mut rng) * 0.8 - 3.0 * (rate.z - 0.1 * (0.05 * t).sin() * spin),
                );
            let jet = (0..truth.jets().len())
                .max_by(|a, b| {
                    let score = |j: &usize| {
                        truth.jets()[*j].torque_b_n_m().dot(&wish)
                            * (1.0 + 0.1 * ((*j * 7919 + k as usize) % 13) as f64)
                    };
                    score(a).total_cmp(&score(b))
                })
                .unwrap();
            let on_s = 0.05 + 0.25 * normal(&mut rng).abs().min(1.5);
            let on_s = (on_s * 100.0).round() / 100.0;
            if plant.command_jet_pulse(jet, k * 10_000_000, on_s).is_ok() {
                recording.jet_pulses[jet].push(OnInterval { on_s: t, off_s: t + on_s });
            }
            next_pulse = t + on_s + 0.5 + 1.5 * normal(&mut rng).abs();
        }
    }
    recording
}
