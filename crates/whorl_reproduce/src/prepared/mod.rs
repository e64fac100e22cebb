//! Samples to evenly averaged points.

use nalgebra::{Unit, Vector3};
use whorl_dynamics::platform::TiltLimit;
use whorl_dynamics::{Environment, Gyrostat, PlatformModel};
use whorl_math::statistics::median;
use whorl_math::unit_or;
use whorl_recording::{OnInterval, Recording, Series};
use whorl_trajectory::noise::second_differences;
use whorl_trajectory::{Needs, Refusal, check};

use super::checks::{DataError, Finding};
use super::surroundings::Surroundings;
use super::wheels::WheelHistory;

/// Longest silence of the gyro that is bridged \[s\].
const LONGEST_GAP_S: f64 = 0.25;
/// Shortest uninterrupted stretch that is used \[s\].
const SHORTEST_STRETCH_S: f64 = 3.0;
/// Mass properties show on the bearing only, and after ten seconds at the earliest.
const NEEDS: Needs = Needs { shortest_s: 10.0, free: true, accelerometer: true };
/// Within this of the bearing's stop counts as touching it \[rad\], and for this long before and after \[s\].
const CONTACT_MARGIN_RAD: f64 = 0.002;
pub(crate) const CONTACT_LASTS_S: f64 = 0.3;
/// A tail of thrust is over after this many of its time constants.
const TAILS: f64 = 20.0;
/// Share of a sensor's range from which a sample counts as clipped.
const CLIPPED: f64 = 0.999;
/// So often must three readings in a row be the largest of all to show an end of the range, ...
const PLATEAU_SAMPLES: usize = 5;
/// ... in a signal whose noise is at least this share of it (a noiseless one may well stay constant).
const NOISY: f64 = 3e-4;

/// A direction seen by a vector sensor, moved to the time of its point.
#[derive(Debug, Clone, PartialEq)]
pub struct Direction {
    /// Seen in body axes, length one.
    pub direction_b: Vector3<f64>,
    /// The same in the world.
    pub reference_world: Unit<Vector3<f64>>,
}

/// Means of the samples around one time, and the torques that act until the next point.
#[derive(Debug, Clone, PartialEq)]
pub struct AveragedSample {
    /// Time since the start of the run \[s\].
    pub time_s: f64,
    /// Mean of the gyro samples, body axes [rad/s].
    pub gyro_b_rad_s: Vector3<f64>,
    /// How many.
    pub gyro_samples: f64,
    /// Mean of the accelerometer samples, body axes [m/s^2], and how many.
    pub specific_force_b_m_s2: Option<(Vector3<f64>, f64)>,
    /// Vector sensors' samples.
    pub directions: Vec<Direction>,
    /// Wheel speeds relative to the body [rad/s].
    pub wheel_speed_rad_s: Vec<f64>,
    /// Their rate of change [rad/s^2].
    pub wheel_acceleration_rad_s2: Vec<f64>,
    /// Mean thrust of each jet until the next point, as a share of its nominal thrust.
    pub jet_share: Vec<f64>,
    /// Mean of other known torques until the next point, body axes [N m].
    pub body_torque_b_n_m: Vector3<f64>,
    /// Known moment of the linear mass actuators, added to the gravity offset [N m].
    pub ballast_moment_b_n_m: Vector3<f64>,
    /// Gas, voltage, temperature, moving masses.
    pub surroundings: Surroundings,
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

/// All runs, ready.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PreparedData {
    /// Uninterrupted stretches; those of one run follow each other.
    pub chains: Vec<Chain>,
    /// What was noticed on the way.
    pub findings: Vec<Finding>,
}

/// Averages the samples of each run over about `step_s`, cuts at gaps and leaves clipped samples out.
/// Sensor latencies in the model are subtracted from the stamps; thrust is that of its valves and nozzles. Effects of
/// the model count.
///
/// # Errors
/// When a run cannot be used at all.
pub fn prepare(runs: &[&Recording], model: &PlatformModel, step_s: f64) -> Result<PreparedData, DataError> {
    let gyrostat = Gyrostat::new(model).map_err(|error| DataError::Model(error.to_string()))?;
    if !model.gyros().is_empty() {
        let sentence = "mass properties are identified from platforms with wheels and jets; this one has control moment gyros, \
                        whose gimbals the identification does not read. `whorl diagnose` does, and fits inertia and gravity \
                        offset beside its effects.";
        return Err(DataError::Refused(sentence.to_owned()));
    }
    let mut data = PreparedData::default();
    for (index, run) in runs.iter().enumerate() {
        prepare_run(index, run, &gyrostat, step_s, &mut data)?;
    }
    Ok(data)
}

fn prepare_run(
    index: usize,
    run: &Recording,
    gyrostat: &Gyrostat,
    step_s: f64,
    data: &mut PreparedData,
) -> Result<(), DataError> {
    let model = gyrostat.model();
    check(run, model, &NEEDS)?;
    let gyro_range = model.sensors.gyro.errors.range;
    let gyro = Samples::new(&run.gyro_b_rad_s, model.sensors.gyro.errors.lag_s(), gyro_range);
    let accelerometer = Samples::new(
        &run.specific_force_b_m_s2,
        model.sensors.accelerometer.errors.lag_s(),
        model.sensors.accelerometer.errors.range,
    );
    for (samples, what) in [(&gyro, "gyro"), (&accelerometer, "accelerometer")] {
        if samples.clipped > 0 {
            data.findings.push(Finding::warning(format!(
                "{}: {} {what} samples at the end of the sensor's range were left out ({:.2} % of the run): move more gently.",
                run.name,
                samples.clipped,
                100.0 * samples.clipped as f64 / (samples.clipped + samples.kept.len()) as f64
            )));
        }
    }
    let before = data.chains.len();
    let mut longest_s: f64 = 0.0;
    let mut touched_s = 0.0;
    let stretches = gyro.stretches(LONGEST_GAP_S);
    for (first, last) in &stretches {
        let stretch = gyro.kept.get(*first..*last).unwrap_or_default();
        let points = points_of(stretch, &accelerometer, run, gyrostat, step_s);
        let all = points.len();
        for points in free_of_contact(points, model) {
            touched_s -= points.len() as f64;
            let chain = Chain { run: index, points };
            longest_s = longest_s.max(chain.duration_s());
            if chain.duration_s() >= SHORTEST_STRETCH_S {
                data.chains.push(chain);
            }
        }
        touched_s += all as f64;
    }
    if stretches.len() > 1 {
        data.findings.push(Finding::warning(format!(
            "{}: the gyro fell silent for more than {LONGEST_GAP_S} s {} times; the {} stretches between are used, the motion is not carried over.",
            run.name,
            stretches.len() - 1,
            data.chains.len() - before
        )));
    }
    touched_s *= step_s;
    if touched_s > 0.0 {
        data.findings.push(Finding::warning(format!(
            "{}: {touched_s:.1} s at the stop of the bearing were left out: the platform is not free there. Swing less.",
            run.name
        )));
    }
    let usable_s: f64 = data.chains.iter().skip(before).map(Chain::duration_s).sum();
    if usable_s < NEEDS.shortest_s {
        let run = run.name.clone();
        return Err(Refusal::TooShort { run, duration_s: longest_s, needed_s: NEEDS.shortest_s }.into());
    }
    Ok(())
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

/// Ends of an axis's range where the readings themselves show one: a noisy signal that stays at its largest or smallest
/// value exactly, again and again, is clipped, whatever the model says of the range. Infinite where nothing shows.
fn ends(values: &[Vector3<f64>], axis: usize) -> (f64, f64) {
    let x: Vec<f64> = values.iter().map(|v| v[axis]).collect();
    let bends = second_differences(&x).filter(|bend| *bend > 0.0);
    // NaN, and so no end, where nothing bends.
    let noise = median(bends);
    let end = |sign: f64| {
        let extreme = x.iter().map(|v| sign * v).fold(f64::NEG_INFINITY, f64::max);
        let stays = x.windows(3).filter(|w| w.iter().all(|v| sign * v == extreme)).count();
        let noisy = noise > NOISY * extreme.abs() && extreme.abs() > 5.0 * noise;
        if noisy && stays >= PLATEAU_SAMPLES { extreme } else { f64::INFINITY }
    };
    (-end(-1.0), end(1.0))
}

/// Whether the specific force says that the platform is at its stop, or nearly.
pub(crate) fn touches(force_b_m_s2: &Vector3<f64>, limit: TiltLimit) -> bool {
    let force = force_b_m_s2;
    match limit {
        TiltLimit::Cone { max_rad } => force.x.hypot(force.y).atan2(force.z) > max_rad - CONTACT_MARGIN_RAD,
        TiltLimit::Pitch { max_rad } => {
            force.x.atan2(force.y.hypot(force.z)).abs() > max_rad - CONTACT_MARGIN_RAD
        }
    }
}

/// Samples with their latency subtracted and clipped ones left out.
struct Samples {
    kept: Vec<(f64, Vector3<f64>)>,
    clipped: usize,
}

impl Samples {
    fn new(series: &Series<Vector3<f64>>, latency_s: f64, range: f64) -> Self {
        let all = series.time_s.iter().zip(&series.value);
        let ends = [0, 1, 2].map(|axis| ends(&series.value, axis));
        let inside = |v: &Vector3<f64>| {
            v.amax() < CLIPPED * range && v.iter().zip(&ends).all(|(x, (low, high))| low < x && x < high)
        };
        let kept: Vec<_> = all.filter(|(_, v)| inside(v)).map(|(t, v)| (t - latency_s, *v)).collect();
        Self { clipped: series.len() - kept.len(), kept }
    }

    /// Index ranges without a gap.
    fn stretches(&self, longest_gap_s: f64) -> Vec<(usize, usize)> {
        let mut stretches = Vec::new();
        let mut first = 0;
        let pairs = self.kept.iter().zip(self.kept.iter().skip(1));
        for (i, ((before, _), (after, _))) in pairs.enumerate() {
            if after - before > longest_gap_s {
                stretches.push((first, i + 1));
                first = i + 1;
            }
        }
        stretches.push((first, self.kept.len()));
        stretches
    }

    /// Those in [from, to).
    fn between(&self, from_s: f64, to_s: f64) -> &[(f64, Vector3<f64>)] {
        let first = self.kept.partition_point(|(t, _)| *t < from_s);
        let last = self.kept.partition_point(|(t, _)| *t < to_s);
        self.kept.get(first..last).unwrap_or_default()
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
        let surroundings = Surroundings::at(run, gyrostat, *time_s);
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
