//! The thread that works off what was asked, one after the other.
//!
//! What fails inside ends the job and not the page.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Weak};
use std::time::Duration;

use rayon::{ThreadPool, ThreadPoolBuilder};
use whorl_prediction::Stop;

use crate::bench::Workbench;
use crate::done::Outcome;
use crate::work;

/// Time after which the thread looks whether it is still needed.
const LOOK: Duration = Duration::from_millis(500);

/// Starts the thread; it ends with the workbench.
///
/// # Errors
/// When the operating system has no thread.
pub fn start(bench: &Arc<Workbench>) -> std::io::Result<()> {
    let bench = Arc::downgrade(bench);
    std::thread::Builder::new().name("jobs".to_owned()).spawn(move || work_off(&bench)).map(|_| ())
}

fn work_off(bench: &Weak<Workbench>) {
    while let Some(bench) = bench.upgrade() {
        let Some((number, ask, stop)) = bench.take(LOOK) else { continue };
        let done = || {
            let mut say = |share: f64, doing: &str| {
                stop.obey();
                bench.progress(number, share, doing);
            };
            work::carry_out(&bench, &ask, &mut say)
        };
        let outcome = match catch_unwind(AssertUnwindSafe(|| pool(&stop)?.install(done))) {
            Ok(Ok(done)) => Outcome::Done(Box::new(done)),
            Ok(Err(error)) => Outcome::Failed(whorl_commands::in_words(&error)),
            Err(cause) if Stop::was_told(cause.as_ref()) => Outcome::Stopped,
            Err(cause) => Outcome::Failed(defect(cause.as_ref())),
        };
        bench.ended(number, &ask, outcome);
    }
}

/// Threads of one job, each of which obeys its stop.
fn pool(stop: &Stop) -> anyhow::Result<ThreadPool> {
    let stop = stop.clone();
    Ok(ThreadPoolBuilder::new().start_handler(move |_| stop.on_this_thread()).build()?)
}

fn defect(cause: &(dyn Any + Send)) -> String {
    let words = cause.downcast_ref::<String>().map(String::as_str);
    let words = words.or_else(|| cause.downcast_ref::<&str>().copied()).unwrap_or("without words");
    format!("a defect of Whorl ended this ({words}); the page goes on")
}
