//! The filter for readings as they arrive, against itself and a regression.

use nalgebra::{DMatrix, DVector, Vector3};
use whorl_dynamics::{InitialState, Plant, PlatformModel};
use whorl_recording::{Channel, Component};

use crate::{Difference, Disturbance, RandomTorque, Reading, Recursive, Since};

const CELLS: usize = 24;

/// Two torques, one that drives wheels, and an error of the gyro, from a cell on, and readings that are off in any way: a filter of
/// so many constants, and of parameters that begin at these cells.
fn gathered(constants: usize, from: usize, starts: &[usize]) -> Recursive {
    let model = PlatformModel::whorl_1_reference();
    let start = InitialState { wheel_speed_rad_s: vec![40.0, -35.0, 30.0], ..InitialState::default() };
    let mut plant = Plant::new(&model, &start, 1).unwrap().without_random_torque();
    let slow = RandomTorque { stddev_b_n_m: [1e-3; 3], correlation_s: 20.0 };
    let disturbance = Disturbance { body: vec![slow], motors_n_m: vec![1e-3; 3], motors_correlation_s: 20.0 };
    let gyrostat = plant.gyrostat().clone();
    let pairs = (0..4).flat_map(|b| (0..=b).map(move |a| (a, b))).collect();
    let mut filter = Recursive::new(&gyrostat, &plant, &disturbance, (constants, 4), pairs);
    filter.forget_motion(1.0, 1.0);
    for cell in 0..CELLS {
        if starts.contains(&cell) {
            filter.begin(0, 2);
        }
        let along = |k: usize| ((cell * (k + 2)) as f64 * 0.3).sin();
        let does = |k: usize| {
            let torque = Vector3::new(along(k), along(k + 1), 1.0) * 1e-2;
            match k {
                _ if cell < from => Difference::default(),
                3 => Difference { gyro_rad_s: torque, ..Difference::default() },
                _ => {
                    let wheels_rad_s2 = [along(k) * 10.0; 8];
                    Difference { body_rad_s2: torque, wheels_rad_s2, ..Difference::default() }
                }
            }
        };
        let step_ns = 200_000_000;
        plant.advance_to(plant.now_ns() + step_ns).unwrap();
        let reading = |r: usize| {
            let channel = if r < 3 { Channel::Gyro } else { Channel::WheelSpeed };
            let component = Component::new(channel, 0, r % 3);
            Reading { component, value: 0.01 * ((cell * 7 + r) as f64).cos(), variance: 1e-4 }
        };
        let readings = [0, 1, 2, 3, 4, 5].map(reading);
        let does = [0, 1, 2, 3].map(does);
        assert!(filter.pass(&mut plant, step_ns, &does, &[], &readings, Some(0.0)));
    }
    filter
}

fn sums(since: &Since) -> (DMatrix<f64>, DVector<f64>) {
    let product = |i: usize, k: usize| since.information[i.max(k) * (i.max(k) + 1) / 2 + i.min(k)];
    (DMatrix::from_fn(4, 4, product), DVector::from_fn(4, |i, _| since.slope[i]))
}

#[test]
fn a_start_in_mid_run_is_what_parameters_do_from_there_on() {
    let (both, later) = (gathered(0, 0, &[0, 12]), gathered(0, 12, &[0]));
    let (found, expected) = (sums(&both.starts[1]), sums(&later.starts[0]));
    assert!(expected.0.amax() > 1.0 && (&found.0 - &expected.0).amax() < 1e-9 * expected.0.amax());
    assert!((&found.1 - &expected.1).amax() < 1e-9 * expected.1.amax());
    let first = sums(&both.starts[0]).0;
    assert!((&found.0 - &first).amax() > 0.1 * first.amax());
}

/// Against all parameters as one regression.
#[test]
fn constants_are_integrated_out_over_their_priors() {
    let (with, without) = (gathered(2, 0, &[0]), gathered(0, 0, &[0]));
    let (information, slope) = sums(&without.starts[0]);
    let known = information.view((0, 0), (2, 2)) + DMatrix::identity(2, 2);
    let covariance = known.try_inverse().unwrap();
    assert!((&with.constants.covariance - &covariance).amax() < 1e-9 * covariance.amax());
    let across = information.view((2, 0), (2, 2));
    let expected = information.view((2, 2), (2, 2)) - across * &covariance * across.transpose();
    let expected_slope = slope.rows(2, 2) - across * &covariance * slope.rows(0, 2);
    let found = sums(&with.starts[0]);
    assert!((found.0.view((2, 2), (2, 2)) - &expected).amax() < 1e-9 * expected.amax());
    assert!((found.1.rows(2, 2) - &expected_slope).amax() < 1e-9 * expected_slope.amax());
}
