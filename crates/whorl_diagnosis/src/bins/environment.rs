//! The environment of the platform in a run: gas, voltage, temperature, moving masses.

use nalgebra::Vector3;
use whorl_dynamics::{Environment, Gyrostat, PlatformModel};
use whorl_recording::{Recording, Series};

use crate::DiagnosisError;
use crate::bins::run::Run;

impl Run {
    /// Pressure, gas, voltage and temperature at the nodes: measured, else predicted.
    pub(crate) fn set_environment(
        &mut self,
        recording: &Recording,
        model: &PlatformModel,
    ) -> Result<(), DiagnosisError> {
        let gyrostat = Gyrostat::new(model)?;
        let nodes = self.nodes();
        // Gas used by the commanded pulses at nominal thrust.
        let mut edges: Vec<(f64, f64)> = Vec::new();
        for (jet, pulses) in model.jets().iter().zip(&self.jet_pulses) {
            let rate = gyrostat.gas_rate_kg_s(jet.thrust_n);
            for pulse in pulses {
                edges.push((pulse.on_s + jet.opening_delay_s, rate));
                edges.push((pulse.off_s + jet.closing_delay_s, -rate));
            }
        }
        edges.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut used, mut rate, mut since, mut next) = (0.0, 0.0, f64::NEG_INFINITY, 0);
        for k in 0..nodes {
            let t = self.time(k);
            while let Some((edge_s, change)) = edges.get(next).copied().filter(|(edge_s, _)| *edge_s <= t) {
                if rate > 0.0 {
                    used += rate * (edge_s - since);
                }
                rate += change;
                since = edge_s;
                next += 1;
            }
            let so_far = if rate > 1e-12 { used + rate * (t - since) } else { used };
            self.gas_used_kg.push(so_far);
        }
        let sensors = &model.sensors;
        for k in 0..nodes {
            let t = self.time(k);
            let gas_kg = gyrostat.initial_gas_kg() - self.gas_used_kg.get(k).copied().unwrap_or(0.0);
            self.pressure_pa.push(gyrostat.pressure_pa(gas_kg.max(0.0)));
            self.voltage_v.push(model.bus.initial_v - model.bus.discharge_v_s * t);
            self.temperature_k.push(sensors.ambient_temperature_k + sensors.temperature_drift_k_s * t);
        }
        let replace = |slot: &mut Vec<f64>, series: &Series<f64>, times: &[f64], width_s: f64| {
            if series.len() > 1 {
                *slot = smoothed(series, times, width_s);
            }
        };
        replace(&mut self.pressure_pa, &recording.tank_pressure_pa, &self.times.node_s, 5.0);
        replace(&mut self.voltage_v, &recording.bus_voltage_v, &self.times.node_s, 0.15);
        replace(&mut self.temperature_k, &recording.temperature_k, &self.times.node_s, 5.0);
        if self.has_pressure {
            // What is gone from the full tank, not from the start of this run.
            let full_pa = model.tank().initial_pressure_pa.max(1.0);
            let full_kg = gyrostat.initial_gas_kg();
            for (used, pressure) in self.gas_used_kg.iter_mut().zip(&self.pressure_pa) {
                *used = full_kg * (1.0 - pressure / full_pa);
            }
        }
        Ok(())
    }

    /// What effects see at node `k` in this motion, gimbals as in the interval after it, wheels and inputs left to the
    /// caller.
    pub fn environment<'a>(&'a self, model: &'a PlatformModel, k: usize) -> Environment<'a> {
        let at = |values: &[f64], fallback: f64| values.get(k).copied().unwrap_or(fallback);
        let mut environment = Environment {
            time_s: self.time(k),
            tank_pressure_pa: at(&self.pressure_pa, model.tank().initial_pressure_pa),
            gas_used_kg: at(&self.gas_used_kg, 0.0),
            bus_voltage_v: at(&self.voltage_v, model.bus.initial_v),
            temperature_k: at(&self.temperature_k, model.sensors.ambient_temperature_k),
            ballast_direction: self.ballast_direction.get(k).copied().unwrap_or_default(),
            ..Environment::new(model, nalgebra::UnitQuaternion::identity(), Vector3::zeros())
        };
        if let Some(gimbals) = self.gimbals.get(k) {
            gimbals.show(&mut environment);
        }
        environment
    }
}

/// Mean of the samples within +-`width_s` of each time; the nearest sample where there is none.
fn smoothed(series: &Series<f64>, times: &[f64], width_s: f64) -> Vec<f64> {
    let mut sums = Vec::with_capacity(series.len() + 1);
    let mut sum = 0.0;
    sums.push(0.0);
    for value in &series.value {
        sum += value;
        sums.push(sum);
    }
    times
        .iter()
        .map(|t| {
            let from = series.time_s.partition_point(|s| *s < t - width_s);
            let to = series.time_s.partition_point(|s| *s <= t + width_s);
            match (sums.get(from), sums.get(to)) {
                (Some(a), Some(b)) if to > from => (b - a) / (to - from) as f64,
                _ => {
                    let after = series.time_s.partition_point(|s| s <= t);
                    let nearest = after.saturating_sub(1).min(series.len() - 1);
                    series.value.get(nearest).copied().unwrap_or(0.0)
                }
            }
        })
        .collect()
}
