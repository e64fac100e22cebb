//! A cap on what a platform tells its neighbours: it broadcasts when their extrapolation would be wrong.
//!
//! # Equations
//!
//! Sender and listeners carry the last broadcast on with its rate. The sender compares
//! that with its current motion and broadcasts again when the two differ by more than a trigger angle, or
//! when the last broadcast is older than the heartbeat; but never more often than the cap allows:
//!
//! ```text
//! speak  <=>  age >= 1/cap  and  ( |log(q_told(age)^-1 q)| > trigger  or  age >= heartbeat )
//! ```
//!
//! # Source
//! D. V. Dimarogonas, E. Frazzoli, K. H. Johansson, "Distributed event-triggered control for multi-agent
//! systems", IEEE Trans. Automatic Control 57(5), 2012. The traffic question: Schwartz 2004, section 2.4
//! (partially decentralised control; J. R. Carpenter).
//!
//! # Stability
//! The listeners' extrapolation is wrong by at most the trigger plus the departure of the motion from
//! its extrapolation within `1/cap`: a bounded disturbance of the law, whose linear part is exponentially
//! stable; the agreement is reached up to that bound over `1 - rho` of the graph.

use nalgebra::Vector3;
use whorl_math::attitude_error;

use super::{Allowed, LawError, Settings};
use crate::reference::Reference;

/// When a platform speaks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrafficCap {
    /// Broadcasts per second at most \[1/s\], > 0.
    pub rate_max_hz: f64,
    /// Listeners may be wrong by this much \[rad\], > 0.
    pub trigger_rad: f64,
    /// Speaks after this long in any case \[s\], > 0; tells listeners that it is alive.
    pub heartbeat_s: f64,
}

impl TrafficCap {
    /// `None`: no cap.
    pub(super) fn read(settings: &mut dyn Settings) -> Option<Self> {
        let rate_max_hz = settings.number_or(
            "rate_max_hz",
            0.0,
            Allowed::NON_NEGATIVE,
            "cap on a platform's broadcasts to its neighbours; 0: none, they hear everything [1/s]",
        );
        let trigger_rad = settings
            .number_or(
                "trigger_deg",
                0.1,
                Allowed::POSITIVE,
                "a platform speaks when its neighbours are wrong by this [deg]",
            )
            .to_radians();
        let heartbeat_s =
            settings.number_or("heartbeat_s", 1.0, Allowed::POSITIVE, "and after this long in any case [s]");
        (rate_max_hz > 0.0).then_some(Self { rate_max_hz, trigger_rad, heartbeat_s })
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// The first that is out of range.
    pub fn check(&self, law: &'static str) -> Result<(), LawError> {
        for (gain, value) in [
            ("traffic.rate_max_hz", self.rate_max_hz),
            ("traffic.trigger_rad", self.trigger_rad),
            ("traffic.heartbeat_s", self.heartbeat_s),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(LawError::Gain { law, gain, value, allowed: "positive and finite".into() });
            }
        }
        Ok(())
    }
}

/// A platform's last broadcast, as its neighbours extrapolate it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Told {
    motion: Reference,
    age_s: f64,
}

impl Told {
    /// The current extrapolation of the listeners.
    pub fn believed(&self) -> Reference {
        self.motion.extrapolated(self.age_s)
    }
}

/// Extrapolates `told` by `dt_s` and broadcasts if needed. Returns whether it did.
pub(super) fn update(told: &mut Option<Told>, motion: &Reference, dt_s: f64, cap: &TrafficCap) -> bool {
    let speaks = match told {
        None => true,
        Some(last) => {
            last.age_s += dt_s;
            // Half a step of tolerance: sums of steps are not exact.
            let allowed = last.age_s + 0.5 * dt_s >= 1.0 / cap.rate_max_hz;
            let wrong = attitude_error(&last.believed().q_world_reference, &motion.q_world_reference).norm();
            allowed && (wrong > cap.trigger_rad || last.age_s >= cap.heartbeat_s)
        }
    };
    if speaks {
        // A broadcast acceleration would be taken to last until the next broadcast.
        let motion = Reference { omega_dot_wr_r_rad_s2: Vector3::zeros(), ..*motion };
        *told = Some(Told { motion, age_s: 0.0 });
    }
    speaks
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    const CAP: TrafficCap = TrafficCap { rate_max_hz: 5.0, trigger_rad: 0.01, heartbeat_s: 1.0 };

    fn yaw(angle_rad: f64) -> UnitQuaternion<f64> {
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad)
    }

    fn count(seconds: f64, motion: impl Fn(f64) -> Reference) -> (u32, f64) {
        let (mut told, mut spoken, mut worst) = (None, 0, 0.0_f64);
        let steps = (seconds / 0.02).round() as u32;
        for k in 0..steps {
            let now = motion(f64::from(k) * 0.02);
            spoken += u32::from(update(&mut told, &now, 0.02, &CAP));
            let believed = told.unwrap().believed().q_world_reference;
            worst = worst.max(attitude_error(&believed, &now.q_world_reference).norm());
        }
        (spoken, worst)
    }

    #[test]
    fn a_steady_turn_needs_the_heartbeat_only() {
        let omega = Vector3::new(0.0, 0.0, 0.05);
        let (spoken, worst) =
            count(10.0, |t| Reference { omega_wr_r_rad_s: omega, ..Reference::at_rest(yaw(0.05 * t)) });
        assert!((10..=11).contains(&spoken), "{spoken}");
        assert!(worst < 1e-9);
    }

    #[test]
    fn jumps_are_told_at_the_cap_and_no_faster() {
        // A square wave of 0.1 rad at 4 Hz is too fast for 5 broadcasts a second.
        let (spoken, _) = count(10.0, |t| Reference::at_rest(yaw(0.1 * (t * 8.0).floor().rem_euclid(2.0))));
        assert!(spoken <= 51, "{spoken}");
        assert!(spoken > 20, "{spoken}");
    }

    #[test]
    fn slow_drift_without_a_rate_is_told_at_every_trigger() {
        // 0.02 rad/s unannounced: a broadcast every 0.5 s.
        let (spoken, worst) = count(20.0, |t| Reference::at_rest(yaw(0.02 * t)));
        assert!((38..=42).contains(&spoken), "{spoken}");
        assert!(worst <= 0.01 + 0.02 * 0.02 + 1e-9, "{worst}");
    }
}
