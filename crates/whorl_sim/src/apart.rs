//! A node in a thread of its own beside the simulation, with the same results.
//!
//! A node that speaks at its timer alone ([`NodeCore::speaks_at_timer_only`]) need not have taken a message when the
//! simulation goes on: only at its timer must it have taken all of them. What such a node computes costs the simulation
//! no time then, as long as a processor is free for it.

use std::mem::take;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use whorl_msgs::topics::{Message, Route};
use whorl_node::{Event, NodeCore, Outputs, Timestamp};

/// Messages after which they are handed over: few enough that little is left to do at the timer.
const BATCH_MESSAGES: usize = 48;

/// Messages in order, with the node's time.
type Batch = Vec<(Timestamp, Route, Arc<Message>)>;

/// What is to be done next.
enum Job {
    Messages(Batch),
    /// To be answered.
    Own(Timestamp, OwnEvent, Outputs),
}

/// An event that is not a message.
#[derive(Debug, Clone, Copy)]
pub(crate) enum OwnEvent {
    Timer,
    Shutdown,
}

/// The node, seen from the simulation.
pub(crate) struct Apart {
    waiting: Batch,
    jobs: Sender<Job>,
    answers: Receiver<(Outputs, bool)>,
    /// `None` once it has been joined.
    thread: Option<JoinHandle<()>>,
    finished: bool,
}

impl Apart {
    /// Starts the thread.
    pub fn new(mut core: Box<dyn NodeCore>) -> Self {
        let (jobs, to_do) = channel::<Job>();
        let (answer, answers) = channel();
        let finished = core.finished();
        let thread = std::thread::spawn(move || {
            for job in to_do {
                match job {
                    Job::Messages(batch) => {
                        let mut unheard = Outputs::default();
                        for (now, route, message) in &batch {
                            core.step(*now, Event::Message { route: *route, message }, &mut unheard);
                        }
                    }
                    Job::Own(now, event, mut outputs) => {
                        let event = match event {
                            OwnEvent::Timer => Event::Timer,
                            OwnEvent::Shutdown => Event::Shutdown,
                        };
                        core.step(now, event, &mut outputs);
                        // Nobody listens once the simulation has been given up.
                        let _ = answer.send((outputs, core.finished()));
                    }
                }
            }
        });
        Self { waiting: Batch::new(), jobs, answers, thread: Some(thread), finished }
    }

    /// Whether the node had finished its work at its last own event.
    pub fn finished(&self) -> bool {
        self.finished
    }

    /// Takes a message.
    pub fn message(&mut self, now: Timestamp, route: Route, message: Arc<Message>) {
        self.waiting.push((now, route, message));
        if self.waiting.len() >= BATCH_MESSAGES {
            let batch = std::mem::replace(&mut self.waiting, Batch::with_capacity(BATCH_MESSAGES));
            self.send(Job::Messages(batch));
        }
    }

    /// Takes an event of the node's own, after all messages; what the node says is added to `outputs`.
    pub fn own_event(&mut self, now: Timestamp, event: OwnEvent, outputs: Outputs) -> Outputs {
        if !self.waiting.is_empty() {
            let batch = take(&mut self.waiting);
            self.send(Job::Messages(batch));
        }
        self.send(Job::Own(now, event, outputs));
        match self.answers.recv() {
            Ok((outputs, finished)) => {
                self.finished = finished;
                outputs
            }
            Err(_) => {
                self.fail();
                Outputs::default()
            }
        }
    }

    fn send(&mut self, job: Job) {
        if self.jobs.send(job).is_err() {
            self.fail();
        }
    }

    /// The thread has ended: a panic there is one here, as if the node ran here.
    fn fail(&mut self) {
        if let Some(Err(reason)) = self.thread.take().map(JoinHandle::join) {
            std::panic::resume_unwind(reason);
        }
    }
}
