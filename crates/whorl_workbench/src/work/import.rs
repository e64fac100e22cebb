//! Model and map of a recording that comes with neither: as `whorl new` makes them, without questions.

use std::path::Path;

use anyhow::{Result, bail};
use serde_json::json;
use whorl_commands::new_rig::next::Next;
use whorl_commands::new_rig::questions::Nobody;
use whorl_commands::new_rig::{NewRig, Preset, new_rig};
use whorl_explain::ProgressCallback;

use crate::api::{Ask, Choice, FileChange, FileKind};
use crate::bench::Workbench;
use crate::done::Done;

pub fn import(
    bench: &Workbench,
    file: &str,
    rig: Option<&str>,
    say: &mut ProgressCallback<'_>,
) -> Result<Done> {
    let path = bench.listed(file, FileKind::Recording)?;
    let preset = match rig {
        None => None,
        Some(word) => match Preset::ALL.iter().find(|(known, _)| *known == word) {
            Some((_, preset)) => Some(*preset),
            None => {
                let known: Vec<&str> = Preset::ALL.iter().map(|(word, _)| *word).collect();
                bail!("there is no kind of rig {word:?}; allowed: {}", known.join(", "))
            }
        },
    };
    say(0.1, "finding out what is what");
    let folder = path.parent().unwrap_or(bench.folder());
    let made = new_rig(&path, folder, preset, &mut Nobody)?;
    let inside = |path: &Path| path.strip_prefix(bench.folder()).unwrap_or(path).display().to_string();
    let (model, map, recording) = (inside(&made.rig), inside(&made.map), inside(&made.file));
    let written = [&model, &map].map(|file| FileChange {
        file: file.clone(),
        before: String::new(),
        after: whorl_files::read_text(&bench.folder().join(file)).unwrap_or_default(),
    });
    let old = bench.choice();
    let choice = Choice {
        runs: vec![recording.clone()],
        held_out: old.held_out.iter().filter(|run| **run != recording).cloned().collect(),
        model: Some(model),
        channels: Some(map),
        platform: None,
        exclude: old.exclude,
    };
    let compare = matches!(made.next, Next::Compare).then_some(Ask::Compare);
    Ok(Done {
        is_answer: true,
        sentences: sentences(&made),
        json: as_json(&made),
        changes: written.to_vec(),
        choice: Some(choice),
        again: std::iter::once(Ask::Look { file: recording }).chain(compare).collect(),
        ..Done::default()
    })
}

fn sentences(made: &NewRig) -> Vec<String> {
    let mut said = vec![match made.assumed() {
        0 => "Every line was measured or stated.".to_owned(),
        1 => "1 line is assumed, as the file cannot say it.".to_owned(),
        count => format!("{count} lines are assumed, as the file cannot say them."),
    }];
    said.extend(made.refused.iter().map(|why| format!("To be corrected first: {why}")));
    match &made.next {
        Next::Compare => {}
        Next::Estimate(why) => said.push(format!("No comparison with a model: {why}.")),
        Next::Missing(what) => said.push(format!("Nothing can explain this recording as it is: {what}.")),
    }
    said.extend(made.notes.iter().cloned());
    if !made.ignored.is_empty() {
        said.push(format!("Not used: {}.", made.ignored.join(", ")));
    }
    said
}

/// Each line with where its number is from.
fn as_json(made: &NewRig) -> serde_json::Value {
    let lines: Vec<_> = made
        .lines
        .iter()
        .map(|line| {
            let source = line.source.as_ref();
            json!({"line": line.text, "depth": line.depth, "from": source.map(|(origin, _)| origin.word()),
                   "how": source.map(|(_, words)| words)})
        })
        .collect();
    json!({"platform": made.platform, "lines": lines, "assumed": made.assumed(),
           "samples": made.samples.iter().map(|(name, count)| json!({"channel": name, "samples": count})).collect::<Vec<_>>()})
}
