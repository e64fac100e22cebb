//! Recordings made ready for the regressions and the joint filters of section 4.6: evenly averaged, cut at gaps, checked.

mod surroundings;
#[cfg(test)]
mod tests;
mod wheels;

use nalgebra::Vector3;
use thiserror::Error;
use whorl_dynamics::{Environment, Gyrostat, PlatformModel};
use whorl_estimation::sequential::{AveragedSample, CONTACT_LASTS_S, Direction, Surroundings, touches};
use whorl_math::unit_or;
use whorl_recording::{Needs, OnInterval, Recording, Refusal, Series, Why, check, usable_readings};

use self::wheels::WheelHistory;

/// Longest silence of the gyro that is bridged \[s\].
const LONGEST_GAP_S: f64 = 0.25;
/// Shortest uninterrupted stretch that is used \[s\].
const SHORTEST_STRETCH_S: f64 = 3.0;
/// Mass properties show on the bearing only, and after ten seconds at the earliest.
const NEEDS: Needs = Needs { shortest_s: 10.0, free: true, accelerometer: true };
/// A tail of thrust is over after this many of its time constants.
const TAILS: f64 = 20.0;

/// Why a recording cannot be prepared.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum DataError {
    /// The recording cannot be used.
    #[error(transparent)]
    Recording(#[from] Refusal),
    /// The model is not a possible platform, or of another kind than these methods are for.
    #[error("{0}")]
    Model(String),
}

/// An uninterrupted stretch of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Chain {
    /// Index of the run.
    pub run: usize,
    /// Its points in order of time, evenly spaced except for the jitter of the samples.
    pub points: Vec<AveragedSample>,
}

impl Chain {
    /// From the first to the last point \[s\].
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        match (self.points.first(), self.points.last()) {
            (Some(first), Some(last)) => last.time_s - first.time_s,
            _ => 0.0,
        }
    }
}

/// Uninterrupted stretches of runs, those of one run after each other: samples averaged over about `step_s`, cut at gaps and at the
/// bearing's stop, without those that say nothing.
/// Sensor latencies in the model are subtracted from the stamps; thrust is that of its valves and nozzles. Effects of
/// the model count.
///
/// # Errors
/// When a run cannot be used at all.
pub fn prepare(runs: &[&Recording], model: &PlatformModel, step_s: f64) -> Result<Vec<Chain>, DataError> {
    let gyrostat = Gyrostat::new(model)
        .map_err(|error| DataError::Model(format!("the model cannot be simulated: {error}")))?;
    if !model.gyros().is_empty() {
        let sentence = "the dissertation's regressions are for platforms with wheels and jets; this one has control moment gyros, \
                        whose gimbals they do not read. `whorl identify` by its default method does.";
        return Err(DataError::Model(sentence.to_owned()));
    }
    let mut chains = Vec::new();
    for (index, run) in runs.iter().enumerate() {
        check(run, model, &NEEDS)?;
        let (run, _) = usable_readings(run, model);
        let own = chains_of(index, &run, &gyrostat, step_s);
        let usable_s: f64 = own.iter().map(Chain::duration_s).sum();
        if usable_s < NEEDS.shortest_s {
            let duration_s = own.iter().map(Chain::duration_s).fold(0.0, f64::max);
            return Err(
                Refusal { run: run.name.clone(), why: Why::TooShort(duration_s, NEEDS.shortest_s) }.into()
            );
        }
        chains.extend(own);
    }
    Ok(chains)
}

fn chains_of(index: usize, run: &Recording, gyrostat: &Gyrostat, step_s: f64) -> Vec<Chain> {
    let sensors = &gyrostat.model().sensors;
    let gyro = Samples::new(&run.gyro_b_rad_s, sensors.gyro.errors.lag_s());
    let accelerometer = Samples::new(&run.specific_force_b_m_s2, sensors.accelerometer.errors.lag_s());
    let stretches = gyro.stretches(LONGEST_GAP_S);
    let points = stretches.iter().flat_map(|(first, last)| {
        let stretch = gyro.0.get(*first..*last).unwrap_or_default();
        free_of_contact(points_of(stretch, &accelerometer, run, gyrostat, step_s), gyrostat.model())
    });
    points
        .map(|points| Chain { run: index, points })
        .filter(|chain| chain.duration_s() >= SHORTEST_STRETCH_S)
        .collect()
}

/// Stretches away from the bearing's stop, whose contact is not modelled here.
fn free_of_contact(points: Vec<AveragedSample>, model: &PlatformModel) -> Vec<Vec<AveragedSample>> {
    let near = |p: &AveragedSample| {
        p.specific_force_b_m_s2.is_some_and(|(force, _)| touches(&force, model.tilt_limit))
    };
    let touching: Vec<f64> = points.iter().filter(|p| near(p)).map(|p| p.time_s).collect();
    let mut stretches = vec![Vec::new()];
    for point in points {
        let next = touching.partition_point(|t| *t < point.time_s - CONTACT_LASTS_S);
        if touching.get(next).is_some_and(|t| *t <= point.time_s + CONTACT_LASTS_S) {
            if stretches.last().is_some_and(|s| !s.is_empty()) {
                stretches.push(Vec::new());
            }
        } else if let Some(last) = stretches.last_mut() {
            last.push(point);
        }
    }
    stretches.retain(|s| !s.is_empty());
    stretches
}

/// Samples with their latency subtracted.
struct Samples(Vec<(f64, Vector3<f64>)>);

impl Samples {
    fn new(series: &Series<Vector3<f64>>, latency_s: f64) -> Self {
        Self(series.time_s.iter().zip(&series.value).map(|(t, v)| (t - latency_s, *v)).collect())
    }

    /// Index ranges without a gap.
    fn stretches(&self, longest_gap_s: f64) -> Vec<(usize, usize)> {
        let mut stretches = Vec::new();
        let mut first = 0;
        let pairs = self.0.iter().zip(self.0.iter().skip(1));
        for (i, ((before, _), (after, _))) in pairs.enumerate() {
            if after - before > longest_gap_s {
                stretches.push((first, i + 1));
                first = i + 1;
            }
        }
        stretches.push((first, self.0.len()));
        stretches
    }

    /// Those in [from, to).
    fn between(&self, from_s: f64, to_s: f64) -> &[(f64, Vector3<f64>)] {
        let first = self.0.partition_point(|(t, _)| *t < from_s);
        let last = self.0.partition_point(|(t, _)| *t < to_s);
        self.0.get(first..last).unwrap_or_default()
    }
}

fn points_of(
    stretch: &[(f64, Vector3<f64>)],
    accelerometer: &Samples,
    run: &Recording,
    gyrostat: &Gyrostat,
    step_s: f64,
) -> Vec<AveragedSample> {
    let model = gyrostat.model();
    let (Some((first_s, _)), Some((last_s, _))) = (stretch.first(), stretch.last()) else {
        return Vec::new();
    };
    let sample_s = (last_s - first_s) / (stretch.len().max(2) - 1) as f64;
    let block = ((step_s / sample_s).round() as usize).max(1);
    let blocks: Vec<_> = stretch.chunks_exact(block).collect();
    let means: Vec<(f64, Vector3<f64>)> = blocks
        .iter()
        .map(|b| {
            let n = b.len() as f64;
            let (t, v) = b.iter().fold((0.0, Vector3::zeros()), |(t, v), (ti, vi)| (t + ti, v + vi));
            (t / n, v / n)
        })
        .collect();
    let half_s = 0.5 * block as f64 * sample_s;
    let wheels = WheelHistory::new(run, model);
    let mut points: Vec<AveragedSample> = Vec::with_capacity(means.len());
    for (i, (time_s, rate)) in means.iter().enumerate() {
        let until_s = means.get(i + 1).map_or(time_s + 2.0 * half_s, |(t, _)| *t);
        let seen = accelerometer.between(time_s - half_s, time_s + half_s);
        let specific_force_b_m_s2 = (!seen.is_empty()).then(|| {
            let n = seen.len() as f64;
            let mean_s = seen.iter().map(|(t, _)| t).sum::<f64>() / n;
            let mean = seen.iter().map(|(_, v)| v).sum::<Vector3<f64>>() / n;
            // Gravity turns past the body: d(g k_b)/dt = -w x g k_b.
            (mean - rate.cross(&mean) * (time_s - mean_s), n)
        });
        let (wheel_speed_rad_s, wheel_acceleration_rad_s2) = wheels.at(*time_s, half_s);
        let held = |series: &Series<Vector3<f64>>| {
            series.held_at(0.5 * (time_s + until_s)).copied().unwrap_or_else(Vector3::zeros)
        };
        let surroundings = surroundings::at(run, gyrostat, *time_s);
        points.push(AveragedSample {
            time_s: *time_s,
            gyro_b_rad_s: *rate,
            gyro_samples: block as f64,
            specific_force_b_m_s2,
            directions: directions_at(run, model, *time_s, half_s, rate),
            wheel_speed_rad_s,
            wheel_acceleration_rad_s2,
            jet_share: jet_shares(run, gyrostat, &surroundings, *time_s, until_s),
            body_torque_b_n_m: mean_held(&run.body_torque_b_n_m, *time_s, until_s),
            ballast_moment_b_n_m: held(&run.ballast_moment_b_n_m),
            surroundings,
        });
    }
    points
}

/// Time mean of a held quantity.
fn mean_held(series: &Series<Vector3<f64>>, from_s: f64, to_s: f64) -> Vector3<f64> {
    let mut sum = series.held_at(from_s).copied().unwrap_or_else(Vector3::zeros) * (to_s - from_s);
    let first = series.time_s.partition_point(|t| *t <= from_s);
    let mut before = series.held_at(from_s).copied().unwrap_or_else(Vector3::zeros);
    for (t, value) in series.time_s.iter().zip(&series.value).skip(first).take_while(|(t, _)| **t < to_s) {
        sum += (value - before) * (to_s - t);
        before = *value;
    }
    sum / (to_s - from_s)
}

fn directions_at(
    run: &Recording,
    model: &PlatformModel,
    time_s: f64,
    half_s: f64,
    rate: &Vector3<f64>,
) -> Vec<Direction> {
    let latency_s = model.sensors.vector.map_or(0.0, |v| v.latency_s);
    let mut directions = Vec::new();
    for channel in &run.vectors {
        let series = &channel.direction_b;
        let first = series.time_s.partition_point(|t| t - latency_s < time_s - half_s);
        let samples = series.time_s.iter().zip(&series.value).skip(first);
        for (t, seen) in samples.take_while(|(t, _)| **t - latency_s < time_s + half_s) {
            let direction_b = seen - rate.cross(seen) * (time_s - (t - latency_s));
            directions.push(Direction {
                direction_b: unit_or(direction_b, channel.reference_world).into_inner(),
                reference_world: channel.reference_world,
            });
        }
    }
    directions
}

/// Mean thrust of each jet over an interval: valve delays, lag of the thrust and tank pressure included.
fn jet_shares(
    run: &Recording,
    gyrostat: &Gyrostat,
    around: &Surroundings,
    from_s: f64,
    to_s: f64,
) -> Vec<f64> {
    let (model, lag) = (gyrostat.model(), gyrostat.thrust_lag());
    let factor = match run.tank_pressure_pa.held_at(from_s) {
        Some(p) => {
            (p / model.tank().reference_pressure_pa).max(0.0).powf(model.tank().thrust_pressure_exponent)
        }
        None => 1.0,
    };
    let environment = Environment {
        bus_voltage_v: around.bus_voltage_v,
        tank_pressure_pa: around.tank_pressure_pa,
        ..Environment::new(model, nalgebra::UnitQuaternion::identity(), Vector3::zeros())
    };
    let late = gyrostat.effects().valve_delay_s(&environment);
    let tail_s = if lag.is_none() { 0.0 } else { TAILS * lag.tail_s.max(lag.rise_s) };
    // Seconds of full thrust from a valve's opening until a time after it.
    let until = |open_s: f64, since_s: f64| {
        if since_s <= 0.0 {
            return 0.0;
        }
        let reached = lag.fraction(0.0, true, open_s);
        lag.impulse_s(0.0, true, since_s.min(open_s))
            + lag.impulse_s(reached, false, (since_s - open_s).max(0.0))
    };
    let open = |pulses: &[OnInterval], opening_s: f64, closing_s: f64| {
        let first = pulses.partition_point(|p| p.off_s + closing_s + tail_s <= from_s);
        let running = pulses.iter().skip(first).take_while(|p| p.on_s + opening_s < to_s);
        if lag.is_none() {
            return running
                .map(|p| (p.off_s + closing_s).min(to_s) - (p.on_s + opening_s).max(from_s))
                .filter(|overlap| *overlap > 0.0)
                .sum::<f64>();
        }
        let within = |p: &OnInterval| {
            let (on_s, open_s) = (p.on_s + opening_s, p.off_s + closing_s - p.on_s - opening_s);
            if open_s <= 0.0 { 0.0 } else { until(open_s, to_s - on_s) - until(open_s, from_s - on_s) }
        };
        running.map(within).sum::<f64>()
    };
    run.jet_pulses
        .iter()
        .zip(model.jets())
        .map(|(pulses, jet)| {
            factor * open(pulses, jet.opening_delay_s + late.0, jet.closing_delay_s + late.1)
                / (to_s - from_s)
        })
        .collect()
}
