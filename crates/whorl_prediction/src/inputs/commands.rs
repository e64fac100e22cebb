//! Commands of a run, as the model's actuators receive them.

use std::borrow::Cow;

use nalgebra::Vector3;
use whorl_dynamics::plant::MeanInputs;
use whorl_dynamics::platform::SensorSuite;
use whorl_dynamics::{Gyrostat, Plant};
use whorl_recording::{Recording, Series};

use crate::inputs::driven_speeds::DrivenSpeeds;
use crate::inputs::wheel_torque;

/// Commands of a run in order of time.
#[derive(Debug, Clone, PartialEq)]
pub struct Commands<'a> {
    wheel_torque_n_m: Cow<'a, Series<Vec<f64>>>,
    body_torque_b_n_m: &'a Series<Vector3<f64>>,
    /// Per jet: opening and closing of the flow, delays and lag included \[s\].
    flow: Vec<Vec<(f64, f64)>>,
    /// All commands to the plant in order: time and command.
    events: Vec<(i64, Event)>,
    /// Whether the wheels' torques were derived from their speeds.
    pub wheel_torque_from_speed: bool,
}

/// A command.
#[derive(Debug, Clone, PartialEq)]
enum Event {
    /// By its position in the series.
    Wheels(usize),
    Jet {
        jet: usize,
        on_time_s: f64,
    },
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
        let wheel_torque_n_m = match driven {
            Some(speeds) => Cow::Owned(wheel_torque::from_speeds(recording, speeds, model)),
            None => Cow::Borrowed(&recording.wheel_torque_command_n_m),
        };
        let (ballast, body) = (&recording.ballast_moment_b_n_m, &recording.body_torque_b_n_m);
        let mut events: Vec<(i64, Event)> = Vec::new();
        let of_wheels = wheel_torque_n_m.time_s.iter().zip(&wheel_torque_n_m.value).enumerate();
        events.extend(of_wheels.map(|(k, (t, _))| (ns(*t), Event::Wheels(k))));
        events.extend(ballast.time_s.iter().zip(&ballast.value).map(|(t, x)| (ns(*t), Event::Ballast(*x))));
        events.extend(body.time_s.iter().zip(&body.value).map(|(t, x)| (ns(*t), Event::Torque(*x))));
        let (angles, rates) = (&recording.gimbal_angle_rad, &recording.gimbal_rate_rad_s);
        for (k, (t, angle_rad)) in angles.time_s.iter().zip(&angles.value).enumerate() {
            let next =
                angles.time_s.get(k + 1).zip(angles.value.get(k + 1)).filter(|(next_s, _)| *next_s > t);
            let rate_rad_s = match next {
                Some((next_s, next)) => {
                    angle_rad.iter().zip(next).map(|(from, to)| (to - from) / (next_s - t)).collect()
                }
                None => {
                    let last = rates.time_s.partition_point(|rate_s| rate_s <= t).saturating_sub(1);
                    rates.value.get(last).cloned().unwrap_or_else(|| vec![0.0; angle_rad.len()])
                }
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
            for pulse in pulses {
                events.push((ns(pulse.on_s), Event::Jet { jet, on_time_s: pulse.off_s - pulse.on_s }));
            }
        }
        events.sort_by_key(|(time_ns, _)| *time_ns);
        let wheel_torque_from_speed = driven.is_some();
        Self { wheel_torque_n_m, body_torque_b_n_m: body, flow, events, wheel_torque_from_speed }
    }

    /// When an event is due \[ns\].
    pub(crate) fn event_ns(&self, event: usize) -> Option<i64> {
        self.events.get(event).map(|(t, _)| *t)
    }

    /// Passes the command to the plant. Refusals (a pulse too short for its valve) are ignored: the hardware would
    /// refuse it too.
    pub(crate) fn tell(&self, event: usize, plant: &mut Plant) {
        let now_ns = plant.now_ns();
        let Some((start_ns, event)) = self.events.get(event) else { return };
        let _ = match event {
            Event::Wheels(k) => plant.command_wheels(&self.wheel_torque_n_m.value[*k]).is_ok(),
            Event::Jet { jet, on_time_s } => {
                plant.command_jet_pulse(*jet, (*start_ns).max(now_ns), *on_time_s).is_ok()
            }
            Event::Gimbals(angle_rad, rate_rad_s) => plant.move_gimbals_along(angle_rad, rate_rad_s).is_ok(),
            Event::Ballast(moment_b_n_m) => {
                plant.set_ballast_moment(*moment_b_n_m);
                true
            }
            Event::Torque(torque_b_n_m) => {
                plant.set_body_torque(*torque_b_n_m);
                true
            }
        };
    }

    /// Advances a plant; false where its motion is lost. A command of the very instant comes after what is read
    /// then: a controller answers to a reading, never before it.
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
    use whorl_dynamics::PlatformModel;
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
        let commands = Commands::along(&recording, &gyrostat, None);
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
