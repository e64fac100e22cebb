//! What jobs do: each asks the functions that the commands ask.

mod adopt;
mod explain;
mod import;
mod map;
mod model;
mod stretch;

use anyhow::Result;
use whorl_commands::runs::RunSources;
use whorl_explain::ProgressCallback;

use crate::api::{Ask, FileKind};
use crate::bench::Workbench;
use crate::columns::Columns;
use crate::done::Done;
use crate::project::sources_in;

pub use map::{map, set_channel};
pub use model::{platform, set_parameter, set_text, undo};
pub use stretch::{stretch, with_stretch};

/// Does what was asked.
///
/// # Errors
/// Why there is no answer.
pub fn carry_out(bench: &Workbench, ask: &Ask, say: &mut ProgressCallback<'_>) -> Result<Done> {
    match ask {
        Ask::Look { file } => {
            say(0.0, "reading");
            let path = bench.listed(file, FileKind::Recording)?;
            // As if it were chosen: it may not be yet.
            let sources = sources_in(bench.folder(), &bench.choice());
            let sources = RunSources { runs: vec![path.clone()], ..sources };
            bench.looked(file, Columns::read(&path, &sources)?);
            Ok(Done::default())
        }
        Ask::Import { file, rig } => import::import(bench, file, rig.as_deref(), say),
        Ask::Compare => explain::compared(bench, say),
        Ask::Where => explain::located(bench, say),
        Ask::Diagnose => explain::diagnosed(bench, say),
        Ask::Discover => explain::discovered(bench, say),
        Ask::Adopt { effects, anyway } => adopt::adopted(bench, effects, *anyway, say),
    }
}
