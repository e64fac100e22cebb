//! All readings of a recording in the order of the instants that they show (METHOD.md, "Readings").

use nalgebra::Vector3;
use whorl_dynamics::platform::SensorSuite;
use whorl_recording::{Channel, ChannelSeries, Component, Recording};

use crate::inputs::commands::ns;

pub(crate) struct Track<'a> {
    pub channel: Channel,
    pub sensor: usize,
    pub time_s: &'a [f64],
    pub series: &'a dyn ChannelSeries,
    /// Components that are taken in; a direction's are those across it.
    pub components: Vec<Component>,
    latency_ns: i64,
    /// Readings at or beyond this say only that they are: limits of the sensor, in its unit.
    range: f64,
}

impl Track<'_> {
    /// The instant that sample `k` shows \[ns\].
    pub fn instant_ns(&self, k: usize) -> Option<i64> {
        Some(ns(*self.time_s.get(k)?) - self.latency_ns)
    }

    /// Whether it measures all that a sensor of its channel may; not asked of wheels.
    pub fn is_whole(&self) -> bool {
        self.components.len() == Component::of(self.channel, self.sensor, 0).count()
    }

    /// A number of sample `k`; `None` where it says nothing: not finite, or at the sensor's limit.
    pub fn number(&self, k: usize, index: usize) -> Option<f64> {
        self.series.number(k, index).filter(|y| y.is_finite() && y.abs() < self.range)
    }

    pub fn vector(&self, k: usize) -> Option<Vector3<f64>> {
        let [x, y, z] = [0, 1, 2].map(|i| self.series.number(k, i).filter(|y| y.is_finite()));
        Some(Vector3::new(x?, y?, z?))
    }
}

/// The sensors of a recording that the model predicts.
pub(crate) fn tracks<'a>(
    recording: &'a Recording,
    sensors: &SensorSuite,
    clamped: bool,
    wheels: usize,
) -> Vec<Track<'a>> {
    let commanded = !recording.wheel_torque_command_n_m.is_empty();
    let vectors = recording.vectors.len();
    let all = [
        (Channel::Gyro, usize::from(!clamped), sensors.gyro.errors.latency_s, sensors.gyro.errors.range),
        (
            Channel::Accelerometer,
            usize::from(!clamped && sensors.accelerometer.fitted),
            sensors.accelerometer.errors.latency_s,
            sensors.accelerometer.errors.range,
        ),
        (
            Channel::Vector,
            if clamped { 0 } else { vectors },
            sensors.vector.map_or(0.0, |v| v.latency_s),
            f64::INFINITY,
        ),
        // Without commands the model's wheels are driven along their measured speeds.
        (Channel::WheelSpeed, usize::from(commanded), 0.0, f64::INFINITY),
    ];
    let mut tracks = Vec::new();
    for (channel, count, latency_s, range) in all {
        for sensor in 0..count {
            let Some(series) = recording.series(channel, sensor) else { continue };
            let components: Vec<Component> = Component::of(channel, sensor, wheels)
                .filter(|component| recording.measures(*component))
                .collect();
            if series.time_s().is_empty() || components.is_empty() {
                continue;
            }
            let (time_s, latency_ns) = (series.time_s(), ns(latency_s));
            tracks.push(Track { channel, sensor, time_s, series, components, latency_ns, range });
        }
    }
    tracks
}

/// Where each track is, on the way through a recording.
#[derive(Debug, Clone)]
pub(crate) struct Cursor {
    next: Vec<usize>,
}

impl Cursor {
    pub fn new(tracks: &[Track<'_>]) -> Self {
        Self { next: vec![0; tracks.len()] }
    }

    /// The next instant at which anything was read \[ns\].
    pub fn instant_ns(&self, tracks: &[Track<'_>]) -> Option<i64> {
        tracks.iter().zip(&self.next).filter_map(|(track, k)| track.instant_ns(*k)).min()
    }

    /// Track and sample of the next reading at this instant, or before.
    pub fn take(&mut self, tracks: &[Track<'_>], instant_ns: i64) -> Option<(usize, usize)> {
        let mut due = tracks.iter().zip(&mut self.next).enumerate();
        let (position, (_, k)) =
            due.find(|(_, (track, k))| track.instant_ns(**k).is_some_and(|t| t <= instant_ns))?;
        *k += 1;
        Some((position, *k - 1))
    }
}
