//! What a recording shows of its rig: rest, noise, steps, ranges, rates, directions, swings.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_math::GRAVITY_M_S2;
use whorl_math::noise::from_second_differences;
use whorl_math::statistics::median;
use whorl_recording::{Recording, Series, usual_rate_hz};

/// Length of a stretch that rests or moves \[s\].
const STRETCH_S: f64 = 1.0;
/// Samples that a stretch needs.
const FEWEST: usize = 10;
/// A stretch rests when nothing scatters by more than so many times its noise \[1\] ...
const QUIET: f64 = 1.6;
/// ... and the gyro reads less than this more than its noise: a bias, no turn [rad/s].
const STILL_RAD_S: f64 = 0.05;
/// Steps of digits that are less than this share of the noise do not matter \[1\].
const COARSE: f64 = 0.2;
/// Values that are multiples of one step, within this share of it \[1\].
const MULTIPLE: f64 = 0.02;
/// Largest readings that are equal in so many samples are the end of a range.
const PINNED: usize = 5;
/// A wheel does as it is told if both are this much alike \[1\].
const ALIKE: f64 = 0.8;
/// A direction that is level by less than this shows no north \[1\].
const LEVEL_LEAST: f64 = 0.05;
/// Slower than this no range ends [rad/s].
const LEAST_RANGE_RAD_S: f64 = 0.5;

/// Noise of three axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Noise {
    /// Standard deviation of one sample.
    pub stddev: Vector3<f64>,
    /// Mean while the rig rests, if it does.
    pub mean_at_rest: Option<Vector3<f64>>,
    /// Step of the digits, if it matters.
    pub quantum: Option<f64>,
    /// The largest reading, if it is the end of the range, and how many samples stand there.
    pub end: Option<(f64, usize)>,
}

/// What is seen.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Measured {
    /// Samples in a second of gyro, else of accelerometer or wheels.
    pub rate_hz: Option<f64>,
    /// How long the rig rests, in all \[s\].
    pub rest_s: f64,
    /// The gyro [rad/s].
    pub gyro: Option<Noise>,
    /// The accelerometer [m/s^2].
    pub force: Option<Noise>,
    /// Up in body axes as it is at rest, or for the most part.
    pub up_b: Option<Vector3<f64>>,
    /// The largest angle between that and where it is at another time \[rad\].
    pub most_tilt_rad: f64,
    /// The largest share by which the accelerometer's length is off gravity, of nine samples in ten \[1\].
    pub force_off: f64,
    /// Each vector sensor.
    pub vectors: Vec<SeenVector>,
    /// Noise of the wheels' speeds [rad/s], and the largest.
    pub wheels: Option<(f64, f64)>,
    /// Inertia of a wheel, the median of those that speed up as they are told [kg m^2].
    pub wheel_inertia_kg_m2: Option<f64>,
    /// The largest torque that was commanded [N m].
    pub most_torque_n_m: Option<f64>,
    /// The bus voltage at the start \[V\].
    pub bus_v: Option<f64>,
    /// Frequency of a free swing about the one axis that the gyro has \[Hz\].
    pub swing_hz: Option<f64>,
}

/// What is seen of a vector sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct SeenVector {
    /// New values in a second \[Hz\].
    pub rate_hz: Option<f64>,
    /// White noise of a value, across each of two axes \[rad\].
    pub noise_rad: f64,
    /// The direction in the world (east, north, up), where the accelerometer shows up; north is where the first sensor points.
    pub world: Option<Vector3<f64>>,
}

impl Measured {
    /// What stands for everything until the file has been read for the first time.
    #[must_use]
    pub fn not_yet() -> Self {
        let noise = |stddev: f64| Noise {
            stddev: Vector3::repeat(stddev),
            mean_at_rest: None,
            quantum: None,
            end: None,
        };
        Self {
            rate_hz: Some(100.0),
            gyro: Some(noise(0.01)),
            force: Some(noise(0.1)),
            vectors: vec![SeenVector { rate_hz: Some(10.0), noise_rad: 0.01, world: None }],
            ..Self::default()
        }
    }
}

/// Looks at a recording; `draft` is the model with which it was read.
#[must_use]
pub fn measure(recording: &Recording, draft: &PlatformModel) -> Measured {
    let gyro = &recording.gyro_b_rad_s;
    let force = &recording.specific_force_b_m_s2;
    let noise_of = |series: &Series<Vector3<f64>>| per_axis(series, from_second_differences);
    let (gyro_noise, force_noise) = (noise_of(gyro), noise_of(force));
    let rests = rests(recording, &gyro_noise, &force_noise);
    let rest_s = rests.iter().map(|[from, to]| to - from).sum();
    let times = [&gyro.time_s, &force.time_s, &recording.wheel_speed_rad_s.time_s];
    let whole = recording.has_whole_accelerometer();
    let up_b = up(force, &rests).filter(|_| whole || sees_hanging(recording));
    let wheels = &recording.wheel_speed_rad_s.value;
    Measured {
        rate_hz: times.into_iter().find_map(|times| usual_rate_hz(times)),
        rest_s,
        gyro: noise(gyro, &gyro_noise, &rests),
        force: noise(force, &force_noise, &rests),
        up_b,
        most_tilt_rad: up_b.filter(|_| whole).map_or(0.0, |up| most_tilt_rad(force, &up)),
        force_off: force_off(force),
        vectors: vectors(recording, &rests),
        wheels: (!wheels.is_empty()).then(|| {
            let count = wheels.first().map_or(0, Vec::len);
            let column =
                |j: usize| -> Vec<f64> { wheels.iter().filter_map(|all| all.get(j).copied()).collect() };
            let noise = (0..count).filter_map(|j| from_second_differences(&column(j))).fold(0.0, f64::max);
            let most = wheels.iter().flatten().fold(0.0, |most: f64, x| most.max(x.abs()));
            (noise, most)
        }),
        wheel_inertia_kg_m2: wheel_inertia_kg_m2(recording, draft),
        most_torque_n_m: recording
            .wheel_torque_command_n_m
            .value
            .iter()
            .flatten()
            .map(|u| u.abs())
            .max_by(f64::total_cmp),
        bus_v: recording.bus_voltage_v.value.first().copied(),
        swing_hz: swing_hz(recording, &gyro_noise),
    }
}

fn wheel_inertia_kg_m2(recording: &Recording, draft: &PlatformModel) -> Option<f64> {
    let responses = recording.wheel_responses(draft).into_iter().zip(draft.wheels());
    let inertias = responses.filter_map(|(response, wheel)| {
        let (ratio, correlation) = response?;
        // A motor may be wired in reverse.
        (correlation.abs() > ALIKE && ratio > 0.0).then_some(wheel.spin_inertia_kg_m2 / ratio)
    });
    let usual = median(inertias);
    (usual > 0.0 && usual.is_finite()).then_some(usual)
}

fn per_axis(series: &Series<Vector3<f64>>, of: impl Fn(&[f64]) -> Option<f64>) -> Vector3<f64> {
    let column = |axis: usize| -> Vec<f64> { series.value.iter().map(|v| v[axis]).collect() };
    Vector3::from_fn(|axis, _| of(&column(axis)).unwrap_or(0.0))
}

/// Stretches in which nothing moves, from and to \[s\].
fn rests(recording: &Recording, gyro_noise: &Vector3<f64>, force_noise: &Vector3<f64>) -> Vec<[f64; 2]> {
    let gyro = &recording.gyro_b_rad_s;
    let force = &recording.specific_force_b_m_s2;
    let leading = if gyro.is_empty() { force } else { gyro };
    let (Some(first), Some(last)) = (leading.time_s.first(), leading.time_s.last()) else {
        return Vec::new();
    };
    let mut found = Vec::new();
    let mut from = *first;
    while from + STRETCH_S <= *last {
        let to = from + STRETCH_S;
        let still = |mean: &Vector3<f64>| (0..3).all(|k| mean[k].abs() < STILL_RAD_S + 5.0 * gyro_noise[k]);
        let gyro_rests = gyro.is_empty()
            || spread(gyro, from, to).is_some_and(|(mean, stddev)| {
                still(&mean) && (0..3).all(|k| stddev[k] <= QUIET * gyro_noise[k])
            });
        let force_rests = force.is_empty()
            || spread(force, from, to)
                .is_none_or(|(_, stddev)| (0..3).all(|k| stddev[k] <= QUIET * force_noise[k]));
        if gyro_rests && force_rests {
            found.push([from, to]);
        }
        from = to;
    }
    found
}

/// Mean and standard deviation of the samples from one time to another.
fn spread(series: &Series<Vector3<f64>>, from: f64, to: f64) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let range = series.time_s.partition_point(|t| *t < from)..series.time_s.partition_point(|t| *t < to);
    let values = series.value.get(range).filter(|values| values.len() >= FEWEST)?;
    let mean = values.iter().sum::<Vector3<f64>>() / values.len() as f64;
    let squares: Vector3<f64> = values.iter().map(|v| (v - mean).component_mul(&(v - mean))).sum();
    Some((mean, (squares / (values.len() - 1) as f64).map(f64::sqrt)))
}

fn noise(series: &Series<Vector3<f64>>, differences: &Vector3<f64>, rests: &[[f64; 2]]) -> Option<Noise> {
    if series.is_empty() {
        return None;
    }
    let at_rest: Vec<(Vector3<f64>, Vector3<f64>)> =
        rests.iter().filter_map(|[from, to]| spread(series, *from, *to)).collect();
    let count = at_rest.len() as f64;
    let (mean_at_rest, stddev) = if at_rest.is_empty() {
        (None, *differences)
    } else {
        let mean = at_rest.iter().map(|(mean, _)| mean).sum::<Vector3<f64>>() / count;
        let square: Vector3<f64> = at_rest.iter().map(|(_, s)| s.component_mul(s)).sum();
        (Some(mean), (square / count).map(f64::sqrt))
    };
    let quantum = (0..3).filter_map(|axis| quantum(series.value.iter().map(|v| v[axis]))).fold(0.0, f64::max);
    Some(Noise {
        stddev,
        mean_at_rest,
        quantum: (quantum > COARSE * stddev.max()).then_some(quantum),
        end: end(series),
    })
}

/// The step of which all values are multiples.
fn quantum(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut sorted: Vec<f64> = values.take(20_000).collect();
    sorted.sort_by(f64::total_cmp);
    let gaps =
        || sorted.windows(2).map(|two| if let [a, b] = two { b - a } else { 0.0 }).filter(|gap| *gap > 1e-12);
    let least = gaps().min_by(f64::total_cmp)?;
    // Gaps that are nearly the least one are it, with rounding.
    let step = median(gaps().filter(|gap| *gap < 1.5 * least));
    let count = gaps().count();
    let whole = gaps()
        .filter(|gap| (gap / step - (gap / step).round()).abs() < MULTIPLE * (gap / step).max(1.0))
        .count();
    (count >= 3 && whole * 20 >= count * 19).then_some(step)
}

fn end(series: &Series<Vector3<f64>>) -> Option<(f64, usize)> {
    let readings = || series.value.iter().flat_map(|v| v.iter().map(|x| x.abs()));
    let most = readings().fold(0.0, f64::max);
    let count = readings().filter(|x| *x == most).count();
    let is_clear = readings().filter(|x| *x > 0.98 * most).count() < 2 * count;
    (most > LEAST_RANGE_RAD_S && count >= PINNED && is_clear).then_some((most, count))
}

/// The mean direction of the specific force at rest, else of all of it.
fn up(force: &Series<Vector3<f64>>, rests: &[[f64; 2]]) -> Option<Vector3<f64>> {
    let first = rests.first().and_then(|[from, to]| spread(force, *from, *to)).map(|(mean, _)| mean);
    let all = || force.value.iter().sum::<Vector3<f64>>();
    first.or_else(|| (!force.is_empty()).then(all))?.try_normalize(1e-9)
}

/// Whether what an accelerometer of one or two axes reads on a hinge is all of gravity: then it shows up as well as three axes do,
/// to 18 deg.
fn sees_hanging(recording: &Recording) -> bool {
    let forces = recording.specific_force_b_m_s2.value.iter().map(Vector3::norm);
    let is_hinge = recording.gyro_axes().iter().filter(|there| **there).count() == 1;
    is_hinge && (median(forces) / GRAVITY_M_S2 - 1.0).abs() < 0.05
}

fn most_tilt_rad(force: &Series<Vector3<f64>>, up: &Vector3<f64>) -> f64 {
    let step = (force.len() / 5_000).max(1);
    let angles = force.value.iter().step_by(step).map(|f| f.angle(up));
    let mut all: Vec<f64> = angles.collect();
    all.sort_by(f64::total_cmp);
    // Not the very largest: a knock is no tilt.
    all.get(all.len() * 99 / 100).copied().unwrap_or(0.0)
}

fn force_off(force: &Series<Vector3<f64>>) -> f64 {
    let mut off: Vec<f64> = force.value.iter().map(|f| (f.norm() / GRAVITY_M_S2 - 1.0).abs()).collect();
    off.sort_by(f64::total_cmp);
    off.get(off.len() * 9 / 10).copied().unwrap_or(0.0)
}

fn vectors(recording: &Recording, rests: &[[f64; 2]]) -> Vec<SeenVector> {
    let none = Series::default();
    let force = if recording.has_whole_accelerometer() { &recording.specific_force_b_m_s2 } else { &none };
    // Where the rig rests; else anywhere.
    let windows: Vec<[f64; 2]> = match (rests, force.time_s.as_slice()) {
        ([], [first, .., last]) => {
            (0..200).map(|k| first + (last - first) * f64::from(k) / 200.0).map(|t| [t, t + 0.2]).collect()
        }
        _ => rests.to_vec(),
    };
    let mean = |series: &Series<Vector3<f64>>, [from, to]: [f64; 2]| {
        let range = series.time_s.partition_point(|t| *t < from)..series.time_s.partition_point(|t| *t < to);
        series.value.get(range)?.iter().sum::<Vector3<f64>>().try_normalize(1e-9)
    };
    let first = recording.vectors.first().map(|sensor| &sensor.direction_b);
    let world = |series: &Series<Vector3<f64>>, window: [f64; 2]| {
        let (up, north, seen) = (mean(force, window)?, mean(first?, window)?, mean(series, window)?);
        let level = north - up * north.dot(&up);
        // A first sensor that sees the vertical shows no north.
        let north = level.try_normalize(LEVEL_LEAST).unwrap_or_else(Vector3::zeros);
        let east = north.cross(&up);
        Some(Vector3::new(seen.dot(&east), seen.dot(&north), seen.dot(&up)))
    };
    let of_sensor = |series: &Series<Vector3<f64>>| {
        let across = per_axis(series, from_second_differences);
        let seen: Vec<Vector3<f64>> = windows.iter().filter_map(|window| world(series, *window)).collect();
        SeenVector {
            rate_hz: usual_rate_hz(&series.time_s),
            noise_rad: (across.norm_squared() / 2.0).sqrt(),
            world: seen.iter().sum::<Vector3<f64>>().try_normalize(1e-9).filter(|_| !seen.is_empty()),
        }
    };
    recording.vectors.iter().map(|sensor| of_sensor(&sensor.direction_b)).collect()
}

/// Swings about an axis: evenly spaced changes of the rate's sign.
fn swing_hz(recording: &Recording, noise: &Vector3<f64>) -> Option<f64> {
    let axes = recording.gyro_axes();
    let axis =
        axes.iter().position(|there| *there).filter(|_| axes.iter().filter(|there| **there).count() == 1)?;
    let gyro = &recording.gyro_b_rad_s;
    let threshold = 4.0 * noise[axis];
    let (mut sign, mut crossings) = (0.0, Vec::new());
    for (t, rate) in gyro.time_s.iter().zip(gyro.value.iter().map(|v| v[axis])) {
        if rate.abs() > threshold && rate.signum() != sign {
            if sign != 0.0 {
                crossings.push(*t);
            }
            sign = rate.signum();
        }
    }
    if crossings.len() < 6 {
        return None;
    }
    let halves: Vec<f64> =
        crossings.windows(2).map(|two| if let [a, b] = two { b - a } else { 0.0 }).collect();
    let usual = median(halves.iter().copied());
    let even = halves.iter().filter(|half| (*half / usual - 1.0).abs() < 0.2).count();
    (usual > 0.0 && even * 10 >= halves.len() * 8).then(|| 0.5 / usual)
}
