//! The workbench: a folder with recordings and the file of a platform, opened on a page.
//!
//! The page asks what the commands ask, through the same functions ([`whorl_explain`], [`whorl_commands`]), and gets the same numbers.
//! Files stay the truth: the state here is what was chosen of them and what was answered, never a model of its own. Everything that
//! changes a file is shown as the text that it writes, and is a step of the model's history.
//!
//! | module | what |
//! |---|---|
//! | [`api`] | what page and program say to each other: types with one JSON schema |
//! | `project` | the folder: which of its files are recordings, models, maps |
//! | `bench` | the state, in one place, and the queue of what was asked |
//! | `jobs` | the thread that works the queue off, and how a job is stopped |
//! | `work`, `done` | what a job does, and what comes of it |
//! | `columns`, `marks` | samples as the page draws them, and what is to be said of stretches |
//! | `server` | the page, its assets, and the interface |
//! | `export` | the whole path as one page for somebody else |

pub mod api;
mod assets;
mod bench;
#[cfg(test)]
mod bench_tests;
mod columns;
mod done;
mod export;
mod jobs;
mod marks;
mod project;
mod server;
mod work;

use std::path::{Path, PathBuf};
use std::sync::{Arc, Weak};
use std::time::Duration;

pub use bench::Workbench;
pub use server::{LARGEST_FILE, routes};

/// Time between two looks at the folder.
const LOOK: Duration = Duration::from_secs(1);

/// Opens a folder and chooses these files of it; what was chosen is looked at, and compared if nothing is missing for that.
///
/// # Errors
/// When the folder cannot be read, or a file is not in it.
pub fn open(folder: &Path, files: &[PathBuf]) -> anyhow::Result<Arc<Workbench>> {
    let bench = Workbench::new(folder, files)?;
    jobs::start(&bench)?;
    let watched = Arc::downgrade(&bench);
    std::thread::Builder::new().name("folder".to_owned()).spawn(move || watch(&watched))?;
    Ok(bench)
}

/// Files change by other hands, too.
fn watch(bench: &Weak<Workbench>) {
    loop {
        std::thread::sleep(LOOK);
        let Some(bench) = bench.upgrade() else { return };
        bench.look();
    }
}
