//! A recording as a run directory.

use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use whorl_bag::{BagOptions, RawSample, RunDescription, RunWriter, extra};
use whorl_msgs::geometry_msgs::{Quaternion, Vector3Stamped};
use whorl_msgs::sensor_msgs::{BatteryState, FluidPressure, Imu, JointState, Temperature};
use whorl_msgs::std_msgs::Header;
use whorl_msgs::whorl::{AttitudeEstimate, ThrusterState};
use whorl_msgs::{Message, PlatformId, Route, Topic, geometry_msgs};
use whorl_node::Timestamp;

use crate::read::{CLOSED_LOOP_NOTE, MOUNTING_NOTE, START_NOTE};
use crate::{KnownPlatform, Mounting, Recording, RecordingError, Series};

/// 0 degrees Celsius [K]: `sensor_msgs/Temperature` is in Celsius.
const CELSIUS_ZERO_K: f64 = 273.15;

/// How a recording came about, for the manifest.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RunOrigin {
    /// Name of the experiment.
    pub experiment: String,
    /// Version of the program that writes.
    pub version: String,
    /// When it was recorded, or is written \[UTC\].
    pub start_utc: Timestamp,
    /// Further facts, such as the file that it was imported from.
    pub notes: Vec<(String, String)>,
}

/// Where a message goes.
enum Place {
    Standard(Topic),
    /// A topic that only recordings have.
    Extra(String),
}

/// Writes a recording as a run directory: bag, the platform's parameters, manifest. [`crate::read_run`] gives it
/// back; everything that reads runs can read it.
///
/// # Errors
/// When the directory holds a run already, or cannot be written.
pub fn write_run(
    recording: &Recording,
    known: &KnownPlatform,
    origin: &RunOrigin,
    out: &Path,
) -> Result<PathBuf, RecordingError> {
    let mut notes = origin.notes.clone();
    let mounting = match recording.mounting {
        Mounting::OnBearing => "on_bearing",
        Mounting::Clamped => "clamped",
    };
    notes.push((MOUNTING_NOTE.to_owned(), mounting.to_owned()));
    notes.push((CLOSED_LOOP_NOTE.to_owned(), recording.closed_loop.to_string()));
    notes.push((START_NOTE.to_owned(), "0".to_owned()));
    let description = RunDescription {
        experiment: origin.experiment.clone(),
        version: origin.version.clone(),
        simulated_time: true,
        platforms: vec![recording.platform.clone()],
        notes,
        ..RunDescription::default()
    };
    let mut writer = RunWriter::create_in(out, description, origin.start_utc, BagOptions::default())?;
    for file in &known.files {
        writer.add_parameter_file(file)?;
    }
    let wheels: Vec<String> = known.model.wheels().iter().map(|wheel| wheel.name.clone()).collect();
    let mut messages = messages(recording, &wheels);
    messages.sort_by_key(|(at, ..)| *at);
    let mut encoded = Vec::new();
    for (at, place, message) in messages {
        let log_time = Timestamp(at);
        match place {
            Place::Standard(topic) => {
                writer.write_message(Route::platform(PlatformId(0), topic), log_time, &message)?;
            }
            Place::Extra(name) => {
                let name = format!("/{}/{name}", recording.platform);
                let handle = writer.add_topic(&name, message.message_type().name(), "", None)?;
                message
                    .encode_into(&mut encoded)
                    .map_err(|source| whorl_bag::BagError::Encode { topic: name, source })?;
                let sample = RawSample { log_time, publish_time: log_time, origin: None, cdr: &encoded };
                writer.write_raw(handle, sample)?;
            }
        }
    }
    let path = writer.path().to_owned();
    writer.finish(origin.start_utc)?;
    Ok(path)
}

fn messages(recording: &Recording, wheels: &[String]) -> Vec<(i64, Place, Message)> {
    let mut out = Vec::new();
    let frame = format!("{}/base_link", recording.platform);
    let header = |at: i64| Header { stamp: Timestamp(at).into(), frame_id: frame.clone() };
    imu(recording, &header, &mut out);
    let vectors = |place: &dyn Fn() -> Place, series: &Series<Vector3<f64>>, out: &mut Vec<_>| {
        for (at, v) in samples(series) {
            out.push((at, place(), Vector3Stamped { header: header(at), vector: (*v).into() }.into()));
        }
    };
    for (index, channel) in recording.vectors.iter().enumerate() {
        let place = || match index {
            0 => Place::Standard(Topic::VectorDirection),
            _ => Place::Extra(extra::vector_direction(index)),
        };
        let first = samples(&channel.direction_b).next().map_or(0, |(at, _)| at);
        let world = Header { stamp: Timestamp(first).into(), frame_id: "world".to_owned() };
        let vector = channel.reference_world.into_inner().into();
        let reference = Place::Extra(extra::vector_reference(index));
        out.push((first, reference, Vector3Stamped { header: world, vector }.into()));
        vectors(&place, &channel.direction_b, &mut out);
    }
    let name = wheels.to_vec();
    for (at, speeds) in samples(&recording.wheel_speed_rad_s) {
        let state = JointState {
            header: header(at),
            name: name.clone(),
            velocity: speeds.clone(),
            ..JointState::default()
        };
        out.push((at, Place::Standard(Topic::WheelState), state.into()));
    }
    for (at, torques) in samples(&recording.wheel_torque_command_n_m) {
        let command = JointState {
            header: header(at),
            name: name.clone(),
            effort: torques.clone(),
            ..JointState::default()
        };
        out.push((at, Place::Extra(extra::WHEEL_COMMAND.to_owned()), command.into()));
    }
    valves(recording, &header, &mut out);
    vectors(&|| Place::Extra(extra::BODY_TORQUE.to_owned()), &recording.body_torque_b_n_m, &mut out);
    vectors(&|| Place::Standard(Topic::BallastMoment), &recording.ballast_moment_b_n_m, &mut out);
    for (at, voltage) in samples(&recording.bus_voltage_v) {
        let unknown = f32::NAN;
        let message = BatteryState {
            header: header(at),
            voltage: *voltage as f32,
            temperature: unknown,
            current: unknown,
            charge: unknown,
            capacity: unknown,
            design_capacity: unknown,
            percentage: unknown,
            present: true,
            ..BatteryState::default()
        };
        out.push((at, Place::Standard(Topic::Battery), message.into()));
    }
    for (at, pressure) in samples(&recording.tank_pressure_pa) {
        let message = FluidPressure { header: header(at), fluid_pressure: *pressure, variance: 0.0 };
        out.push((at, Place::Standard(Topic::TankPressure), message.into()));
    }
    for (at, kelvin) in samples(&recording.temperature_k) {
        let temperature = kelvin - CELSIUS_ZERO_K;
        let message = Temperature { header: header(at), temperature, variance: 0.0 };
        out.push((at, Place::Standard(Topic::Temperature), message.into()));
    }
    truth(recording, &mut out);
    out
}

fn ns(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}

fn samples<T>(series: &Series<T>) -> impl Iterator<Item = (i64, &T)> {
    series.time_s.iter().map(|t| ns(*t)).zip(&series.value)
}

const UNKNOWN: geometry_msgs::Vector3 = geometry_msgs::Vector3 { x: f64::NAN, y: f64::NAN, z: f64::NAN };

/// Values of two series at all times of either, in order.
fn merged<'a, A, B>(a: &'a Series<A>, b: &'a Series<B>) -> Vec<(i64, Option<&'a A>, Option<&'a B>)> {
    let (mut a, mut b) = (samples(a).peekable(), samples(b).peekable());
    let mut out = Vec::new();
    loop {
        let at = match (a.peek(), b.peek()) {
            (Some((a, _)), Some((b, _))) => *a.min(b),
            (Some((at, _)), None) | (None, Some((at, _))) => *at,
            (None, None) => return out,
        };
        let first = a.next_if(|(time, _)| *time == at).map(|(_, value)| value);
        let second = b.next_if(|(time, _)| *time == at).map(|(_, value)| value);
        out.push((at, first, second));
    }
}

fn imu(recording: &Recording, header: &impl Fn(i64) -> Header, out: &mut Vec<(i64, Place, Message)>) {
    for (at, rate, force) in merged(&recording.gyro_b_rad_s, &recording.specific_force_b_m_s2) {
        // A first covariance of -1 says that there is no such measurement (sensor_msgs/Imu).
        let mut none = [0.0; 9];
        none[0] = -1.0;
        let covariance = |given: bool| if given { [0.0; 9] } else { none };
        let message = Imu {
            header: header(at),
            orientation_covariance: none,
            angular_velocity: rate.map_or(UNKNOWN, |v| (*v).into()),
            angular_velocity_covariance: covariance(rate.is_some()),
            linear_acceleration: force.map_or(UNKNOWN, |v| (*v).into()),
            linear_acceleration_covariance: covariance(force.is_some()),
            ..Imu::default()
        };
        out.push((at, Place::Standard(Topic::ImuRaw), message.into()));
    }
}

fn truth(recording: &Recording, out: &mut Vec<(i64, Place, Message)>) {
    let Some(truth) = &recording.truth else { return };
    let no_attitude = Quaternion { x: f64::NAN, y: f64::NAN, z: f64::NAN, w: f64::NAN };
    for (sequence, (at, q, rate)) in (0..).zip(merged(&truth.q_world_body, &truth.omega_wb_b_rad_s)) {
        let message = AttitudeEstimate {
            header: Header { stamp: Timestamp(at).into(), frame_id: "world".to_owned() },
            sequence,
            q_world_body: q.map_or(no_attitude, |q| (*q).into()),
            omega_wb_b_rad_s: rate.map_or(UNKNOWN, |v| (*v).into()),
            gyro_bias_b_rad_s: UNKNOWN,
            nis: f64::NAN,
            health: AttitudeEstimate::HEALTH_OK,
            ..AttitudeEstimate::default()
        };
        out.push((at, Place::Standard(Topic::TruthState), message.into()));
    }
}

/// A message at the start and at each edge of a valve: from these the reader has every pulse to the nanosecond.
fn valves(recording: &Recording, header: &impl Fn(i64) -> Header, out: &mut Vec<(i64, Place, Message)>) {
    let jets = recording.jet_pulses.len();
    if jets == 0 {
        return;
    }
    // (time, jet, whether it opens): it shuts before it opens again.
    let mut edges: Vec<(i64, usize, bool)> = Vec::new();
    for (jet, pulses) in recording.jet_pulses.iter().enumerate() {
        for pulse in pulses {
            let (on, off) = (ns(pulse.on_s), ns(pulse.off_s));
            edges.push((on, jet, true));
            edges.push((off, jet, false));
        }
    }
    edges.sort_unstable();
    let first = edges.first().map_or(i64::MAX, |edge| edge.0);
    let start = recording.first_time_s().map_or(first, |t| ns(t).min(first));
    let mut times: Vec<i64> = std::iter::once(start).chain(edges.iter().map(|edge| edge.0)).collect();
    times.dedup();
    let (mut open, mut total_ns) = (vec![false; jets], vec![0i64; jets]);
    let mut next = edges.into_iter().peekable();
    let mut before_ns = start;
    for (sequence, at) in (0..).zip(times) {
        let before = total_ns.clone();
        for (total, _) in total_ns.iter_mut().zip(&open).filter(|(_, open)| **open) {
            *total += at - before_ns;
        }
        before_ns = at;
        while let Some((_, jet, opens)) = next.next_if(|edge| edge.0 == at) {
            if let Some(open) = open.get_mut(jet) {
                *open = opens;
            }
        }
        let on_ns = total_ns.iter().zip(&before).map(|(now, before)| now - before);
        let message = ThrusterState {
            header: header(at),
            sequence,
            valve_open: open.clone(),
            on_time_s: on_ns.map(|ns| ns as f64 * 1e-9).collect(),
            total_on_time_s: total_ns.iter().map(|ns| *ns as f64 * 1e-9).collect(),
            health: vec![ThrusterState::HEALTH_OK; jets],
        };
        out.push((at, Place::Standard(Topic::ThrusterState), message.into()));
    }
}
