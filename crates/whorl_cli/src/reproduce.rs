//! `whorl reproduce`: figures and tables of the dissertation on one page.

use std::path::PathBuf;

use anyhow::bail;
use serde_json::json;
use whorl_math::words::or_did_you_mean;
use whorl_report::{Reproduction, reproduction_html};
use whorl_reproduce::{ITEMS, reproduce};

use crate::output::{JsonArgument, say};
use crate::runs::write;
use crate::{progress, table};

#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Items to reproduce, e.g. fig_4_16 or table_4_3; without any, all are listed.
    #[arg(value_name = "ITEM")]
    items: Vec<String>,
    /// Reproduces all items.
    #[arg(long, conflicts_with = "items")]
    all: bool,
    /// Path of the HTML page.
    #[arg(long, value_name = "FILE", default_value = "reproduction.html")]
    html: PathBuf,
    #[command(flatten)]
    json: JsonArgument,
}

/// Carries out `whorl reproduce`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let known: Vec<&str> = ITEMS.iter().map(|(name, _)| *name).collect();
    if !arguments.all && arguments.items.is_empty() {
        for (name, title) in ITEMS {
            say!("{name:<11} {title}");
        }
        say!("whorl reproduce ITEM..., or --all");
        let listed =
            || ITEMS.iter().map(|(name, title)| json!({"item": name, "title": title})).collect::<Vec<_>>();
        return arguments.json.write(|| Ok(listed()));
    }
    if let Some(unknown) = arguments.items.iter().find(|item| !known.contains(&item.as_str())) {
        let likely = or_did_you_mean(unknown, known.iter().copied());
        bail!("there is no item `{unknown}`; allowed: {}{likely}", known.join(", "));
    }
    let names: Vec<&str> =
        if arguments.all { known } else { arguments.items.iter().map(String::as_str).collect() };
    let (mut items, mut values) = (Vec::new(), Vec::new());
    for name in names {
        let Some(item) = progress::during(name, || reproduce(name)) else { continue };
        print(&item);
        let table = item.table.as_ref().map(|(headings, rows)| json!({"headings": headings, "rows": rows}));
        values.push(json!({"item": name, "title": item.title, "table": table, "sentences": item.sentences}));
        items.push(item);
    }
    let introduction = "J. L. Schwartz, The Distributed Spacecraft Attitude Control System Simulator, Ph.D. dissertation, Virginia Tech, 2004, chapter 4: recomputed, with the printed values and a comment on each difference. Errors found in the document: docs/errata.md.";
    let page = reproduction_html("The dissertation, reproduced", introduction, &items);
    write(&arguments.html, &page)?;
    say!("page: {}", arguments.html.display());
    arguments.json.write(|| Ok(values))
}

fn print(item: &Reproduction) {
    say!("{}", item.title);
    if let Some((headings, rows)) = &item.table {
        table::print(headings, rows);
    }
    for sentence in &item.sentences {
        say!("  {sentence}");
    }
    say!();
}
