//! A second-order reference model on SO(3).
//!
//! A follower's goal comes from another platform's estimate: noisy, late, and free to jump when a link
//! returns. The filter turns it into a reference with bounded rate and acceleration and with rate and
//! acceleration that belong to its attitude (J. A. Farrell, M. Polycarpou, M. Sharma, W. Dong, "Command
//! filtered backstepping", IEEE Trans. Automatic Control 54(6), 2009, section II-C, transferred to the
//! rotation group).
//!
//! With `e` the rotation vector from the filter's to the goal's attitude, all in the filter's axes:
//!
//! ```text
//! omega_c   = sat_rate( omega_g + e/|e| min( w/(2 z) |e|, sqrt(a |e|) ) )
//! omega_dot = sat_acceleration( 2 z w (omega_c - omega) + omega_dot_g - omega x omega_g )
//! ```
//!
//! Unsaturated and near the goal this is `e'' + 2 z w e' + w^2 e = 0` with full feed-forward: no lag
//! behind a goal whose rate and acceleration are given. The square root makes the filter start to brake in time at
//! half its acceleration limit, so a jump is answered without overshoot.

use nalgebra::{UnitQuaternion, Vector3};
use thiserror::Error;
use whorl_math::{integrate_rate, rotation_vector};

use super::extrapolation::limited;
use super::{Reference, TiltEnvelope};

/// Longest time that one step may bridge \[s\]; after a longer pause the filter goes on from where
/// it was.
const LONGEST_STEP_S: f64 = 1.0;

/// Settings of the filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CommandFilterSettings {
    /// Natural frequency w \[rad/s\], > 0.
    pub bandwidth_rad_s: f64,
    /// Damping ratio z, > 0; 1 for no overshoot.
    pub damping: f64,
    /// Largest rate of the filtered reference \[rad/s\], > 0.
    pub max_rate_rad_s: f64,
    /// Largest angular acceleration of the filtered reference \[rad/s^2\], > 0.
    pub max_acceleration_rad_s2: f64,
}

/// A setting that is not positive and finite.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("command filter: {field} = {value} must be positive and finite")]
pub struct CommandFilterError {
    /// The field.
    pub field: &'static str,
    /// Its value.
    pub value: f64,
}

/// The filter.
#[derive(Debug, Clone, PartialEq)]
pub struct CommandFilter {
    settings: CommandFilterSettings,
    state: Reference,
}

impl CommandFilter {
    /// Starts from a reference, usually at rest at the platform's current attitude.
    ///
    /// # Errors
    /// [`CommandFilterError`] naming the first setting that is not positive and finite.
    pub fn new(settings: CommandFilterSettings, start: Reference) -> Result<Self, CommandFilterError> {
        for (field, value) in [
            ("bandwidth_rad_s", settings.bandwidth_rad_s),
            ("damping", settings.damping),
            ("max_rate_rad_s", settings.max_rate_rad_s),
            ("max_acceleration_rad_s2", settings.max_acceleration_rad_s2),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(CommandFilterError { field, value });
            }
        }
        Ok(Self { settings, state: start })
    }

    /// The current filtered reference.
    #[must_use]
    pub fn reference(&self) -> &Reference {
        &self.state
    }

    /// Restarts from a reference.
    pub fn restart(&mut self, start: Reference) {
        self.state = start;
    }

    /// Moves on by `dt_s` towards a goal that is valid at the end of the step. True when goal or
    /// result had to be clipped into the envelope.
    ///
    /// A goal that is not finite is taken as "come to rest here". A step is at most one second
    /// long; a `dt_s` that is not positive changes nothing.
    pub fn step(&mut self, goal: &Reference, dt_s: f64, envelope: &TiltEnvelope) -> bool {
        if dt_s.is_nan() || dt_s <= 0.0 {
            return false;
        }
        let dt_s = dt_s.min(LONGEST_STEP_S);
        let goal = if goal.is_finite() { *goal } else { Reference::at_rest(self.state.q_world_reference) };
        let (goal, mut clipped) = envelope.clip_reference(&goal);
        // Semi-implicit integration is accurate while 2 z w dt stays well below one.
        let stiffness = 2.0 * self.settings.damping.max(1.0) * self.settings.bandwidth_rad_s * dt_s;
        let substeps = (stiffness * 10.0).ceil().clamp(1.0, 1000.0) as u32;
        let substep_s = dt_s / f64::from(substeps);
        for k in 0..substeps {
            // The goal at the beginning of the substep, where the state stands.
            let ahead_s = dt_s - f64::from(k) * substep_s;
            clipped |= self.substep(&goal.extrapolated(-ahead_s), substep_s, envelope);
        }
        clipped
    }

    fn substep(&mut self, goal: &Reference, dt_s: f64, envelope: &TiltEnvelope) -> bool {
        let s = &self.settings;
        let omega = self.state.omega_wr_r_rad_s;
        let q_filter_goal = self.state.q_world_reference.inverse() * goal.q_world_reference;
        let error = rotation_vector(&q_filter_goal);
        let angle = error.norm();
        let omega_goal = q_filter_goal * goal.omega_wr_r_rad_s;

        let linear = 0.5 * s.bandwidth_rad_s / s.damping;
        let approach_per_rad = if angle > f64::MIN_POSITIVE {
            // Braking at half the limit: sqrt(2 (a/2) angle).
            linear.min((s.max_acceleration_rad_s2 / angle).sqrt())
        } else {
            linear
        };
        let omega_commanded = limited(omega_goal + error * approach_per_rad, s.max_rate_rad_s);
        let feed_forward = q_filter_goal * goal.omega_dot_wr_r_rad_s2 - omega.cross(&omega_goal);
        let acceleration = limited(
            (omega_commanded - omega) * (2.0 * s.damping * s.bandwidth_rad_s) + feed_forward,
            s.max_acceleration_rad_s2,
        );
        let omega_next = limited(omega + acceleration * dt_s, s.max_rate_rad_s);
        let next = Reference {
            // The mean rate over the step: second order.
            q_world_reference: self.moved(&((omega + omega_next) * 0.5), dt_s),
            omega_wr_r_rad_s: omega_next,
            omega_dot_wr_r_rad_s2: (omega_next - omega) / dt_s,
        };
        let (next, clipped) = envelope.clip_reference(&next);
        self.state = next;
        clipped
    }

    fn moved(&self, rate_rad_s: &Vector3<f64>, dt_s: f64) -> UnitQuaternion<f64> {
        integrate_rate(&self.state.q_world_reference, rate_rad_s, dt_s)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tilt::tests::{dumbbell, tabletop};
    use super::*;
    use whorl_math::{attitude_error, quaternion_exp};

    const DT_S: f64 = 0.02;

    fn settings() -> CommandFilterSettings {
        CommandFilterSettings {
            bandwidth_rad_s: 2.0,
            damping: 1.0,
            max_rate_rad_s: 0.1,
            max_acceleration_rad_s2: 0.05,
        }
    }

    fn yaw(angle_rad: f64) -> UnitQuaternion<f64> {
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad)
    }

    fn at_identity() -> CommandFilter {
        CommandFilter::new(settings(), Reference::at_rest(UnitQuaternion::identity())).unwrap()
    }

    #[test]
    fn a_small_step_is_answered_as_by_the_linear_model() {
        let mut filter = at_identity();
        let size = 0.002; // small enough to stay unsaturated
        let goal = Reference::at_rest(yaw(size));
        for k in 1..=200 {
            filter.step(&goal, DT_S, &dumbbell());
            let t = f64::from(k) * DT_S;
            let expected = size * (1.0 - (1.0 + 2.0 * t) * (-2.0 * t).exp());
            let angle = filter.reference().q_world_reference.angle();
            assert!((angle - expected).abs() < 0.04 * size, "{t}: {angle} {expected}");
        }
    }

    #[test]
    fn a_jump_is_taken_within_the_limits_and_without_overshoot() {
        let mut filter = at_identity();
        let goal = Reference::at_rest(yaw(1.0));
        let mut previous = *filter.reference();
        let mut arrived_s = f64::NAN;
        for k in 1..=2000 {
            filter.step(&goal, DT_S, &tabletop());
            let now = *filter.reference();
            assert!(now.omega_wr_r_rad_s.norm() <= 0.1 + 1e-12);
            let acceleration = (now.omega_wr_r_rad_s - previous.omega_wr_r_rad_s) / DT_S;
            assert!(acceleration.norm() <= 0.05 + 1e-9);
            let error = attitude_error(&goal.q_world_reference, &now.q_world_reference).z;
            assert!(error < 2e-3, "overshoot {error}");
            if arrived_s.is_nan() && error.abs() < 0.01 {
                arrived_s = f64::from(k) * DT_S;
            }
            previous = now;
        }
        // The unsmoothed time-optimal trapezoid takes 1/0.1 + 0.1/0.05 = 12 s.
        assert!(arrived_s < 16.0, "{arrived_s}");
        assert!(attitude_error(&goal.q_world_reference, &previous.q_world_reference).norm() < 1e-6);
    }

    #[test]
    fn a_steadily_moving_goal_is_followed_without_lag() {
        let mut filter = at_identity();
        let start = Reference {
            q_world_reference: yaw(0.05),
            omega_wr_r_rad_s: Vector3::new(0.0, 0.0, 0.06),
            omega_dot_wr_r_rad_s2: Vector3::zeros(),
        };
        for k in 1..=1500 {
            filter.step(&start.extrapolated(f64::from(k) * DT_S), DT_S, &tabletop());
        }
        let goal = start.extrapolated(30.0);
        let lag = attitude_error(&goal.q_world_reference, &filter.reference().q_world_reference).norm();
        assert!(lag < 1e-5, "{lag}");
    }

    #[test]
    fn noise_of_the_goal_is_attenuated() {
        let mut filter = at_identity();
        // A square wave at the Nyquist rate stands for noise: the worst case except for the filter's own band.
        let mut worst = 0.0_f64;
        for k in 0..2000 {
            let goal = Reference::at_rest(yaw(if k % 2 == 0 { 1e-3 } else { -1e-3 }));
            filter.step(&goal, DT_S, &tabletop());
            if k > 500 {
                worst = worst.max(filter.reference().q_world_reference.angle());
            }
        }
        assert!(worst < 2e-6, "{worst}");
    }

    #[test]
    fn the_result_never_leaves_the_envelope() {
        let mut filter = at_identity();
        let lean = |tilt: f64, towards: f64| {
            quaternion_exp(&(Vector3::new(towards.cos(), towards.sin(), 0.0) * tilt)) * yaw(2.0 * towards)
        };
        let mut clipped = false;
        for k in 0..3000 {
            let goal = Reference::at_rest(lean(0.12, f64::from(k / 1000) * 1.5));
            clipped |= filter.step(&goal, DT_S, &tabletop());
            assert!(
                tabletop().angle_rad(&filter.reference().q_world_reference) < tabletop().max_rad() + 1e-9
            );
        }
        assert!(clipped);
    }

    #[test]
    fn bad_goals_and_times_do_no_harm() {
        let mut filter = at_identity();
        filter.step(&Reference::at_rest(yaw(0.5)), 1e9, &tabletop());
        let mut bad = Reference::at_rest(yaw(0.1));
        bad.omega_wr_r_rad_s.x = f64::NAN;
        for _ in 0..2000 {
            filter.step(&bad, DT_S, &tabletop());
        }
        assert!(filter.reference().is_finite());
        assert!(filter.reference().omega_wr_r_rad_s.norm() < 1e-6);
        let before = filter.clone();
        assert!(!filter.step(&Reference::at_rest(yaw(0.1)), f64::NAN, &tabletop()));
        assert_eq!(filter, before);
        assert!(
            CommandFilter::new(CommandFilterSettings { damping: 0.0, ..settings() }, *before.reference())
                .is_err()
        );
    }
}
