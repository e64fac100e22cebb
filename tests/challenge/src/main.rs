//! Runs the challenge and prints the score.
//!
//! ```text
//! cargo run --release -p whorl_challenge -- [--quick] [--seeds N] [--cells TEXT...] [--jobs N] [--json FILE]
//! ```
//!
//! With `--json`, every case is written as one line when it is done, and cases that the file has already
//! are not run again.

use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use anyhow::{Context, Result};
use clap::Parser;
use whorl_challenge::cases::build::{Stand, separation_after_follow_up, stand_key};
use whorl_challenge::cases::{Cell, Laboratory, Spec, all_specs, build};
use whorl_challenge::score::judge::not_built;
use whorl_challenge::score::table::markdown;
use whorl_challenge::score::{Outcome, judge, table};
use whorl_challenge::write;

/// Hidden effects for the diagnosis to find, and the score.
#[derive(Debug, Parser)]
struct Arguments {
    /// Fewer cases: detectability 100 only, fewer controls and pairs.
    #[arg(long)]
    quick: bool,
    /// Seeds of every cell.
    #[arg(long, default_value_t = 3)]
    seeds: u32,
    /// Only cases whose key contains one of these, e.g. `single/air_current/`, `control`, `/100/`.
    #[arg(long, num_args = 1..)]
    cells: Vec<String>,
    /// One line of JSON for each case; resumes.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Cases at the same time.
    #[arg(long, default_value_t = 2)]
    jobs: usize,
    /// Writes every case as CSV files with their parameter file into this folder.
    #[arg(long)]
    write: Option<PathBuf>,
    /// Builds the cases and prints their detectability, without any diagnosis.
    #[arg(long)]
    only_build: bool,
    /// Only prints the table of the cases in `--json`.
    #[arg(long)]
    table: bool,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let laboratory = Laboratory::whorl_1()?;
    let mut done: Vec<Outcome> = Vec::new();
    if let Some(path) = arguments.json.as_ref().filter(|p| p.is_file()) {
        for line in std::fs::read_to_string(path).context("the JSON file")?.lines() {
            done.push(
                serde_json::from_str(line)
                    .with_context(|| format!("{}: a line is not a case", path.display()))?,
            );
        }
    }
    if !arguments.table {
        let specs: Vec<Spec> = all_specs(arguments.seeds, arguments.quick)
            .into_iter()
            .filter(|s| arguments.cells.is_empty() || arguments.cells.iter().any(|c| s.key().contains(c)))
            .filter(|s| !done.iter().any(|o| o.key == s.key()))
            .collect();
        run(&arguments, &laboratory, specs, &mut done)?;
    }
    if arguments.only_build {
        return Ok(());
    }
    done.sort_by(|a, b| a.key.cmp(&b.key));
    println!("\n{}", markdown(&table(&done), &done));
    let missing: Vec<&str> = done.iter().filter(|o| o.not_built.is_some()).map(|o| o.key.as_str()).collect();
    if !missing.is_empty() {
        println!("no plausible size shows so much ({} cases): {}", missing.len(), missing.join(", "));
    }
    Ok(())
}

/// Runs cases, those that share platform and runs one after the other.
fn run(
    arguments: &Arguments,
    laboratory: &Laboratory,
    specs: Vec<Spec>,
    done: &mut Vec<Outcome>,
) -> Result<()> {
    let mut groups: BTreeMap<String, Vec<Spec>> = BTreeMap::new();
    let mut order = Vec::new();
    let total = specs.len();
    for spec in specs {
        let key = stand_key(&spec);
        if !groups.contains_key(&key) {
            order.push(key.clone());
        }
        groups.entry(key).or_default().push(spec);
    }
    let file = match &arguments.json {
        Some(path) => Some(Mutex::new(OpenOptions::new().create(true).append(true).open(path)?)),
        None => None,
    };
    let (next, finished) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let outcomes = Mutex::new(Vec::new());
    let failure = Mutex::new(None);
    let begun = Instant::now();
    std::thread::scope(|scope| {
        for _ in 0..arguments.jobs.max(1) {
            scope.spawn(|| {
                while let Some(key) = order.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let specs = &groups[key];
                    let Some(first) = specs.first() else { continue };
                    let stand = Arc::new(Stand::new(laboratory, key, first));
                    for spec in specs {
                        let outcome = one(arguments, laboratory, &stand, spec);
                        let count = finished.fetch_add(1, Ordering::Relaxed) + 1;
                        say(&outcome, count, total, begun);
                        if let Some(file) = &file
                            && let (Ok(mut file), Ok(line)) = (file.lock(), serde_json::to_string(&outcome))
                            && let Err(error) = writeln!(file, "{line}")
                            && let Ok(mut slot) = failure.lock()
                        {
                            *slot = Some(error);
                        }
                        if let Ok(mut outcomes) = outcomes.lock() {
                            outcomes.push(outcome);
                        }
                    }
                }
            });
        }
    });
    if let Ok(Some(error)) = failure.into_inner() {
        return Err(error).context("writing the JSON file");
    }
    done.extend(outcomes.into_inner().unwrap_or_default());
    Ok(())
}

fn one(arguments: &Arguments, laboratory: &Laboratory, stand: &Arc<Stand>, spec: &Spec) -> Outcome {
    let built = match build(laboratory, stand, spec) {
        Ok(built) => built,
        Err(error) => return not_built(spec, &error.to_string()),
    };
    println!("sealed {} {}", built.answer.seal(), spec.key());
    if let Some(folder) = &arguments.write
        && let Err(error) = write::case(folder, &built)
    {
        eprintln!("{}: not written: {error:#}", spec.key());
    }
    if arguments.only_build {
        let after = if spec.cell == Cell::Confounded {
            separation_after_follow_up(stand, &built.answer)
        } else {
            None
        };
        println!("  separation after follow-up: {after:?}; values {:?}", built.answer.values);
        return Outcome {
            lambda: built.answer.lambda,
            separation: built.answer.separation,
            nearest: built.answer.nearest.clone(),
            truth: built.answer.effects.clone(),
            not_built: None,
            ..not_built(spec, "")
        };
    }
    judge(&built, if arguments.jobs > 1 { 1 } else { 2 })
}

fn say(outcome: &Outcome, count: usize, total: usize, begun: Instant) {
    let minutes = begun.elapsed().as_secs_f64() / 60.0;
    let left = minutes / count as f64 * (total - count) as f64;
    let key = &outcome.key;
    if let Some(reason) = &outcome.not_built {
        println!("[{count}/{total}, {left:.0} min left] {key}: not built: {reason}");
        return;
    }
    let judgement = match (&outcome.error, outcome.exact, outcome.first_right, outcome.wrong_name) {
        (Some(error), ..) => format!("ERROR {error}"),
        (None, _, _, true) => "WRONG NAME".to_owned(),
        (None, true, ..) => "exact".to_owned(),
        (None, false, true, _) => "right first".to_owned(),
        _ => "not found".to_owned(),
    };
    println!(
        "[{count}/{total}, {left:.0} min left] {key}: {judgement}: {} {:?}{} lambda {:.0}, separation {:.0}{}; {:.2} s",
        outcome.verdict,
        outcome.answer,
        if outcome.confounded_with.is_empty() {
            String::new()
        } else {
            format!(" or {:?}", outcome.confounded_with)
        },
        outcome.lambda,
        outcome.separation,
        outcome.nearest.as_ref().map(|n| format!(" from {n}")).unwrap_or_default(),
        outcome.seconds
    );
}
