//! Headline numbers of a run, for people and other programs: `summary.json`.

use std::path::Path;

use serde_json::{Map, Value, json};

use crate::error::BagError;
use crate::layout::SUMMARY_FILE;
use crate::manifest::Manifest;
use crate::metadata::replace_file;
use crate::utc::utc;

/// The part of `summary.json` that the recording knows.
pub(crate) fn manifest_summary(manifest: &Manifest) -> Map<String, Value> {
    let value = json!({
        "experiment": manifest.description.experiment,
        "state": manifest.state.name(),
        "start_utc": utc(manifest.start_utc),
        "duration_s": manifest.duration_s(),
        "messages": manifest.message_count(),
        "lost": manifest.lost(),
        "bag_bytes": manifest.bag_bytes,
        "seed": manifest.description.seed,
    });
    match value {
        Value::Object(map) => map,
        _ => Map::new(),
    }
}

pub(crate) fn read_summary(run: &Path) -> Result<Map<String, Value>, BagError> {
    let path = run.join(SUMMARY_FILE);
    let text = match whorl_files::read_text(&path) {
        Ok(text) => text,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Map::new()),
        Err(e) => return Err(BagError::io("cannot read", &path, e)),
    };
    serde_json::from_str(&text).map_err(|e| BagError::Metadata { path, reason: e.to_string() })
}

pub(crate) fn update_summary(run: &Path, entries: &Map<String, Value>) -> Result<(), BagError> {
    let mut summary = read_summary(run)?;
    summary.extend(entries.iter().map(|(key, value)| (key.clone(), value.clone())));
    let mut text = format!("{:#}", Value::Object(summary));
    text.push('\n');
    replace_file(&run.join(SUMMARY_FILE), text.as_bytes())
}
