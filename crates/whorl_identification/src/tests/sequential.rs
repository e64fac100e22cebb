//! Joint filters on simulated runs.

use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_recording::Recording;

use super::simulation::{at_balance, record, swinging};
use super::trajectory::wrong_model;
use crate::data::prepare;
use crate::mass_parameters::{MASS_PARAMETERS, NAMES, mass_vector};
use crate::sequential::{JointFilter, JointUpdate, OnlineFilter, SequentialEstimate};

/// Wheels known exactly, mass properties to 15 %.
fn prior(model: &PlatformModel) -> ModelPrior {
    let mut prior = ModelPrior::typical(model);
    prior.inertia_b_kg_m2 *= 3.0;
    let offset = model.mass_properties.gravity_offset_b_n_m();
    prior.gravity_offset_b_n_m = offset.map(|x| (0.2 * x.abs()).max(0.02));
    prior.actuators.wheels.spin_inertia.fill(0.0);
    prior.actuators.wheels.axis_rad.fill(0.0);
    prior
}

fn truth() -> PlatformModel {
    let mut truth = PlatformModel::whorl_1_reference();
    truth.sensors.accelerometer.errors.bias_turn_on_stddev.fill(1.5e-3);
    truth
}

fn joint(
    truth: &PlatformModel,
    run: &Recording,
    update: JointUpdate,
    forgetting: f64,
) -> Vec<SequentialEstimate> {
    let model = wrong_model(truth);
    let data = prepare(&[run], &model, 0.05).unwrap();
    let mut filter = JointFilter::new(&model, &prior(&model), update, forgetting, at_balance(truth));
    data.chains.iter().flat_map(|c| &c.points).filter_map(|p| filter.step(p)).collect()
}

#[test]
fn joint_filters_converge_to_the_truth() {
    let truth = truth();
    let run = record(&truth, at_balance(&truth), 100.0, 1, &swinging);
    let t = mass_vector(&truth.mass_properties);
    for update in [JointUpdate::Extended, JointUpdate::Iterated { iterations: 3 }, JointUpdate::Unscented] {
        let all = joint(&truth, &run, update, 1.0);
        let last = all.last().unwrap();
        for i in 0..MASS_PARAMETERS {
            println!(
                "{update:?} {} {:.4} true {:.4} +- {:.4}",
                NAMES[i],
                last.estimate[i],
                t[i],
                last.stddev()[i]
            );
            let allowed = (0.05 * t[i].abs()).max(if i < 6 { 0.03 } else { 0.004 });
            assert!((last.estimate[i] - t[i]).abs() < allowed, "{update:?} {}", NAMES[i]);
        }
    }
}

/// Only roll moves, and lambda is small: I_zz must keep its value and its uncertainty.
#[test]
fn an_unexcited_parameter_does_not_wander() {
    let truth = truth();
    let roll = |t: f64| vec![0.03 * (1.1 * t).sin(), 0.0, 0.0];
    let run = record(&truth, at_balance(&truth), 100.0, 2, &roll);
    let before = mass_vector(&wrong_model(&truth).mass_properties)[5];
    let all = joint(&truth, &run, JointUpdate::Extended, 0.98);
    for e in &all {
        let sigma = e.prior_stddev[5];
        assert!((e.estimate[5] - before).abs() < 0.6 * sigma, "{} s: {}", e.time_s, e.estimate[5]);
        assert!(e.stddev()[5] <= 1.001 * sigma, "{}", e.stddev()[5]);
    }
    let last = all.last().unwrap();
    assert!(last.stddev()[5] > 0.7 * last.prior_stddev[5]);
    // Roll itself was identified.
    assert!(last.stddev()[0] < 0.3 * last.prior_stddev[0]);
}

/// Batch preparation and joint filter together, sample by sample.
#[test]
fn the_online_filter_finds_what_the_joint_filter_finds() {
    let truth = truth();
    let run = record(&truth, at_balance(&truth), 100.0, 1, &swinging);
    let model = wrong_model(&truth);
    let mut filter =
        OnlineFilter::new(&model, &prior(&model), JointUpdate::Extended, 1.0, at_balance(&truth));
    let (mut last, mut estimates) = (None, 0);
    let channel = &run.vectors[0];
    let mut next_direction = 0;
    for (k, time_s) in run.gyro_b_rad_s.time_s.iter().enumerate() {
        filter.on_wheels(*time_s, &run.wheel_speed_rad_s.value[k], &run.wheel_torque_command_n_m.value[k]);
        if channel.direction_b.time_s.get(next_direction) == Some(time_s) {
            filter.on_direction(
                *time_s,
                &channel.direction_b.value[next_direction],
                &channel.reference_world,
            );
            next_direction += 1;
        }
        // A broken sample now and then changes nothing.
        if k % 501 == 0 {
            let broken = nalgebra::Vector3::repeat(f64::NAN);
            assert!(filter.on_imu(*time_s, &broken, &broken).is_none());
            filter.on_wheels(*time_s, &[f64::NAN; 3], &[0.0; 3]);
        }
        let found = filter.on_imu(*time_s, &run.gyro_b_rad_s.value[k], &run.specific_force_b_m_s2.value[k]);
        if let Some(found) = found {
            estimates += 1;
            last = Some(found);
        }
    }
    assert!(estimates > 1000, "{estimates}");
    let (last, t) = (last.unwrap(), mass_vector(&truth.mass_properties));
    for i in 0..MASS_PARAMETERS {
        println!("{} {:.4} true {:.4} +- {:.4}", NAMES[i], last.estimate[i], t[i], last.stddev()[i]);
        let allowed = (0.05 * t[i].abs()).max(if i < 6 { 0.05 } else { 0.004 });
        assert!((last.estimate[i] - t[i]).abs() < allowed, "{}", NAMES[i]);
    }
}
