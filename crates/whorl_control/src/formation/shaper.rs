//! One platform's reference: follows any demand, within limits that are never exceeded.
//!
//! State: yaw, pitch, roll and their rates; in each step one acceleration is chosen and then held, so
//! the reference that is published (attitude, rate, acceleration) is exactly consistent until the next
//! step. Let `e` be the demand less the state, `v` the rates, `v_d`, `a_d` the demand's:
//!
//! ```text
//! v_c = sat_rate( v_d + e/|e| approach(|e|) ),   approach(d) = k1 d near, sqrt(2 a_b (d - a_b/(2 k1^2))) far
//! a   = sat_acceleration( a_d + k2 (v_c - v) ),  k1 = w/2, k2 = 2 w, a_b = 0.7 a_max
//! ```
//!
//! Unsaturated this is `e'' + 2 w e' + w^2 e = 0` (critically damped) with full feed-forward: no lag
//! behind a demand whose rate and acceleration are given.
//!
//! # The tilt limit holds by construction
//! The *stop point* is where the reference would come to rest, braking fully along its present rates:
//! `s = x + v |v| / (2 a_max) + v dt / 2`. State and stop point are kept inside the envelope: if the
//! chosen next rate would put either outside, it is mixed with full braking just enough. Full braking
//! leaves the stop point where it is (the last term covers the discrete last step), and the envelope
//! is convex in pitch and roll (a box for the dumbbell; for the tabletop
//! `ln cos pitch + ln cos roll >= ln cos max`, a superlevel set of a concave function), so that is
//! always possible, and the rate and acceleration limits hold at the same time. Clipping the result, as
//! [`crate::reference::CommandFilter`] does, would bound the tilt but not the acceleration.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_math::wrap_angle_rad;

use super::{LimitsError, MotionDemand, ReferenceLimits, YawPitchRoll, YawPitchRollMotion};
use crate::reference::Reference;
use whorl_dynamics::platform::TiltLimit;

/// Share of the acceleration limit that a planned approach uses; the rest follows the plan.
const APPROACH_SHARE: f64 = 0.7;
/// Halvings of the interval when a rate is mixed with braking: 2^-30 of the rate step.
const MIXING_STEPS: u32 = 30;
/// A demand counts as clipped when it lies beyond the limit by more than rounding \[rad\].
const CLIP_TOLERANCE_RAD: f64 = 1e-9;

/// Result of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shaped {
    /// The reference at this instant; its acceleration holds until the next step.
    pub reference: Reference,
    /// The demand lay outside the tilt limit.
    pub clipped: bool,
}

/// The shaper of one platform.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceShaper {
    limits: ReferenceLimits,
    bandwidth_rad_s: f64,
    /// Yaw, pitch, roll; yaw and roll unwrapped \[rad\].
    angles_rad: Vector3<f64>,
    rates_rad_s: Vector3<f64>,
    accelerations_rad_s2: Vector3<f64>,
}

impl ReferenceShaper {
    /// At rest at an attitude, or at the nearest allowed one. `bandwidth_rad_s` is that towards the
    /// demand, > 0 and well below the rate of steps.
    ///
    /// # Errors
    /// Invalid limits or bandwidth.
    pub fn new(
        limits: ReferenceLimits,
        bandwidth_rad_s: f64,
        q_world_body: &UnitQuaternion<f64>,
    ) -> Result<Self, LimitsError> {
        limits.check()?;
        if !(bandwidth_rad_s > 0.0 && bandwidth_rad_s.is_finite()) {
            return Err(LimitsError::NotPositive { name: "the bandwidth [rad/s]", value: bandwidth_rad_s });
        }
        let zero = Vector3::zeros();
        let mut shaper =
            Self { limits, bandwidth_rad_s, angles_rad: zero, rates_rad_s: zero, accelerations_rad_s2: zero };
        shaper.restart(q_world_body);
        Ok(shaper)
    }

    /// At rest at an attitude, or at the nearest allowed one.
    pub fn restart(&mut self, q_world_body: &UnitQuaternion<f64>) {
        let (inside, _) = self.limits.envelope.clip(q_world_body);
        self.angles_rad = YawPitchRoll::of(&inside).vector();
        self.rates_rad_s = Vector3::zeros();
        self.accelerations_rad_s2 = Vector3::zeros();
    }

    /// From the motion that a platform has, as far as the limits allow: a rate beyond them is
    /// lowered, and dropped where the platform could not stop in front of its tilt limit.
    pub fn restart_moving(
        &mut self,
        q_world_body: &UnitQuaternion<f64>,
        omega_wb_b_rad_s: &Vector3<f64>,
        dt_s: f64,
    ) {
        self.restart(q_world_body);
        let moving = Reference {
            omega_wr_r_rad_s: *omega_wb_b_rad_s,
            ..Reference::at_rest(YawPitchRoll::from_vector(self.angles_rad).attitude())
        };
        if moving.is_finite() {
            let rates_rad_s =
                limited(YawPitchRollMotion::of(&moving).rates_rad_s, self.limits.rate_max_rad_s);
            let stop = self.stop_point(&self.angles_rad, &rates_rad_s, dt_s);
            if self.tilt_rad(&stop) <= self.limits.envelope.max_rad() {
                self.rates_rad_s = rates_rad_s;
            }
        }
    }

    /// Changes limits while running. A state outside new limits comes back smoothly.
    ///
    /// # Errors
    /// Invalid limits or bandwidth; the old ones then stay.
    pub fn set_limits(&mut self, limits: ReferenceLimits, bandwidth_rad_s: f64) -> Result<(), LimitsError> {
        let mut changed = Self::new(limits, bandwidth_rad_s, &UnitQuaternion::identity())?;
        changed.angles_rad = self.angles_rad;
        changed.rates_rad_s = self.rates_rad_s;
        changed.accelerations_rad_s2 = self.accelerations_rad_s2;
        *self = changed;
        Ok(())
    }

    /// The limits.
    #[must_use]
    pub fn limits(&self) -> &ReferenceLimits {
        &self.limits
    }

    /// The motion in yaw, pitch and roll.
    #[must_use]
    pub fn motion(&self) -> YawPitchRollMotion {
        YawPitchRollMotion {
            angles: YawPitchRoll::from_vector(self.angles_rad),
            rates_rad_s: self.rates_rad_s,
            accelerations_rad_s2: self.accelerations_rad_s2,
        }
    }

    /// The reference at this instant.
    #[must_use]
    pub fn reference(&self) -> Reference {
        self.motion().reference()
    }

    /// Whether it stands still.
    #[must_use]
    pub fn at_rest(&self) -> bool {
        self.rates_rad_s == Vector3::zeros()
    }

    /// Moves on by `dt_s` (the one given to the latest [`Self::plan`]) with the planned acceleration.
    pub fn advance(&mut self, dt_s: f64) {
        if !(dt_s > 0.0 && dt_s.is_finite()) {
            return;
        }
        let next_rates = self.rates_rad_s + self.accelerations_rad_s2 * dt_s;
        self.angles_rad += (self.rates_rad_s + next_rates) * (0.5 * dt_s);
        // Braking ends at rest exactly, not at a rounding error.
        self.rates_rad_s = if next_rates.norm() < 1e-15 { Vector3::zeros() } else { next_rates };
    }

    /// Chooses the acceleration for the next `dt_s` > 0. A demand that is not finite is taken as
    /// [`MotionDemand::Hold`].
    pub fn plan(&mut self, demand: &MotionDemand, dt_s: f64) -> Shaped {
        let mut clipped = false;
        if dt_s > 0.0 && dt_s.is_finite() {
            let braked = self.braked(dt_s);
            let mut next = match demand {
                MotionDemand::Follow(reference) if reference.is_finite() => {
                    let goal;
                    (goal, clipped) = self.clipped_goal(reference);
                    self.next_rates(&goal, dt_s)
                }
                _ => braked,
            };
            let allowed_rad = self.allowed_rad(dt_s);
            if !self.stays_inside(&next, dt_s, allowed_rad) {
                let (mut inside, mut outside) = (0.0, 1.0);
                let mixed = |share: f64| braked + (next - braked) * share;
                for _ in 0..MIXING_STEPS {
                    let middle = 0.5 * (inside + outside);
                    if self.stays_inside(&mixed(middle), dt_s, allowed_rad) {
                        inside = middle;
                    } else {
                        outside = middle;
                    }
                }
                next = mixed(inside);
            }
            self.accelerations_rad_s2 = (next - self.rates_rad_s) / dt_s;
        }
        Shaped { reference: self.reference(), clipped }
    }

    /// The demand in angles, moved into the envelope.
    fn clipped_goal(&self, demand: &Reference) -> (YawPitchRollMotion, bool) {
        let envelope = &self.limits.envelope;
        let clipped = envelope.angle_rad(&demand.q_world_reference) > envelope.max_rad() + CLIP_TOLERANCE_RAD;
        let (inside, _) = envelope.clip(&demand.q_world_reference);
        let mut goal = YawPitchRollMotion::of(&Reference { q_world_reference: inside, ..*demand });
        if clipped {
            // The motion along the limit does not follow from the motion of the demand.
            let free = match envelope.limit() {
                TiltLimit::Cone { .. } => Vector3::new(1.0, 0.0, 0.0),
                TiltLimit::Pitch { .. } => Vector3::new(1.0, 0.0, 1.0),
            };
            goal.rates_rad_s.component_mul_assign(&free);
            goal.accelerations_rad_s2.component_mul_assign(&free);
        }
        (goal, clipped)
    }

    fn next_rates(&self, goal: &YawPitchRollMotion, dt_s: f64) -> Vector3<f64> {
        let (rate_max, acceleration_max) = (self.limits.rate_max_rad_s, self.limits.acceleration_max_rad_s2);
        let difference = goal.angles.vector() - self.angles_rad;
        let error = Vector3::new(wrap_angle_rad(difference.x), difference.y, wrap_angle_rad(difference.z));
        let distance = error.norm();
        let (k1, k2) = (0.5 * self.bandwidth_rad_s, 2.0 * self.bandwidth_rad_s);
        let braking = APPROACH_SHARE * acceleration_max;
        let near = braking / (k1 * k1);
        let approach_per_rad =
            if distance <= near { k1 } else { (2.0 * braking * (distance - 0.5 * near)).sqrt() / distance };
        let wanted = goal.rates_rad_s + error * approach_per_rad;
        let commanded = limited(wanted, rate_max);
        // The acceleration of a demand that is too fast to follow does not apply to the reference.
        let share = if wanted.norm() > rate_max { rate_max / wanted.norm() } else { 1.0 };
        let asked = goal.accelerations_rad_s2 * share + (commanded - self.rates_rad_s) * k2;
        let step = limited(asked, acceleration_max) * dt_s;
        let bounded = limited(self.rates_rad_s + step, rate_max);
        // A rate limit that was lowered while turning faster is approached, not jumped to.
        self.rates_rad_s + limited(bounded - self.rates_rad_s, acceleration_max * dt_s)
    }

    /// The rates after a step of full braking.
    fn braked(&self, dt_s: f64) -> Vector3<f64> {
        let rate = self.rates_rad_s.norm();
        let loss = self.limits.acceleration_max_rad_s2 * dt_s;
        if rate <= loss { Vector3::zeros() } else { self.rates_rad_s * (1.0 - loss / rate) }
    }

    fn stop_point(&self, angles_rad: &Vector3<f64>, rates_rad_s: &Vector3<f64>, dt_s: f64) -> Vector3<f64> {
        let braking_s = 0.5 * rates_rad_s.norm() / self.limits.acceleration_max_rad_s2;
        angles_rad + rates_rad_s * (braking_s + 0.5 * dt_s)
    }

    fn tilt_rad(&self, angles_rad: &Vector3<f64>) -> f64 {
        self.limits.envelope.angle_rad(&YawPitchRoll::from_vector(*angles_rad).attitude())
    }

    /// The limit, or where the state already is or must go when that is further out.
    fn allowed_rad(&self, dt_s: f64) -> f64 {
        let stop = self.stop_point(&self.angles_rad, &self.rates_rad_s, dt_s);
        self.limits.envelope.max_rad().max(self.tilt_rad(&self.angles_rad)).max(self.tilt_rad(&stop))
    }

    fn stays_inside(&self, next_rates: &Vector3<f64>, dt_s: f64, allowed_rad: f64) -> bool {
        let next = self.angles_rad + (self.rates_rad_s + next_rates) * (0.5 * dt_s);
        self.tilt_rad(&next) <= allowed_rad
            && self.tilt_rad(&self.stop_point(&next, next_rates, dt_s)) <= allowed_rad
    }
}

fn limited(vector: Vector3<f64>, max_norm: f64) -> Vector3<f64> {
    let norm = vector.norm();
    if norm > max_norm { vector * (max_norm / norm) } else { vector }
}
