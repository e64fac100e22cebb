//! Sensor readings around a node.

use nalgebra::{Unit, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_dynamics::platform::TriaxialErrors;
use whorl_math::quaternion_exp;
use whorl_recording::{Recording, Series};

use crate::line::Line;

/// Time between nodes \[s\].
pub(super) const NODE_S: f64 = 0.2;

/// A sensor's readings, corrected for its modelled errors, and their times.
fn corrected(series: &Series<Vector3<f64>>, errors: &TriaxialErrors) -> (Vec<f64>, Vec<Vector3<f64>>) {
    let value = series.value.iter().map(|y| errors.corrected(y)).collect();
    (series.time_s.iter().map(|t| t - errors.lag_s()).collect(), value)
}

/// Linear between samples `k - 1` and `k`; the nearest beyond the ends.
pub(super) fn rate_between(times_s: &[f64], rates: &[Vector3<f64>], k: usize, time_s: f64) -> Vector3<f64> {
    let before = k.checked_sub(1).and_then(|i| Some((*times_s.get(i)?, *rates.get(i)?)));
    let after = times_s.get(k).copied().zip(rates.get(k).copied());
    match (before, after) {
        (Some((t0, a)), Some((t1, b))) => a.lerp(&b, ((time_s - t0) / (t1 - t0)).clamp(0.0, 1.0)),
        (Some((_, a)), None) => a,
        (None, Some((_, b))) => b,
        (None, None) => Vector3::zeros(),
    }
}

/// Index range of the samples within half a node of `time_s`.
fn around(times_s: &[f64], time_s: f64) -> std::ops::Range<usize> {
    let first = times_s.partition_point(|t| *t < time_s - 0.5 * NODE_S);
    first..times_s.partition_point(|t| *t < time_s + 0.5 * NODE_S).max(first)
}

/// Readings of a run, corrected for the model's sensor errors, and their latency-free times \[s\].
pub(super) struct Sensors<'a> {
    pub model: &'a PlatformModel,
    pub gyro: (Vec<f64>, Vec<Vector3<f64>>),
    pub force: (Vec<f64>, Vec<Vector3<f64>>),
    pub vectors: Vec<Directions>,
}

/// Readings of a vector sensor.
pub(super) struct Directions {
    /// Times without latency \[s\].
    pub time_s: Vec<f64>,
    direction_b: Vec<Vector3<f64>>,
    pub reference_world: Unit<Vector3<f64>>,
    stddev_rad: f64,
}

impl<'a> Sensors<'a> {
    pub fn new(recording: &Recording, model: &'a PlatformModel) -> Self {
        let turn = quaternion_exp(&model.sensors.vector.map_or(Vector3::zeros(), |v| v.misalignment_rad));
        let stddev_rad = model.sensors.vector.map_or(5e-3, |v| v.noise_stddev_rad.max(1e-6));
        let latency_s = model.sensors.vector.map_or(0.0, |v| v.latency_s);
        let vectors = recording.vectors.iter().map(|channel| Directions {
            time_s: channel.direction_b.time_s.iter().map(|t| t - latency_s).collect(),
            direction_b: channel.direction_b.value.iter().map(|d| turn * d).collect(),
            reference_world: channel.reference_world,
            stddev_rad,
        });
        let mut gyro = corrected(&recording.gyro_b_rad_s, &model.sensors.gyro.errors);
        let axes = recording.gyro_axes();
        if model.freedom.axes() < 3 {
            // A body on a shaft turns about it alone, whatever the axes read.
            for rate in &mut gyro.1 {
                *rate = model.freedom.rate_from_gyro_b_rad_s(rate, axes).unwrap_or_default();
            }
        }
        Self {
            model,
            gyro,
            force: corrected(&recording.specific_force_b_m_s2, &model.sensors.accelerometer.errors),
            vectors: vectors.collect(),
        }
    }

    pub fn rate_at(&self, time_s: f64) -> Vector3<f64> {
        let k = self.gyro.0.partition_point(|t| *t <= time_s);
        rate_between(&self.gyro.0, &self.gyro.1, k, time_s)
    }

    /// Mean specific force around a node without the acceleration due to motion about the pivot: gravity.
    /// `None` where nothing was measured or no weight is felt.
    pub fn gravity(&self, time_s: f64, bias: &Vector3<f64>) -> Option<(Vector3<f64>, f64)> {
        if !self.model.freedom.has_weight() {
            return None;
        }
        let range = around(&self.force.0, time_s);
        let values = self.force.1.get(range).filter(|v| !v.is_empty())?;
        let mean = values.iter().sum::<Vector3<f64>>() / values.len() as f64;
        let gyro = around(&self.gyro.0, time_s);
        let (times, rates) = (self.gyro.0.get(gyro.clone())?, self.gyro.1.get(gyro)?);
        let line = Line::through(times.iter().copied().zip(rates.iter().copied()));
        let (omega, slope, slope_variance) = match line {
            Some(line) if line.spread > 0.0 => {
                (line.mean, line.slope, one_sample(&self.model.sensors.gyro.errors).powi(2) / line.spread)
            }
            _ => (self.rate_at(time_s), Vector3::zeros(), 0.0),
        };
        let omega = omega - bias;
        let arm = self.model.sensors.accelerometer.lever_arm_b_m;
        let sigma = one_sample(&self.model.sensors.accelerometer.errors);
        let variance = sigma * sigma / values.len() as f64 + arm.norm_squared() * slope_variance;
        Some((mean - slope.cross(&arm) - omega.cross(&omega.cross(&arm)), variance))
    }

    /// Mean direction measured around a node, rotated to the node's time.
    pub fn direction(
        &self,
        sensor: usize,
        time_s: f64,
        bias: &Vector3<f64>,
    ) -> Option<(Vector3<f64>, Unit<Vector3<f64>>, f64)> {
        let seen = self.vectors.get(sensor)?;
        let range = around(&seen.time_s, time_s);
        let count = range.len();
        let omega = self.rate_at(time_s) - bias;
        let sum: Vector3<f64> = range
            .filter_map(|k| Some((seen.time_s.get(k)?, seen.direction_b.get(k)?)))
            .map(|(t, d)| quaternion_exp(&(omega * (t - time_s))) * d)
            .sum();
        (count > 0)
            .then(|| (sum / count as f64, seen.reference_world, seen.stddev_rad.powi(2) / count as f64))
    }
}

/// Noise of one sample of the noisiest axis.
pub(super) fn one_sample(errors: &TriaxialErrors) -> f64 {
    errors.one_sample_stddev().amax().max(1e-9)
}
