//! How a job is stopped: its next word unwinds it, as rust-analyzer does with queries whose answer nobody needs any more. Nothing is half
//! done, as nothing but the end of a job writes.

use std::any::Any;
use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// What unwinds a job that was told to stop.
struct Stopped;

/// Tells a job to stop.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// It ends with its current step.
    pub fn now(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether it was told.
    pub fn is_told(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Ends the job here, if it was told.
    pub fn obey(&self) {
        if self.is_told() {
            resume_unwind(Box::new(Stopped));
        }
    }
}

/// Whether a job ended because it was told to.
pub fn was_told(cause: &(dyn Any + Send)) -> bool {
    cause.is::<Stopped>()
}
