//! Campaigns: their plan from a file, their folder, their tables.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use whorl_campaign::work::Folder;
use whorl_campaign::{Plan, Row, definition, page, table};
use whorl_params::{ParameterTree, try_read};

/// The plan of a campaign file, checked; `params` is the parameter folder (`None`: the file's `../`), `seeds` replaces the
/// file's number of seeds.
///
/// # Errors
/// What is wrong with the file, or with runs that cannot begin.
pub fn planned(file: &Path, params: Option<&Path>, seeds: Option<u64>) -> anyhow::Result<Plan> {
    if !file.is_file() {
        bail!("{} {}", file.display(), whorl_params::missing(file));
    }
    let parameters = match params {
        Some(folder) => folder.to_owned(),
        None => file
            .parent()
            .and_then(Path::parent)
            .filter(|folder| folder.join("common.yaml").is_file())
            .map(Path::to_owned)
            .with_context(|| {
                format!(
                    "{} is not in a folder campaigns/ beside a common.yaml; name the parameter folder with --params",
                    file.display()
                )
            })?,
    };
    let tree = ParameterTree::load(&[file.to_owned()], &[])?;
    tree.check_sections(["/campaign"])?;
    let (mut definition, _) = try_read(&tree.for_node("/campaign"), |r| Some(definition::read(r)))?;
    if let Some(seeds) = seeds {
        if seeds == 0 {
            bail!("--seeds is 0; allowed: at least 1");
        }
        definition.seeds = seeds;
    }
    let plan = Plan::new(definition, &parameters)?;
    plan.check()?;
    Ok(plan)
}

/// The folder of a campaign, new or to be resumed.
///
/// # Errors
/// A folder that cannot be written, or that holds another campaign.
pub fn opened(out: &Path, plan: &Plan) -> anyhow::Result<Folder> {
    Folder::open(out, &fingerprint(plan)?).with_context(|| format!("cannot use {}", out.display()))
}

/// Fingerprint of the plan and the parameter files, so that a folder is not continued with another campaign.
fn fingerprint(plan: &Plan) -> anyhow::Result<String> {
    let mut text = format!("whorl {}\n", env!("CARGO_PKG_VERSION"));
    let first_of_each = plan.len().div_euclid(plan.definition.experiments.len().max(1) as u64).max(1);
    for k in 0..plan.definition.experiments.len() as u64 {
        for layer in plan.run(k * first_of_each).map(|spec| spec.layers).unwrap_or_default() {
            let content = std::fs::read_to_string(&layer)
                .with_context(|| format!("cannot read {}", layer.display()))?;
            // Not its folder: the same campaign may be given by other spellings of its paths.
            let name = layer.file_name().unwrap_or_default().to_string_lossy();
            text.push_str(&format!("# {name}\n{content}\n"));
        }
    }
    text.push_str(&format!("{:#?}\n", plan.definition));
    Ok(text)
}

/// Files of a campaign's results.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tables {
    /// All rows as CSV.
    pub csv: PathBuf,
    /// Folder with all rows as Parquet.
    pub parquet: PathBuf,
    /// Page of percentiles.
    pub page: PathBuf,
}

/// Writes tables and page of these rows into the campaign's folder.
///
/// # Errors
/// When a file cannot be written.
pub fn write_tables(folder: &Folder, plan: &Plan, rows: &[Row]) -> anyhow::Result<Tables> {
    let csv = folder.path().join("summary.csv");
    std::fs::write(&csv, table::csv_text(plan, rows))
        .with_context(|| format!("cannot write {}", csv.display()))?;
    let parquet = folder.path().join("table");
    table::write_parquet(plan, rows, &parquet)?;
    let page = folder.path().join("percentiles.html");
    std::fs::write(&page, page::html(plan, &table::groups(rows)))
        .with_context(|| format!("cannot write {}", page.display()))?;
    Ok(Tables { csv, parquet, page })
}
