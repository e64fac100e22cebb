//! The joint filter on samples as they arrive.

use super::simulation::{at_balance, prior, record, swinging, truth, wrong_model};
use whorl_dynamics::mass_parameters::{MASS_PARAMETERS, NAMES, mass_vector};
use whorl_estimation::sequential::{JointUpdate, OnlineFilter};

#[test]
fn the_online_filter_finds_the_truth() {
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
