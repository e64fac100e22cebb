//! Recordings of samples in memory: arrays, data frames.

use nalgebra::{Unit, Vector3};
use whorl_bag::{Channel, Form};
use whorl_dynamics::PlatformModel;

use crate::error::RecordingError;
use crate::recording::{Mounting, OnInterval, Recording, VectorChannel, take_out_missing_axes};
use crate::series::{nanoseconds, seconds};

/// A quaternion whose length differs from 1 by more than this is none of an attitude.
const QUATERNION_LENGTH: f64 = 0.01;

/// Samples of one channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Samples {
    /// The channel; jets have [`JetPulses`].
    pub channel: Channel,
    /// Which sensor, from 0; of channels other than vector sensors there is one.
    pub sensor: usize,
    /// Time of each sample \[s\], in order.
    pub time_s: Vec<f64>,
    /// The numbers of all samples, one sample after the other.
    pub numbers: Vec<f64>,
    /// How many numbers a sample has.
    pub width: usize,
    /// Their unit, of those that columns of a CSV file may have; `None`: the SI unit.
    pub unit: Option<String>,
    /// Vector sensors: the direction in the world (east, north, up), of any length; `None`: that of the model.
    pub reference_world: Option<Vector3<f64>>,
}

/// Pulses of each jet, in the order of the platform's jets.
pub type JetPulses = Vec<Vec<OnInterval>>;

/// What is known of a recording besides its samples.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Circumstances {
    /// Name of the run.
    pub name: String,
    /// The platform.
    pub platform: String,
    /// How it was held.
    pub mounting: Mounting,
    /// Whether a controller was running.
    pub closed_loop: bool,
    /// Commanded pulses of the jets; `None`: not recorded.
    pub jets: Option<JetPulses>,
}

/// A recording of samples in memory. Times count from the first sample of all. As in files, a sample without a number in
/// every place is left out, and so is an axis of gyro or accelerometer that never has one.
///
/// # Errors
/// [`RecordingError::Samples`] with what is wrong and what is allowed: a channel twice, another number of times than of
/// samples, times that are not in order, a wrong width, an unknown unit, a vector sensor without a direction in the world.
pub fn recording_of(
    samples: Vec<Samples>,
    circumstances: Circumstances,
    model: Option<&PlatformModel>,
) -> Result<Recording, RecordingError> {
    let Circumstances { name, platform, mounting, closed_loop, jets } = circumstances;
    let mut recording = Recording { name, platform, mounting, closed_loop, ..Recording::default() };
    let pulses = jets.iter().flatten().flatten().map(|pulse| pulse.on_s);
    let first = samples.iter().filter_map(|of| of.time_s.first().copied()).chain(pulses);
    let first = first.filter(|t| t.is_finite()).min_by(f64::total_cmp).unwrap_or(0.0);
    let mut seen = Vec::new();
    let mut sensors: Vec<(usize, VectorChannel)> = Vec::new();
    for of in samples {
        let wrong =
            |reason: String| RecordingError::Samples { channel: named(of.channel, of.sensor), reason };
        if seen.contains(&(of.channel, of.sensor)) {
            return Err(wrong("it is given twice".to_owned()));
        }
        seen.push((of.channel, of.sensor));
        if of.sensor >= of.channel.most_sensors() {
            return Err(wrong(format!("allowed: at most {} sensors", of.channel.most_sensors())));
        }
        let mut numbers = checked(&of, first).map_err(wrong)?;
        if of.channel.info().form == Form::Directions {
            let reference_world = reference(&of, model).map_err(wrong)?;
            let direction_b = numbers.into_iter().filter_map(|(at, v)| {
                let direction = Vector3::from_column_slice(&v).try_normalize(f64::MIN_POSITIVE)?;
                Some((seconds(at), direction))
            });
            sensors.push((of.sensor, VectorChannel { reference_world, direction_b: direction_b.collect() }));
            continue;
        }
        if of.channel.info().may_lack_axes {
            recording.set_lacks(of.channel, take_out_missing_axes(&mut numbers));
        }
        if of.channel.info().form == Form::Attitude {
            normalise(&mut numbers).map_err(wrong)?;
        }
        if let Some(series) = recording.series_mut(of.channel, 0) {
            series.fill(&mut numbers.into_iter().map(|(at, numbers)| (seconds(at), numbers)));
        }
    }
    sensors.sort_by_key(|(sensor, _)| *sensor);
    recording.vectors = sensors.into_iter().map(|(_, vector)| vector).collect();
    recording.jet_pulses = jets.map_or_else(|| Ok(Vec::new()), |jets| shifted(jets, first))?;
    if !recording.has_motion() {
        let keys = Channel::ALL.iter().filter(|c| c.info().is_motion).map(|c| c.info().key);
        let reason = format!(
            "there is no sample that measures motion: needed is one of {}",
            keys.collect::<Vec<_>>().join(", ")
        );
        return Err(RecordingError::Samples { channel: recording.name, reason });
    }
    recording.remarks = recording.suspicions(model);
    Ok(recording)
}

/// Name of a channel in messages.
fn named(channel: Channel, sensor: usize) -> String {
    let key = channel.info().key;
    if channel.most_sensors() > 1 { format!("{key}_{}", sensor + 1) } else { key.to_owned() }
}

/// Time of each sample since `first` \[ns\], and its numbers in SI units; incomplete samples are left out, except of
/// sensors that may lack axes.
fn checked(of: &Samples, first_s: f64) -> Result<Vec<(i64, Vec<f64>)>, String> {
    let info = of.channel.info();
    let allowed = match info.form {
        Form::Axes | Form::Directions => Some((3, "x, y, z")),
        Form::Attitude => Some((4, "w, x, y, z")),
        Form::Scalar => Some((1, "one number")),
        Form::Wheels { .. } | Form::Gimbals { .. } => None,
        Form::Pulses => return Err("jets have pulses, not samples: give `jets`".to_owned()),
    };
    if let Some((width, what)) = allowed.filter(|(width, _)| *width != of.width) {
        return Err(format!("a sample has {} numbers; allowed: {width} ({what})", of.width));
    }
    if of.width == 0 {
        return Err("a sample has no numbers; allowed: one for each wheel or gyro".to_owned());
    }
    let rows = of.numbers.chunks_exact(of.width);
    if rows.len() != of.time_s.len() || !rows.remainder().is_empty() {
        return Err(format!("{} times and {} samples; allowed: as many", of.time_s.len(), rows.len()));
    }
    let unit = match &of.unit {
        None => info.units.first(),
        Some(name) => Some(info.units.iter().find(|unit| unit.name == name).ok_or_else(|| {
            let names: Vec<&str> = info.units.iter().map(|unit| unit.name).collect();
            let allowed = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
            format!("there is no unit {name}; allowed: {allowed}")
        })?),
    };
    let (factor, offset) = unit.map_or((1.0, 0.0), |unit| (unit.factor, unit.offset));
    let mut before: Option<i64> = None;
    let mut found = Vec::with_capacity(of.time_s.len());
    for (k, (time_s, row)) in of.time_s.iter().zip(rows).enumerate() {
        if !time_s.is_finite() {
            return Err(format!("time {k} is {time_s}; allowed: a number of seconds"));
        }
        let at = nanoseconds(time_s - first_s);
        if before.is_some_and(|before| at <= before) {
            return Err(format!(
                "time {k} ({time_s} s) is not after the one before it; samples must be in order of time, each time once"
            ));
        }
        before = Some(at);
        let complete = row.iter().all(|x| x.is_finite());
        if complete || info.may_lack_axes && row.iter().any(|x| x.is_finite()) {
            found.push((at, row.iter().map(|x| factor * x + offset).collect()));
        }
    }
    Ok(found)
}

fn reference(of: &Samples, model: Option<&PlatformModel>) -> Result<Unit<Vector3<f64>>, String> {
    let of_model = || model?.sensors.vector.filter(|_| of.sensor == 0).map(|v| v.reference_direction_world);
    match of.reference_world {
        Some(given) => Unit::try_new(given, 1e-12)
            .filter(|direction| direction.iter().all(|x| x.is_finite()))
            .ok_or_else(|| "its direction in the world has no length".to_owned()),
        None => of_model().ok_or_else(|| {
            "the direction that it sees in the world is not known: give reference_world (east, north, up), or a model that has it"
                .to_owned()
        }),
    }
}

fn normalise(quaternions: &mut [(i64, Vec<f64>)]) -> Result<(), String> {
    for (at, q) in quaternions {
        let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        if (length - 1.0).abs() > QUATERNION_LENGTH {
            return Err(format!(
                "the quaternion at {} s has length {length:.3}; allowed: 1 (w, x, y, z)",
                seconds(*at)
            ));
        }
        q.iter_mut().for_each(|x| *x /= length);
    }
    Ok(())
}

fn shifted(jets: JetPulses, first_s: f64) -> Result<JetPulses, RecordingError> {
    let mut all = Vec::with_capacity(jets.len());
    for (j, pulses) in jets.into_iter().enumerate() {
        let mut before = f64::NEG_INFINITY;
        let mut of_jet = Vec::with_capacity(pulses.len());
        for OnInterval { on_s, off_s } in pulses {
            if !(on_s >= before && off_s > on_s && off_s.is_finite()) {
                let reason = format!(
                    "jet {}: a pulse from {on_s} s to {off_s} s; allowed: pulses in order of time that end after they begin",
                    j + 1
                );
                return Err(RecordingError::Samples { channel: Channel::Jets.info().key.to_owned(), reason });
            }
            before = off_s;
            let grid = |t: f64| seconds(nanoseconds(t - first_s));
            of_jet.push(OnInterval { on_s: grid(on_s), off_s: grid(off_s) });
        }
        all.push(of_jet);
    }
    Ok(all)
}
