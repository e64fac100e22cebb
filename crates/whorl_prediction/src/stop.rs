//! A computation that nobody needs any more is stopped between two instants of a recording: it unwinds, as rust-analyzer's queries do, so that
//! nothing on its way has to pass an error on. Whoever starts it catches that ([`Stop::was_told`]).

use std::any::Any;
use std::cell::RefCell;
use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

thread_local! {
    static STOP: RefCell<Option<Stop>> = const { RefCell::new(None) };
}

struct Stopped;

/// Tells a computation to stop.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// It ends at its next instant.
    pub fn now(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether it was told.
    pub fn is_told(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Unwinds if it was told.
    pub fn obey(&self) {
        if self.is_told() {
            resume_unwind(Box::new(Stopped));
        }
    }

    /// From now on passes on this thread obey it: one for each thread of a computation's own pool.
    pub fn on_this_thread(&self) {
        STOP.set(Some(self.clone()));
    }

    /// Whether a computation unwound because it was told to.
    pub fn was_told(cause: &(dyn Any + Send)) -> bool {
        cause.is::<Stopped>()
    }
}

pub(crate) fn obey() {
    STOP.with_borrow(|stop| stop.iter().for_each(Stop::obey));
}
