use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_dynamics::platform::TiltLimit;
use whorl_recording::Channel;

use crate::cell::{Driven, Input, Inputs, Motion};

fn driven(pressure_pa: f64) -> Driven {
    Driven::new(&PlatformModel::whorl_1_reference(), Some(pressure_pa), 0, &Motion::default()).unwrap()
}

/// Rate about the axis of the first jet behind a pulse of 0.1 s [rad/s].
fn rate_by_a_pulse_rad_s(pressure_pa: f64) -> f64 {
    let after = |inputs: &[(i64, Input)]| {
        let mut driven = driven(pressure_pa);
        driven.pass(&mut inputs.to_vec(), 200_000_000).unwrap();
        driven.plant.state().omega_wb_b_rad_s
    };
    (after(&[(0, Input::Pulse(0, 0.1))]) - after(&[])).norm()
}

#[test]
fn a_tank_that_reads_less_than_nothing_is_empty() {
    assert!(rate_by_a_pulse_rad_s(2e7) > 1e-4);
    // A step that is split errs a little otherwise.
    assert!(rate_by_a_pulse_rad_s(0.0) < 1e-7);
    assert!(rate_by_a_pulse_rad_s(-300.0) < 1e-7);
}

/// A plant that is read at 100 Hz while its motors change 50 times a second and jets give short pulses: what is read is what the cells
/// predict, to a part of the noise of their means.
#[test]
fn means_of_readings_are_predicted_whatever_actuators_do_within_a_cell() {
    // Pulses turn it further than its stops would let it.
    let model = PlatformModel { tilt_limit: TiltLimit::NONE, ..PlatformModel::whorl_1_reference() };
    let mut speeds = [0.0; MAX_WHEELS];
    speeds[..3].copy_from_slice(&[90.0, -70.0, 120.0]);
    let tilted = UnitQuaternion::from_euler_angles(0.05, -0.03, 0.4);
    let mut cells = Driven::new(&model, None, 0, &(tilted, Vector3::new(0.02, -0.03, 0.05), speeds)).unwrap();
    let mut truth = cells.plant.clone().with_step_ns(1_000_000);
    let wheels = model.wheels().len();
    let mut inputs = Inputs::new();
    for step in 0..200_i64 {
        let at_ns = step * 10_000_000;
        truth.advance_to(at_ns).unwrap();
        if step % 2 == 0 {
            let torque: [f64; MAX_WHEELS] =
                std::array::from_fn(|j| 0.05 * ((step * 7 + j as i64) as f64).sin());
            truth.command_wheels(&torque[..wheels]).unwrap();
            inputs.push((at_ns, Input::Torque(torque, [0.0; MAX_WHEELS])));
        }
        if step % 13 == 5 {
            let (jet, on_time_s) = (step as usize % 12, 0.02 + 0.001 * (step % 50) as f64);
            truth.command_jet_pulse(jet, at_ns, on_time_s).unwrap();
            inputs.push((at_ns, Input::Pulse(jet, on_time_s)));
        }
        inputs.push((at_ns, Input::Gyro(truth.imu_reading().0)));
        inputs.push((at_ns, Input::Speed(*truth.state().wheel_speed_rad_s())));
        let (q, rate) = (truth.state().q_world_body, truth.state().omega_wb_b_rad_s);
        inputs.push((at_ns, Input::Attitude(q, rate)));
    }
    let gyro_rad_s = model.sensors.gyro.errors.one_sample_stddev().min();
    let speed_rad_s = model.sensors.wheel_speed.one_sample_stddev_rad_s();
    for cell in 1..=9 {
        let found = cells.pass(&mut inputs, cell * 200_000_000).unwrap();
        for reading in cells.readings(&found) {
            let noise = if reading.component.channel == Channel::Gyro { gyro_rad_s } else { speed_rad_s };
            let mean_noise = noise / 20_f64.sqrt();
            assert!(reading.value.abs() < 0.2 * mean_noise, "cell {cell}: {reading:?} of {mean_noise}");
        }
    }
}
