//! What was asked, what runs, and what came of it.

use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use anyhow::bail;
use whorl_prediction::Stop;

use super::inner::{key, with_exclusions};
use super::{Kept, QUEUE, Running, Workbench};
use crate::api::{Ask, FileKind, Stage};
use crate::done::Outcome;
use crate::project;

/// Answers that are kept: those of a model before and after a step, and of the one before.
const ANSWERS: usize = 24;
/// Stages of a job that are listed.
const STAGES: usize = 40;
/// Smallest progress that is told.
const STEP: f64 = 0.005;
impl Workbench {
    /// Asks for something that takes a while; the same thing waits but once.
    pub(crate) fn ask(&self, ask: Ask) -> anyhow::Result<()> {
        let file = match &ask {
            Ask::Look { file } | Ask::Import { file, .. } => Some(file.clone()),
            _ => None,
        };
        if let Some(file) = file {
            self.listed(&file, FileKind::Recording)?;
        }
        self.change(|inner| {
            if inner.queue.len() >= QUEUE {
                bail!("{QUEUE} computations wait already: stop one first");
            }
            inner.push(ask);
            Ok(())
        })
    }

    /// Stops the job of this number; what waits stays.
    pub(crate) fn stop(&self, number: u64) {
        self.change(|inner| {
            if let Some(running) = inner.running.as_ref().filter(|running| running.number == number) {
                running.stop.now();
            }
        });
    }

    /// Forgets what waits.
    pub(crate) fn clear(&self) {
        self.change(|inner| inner.queue.clear());
    }

    /// The next job; waits for one for so long.
    pub(crate) fn take(&self, patience: Duration) -> Option<(u64, Ask, Stop)> {
        let inner = self.inner();
        let (inner, _) = self
            .asked
            .wait_timeout_while(inner, patience, |inner| inner.queue.is_empty())
            .unwrap_or_else(PoisonError::into_inner);
        if inner.queue.is_empty() {
            return None;
        }
        drop(inner);
        self.change(|inner| {
            let ask = inner.queue.pop_front()?;
            inner.numbers += 1;
            let stop = Stop::default();
            inner.running = Some(Running {
                number: inner.numbers,
                ask: ask.clone(),
                began: Instant::now(),
                share: 0.0,
                stages: Vec::new(),
                stop: stop.clone(),
            });
            Some((inner.numbers, ask, stop))
        })
    }

    pub(crate) fn progress(&self, number: u64, share: f64, doing: &str) {
        let is_news = {
            let mut inner = self.inner();
            let Some(running) = inner.running.as_mut().filter(|running| running.number == number) else {
                return;
            };
            let is_new_stage = running.stages.last().is_none_or(|stage| stage.doing != doing);
            if is_new_stage && running.stages.len() < STAGES {
                let began_s = running.began.elapsed().as_secs_f64();
                running.stages.push(Stage { doing: doing.to_owned(), began_s });
            }
            // Work that begins anew is not undone.
            let moved = share > running.share + STEP;
            running.share = running.share.max(share.clamp(0.0, 1.0));
            is_new_stage || moved
        };
        if is_news {
            self.change(|_| ());
        }
    }

    pub(crate) fn ended(&self, number: u64, ask: &Ask, outcome: Outcome) {
        let seen = project::look(&self.folder);
        let remembered = self.change(|inner| {
            let took_s = inner.running.take().map_or(0.0, |running| running.began.elapsed().as_secs_f64());
            inner.seen = seen;
            let what = ask.name();
            if let Ask::Look { file } = ask
                && inner.arrived.remove(file)
                && matches!(outcome, Outcome::Done(_))
            {
                inner.join(file);
            }
            match outcome {
                Outcome::Stopped => inner.say("stopped", what, format!("{}: stopped.", ask.in_words())),
                Outcome::Failed(why) => {
                    inner.say("failed", what, why.replace(&format!("{}/", self.folder.display()), ""));
                }
                Outcome::Done(done) => {
                    if let Some(choice) = &done.choice {
                        inner.choice.clone_from(choice);
                    }
                    let again = done.again.clone();
                    if let Some(said) = &done.said {
                        inner.say("done", what, said.clone());
                    }
                    if done.is_answer {
                        let command = inner.command(ask);
                        let of = inner.asked_of();
                        let key = key(&self.folder, &inner.choice, with_exclusions(what));
                        inner.answers.push_back(Arc::new(Kept {
                            what,
                            number,
                            key,
                            done: *done,
                            command,
                            took_s,
                            of,
                        }));
                        let many = inner.answers.len().saturating_sub(ANSWERS);
                        inner.answers.drain(..many);
                    }
                    again.into_iter().for_each(|ask| inner.push(ask));
                }
            }
            inner.read_model(&self.folder);
            inner.choice.clone()
        });
        // A folder that cannot be written to is asked of again the next time.
        let _ = project::remember(&self.folder, &remembered);
    }
}
