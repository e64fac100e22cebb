//! The whole path as one page for somebody else.

use anyhow::{Result, bail};
use whorl_report::{PathPart, path_html};

use crate::bench::Workbench;

/// The questions, in the order of the path, with their headings.
const PATH: [(&str, &str); 6] = [
    ("import", "What was recorded"),
    ("compare", "How far off is the model?"),
    ("where", "Where does it fail?"),
    ("diagnose", "What is missing?"),
    ("discover", "Which law is missing?"),
    ("adopt", "What does the effect bring?"),
];

/// Every answer that there is.
///
/// # Errors
/// When nothing was asked yet.
pub fn export(bench: &Workbench) -> Result<String> {
    let part = |(what, heading): &(&str, &str)| {
        let kept = bench.kept(what)?;
        let changes = kept.done.changes.iter();
        Some(PathPart {
            heading: (*heading).to_owned(),
            sentences: kept.done.sentences.clone(),
            figures: kept.done.figures.clone(),
            changes: changes.map(|c| (c.file.clone(), c.before.clone(), c.after.clone())).collect(),
            command: kept.command.clone(),
        })
    };
    let parts: Vec<PathPart> = PATH.iter().filter_map(part).collect();
    if parts.is_empty() {
        bail!("there is nothing to export yet: compare first");
    }
    let facts = bench.runs().map(|runs| runs.facts.clone()).unwrap_or_default();
    let folder = format!("{}/", bench.folder().display());
    let facts: Vec<(String, String)> =
        facts.into_iter().map(|(name, value)| (name, value.replace(&folder, ""))).collect();
    let of = facts.iter().find(|(name, _)| name == "platform").map_or("A rig", |(_, name)| name.as_str());
    Ok(path_html(&format!("{of}: from the recording to the model"), &parts, &facts))
}
