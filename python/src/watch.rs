//! Long computations: in a thread of their own without the interpreter's lock, with progress and Ctrl-C.

use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;

use crate::errors::{error, refused};

/// Time between two looks for signals.
const TICK: Duration = Duration::from_millis(100);

/// Ends a computation that nobody waits for any more.
struct Abandoned;

/// Runs `work` in a thread; it reports progress (0 to 1), which never goes back, and its current step. `progress` is called with both, in the
/// caller's thread. Ctrl-C, or an exception of `progress`, is raised at once; the work itself ends at its next report.
///
/// # Errors
/// What `work` returns, as exception; what `progress` raises; `KeyboardInterrupt`.
pub fn watched<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(&mut dyn FnMut(f64, &str)) -> anyhow::Result<T> + Send + 'static,
) -> PyResult<T> {
    let (said, mut heard) = channel::<(f64, String)>();
    let abandoned = Arc::new(AtomicBool::new(false));
    let is_abandoned = Arc::clone(&abandoned);
    let worker = thread::Builder::new().name("whorl".to_owned()).spawn(move || {
        let mut say = |share: f64, doing: &str| {
            if is_abandoned.load(Ordering::Relaxed) {
                // The libraries have no other way out; nothing is printed, and only this thread ends.
                resume_unwind(Box::new(Abandoned));
            }
            // Nobody may be listening any more; the next report ends the work.
            let _ = said.send((share, doing.to_owned()));
        };
        work(&mut say)
    })?;
    let mut done = 0.0;
    loop {
        let (news, receiver) = py.detach(move || (heard.recv_timeout(TICK), heard));
        heard = receiver;
        let called = match (news, &progress) {
            (Err(RecvTimeoutError::Disconnected), _) => break,
            (Ok((share, doing)), Some(progress)) => {
                // A step that begins anew undoes nothing.
                done = share.min(1.0).max(done);
                progress.call1(py, (done, doing)).map(|_| ())
            }
            _ => Ok(()),
        };
        called.and_then(|()| py.check_signals()).inspect_err(|_| abandoned.store(true, Ordering::Relaxed))?;
    }
    match py.detach(|| worker.join()) {
        Ok(result) => result.map_err(error),
        Err(_) => Err(refused("the computation ended abnormally; please report this, with the recording")),
    }
}
