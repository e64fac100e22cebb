//! Transitions between steps.

use std::sync::Arc;

use nalgebra::UnitQuaternion;
use whorl_control::formation::RelativeAttitudeLaw;
use whorl_node::{LogLevel, Outputs};

use super::{Leg, OffsetMotion, REFERENCE_PERIOD_S, Run};
use crate::goal::{Goal, Planning};
use crate::parameters::{CoObservation, Parameters, StepKind};

impl Run {
    pub(super) fn advance_steps(&mut self, parameters: &Parameters, outputs: &mut Outputs) {
        let Some(step) = parameters.steps.get(self.step) else { return };
        self.step_elapsed_s += REFERENCE_PERIOD_S;
        self.advance_goals(REFERENCE_PERIOD_S);
        // Half a period of tolerance: sums of periods are not exact.
        if self.step_elapsed_s + 0.5 * REFERENCE_PERIOD_S >= step.duration_s {
            self.step += 1;
            self.step_elapsed_s = 0.0;
            self.begin_step(parameters, outputs);
        }
        self.advance_offsets(REFERENCE_PERIOD_S);
        for (offset, leg) in self.offsets.iter_mut().zip(&self.legs) {
            *offset = leg.offset();
        }
        self.gather_goals();
    }

    pub(super) fn advance_goals(&mut self, dt_s: f64) {
        self.structure_goal
            .iter_mut()
            .chain(self.legs.iter_mut().filter_map(|leg| leg.goal.as_mut()))
            .for_each(|goal| goal.advance(dt_s));
    }

    pub(super) fn advance_offsets(&mut self, dt_s: f64) {
        for (_, elapsed_s) in self.legs.iter_mut().filter_map(|leg| leg.offset_motion.as_mut()) {
            *elapsed_s += dt_s;
        }
    }

    pub(super) fn begin_step(&mut self, parameters: &Parameters, outputs: &mut Outputs) {
        let Some(step) = parameters.steps.get(self.step) else { return };
        outputs.log(LogLevel::Info, format!("step {}: {:.1} s", step.name, step.duration_s));
        match &step.kind {
            StepKind::Settle(slew) | StepKind::Slew(slew) => {
                let mut longest_s = 0.0_f64;
                if let Some(goal) = &mut self.structure_goal {
                    let planning = structure_planning(self.law.as_ref(), parameters);
                    longest_s = goal.slew(slew, planning).unwrap_or(0.0);
                }
                for (platform, leg) in self.legs.iter_mut().enumerate() {
                    if let Some(goal) = &mut leg.goal
                        && slew.platform.is_none_or(|wanted| wanted == platform)
                    {
                        let limits = *leg.shaper.limits();
                        longest_s = longest_s.max(goal.slew(slew, Planning::Smooth(&limits)).unwrap_or(0.0));
                    }
                }
                // If another law takes over next, that law finishes the slew.
                let next = parameters.steps.get(self.step + 1).map(|next| &next.kind);
                if longest_s > step.duration_s && !matches!(next, Some(StepKind::Law { .. })) {
                    outputs.log(
                        LogLevel::Warn,
                        format!(
                            "step {} lasts {:.1} s but its slew takes {longest_s:.1} s within the limits",
                            step.name, step.duration_s
                        ),
                    );
                }
            }
            StepKind::Scan(scan) => {
                if let Some(goal) = &mut self.structure_goal {
                    goal.scan(scan);
                }
                for (platform, leg) in self.legs.iter_mut().enumerate() {
                    if let Some(goal) = &mut leg.goal
                        && scan.platform.is_none_or(|wanted| wanted == platform)
                    {
                        goal.scan(scan);
                    }
                }
            }
            StepKind::Offset { platform, to } => {
                if let Some(leg) = self.legs.get_mut(*platform) {
                    leg.offset_angles = to.over(&leg.offset_angles, 0.0);
                    leg.offset_motion = None;
                }
            }
            StepKind::OffsetScan(scan) => {
                if let Some(leg) = scan.platform.and_then(|platform| self.legs.get_mut(platform)) {
                    leg.offset_motion = Some((OffsetMotion::Scan(*scan), 0.0));
                }
            }
            StepKind::CoObserve(pass) => {
                let text = describe(pass, &parameters.platforms);
                outputs.log(LogLevel::Info, text);
                let leader_of: Vec<_> =
                    (0..self.legs.len()).map(|p| self.law.leader(p).unwrap_or(0)).collect();
                self.observe(pass, &leader_of);
            }
            StepKind::Law { index } => self.switch_law(*index, parameters),
            StepKind::Excite(_) | StepKind::Hold => {}
        }
    }

    /// Begins a pass: each leader, or the frame in place of the first platform, moves like its spacecraft, and the
    /// offsets follow from the pass.
    fn observe(&mut self, pass: &Arc<CoObservation>, leader_of: &[usize]) {
        let goals = self.structure_goal.iter().chain(self.legs.iter().filter_map(|leg| leg.goal.as_ref()));
        // One heading for all: relative attitudes are those in orbit.
        let yaw_rad = goals.map(Goal::yaw_zero_rad).next().unwrap_or(0.0);
        if let Some(goal) = &mut self.structure_goal {
            goal.observe(pass, 0, yaw_rad);
        }
        for ((platform, leg), leader) in self.legs.iter_mut().enumerate().zip(leader_of) {
            if let Some(goal) = &mut leg.goal {
                goal.observe(pass, platform, yaw_rad);
            } else {
                let motion = OffsetMotion::Pass { pass: Arc::clone(pass), leader: *leader, platform };
                leg.offset_motion = Some((motion, 0.0));
            }
        }
    }

    /// Another law takes over: it starts from the references' current motion, and continues to the same goal.
    fn switch_law(&mut self, index: usize, parameters: &Parameters) {
        let Some(law) = parameters.law.laws.get(index).cloned() else { return };
        let present = |leg: &Leg| leg.shaper.reference().q_world_reference;
        let place = |leg: &Leg| leg.offset_angles.attitude();
        // Goal of the formation's frame: that of the structure, or of the first leader.
        let old = self.structure_goal.take().map(|goal| (goal, UnitQuaternion::identity())).or_else(|| {
            self.legs.iter().find_map(|leg| leg.goal.clone().map(|goal| (goal, place(leg).inverse())))
        });
        for (platform, leg) in self.legs.iter_mut().enumerate() {
            let keeps = law.leads(platform) && leg.goal.is_some();
            if keeps {
                continue;
            }
            let planned = parameters.limits.get(platform).map_or(Planning::Immediate, Planning::Smooth);
            leg.goal = match &old {
                Some((goal, to_frame)) if law.leads(platform) => {
                    Some(goal.transferred(&(to_frame * place(leg)), &present(leg), planned))
                }
                _ => None,
            };
        }
        if let (true, Some((goal, to_frame)), Some(first)) =
            (law.moves_a_structure(), &old, self.legs.first())
        {
            let frame = present(first) * place(first).inverse();
            let planning = structure_planning(law.as_ref(), parameters);
            self.structure_goal = Some(goal.transferred(to_frame, &frame, planning));
        }
        self.law = law;
        self.gather_goals();
        self.restart_law();
    }

    pub(super) fn resume(&mut self, parameters: &Parameters) {
        self.paused = false;
        for (platform, leg) in self.legs.iter_mut().enumerate() {
            if let (Some(goal), Some(limits)) = (&mut leg.goal, parameters.limits.get(platform)) {
                goal.resume(&leg.shaper.reference().q_world_reference, Planning::Smooth(limits));
            }
        }
        if let Some(goal) = &mut self.structure_goal
            && let Some(first) = self.legs.first()
        {
            let frame = first.shaper.reference().q_world_reference * first.offset_angles.attitude().inverse();
            goal.resume(&frame, structure_planning(self.law.as_ref(), parameters));
        }
        self.restart_law();
    }
}

/// Pointing and thrust errors of the pass.
fn describe(pass: &CoObservation, platforms: &[String]) -> String {
    let errors = pass.largest_errors_rad();
    let each = platforms.iter().zip(errors).map(|(name, (boresight, thrust))| {
        let thrust = if thrust.is_nan() {
            "no thrust wanted".to_owned()
        } else {
            format!("thrust within {:.2} deg of what is wanted", thrust.to_degrees())
        };
        format!("{name}: boresight within {:.2} deg of the target, {thrust}", boresight.to_degrees())
    });
    format!("{:.0} s of orbit: {}", pass.mapping.orbit_span_s(), each.collect::<Vec<_>>().join("; "))
}

/// How the goal of the whole formation moves: at once for a law that plans its own motion, otherwise smoothly
/// within the limits of the first platform, whose offset from the frame is usually zero.
fn structure_planning<'p>(law: &dyn RelativeAttitudeLaw, parameters: &'p Parameters) -> Planning<'p> {
    match parameters.limits.first() {
        Some(limits) if !law.plans_its_way() => Planning::Smooth(limits),
        _ => Planning::Immediate,
    }
}
