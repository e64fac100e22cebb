//! A pass in the laboratory: orbit time becomes laboratory time, attitudes become those of platforms that can
//! tilt only so far. What platforms cannot do is reported before anything moves; nothing is clipped.
//!
//! # The mapping
//!
//! 1. The laboratory's vertical is the mean direction of all body z axes over the pass; its heading 0 is where
//!    the first spacecraft's body x axis points in the middle of the pass. One rotation for all, so
//!    relative attitudes are those in orbit. What a pass sweeps is then mostly yaw, which is free.
//! 2. One laboratory second is `time_ratio` seconds of orbit.
//! 3. `geometry_scale` g shrinks every rotation from the mid-pass frame R: `q = R exp(g log(R^-1 q))`; 1: none.
//! 4. The motion begins and ends at rest: the pass is entered and left within `ramp_s`, by a smooth change
//!    of the pace of time.

use nalgebra::{Matrix3, Rotation3, Unit, UnitQuaternion, Vector3};
use thiserror::Error;
use whorl_math::{EulerAngles, EulerSequence, quaternion_exp, rotation_vector, wrap_angle_rad};

use crate::flight::Flight;
use crate::pass::{Pass, PassError, Sight};

/// Laboratory time between two samples of the pass \[s\]; a spline runs through them.
const SAMPLE_S: f64 = 0.5;
/// Steps between samples at which limits are checked.
const CHECKS_PER_SAMPLE: usize = 5;

/// How the pass becomes motion of the platforms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mapping {
    /// Seconds of orbit in a second of the laboratory, > 0.
    pub time_ratio: f64,
    /// Share of every rotation that is shown, above 0 to 1.
    pub geometry_scale: f64,
    /// Time of the smooth beginning, and of the end \[s\], > 0.
    pub ramp_s: f64,
    /// Length of the motion in the laboratory, both ramps included \[s\].
    pub duration_s: f64,
}

/// What a platform can do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reach {
    /// Whether pitch alone is limited (dumbbell), or the angle of body z to the vertical (tabletop).
    pub pitch_only: bool,
    /// Largest of that \[rad\].
    pub tilt_max_rad: f64,
    /// Largest norm of the rates of yaw, pitch and roll \[rad/s\].
    pub rate_max_rad_s: f64,
    /// The same of their accelerations \[rad/s^2\].
    pub acceleration_max_rad_s2: f64,
}

/// Why a pass cannot be shown in the laboratory.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum LaboratoryError {
    /// The pass itself.
    #[error("{0}")]
    Pass(#[from] PassError),
    /// A number of the mapping.
    #[error("{name} = {value} must be {allowed}")]
    Number {
        /// Which.
        name: &'static str,
        /// As given.
        value: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// The body z axes have no mean.
    #[error("the spacecraft turn too far during the pass for one vertical: shorten it")]
    NoVertical,
    /// Beyond what a platform can do.
    #[error(
        "platform {platform} would need {what} {needed} at {time_s:.1} s of the motion ({orbit_s:.0} s of the pass), {allowed} at most: {advice}"
    )]
    Unreachable {
        /// Which, by index.
        platform: usize,
        /// Which limit.
        what: &'static str,
        /// What it would need, with its unit.
        needed: String,
        /// What it can do, with its unit.
        allowed: String,
        /// When, in the laboratory \[s\].
        time_s: f64,
        /// When, in orbit \[s\].
        orbit_s: f64,
        /// What helps.
        advice: &'static str,
    },
}

/// Yaw, pitch and roll of a platform over time: a spline with continuous acceleration.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    mapping: Mapping,
    angles_rad: Vec<Vector3<f64>>,
    curvatures_rad_s2: Vec<Vector3<f64>>,
}

/// Angles with their derivatives; x = yaw, y = pitch, z = roll.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AngleMotion {
    /// \[rad\].
    pub angles_rad: Vector3<f64>,
    /// \[rad/s\].
    pub rates_rad_s: Vector3<f64>,
    /// \[rad/s^2\].
    pub accelerations_rad_s2: Vector3<f64>,
}

impl Mapping {
    fn check(&self) -> Result<(), LaboratoryError> {
        let number = |name, value, allowed, good: bool| {
            if good { Ok(()) } else { Err(LaboratoryError::Number { name, value, allowed }) }
        };
        number(
            "time_ratio",
            self.time_ratio,
            "positive",
            self.time_ratio > 0.0 && self.time_ratio.is_finite(),
        )?;
        let scale = self.geometry_scale;
        number("geometry_scale", scale, "above 0, at most 1", scale > 0.0 && scale <= 1.0)?;
        number("ramp_s", self.ramp_s, "positive", self.ramp_s > 0.0 && self.ramp_s.is_finite())?;
        let long_enough = self.duration_s > 2.0 * self.ramp_s && self.duration_s.is_finite();
        number("duration_s", self.duration_s, "longer than both ramps", long_enough)
    }

    /// Seconds of orbit that are shown.
    #[must_use]
    pub fn orbit_span_s(&self) -> f64 {
        (self.duration_s - self.ramp_s) * self.time_ratio
    }

    /// Pace of the pass: time along it in laboratory seconds, with its first two derivatives.
    fn warp(&self, t_s: f64) -> (f64, f64, f64) {
        let (ramp, length) = (self.ramp_s, self.duration_s);
        let t = t_s.clamp(0.0, length);
        let rising = |t: f64| {
            let x = t / ramp;
            (ramp * (x * x * x - 0.5 * x.powi(4)), x * x * (3.0 - 2.0 * x), 6.0 * x * (1.0 - x) / ramp)
        };
        if t < ramp {
            rising(t)
        } else if t > length - ramp {
            let (left, pace, change) = rising(length - t);
            (length - ramp - left, pace, -change)
        } else {
            (t - 0.5 * ramp, 1.0, 0.0)
        }
    }
}

/// The motions of all platforms, checked against their limits.
///
/// # Errors
/// An invalid pass, or the first platform whose limit it exceeds, with the limit and the instant.
pub fn trajectories(
    pass: &Pass,
    mapping: &Mapping,
    reaches: &[Reach],
) -> Result<Vec<Trajectory>, LaboratoryError> {
    mapping.check()?;
    let samples = ((mapping.duration_s - mapping.ramp_s) / SAMPLE_S).ceil().max(2.0) as usize + 1;
    let step_s = (mapping.duration_s - mapping.ramp_s) / (samples - 1) as f64;
    let mut sights: Vec<Vec<Sight>> = Vec::with_capacity(samples);
    let flight = Flight::new(pass)?;
    for k in 0..samples {
        sights.push(flight.at(k as f64 * step_s * mapping.time_ratio)?);
    }
    let to_world = world_from_eci(&sights)?;
    let middle = sights.get(samples / 2).and_then(|s| s.first());
    let middle = middle.map_or_else(UnitQuaternion::identity, |s| to_world * s.pointing.q_eci_body);
    let mut trajectories = Vec::with_capacity(reaches.len());
    for (platform, reach) in reaches.iter().enumerate() {
        let mut angles_rad: Vec<Vector3<f64>> = Vec::with_capacity(samples);
        for instant in &sights {
            let Some(sight) = instant.get(platform) else { continue };
            let q = scaled(&middle, &(to_world * sight.pointing.q_eci_body), mapping.geometry_scale);
            let angles = EulerAngles::from_quaternion(&q, EulerSequence::E321).angles_rad;
            let previous = angles_rad.last().copied().unwrap_or_default();
            let unwrapped = |i: usize| previous[i] + wrap_angle_rad(angles[i] - previous[i]);
            angles_rad.push(Vector3::new(unwrapped(0), angles.y, unwrapped(2)));
        }
        let curvatures_rad_s2 = natural_spline(&angles_rad, step_s);
        let trajectory = Trajectory { mapping: *mapping, angles_rad, curvatures_rad_s2 };
        trajectory.check(platform, reach, samples * CHECKS_PER_SAMPLE)?;
        trajectories.push(trajectory);
    }
    Ok(trajectories)
}

fn scaled(middle: &UnitQuaternion<f64>, q: &UnitQuaternion<f64>, scale: f64) -> UnitQuaternion<f64> {
    if scale >= 1.0 {
        return *q;
    }
    middle * quaternion_exp(&(rotation_vector(&(middle.inverse() * q)) * scale))
}

fn world_from_eci(sights: &[Vec<Sight>]) -> Result<UnitQuaternion<f64>, LaboratoryError> {
    let all = || sights.iter().flatten().map(|s| s.pointing.q_eci_body);
    let count = all().count() as f64;
    let mean: Vector3<f64> = all().map(|q| q * Vector3::z()).sum::<Vector3<f64>>() / count.max(1.0);
    let up = Unit::try_new(mean, 0.3).ok_or(LaboratoryError::NoVertical)?.into_inner();
    let middle = sights.get(sights.len() / 2).and_then(|s| s.first());
    let ahead = middle.map_or_else(Vector3::x, |s| s.pointing.q_eci_body * Vector3::x());
    let level = ahead - up * up.dot(&ahead);
    let x = Unit::try_new(level, 1e-6).ok_or(LaboratoryError::NoVertical)?.into_inner();
    let to_eci = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, up.cross(&x), up]));
    Ok(UnitQuaternion::from_rotation_matrix(&to_eci.inverse()))
}

/// Second derivatives at the knots of the cubic spline whose curvature ends at zero.
fn natural_spline(values: &[Vector3<f64>], step_s: f64) -> Vec<Vector3<f64>> {
    let n = values.len();
    let mut curvatures = vec![Vector3::zeros(); n];
    if n < 3 {
        return curvatures;
    }
    // m[k-1] + 4 m[k] + m[k+1] = 6 (y[k-1] - 2 y[k] + y[k+1]) / h^2: Thomas's algorithm.
    let mut factors = vec![0.0; n];
    for k in 1..n - 1 {
        let right = (values[k - 1] - values[k] * 2.0 + values[k + 1]) * (6.0 / (step_s * step_s));
        let pivot = 4.0 - factors[k - 1];
        factors[k] = 1.0 / pivot;
        curvatures[k] = (right - curvatures[k - 1]) / pivot;
    }
    for k in (1..n - 1).rev() {
        let next = curvatures[k + 1];
        curvatures[k] -= next * factors[k];
    }
    curvatures
}

impl Trajectory {
    /// How long it lasts \[s\].
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.mapping.duration_s
    }

    /// The motion at a laboratory time; at rest before its beginning and after its end.
    #[must_use]
    pub fn at(&self, t_s: f64) -> AngleMotion {
        let (along_s, pace, change) = self.mapping.warp(t_s);
        let last = self.angles_rad.len().saturating_sub(1).max(1);
        let step_s = (self.mapping.duration_s - self.mapping.ramp_s) / last as f64;
        let k = ((along_s / step_s) as usize).min(last - 1);
        let knot = |list: &[Vector3<f64>], k: usize| list.get(k).copied().unwrap_or_default();
        let (y0, y1) = (knot(&self.angles_rad, k), knot(&self.angles_rad, k + 1));
        let (m0, m1) = (knot(&self.curvatures_rad_s2, k), knot(&self.curvatures_rad_s2, k + 1));
        let b = along_s / step_s - k as f64;
        let a = 1.0 - b;
        let h2 = step_s * step_s / 6.0;
        let value = y0 * a + y1 * b + (m0 * (a * a * a - a) + m1 * (b * b * b - b)) * h2;
        let slope =
            (y1 - y0) / step_s + (m1 * (3.0 * b * b - 1.0) - m0 * (3.0 * a * a - 1.0)) * (step_s / 6.0);
        let curvature = m0 * a + m1 * b;
        AngleMotion {
            angles_rad: value,
            rates_rad_s: slope * pace,
            accelerations_rad_s2: curvature * (pace * pace) + slope * change,
        }
    }

    /// Second of orbit at a laboratory time.
    #[must_use]
    pub fn orbit_time_s(&self, t_s: f64) -> f64 {
        self.mapping.warp(t_s).0 * self.mapping.time_ratio
    }

    fn check(&self, platform: usize, reach: &Reach, checks: usize) -> Result<(), LaboratoryError> {
        for k in 0..=checks {
            let time_s = self.mapping.duration_s * k as f64 / checks as f64;
            let motion = self.at(time_s);
            let orbit_s = self.orbit_time_s(time_s);
            let beyond = |what, needed: f64, allowed: f64, unit: &str, advice| {
                if needed <= allowed {
                    return Ok(());
                }
                let (needed, allowed) = (needed.to_degrees(), allowed.to_degrees());
                Err(LaboratoryError::Unreachable {
                    platform,
                    what,
                    needed: format!("{needed:.2} {unit}"),
                    allowed: format!("{allowed:.2} {unit}"),
                    time_s,
                    orbit_s,
                    advice,
                })
            };
            let (pitch, roll) = (motion.angles_rad.y, motion.angles_rad.z);
            let tilt = if reach.pitch_only {
                pitch.abs()
            } else {
                (pitch.cos() * roll.cos()).clamp(-1.0, 1.0).acos()
            };
            beyond("a tilt of", tilt, reach.tilt_max_rad, "deg", "lower geometry_scale or shorten the pass")?;
            beyond(
                "a rate of",
                motion.rates_rad_s.norm(),
                reach.rate_max_rad_s,
                "deg/s",
                "lower time_ratio or geometry_scale",
            )?;
            beyond(
                "an acceleration of",
                motion.accelerations_rad_s2.norm(),
                reach.acceleration_max_rad_s2,
                "deg/s^2",
                "lower time_ratio or lengthen ramp_s",
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::co_observation::Target;
    use crate::elements::Elements;
    use crate::formation::Formation;
    use crate::pass::{RelativeModel, WantedDeltaV};
    use crate::support;

    fn pass(thrust_weight: f64) -> Pass {
        let formation = Formation::ProjectedCircular { radius_m: 30e3, phase_rad: 1.0 };
        let pass = support::pass(RelativeModel::TwoBody, 0.0, formation, WantedDeltaV::RemoveDrift);
        Pass { thrust_weight, ..pass }
    }

    const MAPPING: Mapping = Mapping { time_ratio: 4.0, geometry_scale: 1.0, ramp_s: 10.0, duration_s: 90.0 };

    fn reaches() -> [Reach; 2] {
        let reach = |pitch_only, tilt: f64| Reach {
            pitch_only,
            tilt_max_rad: tilt.to_radians(),
            rate_max_rad_s: 4_f64.to_radians(),
            acceleration_max_rad_s2: 0.6_f64.to_radians(),
        };
        [reach(false, 4.0), reach(true, 28.0)]
    }

    #[test]
    fn relative_attitudes_are_those_in_orbit() {
        let pass = pass(0.0);
        let motions = trajectories(&pass, &MAPPING, &reaches()).unwrap();
        for k in 0..=90 {
            let t = f64::from(k);
            let sights = pass.at(motions[0].orbit_time_s(t)).unwrap();
            let q = |m: &Trajectory| {
                EulerAngles { sequence: EulerSequence::E321, angles_rad: m.at(t).angles_rad }.to_quaternion()
            };
            let laboratory = q(&motions[0]).inverse() * q(&motions[1]);
            let orbit = sights[0].pointing.q_eci_body.inverse() * sights[1].pointing.q_eci_body;
            assert!(laboratory.angle_to(&orbit) < 1e-6, "{t}: {}", laboratory.angle_to(&orbit));
        }
        // The pass sweeps yaw: 320 s of a 94 min orbit are 20 deg, and the line of sight a little more.
        let swept = (motions[0].at(90.0).angles_rad.x - motions[0].at(0.0).angles_rad.x).abs().to_degrees();
        assert!((swept - 320.0 / 5677.0 * 360.0).abs() < 1.0, "{swept}");
    }

    #[test]
    fn rates_and_accelerations_are_the_derivatives_and_vanish_at_both_ends() {
        let motion = &trajectories(&pass(0.0), &MAPPING, &reaches()).unwrap()[1];
        for k in 1..900 {
            let (t, h) = (f64::from(k) * 0.1, 1e-4);
            let (before, at, after) = (motion.at(t - h), motion.at(t), motion.at(t + h));
            let rate = (after.angles_rad - before.angles_rad) / (2.0 * h);
            assert!((rate - at.rates_rad_s).norm() < 1e-8);
            let acceleration = (after.rates_rad_s - before.rates_rad_s) / (2.0 * h);
            assert!((acceleration - at.accelerations_rad_s2).norm() < 1e-5, "{t}");
        }
        for t in [0.0, 90.0, 100.0] {
            assert!(motion.at(t).rates_rad_s.norm() < 1e-12);
        }
    }

    #[test]
    fn what_cannot_be_reached_is_said_with_what_helps() {
        let fast = Mapping { time_ratio: 100.0, ..MAPPING };
        let error = trajectories(&pass(0.0), &fast, &reaches()).unwrap_err().to_string();
        assert!(error.contains("platform 0") && error.contains("time_ratio"), "{error}");
        // The deputy looks across the chief's plane: no two platforms turn about exactly one axis.
        let [first, second] = reaches();
        let stiff = [Reach { tilt_max_rad: 1e-3, ..first }, Reach { tilt_max_rad: 1e-3, ..second }];
        let error = trajectories(&pass(0.0), &MAPPING, &stiff).unwrap_err().to_string();
        assert!(error.contains("tilt") && error.contains("geometry_scale"), "{error}");
        let horizon = Pass { target: Target::Point { latitude_rad: 0.0, longitude_rad: 3.0 }, ..pass(0.0) };
        assert!(
            trajectories(&horizon, &MAPPING, &reaches())
                .unwrap_err()
                .to_string()
                .contains("below the horizon")
        );
        let low = Pass { chief: Elements { semi_major_axis_m: 6.3e6, ..pass(0.0).chief }, ..pass(0.0) };
        assert!(
            trajectories(&low, &MAPPING, &reaches()).unwrap_err().to_string().contains("above the ground")
        );
        let scale = Mapping { geometry_scale: 0.0, ..MAPPING };
        assert!(trajectories(&pass(0.0), &scale, &reaches()).is_err());
    }
}
