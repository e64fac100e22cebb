//! Where a model fails, in words.

use nalgebra::Vector3;
use serde::Serialize;
use whorl_dynamics::PlatformModel;
use whorl_math::three_digits;
use whorl_prediction::SmoothedState;
use whorl_recording::{Channel, Recording};

use crate::dependence::{
    Dependence, Dependences, Frame, RATE_ABOUT_SAME_AXIS, Residual, Variable, dependences, range,
};
use crate::error::ValidationError;
use crate::quantities::{Quantity, environment, quantities};
use crate::shapes::{Growth, Parity};
use crate::unexplained::UnexplainedTorques;

/// Fewest values of a residual.
const FEWEST_VALUES: usize = 20;
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
/// Standard deviations of a smoothed quantity within which it counts as constant, and the share of its largest size of what is not smoothed.
const CONSTANT_STDDEVS: f64 = 4.0;
const CONSTANT_SHARE: f64 = 1e-3;
/// Of a turn: an angle that varies by less counts as constant.
const CONSTANT_ANGLE_RAD: f64 = 0.3;

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
    let shown = |is_shown: &dyn Fn(&UnexplainedTorques) -> bool| -> Vec<WithTorques<'_>> {
        runs.iter().copied().filter(|(_, torques)| is_shown(torques)).collect()
    };
    let of = |residual: Residual, shown: &[WithTorques<'_>]| match residual.torques.len() {
        0 => Ok(None),
        given if given < FEWEST_VALUES => Err(ValidationError::TooShort { run: run.clone(), given }),
        _ => {
            let found = dependences(&residual, &variables(shown, model));
            Ok(Some(found).filter(|found| found.excess >= LEAST_EXCESS))
        }
    };
    let hinge_b = model.freedom.hinge_axis_b().map(|axis| axis.into_inner());
    let mut on_body = Residual::new(hinge_b.map_or(Frame::Body, |_| Frame::Hinge));
    let pushed = shown(&|torques| torques.levels.body_stddev_b_n_m().iter().any(|level| *level > 0.0));
    for (_, torques) in &pushed {
        for (state, noise) in torques.states.iter().zip(torques.noise_of_body(model)) {
            let torque = &state.torque_b_n_m;
            match hinge_b {
                Some(axis) => {
                    let variance = axis.dot(&(noise * axis));
                    on_body.push_about_one((axis.dot(torque), variance.max(0.0).sqrt()));
                }
                None => {
                    on_body.push_on_body(torque, &noise, state.q_world_body.to_rotation_matrix().matrix())
                }
            }
        }
    }
    // Root mean square over all runs.
    let rms = |of: &dyn Fn(&SmoothedState) -> Option<f64>| {
        let values = runs.iter().flat_map(|(_, torques)| &torques.states).filter_map(of);
        let (squares, count) = values.fold((0.0, 0.0), |(sum, n), x| (sum + x * x, n + 1.0));
        if count > 0.0 { f64::sqrt(squares / count) } else { 0.0 }
    };
    let mut motors = Vec::new();
    for (j, wheel) in model.wheels().iter().enumerate() {
        let mut residual = Residual::new(Frame::Wheel);
        let pushed = shown(&|torques| !torques.motor(j).is_empty());
        let all = pushed.iter().flat_map(|(_, torques)| torques.motor(j));
        all.for_each(|torque| residual.push_about_one(torque));
        motors.push(OfMotor {
            wheel: wheel.name.clone(),
            rms_n_m: rms(&|state| state.motor_torque_n_m.get(j).copied()),
            stddev_n_m: rms(&|state| state.motor_torque_stddev_n_m.get(j).copied()),
            dependences: of(residual, &pushed)?,
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
        dependences: of(on_body, &pushed)?,
        remarks: remarks.map(of_run).collect(),
        run,
        motors,
    })
}

/// The quantities that vary in these runs, one run after the other: tilt, rates and wheel speeds as they were smoothed, since noise would blur
/// sharp curves.
fn variables(runs: &[WithTorques<'_>], model: &PlatformModel) -> Vec<Variable> {
    let states =
        || runs.iter().flat_map(|(run, torques)| torques.states.iter().map(move |state| (run, state)));
    let mut all: Vec<Variable> = Vec::new();
    for quantity in quantities(model, runs.iter().map(|(recording, _)| *recording)) {
        let number = |(recording, state): (&&Recording, &SmoothedState)| {
            let motion = (state.q_world_body, state.omega_wb_b_rad_s);
            let here = environment(model, recording, state.time_s, motion, &state.wheel_speed_rad_s);
            quantity.sense() * quantity.number(&here)
        };
        let values: Vec<f64> = states().map(number).collect();
        let squares: f64 = states().map(|(_, state)| resolution(&quantity, state).powi(2)).sum();
        let (low, high) = range(&values);
        let Some(scale) = quantity.scale((low, high)) else { continue };
        let constant = (squares / values.len() as f64).sqrt() + CONSTANT_SHARE * scale.1;
        if values.iter().all(|x| x.is_finite()) && high - low > constant {
            all.push(Variable { quantity, values: vec![values], scale });
        }
    }
    if let Some(mut rate) = all.iter().find(|variable| variable.quantity.name == "rate").cloned() {
        let about = |i: usize| states().map(|(_, state)| state.omega_wb_b_rad_s[i]).collect();
        rate.quantity.name = RATE_ABOUT_SAME_AXIS.to_owned();
        all.push(Variable { values: [0, 1, 2].map(about).to_vec(), ..rate });
    }
    all
}

/// Change of a quantity that may be noise.
fn resolution(quantity: &Quantity, state: &SmoothedState) -> f64 {
    let of_channel = || {
        let channel = Channel::ALL.iter().find(|channel| channel.info().key == quantity.name);
        channel.and_then(|channel| channel.info().resolution).unwrap_or(0.0)
    };
    match quantity.unit {
        _ if quantity.is_angle() => CONSTANT_ANGLE_RAD,
        "1" | "rad" => CONSTANT_STDDEVS * state.attitude_stddev_b_rad.max(),
        "rad/s" if quantity.name.ends_with("rate") => CONSTANT_STDDEVS * state.omega_stddev_b_rad_s.max(),
        "rad/s" => CONSTANT_STDDEVS * state.wheel_speed_stddev_rad_s.iter().copied().fold(0.0, f64::max),
        _ => of_channel(),
    }
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
    let mean = &mean[..frame.axes().len()];
    let size = mean.iter().map(|x| x * x).sum::<f64>().sqrt();
    let about = mean.iter().position(|x| x.abs() > ABOUT_ONE * size);
    let milli = |x: &f64| three_digits(x * 1e3);
    let is_upright = (found.constant_world_share - found.constant_body_share).abs() < CONSTANT_MARGIN;
    let fixed = match frame {
        Frame::World => ", fixed to the room",
        Frame::Body => ", fixed to the platform",
        Frame::Wheel | Frame::Hinge => "",
    };
    match about {
        None => {
            let listed = mean.iter().map(milli).collect::<Vec<_>>().join(", ");
            format!("a constant torque of {listed} mN m about {}{fixed}", frame.axes().join(", "))
        }
        // A platform that stands upright turns about both alike.
        Some(2) if is_upright && found.mean_world_n_m[2].abs() > 0.0 => {
            let told = milli(&mean[2]);
            format!("a constant torque of {told} mN m about the vertical, or body z, which was close to it")
        }
        Some(axis) => {
            format!("a constant torque of {} mN m about {}{fixed}", milli(&mean[axis]), frame.about(axis))
        }
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
