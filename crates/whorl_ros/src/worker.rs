//! A thread for each participant that makes the calls which may never return.
//!
//! RustDDS 0.15 can lock up while endpoints are created as other participants are discovered: its discovery thread
//! sends to its event loop with the table of endpoints locked for reading, the creation waits to write that table,
//! and the event loop waits behind it to read. Whoever calls then waits for ever, and so does whoever drops an
//! endpoint of the same participant. Where traffic is secured it locks up without that: its discovery thread sends the event
//! loop, whose queue of 32 is full, the news of a handshake with the table locked for writing, and the event loop waits to read
//! it (docs/upstream). Here the caller waits for a limited time, and goes on without it.

use std::ops::{Deref, DerefMut};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How long the creation of an endpoint may take. It takes 1 ms, and half a second on a machine that is far too busy.
pub(crate) const LONGEST_CREATION: Duration = Duration::from_secs(4);

type Job = Box<dyn FnOnce() + Send>;
/// When work was given, and where its end is told.
type Given = (Instant, Receiver<()>);

/// The thread. It ends when the last handle is dropped and all work is done.
#[derive(Clone)]
pub(crate) struct Worker {
    jobs: Sender<Job>,
    stuck: Arc<AtomicBool>,
    /// Work that nobody waits for.
    probe: Arc<Mutex<Option<Given>>>,
}

impl Worker {
    pub(crate) fn start() -> std::io::Result<Self> {
        let (jobs, todo) = channel::<Job>();
        std::thread::Builder::new()
            .name("dds endpoints".to_owned())
            .spawn(move || todo.iter().for_each(|job| job()))?;
        Ok(Self { jobs, stuck: Arc::default(), probe: Arc::default() })
    }

    /// Whether some work did not return in time.
    pub(crate) fn is_stuck(&self) -> bool {
        self.stuck.load(Ordering::Relaxed)
    }

    /// The result of work, or `None` when this or earlier work has not returned in time.
    pub(crate) fn run<T: Send + 'static>(
        &self,
        limit: Duration,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Option<T> {
        if self.is_stuck() {
            return None;
        }
        let (done, result) = channel();
        let job: Job = Box::new(move || {
            // The caller no longer waits: the result is dropped here.
            let _ = done.send(work());
        });
        self.jobs.send(job).ok()?;
        let result = result.recv_timeout(limit).ok();
        self.stuck.fetch_or(result.is_none(), Ordering::Relaxed);
        result
    }

    /// Gives work that nobody waits for, unless some is under way: false once that has not returned within `limit`.
    pub(crate) fn probe(&self, limit: Duration, work: impl FnOnce() + Send + 'static) -> bool {
        let mut probe = self.probe.lock().unwrap_or_else(PoisonError::into_inner);
        match probe.as_ref().map(|(since, done)| (since.elapsed(), done.try_recv())) {
            Some((elapsed, Err(TryRecvError::Empty))) => {
                self.stuck.fetch_or(elapsed > limit, Ordering::Relaxed);
            }
            _ => {
                let (done, told) = channel();
                let job: Job = Box::new(move || {
                    work();
                    let _ = done.send(());
                });
                *probe = self.jobs.send(job).is_ok().then(|| (Instant::now(), told));
            }
        }
        !self.is_stuck()
    }

    /// Something that is dropped on this thread, after all work that was given before.
    pub(crate) fn keep<T: Send + 'static>(&self, value: T) -> Kept<T> {
        Kept { value: Some(value), worker: self.clone() }
    }

    /// Waits for what was dropped, at most `limit`.
    pub(crate) fn wait(&self, limit: Duration) {
        let _ = self.run(limit, || ());
    }
}

/// A value whose drop may never return: a [`Worker`] drops it.
pub(crate) struct Kept<T: Send + 'static> {
    /// `None` only while it is dropped.
    value: Option<T>,
    worker: Worker,
}

impl<T: Send + 'static> Deref for Kept<T> {
    type Target = T;

    #[expect(
        clippy::expect_used,
        reason = "only `drop` takes the value, and nobody can look at it afterwards"
    )]
    fn deref(&self) -> &T {
        self.value.as_ref().expect("the value is there until it is dropped")
    }
}

impl<T: Send + 'static> DerefMut for Kept<T> {
    #[expect(
        clippy::expect_used,
        reason = "only `drop` takes the value, and nobody can look at it afterwards"
    )]
    fn deref_mut(&mut self) -> &mut T {
        self.value.as_mut().expect("the value is there until it is dropped")
    }
}

impl<T: Send + 'static> Kept<T> {
    /// Drops the value now.
    pub(crate) fn leave(&mut self) {
        if let Some(value) = self.value.take() {
            // It cannot fail: the thread takes jobs as long as there is a handle.
            let _ = self.worker.jobs.send(Box::new(move || drop(value)));
        }
    }
}

impl<T: Send + 'static> Drop for Kept<T> {
    fn drop(&mut self) {
        self.leave();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_that_never_returns_does_not_hold_up_its_caller() {
        let worker = Worker::start().unwrap();
        assert_eq!(worker.run(LONGEST_CREATION, || 7), Some(7));
        let (release, wait) = channel::<()>();
        let stuck = worker.run(Duration::from_millis(20), move || wait.recv());
        assert!(stuck.is_none() && worker.is_stuck());
        // Neither later work nor a drop waits for it.
        assert_eq!(worker.run(LONGEST_CREATION, || 8), None);
        let (dropped, on) = channel();
        struct Tell(Sender<std::thread::ThreadId>);
        impl Drop for Tell {
            fn drop(&mut self) {
                self.0.send(std::thread::current().id()).unwrap();
            }
        }
        drop(worker.keep(Tell(dropped)));
        assert!(on.try_recv().is_err());
        release.send(()).unwrap();
        let thread = on.recv_timeout(Duration::from_secs(10)).unwrap();
        assert_ne!(thread, std::thread::current().id());
    }

    #[test]
    fn what_locks_up_is_noticed_by_who_does_not_wait_for_it() {
        let worker = Worker::start().unwrap();
        let (release, wait) = channel::<()>();
        let limit = Duration::from_millis(20);
        assert!(worker.probe(LONGEST_CREATION, || ()));
        assert_eq!(worker.run(LONGEST_CREATION, || 7), Some(7), "the probe has returned");
        assert!(
            worker.probe(limit, move || {
                let _ = wait.recv();
            }),
            "not at once"
        );
        std::thread::sleep(2 * limit);
        assert!(!worker.probe(limit, || ()) && worker.is_stuck());
        drop(release);
    }
}
