//! Channels of one platform as a recording.

use std::path::Path;

use nalgebra::{Unit, Vector3};
use whorl_bag::RunDirectory;
use whorl_dynamics::PlatformModel;
use whorl_node::Timestamp;

use super::commands::{self, Limits, PulseNs};
use super::gather::{Gathered, Samples, in_order, series};
use super::{CLOSED_LOOP_NOTE, MOUNTING_NOTE, note, valves, wheel_torque};
use crate::{Mounting, OnInterval, Recording, TrueMotion, VectorChannel};

pub(super) fn recording(
    path: &Path,
    run: &RunDirectory,
    platform: &str,
    mut gathered: Gathered,
    start: Timestamp,
    model: Option<&PlatformModel>,
    mut remarks: Vec<String>,
) -> Recording {
    for (role, count) in &gathered.not_finite {
        remarks.push(format!("{count} messages of {role:?} hold no finite numbers and were left out."));
    }
    if gathered.undecodable > 0 {
        remarks.push(format!("{} messages could not be decoded and were left out.", gathered.undecodable));
    }
    let doubles = in_order(&mut gathered.gyro);
    if doubles > 0 {
        remarks.push(format!("{doubles} messages of the gyro have the stamp of another and were left out."));
    }
    in_order(&mut gathered.force);
    in_order(&mut gathered.wheel_speed);
    in_order(&mut gathered.wheel_effort);
    in_order(&mut gathered.wheel_command);
    in_order(&mut gathered.thrusters);
    in_order(&mut gathered.bus_voltage_v);
    in_order(&mut gathered.tank_pressure_pa);
    in_order(&mut gathered.temperature_k);
    in_order(&mut gathered.body_torque);
    in_order(&mut gathered.ballast);
    in_order(&mut gathered.true_attitude);
    in_order(&mut gathered.true_rate);
    gathered.commands.sort_by_key(|sent| sent.at_ns);

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
    let torque = if gathered.wheel_command.is_empty() {
        wheel_torque::in_force(&applied.wheel_torque_n_m, &gathered.wheel_effort)
    } else {
        std::mem::take(&mut gathered.wheel_command)
    };
    let vectors = vectors(&mut gathered, start, model, &mut remarks);
    let truth = (!gathered.true_attitude.is_empty() || !gathered.true_rate.is_empty()).then(|| TrueMotion {
        q_world_body: series(gathered.true_attitude, start),
        omega_wb_b_rad_s: series(gathered.true_rate, start),
    });
    let mut recording = Recording {
        name: path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned(),
        platform: platform.to_owned(),
        mounting: match note(run, MOUNTING_NOTE) {
            Some("clamped") => Mounting::Clamped,
            _ => Mounting::OnBearing,
        },
        gyro_b_rad_s: series(gathered.gyro, start),
        specific_force_b_m_s2: series(gathered.force, start),
        vectors,
        wheel_speed_rad_s: series(gathered.wheel_speed, start),
        wheel_torque_command_n_m: series(torque, start),
        jet_pulses: pulses.iter().map(|pulses| intervals(pulses, start)).collect(),
        body_torque_b_n_m: series(gathered.body_torque, start),
        bus_voltage_v: series(gathered.bus_voltage_v, start),
        tank_pressure_pa: series(gathered.tank_pressure_pa, start),
        temperature_k: series(gathered.temperature_k, start),
        ballast_moment_b_n_m: series(gathered.ballast, start),
        closed_loop: match note(run, CLOSED_LOOP_NOTE) {
            Some(text) => text == "true",
            None => gathered.controlled.unwrap_or(!gathered.commands.is_empty()),
        },
        truth,
        remarks,
    };
    let suspicions = recording.suspicions(model);
    recording.remarks.extend(suspicions);
    recording
}

fn intervals(pulses: &[PulseNs], start: Timestamp) -> Vec<OnInterval> {
    let seconds = |at: i64| crate::series::seconds(at - start.0);
    pulses.iter().map(|p| OnInterval { on_s: seconds(p.on_ns), off_s: seconds(p.off_ns) }).collect()
}

/// Brings the wheels into the model's order, by their names where both have them.
fn sort_wheels(gathered: &mut Gathered, model: Option<&PlatformModel>, remarks: &mut Vec<String>) {
    let Some(model) = model else { return };
    let names = &gathered.wheel_names;
    let place = |name: &String| names.iter().position(|known| known == name);
    let Some(order) = model.wheels().iter().map(|wheel| place(&wheel.name)).collect::<Option<Vec<usize>>>()
    else {
        return;
    };
    let unchanged = order.len() == names.len() && order.iter().enumerate().all(|(i, j)| i == *j);
    if unchanged || order.is_empty() {
        return;
    }
    let pick = |samples: &mut Samples<Vec<f64>>| {
        for (_, values) in samples.iter_mut() {
            *values = order.iter().filter_map(|j| values.get(*j).copied()).collect();
        }
        samples.retain(|(_, values)| values.len() == order.len());
    };
    pick(&mut gathered.wheel_speed);
    pick(&mut gathered.wheel_effort);
    remarks.push("The wheels were brought into the order of the platform's parameters, by name.".to_owned());
}

fn vectors(
    gathered: &mut Gathered,
    start: Timestamp,
    model: Option<&PlatformModel>,
    remarks: &mut Vec<String>,
) -> Vec<VectorChannel> {
    let mut channels = Vec::new();
    for (index, mut samples) in std::mem::take(&mut gathered.vectors).into_iter().enumerate() {
        if samples.is_empty() {
            continue;
        }
        in_order(&mut samples);
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
        let samples = samples.into_iter().filter_map(|(at, v)| Some((at, direction(v)?))).collect();
        channels.push(VectorChannel { reference_world, direction_b: series(samples, start) });
    }
    channels
}
