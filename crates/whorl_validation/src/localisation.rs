//! Where a model fails, in words.

use nalgebra::Vector3;
use serde::Serialize;
use whorl_dynamics::PlatformModel;
use whorl_dynamics::platform::Wheel;
use whorl_math::three_digits;
use whorl_prediction::SmoothedState;
use whorl_recording::{Channel, Recording};

use crate::dependence::{
    Dependence, Dependences, Frame, RATE_ABOUT_SAME_AXIS, Residual, Variable, dependences, range,
};
use crate::quantities::{Quantity, environment, quantities};
use crate::shapes::{Growth, Parity};
use crate::unexplained::UnexplainedTorques;

/// Of fewer values nothing is said.
const FEWEST_VALUES: usize = 20;
/// Excess over the noise below which there is nothing to locate.
const LEAST_EXCESS: f64 = 0.05;
/// Quantities named in words.
const NAMED: usize = 3;
/// Share of the excess below which a quantity is not named.
const WORTH_NAMING: f64 = 0.15;
/// Any slow torque is a smooth function of time: it is named only if it explains this much more than every other quantity.
const TIME_MARGIN: f64 = 0.25;
/// A constant torque has a name if it is so much of what the best curve explains; a quantity beside it is named for what it adds.
const CONSTANT_OF_BEST: f64 = 0.75;
/// Shares of a constant torque in two frames that differ by less do not tell the frames apart.
const CONSTANT_MARGIN: f64 = 0.07;
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

/// Finds in which regime `model` fails, over all of these runs, each with what pushed the platform in it beside the model.
pub fn explain_where(runs: &[(&Recording, &UnexplainedTorques)], model: &PlatformModel) -> Localisation {
    // What is unexplained in those runs that show anything of it.
    let explain = |first: Frame, add: &dyn Fn(&UnexplainedTorques, &mut Residual)| {
        let (mut residual, mut shown) = (Residual::new(first), Vec::new());
        for of in runs {
            let before = residual.torques.len();
            add(of.1, &mut residual);
            shown.extend((residual.torques.len() > before).then_some(*of));
        }
        let is_enough = residual.torques.len() >= FEWEST_VALUES;
        let found = is_enough.then(|| dependences(&residual, &variables(&shown, model)));
        found.filter(|found| found.excess >= LEAST_EXCESS)
    };
    let rms = |of: &dyn Fn(&SmoothedState) -> Option<f64>| {
        let values = runs.iter().flat_map(|(_, torques)| &torques.states).filter_map(of);
        let (squares, count) = values.fold((0.0, 0.0), |(sum, n), x| (sum + x * x, n + 1.0));
        if count > 0.0 { f64::sqrt(squares / count) } else { 0.0 }
    };
    let motor = |(j, wheel): (usize, &Wheel)| OfMotor {
        wheel: wheel.name.clone(),
        rms_n_m: rms(&|state| state.motor_torque_n_m.get(j).copied()),
        stddev_n_m: rms(&|state| state.motor_torque_stddev_n_m.get(j).copied()),
        dependences: explain(Frame::Wheel, &|torques, to| torques.of_motor(j, to)),
    };
    let frame = if model.freedom.hinge_axis_b().is_some() { Frame::Hinge } else { Frame::Body };
    let of_run = |torques: &UnexplainedTorques, remark: &String| {
        if runs.len() > 1 { format!("{}: {remark}", torques.run) } else { remark.clone() }
    };
    let remarks = runs.iter().flat_map(|(_, of)| of.remarks.iter().map(move |remark| of_run(of, remark)));
    Localisation {
        run: runs.iter().map(|(_, torques)| torques.run.as_str()).collect::<Vec<_>>().join(", "),
        rms_b_n_m: [0, 1, 2].map(|i| rms(&|state| Some(state.torque_b_n_m[i]))),
        stddev_b_n_m: [0, 1, 2].map(|i| rms(&|of| Some(of.torque_covariance_b[(i, i)].max(0.0).sqrt()))),
        dependences: explain(frame, &|torques, to| torques.on_body(&model.freedom, to)),
        motors: model.wheels().iter().enumerate().map(motor).collect(),
        remarks: remarks.collect(),
    }
}

/// The quantities that vary in these runs, one run after the other, of the smoothed motion: noise would blur sharp curves.
fn variables(runs: &[(&Recording, &UnexplainedTorques)], model: &PlatformModel) -> Vec<Variable> {
    let states =
        || runs.iter().flat_map(|(run, torques)| torques.states.iter().map(move |state| (run, state)));
    let mut all: Vec<Variable> = Vec::new();
    for quantity in quantities(model, runs.iter().map(|(recording, _)| *recording)) {
        let number = |(recording, state): (&&Recording, &SmoothedState)| {
            let motion = (state.q_world_body, state.omega_wb_b_rad_s);
            let here = environment(model, recording, state.time_s, motion, &state.wheel_speed_rad_s);
            // A law has a coefficient of either sign; here it has the sense of its name.
            let sense = if quantity.name == "tilt_y" { -1.0 } else { 1.0 };
            sense * quantity.formula.number(&here)
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
    let channel = Channel::ALL.iter().find(|channel| channel.info().key == quantity.name);
    match quantity.unit {
        _ if quantity.is_angle() => CONSTANT_ANGLE_RAD,
        "1" | "rad" => CONSTANT_STDDEVS * state.attitude_stddev_b_rad.max(),
        "rad/s" if quantity.name.ends_with("rate") => CONSTANT_STDDEVS * state.omega_stddev_b_rad_s.max(),
        "rad/s" => CONSTANT_STDDEVS * state.wheel_speed_stddev_rad_s.iter().copied().fold(0.0, f64::max),
        _ => channel.and_then(|channel| channel.info().resolution).unwrap_or(0.0),
    }
}

impl Localisation {
    /// Whether there is anything to locate; otherwise the shares would describe noise.
    pub fn is_anything_left(&self) -> bool {
        self.dependences.is_some() || self.motors.iter().any(|motor| motor.dependences.is_some())
    }

    /// The answer in words: for body and motors each a summary, then one sentence for each named quantity.
    pub fn answer(&self) -> Vec<String> {
        let run = &self.run;
        let size = |by_axis: [f64; 3]| Vector3::from(by_axis).norm();
        let of_body = (size(self.rms_b_n_m), size(self.stddev_b_n_m), String::new(), &self.dependences);
        let of_motor = |of: &OfMotor| format!(" of {}'s motor", of.wheel);
        let motors = self.motors.iter().map(|m| (m.rms_n_m, m.stddev_n_m, of_motor(m), &m.dependences));
        let mut answer = Vec::new();
        for (rms_n_m, stddev_n_m, whose, found) in std::iter::once(of_body).chain(motors) {
            let Some(found) = found else { continue };
            let [rms, stddev] = [rms_n_m, stddev_n_m].map(|x| three_digits(x * 1e3));
            answer.push(format!(
                "{run}: the model leaves a torque of {rms} mN m RMS (each value +- {stddev}){whose} unexplained."
            ));
            answer.extend(named(found));
        }
        if answer.is_empty() {
            let nothing = "no torque beside the model's can be told from noise: there is nothing to locate.";
            answer.push(format!("{run}: {nothing}"));
        }
        answer
    }
}

/// One sentence for each quantity that explains much.
fn named(found: &Dependences) -> Vec<String> {
    let mut sentences = Vec::new();
    let other = found.ranked.iter().find(|d| d.variable != "time").map_or(0.0, |d| d.share);
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

/// "a constant torque of 0.100, -0.030, 30.0 mN m about east, north, the vertical, fixed to the room".
fn constant_torque(found: &Dependences) -> String {
    let more = found.constant_world_share - found.constant_body_share;
    // A platform that stands upright turns about the vertical and its own axis alike.
    let is_either = more.abs() < CONSTANT_MARGIN;
    let in_world = more > 0.0 || (is_either && found.frame == Frame::Body);
    let (frame, mean) =
        if in_world { (Frame::World, found.mean_world_n_m) } else { (found.frame, found.mean_b_n_m) };
    let fixed = match frame {
        Frame::World if !is_either => ", fixed to the room",
        Frame::Body if !is_either => ", fixed to the platform",
        _ => "",
    };
    let axes: Vec<&str> = (0..frame.axes().len()).map(|axis| frame.about(axis)).collect();
    let told: Vec<String> = mean.iter().take(axes.len()).map(|x| three_digits(x * 1e3)).collect();
    format!("a constant torque of {} mN m about {}{fixed}", told.join(", "), axes.join(", "))
}

/// "71 % of the excess is a function of yaw rate (about body z; odd; saturates)".
fn sentence(d: &Dependence) -> String {
    let about = (d.frame.axes().len() > 1).then(|| format!("mostly about {}", d.frame.about(d.axis)));
    let parity = (d.parity != Parity::None).then(|| format!("{:?}", d.parity).to_lowercase());
    let growth = match d.growth {
        Growth::Saturates if d.parity == Parity::Odd => Some("saturates"),
        Growth::Linear => Some("in proportion"),
        Growth::Superlinear => Some("grows faster than in proportion"),
        _ => None,
    };
    let notes: Vec<&str> = about.as_deref().into_iter().chain(parity.as_deref()).chain(growth).collect();
    let notes = if notes.is_empty() { String::new() } else { format!(" ({})", notes.join("; ")) };
    let (share, variable) = (d.share * 100.0, d.variable.replace('_', " "));
    format!("{share:.0} % of the excess is a function of {variable}{notes}.")
}
