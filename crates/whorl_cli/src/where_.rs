//! `whorl where`: in which regime a model fails.

use serde_json::json;
use whorl_validation::dependence::Frame;
use whorl_validation::{Whereabouts, explain_where};

use crate::progress;
use crate::runs::{OutputArguments, RunArguments};
use crate::table::print;

/// Version of the JSON form.
const SCHEMA: u32 = 1;
/// Quantities listed in the table.
const LISTED: usize = 12;

/// Arguments of `whorl where`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    runs: RunArguments,
    #[command(flatten)]
    output: OutputArguments,
}

/// Carries out `whorl where`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let runs = progress::during("reading the runs", || arguments.runs.read())?;
    let recordings: Vec<_> = runs.training.iter().chain(&runs.held_out).collect();
    let found = progress::watched("looking into the runs", |say| {
        let looked = recordings.iter().enumerate().map(|(k, recording)| {
            say(k as f64 / recordings.len() as f64, &format!("looking into {}", recording.name));
            explain_where(recording, &runs.known.model)
        });
        looked.collect::<Result<Vec<_>, _>>()
    })?;
    for run in &found {
        for (k, sentence) in run.answer().iter().enumerate() {
            println!("{}{sentence}", if k > 0 { "  " } else { "" });
        }
    }
    for run in found.iter().filter(|run| run.is_anything_left()) {
        let d = &run.dependences;
        println!("\n{}: share of the excess that each quantity explains (shares overlap)", run.run);
        let constant = |share: f64, frame: &str| {
            let cells = ["constant", frame, &format!("{:.0}", share * 100.0), "", "", ""];
            cells.map(str::to_owned).to_vec()
        };
        let mut rows =
            vec![constant(d.constant_body_share, "body"), constant(d.constant_world_share, "world")];
        rows.extend(d.ranked.iter().take(LISTED).map(|d| {
            let (frame, axes) = match d.frame {
                Frame::Body => ("body", ["x", "y", "z"]),
                Frame::World => ("world", ["east", "north", "up"]),
            };
            vec![
                d.variable.clone(),
                frame.to_owned(),
                format!("{:.0}", d.share * 100.0),
                axes.get(d.axis).copied().unwrap_or("").to_owned(),
                format!("{:?}", d.parity).to_lowercase(),
                format!("{:?}", d.growth).to_lowercase(),
            ]
        }));
        let headings = ["quantity", "frame", "#share %", "axis", "symmetry", "growth"].map(str::to_owned);
        print(&headings, &rows);
    }
    arguments.output.write_json(|| as_json(&runs.known.platform, &found))?;
    let page = whorl_report::whereabouts_html(&found, &runs.facts);
    let page = arguments.output.write_page(&arguments.runs, "where.html", &page)?;
    println!("\npage: {}", page.display());
    Ok(())
}

fn as_json(platform: &str, found: &[Whereabouts]) -> anyhow::Result<serde_json::Value> {
    let mut list = Vec::new();
    for run in found {
        let mut value = serde_json::to_value(run)?;
        if let Some(object) = value.as_object_mut() {
            object.insert("answer".to_owned(), json!(run.answer()));
        }
        list.push(value);
    }
    Ok(json!({"schema": SCHEMA, "platform": platform, "runs": list}))
}
