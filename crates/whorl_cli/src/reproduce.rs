//! `whorl reproduce`: figures and tables of the dissertation on one page.

use std::path::PathBuf;

use anyhow::bail;
use whorl_report::{Reproduction, reproduction_html};
use whorl_reproduce::{ITEMS, reproduce};

use crate::runs::write;
use crate::table;

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
}

/// Carries out `whorl reproduce`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let known: Vec<&str> = ITEMS.iter().map(|(name, _)| *name).collect();
    if !arguments.all && arguments.items.is_empty() {
        for (name, title) in ITEMS {
            println!("{name:<11} {title}");
        }
        println!("whorl reproduce ITEM..., or --all");
        return Ok(());
    }
    if let Some(unknown) = arguments.items.iter().find(|item| !known.contains(&item.as_str())) {
        bail!("there is no item `{unknown}`; allowed: {}", known.join(", "));
    }
    let names: Vec<&str> =
        if arguments.all { known } else { arguments.items.iter().map(String::as_str).collect() };
    let mut items = Vec::new();
    for name in names {
        let Some(item) = reproduce(name) else { continue };
        print(&item);
        items.push(item);
    }
    let introduction = "J. L. Schwartz, The Distributed Spacecraft Attitude Control System Simulator, Ph.D. dissertation, Virginia Tech, 2004, chapter 4: recomputed, with the printed values and a comment on each difference. Errors found in the document: docs/errata.md.";
    let page = reproduction_html("The dissertation, reproduced", introduction, &items);
    write(&arguments.html, &page)?;
    println!("page: {}", arguments.html.display());
    Ok(())
}

fn print(item: &Reproduction) {
    println!("{}", item.title);
    if let Some((headings, rows)) = &item.table {
        table::print(headings, rows);
    }
    for sentence in &item.sentences {
        println!("  {sentence}");
    }
    println!();
}
