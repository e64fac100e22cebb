//! Channels of one platform as a recording.

use std::path::Path;

use nalgebra::{Unit, Vector3};
use whorl_bag::{Channel, RunDirectory};
use whorl_dynamics::PlatformModel;
use whorl_node::Timestamp;

use super::commands::{self, Commands, Limits, PulseNs};
use super::gather::{Gathered, in_order};
use super::{valves, wheel_torque};
use crate::columns::Columns;
use crate::notes::{CLOSED_LOOP_NOTE, MOUNTING_NOTE, noted_in};
use crate::recording::{Mounting, OnInterval, Recording, VectorChannel, missing_axes};
use crate::series::seconds;

pub(super) fn recording(
    path: &Path,
    run: &RunDirectory,
    platform: &str,
    mut gathered: Gathered,
    start: Timestamp,
    model: Option<&PlatformModel>,
    mut remarks: Vec<String>,
) -> Recording {
    remarks.extend(gathered.believe_marked());
    let [no_gyro_axis, no_force_axis] = [Channel::Gyro, Channel::Accelerometer].map(|channel| {
        let Some(samples) = gathered.samples.get_mut(&(channel, 0)) else { return [false; 3] };
        let before = samples.len();
        let missing = missing_axes(samples.lines().map(|(_, v)| v));
        let missing = samples.take_out_missing_axes(missing);
        let taken_out = before - samples.len();
        if taken_out > 0 {
            *gathered.not_finite.entry(channel).or_default() += taken_out;
        }
        missing
    });
    for (channel, count) in &gathered.not_finite {
        remarks.push(format!(
            "{count} messages of the channel {channel} hold no finite numbers and were left out."
        ));
    }
    let undecodable: usize = gathered.undecodable.values().sum();
    if undecodable > 0 {
        remarks.push(format!("{undecodable} messages could not be decoded and were left out."));
    }
    if gathered.of_other_frames > 0 {
        let count = gathered.of_other_frames;
        remarks.push(format!("{count} messages of other frames than the map's were left out."));
    }
    for (topic, clock) in &gathered.topic_clocks {
        remarks.extend(clock.notes(topic, start.0));
    }
    for ((channel, _), samples) in &mut gathered.samples {
        let info = channel.info();
        let (doubles, spread) = if info.is_motion && !info.is_held {
            samples.in_order_or_spread()
        } else {
            (samples.in_order(), 0)
        };
        if spread > 0 {
            remarks.push(format!(
                "Samples of the {channel} came in bursts of one stamp: {spread} of them were spread evenly over the time since the stamp \
                 before, in the order that they came."
            ));
        }
        if doubles > 0 && *channel == Channel::Gyro {
            remarks
                .push(format!("{doubles} messages of the gyro have the stamp of another and were left out."));
        }
    }
    for ((channel, _), samples) in &mut gathered.samples {
        let info = channel.info();
        if info.is_motion
            && !info.is_held
            && let Some((held, left_out)) = samples.leave_out_held()
        {
            remarks.push(whorl_bag::held::said(&format!("the {channel}"), held, left_out));
        }
    }
    gathered.wheel_effort.in_order();
    in_order(&mut gathered.thrusters);
    gathered.commands.sort();

    sort_wheels(&mut gathered, model, &mut remarks);
    let limits = model.map_or_else(Limits::default, |model| Limits {
        wheel_torque_n_m: model.wheels().iter().map(|wheel| wheel.max_torque_n_m).collect(),
        min_on_time_s: model.jets().iter().map(|jet| jet.min_on_time_s).collect(),
    });
    let applied = commands::apply(&gathered.commands, &limits);
    if applied.refused > 0 {
        remarks.push(format!(
            "{} of {} actuator commands are none that a driver carries out and were left out.",
            applied.refused,
            gathered.commands.len()
        ));
    }
    let pulses = if gathered.thrusters.is_empty() {
        applied.pulses
    } else {
        valves::pulses(&gathered.thrusters, &applied.pulses)
    };
    let commanded = gathered.samples.entry((Channel::WheelTorqueCommand, 0)).or_default();
    if commanded.is_empty() {
        *commanded = wheel_torque::in_force(applied.wheel_torque_n_m, &gathered.wheel_effort);
        // Commands of a platform without wheels.
        if commanded.line(0).is_some_and(|(_, torques)| torques.is_empty()) {
            *commanded = Columns::default();
        }
    }
    // What is not needed any more makes room for the series.
    let was_commanded = !gathered.commands.is_empty();
    gathered.commands = Commands::default();
    gathered.thrusters = Vec::new();
    gathered.wheel_effort = Columns::default();
    let vectors = vectors(&mut gathered, start, model, &mut remarks);
    let mut recording = Recording {
        name: path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned(),
        platform: platform.to_owned(),
        no_gyro_axis,
        no_force_axis,
        mounting: match noted_in(run, MOUNTING_NOTE) {
            Some("clamped") => Mounting::Clamped,
            _ if model.is_some_and(|model| !model.freedom.turns()) => Mounting::Clamped,
            _ => Mounting::OnBearing,
        },
        vectors,
        jet_pulses: pulses.iter().map(|pulses| intervals(pulses, start)).collect(),
        closed_loop: match noted_in(run, CLOSED_LOOP_NOTE) {
            Some(text) => text == "true",
            None => gathered.controlled.unwrap_or(was_commanded),
        },
        remarks,
        ..Recording::default()
    };
    let samples = gathered.samples.into_iter().filter(|(_, samples)| !samples.is_empty());
    for ((channel, sensor), samples) in samples {
        if let Some(series) = recording.series_mut(channel, sensor) {
            let at_s = |at: i64| seconds(at - start.0);
            series.fill(&mut samples.lines().map(|(at, numbers)| (at_s(at), numbers.to_vec())));
        }
    }
    let suspicions = recording.suspicions(model);
    recording.remarks.extend(suspicions);
    recording
}

fn intervals(pulses: &[PulseNs], start: Timestamp) -> Vec<OnInterval> {
    let at_s = |at: i64| seconds(at - start.0);
    pulses.iter().map(|p| OnInterval { on_s: at_s(p.on_ns), off_s: at_s(p.off_ns) }).collect()
}

/// Brings the wheels into the model's order, by their names where both have them.
fn sort_wheels(gathered: &mut Gathered, model: Option<&PlatformModel>, remarks: &mut Vec<String>) {
    let Some(model) = model else { return };
    let mut moved = false;
    for (channel, names) in &gathered.wheel_names {
        let Some(order) = order_of(names, model) else { continue };
        moved = true;
        if let Some(samples) = gathered.samples.get_mut(&(*channel, 0)) {
            samples.pick(&order);
        }
        if *channel == Channel::WheelSpeed {
            gathered.wheel_effort.pick(&order);
        }
    }
    if moved {
        remarks
            .push("The wheels were brought into the order of the platform's parameters, by name.".to_owned());
    }
}

/// Where the model's wheels stand among these names; `None` where they stand in its order, or are not known.
fn order_of(names: &[String], model: &PlatformModel) -> Option<Vec<usize>> {
    let place = |name: &String| names.iter().position(|known| known == name);
    let order = model.wheels().iter().map(|wheel| place(&wheel.name)).collect::<Option<Vec<usize>>>()?;
    let unchanged = order.len() == names.len() && order.iter().enumerate().all(|(i, j)| i == *j);
    (!unchanged && !order.is_empty()).then_some(order)
}

/// The vector sensors whose direction in the world is known, by the recording or by the model.
fn vectors(
    gathered: &mut Gathered,
    start: Timestamp,
    model: Option<&PlatformModel>,
    remarks: &mut Vec<String>,
) -> Vec<VectorChannel> {
    let mut channels = Vec::new();
    for index in 0..Channel::Vector.most_sensors() {
        let samples = gathered.samples.remove(&(Channel::Vector, index)).unwrap_or_default();
        if samples.is_empty() {
            continue;
        }
        let recorded = gathered.references.get(index).copied().flatten();
        let recorded = recorded.and_then(|direction| Unit::try_new(direction, 1e-9));
        // The platform's parameters describe one vector sensor.
        let parameter = || model.filter(|_| index == 0)?.sensors.vector.map(|v| v.reference_direction_world);
        let Some(reference_world) = recorded.or_else(parameter) else {
            remarks.push(format!(
                "Vector sensor {} is left out: what it sees in the world is not known. Give the platform's \
                 parameters (sensors.vector.reference_direction).",
                index + 1
            ));
            continue;
        };
        // One of length one stays as it is, to the bit: what was exported comes back.
        let direction = |v: Vector3<f64>| {
            if (v.norm() - 1.0).abs() < 1e-12 { Some(v) } else { v.try_normalize(1e-9) }
        };
        let samples = samples.lines().filter_map(|(at, numbers)| {
            let direction_b = direction(<[f64; 3]>::try_from(numbers).ok()?.into())?;
            Some((seconds(at - start.0), direction_b))
        });
        channels.push(VectorChannel { reference_world, direction_b: samples.collect() });
    }
    channels
}
