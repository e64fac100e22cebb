//! Sensors that delay by their time constant, and sensors that only say so.

use whorl_dynamics::{ModelPrior, PlatformModel};

use super::generator::record;
use crate::Options;
use crate::case::Case;
use crate::fitting::low_pass;

fn with_low_pass(gyro_s: f64, accelerometer_s: f64) -> PlatformModel {
    let mut model = PlatformModel::whorl_1_reference();
    model.sensors.gyro.errors.time_constant_s = gyro_s;
    model.sensors.accelerometer.errors.time_constant_s = accelerometer_s;
    model
}

/// Time constants of gyro and accelerometer with which a run of this platform goes on, where these are stated; `None`: as stated.
fn found_s(truth: &PlatformModel, stated: &PlatformModel) -> Option<[f64; 2]> {
    let run = [record(truth, 4, 20.0, None)];
    let prior = ModelPrior::typical(stated).with_mass_properties_scaled(0.1);
    let model = Case::new(&run, &[], stated, &prior, &Options::default()).unwrap().reference.model;
    if model == *stated {
        return None;
    }
    assert_eq!(low_pass::remarks(stated, &model).len(), 1);
    Some([model.sensors.gyro.errors.time_constant_s, model.sensors.accelerometer.errors.time_constant_s])
}

#[test]
fn a_window_that_is_stamped_in_its_middle_does_not_delay() {
    let truth = with_low_pass(0.0, 0.0);
    assert_eq!(found_s(&truth, &truth), None);
    assert_eq!(found_s(&truth, &with_low_pass(0.0, 0.04)), Some([0.0, 0.0]));
    assert_eq!(found_s(&truth, &with_low_pass(0.02, 0.0)), Some([0.0, 0.0]));
}

#[test]
fn it_is_said_what_readings_are_instead() {
    let stated = with_low_pass(0.0, 0.01);
    let mut shown = with_low_pass(0.0, 0.0);
    assert!(low_pass::remarks(&stated, &shown)[0].contains("likelier without any"));
    shown.sensors.accelerometer.errors.averaging_window_s = 0.02;
    assert!(low_pass::remarks(&stated, &shown)[0].contains("means over a window of 20 ms"));
}

#[test]
fn a_low_pass_that_delays_stays() {
    let truth = with_low_pass(0.02, 0.04);
    assert_eq!(found_s(&truth, &truth), None);
    let accelerometer_late = with_low_pass(0.0, 0.04);
    assert_eq!(found_s(&accelerometer_late, &truth), Some([0.0, 0.04]));
}
