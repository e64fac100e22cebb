//! Behind the first seconds of a run, where no valve moves, a pass takes no more memory: neither of gains and mean, nor of the mean with gains that were kept, nor
//! with columns.

#![expect(clippy::unwrap_used, reason = "a test stops at a broken precondition")]

use std::cell::Cell;

use nalgebra::Vector3;
use whorl_dynamics::{InitialState, Plant, PlatformModel};
use whorl_prediction::{
    Disturbance, Noise, Prepared, RandomTorque, Settings, Start, Told, Varied, frozen_gains, innovations,
    predict, sensitivities,
};
use whorl_recording::{OnInterval, Recording};

/// At 50 Hz, with wheels at work, and jets in the first two seconds.
fn recording(model: &PlatformModel, samples: i64) -> Recording {
    let start = InitialState { omega_wb_b_rad_s: Vector3::new(0.02, -0.03, 0.1), ..InitialState::default() };
    let mut plant = Plant::new(model, &start, 1).unwrap();
    let mut r = Recording { name: "at work".to_owned(), ..Recording::default() };
    r.jet_pulses = vec![Vec::new(); model.jets().len()];
    for k in 0..samples {
        let (t, now_ns) = (k as f64 * 0.02, k * 20_000_000);
        plant.advance_to(now_ns).unwrap();
        let imu = plant.sample_imu();
        r.gyro_b_rad_s.time_s.push(t);
        r.gyro_b_rad_s.value.push(imu.angular_velocity_rad_s);
        r.specific_force_b_m_s2.time_s.push(t);
        r.specific_force_b_m_s2.value.push(imu.specific_force_m_s2);
        r.wheel_speed_rad_s.time_s.push(t);
        r.wheel_speed_rad_s.value.push(plant.sample_wheels().iter().map(|wheel| wheel.speed_rad_s).collect());
        let torque: Vec<f64> = (0..3).map(|j| 0.1 * ((0.3 + 0.2 * f64::from(j)) * t).sin()).collect();
        plant.command_wheels(&torque).unwrap();
        r.wheel_torque_command_n_m.time_s.push(t);
        r.wheel_torque_command_n_m.value.push(torque);
        if k % 40 == 0 && k < 100 && plant.command_jet_pulse(0, now_ns, 0.05).is_ok() {
            r.jet_pulses[0].push(OnInterval { on_s: t, off_s: t + 0.05 });
        }
    }
    r
}

/// Models a little further along constants, a torque, jets and a sensor.
fn varied(model: &PlatformModel) -> Vec<Varied> {
    let step = 1e-4;
    let with = |change: &dyn Fn(&mut PlatformModel)| {
        let mut model = model.clone();
        change(&mut model);
        Varied { model, step }
    };
    let effect = |id: &'static str, name: &'static str| {
        with(&move |model| {
            model.effects.insert(id.to_owned(), [(name.to_owned(), step)].into());
        })
    };
    vec![
        effect("bearing_viscous_friction", "c_n_m_s"),
        effect("gravity_offset", "mgr_x_n_m"),
        effect("inertia_products", "ixy_kg_m2"),
        effect("imu_latency", "t_s"),
        with(&|model| model.wheels_mut()[0].spin_inertia_kg_m2 += step),
        with(&|model| model.jets_mut()[0].thrust_n += step),
        with(&|model| model.sensors.gyro.errors.scale.x += step),
    ]
}

/// Of a run as much memory is taken as of one twice as long.
#[test]
fn a_pass_takes_no_memory_on_its_way() {
    let model = PlatformModel::whorl_1_reference();
    let varied = varied(&model);
    let taken = [250, 500].map(|samples| {
        let recording = recording(&model, samples);
        let case = Prepared::new(&recording, &model, Settings::default()).unwrap();
        let body = vec![RandomTorque { stddev_b_n_m: [1e-3; 3], correlation_s: 1.0 }];
        let disturbance = Disturbance { body, motors_n_m: vec![1e-4; 3], motors_correlation_s: 1.0 };
        let noise = Noise { disturbance, ..Noise::stated(&case).unwrap() };
        let start = Start::wide(&case, &noise);
        let gains = frozen_gains(&case, &noise, &start).unwrap();
        let seen = Cell::new(0);
        let count = |pass: &dyn Fn()| {
            seen.set(0);
            let taken = allocation_counter::measure(pass).count_total;
            assert!(seen.get() > 8 * samples, "{} innovations", seen.get());
            taken
        };
        let see = || seen.set(seen.get() + 1);
        [
            count(&|| {
                predict(&case, &noise, &start, &[], &mut |told| {
                    if let Told::Innovation(_) = told {
                        see();
                    }
                });
            }),
            count(&|| {
                innovations(&case, &noise, &start, &gains, &mut |_| see()).unwrap();
            }),
            count(&|| sensitivities(&case, &noise, &start, &varied, &mut |_, _| see()).unwrap()),
        ]
    });
    assert_eq!(taken[0], taken[1], "gains and mean, mean alone, columns");
}
