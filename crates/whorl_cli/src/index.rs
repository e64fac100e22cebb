//! `whorl runs`: what has been run, as a table and as a page.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::{Args, ValueEnum};
use serde::Serialize;
use serde_json::Value;
use whorl_bag::RunDirectory;
use whorl_math::deg_from_rad;
use whorl_math::words::{one_line, or_did_you_mean};
use whorl_report::{IndexRow, IndexedCampaign, index_html};
use whorl_tables::{Table, Values};

use crate::output::{JsonArgument, say, tell};
use crate::runs::write;

/// Folders below a given one that are searched for runs: DATE/RUN and the like.
const DEPTH: usize = 3;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Run directories, or folders that hold some, or campaigns.
    #[arg(default_value = "runs", value_name = "FOLDER")]
    folders: Vec<PathBuf>,
    /// Column to sort by.
    #[arg(long, value_enum, default_value_t = Column::Time)]
    sort: Column,
    /// Largest first.
    #[arg(long)]
    reverse: bool,
    /// Only runs in whose column the text occurs, e.g. verdict=failed; may be given several times.
    #[arg(long = "where", value_name = "COLUMN=TEXT")]
    filters: Vec<Filter>,
    /// Writes the table as a page.
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Writes the table as a Parquet file, for SQL: docs/campaigns.md.
    #[arg(long, value_name = "FILE")]
    parquet: Option<PathBuf>,
    #[command(flatten)]
    json: JsonArgument,
}

/// A column of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Column {
    Time,
    Run,
    Experiment,
    Law,
    Seed,
    Verdict,
    Error,
    Gas,
    Safe,
    Length,
    Effects,
}

/// COLUMN=TEXT.
#[derive(Debug, Clone)]
struct Filter(Column, String);

impl FromStr for Filter {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (column, wanted) = text.split_once('=').ok_or("it takes COLUMN=TEXT")?;
        let column = Column::from_str(column, true).map_err(|_| {
            let names: Vec<String> =
                Column::value_variants().iter().map(|c| format!("{c:?}").to_lowercase()).collect();
            let likely = or_did_you_mean(column, names.iter().map(String::as_str));
            format!("there is no column '{column}'; there are {}{likely}", names.join(", "))
        })?;
        Ok(Self(column, wanted.to_lowercase()))
    }
}

fn as_shown<S: serde::Serializer>(path: &Path, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&crate::output::shown(path))
}

/// A run, as the table shows it.
#[derive(Debug, Clone, Serialize, PartialEq)]
struct Row {
    #[serde(serialize_with = "as_shown")]
    run: PathBuf,
    start_utc: String,
    experiment: String,
    law: String,
    seed: Option<u64>,
    /// passed, failed, not judged; empty without a summary.
    verdict: String,
    /// Why, in a sentence.
    because: String,
    /// Largest relative pointing error in hold of all pairs, RMS \[deg\].
    error_deg: Option<f64>,
    gas_g: Option<f64>,
    safe_s: Option<f64>,
    duration_s: Option<f64>,
    /// Effects of the platforms' models.
    effects: Vec<String>,
}

/// Carries out `whorl runs`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let (mut rows, mut campaigns, mut unreadable) = (Vec::new(), Vec::new(), Vec::new());
    for folder in &arguments.folders {
        if !folder.is_dir() {
            let why = if folder.exists() { "is no folder".to_owned() } else { whorl_params::missing(folder) };
            anyhow::bail!("{} {why}", folder.display());
        }
        let mut found = |run: &Path| match row(run) {
            Ok(row) => rows.push(row),
            Err(error) => unreadable.push(format!("{}: {}", run.display(), whorl_commands::in_words(&error))),
        };
        find(folder, DEPTH, &mut found, &mut |campaign| campaigns.push(campaign.to_owned()));
    }
    rows.retain(|row| {
        arguments.filters.iter().all(|Filter(c, text)| row.text(*c).to_lowercase().contains(text))
    });
    rows.sort_by(|a, b| a.compare(b, arguments.sort));
    if arguments.reverse {
        rows.reverse();
    }
    arguments.json.write(|| Ok(&rows))?;
    print(&rows);
    for campaign in &campaigns {
        let page =
            campaign_page(campaign).map_or_else(String::new, |page| format!("; page: {}", page.display()));
        let said = format!("campaign {}: {} runs done{page}", campaign.display(), runs_done(campaign));
        say!("{}", one_line(&said));
    }
    if let Some(path) = &arguments.parquet {
        table(&rows).write(path)?;
        say!("table: {}", path.display());
    }
    for problem in &unreadable {
        tell(format_args!("warning: {}", one_line(problem)));
    }
    if let Some(path) = &arguments.html {
        let base = path.parent().unwrap_or(Path::new(""));
        let rows: Vec<IndexRow> = rows.iter().map(|row| row.on_page(base)).collect();
        let on_page = |campaign: &PathBuf| IndexedCampaign {
            name: name_of(campaign),
            runs_done: runs_done(campaign),
            link: campaign_page(campaign).map(|page| relative(&page, base)),
        };
        let campaigns: Vec<IndexedCampaign> = campaigns.iter().map(on_page).collect();
        write(path, &index_html("Runs", &rows, &campaigns))?;
        say!("page: {}", path.display());
    }
    Ok(())
}

/// The rows as a table; what is not known is null.
fn table(rows: &[Row]) -> Table {
    let texts = |of: &dyn Fn(&Row) -> String| Values::Texts(rows.iter().map(of).collect());
    let numbers = |of: &dyn Fn(&Row) -> Option<f64>| {
        Values::Numbers(rows.iter().map(|r| of(r).unwrap_or(f64::NAN)).collect())
    };
    Table::default()
        .with("run", texts(&|row| row.run.display().to_string()))
        .with("start_utc", texts(&|row| row.start_utc.clone()))
        .with("experiment", texts(&|row| row.experiment.clone()))
        .with("law", texts(&|row| row.law.clone()))
        .with("seed", numbers(&|row| row.seed.map(|seed| seed as f64)))
        .with("verdict", texts(&|row| row.verdict.clone()))
        .with("because", texts(&|row| row.because.clone()))
        .with("error_deg", numbers(&|row| row.error_deg))
        .with("gas_g", numbers(&|row| row.gas_g))
        .with("safe_s", numbers(&|row| row.safe_s))
        .with("duration_s", numbers(&|row| row.duration_s))
        .with("effects", texts(&|row| row.effects.join(", ")))
}

/// Every run directory and every campaign in a folder, the folder itself included; runs that a campaign kept are runs, too.
fn find(folder: &Path, depth: usize, run: &mut impl FnMut(&Path), campaign: &mut impl FnMut(&Path)) {
    if folder.join("manifest.yaml").is_file() {
        return run(folder);
    }
    if folder.join("campaign.txt").is_file() {
        campaign(folder);
    }
    if depth == 0 {
        return;
    }
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let mut folders: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(|p| p.is_dir()).collect();
    folders.sort();
    for folder in folders {
        find(&folder, depth - 1, run, campaign);
    }
}

/// How many runs of a campaign have their row.
fn runs_done(campaign: &Path) -> usize {
    std::fs::read_dir(campaign.join("rows")).map_or(0, |rows| rows.flatten().count())
}

/// The page of a campaign that has one.
fn campaign_page(campaign: &Path) -> Option<PathBuf> {
    Some(campaign.join("percentiles.html")).filter(|page| page.is_file())
}

/// The last part of a path, or all of it where there is none.
fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.display().to_string())
}

fn row(path: &Path) -> anyhow::Result<Row> {
    let run = RunDirectory::open(path)?;
    let manifest = run.manifest_or_from_bag()?;
    // A run that was not reported has no summary yet.
    let summary = run.summary().map(Value::Object).unwrap_or_default();
    let numbers = |list: &str, key: &str| -> Vec<f64> {
        let entries = summary[list].as_array().map_or(&[][..], Vec::as_slice);
        entries.iter().filter_map(|entry| entry[key].as_f64()).collect()
    };
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let gas = numbers("platforms", "gas_used_kg");
    let tree = crate::report::effective_parameters(path);
    let mut effects: Vec<String> = tree
        .iter()
        .flat_map(|tree| {
            manifest.description.platforms.iter().flat_map(|name| {
                let own = tree.for_node(&format!("/{name}/local_control"));
                own.children("model.effects").iter().map(|id| (*id).to_owned()).collect::<Vec<_>>()
            })
        })
        .collect();
    effects.sort();
    effects.dedup();
    Ok(Row {
        run: path.to_owned(),
        start_utc: text(&summary["start_utc"]),
        experiment: manifest.description.experiment.clone(),
        law: text(&summary["law"]),
        seed: manifest.description.seed,
        verdict: text(&summary["verdict"]["result"]).replace('_', " "),
        because: text(&summary["verdict"]["line"]),
        error_deg: numbers("pairs", "relative_error_rms_rad").into_iter().map(deg_from_rad).reduce(f64::max),
        gas_g: (!gas.is_empty()).then(|| gas.iter().sum::<f64>() * 1e3),
        safe_s: summary["verdict"]["safe_s"].as_f64(),
        duration_s: summary["duration_s"].as_f64(),
        effects,
    })
}

impl Row {
    fn text(&self, column: Column) -> String {
        let number = |value: Option<f64>, digits: usize| {
            value.map_or_else(|| "–".to_owned(), |v| format!("{v:.digits$}"))
        };
        match column {
            Column::Time => self.start_utc.clone(),
            Column::Run => name_of(&self.run),
            Column::Experiment => self.experiment.clone(),
            Column::Law => self.law.clone(),
            Column::Seed => self.seed.map_or_else(|| "–".to_owned(), |s| s.to_string()),
            Column::Verdict => self.verdict.clone(),
            Column::Error => number(self.error_deg, 4),
            Column::Gas => number(self.gas_g, 2),
            Column::Safe => number(self.safe_s, 1),
            Column::Length => number(self.duration_s, 1),
            Column::Effects => self.effects.join(", "),
        }
    }

    /// What is not known comes last.
    fn compare(&self, other: &Self, column: Column) -> std::cmp::Ordering {
        let number = |row: &Self| match column {
            Column::Seed => row.seed.map(|s| s as f64),
            Column::Error => row.error_deg,
            Column::Gas => row.gas_g,
            Column::Safe => row.safe_s,
            Column::Length => row.duration_s,
            _ => None,
        };
        let known = |row: &Self| number(row).filter(|x| x.is_finite()).unwrap_or(f64::INFINITY);
        known(self).total_cmp(&known(other)).then_with(|| self.text(column).cmp(&other.text(column)))
    }

    fn on_page(&self, base: &Path) -> IndexRow {
        let report = self.run.join("report.html");
        let link = report.is_file().then(|| relative(&report, base));
        IndexRow {
            cells: COLUMNS.iter().map(|(_, column)| self.text(*column)).collect(),
            link,
            failed: self.verdict == "failed",
            because: self.because.clone(),
        }
    }
}

/// From the folder of the page to the run's page; absolute where that is not possible.
fn relative(path: &Path, base: &Path) -> String {
    let base = if base.as_os_str().is_empty() { Path::new(".") } else { base };
    let full = |p: &Path| p.canonicalize().unwrap_or_else(|_| p.to_owned());
    let (path, base) = (full(path), full(base));
    path.strip_prefix(&base).map_or_else(|_| path.display().to_string(), |p| p.display().to_string())
}

/// Headings, with `#` before those of numbers; first what a narrow screen has to show.
const COLUMNS: [(&str, Column); 11] = [
    ("run", Column::Run),
    ("verdict", Column::Verdict),
    ("#error [deg]", Column::Error),
    ("experiment", Column::Experiment),
    ("law", Column::Law),
    ("#seed", Column::Seed),
    ("#gas [g]", Column::Gas),
    ("#safe [s]", Column::Safe),
    ("#length [s]", Column::Length),
    ("start", Column::Time),
    ("effects of the models", Column::Effects),
];

fn print(rows: &[Row]) {
    if rows.is_empty() {
        say!("no runs");
        return;
    }
    let headings: Vec<String> = COLUMNS.iter().map(|(h, _)| (*h).to_owned()).collect();
    let cells = |row: &Row| COLUMNS.iter().map(|(_, column)| row.text(*column)).collect();
    crate::table::print(&headings, &rows.iter().map(cells).collect::<Vec<_>>());
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(name: &str, error_deg: Option<f64>) -> Row {
        Row {
            run: PathBuf::from(name),
            start_utc: String::new(),
            experiment: name.to_owned(),
            law: String::new(),
            seed: None,
            verdict: String::new(),
            because: String::new(),
            error_deg,
            gas_g: None,
            safe_s: None,
            duration_s: None,
            effects: Vec::new(),
        }
    }

    #[test]
    fn numbers_are_sorted_as_numbers_and_what_is_unknown_comes_last() {
        let mut rows = [named("a", None), named("b", Some(10.0)), named("c", Some(9.0))];
        rows.sort_by(|a, b| a.compare(b, Column::Error));
        assert_eq!(rows.map(|r| r.experiment), ["c", "b", "a"]);
    }

    #[test]
    fn campaigns_are_found_beside_runs_and_so_are_the_runs_that_they_kept() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("campaigns/link");
        for (file, text) in [("campaign.txt", ""), ("rows/00000000.csv", ""), ("runs/kept/manifest.yaml", "")]
        {
            std::fs::create_dir_all(link.join(file).parent().unwrap()).unwrap();
            std::fs::write(link.join(file), text).unwrap();
        }
        let (mut runs, mut campaigns) = (Vec::new(), Vec::new());
        find(folder.path(), 4, &mut |run| runs.push(name_of(run)), &mut |found| {
            campaigns.push(found.to_owned())
        });
        assert_eq!((runs, campaigns), (vec!["kept".to_owned()], vec![link.clone()]));
        assert_eq!((runs_done(&link), campaign_page(&link)), (1, None));
    }

    #[test]
    fn a_wrong_column_is_refused_with_the_ones_there_are() {
        assert!("experiment=x".parse::<Filter>().is_ok());
        let refused = "colour=x".parse::<Filter>().unwrap_err();
        assert!(refused.contains("colour") && refused.contains("verdict"), "{refused}");
    }
}
