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

/// A still stretch and the means in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Still {
    /// Index of the run.
    pub run: usize,
    /// From \[s\].
    pub from_s: f64,
    /// To \[s\].
    pub to_s: f64,
    /// Mean gyro reading [rad/s].
    pub gyro_rad_s: Vector3<f64>,
    /// Mean accelerometer reading [m/s^2].
    pub specific_force_m_s2: Vector3<f64>,
    /// Standard deviations of the two means.
    pub gyro_stddev_rad_s: Vector3<f64>,
    /// Of the accelerometer's [m/s^2].
    pub specific_force_stddev_m_s2: Vector3<f64>,
    /// Mean temperature \[K\], if measured.
    pub temperature_k: Option<f64>,
}

impl Still {
    /// Length \[s\].
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.to_s - self.from_s
    }

    /// Samples of a channel within.
    #[must_use]
    pub fn of(&self, series: &Series<Vector3<f64>>) -> Vec<Vector3<f64>> {
        between(series, self.from_s, self.to_s)
    }
}

fn between(series: &Series<Vector3<f64>>, from_s: f64, to_s: f64) -> Vec<Vector3<f64>> {
    let first = series.time_s.partition_point(|t| *t < from_s);
    let last = series.time_s.partition_point(|t| *t <= to_s);
    series.value.get(first..last).unwrap_or_default().to_vec()
}

/// Mean and standard deviation of a sample.
pub(super) fn mean_stddev(samples: &[Vector3<f64>]) -> (Vector3<f64>, Vector3<f64>) {
    let n = samples.len().max(1) as f64;
    let mean = samples.iter().sum::<Vector3<f64>>() / n;
    let square: Vector3<f64> = samples.iter().map(|s| (s - mean).component_mul(&(s - mean))).sum();
    (mean, (square / (n - 1.0).max(1.0)).map(f64::sqrt))
}

/// Stretches of a run where gyro and accelerometer show their noise alone.
///
/// A window is still when its scatter is at most three times the quietest window's (or the model's
/// noise) and its mean rate does not differ from the quietest's by more than the noise allows.
#[must_use]
pub fn still_stretches(index: usize, run: &Recording, sensors: &SensorSuite) -> Vec<Still> {
    let times = &run.gyro_b_rad_s.time_s;
    let (Some(start), Some(end)) = (times.first(), times.last()) else { return Vec::new() };
    let count = ((end - start) / WINDOW_S).floor() as usize;
    let from = |n: usize| start + n as f64 * WINDOW_S;
    let windows: Vec<Window> =
        (0..count).map(|n| Window::of(index, run, from(n), from(n) + WINDOW_S)).collect();
    let limit = |of: fn(&Window) -> f64, errors: &TriaxialErrors| {
        let scatter = quantile(windows.iter().map(of).filter(|s| *s > 0.0), QUIETEST);
        let floor = 0.2 * errors.noise_stddev.amax().max(errors.quantum);
        2.5 * if scatter.is_finite() { scatter.max(floor) } else { floor }
    };
    let gyro_limit = limit(|w| w.gyro_scatter, &sensors.gyro.errors);
    let force_limit = limit(|w| w.force_scatter, &sensors.accelerometer.errors);
    // A turn at constant rate is as quiet as rest: its mean is not. Rest is the commonest mean.
    let quiet = windows.iter().filter(|w| w.gyro_scatter < gyro_limit);
    let first_centre = centre_of(quiet.map(|w| w.still.gyro_rad_s));
    let allowed = |w: &Window, centre: &Vector3<f64>| {
        w.samples >= 5
            && w.gyro_scatter < gyro_limit
            && w.force_scatter < force_limit
            && (w.still.gyro_rad_s - centre).amax() < gyro_limit
    };
    let at_rest = windows.iter().filter(|w| allowed(w, &first_centre));
    let centre = centre_of(at_rest.map(|w| w.still.gyro_rad_s));
    let mut stretches = Vec::new();
    let mut began: Option<usize> = None;
    for n in 0..=windows.len() {
        let still = windows.get(n).is_some_and(|w| {
            // A slow change of position shows in the accelerometer's mean.
            let force = |w: &Window| w.still.specific_force_m_s2;
            let first = began.and_then(|first| windows.get(first));
            let steady = first.is_none_or(|first| (force(first) - force(w)).amax() < force_limit);
            allowed(w, &centre) && steady
        });
        match (still, began) {
            (true, None) => began = Some(n),
            (false, Some(first)) => {
                began = None;
                let (from_s, to_s) = (from(first) + EDGE_S, from(n) - EDGE_S);
                if to_s - from_s >= SHORTEST_S - 2.0 * EDGE_S {
                    stretches.push(Window::of(index, run, from_s, to_s).still);
                }
            }
            _ => {}
        }
    }
    stretches
}

/// Means over a time, the largest scatter of gyro [rad/s] and accelerometer [m/s^2], and the samples of the one that has fewer.
struct Window {
    still: Still,
    gyro_scatter: f64,
    force_scatter: f64,
    samples: usize,
}

impl Window {
    fn of(index: usize, run: &Recording, from_s: f64, to_s: f64) -> Self {
        let g = between(&run.gyro_b_rad_s, from_s, to_s);
        let a = between(&run.specific_force_b_m_s2, from_s, to_s);
        let ((gyro_rad_s, gyro_scatter), (specific_force_m_s2, force_scatter)) =
            (mean_stddev(&g), mean_stddev(&a));
        let t = &run.temperature_k;
        let within = t.time_s.partition_point(|t| *t < from_s)..t.time_s.partition_point(|t| *t <= to_s);
        let warm = t.value.get(within).filter(|warm| !warm.is_empty());
        let mean = |warm: &[f64]| warm.iter().sum::<f64>() / warm.len() as f64;
        let still = Still {
            run: index,
            from_s,
            to_s,
            gyro_rad_s,
            specific_force_m_s2,
            gyro_stddev_rad_s: gyro_scatter / (g.len().max(1) as f64).sqrt(),
            specific_force_stddev_m_s2: force_scatter / (a.len().max(1) as f64).sqrt(),
            temperature_k: warm.map(mean).or_else(|| t.held_at(to_s).copied()),
        };
        let samples = g.len().min(a.len());
        Self { still, gyro_scatter: gyro_scatter.amax(), force_scatter: force_scatter.amax(), samples }
    }
}

/// The median of each component.
fn centre_of(values: impl Iterator<Item = Vector3<f64>>) -> Vector3<f64> {
    let values: Vec<Vector3<f64>> = values.collect();
    let centre = |axis: usize| median(values.iter().map(|v| v[axis]));
    if values.is_empty() { Vector3::zeros() } else { Vector3::from_fn(|axis, _| centre(axis)) }
}
