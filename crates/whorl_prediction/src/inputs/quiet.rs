//! A model as a recording's prediction needs it.

use whorl_dynamics::PlatformModel;
use whorl_recording::{Recording, Series};

use whorl_math::line::Line;

/// The model without noise, with the supplies of this run: temperature, tank pressure and bus voltage as they were recorded.
#[must_use]
pub fn quiet(model: &PlatformModel, recording: &Recording) -> PlatformModel {
    let mut quiet = model.clone();
    let sensors = &mut quiet.sensors;
    sensors.silence();
    let duration_s = recording.duration_s();
    if let Some((start, slope)) = trend(&recording.temperature_k) {
        sensors.ambient_temperature_k = start;
        sensors.temperature_drift_k_s = if duration_s > 30.0 { slope } else { 0.0 };
    }
    let pressures = &recording.tank_pressure_pa.value;
    if let Some(first) = pressures.get(..pressures.len().min(5)).filter(|p| !p.is_empty()) {
        quiet.tank_mut().fill_to(first.iter().sum::<f64>() / first.len() as f64);
    }
    if let Some((start, slope)) = trend(&recording.bus_voltage_v) {
        let load = quiet.bus.sag_v_n_m
            * mean_of(
                recording.wheel_torque_command_n_m.value.iter().map(|u| u.iter().map(|x| x.abs()).sum()),
            );
        quiet.bus.initial_v = start + load;
        quiet.bus.discharge_v_s = if duration_s > 30.0 { -slope } else { 0.0 };
    }
    quiet
}

fn mean_of(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0usize), |(s, n), x| (s + x, n + 1));
    sum / count.max(1) as f64
}

/// Value at time zero and slope of the least-squares line.
fn trend(series: &Series<f64>) -> Option<(f64, f64)> {
    let line = Line::through(series.time_s.iter().copied().zip(series.value.iter().copied()))?;
    Some((line.at(0.0), line.slope))
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
