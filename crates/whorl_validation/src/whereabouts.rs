//! Where a model fails, in words.

use nalgebra::Vector3;
use serde::Serialize;
use whorl_dynamics::PlatformModel;
use whorl_recording::Recording;

use crate::dependence::{Dependence, Dependences, Frame, Growth, Parity, Variable, conditions, dependences};
use crate::error::ValidationError;
use whorl_trajectory::{ResidualTorque, residual_torque};

/// Excess over the noise below which there is nothing to locate.
const LEAST_EXCESS: f64 = 0.05;
/// Quantities named in words.
const NAMED: usize = 3;
/// Share of the excess below which a quantity is not named.
const WORTH_NAMING: f64 = 0.15;
/// Time is named only if it explains this much more than every other quantity, because any slow torque is a smooth
/// function of time.
const TIME_MARGIN: f64 = 0.25;
/// A constant torque is preferred as simpler if its share is within this margin of the best curve's.
const CONSTANT_MARGIN: f64 = 0.07;

/// Where a model fails in one run, or in several together.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Whereabouts {
    /// Names of the runs.
    pub run: String,
    /// RMS residual torque about each body axis [N m].
    pub rms_b_n_m: [f64; 3],
    /// Typical standard deviation of the residual torque about each body axis [N m].
    pub stddev_b_n_m: [f64; 3],
    /// Its dependence on recorded quantities.
    pub dependences: Dependences,
    /// The residual itself, run by run, for plots.
    #[serde(skip)]
    pub residuals: Vec<ResidualTorque>,
}

/// Finds in which regime `model` fails, over all of these runs.
///
/// # Errors
/// As [`residual_torque`]; also for runs too short to see anything.
pub fn explain_where(
    recordings: &[&Recording],
    model: &PlatformModel,
) -> Result<Whereabouts, ValidationError> {
    let names: Vec<&str> = recordings.iter().map(|r| r.name.as_str()).collect();
    let run = names.join(", ");
    let wheels: Vec<String> = model.wheels().iter().map(|w| w.name.clone()).collect();
    let mut residuals = Vec::new();
    let mut variables: Vec<Vec<Variable>> = Vec::new();
    for recording in recordings {
        let residual = residual_torque(recording, model)?;
        let (times, attitudes, rates) =
            (&residual.time_s, &residual.q_world_body, &residual.omega_wb_b_rad_s);
        variables.push(conditions(recording, times, attitudes, rates, &wheels));
        residuals.push(residual);
    }
    let found = dependences(&residuals, &variables)
        .map_err(|error| ValidationError::Dependence { run: run.clone(), error })?;
    let rms = |of: fn(&ResidualTorque) -> &[Vector3<f64>]| {
        let all = || residuals.iter().flat_map(of);
        let sum: Vector3<f64> = all().map(|v| v.component_mul(v)).sum();
        (sum / all().count().max(1) as f64).map(f64::sqrt).into()
    };
    Ok(Whereabouts {
        rms_b_n_m: rms(|r| &r.torque_b_n_m),
        stddev_b_n_m: rms(|r| &r.stddev_b_n_m),
        run,
        dependences: found,
        residuals,
    })
}

impl Whereabouts {
    /// Whether there is anything to locate; otherwise the shares would describe noise.
    #[must_use]
    pub fn is_anything_left(&self) -> bool {
        self.dependences.excess >= LEAST_EXCESS
    }

    /// The answer in words: a summary, then one sentence for each named quantity.
    #[must_use]
    pub fn answer(&self) -> Vec<String> {
        let found = &self.dependences;
        let rms = self.rms_b_n_m.iter().map(|x| x * x).sum::<f64>().sqrt() * 1e3;
        let stddev = self.stddev_b_n_m.iter().map(|x| x * x).sum::<f64>().sqrt() * 1e3;
        if !self.is_anything_left() {
            return vec![format!(
                "{}: the residual torque ({rms:.2} mN m RMS) is consistent with noise ({stddev:.2} mN m): there is nothing to locate.",
                self.run
            )];
        }
        let mut answer = vec![format!(
            "{}: the model leaves a torque of {rms:.2} mN m RMS unexplained (noise {stddev:.2} mN m).",
            self.run
        )];
        let best = found.ranked.first().map_or(0.0, |d| d.share);
        let (constant, frame, mean) = if found.constant_world_share > found.constant_body_share {
            (found.constant_world_share, "fixed to the room (east, north, up)", found.mean_world_n_m)
        } else {
            (found.constant_body_share, "fixed to the platform (x, y, z)", found.mean_b_n_m)
        };
        if constant > WORTH_NAMING && constant + CONSTANT_MARGIN >= best {
            let [x, y, z] = mean.map(|m| m * 1e3);
            answer.push(format!(
                "{:.0} % of the excess is a constant torque {frame}: {x:.2}, {y:.2}, {z:.2} mN m.",
                constant * 100.0
            ));
        }
        let other = found.ranked.iter().filter(|d| d.variable != "time").map(|d| d.share).fold(0.0, f64::max);
        let is_named = |d: &&Dependence| {
            d.share > WORTH_NAMING && (d.variable != "time" || d.share > other + TIME_MARGIN)
        };
        answer.extend(found.ranked.iter().filter(is_named).take(NAMED).map(sentence));
        if let Some(line) = found.line {
            answer.push(format!(
                "An oscillation of {:.2} mN m at {:.3} Hz about {} holds {:.0} % of that axis' power.",
                line.amplitude_n_m * 1e3,
                line.frequency_hz,
                axis_name(line.frame, line.axis),
                line.share * 100.0
            ));
        }
        if answer.len() == 1 {
            answer.push("No recorded quantity explains more than 15 % of the excess: it depends on something that was not measured.".to_owned());
        }
        answer
    }
}

fn axis_name(frame: Frame, axis: usize) -> &'static str {
    match (frame, axis) {
        (Frame::Body, 0) => "body x",
        (Frame::Body, 1) => "body y",
        (Frame::Body, _) => "body z",
        (Frame::World, 0) => "east",
        (Frame::World, 1) => "north",
        (Frame::World, _) => "the vertical",
    }
}

/// "71 % of the excess is a function of yaw rate (about body z; odd; saturates)".
fn sentence(d: &Dependence) -> String {
    let mut notes = vec![format!("mostly about {}", axis_name(d.frame, d.axis))];
    match d.parity {
        Parity::Odd => notes.push("odd".to_owned()),
        Parity::Even => notes.push("even".to_owned()),
        Parity::None => {}
    }
    match d.growth {
        Growth::Saturates if d.parity == Parity::Odd => notes.push("saturates".to_owned()),
        Growth::Linear => notes.push("in proportion".to_owned()),
        Growth::Superlinear => notes.push("grows faster than in proportion".to_owned()),
        _ => {}
    }
    format!(
        "{:.0} % of the excess is a function of {} ({}).",
        d.share * 100.0,
        d.variable.replace('_', " "),
        notes.join("; ")
    )
}
