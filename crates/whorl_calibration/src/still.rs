//! Stretches in which nothing moved.

use nalgebra::Vector3;
use whorl_dynamics::platform::{SensorSuite, TriaxialErrors};
use whorl_math::statistics::{median, quantile};
use whorl_recording::{Recording, Series};

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

/// A still stretch and the means in it, with their standard deviations.
#[derive(Debug)]
pub(super) struct Still {
    /// Index of the run.
    pub run: usize,
    pub from_s: f64,
    pub to_s: f64,
    pub gyro_rad_s: Vector3<f64>,
    pub specific_force_m_s2: Vector3<f64>,
    pub gyro_stddev_rad_s: Vector3<f64>,
    pub specific_force_stddev_m_s2: Vector3<f64>,
    /// Largest scatter of gyro [rad/s] and accelerometer [m/s^2].
    scatter: [f64; 2],
    /// Samples of the sensor that has fewer.
    samples: usize,
}

impl Still {
    fn new(index: usize, run: &Recording, from_s: f64, to_s: f64) -> Self {
        let of = |series| -> (Vector3<f64>, Vector3<f64>, f64, usize) {
            let samples: &[Vector3<f64>] = between(series, from_s, to_s);
            let n = samples.len().max(1) as f64;
            let mean = samples.iter().sum::<Vector3<f64>>() / n;
            let squares = samples.iter().map(|s| (s - mean).map(|x| x * x)).sum::<Vector3<f64>>();
            let stddev = (squares / (n - 1.0).max(1.0)).map(f64::sqrt);
            (mean, stddev / n.sqrt(), stddev.amax(), samples.len())
        };
        let (gyro_rad_s, gyro_stddev_rad_s, gyro_scatter, rates) = of(&run.gyro_b_rad_s);
        let (specific_force_m_s2, specific_force_stddev_m_s2, force_scatter, forces) =
            of(&run.specific_force_b_m_s2);
        Self {
            run: index,
            from_s,
            to_s,
            gyro_rad_s,
            specific_force_m_s2,
            gyro_stddev_rad_s,
            specific_force_stddev_m_s2,
            scatter: [gyro_scatter, force_scatter],
            samples: rates.min(forces),
        }
    }

    pub fn duration_s(&self) -> f64 {
        self.to_s - self.from_s
    }

    /// Samples of a channel within.
    pub fn of<'a>(&self, series: &'a Series<Vector3<f64>>) -> &'a [Vector3<f64>] {
        between(series, self.from_s, self.to_s)
    }
}

fn between(series: &Series<Vector3<f64>>, from_s: f64, to_s: f64) -> &[Vector3<f64>] {
    let first = series.time_s.partition_point(|t| *t < from_s);
    let last = series.time_s.partition_point(|t| *t <= to_s);
    series.value.get(first..last).unwrap_or_default()
}

/// Stretches of a run where gyro and accelerometer show their noise alone.
///
/// A window is still when its scatter is at most three times the quietest window's (or the model's
/// noise) and its mean rate does not differ from the quietest's by more than the noise allows.
pub(super) fn still_stretches(index: usize, run: &Recording, sensors: &SensorSuite) -> Vec<Still> {
    let times = &run.gyro_b_rad_s.time_s;
    let (Some(start), Some(end)) = (times.first(), times.last()) else { return Vec::new() };
    let count = ((end - start) / WINDOW_S).floor() as usize;
    let from = |n: usize| start + n as f64 * WINDOW_S;
    let windows: Vec<Still> =
        (0..count).map(|n| Still::new(index, run, from(n), from(n) + WINDOW_S)).collect();
    let limit = |sensor: usize, errors: &TriaxialErrors| {
        let scatter = quantile(windows.iter().map(|w| w.scatter[sensor]).filter(|s| *s > 0.0), QUIETEST);
        let floor = 0.2 * errors.noise_stddev.amax().max(errors.quantum);
        2.5 * if scatter.is_finite() { scatter.max(floor) } else { floor }
    };
    let gyro_limit = limit(0, &sensors.gyro.errors);
    let force_limit = limit(1, &sensors.accelerometer.errors);
    // A turn at constant rate is as quiet as rest: its mean is not. Rest is the commonest mean.
    let first_centre = median_rate(windows.iter().filter(|w| w.scatter[0] < gyro_limit));
    let allowed = |w: &Still, centre: &Vector3<f64>| {
        let is_quiet = w.scatter[0] < gyro_limit && w.scatter[1] < force_limit;
        w.samples >= FEWEST && is_quiet && (w.gyro_rad_s - centre).amax() < gyro_limit
    };
    let centre = median_rate(windows.iter().filter(|w| allowed(w, &first_centre)));
    // A slow change of position shows in the accelerometer's mean.
    let is_steady =
        |a: &Still, b: &Still| (a.specific_force_m_s2 - b.specific_force_m_s2).amax() < force_limit;
    let mut stretches = Vec::new();
    let mut rest = &windows[..];
    while let Some(begin) = rest.iter().position(|w| allowed(w, &centre)) {
        let (first, from_begin) = (&rest[begin], &rest[begin..]);
        let is_still = |w: &&Still| allowed(w, &centre) && is_steady(first, w);
        let count = from_begin.iter().take_while(is_still).count().max(1);
        let (from_s, to_s) = (first.from_s + EDGE_S, from_begin[count - 1].to_s - EDGE_S);
        if to_s - from_s >= SHORTEST_S - 2.0 * EDGE_S {
            stretches.push(Still::new(index, run, from_s, to_s));
        }
        rest = &from_begin[count..];
    }
    stretches
}

/// The median of each component; zero of none.
fn median_rate<'a>(windows: impl Iterator<Item = &'a Still> + Clone) -> Vector3<f64> {
    let of = |axis: usize| median(windows.clone().map(|w| w.gyro_rad_s[axis]));
    Vector3::from_fn(|axis, _| Some(of(axis)).filter(|x| !x.is_nan()).unwrap_or(0.0))
}
