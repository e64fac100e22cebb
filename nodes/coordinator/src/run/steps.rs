//! From step to step.

use whorl_control::formation::Offset;
use whorl_node::{LogLevel, Outputs};

use super::{REFERENCE_PERIOD_S, Run};
use crate::goal::Planning;
use crate::parameters::{Parameters, StepKind};

impl Run {
    pub(super) fn advance_steps(&mut self, parameters: &Parameters, outputs: &mut Outputs) {
        let Some(step) = parameters.steps.get(self.step) else { return };
        self.step_elapsed_s += REFERENCE_PERIOD_S;
        self.structure_goal
            .iter_mut()
            .chain(self.legs.iter_mut().filter_map(|leg| leg.goal.as_mut()))
            .for_each(|goal| goal.advance(REFERENCE_PERIOD_S));
        // Half a period of tolerance: sums of periods are not exact.
        if self.step_elapsed_s + 0.5 * REFERENCE_PERIOD_S >= step.duration_s {
            self.step += 1;
            self.step_elapsed_s = 0.0;
            self.begin_step(parameters, outputs);
        }
        for (offset, leg) in self.offsets.iter_mut().zip(&self.legs) {
            *offset = Offset::constant(leg.offset_angles.attitude());
        }
        self.gather_goals();
    }

    pub(super) fn begin_step(&mut self, parameters: &Parameters, outputs: &mut Outputs) {
        let Some(step) = parameters.steps.get(self.step) else { return };
        outputs.log(LogLevel::Info, format!("step {}: {:.1} s", step.name, step.duration_s));
        match &step.kind {
            StepKind::Settle(slew) | StepKind::Slew(slew) => {
                let mut longest_s = 0.0_f64;
                if let Some(goal) = &mut self.structure_goal {
                    goal.slew(slew, Planning::Immediate);
                }
                for (platform, leg) in self.legs.iter_mut().enumerate() {
                    if let Some(goal) = &mut leg.goal
                        && slew.platform.is_none_or(|wanted| wanted == platform)
                    {
                        let limits = *leg.shaper.limits();
                        longest_s = longest_s.max(goal.slew(slew, Planning::Smooth(&limits)).unwrap_or(0.0));
                    }
                }
                if longest_s > step.duration_s {
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
                }
            }
            StepKind::Hold => {}
        }
    }

    pub(super) fn resume(&mut self, parameters: &Parameters) {
        self.paused = false;
        for (platform, leg) in self.legs.iter_mut().enumerate() {
            if let (Some(goal), Some(limits)) = (&mut leg.goal, parameters.limits.get(platform)) {
                goal.resume(&leg.shaper.reference().q_world_reference, Planning::Smooth(limits));
            }
        }
        self.restart_law();
    }
}
