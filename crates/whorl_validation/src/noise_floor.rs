//! Noise floors of the sensors: from stretches where the platform is still, else from the model.

use nalgebra::Vector3;
use serde::Serialize;
use whorl_dynamics::PlatformModel;
use whorl_math::allan_deviation;
use whorl_recording::{Channel, Component};
use whorl_trajectory::line::Line;

use crate::prediction::{Chunk, Simulator};

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

/// Looks for the still segments of a recording, chunk by chunk.
pub(crate) struct StillSearch<'a> {
    model: &'a PlatformModel,
    axes: Vec<(Channel, [StillNoise; 3])>,
}

impl<'a> StillSearch<'a> {
    /// In a recording of this model.
    pub fn new(model: &'a PlatformModel) -> Self {
        let sensors = &model.sensors;
        let triaxial = |sigma: Vector3<f64>| {
            [0, 1, 2].map(|i| StillNoise { by_parameters: sigma[i], ..StillNoise::default() })
        };
        let axes = vec![
            (Channel::Gyro, triaxial(sensors.gyro.errors.one_sample_stddev())),
            (Channel::Accelerometer, triaxial(sensors.accelerometer.errors.one_sample_stddev())),
        ];
        Self { model, axes }
    }

    /// Adds what was measured, and the model's prediction, from which motion is detected.
    pub fn add(&mut self, simulator: &Simulator<'_>, measured: &Chunk, predicted: &Chunk) {
        for (channel, axes) in &mut self.axes {
            let Some(track) = simulator.track(*channel, 0) else { continue };
            let times = simulator.tracks().get(track).map_or(&[][..], |track| track.time_s);
            for k in predicted.samples(track) {
                let Some(&time_s) = times.get(k) else { continue };
                for (i, axis) in axes.iter_mut().enumerate() {
                    axis.add(time_s, measured.number(track, k, i), predicted.number(track, k, i));
                }
            }
        }
    }

    /// The noise floors of all channels.
    pub fn floors(self) -> NoiseFloors {
        let sensors = &self.model.sensors;
        let of = |wanted: Channel| {
            let found = self.axes.iter().find(|(channel, _)| *channel == wanted);
            [0, 1, 2].map(|i| {
                let axis = found.and_then(|(_, axes)| axes.get(i)).cloned().unwrap_or_default();
                let sigma = axis.by_parameters;
                axis.floor().unwrap_or_else(|| by_parameters(sigma))
            })
        };
        NoiseFloors {
            gyro: of(Channel::Gyro),
            accelerometer: of(Channel::Accelerometer),
            vector: by_parameters(sensors.vector.map_or(f64::NAN, |v| v.noise_stddev_rad)),
            wheel_speed: by_parameters(sensors.wheel_speed.one_sample_stddev_rad_s()),
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
#[derive(Debug, Clone, Default)]
struct StillNoise {
    by_parameters: f64,
    first_s: Option<f64>,
    /// The present stretch: its number, and times, measurements and predictions in it.
    stretch: f64,
    time_s: Vec<f64>,
    measured: Vec<f64>,
    predicted: Vec<f64>,
    squares: f64,
    degrees: f64,
    still_s: f64,
    allan_squares: f64,
    allan_count: f64,
}

impl StillNoise {
    fn add(&mut self, time_s: f64, measured: f64, predicted: f64) {
        let first_s = *self.first_s.get_or_insert(time_s);
        let stretch = ((time_s - first_s) / STRETCH_S).floor();
        if stretch > self.stretch {
            self.end_stretch();
            self.stretch = stretch;
        }
        self.time_s.push(time_s);
        self.measured.push(measured);
        self.predicted.push(predicted);
    }

    fn end_stretch(&mut self) {
        self.judge_stretch();
        self.time_s.clear();
        self.measured.clear();
        self.predicted.clear();
    }

    fn judge_stretch(&mut self) {
        let count = self.time_s.len();
        let (Some(first), Some(last)) = (self.time_s.first(), self.time_s.last()) else { return };
        if count < 20 {
            return;
        }
        let motion = about_line(&self.time_s, &self.predicted);
        let moved = (motion.iter().map(|x| x * x).sum::<f64>() / count as f64).sqrt();
        if moved.is_nan() || moved > STILL * self.by_parameters {
            return;
        }
        let noise = about_line(&self.time_s, &self.measured);
        self.squares += noise.iter().map(|x| x * x).sum::<f64>();
        self.degrees += (count - 2) as f64;
        let length_s = last - first;
        self.still_s += length_s;
        let shortest = allan_deviation(&noise, length_s / (count - 1) as f64, 1);
        if let Some(point) = shortest.first() {
            self.allan_squares += point.deviation.powi(2);
            self.allan_count += 1.0;
        }
    }

    fn floor(mut self) -> Option<NoiseFloor> {
        self.end_stretch();
        let sigma = (self.squares / self.degrees).sqrt();
        let found = self.still_s >= STILL_NEEDED_S && sigma > 0.0 && sigma.is_finite();
        found.then(|| NoiseFloor {
            sigma,
            source: FloorSource::StillSegments,
            by_parameters: self.by_parameters,
            whiteness: (self.allan_count > 0.0)
                .then(|| (self.allan_squares / self.allan_count).sqrt() / sigma),
            still_s: self.still_s,
        })
    }
}

/// Residuals of the values about their straight line.
fn about_line(time_s: &[f64], value: &[f64]) -> Vec<f64> {
    let samples = || time_s.iter().copied().zip(value.iter().copied());
    Line::through(samples()).map_or_else(Vec::new, |line| samples().map(|(t, y)| y - line.at(t)).collect())
}
