//! Excitations that the coordinator may request by name: the group `excitations`.

use whorl_allocation::Mode;
use whorl_control::excitation::{PulseTrain, Signal, Waveform};
use whorl_dynamics::PlatformModel;
use whorl_params::{Reader, any, positive, range};

/// What control holds while an excitation is played.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hold {
    /// The reference: the excitation is added.
    Attitude,
    /// The tilt at its start; yaw is free.
    Tilt,
    /// Nothing: all actuators follow the excitation.
    Nothing,
}

/// Wheel torques and jet pulses that are played open loop.
#[derive(Debug, Clone, PartialEq)]
pub struct Excitation {
    /// Its name.
    pub name: String,
    /// What control holds.
    pub hold: Hold,
    /// Wheels of the signal, as indices of the model's.
    pub wheels: Vec<usize>,
    /// Their torques; `None`: no torque.
    pub signal: Option<Signal>,
    /// Jet pulses; `None`: all valves closed.
    pub pulses: Option<PulseTrain>,
}

/// Reads all of them.
pub(super) fn read(
    r: &mut Reader<'_>,
    model: Option<&PlatformModel>,
    actuators: Mode,
    slot_length_s: f64,
) -> Vec<Excitation> {
    let names = r.children("excitations");
    let Some(model) = model else {
        r.claim_group("excitations");
        return Vec::new();
    };
    let one = |name: String| {
        r.group(&format!("excitations.{name}"), |r| read_one(r, name, model, actuators, slot_length_s))
    };
    names.into_iter().map(one).collect()
}

fn read_one(
    r: &mut Reader<'_>,
    name: String,
    model: &PlatformModel,
    actuators: Mode,
    slot_length_s: f64,
) -> Excitation {
    let hold = match r.choice_or(
        "hold",
        "nothing",
        &["attitude", "tilt", "nothing"],
        "what control still holds with the wheels; tilt: yaw is free",
    ) {
        "attitude" => Hold::Attitude,
        "tilt" => Hold::Tilt,
        _ => Hold::Nothing,
    };
    if hold != Hold::Nothing && actuators == Mode::Jets {
        r.reject("hold", "allowed with actuators: jets: nothing; it is the wheels that hold");
    }
    let wheels =
        read_names(r, "wheels", model.wheels().iter().map(|w| w.name.as_str()), "wheels that get a torque");
    let signal = if wheels.is_empty() { None } else { read_signal(r, &wheels, model) };
    let jets = read_names(
        r,
        "jets",
        model.jets().iter().map(|j| j.name.as_str()),
        "jets that fire, one after the other",
    );
    let pulses = (!jets.is_empty()).then(|| read_pulses(r, jets, model, slot_length_s));
    Excitation { name, hold, wheels, signal, pulses }
}

/// Indices of the named parts.
fn read_names<'m>(
    r: &mut Reader<'_>,
    key: &str,
    known: impl Iterator<Item = &'m str>,
    doc: &str,
) -> Vec<usize> {
    let known: Vec<&str> = known.collect();
    let named = r.string_array_or(key, &[], doc);
    let mut indices = Vec::with_capacity(named.len());
    for name in &named {
        match known.iter().position(|k| k == name) {
            Some(index) if !indices.contains(&index) => indices.push(index),
            Some(_) => r.reject(key, format!("`{name}` is there twice")),
            None => r.reject(key, format!("there is no `{name}`; allowed: {}", known.join(", "))),
        }
    }
    indices
}

fn read_signal(r: &mut Reader<'_>, wheels: &[usize], model: &PlatformModel) -> Option<Signal> {
    let waveform = match r.choice(
        "signal",
        &["constant", "multisine", "prbs", "sweep"],
        "signal of the torque: constant, a sum of sines, a binary sequence, or a sine of rising frequency, wheel after wheel",
    ) {
        "constant" => Waveform::Constant,
        "prbs" => Waveform::Prbs,
        "sweep" => Waveform::Sweep,
        _ => Waveform::Multisine,
    };
    let torque_n_m = r.f64("torque_n_m", any(), "largest motor torque; below zero only a constant one [N m]");
    let period_s =
        r.f64_or("period_s", 30.0, positive(), "period of a multisine, or length of one wheel's sweep [s]");
    let highest_hz = r.f64_or(
        "highest_hz",
        0.5,
        range(0.001..=10.0),
        "highest frequency; a bit of a binary sequence lasts half its period [Hz]",
    );
    let weakest = wheels
        .iter()
        .filter_map(|w| model.wheels().get(*w))
        .map(|w| w.max_torque_n_m)
        .fold(f64::INFINITY, f64::min);
    if torque_n_m.abs() > weakest {
        r.reject("torque_n_m", format!("allowed: up to the wheels' {weakest} N m"));
    }
    Signal::new(waveform, wheels.len(), torque_n_m, period_s, highest_hz)
        .map_err(|error| r.reject("signal", error.to_string()))
        .ok()
}

fn read_pulses(
    r: &mut Reader<'_>,
    jets: Vec<usize>,
    model: &PlatformModel,
    slot_length_s: f64,
) -> PulseTrain {
    let on_time_s = r.f64_array("on_time_s", positive(), "lengths of the pulses, one after the other [s]");
    let every_s = r.f64("every_s", range(0.1..=100.0), "from pulse to pulse [s]");
    let least_s =
        jets.iter().filter_map(|j| model.jets().get(*j)).map(|j| j.min_on_time_s).fold(0.0, f64::max);
    if on_time_s.is_empty() || on_time_s.iter().any(|on| !(least_s..=slot_length_s).contains(on)) {
        r.reject(
            "on_time_s",
            format!("allowed: one or more from {least_s} to {slot_length_s} s, a jet slot"),
        );
    }
    PulseTrain { jets, on_time_s, every_s }
}
