//! Effects become part of the model's file.

use std::path::PathBuf;
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::{Context as _, Result, bail};
use whorl_commands::adopt::{as_json, pointing, write};
use whorl_commands::{options, provenance};
use whorl_dynamics::effects::find;
use whorl_explain::{ProgressCallback, adopt};
use whorl_node::Timestamp;
use whorl_params::load_effect;
use whorl_report::adoption_figures;

use crate::api::{Ask, Choice};
use crate::bench::{Workbench, change_of};
use crate::done::Done;
use crate::project::{inside, sources, sources_in};

/// Now, UTC.
pub fn now() -> Timestamp {
    Timestamp::from_seconds(
        SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64()),
    )
}

pub fn adopted(
    bench: &Workbench,
    effects: &[String],
    anyway: bool,
    say: &mut ProgressCallback<'_>,
) -> Result<Done> {
    let effects = effects.iter().map(|id| known(bench, id)).collect::<Result<Vec<String>>>()?;
    if effects.is_empty() {
        bail!("name the effect to adopt");
    }
    say(0.0, "reading the runs");
    let choice = bench.choice();
    let runs = bench.runs()?;
    let adoption = adopt(&runs.case(), std::slice::from_ref(&effects), &options(), say)?;
    let given = sources(&choice);
    let out = given.out();
    let ids: Vec<&str> = effects.iter().map(String::as_str).collect();
    let command = given.command("adopt", &[&ids[..], &["--out", &out]].concat());
    let paths: Vec<PathBuf> = sources_in(bench.folder(), &choice).runs;
    let provenance = provenance::provenance(&paths, &command)?;
    let path = bench.folder().join(&out);
    let before = whorl_files::read_text(&path).ok();
    say(0.95, "writing, and simulating an experiment");
    // From here on nothing stops: what is written is written whole.
    write(Some(&path), anyway, &runs, &adoption, &provenance, now())?;
    let answer = adoption.answer();
    // On a thread that obeys no stop.
    let (simulated, pointed) = std::thread::scope(|scope| scope.spawn(|| pointing(&runs, &path)).join())
        .unwrap_or_else(|cause| std::panic::resume_unwind(cause));
    let mut sentences = answer.clone();
    sentences.push(pointed);
    sentences.extend(adoption.left_out.iter().map(|(version, reason)| format!("{version}: {reason}")));
    sentences.extend(runs.left_out());
    let changes = change_of(bench.folder(), &out, before).into_iter().collect();
    Ok(Done {
        is_answer: true,
        json: as_json(&runs.known.platform, &adoption.versions, &answer, &provenance, simulated.as_ref())?,
        sentences,
        figures: adoption_figures(&adoption),
        changes,
        choice: Some(Choice { model: Some(out.clone()), ..choice }),
        again: vec![Ask::Compare],
        said: Some(format!("{out}: {} is part of the model now; Undo takes it back.", effects.join(" and "))),
    })
}

/// The id of an effect, or of one in a file of the folder.
fn known(bench: &Workbench, named: &str) -> Result<String> {
    if find(named).is_some() {
        return Ok(named.to_owned());
    }
    if named.ends_with(".yaml") {
        let path = inside(bench.folder(), named)?;
        return Ok(load_effect(&path).with_context(|| named.to_owned())?.info().id.to_owned());
    }
    bail!("there is no effect {named:?}; `whorl effects` lists them")
}
