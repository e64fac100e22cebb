//! What a recording says of temperature, bus and gas, as inputs of a plant that follows it.

use whorl_dynamics::{Course, MeasuredSupplies};

use crate::{Recording, Series};

/// Measured temperatures and voltages are taken as means over this time \[s\]: the noise of one sample is no change of the supply, and a bus sags with
/// what a valve or a wheel takes for about as long.
const STEP_S: f64 = 0.1;
/// Samples whose mean is the tank's pressure at the start.
const FIRST: usize = 5;

/// Supplies of a recording as they were measured.
#[must_use]
pub fn supplies(recording: &Recording) -> MeasuredSupplies {
    let course = |series: &Series<f64>| {
        Course::through(series.time_s.iter().copied().zip(series.value.iter().copied()), STEP_S)
    };
    let pressures = &recording.tank_pressure_pa.value;
    let first = pressures.get(..pressures.len().min(FIRST)).filter(|first| !first.is_empty());
    MeasuredSupplies {
        first_tank_pressure_pa: first.map(|first| first.iter().sum::<f64>() / first.len() as f64),
        temperature_k: course(&recording.temperature_k),
        bus_voltage_v: course(&recording.bus_voltage_v),
    }
}
