//! `whorl parameters`: every parameter of every node, with default, range and meaning.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use serde_json::{Map, Value, json};
use whorl_math::words::or_did_you_mean;
use whorl_params::{
    ListedDefault, ListedParameter, NodeParameters, ParameterTree, Reader, formation, is_shared,
    list_parameters, standard_layers,
};

use crate::output::{JsonArgument, text};

/// Arguments of `whorl parameters`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Nodes, e.g. estimator, or a shared group such as model; none: all.
    #[arg(value_name = "NODE")]
    nodes: Vec<String>,
    /// Parameter folder, whose files say which wheels, jets and steps there are.
    #[arg(long, value_name = "DIR", default_value = "params")]
    params: PathBuf,
    #[command(flatten)]
    json: JsonArgument,
}

/// Carries out `whorl parameters`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let sections = sections(&arguments.params)?;
    let known: Vec<&str> = sections.keys().map(String::as_str).collect();
    if let Some(unknown) = arguments.nodes.iter().find(|node| !known.contains(&node.as_str())) {
        let likely = or_did_you_mean(unknown, known.iter().copied());
        bail!("there is no node or shared group {unknown}; allowed: {}{likely}", known.join(", "));
    }
    let wanted = |name: &str| arguments.nodes.is_empty() || arguments.nodes.iter().any(|node| node == name);
    text(&page(sections.iter().filter(|(name, _)| wanted(name))));
    let listed = |(name, listed): (&String, &Vec<ListedParameter>)| {
        let values: Vec<Value> = listed.iter().map(as_json).collect();
        (name.clone(), Value::Array(values))
    };
    arguments
        .json
        .write(|| Ok(sections.iter().filter(|(name, _)| wanted(name)).map(listed).collect::<Map<_, _>>()))
}

fn as_json(parameter: &ListedParameter) -> Value {
    let (default, is) = match &parameter.default {
        ListedDefault::Required => (Value::Null, "required"),
        ListedDefault::Depends => (Value::Null, "depends"),
        ListedDefault::None => (Value::Null, "none"),
        ListedDefault::Value(value) => (Value::String(value.to_string()), "value"),
    };
    json!({
        "key": parameter.key,
        "default": default,
        "default_is": is,
        "while_it_runs": !parameter.read_only,
        "allowed": parameter.allowed,
        "meaning": parameter.doc,
    })
}

/// What a node asks for.
type Ask = fn(&mut Reader<'_>);

/// Nodes that every platform has one of.
const OF_PLATFORMS: [(&str, Ask); 4] = [
    ("driver", |r| drop(whorl_driver::parameters::read(r))),
    ("estimator", |r| drop(whorl_estimator::parameters::read(r))),
    ("local_control", |r| drop(whorl_local_control::parameters::read(r))),
    ("model_monitor", |r| drop(whorl_model_monitor::parameters::read(r))),
];
/// Nodes that exist once.
const OF_THE_FORMATION: [(&str, Ask); 3] = [
    ("coordinator", |r| drop(whorl_coordinator::parameters::read(r))),
    ("recorder", |r| drop(whorl_recorder::parameters::read(r))),
    ("simulation", whorl_sim::ask_simulation),
];

/// The parameters of each node, and of each shared group, by its name.
fn sections(folder: &Path) -> anyhow::Result<BTreeMap<String, Vec<ListedParameter>>> {
    let common = ParameterTree::load(&standard_layers(folder, &[], None), &[])?;
    let platforms = formation(&mut Reader::new(&common.for_node("/coordinator"))).platforms;
    let names: Vec<&str> = platforms.iter().map(String::as_str).collect();
    let trees = files(&folder.join("experiments"))?
        .iter()
        .map(|experiment| ParameterTree::load(&standard_layers(folder, &names, Some(experiment)), &[]))
        .collect::<Result<Vec<_>, _>>()?;
    let mut sections: BTreeMap<String, Vec<ListedParameter>> = BTreeMap::new();
    let mut take = |node: &str, bases: &[NodeParameters], ask: Ask| {
        for parameter in list_parameters(bases, &platforms, ask) {
            let group = parameter.key.split('.').next().unwrap_or_default();
            let section = if is_shared(&parameter.key) { group } else { node };
            let listed = sections.entry(section.to_owned()).or_default();
            // A shared group is read by several nodes.
            let known = listed.iter().any(|p| p.key == parameter.key && p.doc == parameter.doc);
            if !known && !parameter.key.contains(".effects.") {
                listed.push(parameter);
            }
        }
    };
    for (node, ask) in OF_THE_FORMATION {
        let bases: Vec<_> = trees.iter().map(|tree| tree.for_node(&format!("/{node}"))).collect();
        take(node, &bases, ask);
    }
    for (node, ask) in OF_PLATFORMS {
        let of_tree = |tree: &ParameterTree| -> Vec<NodeParameters> {
            names.iter().map(|platform| tree.for_node(&format!("/{platform}/{node}"))).collect()
        };
        take(node, &trees.iter().flat_map(of_tree).collect::<Vec<_>>(), ask);
    }
    let campaigns = files(&folder.join("campaigns"))?;
    let campaigns = campaigns.into_iter().map(|file| ParameterTree::load(&[file], &[]));
    let campaigns =
        campaigns.map(|tree| tree.map(|t| t.for_node("/campaign"))).collect::<Result<Vec<_>, _>>()?;
    let (over_recordings, over_experiments): (Vec<_>, Vec<_>) =
        campaigns.into_iter().partition(|campaign: &NodeParameters| campaign.get("recordings").is_some());
    take("campaign", &over_experiments, |r| drop(whorl_campaign::definition::read(r)));
    take("campaign", &over_recordings, |r| drop(whorl_campaign::recordings::read(r)));
    sections.values_mut().for_each(|listed| listed.sort_by(|a, b| (&a.key, &a.doc).cmp(&(&b.key, &b.doc))));
    Ok(sections)
}

/// The parameter files of a folder, in the order of their names; none when it does not exist.
fn files(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let entries = std::fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
    let mut files: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|extension| extension == "yaml"))
        .collect();
    files.sort();
    Ok(files)
}

const HEAD: &str = "# Parameters

Made by `whorl parameters > docs/parameters.md` from the definitions that the nodes read; a test says when it is out of date.
How the files are written: [params/README.md](../params/README.md). Experiments: [experiments.md](experiments.md).

`<platform>` stands for the name of a platform, `<name>` for one that the file gives (a jet, a step, ...). A value in the column
*default* is in force when the key is left out; *required* must be given, *depends* follows from other parameters, and what
has none may be left out. A dot marks what can be set while the node runs (`ros2 param set`). Keys that stand twice mean
different things in different places, as the text says. `truth` takes every key of `model`; those listed are the ones that
the files here set. The physical effects below `model.effects` and `truth.effects`:
`whorl effects`.
";

fn page<'a>(sections: impl Iterator<Item = (&'a String, &'a Vec<ListedParameter>)>) -> String {
    let mut text = HEAD.to_owned();
    for (name, listed) in sections {
        let what = if is_shared(name) { "Shared group" } else { "Node" };
        text.push_str(&format!(
            "\n## {what} `{name}`\n\n| key | | default | allowed | meaning |\n|---|---|---|---|---|\n"
        ));
        for parameter in listed {
            let default = match &parameter.default {
                ListedDefault::Required => "*required*".to_owned(),
                ListedDefault::Depends => "*depends*".to_owned(),
                ListedDefault::None => String::new(),
                ListedDefault::Value(value) => format!("`{value}`"),
            };
            let cells = [
                format!("`{}`", parameter.key),
                if parameter.read_only { String::new() } else { "·".to_owned() },
                default,
                parameter.allowed.clone(),
                parameter.doc.clone(),
            ];
            text.push_str(&format!("| {} |\n", cells.map(|cell| cell.replace('|', "\\|")).join(" | ")));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

    #[test]
    fn the_page_of_parameters_is_current() {
        let sections = sections(&Path::new(ROOT).join("params")).unwrap();
        let made = page(sections.iter());
        let written = std::fs::read_to_string(Path::new(ROOT).join("docs/parameters.md")).unwrap_or_default();
        let differing = made.lines().zip(written.lines().chain(std::iter::repeat(""))).find(|(a, b)| a != b);
        assert!(
            made == written,
            "docs/parameters.md is out of date: `whorl parameters > docs/parameters.md`; first difference: {differing:#?}"
        );
    }

    #[test]
    fn what_stands_behind_choices_is_listed_and_explained() {
        let sections = sections(&Path::new(ROOT).join("params")).unwrap();
        let has = |section: &str, key: &str| sections[section].iter().any(|p| p.key == key);
        for law in whorl_control::formation::catalogue() {
            // The leader-follower law has settings of its members only.
            let own = format!("law.{}.", law.kind());
            let listed = sections["coordinator"].iter().any(|p| p.key.starts_with(&own));
            assert!(listed || law.kind() == "leader_follower", "{own}");
        }
        assert!(has("coordinator", "law.members.<platform>.leader"));
        assert!(has("coordinator", "steps.<name>.kind"));
        assert!(has("driver", "replay.source"));
        assert!(has("model", "model.jets.<name>.thrust_n"));
        assert!(sections["truth"].iter().all(|p| p.key.starts_with("truth.")), "{:?}", sections["truth"]);
        for (section, listed) in &sections {
            for parameter in listed {
                assert!(
                    !parameter.doc.is_empty() && !parameter.allowed.is_empty(),
                    "{section} {}",
                    parameter.key
                );
            }
        }
    }
}
