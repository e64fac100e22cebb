//! `whorl where`: in which regime a model fails.

use whorl_commands::locate::as_json;
use whorl_commands::options;
use whorl_explain::locate;
use whorl_validation::{Dependences, Localisation};

use crate::explain::ExplainArguments;
use crate::output::say;
use crate::progress;
use crate::table::print;

/// Rows of the table.
const LISTED: usize = 14;

/// Arguments of `whorl where`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    explain: ExplainArguments,
}

/// Carries out `whorl where`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let runs = progress::during("reading the runs", || arguments.explain.runs.read())?;
    let found = progress::watched("analysing the runs", |say| locate(&runs.case(), &options(), say))?;
    for where_ in std::iter::once(&found.pooled).chain(&found.runs) {
        for (k, sentence) in where_.answer().iter().enumerate() {
            say!("{}{sentence}", if k > 0 { "  " } else { "" });
        }
    }
    match &found.not_refitted {
        None => {
            say!("The platform's own parameters were refitted to the runs first, within their priors.")
        }
        Some(reason) => say!("note: the platform's own parameters are as given: {reason}"),
    }
    for remark in &found.pooled.remarks {
        say!("note: {remark}");
    }
    print_shares(&found.pooled);
    arguments.explain.write_json(|| as_json(&runs.known.platform, &found))?;
    let page = whorl_report::localisation_html(&found, &runs.facts);
    let page = arguments.explain.write_page("where.html", &page)?;
    say!("\npage: {}", page.display());
    if found.pooled.is_anything_left() {
        say!("next: {}", arguments.explain.runs.sources().command("diagnose", &[]));
    }
    Ok(())
}

/// Share of the excess that each quantity explains, of body and motors.
fn print_shares(where_: &Localisation) {
    let title = |of: &str| {
        format!("\n{}: share of the excess{of} that each quantity explains (shares overlap)", where_.run)
    };
    if let Some(of_body) = &where_.dependences {
        say!("{}", title(""));
        print_table(of_body);
    }
    for motor in &where_.motors {
        if let Some(of_motor) = &motor.dependences {
            say!("{}", title(&format!(" of {}'s motor", motor.wheel)));
            print_table(of_motor);
        }
    }
}

fn print_table(found: &Dependences) {
    let rows: Vec<Vec<String>> =
        whorl_report::shares(found).into_iter().take(LISTED).map(|row| row.to_vec()).collect();
    print(&whorl_report::SHARES.map(str::to_owned), &rows);
}
