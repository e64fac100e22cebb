//! Stretches in which nothing moved.

use nalgebra::Vector3;
use whorl_dynamics::platform::{SensorSuite, TriaxialErrors};
use whorl_math::statistics::{median, quantile};

use crate::{Recording, Series};

/// Shortest still stretch \[s\].
const SHORTEST_S: f64 = 2.0;
/// Windows that are judged one by one \[s\].
const WINDOW_S: f64 = 0.5;
/// This share of the windows is taken to be as quiet as the quietest.
const QUIETEST: f64 = 0.05;
/// Left out at both ends \[s\], where a hand may still touch it.
const EDGE_S: f64 = 0.3;
/// Windows with fewer samples say nothing.
const FEWEST: usize = 5;

/// What a sensor with three axes read within some time, in its unit.
#[derive(Debug)]
pub struct Readings<'a> {
    /// One by one.
    pub samples: &'a [Vector3<f64>],
    /// Their mean,
    pub mean: Vector3<f64>,
    /// and its standard deviation.
    pub stddev: Vector3<f64>,
    /// The largest of its axes.
    scatter: f64,
}

impl<'a> Readings<'a> {
    fn of(series: &'a Series<Vector3<f64>>, from_s: f64, to_s: f64) -> Self {
        let first = series.time_s.partition_point(|t| *t < from_s);
        let last = series.time_s.partition_point(|t| *t <= to_s);
        let samples = series.value.get(first..last).unwrap_or_default();
        let n = samples.len().max(1) as f64;
        let mean = samples.iter().sum::<Vector3<f64>>() / n;
        let squares = samples.iter().map(|s| (s - mean).map(|x| x * x)).sum::<Vector3<f64>>();
        let stddev = (squares / (n - 1.0).max(1.0)).map(f64::sqrt);
        Self { samples, mean, stddev: stddev / n.sqrt(), scatter: stddev.amax() }
    }
}

/// A still stretch.
#[derive(Debug)]
pub struct Still<'a> {
    /// Of this run.
    pub run: &'a Recording,
    /// Its beginning \[s\],
    pub from_s: f64,
    /// and its end \[s\].
    pub to_s: f64,
    /// Of the gyro [rad/s].
    pub gyro: Readings<'a>,
    /// Of the accelerometer [m/s^2].
    pub force: Readings<'a>,
}

impl<'a> Still<'a> {
    fn new(run: &'a Recording, from_s: f64, to_s: f64) -> Self {
        let gyro = Readings::of(&run.gyro_b_rad_s, from_s, to_s);
        let force = Readings::of(&run.specific_force_b_m_s2, from_s, to_s);
        Self { run, from_s, to_s, gyro, force }
    }

    /// Its length \[s\].
    pub fn duration_s(&self) -> f64 {
        self.to_s - self.from_s
    }
}

/// Stretches of a run where gyro and accelerometer show their noise alone. A window is still when its scatter is at most 2.5 times the
/// quietest window's (or a share of the model's noise) and its mean rate does not differ from that of rest by more.
pub fn still_stretches<'a>(run: &'a Recording, sensors: &SensorSuite) -> Vec<Still<'a>> {
    let times = &run.gyro_b_rad_s.time_s;
    let (Some(start), Some(end)) = (times.first(), times.last()) else { return Vec::new() };
    let count = ((end - start) / WINDOW_S).floor() as usize;
    let from = |n: usize| start + n as f64 * WINDOW_S;
    let windows: Vec<Still<'_>> = (0..count).map(|n| Still::new(run, from(n), from(n) + WINDOW_S)).collect();
    let limit = |of: fn(&Still<'_>) -> f64, errors: &TriaxialErrors| {
        let scatter = quantile(windows.iter().map(of).filter(|s| *s > 0.0), QUIETEST);
        let floor = 0.2 * errors.noise_stddev.amax().max(errors.quantum);
        2.5 * if scatter.is_finite() { scatter.max(floor) } else { floor }
    };
    let gyro_limit = limit(|w| w.gyro.scatter, &sensors.gyro.errors);
    let force_limit = limit(|w| w.force.scatter, &sensors.accelerometer.errors);
    // A turn at constant rate is as quiet as rest: its mean is not. Rest is the commonest mean.
    let first_centre = median_rate(windows.iter().filter(|w| w.gyro.scatter < gyro_limit));
    let allowed = |w: &Still<'_>, centre: &Vector3<f64>| {
        let is_quiet = w.gyro.scatter < gyro_limit && w.force.scatter < force_limit;
        let count = w.gyro.samples.len().min(w.force.samples.len());
        count >= FEWEST && is_quiet && (w.gyro.mean - centre).amax() < gyro_limit
    };
    let centre = median_rate(windows.iter().filter(|w| allowed(w, &first_centre)));
    let mut stretches = Vec::new();
    let mut rest = &windows[..];
    while let Some(begin) = rest.iter().position(|w| allowed(w, &centre)) {
        let (first, from_begin) = (&rest[begin], &rest[begin..]);
        // A slow change of position shows in the accelerometer's mean.
        let is_steady = |w: &Still<'_>| (first.force.mean - w.force.mean).amax() < force_limit;
        let is_still = |w: &&Still<'_>| allowed(w, &centre) && is_steady(w);
        let count = from_begin.iter().take_while(is_still).count().max(1);
        let (from_s, to_s) = (first.from_s + EDGE_S, from_begin[count - 1].to_s - EDGE_S);
        if to_s - from_s >= SHORTEST_S - 2.0 * EDGE_S {
            stretches.push(Still::new(run, from_s, to_s));
        }
        rest = &from_begin[count..];
    }
    stretches
}

/// The median of each component; zero of none.
fn median_rate<'a>(windows: impl Iterator<Item = &'a Still<'a>> + Clone) -> Vector3<f64> {
    let of = |axis: usize| median(windows.clone().map(|w| w.gyro.mean[axis]));
    Vector3::from_fn(|axis, _| Some(of(axis)).filter(|x| !x.is_nan()).unwrap_or(0.0))
}
