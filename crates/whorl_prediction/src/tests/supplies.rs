//! Supplies as a recording shows them.

use nalgebra::Vector3;
use whorl_dynamics::{PlatformModel, Truth};
use whorl_recording::{Recording, Series};

use crate::{Prepared, Settings};

fn series(samples: impl IntoIterator<Item = (f64, f64)>) -> Series<f64> {
    let (time_s, value) = samples.into_iter().unzip();
    Series { time_s, value }
}

/// Of two minutes at rest.
fn recording() -> Recording {
    let time_s: Vec<f64> = (0..1200).map(|k| 0.1 * f64::from(k)).collect();
    let value = vec![Vector3::zeros(); time_s.len()];
    Recording { gyro_b_rad_s: Series { time_s, value }, ..Recording::default() }
}

/// A platform at the start of a run that begins with these pressures \[Pa\].
fn begun(model: &PlatformModel, pressures_pa: [f64; 3]) -> Truth {
    let tank_pressure_pa = series([0.0, 1.0, 2.0].into_iter().zip(pressures_pa));
    let recording = Recording { tank_pressure_pa, ..recording() };
    Prepared::new(&recording, model, Settings::default()).unwrap().plant.truth()
}

#[test]
fn a_tank_that_reads_less_than_nothing_is_empty() {
    let model = PlatformModel::whorl_1_reference();
    let full_kg = begun(&model, [2.0e7, 2.01e7, 1.99e7]).gas_kg;
    assert!((full_kg / model.tank().initial_gas_kg() - 1.0).abs() < 1e-9);
    assert!(begun(&model, [-900.0, 200.0, 100.0]).gas_kg < 1e-6 * full_kg);
}

/// What moves as gas is used has moved between two runs as well.
#[test]
fn gas_is_used_since_the_tank_was_as_the_model_has_it() {
    let mut model = PlatformModel::whorl_1_reference();
    let (full_kg, inertia_kg_m2) =
        (model.tank().initial_gas_kg(), model.mass_properties.inertia_b_kg_m2()[(1, 1)]);
    model.effects.insert("mass_shift".into(), [("shift_x_n_m_kg".to_owned(), 1.0)].into());
    let [full, quarter] =
        [2.0e7, 0.5e7].map(|pa| begun(&model, [pa; 3]).omega_dot_wb_b_rad_s2.y * inertia_kg_m2);
    let shifted_n_m = quarter - full;
    assert!((shifted_n_m / (0.75 * full_kg) - 1.0).abs() < 0.05, "{shifted_n_m} N m of {full_kg} kg");
}

/// A temperature that rises and falls, and a bus that sags under a load, are no straight lines.
#[test]
fn temperature_and_voltage_are_as_they_were_measured() {
    let model = PlatformModel::whorl_1_reference();
    let hump = |t: f64| 290.0 + 5.0 * (0.05 * t).sin();
    let sagging = |t: f64| if (40.0..60.0).contains(&t) { 22.0 } else { 24.0 };
    let times = || (0..12_000).map(|k| 0.01 * f64::from(k));
    let recording = Recording {
        temperature_k: series(times().map(|t| (t, hump(t)))),
        bus_voltage_v: series(times().map(|t| (t, sagging(t)))),
        ..recording()
    };
    let case = Prepared::new(&recording, &model, Settings::default()).unwrap();
    let mut plant = case.plant.clone();
    for t in [10.0, 31.0, 50.0, 62.0, 100.0] {
        plant.advance_to((t * 1e9) as i64).unwrap();
        let Truth { temperature_k, bus_voltage_v: bus_v, .. } = plant.truth();
        assert!((temperature_k - hump(t)).abs() < 1e-3, "{t} s: {temperature_k} K, {}", hump(t));
        assert!((bus_v - sagging(t)).abs() < 1e-9, "{t} s: {bus_v} V");
    }
}
