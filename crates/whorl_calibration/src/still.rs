//! Stretches in which nothing moved.

use nalgebra::Vector3;
use whorl_dynamics::platform::SensorSuite;
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
    let gyro = &run.gyro_b_rad_s;
    let (Some(start), Some(end)) = (gyro.time_s.first(), gyro.time_s.last()) else { return Vec::new() };
    let count = ((end - start) / WINDOW_S).floor() as usize;
    let windows: Vec<Window> = (0..count)
        .map(|n| {
            let from_s = start + n as f64 * WINDOW_S;
            let g = between(gyro, from_s, from_s + WINDOW_S);
            let a = between(&run.specific_force_b_m_s2, from_s, from_s + WINDOW_S);
            (from_s, g.len().min(a.len()), mean_stddev(&g), mean_stddev(&a))
        })
        .collect();
    let quietest = |of: &dyn Fn(usize) -> f64, floor: f64| {
        let scatter = quantile((0..windows.len()).map(of).filter(|s| *s > 0.0), QUIETEST);
        if scatter.is_finite() { scatter.max(floor) } else { floor }
    };
    let gyro_floor = sensors.gyro.errors.noise_stddev.amax().max(sensors.gyro.errors.quantum);
    let force_floor =
        sensors.accelerometer.errors.noise_stddev.amax().max(sensors.accelerometer.errors.quantum);
    let gyro_limit = 2.5 * quietest(&|n| windows[n].2.1.amax(), gyro_floor * 0.2);
    let force_limit = 2.5 * quietest(&|n| windows[n].3.1.amax(), force_floor * 0.2);
    // A turn at constant rate is as quiet as rest: its mean is not. Rest is the commonest mean.
    let mut centre = centre_of(windows.iter().filter(|w| w.2.1.amax() < gyro_limit).map(|w| w.2.0));
    let allowed = |w: &Window, centre: &Vector3<f64>| {
        w.1 >= 5
            && w.2.1.amax() < gyro_limit
            && w.3.1.amax() < force_limit
            && (w.2.0 - centre).amax() < gyro_limit
    };
    centre = centre_of(windows.iter().filter(|w| allowed(w, &centre)).map(|w| w.2.0));
    let mut stretches = Vec::new();
    let mut began: Option<usize> = None;
    for n in 0..=windows.len() {
        let still = windows.get(n).is_some_and(|w| {
            // A slow change of position shows in the accelerometer's mean.
            let steady =
                began.and_then(|b| windows.get(b)).is_none_or(|b| (b.3.0 - w.3.0).amax() < force_limit);
            allowed(w, &centre) && steady
        });
        match (still, began) {
            (true, None) => began = Some(n),
            (false, Some(first)) => {
                stretches.extend(stretch(index, run, &windows, first, n));
                began = None;
            }
            _ => {}
        }
    }
    stretches
}

type Window = (f64, usize, (Vector3<f64>, Vector3<f64>), (Vector3<f64>, Vector3<f64>));

fn stretch(index: usize, run: &Recording, windows: &[Window], first: usize, last: usize) -> Option<Still> {
    let from_s = windows.get(first)?.0 + EDGE_S;
    let to_s = windows.get(last.checked_sub(1)?)?.0 + WINDOW_S - EDGE_S;
    if to_s - from_s < SHORTEST_S - 2.0 * EDGE_S {
        return None;
    }
    let g = between(&run.gyro_b_rad_s, from_s, to_s);
    let a = between(&run.specific_force_b_m_s2, from_s, to_s);
    let (gyro_rad_s, gyro_scatter) = mean_stddev(&g);
    let (specific_force_m_s2, force_scatter) = mean_stddev(&a);
    let t = &run.temperature_k;
    let warm: Vec<f64> = t
        .time_s
        .iter()
        .zip(&t.value)
        .filter(|(t, _)| (from_s..=to_s).contains(*t))
        .map(|(_, v)| *v)
        .collect();
    let temperature_k = if warm.is_empty() {
        t.held_at(to_s).copied()
    } else {
        Some(warm.iter().sum::<f64>() / warm.len() as f64)
    };
    Some(Still {
        run: index,
        from_s,
        to_s,
        gyro_rad_s,
        specific_force_m_s2,
        gyro_stddev_rad_s: gyro_scatter / (g.len().max(1) as f64).sqrt(),
        specific_force_stddev_m_s2: force_scatter / (a.len().max(1) as f64).sqrt(),
        temperature_k,
    })
}

/// The median of each component.
fn centre_of(values: impl Iterator<Item = Vector3<f64>>) -> Vector3<f64> {
    let values: Vec<Vector3<f64>> = values.collect();
    let centre = |axis: usize| median(values.iter().map(|v| v[axis]));
    if values.is_empty() { Vector3::zeros() } else { Vector3::from_fn(|axis, _| centre(axis)) }
}
