//! `whorl compare-runs`: what differs between two runs, in parameters and in results.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;
use whorl_math::deg_from_rad;
use whorl_params::ParameterTree;
use whorl_report::{PairDifference, ParameterDifference, overlay_html, pair_differences};

use crate::output::{JsonArgument, say};
use crate::report;
use crate::runs::write;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The first run; solid lines.
    #[arg(value_name = "A")]
    first: PathBuf,
    /// The second run; dashed lines.
    #[arg(value_name = "B")]
    second: PathBuf,
    /// Path of the page with both runs in every plot [default: A/compared.html].
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    #[command(flatten)]
    json: JsonArgument,
}

/// Carries out `whorl compare-runs`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let paths = [arguments.first.as_path(), arguments.second.as_path()];
    let [first, second] = [report::read(paths[0])?, report::read(paths[1])?];
    let runs = [&first.data, &second.data];
    let parameters = match paths.map(effective) {
        [Some(a), Some(b)] => parameter_differences(&a, &b),
        _ => {
            eprintln!("warning: one of the runs has no params/effective.yaml: parameters are not compared");
            Vec::new()
        }
    };
    let names = names(paths);
    let names = [names[0].as_str(), names[1].as_str()];
    say!("parameters that differ: {}", parameters.len());
    let headings = ["parameter", "nodes", names[0], names[1]].map(str::to_owned);
    let cells = |p: &ParameterDifference| {
        vec![p.key.clone(), p.nodes.clone(), p.values[0].clone(), p.values[1].clone()]
    };
    if !parameters.is_empty() {
        crate::table::print(&headings, &parameters.iter().map(cells).collect::<Vec<_>>());
    }
    let differences = pair_differences(runs);
    let answers: Vec<String> = differences.iter().map(sentence).collect();
    for answer in &answers {
        say!("{answer}");
    }
    let page = arguments.html.clone().unwrap_or_else(|| {
        let beside = paths[0].parent().unwrap_or(Path::new(""));
        if paths[0].is_dir() { paths[0].join("compared.html") } else { beside.join("compared.html") }
    });
    write(&page, &overlay_html(names, &answers, &parameters, runs))?;
    say!("page: {}", page.display());
    let pair = |d: &PairDifference| {
        let [a, b] = d
            .rms_rad
            .map(|(rms, error)| json!({"rms_deg": deg_from_rad(rms), "stddev_deg": deg_from_rad(error)}));
        json!({"pair": d.pair, "relative_error": [a, b], "significant": d.significant})
    };
    let parameter = |p: &ParameterDifference| json!({"key": p.key, "nodes": p.nodes, "values": p.values});
    arguments.json.write(|| {
        Ok(json!({
            "schema": 1, "runs": paths, "page": page,
            "parameters": parameters.iter().map(parameter).collect::<Vec<_>>(),
            "pairs": differences.iter().map(pair).collect::<Vec<_>>(),
        }))
    })
}

fn sentence(d: &PairDifference) -> String {
    let [a, b] =
        d.rms_rad.map(|(rms, error)| format!("{:.4} +- {:.4}", deg_from_rad(rms), deg_from_rad(error)));
    let found = if d.significant {
        "they differ beyond the noise of the runs"
    } else {
        "no difference beyond the noise of the runs"
    };
    format!("{}: relative pointing error in hold {a} deg and {b} deg RMS: {found}", d.pair)
}

/// Names that tell the runs apart: the last parts of their paths, or A and B.
fn names(paths: [&Path; 2]) -> [String; 2] {
    let last = paths.map(|p| p.file_name().map_or_else(String::new, |n| n.display().to_string()));
    if last[0] != last[1] && last.iter().all(|n| !n.is_empty()) {
        last
    } else {
        ["A", "B"].map(str::to_owned)
    }
}

/// Every parameter of every node of a run.
type Parameters = BTreeMap<(String, String), String>;

fn effective(run: &Path) -> Option<Parameters> {
    let tree = report::effective_parameters(run)?;
    let text = std::fs::read_to_string(run.join("params/effective.yaml")).ok()?;
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
fn parameter_differences(a: &Parameters, b: &Parameters) -> Vec<ParameterDifference> {
    let mut rows: BTreeMap<(String, [String; 2]), Vec<String>> = BTreeMap::new();
    for entry in a.keys().chain(b.keys().filter(|entry| !a.contains_key(*entry))) {
        let value = |of: &Parameters| of.get(entry).cloned().unwrap_or_else(|| "–".to_owned());
        let values = [value(a), value(b)];
        if values[0] != values[1] {
            rows.entry((entry.0.clone(), values)).or_default().push(entry.1.clone());
        }
    }
    let row = |((key, values), nodes): ((String, [String; 2]), Vec<String>)| ParameterDifference {
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
        let found = parameter_differences(&a, &b);
        let shown: Vec<_> = found
            .iter()
            .map(|d| (d.key.as_str(), d.nodes.as_str(), d.values[0].as_str(), d.values[1].as_str()))
            .collect();
        assert_eq!(
            shown,
            [("gain", "/a /b", "1.0", "2.0"), ("gone", "/a", "7", "–"), ("new", "/b", "–", "8")]
        );
    }
}
