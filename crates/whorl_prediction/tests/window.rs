//! Accelerometers whose readings are means over a window: against readings that are made here of the rates at its two ends.

#![expect(clippy::unwrap_used, reason = "a test stops at a broken precondition")]

use nalgebra::Vector3;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use whorl_dynamics::actuators::Kind;
use whorl_dynamics::platform::TiltLimit;
use whorl_dynamics::{InitialState, Plant, PlatformModel};
use whorl_prediction::{
    Innovation, Noise, Prepared, Settings, Told, Varied, fitted_start, predict, sensitivities,
};
use whorl_recording::{Channel, OnInterval, Recording};

const STEP_NS: i64 = 10_000_000;
const SAMPLES: i64 = 3_000;

/// A platform with an accelerometer that is far from the centre.
fn model(window_s: f64) -> PlatformModel {
    let mut model = PlatformModel::whorl_1_reference();
    model.tilt_limit = TiltLimit::NONE;
    for jet in model.jets_mut() {
        (jet.min_on_time_s, jet.opening_delay_s, jet.closing_delay_s) = (1e-3, 0.0, 0.0);
    }
    let sensors = &mut model.sensors;
    sensors.accelerometer.lever_arm_b_m = Vector3::new(0.3, -0.2, 0.1);
    sensors.accelerometer.errors.noise_stddev = Vector3::repeat(1e-3);
    sensors.accelerometer.errors.averaging_window_s = window_s;
    sensors.gyro.errors.noise_stddev = Vector3::repeat(1e-3);
    model
}

/// Pulses of changing lengths that begin at the very instants of samples, and wheels that jump there; specific force as the mean
/// over a window about each sample: of the rate's change from its beginning to its end, and of the motion in the middle.
fn recording(model: &PlatformModel, window_s: f64, noise: f64) -> Recording {
    let start = InitialState { omega_wb_b_rad_s: Vector3::new(0.02, -0.03, 0.1), ..InitialState::default() };
    let mut quiet = model.clone();
    quiet.sensors.gyro.errors.bias_turn_on_stddev = Vector3::zeros();
    let mut plant = Plant::new(&quiet, &start, 1).unwrap().without_random_torque();
    let mut random = Pcg64::new(7, 9);
    let mut noise = |stddev: f64| {
        let z: f64 = StandardNormal.sample(&mut random);
        stddev * z * noise
    };
    let mut r = Recording { name: "window".to_owned(), ..Recording::default() };
    r.jet_pulses = vec![Vec::new(); model.jets().len()];
    let half_ns = (0.5e9 * window_s) as i64;
    for k in 1..=SAMPLES {
        let now_ns = k * STEP_NS;
        plant.advance_to(now_ns - half_ns).unwrap();
        let before = plant.state().omega_wb_b_rad_s;
        plant.advance_to(now_ns).unwrap();
        let (rate, up) =
            (plant.state().omega_wb_b_rad_s, plant.state().q_world_body.inverse() * Vector3::z());
        let speeds = plant.state().wheel_speed_rad_s().iter().take(model.wheels().len());
        let tachometer: Vec<f64> = speeds.map(|w| w + noise(0.05)).collect();
        let command: Vec<f64> = (0..3).map(|j| if (k / 7 + j) % 2 == 0 { 0.02 } else { -0.02 }).collect();
        plant.command_motors(Kind::Wheels, &command).unwrap();
        let jet = (k / 3) as usize % model.jets().len();
        let on_time_s = 0.002 * (1 + k % 9) as f64;
        let on_s = now_ns as f64 * 1e-9;
        if k % 3 == 0 && plant.command_jet_pulse(jet, now_ns, on_time_s).is_ok() {
            r.jet_pulses[jet].push(OnInterval { on_s, off_s: on_s + on_time_s });
        }
        plant.advance_to(now_ns + half_ns).unwrap();
        let acceleration = (plant.state().omega_wb_b_rad_s - before) / window_s;
        let arm = model.sensors.accelerometer.lever_arm_b_m;
        let force = acceleration.cross(&arm) + rate.cross(&rate.cross(&arm)) + 9.81 * up;
        r.gyro_b_rad_s.time_s.push(on_s);
        r.gyro_b_rad_s.value.push(rate.map(|x| x + noise(1e-3)));
        r.specific_force_b_m_s2.time_s.push(on_s);
        r.specific_force_b_m_s2.value.push(force.map(|x| x + noise(1e-3)));
        r.wheel_speed_rad_s.time_s.push(on_s);
        r.wheel_speed_rad_s.value.push(tachometer);
        r.wheel_torque_command_n_m.time_s.push(on_s);
        r.wheel_torque_command_n_m.value.push(command);
    }
    r
}

/// Mean square of the accelerometer's normalised innovations.
fn misfit(recording: &Recording, model: &PlatformModel) -> f64 {
    let case = Prepared::new(recording, model, Settings::default()).unwrap();
    let noise = Noise::stated(&case).unwrap();
    let start = fitted_start(&case, &noise).start;
    let (mut sum, mut numbers) = (0.0, 0);
    predict(&case, &noise, &start, &[], &mut |told| {
        if let Told::Innovation(innovation) = told
            && innovation.component.channel == Channel::Accelerometer
        {
            sum += innovation.normalised().powi(2);
            numbers += 1;
        }
    });
    assert!(numbers > 8_000);
    sum / f64::from(numbers)
}

#[test]
fn readings_over_a_window_are_predicted_as_such() {
    for window_s in [0.004, 0.007, 0.01] {
        let recording = recording(&model(window_s), window_s, 1.0);
        let [averaged, instants] = [window_s, 0.0].map(|window_s| misfit(&recording, &model(window_s)));
        // 99.9 % of a mean of 9,000 squares; the motion within a window is not quite straight.
        assert!((averaged - 1.0).abs() < 0.06, "{window_s}: {averaged}");
        assert!(instants > 2.0, "{window_s}: {instants}");
    }
}

/// Moves a parameter of a model.
type Moved = fn(&mut PlatformModel, f64);

/// Of thrust, valve delay (no edge at an end of a window) and a sensor's lever arm: what a window averages moves with the valves.
#[test]
fn sensitivities_are_slopes_of_the_innovations() {
    let window_s = 0.01;
    let truth = model(window_s);
    // Without noise: what gains change is no part of a sensitivity, and nothing where nothing is left.
    let recording = recording(&truth, window_s, 0.0);
    let settings = Settings { derivatives_held: 0.0, ..Settings::default() };
    let moves: [(&str, f64, Moved); 3] = [
        ("thrust", 1e-4, |model, by| model.jets_mut().iter_mut().for_each(|jet| jet.thrust_n += by)),
        ("delay", 1e-5, |model, by| {
            model.jets_mut().iter_mut().for_each(|jet| {
                jet.opening_delay_s += 1.3e-3 + by;
                jet.closing_delay_s += 1.3e-3 + by;
            });
        }),
        ("arm", 1e-4, |model, by| model.sensors.accelerometer.lever_arm_b_m.x += by),
    ];
    for (name, step, moved) in moves {
        let at = |by: f64| {
            let mut model = truth.clone();
            moved(&mut model, by);
            model
        };
        let here = at(0.0);
        let case = Prepared::new(&recording, &here, settings).unwrap();
        let noise = Noise::stated(&case).unwrap();
        let start = fitted_start(&case, &noise).start;
        let innovations = |by: f64| {
            let model = at(by);
            let case = Prepared::new(&recording, &model, settings).unwrap();
            let mut all: Vec<Innovation> = Vec::new();
            predict(&case, &noise, &start, &[], &mut |told| {
                if let Told::Innovation(innovation) = told {
                    all.push(*innovation);
                }
            });
            all
        };
        let (plus, minus) = (innovations(step), innovations(-step));
        let varied = [Varied { model: at(step), step }];
        let (mut off, mut size, mut k) = (0.0, 0.0, 0);
        sensitivities(&case, &noise, &start, &varied, &mut |innovation, d| {
            let slope = (plus[k].value - minus[k].value) / (2.0 * step * innovation.stddev);
            off += (d[0] / innovation.stddev - slope).powi(2);
            size += slope.powi(2);
            k += 1;
        })
        .unwrap();
        assert!(k == plus.len() && size > 1.0, "{name}: {k} {size}");
        assert!(off < 1e-3 * size, "{name}: {off} of {size}");
    }
}
