//! Commands of a run, as the model's actuators receive them.

use std::borrow::Cow;

use nalgebra::Vector3;
use whorl_dynamics::plant::MeanInputs;
use whorl_dynamics::platform::SensorSuite;
use whorl_dynamics::{Gyrostat, Plant};
use whorl_recording::{Recording, Series};

use crate::driven_speeds::{DrivenSpeeds, from_speeds};

/// Numbers of [`MeanInputs`].
pub type Inputs = [f64; MeanInputs::COUNT];

#[derive(Debug, Clone, PartialEq)]
pub struct Commands<'a> {
    wheel_torque_n_m: Cow<'a, Series<Vec<f64>>>,
    body_torque_b_n_m: &'a Series<Vector3<f64>>,
    /// Per jet: opening and closing of the flow, delays and lag included \[s\].
    flow: Vec<Vec<(f64, f64)>>,
    /// All commands to the plant in order: time and command.
    events: Vec<(i64, Event)>,
}

#[derive(Debug, Clone, PartialEq)]
enum Event {
    /// By its position in the series.
    Wheels(usize),
    /// A jet, and for how long it opens \[s\].
    Jet(usize, f64),
    Ballast(Vector3<f64>),
    Torque(Vector3<f64>),
    /// Angles that were measured, and rates to those of the next sample.
    Gimbals(Vec<f64>, Vec<f64>),
}

impl<'a> Commands<'a> {
    /// Of a recording, with the speeds along which its wheels are driven if their torques were not recorded, which are the same whatever the model.
    pub(crate) fn along(
        recording: &'a Recording,
        gyrostat: &Gyrostat,
        driven: Option<&DrivenSpeeds>,
    ) -> Self {
        let model = gyrostat.model();
        let wheel_torque_n_m = driven.map_or(Cow::Borrowed(&recording.wheel_torque_command_n_m), |speeds| {
            Cow::Owned(from_speeds(recording, speeds, model))
        });
        let (ballast, body) = (&recording.ballast_moment_b_n_m, &recording.body_torque_b_n_m);
        let mut events: Vec<(i64, Event)> = Vec::new();
        events.extend(wheel_torque_n_m.time_s.iter().enumerate().map(|(k, t)| (ns(*t), Event::Wheels(k))));
        events.extend(ballast.time_s.iter().zip(&ballast.value).map(|(t, x)| (ns(*t), Event::Ballast(*x))));
        events.extend(body.time_s.iter().zip(&body.value).map(|(t, x)| (ns(*t), Event::Torque(*x))));
        let (angles, rates) = (&recording.gimbal_angle_rad, &recording.gimbal_rate_rad_s);
        for (k, (t, angle_rad)) in angles.time_s.iter().zip(&angles.value).enumerate() {
            let next = angles.time_s.get(k + 1).zip(angles.value.get(k + 1));
            let rate_rad_s = if let Some((next_s, next)) = next.filter(|(next_s, _)| *next_s > t) {
                angle_rad.iter().zip(next).map(|(from, to)| (to - from) / (next_s - t)).collect()
            } else {
                let last = rates.time_s.partition_point(|rate_s| rate_s <= t).saturating_sub(1);
                rates.value.get(last).cloned().unwrap_or_else(|| vec![0.0; angle_rad.len()])
            };
            events.push((ns(*t), Event::Gimbals(angle_rad.clone(), rate_rad_s)));
        }
        // As a whole a lag gives and takes what a delay by its time would.
        let lag = gyrostat.thrust_lag();
        let mut flow = Vec::new();
        for (jet, pulses) in recording.jet_pulses.iter().enumerate() {
            let data = model.jets().get(jet);
            let (opening_s, closing_s) = data.map_or((0.0, 0.0), |j| (j.opening_delay_s, j.closing_delay_s));
            let (opening_s, closing_s) = (opening_s + lag.rise_s, closing_s + lag.tail_s);
            flow.push(pulses.iter().map(|p| (p.on_s + opening_s, p.off_s + closing_s)).collect());
            events.extend(pulses.iter().map(|p| (ns(p.on_s), Event::Jet(jet, p.off_s - p.on_s))));
        }
        events.sort_by_key(|(time_ns, _)| *time_ns);
        Self { wheel_torque_n_m, body_torque_b_n_m: body, flow, events }
    }

    pub(crate) fn event_ns(&self, event: usize) -> Option<i64> {
        self.events.get(event).map(|(t, _)| *t)
    }

    /// Passes the command to the plant. Refusals (a pulse too short for its valve) are ignored: the hardware refuses too.
    pub(crate) fn tell(&self, event: usize, plant: &mut Plant) {
        let now_ns = plant.now_ns();
        let Some((start_ns, event)) = self.events.get(event) else { return };
        let _ = match event {
            Event::Wheels(k) => plant.command_wheels(&self.wheel_torque_n_m.value[*k]),
            Event::Jet(jet, on_s) => plant.command_jet_pulse(*jet, (*start_ns).max(now_ns), *on_s).map(drop),
            Event::Gimbals(angle_rad, rate_rad_s) => plant.move_gimbals_along(angle_rad, rate_rad_s),
            Event::Ballast(moment_b_n_m) => return plant.set_ballast_moment(*moment_b_n_m),
            Event::Torque(torque_b_n_m) => return plant.set_body_torque(*torque_b_n_m),
        };
    }

    /// Passes what wheels were told last before a command.
    pub(crate) fn tell_wheels(&self, before: usize, plant: &mut Plant) {
        let told = self.events.get(..before).unwrap_or_default();
        let last = told.iter().rposition(|(_, event)| matches!(event, Event::Wheels(_)));
        last.into_iter().for_each(|event| self.tell(event, plant));
    }

    /// Advances a plant; false where its motion is lost. A command of the very instant comes after what is read then: a controller answers to it.
    pub(crate) fn run_to(&self, plant: &mut Plant, event: &mut usize, time_ns: i64) -> bool {
        while let Some(due_ns) = self.event_ns(*event).filter(|t| *t < time_ns) {
            if plant.advance_to(due_ns.max(plant.now_ns())).is_err() {
                return false;
            }
            self.tell(*event, plant);
            *event += 1;
        }
        plant.advance_to(time_ns.max(plant.now_ns())).is_ok()
    }

    /// Valves, gas and commands as they are at the first reading, and the next command; the motion until then is nobody's.
    pub(crate) fn at_first_reading(&self, plant: Plant, first_ns: i64) -> (Plant, usize) {
        let (mut moved, begun) = (plant.clone(), self.events.partition_point(|(t, _)| *t < plant.now_ns()));
        let mut event = begun;
        if self.run_to(&mut moved, &mut event, first_ns) { (moved, event) } else { (plant, begun) }
    }

    /// Over the window of an accelerometer whose readings show this instant \[ns\]; `None` where they are no means.
    pub(crate) fn mean_inputs(&self, sensors: &SensorSuite, instant_ns: i64) -> Option<MeanInputs> {
        let window_s = sensors.accelerometer.errors.averaging_window_s;
        let (middle_s, half_s) = (instant_ns as f64 * 1e-9, 0.5 * window_s);
        (window_s > 0.0).then(|| self.mean_between(middle_s - half_s, middle_s + half_s))
    }

    /// How large what motors are told is, root mean squares [N m].
    pub fn motors_rms_n_m(&self) -> impl Iterator<Item = f64> {
        let told = &self.wheel_torque_n_m.value;
        let rms = |j: usize| {
            let squares = told.iter().filter_map(|of| of.get(j)).map(|x| x * x);
            (squares.sum::<f64>() / told.len().max(1) as f64).sqrt()
        };
        (0..told.first().map_or(0, Vec::len)).map(rms)
    }

    pub fn mean_between(&self, from_s: f64, to_s: f64) -> MeanInputs {
        self.moments_between(from_s, to_s)[0]
    }

    /// Mean inputs over a stretch of time, and their mean by how much of it is still to come, twice: the same where inputs do not change.
    pub fn moments_between(&self, from_s: f64, to_s: f64) -> [MeanInputs; 2] {
        let length_s = (to_s - from_s).max(1e-9);
        let mut moments = [MeanInputs::default(); 2];
        let [mean, early] = &mut moments;
        // Of what is held between two instants.
        let shares = |on_s: f64, off_s: f64| {
            let (on_s, off_s) = (on_s.max(from_s), off_s.min(to_s));
            let share = (off_s - on_s).max(0.0) / length_s;
            [share, share * (2.0 * to_s - on_s - off_s) / length_s]
        };
        let slots = mean.valve_fraction.iter_mut().zip(&mut early.valve_fraction);
        for ((mean, early), intervals) in slots.zip(&self.flow) {
            // Pulses are sorted by their beginning, and few are open at once.
            let end = intervals.partition_point(|(on, _)| *on < to_s);
            // A pulse that is shorter than its valve takes to open ends before it begins: nothing flows.
            for (on, off) in intervals[..end].iter().rev().take_while(|(_, off)| *off > from_s) {
                let [share, of_early] = shares(*on, *off);
                (*mean, *early) = (*mean + share, *early + of_early);
            }
        }
        for (k, on_s, off_s) in held_between(&self.wheel_torque_n_m.time_s, from_s, to_s) {
            let torques = self.wheel_torque_n_m.value.get(k).into_iter().flatten();
            let [share, of_early] = shares(on_s, off_s);
            let slots = mean.wheel_torque_n_m.iter_mut().zip(&mut early.wheel_torque_n_m);
            for ((mean, early), x) in slots.zip(torques) {
                (*mean, *early) = (*mean + x * share, *early + x * of_early);
            }
        }
        for (k, on_s, off_s) in held_between(&self.body_torque_b_n_m.time_s, from_s, to_s) {
            let [share, of_early] = shares(on_s, off_s);
            mean.body_torque_b_n_m += self.body_torque_b_n_m.value[k] * share;
            early.body_torque_b_n_m += self.body_torque_b_n_m.value[k] * of_early;
        }
        moments
    }
}

/// The samples that are held within a stretch, from when and until when \[s\].
fn held_between(time_s: &[f64], from_s: f64, to_s: f64) -> impl Iterator<Item = (usize, f64, f64)> {
    let first = time_s.partition_point(|t| *t <= from_s).saturating_sub(1);
    let held = time_s.iter().enumerate().skip(first).take_while(move |(_, t)| **t < to_s);
    held.map(move |(k, t)| (k, *t, time_s.get(k + 1).copied().unwrap_or(to_s)))
}

/// Seconds rounded to nanoseconds; saturates.
pub fn ns(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}

#[cfg(test)]
mod tests;
