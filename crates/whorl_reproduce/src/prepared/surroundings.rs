//! Inputs of a model's effects besides the motion: gas, voltage, temperature, moving masses.

use nalgebra::Vector3;
use whorl_dynamics::Gyrostat;
use whorl_estimation::sequential::Surroundings;
use whorl_recording::{Recording, Series};

/// At a time of a run: measured, else as the model predicts.
pub fn at(run: &Recording, gyrostat: &Gyrostat, time_s: f64) -> Surroundings {
    let (model, full_kg) = (gyrostat.model(), gyrostat.initial_gas_kg());
    let measured = |series: &Series<f64>| series.held_at(time_s).copied();
    let pressure = measured(&run.tank_pressure_pa);
    let gas_used_kg = match pressure {
        // Gas goes with pressure in an isothermal tank.
        Some(pa) => full_kg * (1.0 - pa / model.tank().initial_pressure_pa),
        None => used_by_pulses_kg(run, gyrostat, time_s),
    };
    let (bus, sensors) = (&model.bus, &model.sensors);
    Surroundings {
        tank_pressure_pa: pressure.unwrap_or_else(|| gyrostat.pressure_pa(full_kg - gas_used_kg)),
        gas_used_kg,
        bus_voltage_v: measured(&run.bus_voltage_v).unwrap_or(bus.initial_v - bus.discharge_v_s * time_s),
        temperature_k: measured(&run.temperature_k)
            .unwrap_or(sensors.ambient_temperature_k + sensors.temperature_drift_k_s * time_s),
        ballast_direction: last_travel(&run.ballast_moment_b_n_m, time_s),
    }
}

/// Gas that pulses at nominal thrust have used up to a time \[kg\].
fn used_by_pulses_kg(run: &Recording, gyrostat: &Gyrostat, time_s: f64) -> f64 {
    let of_jet = |(pulses, jet): (&Vec<whorl_recording::OnInterval>, &whorl_dynamics::platform::Jet)| {
        let open = pulses.iter().take_while(|p| p.on_s < time_s).map(|p| p.off_s.min(time_s) - p.on_s);
        gyrostat.gas_rate_kg_s(jet.thrust_n) * open.sum::<f64>()
    };
    run.jet_pulses.iter().zip(gyrostat.model().jets()).map(of_jet).sum()
}

/// Sense of the latest change of each component up to a time.
fn last_travel(moment: &Series<Vector3<f64>>, time_s: f64) -> Vector3<f64> {
    let until = moment.time_s.partition_point(|t| *t <= time_s);
    let so_far = moment.value.get(..until).unwrap_or_default();
    Vector3::from_fn(|axis, _| {
        let change = so_far.windows(2).rev().map(|w| w[1][axis] - w[0][axis]).find(|d| *d != 0.0);
        change.map_or(0.0, f64::signum)
    })
}
