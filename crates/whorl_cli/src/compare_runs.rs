//! `whorl compare-runs`: what differs between runs, in parameters and in results.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::Args;
use serde_json::json;
use whorl_math::deg_from_rad;
use whorl_params::ParameterTree;
use whorl_report::{MOST_OVERLAID, PairDifference, ParameterDifference, overlay_html, pair_differences};

use crate::output::{JsonArgument, say, shown, tell};
use crate::runs::write;
use crate::{progress, report};

#[derive(Debug, Args)]
pub struct Arguments {
    /// The run that the others are compared with; solid lines.
    #[arg(value_name = "A")]
    first: PathBuf,
    /// The second run, dashed lines; a third and a fourth, dotted lines, and dashes and dots.
    #[arg(value_name = "B", required = true)]
    others: Vec<PathBuf>,
    /// Path of the page with all runs in every plot [default: A/compared.html].
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    #[command(flatten)]
    json: JsonArgument,
}

/// Carries out `whorl compare-runs`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let paths: Vec<&Path> =
        std::iter::once(&arguments.first).chain(&arguments.others).map(PathBuf::as_path).collect();
    if paths.len() > MOST_OVERLAID {
        bail!("{} runs; allowed: 2 to {MOST_OVERLAID}, as many as lines can be told apart", paths.len());
    }
    let read = || paths.iter().map(|path| report::read(path)).collect::<Result<Vec<_>, _>>();
    let read = progress::during("reading the runs", read)?;
    let runs: Vec<_> = read.iter().map(|run| &run.data).collect();
    let effective: Option<Vec<Parameters>> = paths.iter().map(|path| effective(path)).collect();
    let parameters = effective.as_deref().map_or_else(
        || {
            tell("warning: one of the runs has no params/effective.yaml: parameters are not compared");
            Vec::new()
        },
        parameter_differences,
    );
    let names = names(&paths);
    let differences = pair_differences(&runs);
    let several = paths.len() > 2;
    let answers: Vec<String> =
        differences.iter().map(|d| sentence(d, several.then(|| names[d.other].as_str()))).collect();
    for answer in &answers {
        say!("{answer}");
    }
    say!("parameters that differ: {}", parameters.len());
    let headings: Vec<String> =
        ["parameter", "nodes"].map(str::to_owned).into_iter().chain(names.iter().cloned()).collect();
    let cells = |p: &ParameterDifference| -> Vec<String> {
        [&p.key, &p.nodes].into_iter().chain(&p.values).cloned().collect()
    };
    if !parameters.is_empty() {
        crate::table::print(&headings, &parameters.iter().map(cells).collect::<Vec<_>>());
    }
    let page = arguments.html.clone().unwrap_or_else(|| {
        let beside = paths[0].parent().unwrap_or(Path::new(""));
        if paths[0].is_dir() { paths[0].join("compared.html") } else { beside.join("compared.html") }
    });
    write(&page, &overlay_html(&names, &answers, &parameters, &runs))?;
    say!("page: {}", page.display());
    let pair = |d: &PairDifference| {
        let [a, b] = d
            .rms_rad
            .map(|(rms, error)| json!({"rms_deg": deg_from_rad(rms), "stddev_deg": deg_from_rad(error)}));
        json!({"pair": d.pair, "run": shown(paths[d.other]), "relative_error": [a, b], "significant": d.significant})
    };
    let parameter = |p: &ParameterDifference| json!({"key": p.key, "nodes": p.nodes, "values": p.values});
    arguments.json.write(|| {
        Ok(json!({
            "schema": 1, "runs": paths.iter().map(|path| shown(path)).collect::<Vec<_>>(), "page": shown(&page),
            "parameters": parameters.iter().map(parameter).collect::<Vec<_>>(),
            "pairs": differences.iter().map(pair).collect::<Vec<_>>(),
        }))
    })
}

/// What was found of a pair; `other` names the run that the first was compared with, where there are several.
fn sentence(d: &PairDifference, other: Option<&str>) -> String {
    let [a, b] =
        d.rms_rad.map(|(rms, error)| format!("{:.4} +- {:.4}", deg_from_rad(rms), deg_from_rad(error)));
    let found = if d.significant {
        "they differ beyond the noise of the runs"
    } else {
        "no difference beyond the noise of the runs"
    };
    let of = other.map_or_else(String::new, |name| format!(" ({name})"));
    format!("{}: relative pointing error in hold {a} deg and {b} deg{of} RMS: {found}", d.pair)
}

/// Names that tell the runs apart: the last parts of their paths, or A, B and so on.
fn names(paths: &[&Path]) -> Vec<String> {
    let last = |p: &&Path| p.file_name().map_or_else(String::new, |n| n.display().to_string());
    let last: Vec<String> = paths.iter().map(last).collect();
    let alike = (1..last.len()).any(|k| last[..k].contains(&last[k]));
    if alike || last.iter().any(String::is_empty) {
        ('A'..).take(paths.len()).map(String::from).collect()
    } else {
        last
    }
}

/// Every parameter of every node of a run.
type Parameters = BTreeMap<(String, String), String>;

fn effective(run: &Path) -> Option<Parameters> {
    let tree = report::effective_parameters(run)?;
    let text = whorl_files::read_text(&run.join("params/effective.yaml")).ok()?;
    let nodes = text.lines().filter_map(|line| line.strip_suffix(':').filter(|name| name.starts_with('/')));
    Some(parameters(&tree, nodes))
}

fn parameters<'a>(tree: &ParameterTree, nodes: impl Iterator<Item = &'a str>) -> Parameters {
    nodes
        .flat_map(|node| {
            let own = tree.for_node(node);
            own.iter().map(|e| ((e.key.clone(), node.to_owned()), e.value.to_string())).collect::<Vec<_>>()
        })
        .collect()
}

/// Those that differ, with the nodes among which the values are the same in one row.
fn parameter_differences(runs: &[Parameters]) -> Vec<ParameterDifference> {
    let mut rows: BTreeMap<(String, Vec<String>), Vec<String>> = BTreeMap::new();
    let entries: BTreeSet<&(String, String)> = runs.iter().flat_map(BTreeMap::keys).collect();
    for entry in entries {
        let value = |of: &Parameters| of.get(entry).cloned().unwrap_or_else(|| "–".to_owned());
        let values: Vec<String> = runs.iter().map(value).collect();
        if values.iter().any(|value| *value != values[0]) {
            rows.entry((entry.0.clone(), values)).or_default().push(entry.1.clone());
        }
    }
    let row = |((key, values), nodes): ((String, Vec<String>), Vec<String>)| ParameterDifference {
        key,
        nodes: nodes.join(" "),
        values,
    };
    rows.into_iter().map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_are_compared_node_by_node_and_shown_once() {
        let of = |list: &[(&str, &str, &str)]| -> Parameters {
            list.iter().map(|(k, n, v)| (((*k).to_owned(), (*n).to_owned()), (*v).to_owned())).collect()
        };
        let a = of(&[("gain", "/a", "1.0"), ("gain", "/b", "1.0"), ("same", "/a", "x"), ("gone", "/a", "7")]);
        let b = of(&[("gain", "/a", "2.0"), ("gain", "/b", "2.0"), ("same", "/a", "x"), ("new", "/b", "8")]);
        let found = parameter_differences(&[a.clone(), b, a]);
        let shown: Vec<_> =
            found.iter().map(|d| (d.key.as_str(), d.nodes.as_str(), d.values.join(" "))).collect();
        assert_eq!(
            shown,
            [("gain", "/a /b", "1.0 2.0 1.0"), ("gone", "/a", "7 – 7"), ("new", "/b", "– 8 –")]
                .map(|(key, nodes, values)| (key, nodes, values.to_owned()))
        );
    }
}
