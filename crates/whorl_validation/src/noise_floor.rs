//! Noise floors of the sensors: from stretches where the platform is still, else from the model.

use nalgebra::Vector3;
use serde::Serialize;
use whorl_dynamics::PlatformModel;
use whorl_math::allan_deviation;
use whorl_recording::{Channel, Component, Recording, Series};
use whorl_trajectory::line::Line;

use crate::prediction::Prediction;

/// Length of the tested stretches \[s\].
const STRETCH_S: f64 = 2.0;
/// Still: the predicted motion, but for a straight line, is below this share of the noise.
const STILL: f64 = 0.3;
/// Minimum still time \[s\].
const STILL_NEEDED_S: f64 = 6.0;

/// Source of a noise floor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FloorSource {
    /// Measured where the platform was still.
    StillSegments,
    /// The sensor parameters of the model.
    SensorParameters,
}

/// Noise of one channel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NoiseFloor {
    /// Standard deviation of one sample, in the channel's unit.
    pub sigma: f64,
    /// Source of the value.
    pub source: FloorSource,
    /// Standard deviation according to the model's sensor parameters.
    pub by_parameters: f64,
    /// Allan deviation at one sample time over `sigma`: near 1 for white noise, below 1 for coloured
    /// noise. `None` without still segments.
    pub whiteness: Option<f64>,
    /// Still time that was found \[s\].
    pub still_s: f64,
}

/// Noise floors of all channels.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NoiseFloors {
    /// Gyro axes [rad/s].
    pub gyro: [NoiseFloor; 3],
    /// Accelerometer axes [m/s^2].
    pub accelerometer: [NoiseFloor; 3],
    /// Angle of a vector sensor about each of two axes \[rad\].
    pub vector: NoiseFloor,
    /// Wheel speed [rad/s].
    pub wheel_speed: NoiseFloor,
}

fn by_parameters(sigma: f64) -> NoiseFloor {
    NoiseFloor {
        sigma,
        source: FloorSource::SensorParameters,
        by_parameters: sigma,
        whiteness: None,
        still_s: 0.0,
    }
}

impl NoiseFloors {
    /// From the still segments of a recording; `predicted` is the model's prediction, from which motion
    /// is detected.
    #[must_use]
    pub fn of(recording: &Recording, model: &PlatformModel, predicted: &Prediction) -> Self {
        let sensors = &model.sensors;
        let gyro = sensors.gyro.errors.one_sample_stddev();
        let force = sensors.accelerometer.errors.one_sample_stddev();
        let speed = sensors.wheel_speed.one_sample_stddev_rad_s();
        let triaxial = |series: &Series<Vector3<f64>>, expected: &[Vector3<f64>], sigma: Vector3<f64>| {
            [0, 1, 2].map(|i| {
                let measured: Vec<f64> = series.value.iter().map(|v| v[i]).collect();
                let expected: Vec<f64> = expected.iter().map(|v| v[i]).collect();
                still_noise(&series.time_s, &measured, &expected, sigma[i])
                    .unwrap_or_else(|| by_parameters(sigma[i]))
            })
        };
        Self {
            gyro: triaxial(&recording.gyro_b_rad_s, &predicted.gyro_b_rad_s, gyro),
            accelerometer: triaxial(
                &recording.specific_force_b_m_s2,
                &predicted.specific_force_b_m_s2,
                force,
            ),
            vector: by_parameters(sensors.vector.map_or(f64::NAN, |v| v.noise_stddev_rad)),
            wheel_speed: by_parameters(speed),
        }
    }
}

impl NoiseFloors {
    /// Noise floor of one component; all wheels have the same, and so have all vector sensors.
    ///
    /// NaN for channels that no model predicts.
    #[must_use]
    pub fn of_component(&self, component: Component) -> NoiseFloor {
        let of_axis = |axes: &[NoiseFloor; 3]| axes.get(component.index()).copied();
        let floor = match component.channel {
            Channel::Gyro => of_axis(&self.gyro),
            Channel::Accelerometer => of_axis(&self.accelerometer),
            Channel::Vector => Some(self.vector),
            Channel::WheelSpeed => Some(self.wheel_speed),
            _ => None,
        };
        floor.unwrap_or_else(|| by_parameters(f64::NAN))
    }
}

/// Noise about straight lines over stretches in which the platform moves along straight lines.
fn still_noise(
    time_s: &[f64],
    measured: &[f64],
    predicted: &[f64],
    by_parameters: f64,
) -> Option<NoiseFloor> {
    let first = *time_s.first()?;
    let (mut squares, mut degrees, mut still_s) = (0.0, 0.0, 0.0);
    let (mut allan_squares, mut allan_count) = (0.0, 0.0);
    let mut start = 0;
    while start < time_s.len() {
        let stretch = ((time_s.get(start)? - first) / STRETCH_S).floor();
        let end = time_s.partition_point(|t| ((t - first) / STRETCH_S).floor() <= stretch).max(start + 1);
        let (times, y, p) = (time_s.get(start..end)?, measured.get(start..end)?, predicted.get(start..end)?);
        start = end;
        let count = times.len();
        if count < 20 {
            continue;
        }
        let motion = about_line(times, p);
        let moved = (motion.iter().map(|x| x * x).sum::<f64>() / count as f64).sqrt();
        if moved.is_nan() || moved > STILL * by_parameters {
            continue;
        }
        let noise = about_line(times, y);
        squares += noise.iter().map(|x| x * x).sum::<f64>();
        degrees += (count - 2) as f64;
        let length_s = times.last()? - times.first()?;
        still_s += length_s;
        let shortest = allan_deviation(&noise, length_s / (count - 1) as f64, 1);
        if let Some(point) = shortest.first() {
            allan_squares += point.deviation.powi(2);
            allan_count += 1.0;
        }
    }
    let sigma = (squares / degrees).sqrt();
    (still_s >= STILL_NEEDED_S && sigma > 0.0 && sigma.is_finite()).then(|| NoiseFloor {
        sigma,
        source: FloorSource::StillSegments,
        by_parameters,
        whiteness: (allan_count > 0.0).then(|| (allan_squares / allan_count).sqrt() / sigma),
        still_s,
    })
}

/// Residuals of the values about their straight line.
fn about_line(time_s: &[f64], value: &[f64]) -> Vec<f64> {
    let samples = || time_s.iter().copied().zip(value.iter().copied());
    Line::through(samples()).map_or_else(Vec::new, |line| samples().map(|(t, y)| y - line.at(t)).collect())
}
