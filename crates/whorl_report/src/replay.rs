//! The recording as frames: what the three-dimensional view shows at each instant.

use nalgebra::{UnitQuaternion, Vector3};
use serde::Serialize;
use serde_json::{Value, json};
use whorl_math::deg_from_rad;
use whorl_msgs::whorl::ControlStatus;

use crate::data::RunData;
use crate::events::mode_name;
use crate::platform::PlatformData;
use crate::times::Recorded;

/// A sample older than this is not shown any more \[s\].
const STALE_S: f64 = 1.0;

/// Where a bearing stops.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TiltLimit {
    /// `cone`: angle between body z and the vertical; `pitch`: elevation of body x.
    pub kind: String,
    /// Largest angle \[rad\].
    pub max_rad: f64,
}

/// A direction that a body axis must stay away from.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct KeepOut {
    /// Axis of the cone, world axes.
    pub direction_world: [f64; 3],
    /// Half angle of the cone \[rad\].
    pub half_angle_rad: f64,
}

/// A jet.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JetShape {
    /// Where it is, body axes \[m\].
    pub position_m: [f64; 3],
    /// Direction of its force on the platform, body axes.
    pub force_direction: [f64; 3],
}

/// What is drawn of a platform besides its state, and limits that its figures show.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlatformShape {
    /// Its name.
    pub name: String,
    /// Where its bearing stops, if known.
    pub tilt: Option<TiltLimit>,
    /// The axis that is pointed, body axes.
    pub boresight: [f64; 3],
    /// Where the boresight must not point.
    pub keep_out: Option<KeepOut>,
    /// In the order of every per-jet array in messages.
    pub jets: Vec<JetShape>,
    /// Largest momentum of a wheel \[N m s\]: the length of the drawn arrow.
    pub momentum_max_n_m_s: Option<f64>,
    /// Largest speed of a wheel \[rad/s\].
    pub wheel_speed_max_rad_s: Option<f64>,
}

impl PlatformShape {
    /// A platform of which nothing is known but its name: its boresight is taken to be body x.
    #[must_use]
    pub fn unknown(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            tilt: None,
            boresight: [1.0, 0.0, 0.0],
            keep_out: None,
            jets: Vec::new(),
            momentum_max_n_m_s: None,
            wheel_speed_max_rad_s: None,
        }
    }
}

/// The frames of a run as the page's script reads them: integers as differences to the one before, `null` where
/// nothing is known.
pub(crate) fn stored(run: &RunData, shapes: &[PlatformShape]) -> Value {
    let (step_s, frames) = (run.grid.step_s(), run.grid.frames());
    let times: Vec<f64> = (0..frames).map(|i| i as f64 * step_s).collect();
    let shapes: Vec<PlatformShape> = run
        .platforms
        .keys()
        .map(|name| {
            shapes.iter().find(|s| &s.name == name).cloned().unwrap_or_else(|| PlatformShape::unknown(name))
        })
        .collect();
    let begun = run.formation.iter().find(|s| s.message.run_elapsed_s > 0.0);
    json!({
        "shapes": shapes,
        "step_s": step_s,
        "frames": frames,
        "begin_s": begun.map_or(0.0, |s| s.stamp_s),
        "steps": crate::timeline::steps(run),
        "platforms": run.platforms.iter().map(|(name, data)| platform(run, name, data, &times)).collect::<Vec<_>>(),
    })
}

fn platform(run: &RunData, name: &str, data: &PlatformData, times: &[f64]) -> Value {
    let frames = &data.frames;
    let momentum = |axis: usize| frames.iter().map(move |f| f.momentum_and_gas.map(|(h, _)| h[axis]));
    let index = |m: &whorl_msgs::whorl::FormationState| m.platforms.iter().position(|p| p == name);
    let formation = Latest::new(&run.formation);
    let of_formation = |value: fn(&whorl_msgs::whorl::FormationState, usize) -> Option<f64>, scale: f64| {
        coded(times.iter().map(|t| formation.at(*t).and_then(|m| value(m, index(m)?))), scale)
    };
    json!({
        "q": quaternions(frames.iter().map(|f| f.q_world_body)),
        "ref": quaternions(frames.iter().map(|f| f.q_world_reference)),
        "h": (0..3).map(|axis| coded(momentum(axis), 1e3)).collect::<Vec<_>>(),
        "jets": jets(data, run.grid.step_s()),
        "error_mdeg": of_formation(|m, i| m.relative_error_rad.get(i).map(|e| deg_from_rad(Vector3::from(*e).norm())), 1e3),
        "link_ms": of_formation(|m, i| m.link_age_s.get(i).copied(), 1e3),
        "gas_mg": coded(frames.iter().map(|f| f.momentum_and_gas.map(|(_, gas_kg)| gas_kg)), 1e6),
        "modes": modes(data),
    })
}

/// Components w, x, y, z of the attitudes, of continuous sign, as integers of 1e-5.
fn quaternions(attitudes: impl Iterator<Item = Option<UnitQuaternion<f64>>>) -> Vec<Vec<Option<i64>>> {
    let mut before: Option<UnitQuaternion<f64>> = None;
    let samples: Vec<Option<[f64; 4]>> = attitudes
        .map(|q| {
            let q = q?;
            let opposite = before.is_some_and(|b| b.coords.dot(&q.coords) < 0.0);
            let q = if opposite { UnitQuaternion::new_unchecked(-q.into_inner()) } else { q };
            before = Some(q);
            Some([q.w, q.i, q.j, q.k])
        })
        .collect();
    (0..4).map(|i| coded(samples.iter().map(|s| s.map(|s| s[i])), 1e5)).collect()
}

/// Share of each frame over which each valve was open, in hundredths.
fn jets(data: &PlatformData, step_s: f64) -> Vec<Vec<Option<i64>>> {
    (0..data.jets.len())
        .map(|jet| {
            let total = |i: usize| data.frames.get(i)?.on_time_s.as_ref()?.get(jet).copied();
            let shares =
                (0..data.frames.len()).map(|i| Some(((total(i + 1)? - total(i)?) / step_s).clamp(0.0, 1.0)));
            coded(shares, 100.0)
        })
        .collect()
}

/// When the mode changed \[s\], to which, and whether that is a response to a fault.
fn modes(data: &PlatformData) -> Vec<(f64, &'static str, bool)> {
    let mut list: Vec<(f64, &'static str, bool)> = Vec::new();
    for (time_s, (mode, _)) in &data.modes {
        let name = mode_name(*mode);
        if list.last().is_none_or(|(_, last, _)| *last != name) {
            list.push((*time_s, name, alarming(*mode)));
        }
    }
    list
}

/// Whether a mode is a response to a fault.
#[must_use]
pub fn alarming(mode: u8) -> bool {
    !matches!(mode, ControlStatus::MODE_IDLE | ControlStatus::MODE_TRACK | ControlStatus::MODE_EXCITE)
}

/// Scaled, rounded, and less the one before.
fn coded(values: impl Iterator<Item = Option<f64>>, scale: f64) -> Vec<Option<i64>> {
    let mut before = 0_i64;
    values
        .map(|value| {
            let now = (value.filter(|v| v.is_finite())? * scale).round() as i64;
            Some(now - std::mem::replace(&mut before, now))
        })
        .collect()
}

/// The latest message at a time, unless it is stale.
struct Latest<'a, T>(&'a [Recorded<T>]);

impl<'a, T> Latest<'a, T> {
    fn new(messages: &'a [Recorded<T>]) -> Self {
        Self(messages)
    }

    fn at(&self, time_s: f64) -> Option<&'a T> {
        let after = self.0.partition_point(|m| m.stamp_s <= time_s);
        let latest = self.0.get(after.checked_sub(1)?)?;
        (time_s - latest.stamp_s <= STALE_S).then_some(&latest.message)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the page's script does with the differences.
    fn decoded(steps: &[Option<i64>], scale: f64) -> Vec<Option<f64>> {
        let mut at = 0;
        let mut next = |d: i64| {
            at += d;
            at as f64 / scale
        };
        steps.iter().map(|d| d.map(&mut next)).collect()
    }

    #[test]
    fn frames_hold_what_was_recorded_across_gaps() {
        let values = [Some(0.5), None, Some(f64::NAN), Some(-0.25), Some(-0.25)];
        let steps = coded(values.into_iter(), 100.0);
        assert_eq!(decoded(&steps, 100.0), [Some(0.5), None, None, Some(-0.25), Some(-0.25)]);
    }

    #[test]
    fn attitudes_keep_their_sign_through_a_full_turn() {
        let turn = |t: f64| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), t);
        let times: Vec<f64> = (0..69).map(|i| f64::from(i) * 0.1).collect();
        // Of whatever sign: both are the same attitude.
        let attitudes = times.iter().enumerate().map(|(i, t)| {
            let q = turn(*t);
            Some(if i % 3 == 1 { UnitQuaternion::new_unchecked(-q.into_inner()) } else { q })
        });
        let parts: Vec<Vec<Option<f64>>> = quaternions(attitudes).iter().map(|p| decoded(p, 1e5)).collect();
        for (i, t) in times.iter().enumerate() {
            // Half the angle of rotation, in closed form; it passes pi without a jump.
            assert!((parts[0][i].unwrap() - (t / 2.0).cos()).abs() < 2e-5, "{t}");
            assert!((parts[3][i].unwrap() - (t / 2.0).sin()).abs() < 2e-5, "{t}");
        }
    }
}
