//! All readings of a recording in the order of the instants that they show, and which are taken in together, as their means (METHOD.md, "Readings").

use nalgebra::Vector3;
use whorl_dynamics::platform::SensorSuite;
use whorl_recording::{Channel, ChannelSeries, Component, Recording};

use crate::commands::ns;

/// Of the time within which a random torque comes and goes: its mean over a cell is known from its end to a hundredth of its variance.
pub(crate) const SHARE_OF_TIME: f64 = 1.0 / 6.0;
/// Radians of the fastest motion: of exp(-A t) the terms that are left out are a twentieth of a hundredth.
pub(crate) const SHARE_OF_MOTION_RAD: f64 = 0.25;

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

    /// Of each component half the mean square of its change from one sample to the next, which motion makes larger; nothing of what never changes.
    pub fn variances_within(&self) -> impl Iterator<Item = (Component, f64)> {
        self.components.iter().filter_map(|component| {
            let number = |k: usize| self.number(k, component.index());
            let changes = (1..self.time_s.len()).filter_map(|k| Some(number(k)? - number(k - 1)?));
            let (sum, count) = changes.fold((0.0, 0.0), |(sum, n), by| (sum + by * by, n + 1.0));
            (sum > 0.0).then_some((*component, 0.5 * sum / count))
        })
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
    let [gyro, force] = [&sensors.gyro.errors, &sensors.accelerometer.errors];
    let on_body = |count: usize| if clamped { 0 } else { count };
    let (vectors, vector_s) = (recording.vectors.len(), sensors.vector.map_or(0.0, |v| v.latency_s));
    // Without commands the model's wheels are driven along their measured speeds.
    let commanded = usize::from(!recording.wheel_torque_command_n_m.is_empty());
    let forces = usize::from(sensors.accelerometer.fitted);
    let all = [
        (Channel::Gyro, on_body(1), gyro.latency_s, gyro.range),
        (Channel::Accelerometer, on_body(forces), force.latency_s, force.range),
        (Channel::Vector, on_body(vectors), vector_s, f64::INFINITY),
        (Channel::WheelSpeed, commanded, 0.0, f64::INFINITY),
    ];
    let sensors = all.into_iter().flat_map(|(channel, count, latency_s, range)| {
        (0..count).filter_map(move |sensor| {
            let series = recording.series(channel, sensor)?;
            let measured = |component: &Component| recording.measures(*component);
            let components = Component::of(channel, sensor, wheels).filter(measured).collect();
            let (time_s, latency_ns) = (series.time_s(), ns(latency_s));
            Some(Track { channel, sensor, time_s, series, components, latency_ns, range })
        })
    });
    sensors.filter(|track| !track.time_s.is_empty() && !track.components.is_empty()).collect()
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

    pub fn instant_ns(&self, tracks: &[Track<'_>]) -> Option<i64> {
        tracks.iter().zip(&self.next).filter_map(|(track, k)| track.instant_ns(*k)).min()
    }

    /// Track and sample of all readings up to this instant, which it passes.
    pub fn take(&mut self, tracks: &[Track<'_>], instant_ns: i64, due: &mut Vec<(usize, usize)>) {
        due.clear();
        for (position, (track, k)) in tracks.iter().zip(&mut self.next).enumerate() {
            while track.instant_ns(*k).is_some_and(|t| t <= instant_ns) {
                due.push((position, *k));
                *k += 1;
            }
        }
    }
}

/// The last instant of each cell \[ns\]; none: every instant is one. Cells are the recording's own, so that all models are asked for the same numbers.
pub(crate) fn cell_ends_ns(tracks: &[Track<'_>], recording: &Recording, cell_s: f64) -> Vec<i64> {
    let (mut ends, cell_ns) = (Vec::new(), ns(cell_s));
    if cell_ns <= 0 {
        return ends;
    }
    let edges_ns = edges_ns(recording);
    let comes = |from_ns: i64, to_ns: i64| {
        let next = edges_ns.partition_point(|time_ns| *time_ns < from_ns);
        edges_ns.get(next).is_some_and(|time_ns| *time_ns < to_ns)
    };
    let (mut cursor, mut first_ns, mut before_ns) = (Cursor::new(tracks), i64::MIN, i64::MIN);
    let (mut is_open, mut due) = (false, Vec::new());
    while let Some(instant_ns) = cursor.instant_ns(tracks) {
        cursor.take(tracks, instant_ns, &mut due);
        if is_open && !comes(before_ns, instant_ns) && instant_ns - first_ns < cell_ns {
            ends.pop();
        } else {
            first_ns = instant_ns;
        }
        ends.push(instant_ns);
        (is_open, before_ns) = (true, instant_ns);
    }
    ends
}

/// When anything comes that no mean over a cell stands for \[ns\], in order: masses that are moved, gimbals that are turned.
fn edges_ns(recording: &Recording) -> Vec<i64> {
    let all = [&recording.ballast_moment_b_n_m.time_s, &recording.gimbal_angle_rad.time_s];
    let mut edges: Vec<i64> = all.into_iter().flatten().copied().map(ns).collect();
    edges.sort_unstable();
    edges
}
