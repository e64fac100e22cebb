//! Laws that no model has are columns like those of parameters: where an effect of the catalogue has the same formula both say the same,
//! and a recording that was made with a law shows its size.

#![expect(clippy::unwrap_used, reason = "a test stops at a broken precondition")]

use std::collections::BTreeMap;

use nalgebra::Vector3;
use whorl_dynamics::platform::TiltLimit;
use whorl_dynamics::{InitialState, Plant, PlatformModel};
use whorl_prediction::{Hints, Laws, Noise, Parameter, Prepared, Push, Settings, follow, hints};
use whorl_recording::{Recording, VectorChannel};

const RATE_HZ: i64 = 100;
const SAMPLES: i64 = 3_000;

/// Effects of the catalogue with one parameter each, and the size that is one unit of the laws below.
const EFFECTS: [(&str, &str, f64); 4] = [
    ("bearing_viscous_friction", "c_n_m_s", 1e-3),
    ("wheel_motor_bias", "wheel_y_n_m", 1e-4),
    ("gyro_misalignment", "xz_rad", 1e-3),
    ("vector_sensor_misalignment", "m_z_rad", 1e-3),
];

fn laws<'a>() -> Laws<'a> {
    Laws::new(EFFECTS.len(), EFFECTS.len(), |plant, pushes| {
        let rate_rad_s = plant.state().omega_wb_b_rad_s;
        pushes.extend([
            Push::Body(rate_rad_s * -1e-3),
            Push::Wheel(1, 1e-4),
            Push::Gyro(Vector3::x() * (1e-3 * rate_rad_s.z)),
            Push::Turn(Vector3::z() * -1e-3),
        ]);
    })
}

fn model() -> PlatformModel {
    let mut model = PlatformModel::whorl_1_reference();
    model.tilt_limit = TiltLimit::NONE;
    for wheel in model.wheels_mut() {
        wheel.coulomb_friction_n_m = 0.0;
    }
    model
}

fn with(sizes: &[f64]) -> PlatformModel {
    let mut model = model();
    for ((id, name, unit), size) in EFFECTS.iter().zip(sizes).filter(|(_, size)| **size != 0.0) {
        model.effects.insert((*id).to_owned(), BTreeMap::from([((*name).to_owned(), size * unit)]));
    }
    model
}

/// Half a minute of a platform that turns, with its wheels driven.
fn record(truth: &PlatformModel) -> Recording {
    let start = InitialState {
        omega_wb_b_rad_s: Vector3::new(0.06, -0.05, 0.3),
        wheel_speed_rad_s: vec![30.0, -40.0, 50.0],
        ..InitialState::default()
    };
    let mut plant = Plant::new(truth, &start, 5).unwrap();
    let mut r = Recording { name: "law".to_owned(), ..Recording::default() };
    r.jet_pulses = vec![Vec::new(); truth.jets().len()];
    let mut directions = Vec::new();
    for k in 0..SAMPLES {
        let t = k as f64 / RATE_HZ as f64;
        plant.advance_to(k * 1_000_000_000 / RATE_HZ).unwrap();
        let imu = plant.sample_imu();
        r.gyro_b_rad_s.time_s.push(t);
        r.gyro_b_rad_s.value.push(imu.angular_velocity_rad_s);
        r.specific_force_b_m_s2.time_s.push(t);
        r.specific_force_b_m_s2.value.push(imu.specific_force_m_s2);
        r.wheel_speed_rad_s.time_s.push(t);
        r.wheel_speed_rad_s.value.push(plant.sample_wheels().iter().map(|w| w.speed_rad_s).collect());
        directions.push((t, plant.sample_vector().unwrap().direction.into_inner()));
        let torque: Vec<f64> = (0..3).map(|j| 0.05 * ((1.3 + f64::from(j)) * t).sin()).collect();
        plant.command_wheels(&torque).unwrap();
        r.wheel_torque_command_n_m.time_s.push(t);
        r.wheel_torque_command_n_m.value.push(torque);
    }
    let reference_world = truth.sensors.vector.unwrap().reference_direction_world;
    r.vectors.push(VectorChannel { reference_world, direction_b: directions.into_iter().collect() });
    r
}

/// What a recording says about the model without anything, of so many of the effects and of all laws.
fn said_of(recording: &Recording, effects: usize) -> Hints {
    let case = Prepared::new(recording, &model(), Settings::default()).unwrap();
    let followed = follow(&case, &Noise::stated(&case).unwrap());
    let parameters = vec![Parameter { stddev: 1.0, range: (-10.0, 10.0) }; effects];
    let model_at = |units: &[f64]| Some(with(units));
    let recordings = [recording.clone()];
    let at = vec![0.0; effects];
    hints(&recordings, &parameters, &model_at, &at, &[followed], &[laws()], &Settings::default())
        .unwrap()
        .remove(0)
}

#[test]
fn a_law_with_the_formula_of_an_effect_says_what_the_effect_says() {
    let n = EFFECTS.len();
    let found = said_of(&record(&model()), n);
    for (i, (id, ..)) in EFFECTS.iter().enumerate() {
        let (own, law) = (found.information[(i, i)], found.information[(n + i, n + i)]);
        let together = found.information[(i, n + i)] / (own * law).sqrt();
        assert!(own > 0.1 && (law / own - 1.0).abs() < 0.02, "{id}: {own} and {law}");
        assert!(together > 0.999, "{id}: they go together by {together}");
        let slopes = (found.slope[i], found.slope[n + i]);
        assert!((slopes.0 - slopes.1).abs() < 0.05 * own.sqrt(), "{id}: {slopes:?}");
    }
}

#[test]
fn a_recording_shows_the_size_of_the_law_that_made_it() {
    // As many deviations as a recording of nothing shows of each.
    let quiet = said_of(&record(&model()), 0);
    let sizes: Vec<f64> = (0..EFFECTS.len()).map(|i| 10.0 / quiet.information[(i, i)].sqrt()).collect();
    for i in 0..EFFECTS.len() {
        let mut of_one = vec![0.0; EFFECTS.len()];
        of_one[i] = sizes[i];
        let found = said_of(&record(&with(&of_one)), 0);
        let (estimate, stddev) =
            (found.slope[i] / found.information[(i, i)], found.information[(i, i)].sqrt().recip());
        let off = (estimate - sizes[i]) / stddev;
        assert!(off.abs() < 4.0, "{}: {estimate} +- {stddev} instead of {}", EFFECTS[i].0, sizes[i]);
    }
}
