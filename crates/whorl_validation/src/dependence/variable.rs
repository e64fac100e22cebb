//! The recorded quantities on which a residual may depend.

use std::f64::consts::TAU;

use nalgebra::{UnitQuaternion, Vector3};
use whorl_math::{azimuth_rad, vertical_b};
use whorl_recording::{Channel, ChannelSeries, Component, Recording};

/// A quantity at the residual's times.
#[derive(Debug, Clone, PartialEq)]
pub struct Variable {
    /// Name in answers and in JSON, such as `yaw_rate`.
    pub name: String,
    /// Unit.
    pub unit: &'static str,
    /// Its value at each time of the residual.
    pub value: Vec<f64>,
    /// Period, for angles; values then lie in -period/2..period/2.
    pub period: Option<f64>,
    /// Spread below which it counts as constant.
    pub resolution: f64,
}

impl Variable {
    /// A quantity that counts as constant when it stays within `resolution`.
    pub fn new(name: impl Into<String>, unit: &'static str, resolution: f64, value: Vec<f64>) -> Self {
        Self { name: name.into(), unit, value, period: None, resolution }
    }
}

/// All recorded quantities at the given times and attitudes: time, tilt, azimuth, rates, every channel with a
/// resolution (wheel speeds, tank pressure, ...), time since the last jet edge. Quantities that were not
/// recorded are left out.
///
/// `omega_wb_b_rad_s` is the body rate at those times, smoothed, since noise would blur sharp curves. `wheel_names` are
/// those of the platform.
#[must_use]
pub fn conditions(
    recording: &Recording,
    time_s: &[f64],
    q_world_body: &[UnitQuaternion<f64>],
    omega_wb_b_rad_s: &[Vector3<f64>],
    wheel_names: &[String],
) -> Vec<Variable> {
    let mut all = vec![Variable::new("time", "s", 1.0, time_s.to_vec())];
    let vertical: Vec<Vector3<f64>> = q_world_body.iter().map(vertical_b).collect();
    let of_vertical = |name: &str, f: &dyn Fn(&Vector3<f64>) -> f64| {
        Variable::new(name, "rad", 2e-3, vertical.iter().map(f).collect())
    };
    all.push(of_vertical("tilt", &|k| k.x.hypot(k.y).atan2(k.z)));
    all.push(of_vertical("tilt_x", &|k| k.y.atan2(k.z)));
    all.push(of_vertical("tilt_y", &|k| (-k.x).atan2(k.z)));
    all.push(Variable {
        period: Some(TAU),
        ..Variable::new("azimuth", "rad", 0.02, q_world_body.iter().map(azimuth_rad).collect())
    });
    let of_rate = |name: &str, f: &dyn Fn(&Vector3<f64>) -> f64| {
        Variable::new(name, "rad/s", 2e-3, omega_wb_b_rad_s.iter().map(f).collect())
    };
    all.push(of_rate("roll_rate", &|w| w.x));
    all.push(of_rate("pitch_rate", &|w| w.y));
    all.push(of_rate("yaw_rate", &|w| w.z));
    all.push(of_rate("rate_magnitude", &Vector3::norm));
    for channel in Channel::ALL {
        let (Some(resolution), Some(series)) = (channel.info().resolution, recording.series(*channel, 0))
        else {
            continue;
        };
        for component in Component::of(*channel, 0, wheel_names.len()) {
            let value = held(series, time_s, component.index());
            let name = component.name(wheel_names);
            all.extend(value.map(|value| Variable::new(name, channel.unit(), resolution, value)));
        }
    }
    all.extend(time_since_jet_edge(recording, time_s));
    all
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
