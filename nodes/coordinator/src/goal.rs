//! Where the experiment wants a leader, or the virtual structure: a smooth motion from step to step.

use std::sync::Arc;

use nalgebra::{UnitQuaternion, Vector3};
use whorl_control::formation::{ReferenceLimits, YawPitchRoll, YawPitchRollMotion};
use whorl_control::reference::{Reference, Slew, SlewLimits};

use crate::parameters::{self, Axis, CoObservation, PartialAngles, Scan};

/// Share of a platform's limits that planned motion uses; its followers need the rest to catch up.
const PLANNED_SHARE: f64 = 0.8;

/// The motion of one leader or of the virtual structure.
#[derive(Debug, Clone)]
pub(crate) struct Goal {
    /// Angles at the end of the current motion.
    angles: YawPitchRoll,
    yaw_zero_rad: f64,
    motion: Motion,
    elapsed_s: f64,
}

#[derive(Debug, Clone)]
enum Motion {
    Rest,
    Slew { plan: Box<Slew>, step: parameters::Slew },
    Scan(Scan),
    Pass { pass: Arc<CoObservation>, platform: usize, yaw_rad: f64 },
}

/// Limits within which a slew is planned.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Planning<'a> {
    /// Those of this platform: the goal moves along a smooth slew.
    Smooth(&'a ReferenceLimits),
    /// None: the law plans its own motion, the goal is set at once.
    Immediate,
}

impl Goal {
    /// At rest at an attitude.
    pub fn new(q_world_goal: &UnitQuaternion<f64>, yaw_zero_rad: f64) -> Self {
        let angles = YawPitchRoll::of(q_world_goal);
        Self { angles, yaw_zero_rad, motion: Motion::Rest, elapsed_s: 0.0 }
    }

    /// Advances the motion.
    pub fn advance(&mut self, dt_s: f64) {
        self.elapsed_s += dt_s;
        let ended = match &self.motion {
            Motion::Rest => false,
            Motion::Slew { plan, .. } => self.elapsed_s >= plan.duration_s(),
            Motion::Scan(scan) => self.elapsed_s >= scan.duration_s,
            // The trajectory ends at rest.
            Motion::Pass { .. } => false,
        };
        if ended {
            self.motion = Motion::Rest;
        }
    }

    /// The current motion.
    pub fn reference(&self) -> Reference {
        match &self.motion {
            Motion::Rest => Reference::at_rest(self.angles.attitude()),
            Motion::Slew { plan, .. } => plan.at(self.elapsed_s),
            Motion::Scan(scan) => scan_motion(scan, &self.angles, self.elapsed_s).reference(),
            Motion::Pass { pass, platform, yaw_rad } => pass
                .motion(*platform, self.elapsed_s, *yaw_rad)
                .unwrap_or_else(|| Reference::at_rest(self.angles.attitude())),
        }
    }

    /// Begins a slew from the current goal. Returns its length \[s\], if known.
    pub fn slew(&mut self, step: &parameters::Slew, planning: Planning<'_>) -> Option<f64> {
        let from = self.reference().q_world_reference;
        self.angles = step.to.over(&self.angles, self.yaw_zero_rad);
        self.elapsed_s = 0.0;
        self.motion = Motion::Rest;
        let Planning::Smooth(limits) = planning else { return None };
        let tighter = |own: f64, asked: Option<f64>| own.min(asked.unwrap_or(f64::INFINITY));
        let rate = tighter(PLANNED_SHARE * limits.rate_max_rad_s, step.rate_max_rad_s);
        let acceleration =
            tighter(PLANNED_SHARE * limits.acceleration_max_rad_s2, step.acceleration_max_rad_s2);
        let slew_limits = SlewLimits::new(rate, acceleration).ok()?;
        let plan = Slew::new(&from, &self.angles.attitude(), &slew_limits, &limits.envelope);
        let duration_s = plan.duration_s();
        self.motion = Motion::Slew { plan: Box::new(plan), step: *step };
        Some(duration_s)
    }

    /// Continues after a pause: the rest of a slew starts again from `q_world_reference`.
    pub fn resume(&mut self, q_world_reference: &UnitQuaternion<f64>, planning: Planning<'_>) {
        if let Motion::Slew { step, .. } = self.motion {
            let end = self.angles;
            self.angles = YawPitchRoll::of(q_world_reference);
            self.motion = Motion::Rest;
            let to = PartialAngles {
                yaw_rad: Some(end.yaw_rad - self.yaw_zero_rad),
                pitch_rad: Some(end.pitch_rad),
                roll_rad: Some(end.roll_rad),
            };
            self.slew(&parameters::Slew { to, ..step }, planning);
        }
    }

    /// Restarts the motion from the platform's attitude `q_world_body`: a slew starts again from there, a scan continues
    /// about it, and a goal at rest is moved there.
    pub fn moved_to(&mut self, q_world_body: &UnitQuaternion<f64>, planning: Planning<'_>) {
        match &self.motion {
            Motion::Slew { .. } => self.resume(q_world_body, planning),
            Motion::Rest | Motion::Scan(_) => self.angles = YawPitchRoll::of(q_world_body),
            Motion::Pass { .. } => {}
        }
    }

    /// The same goal for another platform or structure, which is turned by `q_old_new` against this one:
    /// a scan continues, anything else is approached from `from`, the current attitude of the new one.
    pub fn transferred(
        &self,
        q_old_new: &UnitQuaternion<f64>,
        from: &UnitQuaternion<f64>,
        planning: Planning<'_>,
    ) -> Self {
        let end = YawPitchRoll::of(&(self.angles.attitude() * q_old_new));
        if let Motion::Scan(_) = &self.motion {
            return Self { angles: end, ..self.clone() };
        }
        if let Motion::Pass { .. } = &self.motion {
            return self.clone();
        }
        let to = PartialAngles {
            yaw_rad: Some(end.yaw_rad - self.yaw_zero_rad),
            pitch_rad: Some(end.pitch_rad),
            roll_rad: Some(end.roll_rad),
        };
        let mut goal = Self::new(from, self.yaw_zero_rad);
        let (rate_max_rad_s, acceleration_max_rad_s2) = match &self.motion {
            Motion::Slew { step, .. } => (step.rate_max_rad_s, step.acceleration_max_rad_s2),
            _ => (None, None),
        };
        goal.slew(
            &parameters::Slew { platform: None, to, rate_max_rad_s, acceleration_max_rad_s2 },
            planning,
        );
        goal
    }

    /// Zero of its yaw \[rad\].
    pub fn yaw_zero_rad(&self) -> f64 {
        self.yaw_zero_rad
    }

    /// Begins the pass of a platform, whose headings count from `yaw_rad`.
    pub fn observe(&mut self, pass: &Arc<CoObservation>, platform: usize, yaw_rad: f64) {
        self.elapsed_s = 0.0;
        if let Some(end) = pass.motion(platform, f64::INFINITY, yaw_rad) {
            self.angles = YawPitchRoll::of(&end.q_world_reference);
        }
        self.motion = Motion::Pass { pass: Arc::clone(pass), platform, yaw_rad };
    }

    /// Begins a scan about the angles of the goal.
    pub fn scan(&mut self, scan: &Scan) {
        self.elapsed_s = 0.0;
        self.motion = Motion::Scan(*scan);
    }
}

/// `A s(t) sin(2 pi t / T)`; the envelope s rises from 0 to 1 in half a period, falls at the end, and
/// its first two derivatives vanish at both ends.
pub(crate) fn scan_motion(scan: &Scan, about: &YawPitchRoll, elapsed_s: f64) -> YawPitchRollMotion {
    let ramp_s = (0.5 * scan.period_s).min(0.5 * scan.duration_s);
    let left_s = scan.duration_s - elapsed_s;
    let (s, s_dot, s_ddot) = if elapsed_s < ramp_s {
        smooth_step(elapsed_s, ramp_s, 1.0)
    } else if left_s < ramp_s {
        smooth_step(left_s, ramp_s, -1.0)
    } else {
        (1.0, 0.0, 0.0)
    };
    let w = std::f64::consts::TAU / scan.period_s;
    let (sine, cosine) = (w * elapsed_s).sin_cos();
    let axis = match scan.axis {
        Axis::Yaw => Vector3::x(),
        Axis::Pitch => Vector3::y(),
        Axis::Roll => Vector3::z(),
    } * scan.amplitude_rad;
    YawPitchRollMotion {
        angles: YawPitchRoll::from_vector(about.vector() + axis * (s * sine)),
        rates_rad_s: axis * (s_dot * sine + s * w * cosine),
        accelerations_rad_s2: axis * (s_ddot * sine + 2.0 * s_dot * w * cosine - s * w * w * sine),
    }
}

/// `6 x^5 - 15 x^4 + 10 x^3` of `x = t / ramp`, with its derivatives by time; `direction` is the sign of
/// dt.
fn smooth_step(t_s: f64, ramp_s: f64, direction: f64) -> (f64, f64, f64) {
    let x = (t_s / ramp_s).clamp(0.0, 1.0);
    let value = x * x * x * (10.0 + x * (6.0 * x - 15.0));
    let slope = 30.0 * x * x * (1.0 - x) * (1.0 - x);
    let curve = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x);
    (value, direction * slope / ramp_s, curve / (ramp_s * ramp_s))
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_control::reference::TiltEnvelope;
    use whorl_dynamics::platform::TiltLimit;
    use whorl_math::attitude_error;

    fn limits() -> ReferenceLimits {
        ReferenceLimits {
            envelope: TiltEnvelope::new(TiltLimit::Cone { max_rad: 0.087 }, 0.017).unwrap(),
            rate_max_rad_s: 0.07,
            acceleration_max_rad_s2: 0.01,
        }
    }

    fn check_consistent(goal: &mut Goal, duration_s: f64) {
        let dt_s = 1e-3;
        let mut before = goal.reference();
        for _ in 0..(duration_s / dt_s) as usize {
            goal.advance(dt_s);
            let now = goal.reference();
            let rate = attitude_error(&before.q_world_reference, &now.q_world_reference) / dt_s;
            let mean = (before.omega_wr_r_rad_s + now.omega_wr_r_rad_s) * 0.5;
            assert!((rate - mean).norm() < 1e-6, "{} {}", rate, mean);
            let acceleration = (now.omega_wr_r_rad_s - before.omega_wr_r_rad_s) / dt_s;
            let mean = (before.omega_dot_wr_r_rad_s2 + now.omega_dot_wr_r_rad_s2) * 0.5;
            assert!((acceleration - mean).norm() < 2e-5, "{} {}", acceleration, mean);
            before = now;
        }
    }

    #[test]
    fn a_scan_is_smooth_and_reaches_its_amplitude() {
        let mut goal =
            Goal::new(&YawPitchRoll { yaw_rad: 0.3, pitch_rad: 0.02, roll_rad: 0.0 }.attitude(), 0.0);
        let scan =
            Scan { platform: None, axis: Axis::Yaw, amplitude_rad: 0.2, period_s: 10.0, duration_s: 30.0 };
        goal.scan(&scan);
        let mut top = 0.0_f64;
        let mut probe = goal.clone();
        for _ in 0..3000 {
            probe.advance(0.01);
            top = top.max(YawPitchRoll::of(&probe.reference().q_world_reference).yaw_rad - 0.3);
        }
        assert!((top - 0.2).abs() < 1e-4, "{top}");
        check_consistent(&mut goal, 31.0);
        assert_eq!(goal.reference().omega_wr_r_rad_s, Vector3::zeros());
        assert!((YawPitchRoll::of(&goal.reference().q_world_reference).yaw_rad - 0.3).abs() < 1e-12);
    }

    #[test]
    fn a_slew_counts_yaw_from_zero_and_keeps_what_is_not_given() {
        let start = YawPitchRoll { yaw_rad: 1.0, pitch_rad: 0.02, roll_rad: -0.01 };
        let mut goal = Goal::new(&start.attitude(), 1.0);
        let to = PartialAngles { yaw_rad: Some(0.4), pitch_rad: None, roll_rad: Some(0.03) };
        let step =
            parameters::Slew { platform: None, to, rate_max_rad_s: None, acceleration_max_rad_s2: None };
        let limits = limits();
        let duration_s = goal.slew(&step, Planning::Smooth(&limits)).unwrap();
        check_consistent(&mut goal, duration_s + 0.5);
        let end = YawPitchRoll::of(&goal.reference().q_world_reference).vector();
        assert!((end - Vector3::new(1.4, 0.02, 0.03)).norm() < 1e-9, "{end}");
        // 0.4 rad at 0.8 of both limits: two smooth ramps of 1.5 v / a meet before full rate is reached.
        let expected_s = 2.0 * 1.5 * (0.4 * 0.008 / 1.5_f64).sqrt() / 0.008;
        assert!((duration_s - expected_s).abs() < 0.05 * expected_s, "{duration_s} {expected_s}");
    }

    #[test]
    fn a_slew_that_was_paused_ends_where_it_was_meant_to() {
        let mut goal = Goal::new(&UnitQuaternion::identity(), 0.0);
        let to = PartialAngles { yaw_rad: Some(0.5), ..PartialAngles::default() };
        let step =
            parameters::Slew { platform: None, to, rate_max_rad_s: None, acceleration_max_rad_s2: None };
        let limits = limits();
        goal.slew(&step, Planning::Smooth(&limits));
        goal.advance(5.0);
        let stood = YawPitchRoll { yaw_rad: 0.22, ..YawPitchRoll::default() }.attitude();
        goal.resume(&stood, Planning::Smooth(&limits));
        assert!(attitude_error(&stood, &goal.reference().q_world_reference).norm() < 1e-12);
        assert_eq!(goal.reference().omega_wr_r_rad_s, Vector3::zeros());
        goal.advance(100.0);
        assert!((YawPitchRoll::of(&goal.reference().q_world_reference).yaw_rad - 0.5).abs() < 1e-12);
    }

    #[test]
    fn a_law_that_plans_its_own_way_gets_the_goal_at_once() {
        let mut goal = Goal::new(&UnitQuaternion::identity(), 0.0);
        let to = PartialAngles { yaw_rad: Some(2.0), ..PartialAngles::default() };
        let step =
            parameters::Slew { platform: None, to, rate_max_rad_s: None, acceleration_max_rad_s2: None };
        assert_eq!(goal.slew(&step, Planning::Immediate), None);
        assert!((YawPitchRoll::of(&goal.reference().q_world_reference).yaw_rad - 2.0).abs() < 1e-12);
    }
}
