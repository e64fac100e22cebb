//! Commands of a run, as the model's actuators receive them.

use std::borrow::Cow;

use nalgebra::Vector3;
use whorl_dynamics::plant::MeanInputs;
use whorl_dynamics::{Gyrostat, Plant, PlatformModel};
use whorl_recording::{Recording, Series};

use crate::inputs::driven_speeds::DrivenSpeeds;
use crate::inputs::gimbals::GimbalMotion;
use crate::inputs::wheel_torque;

/// Commands of a run in order of time.
#[derive(Debug, Clone, PartialEq)]
pub struct Commands<'a> {
    wheel_torque_n_m: Cow<'a, Series<Vec<f64>>>,
    ballast_moment_b_n_m: &'a Series<Vector3<f64>>,
    body_torque_b_n_m: &'a Series<Vector3<f64>>,
    /// Angles and rates of the gimbals, from each sample to the next.
    gimbals: Vec<(Vec<f64>, Vec<f64>)>,
    /// Per jet: opening and closing of the flow, delays and lag included \[s\].
    flow: Vec<Vec<(f64, f64)>>,
    /// All commands to the plant in order: time and command.
    events: Vec<(i64, Event)>,
    /// Whether the wheels' torques were derived from their speeds.
    pub wheel_torque_from_speed: bool,
    wheels: usize,
}

/// A command, most of them by their position in their series.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Event {
    Wheels(usize),
    Jet { jet: usize, on_time_s: f64 },
    Ballast(usize),
    Torque(usize),
    Gimbals(usize),
}

impl<'a> Commands<'a> {
    /// Commands of a recording. Wheels without recorded torques are driven along their measured speeds.
    #[must_use]
    pub fn of(recording: &'a Recording, gyrostat: &Gyrostat) -> Self {
        let driven = wheel_torque::go_along_speeds(recording).then(|| DrivenSpeeds::of(recording));
        Self::along(recording, gyrostat, driven.as_ref())
    }

    /// The same with the speeds along which its wheels are driven, which are the same whatever the model.
    #[must_use]
    pub fn along(recording: &'a Recording, gyrostat: &Gyrostat, driven: Option<&DrivenSpeeds>) -> Self {
        let model = gyrostat.model();
        let wheels = model.wheels().len();
        let wheel_torque_n_m = match driven {
            Some(speeds) => Cow::Owned(wheel_torque::from_speeds(recording, speeds, model)),
            None => Cow::Borrowed(&recording.wheel_torque_command_n_m),
        };
        let mut events = Vec::new();
        let ballast = &recording.ballast_moment_b_n_m;
        let body = &recording.body_torque_b_n_m;
        let angles = &recording.gimbal_angle_rad;
        let mut hold = |times: &[f64], event: fn(usize) -> Event| {
            events.extend(times.iter().enumerate().map(|(k, t)| (ns(*t), event(k))));
        };
        hold(&wheel_torque_n_m.time_s, Event::Wheels);
        hold(&ballast.time_s, Event::Ballast);
        hold(&body.time_s, Event::Torque);
        hold(&angles.time_s, Event::Gimbals);
        // The gimbals of the model follow those that were measured: from each sample to the next.
        let gimbals = angles.time_s.iter().zip(&angles.value).enumerate().map(|(k, (t, angle_rad))| {
            let next = angles.time_s.get(k + 1).copied().unwrap_or(*t);
            (angle_rad.clone(), GimbalMotion::between(recording, *t, next).rate_rad_s)
        });
        let gimbals = gimbals.collect();
        // As a whole a lag gives and takes what a delay by its time would.
        let lag = gyrostat.thrust_lag();
        let mut flow = Vec::new();
        for (jet, pulses) in recording.jet_pulses.iter().enumerate() {
            let data = model.jets().get(jet);
            let (opening_s, closing_s) = data.map_or((0.0, 0.0), |j| (j.opening_delay_s, j.closing_delay_s));
            let (opening_s, closing_s) = (opening_s + lag.rise_s, closing_s + lag.tail_s);
            flow.push(pulses.iter().map(|p| (p.on_s + opening_s, p.off_s + closing_s)).collect());
            for pulse in pulses {
                events.push((ns(pulse.on_s), Event::Jet { jet, on_time_s: pulse.off_s - pulse.on_s }));
            }
        }
        events.sort_by_key(|(time_ns, _)| *time_ns);
        Self {
            wheel_torque_n_m,
            ballast_moment_b_n_m: ballast,
            body_torque_b_n_m: body,
            gimbals,
            flow,
            events,
            wheel_torque_from_speed: driven.is_some(),
            wheels,
        }
    }

    /// The first event at or after a time.
    #[must_use]
    pub fn first_event(&self, time_ns: i64) -> usize {
        self.events.partition_point(|(t, _)| *t < time_ns)
    }

    /// When an event is due \[ns\].
    #[must_use]
    pub fn event_ns(&self, event: usize) -> Option<i64> {
        self.events.get(event).map(|(t, _)| *t)
    }

    /// Passes the command to the plant. Refusals (a pulse too short for its valve) are ignored: the hardware would
    /// refuse it too.
    pub fn tell(&self, event: usize, plant: &mut Plant) {
        let now_ns = plant.now_ns();
        let Some((start_ns, event)) = self.events.get(event) else { return };
        match *event {
            Event::Wheels(k) => {
                if let Some(torque) = self.wheel_torque_n_m.value.get(k) {
                    let _ = plant.command_wheels(torque);
                }
            }
            Event::Jet { jet, on_time_s } => {
                let _ = plant.command_jet_pulse(jet, (*start_ns).max(now_ns), on_time_s);
            }
            Event::Ballast(k) => {
                if let Some(moment) = self.ballast_moment_b_n_m.value.get(k) {
                    plant.set_ballast_moment(*moment);
                }
            }
            Event::Torque(k) => {
                if let Some(torque) = self.body_torque_b_n_m.value.get(k) {
                    plant.set_body_torque(*torque);
                }
            }
            Event::Gimbals(k) => {
                if let Some((angle_rad, rate_rad_s)) = self.gimbals.get(k) {
                    let _ = plant.move_gimbals_along(angle_rad, rate_rad_s);
                }
            }
        }
    }

    /// Mean inputs over a stretch of time \[s\].
    #[must_use]
    pub fn mean_between(&self, from_s: f64, to_s: f64) -> MeanInputs {
        let length_s = (to_s - from_s).max(1e-9);
        let mut mean = MeanInputs::default();
        for (slot, intervals) in mean.valve_fraction.iter_mut().zip(&self.flow) {
            // Pulses are sorted by their beginning, and few are open at once.
            let end = intervals.partition_point(|(on, _)| *on < to_s);
            let near = intervals[..end].iter().rev().take_while(|(_, off)| *off > from_s);
            // A pulse that is shorter than its valve takes to open ends before it begins: nothing flows.
            *slot = near.map(|(on, off)| (off.min(to_s) - on.max(from_s)).max(0.0)).sum::<f64>() / length_s;
        }
        held_between(&self.wheel_torque_n_m, from_s, to_s, |torque_n_m, share_s| {
            for (slot, torque_n_m) in mean.wheel_torque_n_m.iter_mut().zip(torque_n_m) {
                *slot += torque_n_m * share_s / length_s;
            }
        });
        let body = &mut mean.body_torque_b_n_m;
        held_between(self.body_torque_b_n_m, from_s, to_s, |torque, share_s| {
            *body += torque * share_s / length_s
        });
        mean
    }

    /// Inputs of the platform as named series at these times, for cross-correlation: wheel torques, and jet and external
    /// torque about each body axis. Constant series are left out.
    #[must_use]
    pub fn inputs(&self, model: &PlatformModel, time_s: &[f64]) -> Vec<(String, Vec<f64>)> {
        let mut columns: Vec<Input> =
            model.wheels().iter().map(|w| Input::new(format!("{} torque", w.name))).collect();
        let axes = ["x", "y", "z"];
        columns.extend(axes.iter().map(|axis| Input::new(format!("jet torque {axis}"))));
        columns.extend(axes.iter().map(|axis| Input::new(format!("outside torque {axis}"))));
        let mut before = time_s.first().copied().unwrap_or(0.0) - 0.01;
        for t in time_s {
            let drive = self.mean_between(before, *t);
            before = *t;
            let jets: Vector3<f64> =
                model.jets().iter().zip(&drive.valve_fraction).map(|(jet, f)| jet.torque_b_n_m() * *f).sum();
            let values = (0..self.wheels)
                .map(|j| drive.wheel_torque_n_m.get(j).copied().unwrap_or(0.0))
                .chain(jets.iter().copied())
                .chain(drive.body_torque_b_n_m.iter().copied());
            for (column, value) in columns.iter_mut().zip(values) {
                column.push(value);
            }
        }
        columns.into_iter().filter_map(Input::varying).collect()
    }
}

/// An input while it is read: most are constant throughout, and of those nothing is stored.
struct Input {
    name: String,
    first: f64,
    /// Values that equal the first, before any other.
    alike: usize,
    values: Vec<f64>,
}

impl Input {
    fn new(name: String) -> Self {
        Self { name, first: 0.0, alike: 0, values: Vec::new() }
    }

    fn push(&mut self, value: f64) {
        if self.alike == 0 {
            self.first = value;
        }
        if self.values.is_empty() && (self.alike == 0 || value == self.first) {
            self.alike += 1;
            return;
        }
        if self.values.is_empty() {
            self.values = vec![self.first; self.alike];
        }
        self.values.push(value);
    }

    /// Name and values, if it is not constant.
    fn varying(self) -> Option<(String, Vec<f64>)> {
        let varies = self.values.iter().any(|x| (x - self.first).abs() > 1e-9);
        varies.then_some((self.name, self.values))
    }
}

/// Tells every value that is held within a stretch, and for how long \[s\].
fn held_between<T>(series: &Series<T>, from_s: f64, to_s: f64, mut told: impl FnMut(&T, f64)) {
    let first = series.time_s.partition_point(|t| *t <= from_s).saturating_sub(1);
    for (k, (t, value)) in series.time_s.iter().zip(&series.value).enumerate().skip(first) {
        if *t >= to_s {
            break;
        }
        let until = series.time_s.get(k + 1).copied().unwrap_or(to_s).min(to_s);
        told(value, until - t.max(from_s));
    }
}

/// Seconds rounded to nanoseconds; saturates.
#[must_use]
pub fn ns(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}

#[cfg(test)]
mod tests {
    use whorl_recording::OnInterval;

    use super::*;

    #[test]
    fn means_are_those_of_what_jumps_within() {
        let mut model = PlatformModel::whorl_1_reference();
        for jet in model.jets_mut() {
            (jet.opening_delay_s, jet.closing_delay_s) = (0.006, 0.004);
        }
        let mut recording = Recording { jet_pulses: vec![Vec::new(); 12], ..Recording::default() };
        // Gas flows from 0.106 to 0.124 s; of the other jet's pulse none does.
        recording.jet_pulses[0].push(OnInterval { on_s: 0.1, off_s: 0.12 });
        recording.jet_pulses[1].push(OnInterval { on_s: 0.1, off_s: 0.101 });
        for (time_s, torque_n_m) in [(0.0, 0.1), (0.11, 0.2), (0.13, 0.4)] {
            recording.wheel_torque_command_n_m.time_s.push(time_s);
            recording.wheel_torque_command_n_m.value.push(vec![torque_n_m, 0.0, -torque_n_m]);
        }
        let gyrostat = Gyrostat::new(&model).unwrap();
        let commands = Commands::of(&recording, &gyrostat);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        let mean = commands.mean_between(0.1, 0.12);
        near(mean.valve_fraction[0], 0.7);
        assert_eq!(mean.valve_fraction[1], 0.0);
        near(mean.wheel_torque_n_m[0], 0.15);
        near(mean.wheel_torque_n_m[2], -0.15);
        let mean = commands.mean_between(0.12, 0.14);
        near(mean.valve_fraction[0], 0.2);
        near(mean.wheel_torque_n_m[0], 0.3);
    }
}
