//! `whorl platforms`: a parameter folder with as many platforms as wanted, for simulations of large formations.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;

use crate::output::say;

#[derive(Debug, Args)]
pub struct Arguments {
    /// How many platforms.
    #[arg(value_name = "N")]
    count: u16,
    /// Folder to write; must not exist yet.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Parameter folder to start from.
    #[arg(long, value_name = "DIR", default_value = "params")]
    params: PathBuf,
}

/// Carries out `whorl platforms`. Platforms are called whorl_1 to whorl_N; odd ones copy whorl_1, even ones whorl_2,
/// and so do their sections of every experiment. Experiments over a chain, a tree and two parallel leaders are added.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let (count, from, out) = (arguments.count, &arguments.params, &arguments.out);
    if count < 2 {
        bail!("N is {count}; allowed: 2 or more");
    }
    if out.exists() {
        bail!("{} is there already", out.display());
    }
    for folder in ["experiments", "truth"] {
        std::fs::create_dir_all(out.join(folder))
            .with_context(|| format!("cannot create {}", out.display()))?;
    }
    let names: Vec<String> = (1..=count).map(|k| format!("whorl_{k}")).collect();
    let list = format!("platforms: [{}]", names.join(", "));
    let common = read(&from.join("common.yaml"))?;
    let lines = common.lines().map(|line| match line.split_once("platforms: [") {
        Some((indent, _)) if !line.trim_start().starts_with('#') => format!("{indent}{list}\n"),
        _ => format!("{line}\n"),
    });
    write(&out.join("common.yaml"), &lines.collect::<String>())?;
    for (index, name) in names.iter().enumerate() {
        let like = pattern(index);
        for folder in ["", "truth"] {
            let text = read(&from.join(folder).join(format!("{like}.yaml")))?;
            write(&out.join(folder).join(format!("{name}.yaml")), &renamed(&text, like, name))?;
        }
    }
    let experiments = from.join("experiments");
    let entries =
        std::fs::read_dir(&experiments).with_context(|| format!("cannot read {}", experiments.display()))?;
    for entry in entries {
        let path = entry?.path();
        let Some(file) = path.file_name().filter(|_| path.extension().is_some_and(|x| x == "yaml")) else {
            continue;
        };
        let mut text = read(&path)?;
        let own = sections(&text);
        for (index, name) in names.iter().enumerate().skip(2) {
            let like = pattern(index);
            for section in own.iter().filter(|s| s.starts_with(&format!("/{like}/"))) {
                text.push_str(&renamed(section, like, name));
            }
        }
        write(&out.join("experiments").join(file), &text)?;
    }
    let pair = read(&out.join("experiments/leader_follower_short.yaml"))?;
    for graph in [Graph::Chain, Graph::Tree, Graph::ParallelLeaders] {
        let text = graph.experiment(&pair, &names).with_context(|| {
            format!(
                "leader_follower_short.yaml in {} does not have the expected content",
                experiments.display()
            )
        })?;
        write(&out.join(format!("experiments/{}.yaml", graph.name())), &text)?;
    }
    say!("{count} platforms in {}", out.display());
    Ok(())
}

/// Graph of leaders and followers in the added experiments.
#[derive(Debug, Clone, Copy)]
enum Graph {
    /// Each platform follows the one before it.
    Chain,
    /// Each platform leads two others.
    Tree,
    /// The first two lead, and every other one follows one of them.
    ParallelLeaders,
}

impl Graph {
    fn name(self) -> &'static str {
        match self {
            Self::Chain => "chain",
            Self::Tree => "tree",
            Self::ParallelLeaders => "parallel_leaders",
        }
    }

    fn words(self) -> &'static str {
        match self {
            Self::Chain => "chain",
            Self::Tree => "tree in which each leads two",
            Self::ParallelLeaders => "forest of two parallel leaders",
        }
    }

    /// Leader of a platform, counted from 0.
    fn leader(self, platform: usize) -> Option<usize> {
        match self {
            Self::Chain => platform.checked_sub(1),
            Self::Tree => platform.checked_sub(1).map(|p| p / 2),
            Self::ParallelLeaders => (platform >= 2).then_some(platform % 2),
        }
    }

    /// The experiment of a pair, extended to all platforms on this graph; `None` if the text is no such experiment.
    fn experiment(self, pair: &str, names: &[String]) -> Option<String> {
        let mut text = format!("# Written by `whorl platforms`: leader-follower over a {}.\n", self.words());
        let mut replaced = false;
        for line in pair.lines().skip_while(|line| line.starts_with('#')) {
            if line.trim_start().starts_with("whorl_2: {leader: whorl_1") {
                replaced = true;
                for (platform, name) in names.iter().enumerate() {
                    let leader = self.leader(platform);
                    // Odd and even platforms begin 20 deg apart.
                    let yaw_deg =
                        leader.map_or(0.0, |leader| 20.0 * ((platform % 2) as f64 - (leader % 2) as f64));
                    let leader = leader.and_then(|leader| names.get(leader)).map_or("\"\"", String::as_str);
                    text +=
                        &format!("        {name}: {{leader: {leader}, offset: {{yaw_deg: {yaw_deg:?}}}}}\n");
                }
            } else if line.trim_start().starts_with("description:") {
                text += &format!("      description: leader-follower over a {}\n", self.words());
            } else {
                // Both of two leaders go to the first attitude, also the one that begins elsewhere.
                text += &line
                    .replace("leader_follower_short", self.name())
                    .replace("kind: settle, duration_s: 7.0", "kind: settle, duration_s: 20.0");
                text.push('\n');
            }
        }
        replaced.then_some(text)
    }
}

fn pattern(index: usize) -> &'static str {
    if index.is_multiple_of(2) { "whorl_1" } else { "whorl_2" }
}

/// `text` with `from` replaced by `to` wherever it is a whole name.
fn renamed(text: &str, from: &str, to: &str) -> String {
    let mut result = String::with_capacity(text.len() + 64);
    let mut rest = text;
    while let Some(at) = rest.find(from) {
        let (before, after) = rest.split_at(at);
        let after = after.get(from.len()..).unwrap_or_default();
        let whole = !after.starts_with(|c: char| c.is_ascii_alphanumeric() || c == '_');
        result.push_str(before);
        result.push_str(if whole { to } else { from });
        rest = after;
    }
    result.push_str(rest);
    result
}

/// Top-level sections of a parameter file, each with its name and its content.
fn sections(text: &str) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    for line in text.lines() {
        if line.starts_with('/') {
            found.push(String::new());
        }
        if let Some(section) = found.last_mut().filter(|_| !line.starts_with('#')) {
            section.push_str(line);
            section.push('\n');
        }
    }
    found
}

fn read(path: &Path) -> anyhow::Result<String> {
    whorl_files::read_text(path).with_context(|| format!("cannot read {}", path.display()))
}

fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    whorl_files::write_file(path, text).with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_replaced_whole() {
        assert_eq!(
            renamed("/whorl_1/driver: whorl_10 whorl_1", "whorl_1", "whorl_3"),
            "/whorl_3/driver: whorl_10 whorl_3"
        );
    }

    #[test]
    fn graphs_are_those_of_their_names() {
        let leaders = |graph: Graph| (0..6).map(|p| graph.leader(p)).collect::<Vec<_>>();
        assert_eq!(leaders(Graph::Chain), [None, Some(0), Some(1), Some(2), Some(3), Some(4)]);
        assert_eq!(leaders(Graph::Tree), [None, Some(0), Some(0), Some(1), Some(1), Some(2)]);
        assert_eq!(leaders(Graph::ParallelLeaders), [None, None, Some(0), Some(1), Some(0), Some(1)]);
        let pair = "# x\nname: leader_follower_short\n        whorl_2: {leader: whorl_1, offset: {}}\n";
        let names = ["a", "b", "c"].map(str::to_owned);
        let text = Graph::Chain.experiment(pair, &names).unwrap();
        assert!(
            text.contains("name: chain\n") && text.contains("c: {leader: b, offset: {yaw_deg: -20.0}}"),
            "{text}"
        );
        assert!(Graph::Chain.experiment("steps: {}", &names).is_none());
    }

    #[test]
    fn sections_end_where_the_next_begins() {
        let text = "# a\n/whorl_1/driver:\n  x: 1\n# b\n/coordinator:\n  y: 2\n";
        assert_eq!(sections(text), ["/whorl_1/driver:\n  x: 1\n", "/coordinator:\n  y: 2\n"]);
    }
}
