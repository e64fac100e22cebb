//! Supplies as a recording shows them.

use whorl_dynamics::PlatformModel;
use whorl_recording::{Recording, Series};

use crate::prepared::quiet;

#[test]
fn a_tank_that_reads_less_than_nothing_is_empty() {
    let model = PlatformModel::whorl_1_reference();
    let with = |readings_pa: [f64; 3]| {
        let tank_pressure_pa = Series { time_s: vec![0.0, 1.0, 2.0], value: readings_pa.to_vec() };
        let recording = Recording { tank_pressure_pa, ..Recording::default() };
        quiet(&model, &recording).tank().initial_gas_kg()
    };
    let full_kg = with([2.0e7, 2.01e7, 1.99e7]);
    assert!((full_kg / model.tank().initial_gas_kg() - 1.0).abs() < 1e-9);
    assert!(with([-900.0, 200.0, 100.0]) < 1e-6 * full_kg);
}
