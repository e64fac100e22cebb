//! The quantities on which a residual may depend.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_math::{azimuth_rad, vertical_b};
use whorl_prediction::SmoothedState;
use whorl_recording::{Channel, ChannelSeries, Component, Mounting, Recording};

/// A quantity at the residual's times.
#[derive(Debug, Clone, PartialEq)]
pub struct Variable {
    /// Name in answers and in JSON, such as `yaw_rate`.
    pub name: String,
    /// Unit.
    pub unit: &'static str,
    /// Its value at each time of the residual.
    pub value: Vec<f64>,
    /// The same for the second and the third axis, where each axis has a quantity of its own.
    pub of_other_axes: Option<[Vec<f64>; 2]>,
    /// Period, for angles; values then lie in -period/2..period/2.
    pub period: Option<f64>,
    /// Spread below which it counts as constant.
    pub resolution: f64,
}

impl Variable {
    /// Its values for an axis: 0, 1, 2.
    pub(super) fn of_axis(&self, axis: usize) -> &[f64] {
        let other = axis.checked_sub(1).zip(self.of_other_axes.as_ref()).and_then(|(k, of)| of.get(k));
        other.unwrap_or(&self.value)
    }

    /// A quantity that counts as constant when it stays within `resolution`.
    pub fn new(name: impl Into<String>, unit: &'static str, resolution: f64, value: Vec<f64>) -> Self {
        Self { name: name.into(), unit, value, of_other_axes: None, period: None, resolution }
    }
}

/// Standard deviations of a smoothed quantity within which it counts as constant.
const CONSTANT_STDDEVS: f64 = 4.0;
/// Share of a wheel's largest torque within which its command counts as constant.
const CONSTANT_COMMAND: f64 = 1e-3;

/// All quantities of a run at these instants: time; tilt, azimuth, rates and wheel speeds as they were smoothed, since noise would blur
/// sharp curves; the wheels' commands; every channel with a resolution (tank pressure, ...); time since the last jet edge.
/// What was not recorded is left out.
#[must_use]
pub fn conditions(recording: &Recording, model: &PlatformModel, states: &[SmoothedState]) -> Vec<Variable> {
    let time_s: Vec<f64> = states.iter().map(|state| state.time_s).collect();
    let wheels: Vec<&str> = model.wheels().iter().map(|wheel| wheel.name.as_str()).collect();
    let mut all = vec![Variable::new("time", "s", 1.0, time_s.clone())];
    if recording.mounting != Mounting::Clamped && model.freedom.turns() {
        all.extend(of_body(states));
    }
    for (j, (name, wheel)) in wheels.iter().zip(model.wheels()).enumerate() {
        if !recording.wheel_speed_rad_s.is_empty() {
            let number = |of: &[f64]| of.get(j).copied().unwrap_or(f64::NAN);
            let stddev = typical(states, |state| number(&state.wheel_speed_stddev_rad_s));
            let speed = states.iter().map(|state| number(&state.wheel_speed_rad_s)).collect();
            let name = Component::new(Channel::WheelSpeed, 0, j).name(&wheels);
            all.push(Variable::new(name, "rad/s", CONSTANT_STDDEVS * stddev, speed));
        }
        let resolution = CONSTANT_COMMAND * wheel.max_torque_n_m;
        let command = held(&recording.wheel_torque_command_n_m, &time_s, j);
        all.extend(command.map(|u| Variable::new(format!("{name}_torque_command"), "N m", resolution, u)));
    }
    for channel in
        Channel::ALL.iter().filter(|c| !matches!(c, Channel::WheelSpeed | Channel::WheelTorqueCommand))
    {
        let (Some(resolution), Some(series)) = (channel.info().resolution, recording.series(*channel, 0))
        else {
            continue;
        };
        for component in Component::of(*channel, 0, wheels.len()) {
            let value = held(series, &time_s, component.index());
            let name = component.name(&wheels);
            all.extend(value.map(|value| Variable::new(name, channel.unit(), resolution, value)));
        }
    }
    all.extend(time_since_jet_edge(recording, &time_s));
    all
}

/// Of each axis the rate about it: friction that acts about all of them.
pub(super) const RATE_ABOUT_SAME_AXIS: &str = "rate_about_the_same_axis";

/// Attitude and rate.
fn of_body(states: &[SmoothedState]) -> Vec<Variable> {
    let angle_rad = CONSTANT_STDDEVS * typical(states, |state| state.attitude_stddev_b_rad.max());
    let rate_rad_s = CONSTANT_STDDEVS * typical(states, |state| state.omega_stddev_b_rad_s.max());
    let all = |of: &dyn Fn(&SmoothedState) -> f64| -> Vec<f64> { states.iter().map(of).collect() };
    let of_vertical = |name: &str, f: fn(Vector3<f64>) -> f64| {
        Variable::new(name, "rad", angle_rad, all(&|state| f(vertical_b(&state.q_world_body))))
    };
    let of_rate = |name: &str, f: fn(&Vector3<f64>) -> f64| {
        Variable::new(name, "rad/s", rate_rad_s, all(&|state| f(&state.omega_wb_b_rad_s)))
    };
    let azimuth = all(&|state| azimuth_rad(&state.q_world_body));
    let of_other_axes = Some([1, 2].map(|i| all(&|state| state.omega_wb_b_rad_s[i])));
    vec![
        of_vertical("tilt", |k| k.x.hypot(k.y).atan2(k.z)),
        of_vertical("tilt_x", |k| k.y.atan2(k.z)),
        of_vertical("tilt_y", |k| (-k.x).atan2(k.z)),
        Variable { period: Some(TAU), ..Variable::new("azimuth", "rad", angle_rad, azimuth) },
        of_rate("roll_rate", |w| w.x),
        of_rate("pitch_rate", |w| w.y),
        of_rate("yaw_rate", |w| w.z),
        of_rate("rate_magnitude", Vector3::norm),
        Variable { of_other_axes, ..of_rate(RATE_ABOUT_SAME_AXIS, |w| w.x) },
    ]
}

/// Root mean square.
fn typical(states: &[SmoothedState], of: impl Fn(&SmoothedState) -> f64) -> f64 {
    (states.iter().map(|state| of(state).powi(2)).sum::<f64>() / states.len().max(1) as f64).sqrt()
}

/// A number of the series, held until the next sample; the first value before the first sample; `None` where it
/// was not recorded.
fn held(series: &dyn ChannelSeries, time_s: &[f64], index: usize) -> Option<Vec<f64>> {
    let at = |t: &f64| {
        let after = series.time_s().partition_point(|sample| sample <= t);
        series.number(after.saturating_sub(1), index)
    };
    time_s.iter().map(at).collect()
}

/// Time since a jet last switched on or off, limited to 1 s.
fn time_since_jet_edge(recording: &Recording, time_s: &[f64]) -> Option<Variable> {
    let mut edges: Vec<f64> =
        recording.jet_pulses.iter().flatten().flat_map(|pulse| [pulse.on_s, pulse.off_s]).collect();
    if edges.is_empty() {
        return None;
    }
    edges.sort_by(f64::total_cmp);
    let since = |t: &f64| {
        let before = edges.partition_point(|edge| edge <= t).checked_sub(1);
        before.and_then(|i| edges.get(i)).map_or(1.0, |edge| (t - edge).min(1.0))
    };
    Some(Variable::new("time_since_jet_edge", "s", 0.02, time_s.iter().map(since).collect()))
}
