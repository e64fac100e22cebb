//! What the coordinator sends: authority, references, the formation's state.

use std::time::Duration;

use whorl_msgs::topics::{PlatformId, Route, Topic};
use whorl_node::{Outputs, Timestamp};

use super::CoordinatorCore;
use crate::link::PlatformLink;
use crate::parameters::{Role, StepKind};
use crate::report;
use crate::run::REFERENCE_PERIOD_S;
use crate::stage::Stage;

impl CoordinatorCore {
    pub(super) fn publish_command(&mut self, now: Timestamp, command: u8, outputs: &mut Outputs) {
        let validity = Duration::from_secs_f64(self.parameters.command_validity_s);
        // The platform addressed, with the time by its clock; a single message while all share one clock.
        let to: Vec<(String, Timestamp)> = match (self.parameters.role, &self.stage) {
            (Role::Formation, _) if self.links.iter().any(|link| link.clock().applied_s() != 0.0) => {
                let remote = |link: &PlatformLink| (link.name().to_owned(), link.clock().to_remote(now));
                self.links.iter().map(remote).collect()
            }
            (Role::Formation, _) => vec![(String::new(), now)],
            (Role::Platform(own), _) => {
                let link = self.links.get(own);
                link.map(|link| (link.name().to_owned(), link.clock().to_remote(now))).into_iter().collect()
            }
            // An observer may only abort.
            (Role::Observer, Stage::Aborted { run: Some(_), .. }) => vec![(String::new(), now)],
            (Role::Observer, _) => return,
        };
        for (platform, at) in to {
            let message = report::command(at, self.sequences.command, command, at + validity, &platform);
            self.sequences.command += 1;
            outputs.publish(Route::shared(Topic::FormationCommand), message);
        }
    }

    pub(super) fn publish_references(&mut self, at: Timestamp, outputs: &mut Outputs) {
        let (Stage::Running(run) | Stage::Finished { run, .. }) = &self.stage else { return };
        let valid_until = at + Duration::from_secs_f64(self.parameters.reference_validity_s);
        for (platform, leg) in (0u16..).zip(&run.legs) {
            if !self.parameters.commands(usize::from(platform)) {
                continue;
            }
            // By the platform's own clock, like all messages in its namespace.
            let clock = self.links.get(usize::from(platform)).map(PlatformLink::clock);
            let [at, until] = [at, valid_until].map(|t| clock.map_or(t, |clock| clock.to_remote(t)));
            let message = report::reference(at, self.sequences.reference, until, leg);
            outputs.publish(Route::platform(PlatformId(platform), Topic::AttitudeReference), message);
        }
        self.sequences.reference += 1;
    }

    /// Sent while a step makes a platform play an excitation, and only while the sequence does not wait.
    pub(super) fn publish_excitations(&mut self, at: Timestamp, outputs: &mut Outputs) {
        let Stage::Running(run) = &self.stage else { return };
        let Some(step) = run.step(&self.parameters).filter(|_| !run.paused) else { return };
        let StepKind::Excite(excite) = &step.kind else { return };
        // Valid until the next reference, which may come with the next excitation.
        let left_s = step.duration_s - run.step_elapsed_s + REFERENCE_PERIOD_S;
        let valid_s = self.parameters.reference_validity_s.min(left_s).max(0.0);
        for (platform, link) in (0u16..).zip(&self.links) {
            let index = usize::from(platform);
            if !self.parameters.commands(index) || !excite.concerns(index) {
                continue;
            }
            let stamp = link.clock().to_remote(at);
            let message = report::excitation(
                stamp,
                self.sequences.excitation,
                stamp + Duration::from_secs_f64(valid_s),
                &excite.excitation,
                run.step_elapsed_s,
            );
            outputs.publish(Route::platform(PlatformId(platform), Topic::Excitation), message);
        }
        self.sequences.excitation += 1;
    }

    /// Only one coordinator publishes the formation's state; a platform's own coordinator does not.
    pub(super) fn publish_state(&mut self, now: Timestamp, outputs: &mut Outputs) {
        if matches!(self.parameters.role, Role::Platform(_)) {
            return;
        }
        let message = report::state(now, self.sequences.state, &self.parameters, &self.links, &self.stage);
        self.sequences.state += 1;
        outputs.publish(Route::shared(Topic::FormationState), message);
    }
}
