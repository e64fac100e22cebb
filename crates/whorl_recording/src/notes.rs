//! Facts about a run that are stored in its manifest and not in its messages.

use whorl_bag::RunDirectory;

/// Note in a manifest: `clamped`, or on its bearing.
pub(crate) const MOUNTING_NOTE: &str = "mounting";
/// Note in a manifest: whether a controller was running, for recordings without its messages.
pub(crate) const CLOSED_LOOP_NOTE: &str = "closed_loop";
/// Note in a manifest: the log time that is the start of the run \[ns\], where it is not the first message's.
pub(crate) const START_NOTE: &str = "start_of_run_ns";

/// A fact out of the manifest.
pub(crate) fn noted_in<'a>(run: &'a RunDirectory, key: &str) -> Option<&'a str> {
    let notes = &run.manifest()?.description.notes;
    notes.iter().find(|(known, _)| known == key).map(|(_, value)| value.as_str())
}
