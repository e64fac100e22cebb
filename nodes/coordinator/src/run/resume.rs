//! Going on with an experiment whose coordinator ended in the middle of it.

use std::time::Duration;

use whorl_node::{Outputs, Timestamp};

use super::{Run, Sight, goal_at};
use crate::parameters::{Parameters, StepKind};
use crate::progress::Progress;

impl Run {
    /// How far it has come at `now`; a run that was aborted says why.
    pub fn progress(&self, now: Timestamp, aborted: Option<&str>) -> Progress {
        Progress {
            fingerprint: self.fingerprint,
            starts: self.legs.iter().map(|leg| leg.start).collect(),
            step: self.step,
            step_elapsed_s: self.step_elapsed_s,
            run_elapsed_s: now.seconds_since(self.started).max(0.0),
            paused_s: self.paused_s,
            held: self.held.clone(),
            aborted: aborted.map(str::to_owned),
        }
    }

    /// Goes on where another coordinator was `away_s` ago. References start at rest where the platforms are, and the
    /// sequence waits until all are followed: then what is left of a slew is planned from there, as after every wait.
    /// An excitation is played from its beginning: its first half would be missing.
    pub fn go_on(
        parameters: &Parameters,
        progress: &Progress,
        away_s: f64,
        sights: &[Sight],
        now: Timestamp,
        outputs: &mut Outputs,
    ) -> Result<Self, String> {
        let mut run = Self::at_rest(parameters, sights, now)?;
        for (leg, start) in run.legs.iter_mut().zip(&progress.starts) {
            leg.start = *start;
            leg.goal = leg.goal.take().map(|_| goal_at(parameters, start));
        }
        if let (Some(goal), Some(first)) = (&mut run.structure_goal, progress.starts.first()) {
            *goal = goal_at(parameters, &(first * parameters.law.offset(0).inverse()));
        }
        // What was before ends where its steps end, whatever they waited for.
        let mut unsaid = Outputs::default();
        for step in parameters.steps.iter().take(progress.step) {
            run.begin_step(parameters, &mut unsaid);
            run.advance_goals(step.duration_s);
            run.advance_offsets(step.duration_s);
            run.step += 1;
        }
        run.begin_step(parameters, outputs);
        if !matches!(run.step(parameters).map(|step| &step.kind), Some(StepKind::Excite(_))) {
            run.advance_goals(progress.step_elapsed_s);
            run.advance_offsets(progress.step_elapsed_s);
            run.step_elapsed_s = progress.step_elapsed_s;
        }
        run.paused = true;
        run.paused_s = progress.paused_s + away_s;
        run.started = now - Duration::from_secs_f64(progress.run_elapsed_s + away_s);
        run.held.clone_from(&progress.held);
        run.look(parameters, sights);
        run.restart_law();
        Ok(run)
    }
}
