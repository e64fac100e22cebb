//! `whorl discover`: the law of what no effect of the catalogue explains.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use whorl_commands::discover::{answer, as_json, competitors, settled};
use whorl_identification::{Discovery, EvaluatedLaw, discover};
use whorl_math::three_digits;
use whorl_params::effect_yaml;

use crate::explain::{ExplainArguments, SearchArguments};
use crate::output::say;
use crate::progress;
use crate::provenance::provenance_of_this;
use crate::runs::write;
use crate::table::print;

/// Arguments of `whorl discover`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    explain: ExplainArguments,
    #[command(flatten)]
    search: SearchArguments,
    /// Writes the best law as an effect: NAME.yaml, which `whorl adopt RUN... NAME.yaml --out FILE` takes.
    #[arg(long, value_name = "NAME.yaml")]
    write: Option<PathBuf>,
    /// Searches even if a named effect explains the data, or nothing is missing.
    #[arg(long)]
    anyway: bool,
}

/// Carries out `whorl discover`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if let Some(path) = &arguments.write {
        id_of(path)?;
    }
    let runs = progress::during("reading the runs", || arguments.explain.runs.read())?;
    let options = arguments.search.options()?;
    let case = runs.case();
    let diagnosis = progress::watched("asking the catalogue", |say| {
        let mut said = |p: whorl_identification::Progress| say(p.share, p.doing);
        whorl_identification::diagnose(
            case.training,
            case.held_out,
            case.model,
            case.prior,
            &options,
            &mut said,
        )
    })?;
    if let Some(reason) = settled(&diagnosis).filter(|_| !arguments.anyway) {
        for sentence in diagnosis.answer() {
            say!("{sentence}");
        }
        say!("{reason} --anyway searches nevertheless.");
        arguments
            .explain
            .write_json(|| as_json(&runs.known.platform, &diagnosis, None, std::slice::from_ref(&reason)))?;
        if arguments.write.is_some() {
            bail!("nothing was written: there is no law to write");
        }
        return Ok(());
    }
    let named = competitors(&diagnosis);
    let id = arguments.write.as_deref().map_or_else(|| Ok("discovered_law".to_owned()), id_of)?;
    let found = progress::watched("searching for a law", |say| {
        discover(case.training, case.held_out, case.model, case.prior, &named, &id, &options, say)
    })?;
    let answer = answer(&found);
    for sentence in &answer {
        say!("{sentence}");
    }
    say!();
    print_laws(&found);
    for remark in runs.left_out() {
        say!("note: {remark}");
    }
    let provenance = provenance_of_this(&arguments.explain.runs)?;
    if let Some(path) = &arguments.write {
        let best = found.best().with_context(|| "nothing was written: no law is more probable than none")?;
        written(path, best, &provenance)?;
    }
    arguments.explain.write_json(|| as_json(&runs.known.platform, &diagnosis, Some(&found), &answer))?;
    let page = whorl_report::discovery_html(&found, &answer, &runs.facts);
    let page = arguments.explain.write_page("discover.html", &page)?;
    say!("page: {}", page.display());
    if let Some(law) = &arguments.write {
        let sources = arguments.explain.runs.sources();
        say!("next: {}", sources.command("adopt", &[&law.display().to_string(), "--out", &sources.out()]));
    }
    Ok(())
}

fn id_of(path: &Path) -> anyhow::Result<String> {
    if path.extension().is_none_or(|e| e != "yaml") {
        bail!("{}: the file of an effect is called NAME.yaml, NAME being its id", path.display());
    }
    let id = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let plain = id.starts_with(|c: char| c.is_ascii_lowercase())
        && id.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_');
    if !plain {
        bail!("{}: the file's name is the effect's id; allowed: small letters, digits and _", path.display());
    }
    Ok(id)
}

fn written(path: &Path, law: &EvaluatedLaw, provenance: &str) -> anyhow::Result<()> {
    let definition = law.definition.clone().with_context(|| "this law is no effect of its own")?;
    let id = id_of(path)?;
    let fitted: Vec<String> =
        law.parameters.iter().map(|p| format!("{} = {} {}", p.name, three_digits(p.value), p.unit)).collect();
    let comment = format!("{}\nFitted here: {}.\n{provenance}", law.sentence, fitted.join(", "));
    let definition = whorl_dynamics::effects::written::Definition { id: id.clone(), ..definition };
    write(path, &effect_yaml(&definition, &comment))?;
    say!("{}: written", path.display());
    Ok(())
}

fn print_laws(found: &Discovery) {
    let rows: Vec<Vec<String>> = found
        .laws
        .iter()
        .map(|law| {
            vec![
                law.kind.to_owned(),
                format!("{:.1}", 100.0 * law.probability),
                format!("{:.1}", law.log_evidence),
                law.held_out_gain.map_or_else(|| "-".to_owned(), |gain| format!("{gain:.1}")),
                if law.equation.is_empty() { law.sentence.clone() } else { law.equation.clone() },
            ]
        })
        .collect();
    print(&["", "#probability %", "#log evidence", "#held out", "equation"].map(str::to_owned), &rows);
}
