//! Requirements on every effect of the catalogue.

mod search;
mod sources;

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Unit, UnitQuaternion, Vector3};

use super::{
    Effect, EffectError, EffectKind, EffectSet, ParameterSpec, Part, Signature, TrueImu, catalogue, describe,
    find,
};
use crate::actuators::{ActuatorKind, Kind};
use crate::sensing::{ImuSample, VectorSample, WheelSample};
use crate::{Environment, InitialState, Plant, PlatformModel};

type Values = BTreeMap<String, f64>;

/// Whorl-I with two control moment gyros beside its wheels and jets: every effect has its part.
fn platform() -> PlatformModel {
    let mut model = PlatformModel::whorl_1_reference();
    let axes = [(Vector3::new(0.3, 1.0, -0.2), Vector3::x()), (Vector3::new(-0.5, 0.2, 1.0), Vector3::y())];
    for (name, (gimbal, spin)) in ["cmg_a", "cmg_b"].into_iter().zip(axes) {
        model.actuators.control_moment_gyros.add(name.to_owned());
        let gyro = model.gyros_mut().last_mut().unwrap();
        (gyro.gimbal_axis_b, gyro.spin_axis_b) = (Unit::new_normalize(gimbal), Unit::new_normalize(spin));
        gyro.rotor_momentum_n_m_s = 0.8;
        gyro.gimbal_inertia_kg_m2 = 6e-3;
        (gyro.max_rate_rad_s, gyro.max_angle_rad, gyro.time_constant_s) = (1.0, 6.0, 4e-3);
    }
    model
}

fn with_effect(effect: &dyn Effect, values: &[(ParameterSpec, f64)]) -> PlatformModel {
    let mut model = platform();
    let values: Values = values.iter().map(|(spec, x)| (spec.name.clone(), *x)).collect();
    model.effects.insert(effect.info().id.to_owned(), values);
    model
}

fn specs(effect: &dyn Effect) -> Vec<ParameterSpec> {
    effect.parameters(&platform())
}

fn neutral(effect: &dyn Effect) -> Vec<(ParameterSpec, f64)> {
    specs(effect).into_iter().map(|spec| (spec.clone(), spec.neutral)).collect()
}

/// One prior standard deviation off neutral, inside the range.
fn present(effect: &dyn Effect) -> Vec<(ParameterSpec, f64)> {
    let off = |spec: &ParameterSpec| {
        let up = spec.neutral + spec.prior_stddev;
        if up <= spec.max { up } else { (spec.neutral - spec.prior_stddev).max(spec.min) }
    };
    specs(effect)
        .into_iter()
        .map(|spec| (spec.clone(), if spec.known { spec.neutral } else { off(&spec) }))
        .collect()
}

/// Everything a run can show.
type Record = (
    Vec<(UnitQuaternion<f64>, Vector3<f64>, [f64; 3], f64)>,
    Vec<ImuSample>,
    Vec<VectorSample>,
    Vec<WheelSample>,
    Vec<[f64; 6]>,
);

/// A run that moves everything: tilt, spin past the gyro's range, wheels, jets, ballast, into the stop.
fn rich_run(model: &PlatformModel) -> Record {
    let initial = InitialState {
        q_world_body: UnitQuaternion::from_euler_angles(0.05, 0.03, 0.8),
        omega_wb_b_rad_s: Vector3::new(0.10, -0.15, 1.2),
        wheel_speed_rad_s: vec![40.0, -30.0, 20.0],
        ..InitialState::default()
    };
    let mut plant = Plant::new(model, &initial, 7).unwrap();
    let mut record: Record = (Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for slot in 0..100_i64 {
        let now_ns = slot * 20_000_000;
        let phase = slot as f64;
        plant.command_wheels(&[0.2 * (0.3 * phase).sin(), 0.1, -0.2 * (0.2 * phase).cos()]).unwrap();
        plant.command_motors(Kind::ControlMomentGyros, &[0.5 * (0.2 * phase).sin(), -0.3]).unwrap();
        plant.command_jet_pulse((slot % 12) as usize, now_ns, 0.0151).unwrap();
        plant
            .set_ballast_moment(Vector3::new((0.1 * phase).sin(), (0.13 * phase).cos(), 0.02 * phase) * 0.01);
        plant.advance_to(now_ns + 20_000_000).unwrap();
        let state = plant.state();
        record.4.push(state.actuators.control_moment_gyros.angle_rad);
        let [x, y, z, ..] = *state.wheel_speed_rad_s();
        record.0.push((state.q_world_body, state.omega_wb_b_rad_s, [x, y, z], state.gas_kg()));
        record.1.push(plant.sample_imu());
        record.2.extend(plant.sample_vector());
        record.3.extend(plant.sample_wheels());
    }
    record
}

#[test]
fn the_catalogue_is_complete_and_well_formed() {
    let expected = [
        "gravity_offset",
        "inertia_products",
        "bearing_viscous_friction",
        "bearing_coulomb_friction",
        "air_drag_quadratic",
        "air_current",
        "air_current_periodic",
        "bearing_turbine",
        "magnetic_torque",
        "harness_spring",
        "anisoelastic_sag",
        "mass_shift",
        "moving_ballast_backlash",
        "tilt_stop_contact",
        "earth_rotation",
        "gravity_gradient",
        "thruster_strength",
        "thruster_misalignment",
        "thruster_delay",
        "thruster_rise",
        "thruster_leak",
        "thruster_pressure",
        "supply_voltage",
        "wheel_friction",
        "wheel_misalignment",
        "wheel_inertia",
        "wheel_imbalance",
        "wheel_windage",
        "gyro_bias",
        "gyro_scale",
        "gyro_misalignment",
        "gyro_temperature",
        "gyro_g_sensitivity",
        "gyro_saturation",
        "accel_bias",
        "accel_scale",
        "accel_lever_arm",
        "imu_latency",
        "vector_sensor_misalignment",
        "vibration_alias",
        "slosh",
        "flexible_mode",
        "unmodelled_torque",
        "periodic_torque",
        "air_drag_power",
        "thruster_voltage",
        "wheel_motor_bias",
        "wheel_motor_constant",
        "winding_cable",
        "imu_bandwidth",
        "gimbal_misalignment",
        "gimbal_friction",
        "rotor_momentum",
    ];
    let ids: BTreeSet<&str> = catalogue().iter().map(|e| e.info().id).collect();
    // Ids are fixed: files and reports use them. New ones may come.
    assert!(expected.iter().all(|id| ids.contains(id)), "{ids:?}");
    assert_eq!(catalogue().len(), ids.len(), "ids are unique");
    for effect in catalogue() {
        let info = effect.info();
        for text in [info.title, info.explanation, info.equation, info.source] {
            assert!(!text.is_empty(), "{}", info.id);
        }
        for other in info.confusable_with {
            assert!(ids.contains(other) && *other != info.id, "{}: {other}", info.id);
        }
        let specs = specs(*effect);
        assert!(specs.iter().any(|spec| !spec.known), "{} has something to fit", info.id);
        let names: BTreeSet<&str> = specs.iter().map(|s| s.name.as_str()).collect();
        assert_eq!(names.len(), specs.len(), "{}", info.id);
        for spec in &specs {
            let label = format!("{} {}", info.id, spec.name);
            assert!(spec.min < spec.max && spec.min <= spec.neutral && spec.neutral <= spec.max, "{label}");
            assert!(spec.prior_stddev > 0.0 && spec.prior_stddev.is_finite(), "{label}");
            assert!(!spec.doc.is_empty() && !spec.unit.is_empty(), "{label}");
        }
        let model = platform();
        let text = describe(*effect, &model);
        assert!(text.starts_with(info.id) && specs.iter().all(|s| text.contains(&s.name)));
        let turns_with_a_wheel = effect.signature() == Some(Signature::WheelTurn);
        assert_eq!(
            effect.hidden_states(&model) > 0,
            info.kind == EffectKind::HiddenState || turns_with_a_wheel,
            "{}",
            info.id
        );
    }
}

#[test]
fn parameters_say_which_wheel_or_jet_is_theirs() {
    let model = platform();
    for effect in catalogue() {
        for spec in effect.parameters(&model) {
            // A name is the part's own, alone or with the quantity behind it.
            let is_of = |part: &str| {
                spec.name == part || spec.name.strip_prefix(part).is_some_and(|rest| rest.starts_with('_'))
            };
            let named = (model.wheels().iter().position(|w| is_of(&w.name)).map(Part::Wheel))
                .or_else(|| model.jets().iter().position(|j| is_of(&j.name)).map(Part::Jet))
                .or_else(|| model.gyros().iter().position(|g| is_of(&g.name)).map(Part::Gyro));
            assert_eq!(spec.part, named.unwrap_or(Part::Platform), "{}.{}", effect.info().id, spec.name);
        }
    }
}

#[test]
fn neutral_values_change_nothing_at_all() {
    let base = rich_run(&platform());
    for effect in catalogue() {
        let run = rich_run(&with_effect(*effect, &neutral(*effect)));
        assert!(run == base, "{}", effect.info().id);
        let mut model = platform();
        model.effects.insert(effect.info().id.to_owned(), Values::new());
        assert!(rich_run(&model) == base, "{}: left-out parameters are neutral", effect.info().id);
    }
}

#[test]
fn every_parameter_of_every_effect_matters() {
    for effect in catalogue() {
        let values = present(*effect);
        let run = rich_run(&with_effect(*effect, &values));
        for (k, (spec, _)) in values.iter().enumerate() {
            let mut changed = values.clone();
            let slot = &mut changed[k].1;
            let step = 0.3 * spec.prior_stddev;
            *slot = if *slot - step >= spec.min { *slot - step } else { *slot + step };
            assert!(rich_run(&with_effect(*effect, &changed)) != run, "{} {}", effect.info().id, spec.name);
        }
    }
}

/// Everything that an effect does in one environment, as a list of numbers.
fn response(effect: &dyn Effect, values: &[f64], hidden: &[f64]) -> Vec<f64> {
    let mut model = platform();
    effect.adjust(values, &mut model).unwrap();
    let q = UnitQuaternion::from_euler_angles(0.07, -0.06, 0.4);
    let (speed, torque, valves) = ([40.0, -30.0, 20.0], [0.1, -0.2, 0.3], [0.0, 1.0, 0.0, 0.0]);
    let environment = Environment {
        omega_dot_wb_b_rad_s2: Vector3::new(0.01, 0.02, -0.03),
        wheel_speed_rad_s: &speed,
        wheel_motor_torque_n_m: &torque,
        valve_fraction: &valves,
        gas_used_kg: 0.1,
        bus_voltage_v: 23.0,
        temperature_k: 300.0,
        time_s: 12.3,
        tank_pressure_pa: 1.5e7,
        ballast_direction: Vector3::new(1.0, -1.0, 1.0),
        ..Environment::new(&model, q, Vector3::new(0.3, -0.2, 0.5))
    };
    let mut numbers = Vec::new();
    numbers.extend(&effect.torque_b_n_m(values, &environment, hidden));
    numbers.extend(&effect.reaction_inertia_b_kg_m2(values, &model));
    let mut wheel_torque = [0.0; 3];
    effect.add_wheel_torque_n_m(values, &environment, &mut wheel_torque);
    numbers.extend(wheel_torque);
    numbers.push(effect.gas_rate_kg_s(values, &environment));
    numbers.extend(<[f64; 2]>::from(effect.valve_delay_s(values, &environment)));
    numbers.push(effect.thrust_factor(values, &environment));
    let lag = effect.thrust_lag(values);
    numbers.extend([lag.rise_s, lag.tail_s, lag.tail_exponent]);
    let mut derivative = vec![0.0; hidden.len()];
    effect.hidden_derivative(values, &environment, hidden, &mut derivative);
    effect.hidden_noise(values, &mut derivative);
    numbers.extend(derivative);
    let mut imu = TrueImu {
        angular_velocity_b_rad_s: Vector3::new(0.3, -0.2, 0.5),
        specific_force_b_m_s2: Vector3::new(0.3, -0.2, 9.8),
    };
    effect.measure_imu(values, &environment, &mut imu);
    numbers.extend(&imu.angular_velocity_b_rad_s);
    numbers.extend(&imu.specific_force_b_m_s2);
    // What was adjusted.
    numbers.extend(model.mass_properties.inertia_b_kg_m2());
    numbers.extend(model.mass_properties.gravity_offset_b_n_m());
    for wheel in model.wheels() {
        numbers.extend(&wheel.spin_axis_b.into_inner());
        numbers.extend([wheel.spin_inertia_kg_m2, wheel.viscous_friction_n_m_s, wheel.coulomb_friction_n_m]);
    }
    for gyro in model.gyros() {
        numbers.extend(&gyro.gimbal_axis_b.into_inner());
        numbers.extend(&gyro.spin_axis_b.into_inner());
        numbers.extend([gyro.rotor_momentum_n_m_s, gyro.viscous_friction_n_m_s, gyro.coulomb_friction_n_m]);
    }
    for jet in model.jets() {
        numbers.extend(&jet.torque_b_n_m());
        numbers.extend([jet.opening_delay_s, jet.closing_delay_s]);
    }
    numbers.push(model.tank().thrust_pressure_exponent);
    for errors in [model.sensors.gyro.errors, model.sensors.accelerometer.errors] {
        numbers.extend(&errors.bias);
        numbers.extend(&errors.scale);
        numbers.extend([errors.range, errors.quantum, errors.latency_s, errors.time_constant_s]);
    }
    numbers.extend(&model.sensors.accelerometer.lever_arm_b_m);
    numbers.extend(&model.sensors.vector.unwrap().misalignment_rad);
    numbers
}

/// Columns of a fit are differences in the parameters: halving the step must not change them, also
/// at the neutral point and at a bound, where differences are one-sided.
#[test]
fn every_effect_is_differentiable_in_its_parameters() {
    for effect in catalogue() {
        let model = platform();
        let hidden: Vec<f64> = (0..effect.hidden_states(&model)).map(|k| 0.02 + 0.01 * k as f64).collect();
        for at in [neutral(*effect), present(*effect)] {
            let point: Vec<f64> = at.iter().map(|(_, x)| *x).collect();
            for (k, (spec, x)) in at.iter().enumerate() {
                let column = |step: f64| -> Vec<f64> {
                    let mut moved = [point.clone(), point.clone()];
                    moved[0][k] = (x - step).max(spec.min);
                    moved[1][k] = (x + step).min(spec.max);
                    let span = moved[1][k] - moved[0][k];
                    let [low, high] = moved.map(|values| response(*effect, &values, &hidden));
                    high.iter().zip(low).map(|(h, l)| (h - l) / span * spec.prior_stddev).collect()
                };
                let (coarse, fine) = (column(2e-5 * spec.prior_stddev), column(1e-5 * spec.prior_stddev));
                let size = fine.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
                for (c, f) in coarse.iter().zip(&fine) {
                    assert!(
                        (c - f).abs() <= 2e-3 * size + 1e-9,
                        "{} {}: {c} {f}",
                        effect.info().id,
                        spec.name
                    );
                }
                assert!(fine.iter().all(|x| x.is_finite()));
            }
        }
    }
}

/// Effects declared passive never add energy, whatever the motion.
#[test]
fn passive_effects_only_take_energy() {
    let model = platform();
    let mut seen = Vec::new();
    for effect in catalogue().iter().filter(|e| e.info().is_passive) {
        seen.push(effect.info().id);
        for k in 0..1000 {
            let x = |salt: f64| (f64::from(k) * 12.9898 + salt * 78.233).sin() * 43.7;
            let q = UnitQuaternion::from_euler_angles(x(1.0), x(2.0), x(3.0));
            let omega = Vector3::new(x(4.0).fract(), x(5.0).fract(), x(6.0).fract()) * x(7.0).fract();
            let values: Vec<f64> = specs(*effect)
                .iter()
                .enumerate()
                .map(|(i, s)| s.min + (s.max - s.min) * x(8.0 + i as f64).fract().abs())
                .collect();
            let torque = effect.torque_b_n_m(&values, &Environment::new(&model, q, omega), &[]);
            assert!(torque.dot(&omega) <= 0.0, "{}", effect.info().id);
        }
    }
    for id in ["bearing_viscous_friction", "bearing_coulomb_friction", "air_drag_quadratic"] {
        assert!(seen.contains(&id), "{seen:?}");
    }
}

/// The model's prediction and the plant's motion are the same equations.
#[test]
fn predicted_and_simulated_acceleration_agree_for_every_effect() {
    for effect in catalogue() {
        let model = with_effect(*effect, &present(*effect));
        let initial = InitialState {
            q_world_body: UnitQuaternion::from_euler_angles(0.05, 0.03, 0.8),
            omega_wb_b_rad_s: Vector3::new(0.10, -0.15, 0.6),
            wheel_speed_rad_s: vec![40.0, -30.0, 20.0],
            ..InitialState::default()
        };
        let mut plant = Plant::new(&model, &initial, 7).unwrap();
        plant.command_wheels(&[0.1, -0.2, 0.3]).unwrap();
        // A model takes the gimbals' motion as measured.
        plant.move_gimbals_along(&[0.3, -0.7], &[0.2, 0.4]).unwrap();
        plant.advance_to(50_000_000).unwrap();
        let hidden = plant.state().hidden;
        let predicted = plant.gyrostat().angular_acceleration_b_rad_s2(&plant.environment(), &hidden);
        let simulated = plant.angular_acceleration_b_rad_s2();
        assert!((predicted - simulated).norm() < 1e-12, "{}: {predicted} {simulated}", effect.info().id);
    }
}

#[test]
fn refusals_name_what_is_wrong_and_what_is_near() {
    let model = platform();
    let read = |id: &str, values: &[(&str, f64)]| {
        let values: Values = values.iter().map(|(name, x)| ((*name).to_owned(), *x)).collect();
        EffectSet::from_map(&BTreeMap::from([(id.to_owned(), values)]), &model).unwrap_err()
    };
    let unknown = read("bearing_viscos_friction", &[]).to_string();
    assert!(unknown.contains("`bearing_viscos_friction`") && unknown.contains("bearing_viscous_friction"));
    let parameter = read("thruster_strength", &[("jet_33", 0.1)]).to_string();
    assert!(parameter.contains("`jet_33`") && parameter.contains("jet_3"), "{parameter}");
    let range = read("bearing_viscous_friction", &[("c_n_m_s", -0.1)]);
    assert!(matches!(&range, EffectError::OutOfRange { min, .. } if *min == 0.0));
    assert_eq!(
        range.to_string(),
        "effect `bearing_viscous_friction`: c_n_m_s = -0.1 N m s is outside 0 .. 5 N m s"
    );
    assert!(matches!(read("air_current", &[("t_x_n_m", f64::NAN)]), EffectError::OutOfRange { .. }));
    let mut impossible = model.clone();
    impossible.effects.insert("inertia_products".to_owned(), Values::from([("ixy_kg_m2".to_owned(), 15.0)]));
    let error = crate::Gyrostat::new(&impossible).unwrap_err().to_string();
    assert!(error.contains("inertia_products") && error.contains("cannot exist"), "{error}");
    assert!(find("slosh").is_some() && find("").is_none());
}
