//! Where a model fails, in words.

use nalgebra::Vector3;
use serde::Serialize;
use whorl_dynamics::PlatformModel;
use whorl_math::three_digits;
use whorl_prediction::SmoothedState;
use whorl_recording::Recording;

use crate::dependence::{
    Dependence, Dependences, Frame, Growth, Parity, Residual, Variable, conditions, dependences,
};
use crate::error::ValidationError;
use crate::unexplained::UnexplainedTorques;

/// Excess over the noise below which there is nothing to locate.
const LEAST_EXCESS: f64 = 0.05;
/// Quantities named in words.
const NAMED: usize = 3;
/// Share of the excess below which a quantity is not named.
const WORTH_NAMING: f64 = 0.15;
/// Time is named only if it explains this much more than every other quantity, because any slow torque is a smooth
/// function of time.
const TIME_MARGIN: f64 = 0.25;
/// A constant torque has a name if it is so much of what the best curve explains; a quantity beside it is named for what it adds.
const CONSTANT_OF_BEST: f64 = 0.75;
/// Shares of a constant torque in two frames that differ by less do not tell the frames apart.
const CONSTANT_MARGIN: f64 = 0.07;

/// Share of a torque's size beyond which it is about one axis.
const ABOUT_ONE: f64 = 0.95;

/// Where a model fails in one run, or in several together.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Localisation {
    /// Names of the runs.
    pub run: String,
    /// RMS unexplained torque about each body axis [N m].
    pub rms_b_n_m: [f64; 3],
    /// Typical standard deviation of its estimate about each body axis [N m].
    pub stddev_b_n_m: [f64; 3],
    /// Its dependence on recorded quantities; `None` where nothing on the body is unexplained.
    pub dependences: Option<Dependences>,
    /// The same of every wheel's motor.
    pub motors: Vec<OfMotor>,
    /// What limits the answer, one sentence each.
    pub remarks: Vec<String>,
}

/// What is unexplained of a wheel's motor: torque about the wheel's axis beyond the commanded one and the model's friction.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OfMotor {
    /// Name of the wheel.
    pub wheel: String,
    /// RMS [N m].
    pub rms_n_m: f64,
    /// Typical standard deviation of its estimate [N m].
    pub stddev_n_m: f64,
    /// Its dependence on recorded quantities; `None` where nothing is unexplained.
    pub dependences: Option<Dependences>,
}

/// A run, and what pushed the platform in it beside its model.
pub type WithTorques<'a> = (&'a Recording, &'a UnexplainedTorques);

/// Finds in which regime `model` fails, over all of these runs.
///
/// # Errors
/// Where something is unexplained in runs that are too short to see on what it depends.
pub fn explain_where(
    runs: &[WithTorques<'_>],
    model: &PlatformModel,
) -> Result<Localisation, ValidationError> {
    let names: Vec<&str> = runs.iter().map(|(_, torques)| torques.run.as_str()).collect();
    let run = names.join(", ");
    let dependences_of = |residual: &dyn Fn(&UnexplainedTorques) -> Option<Residual>| {
        let of = |(recording, torques): &WithTorques<'_>| {
            Some((residual(torques)?, conditions(recording, model, &torques.states)))
        };
        let (residuals, variables): (Vec<Residual>, Vec<Vec<Variable>>) = runs.iter().filter_map(of).unzip();
        if residuals.is_empty() {
            return Ok(None);
        }
        match dependences(&residuals, &variables) {
            Ok(found) => Ok(Some(found).filter(|found| found.excess >= LEAST_EXCESS)),
            Err(error) => Err(ValidationError::Dependence { run: run.clone(), error }),
        }
    };
    let times = |torques: &UnexplainedTorques| torques.states.iter().map(|state| state.time_s).collect();
    let of_body = |torques: &UnexplainedTorques| {
        let noise = torques.noise_of_body(model);
        let of: Vec<_> = torques.states.iter().map(|state| state.torque_b_n_m).collect();
        let attitudes: Vec<_> = torques.states.iter().map(|state| state.q_world_body).collect();
        let pushes = torques.levels.body_stddev_b_n_m().iter().any(|level| *level > 0.0);
        pushes.then(|| match model.freedom.hinge_axis_b() {
            Some(axis_b) => Residual::on_hinge(times(torques), &of, &noise, &axis_b),
            None => Residual::of_body(times(torques), &of, &noise, &attitudes),
        })
    };
    // Root mean square over all runs.
    let rms = |of: &dyn Fn(&SmoothedState) -> Option<f64>| {
        let values = runs.iter().flat_map(|(_, torques)| &torques.states).filter_map(of);
        let (squares, count) = values.fold((0.0, 0.0), |(sum, n), x| (sum + x * x, n + 1.0));
        if count > 0.0 { f64::sqrt(squares / count) } else { 0.0 }
    };
    let mut motors = Vec::new();
    for (j, wheel) in model.wheels().iter().enumerate() {
        let of_motor = |torques: &UnexplainedTorques| {
            let motor = torques.motor(j);
            (!motor.is_empty()).then(|| Residual::of_motor(times(torques), motor))
        };
        motors.push(OfMotor {
            wheel: wheel.name.clone(),
            rms_n_m: rms(&|state| state.motor_torque_n_m.get(j).copied()),
            stddev_n_m: rms(&|state| state.motor_torque_stddev_n_m.get(j).copied()),
            dependences: dependences_of(&of_motor)?,
        });
    }
    let remarks =
        runs.iter().flat_map(|(_, torques)| torques.remarks.iter().map(|remark| (&torques.run, remark)));
    let of_run = |(run, remark): (&String, &String)| {
        if runs.len() > 1 { format!("{run}: {remark}") } else { remark.clone() }
    };
    Ok(Localisation {
        rms_b_n_m: [0, 1, 2].map(|i| rms(&|state| Some(state.torque_b_n_m[i]))),
        stddev_b_n_m: [0, 1, 2]
            .map(|i| rms(&|state| Some(state.torque_covariance_b[(i, i)].max(0.0).sqrt()))),
        dependences: dependences_of(&of_body)?,
        remarks: remarks.map(of_run).collect(),
        run,
        motors,
    })
}

impl Localisation {
    /// Whether there is anything to locate; otherwise the shares would describe noise.
    #[must_use]
    pub fn is_anything_left(&self) -> bool {
        self.dependences.is_some() || self.motors.iter().any(|motor| motor.dependences.is_some())
    }

    /// The answer in words: for body and motors each a summary, then one sentence for each named quantity.
    #[must_use]
    pub fn answer(&self) -> Vec<String> {
        if !self.is_anything_left() {
            return vec![format!(
                "{}: no torque beside the model's can be told from noise: there is nothing to locate.",
                self.run
            )];
        }
        // "14.5 mN m RMS (each value +- 0.48)", and on what it depends.
        let told = |rms_n_m: f64, stddev_n_m: f64, whose: &str, found: &Dependences| {
            let [rms, stddev] = [rms_n_m, stddev_n_m].map(|x| three_digits(x * 1e3));
            let left = format!(
                "{}: the model leaves a torque of {rms} mN m RMS (each value +- {stddev}){whose} unexplained.",
                self.run
            );
            std::iter::once(left).chain(named(found)).collect::<Vec<_>>()
        };
        let size = |by_axis: [f64; 3]| Vector3::from(by_axis).norm();
        let of_body = |found| told(size(self.rms_b_n_m), size(self.stddev_b_n_m), "", found);
        let of_motor = |motor: &OfMotor| {
            let whose = format!(" of {}'s motor", motor.wheel);
            motor.dependences.as_ref().map(|found| told(motor.rms_n_m, motor.stddev_n_m, &whose, found))
        };
        let body = self.dependences.as_ref().map(of_body);
        body.into_iter().chain(self.motors.iter().filter_map(of_motor)).flatten().collect()
    }
}

/// One sentence for each quantity that explains much.
fn named(found: &Dependences) -> Vec<String> {
    let mut sentences = Vec::new();
    let other = found.ranked.iter().filter(|d| d.variable != "time").map(|d| d.share).fold(0.0, f64::max);
    let constant = found.constant_world_share.max(found.constant_body_share);
    let is_constant = constant > WORTH_NAMING && constant >= CONSTANT_OF_BEST * other;
    if is_constant {
        sentences.push(format!("{:.0} % of the excess is {}.", constant * 100.0, constant_torque(found)));
    }
    // What is constant is a function of anything.
    let least = if is_constant { constant + WORTH_NAMING } else { WORTH_NAMING };
    let is_named =
        |d: &&Dependence| d.share > least && (d.variable != "time" || d.share > other + TIME_MARGIN);
    sentences.extend(found.ranked.iter().filter(is_named).take(NAMED).map(sentence));
    if let Some(line) = found.line {
        sentences.push(format!(
            "An oscillation of {} mN m at {:.3} Hz about {} holds {:.0} % of that axis' power.",
            three_digits(line.amplitude_n_m * 1e3),
            line.frequency_hz,
            line.frame.about(line.axis),
            line.share * 100.0
        ));
    }
    if sentences.is_empty() {
        sentences.push("No recorded quantity explains more than 15 % of the excess: it depends on something that was not measured.".to_owned());
    }
    sentences
}

/// "a constant torque of 30.0 mN m about the vertical", or by its components where it is about no axis.
fn constant_torque(found: &Dependences) -> String {
    let in_world = found.constant_world_share > found.constant_body_share;
    let (frame, mean) =
        if in_world { (Frame::World, found.mean_world_n_m) } else { (found.frame, found.mean_b_n_m) };
    let axes = frame.axes();
    let mean = &mean[..axes.len()];
    let size = mean.iter().map(|x| x * x).sum::<f64>().sqrt();
    let Some(axis) = mean.iter().position(|x| x.abs() > ABOUT_ONE * size) else {
        let listed = |of: &[f64]| of.iter().map(|x| three_digits(x * 1e3)).collect::<Vec<_>>().join(", ");
        let fixed = if in_world { "room" } else { "platform" };
        return format!(
            "a constant torque fixed to the {fixed}: {} mN m about {}",
            listed(mean),
            axes.join(", ")
        );
    };
    let told = format!("a constant torque of {} mN m about", three_digits(mean[axis] * 1e3));
    let is_upright = (found.constant_world_share - found.constant_body_share).abs() < CONSTANT_MARGIN
        && axis == 2
        && found.mean_world_n_m[2].abs() > 0.0;
    match (is_upright, frame) {
        // A platform that stands upright turns about both alike.
        (true, _) => format!("{told} the vertical, or body z, which was close to it"),
        (false, Frame::World) => format!("{told} {}, fixed to the room", frame.about(axis)),
        (false, Frame::Body) => format!("{told} {}, fixed to the platform", frame.about(axis)),
        (false, _) => format!("{told} {}", frame.about(axis)),
    }
}

/// "71 % of the excess is a function of yaw rate (about body z; odd; saturates)".
fn sentence(d: &Dependence) -> String {
    let about = (d.frame.axes().len() > 1).then(|| format!("mostly about {}", d.frame.about(d.axis)));
    let parity = match d.parity {
        Parity::Odd => Some("odd"),
        Parity::Even => Some("even"),
        Parity::None => None,
    };
    let growth = match d.growth {
        Growth::Saturates if d.parity == Parity::Odd => Some("saturates"),
        Growth::Linear => Some("in proportion"),
        Growth::Superlinear => Some("grows faster than in proportion"),
        _ => None,
    };
    let notes: Vec<&str> = about.as_deref().into_iter().chain(parity).chain(growth).collect();
    let notes = if notes.is_empty() { String::new() } else { format!(" ({})", notes.join("; ")) };
    format!(
        "{:.0} % of the excess is a function of {}{notes}.",
        d.share * 100.0,
        d.variable.replace('_', " ")
    )
}
