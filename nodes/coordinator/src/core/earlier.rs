//! A coordinator that is started again in the middle of an experiment.

use std::time::Duration;

use whorl_node::{LogLevel, Outputs, Timestamp};

use super::CoordinatorCore;
use crate::parameters::Role;
use crate::progress::{Earlier, Progress};
use crate::stage::Stage;

impl CoordinatorCore {
    /// The same, started again in the middle of an experiment: `kept` is what [`Self::progress`] said last, `age_s` seconds ago. It goes
    /// on by itself with the experiment that was running, within `link.timeout_s`, as after a link that was cut for as long; held
    /// if it was held. Whatever else was kept is the end: it aborts, and says why. Nothing moves by what is old or unreadable.
    #[must_use]
    pub fn going_on(self, kept: String, age_s: f64) -> Self {
        Self { earlier: Some(Earlier::Kept(kept, age_s)), ..self }
    }

    /// What a coordinator that is started again needs to go on ([`Self::going_on`]). `None`: nothing has begun, and what was kept
    /// before still holds; or this one does not command the whole formation, so that nobody waits for it.
    #[must_use]
    pub fn progress(&self, now: Timestamp) -> Option<String> {
        if self.parameters.role != Role::Formation {
            return None;
        }
        let progress = match &self.stage {
            Stage::Running(run) | Stage::Finished { run, .. } => run.progress(now, None),
            Stage::Aborted { run: Some(run), reason, .. } => run.progress(now, Some(reason)),
            Stage::Waiting { .. } | Stage::Ready | Stage::Aborted { run: None, .. } => return None,
        };
        Some(progress.to_text())
    }

    /// At its first tick: decides whether it goes on.
    pub(super) fn look_at_earlier(&mut self, now: Timestamp, outputs: &mut Outputs) {
        let Some(Earlier::Kept(kept, age_s)) = self.earlier.take() else { return };
        // An age that is not known is not a short one.
        let age_s = if age_s >= 0.0 { age_s } else { f64::INFINITY };
        match Progress::from_text(&kept, &self.parameters) {
            Err(error) => {
                let reason = format!(
                    "the coordinator ended in the middle of an experiment and cannot go on with it: {error}"
                );
                self.abort(now, reason, outputs);
            }
            Ok(Progress { aborted: Some(reason), .. }) => self.abort(now, reason, outputs),
            Ok(_) if age_s > self.parameters.link.timeout_s => self.abort(now, self.too_long(age_s), outputs),
            Ok(progress) => {
                let step =
                    self.parameters.steps.get(progress.step).map_or("the end", |step| step.name.as_str());
                let held =
                    progress.held.as_ref().map_or_else(String::new, |held| format!("; it waits for {held}"));
                outputs.log(
                    LogLevel::Warn,
                    format!("started again: the experiment goes on at {step} as soon as all platforms are well{held}"),
                );
                let ended = now - Duration::from_secs_f64(age_s);
                self.earlier = Some(Earlier::GoesOn(Box::new(progress), ended));
            }
        }
    }

    /// An experiment whose platforms are not well again in time does not begin to move by itself.
    pub(super) fn give_up_earlier(&mut self, now: Timestamp, outputs: &mut Outputs) {
        if let Some(Earlier::GoesOn(_, ended)) = &self.earlier
            && matches!(self.stage, Stage::Waiting { .. } | Stage::Ready)
        {
            let away_s = now.seconds_since(*ended);
            if away_s > self.parameters.link.timeout_s {
                self.abort(now, self.too_long(away_s), outputs);
            }
        }
    }

    fn too_long(&self, away_s: f64) -> String {
        let limit_s = self.parameters.link.timeout_s;
        let for_how_long = if away_s.is_finite() {
            format!("for {away_s:.0} s")
        } else {
            "since before this computer was started, or for a time that nobody knows".to_owned()
        };
        format!(
            "the experiment was without a coordinator {for_how_long}; it goes on by itself within {limit_s:.0} s (link.timeout_s)"
        )
    }
}
