//! An example or more for every command: in its --help, in its manual page.

use clap::Command;

/// The words after `whorl`, and examples: lines of commands, each perhaps with what it is for, after three spaces.
const EXAMPLES: &[(&str, &str)] = &[
    ("init", "whorl init laboratory   writes laboratory/params"),
    (
        "new",
        "whorl new swing.csv   writes swing.yaml and swing.channels.yaml, and asks what the file does not show
whorl new my_bag --out rigs --no-questions --json -",
    ),
    (
        "run",
        "whorl run leader_follower   two platforms, two minutes
whorl run leader_follower_short --live   shown in a browser meanwhile
whorl run swing --platforms \"whorl_1\" --backend hardware",
    ),
    ("nodes platform", "whorl nodes platform whorl_1 --backend hardware"),
    ("nodes coordinator", "whorl nodes coordinator --experiment leader_follower"),
    ("nodes recorder", "whorl nodes recorder --experiment leader_follower"),
    ("nodes stop", "whorl nodes stop"),
    ("nodes list", "whorl nodes list"),
    ("emulators", "whorl emulators whorl_1 whorl_2"),
    ("arm", "whorl arm whorl_1 whorl_2"),
    ("disarm", "whorl disarm whorl_1"),
    (
        "checkout",
        "whorl checkout whorl_1 --yes
whorl checkout whorl_1 --backend sim --json checkout.json",
    ),
    (
        "doctor",
        "whorl doctor
whorl doctor whorl_1 --json -",
    ),
    (
        "simulate",
        "whorl simulate --experiment leader_follower --out /tmp/run --seed 2
whorl simulate --experiment params/experiments/swing.yaml -p /coordinator:law.kind:=decentralised
whorl simulate --experiment swing --no-record --json -   the speed, for a script",
    ),
    (
        "campaign",
        "whorl campaign params/campaigns/link.yaml   on all cores; the same command resumes it
whorl campaign params/campaigns/link.yaml --dry-run   lists the runs
whorl parameters campaign   explains the keys of a campaign's file
whorl campaign params/campaigns/link.yaml --engine dask --scheduler tcp://scheduler:8786",
    ),
    (
        "orbit",
        "whorl orbit co_observation --every 30 --html pass.html
whorl orbit formation_keeping --html keeping.html   flies five days of corrections, too
whorl orbit params/experiments/co_observation.yaml -p /coordinator:steps.observe.time_ratio:=2.0",
    ),
    ("platforms", "whorl platforms 4 --out my_platforms"),
    (
        "estimate",
        "whorl estimate hand.csv --channels params/channels/broad.yaml --out attitude.csv
whorl estimate satellite.csv --channels map.yaml --filter directions --smooth",
    ),
    ("start", "whorl start"),
    ("hold", "whorl hold \"somebody is at the platform\""),
    ("abort", "whorl abort \"the air supply is low\""),
    (
        "monitor",
        "whorl monitor
whorl monitor whorl_1 --stay
whorl monitor --json -   an object to a line, ten in a second",
    ),
    (
        "live",
        "whorl live
whorl live --foxglove   and every topic for Foxglove and Lichtblick
whorl live whorl_1 whorl_2 --bind 0.0.0.0 --read-only   for everybody in the network to watch",
    ),
    (
        "report",
        "whorl report runs/2026-11-21T06-32-49Z_leader_follower
whorl report runs/* --json -   the numbers of all runs",
    ),
    (
        "runs",
        "whorl runs   every run in runs/, oldest first
whorl runs --sort error --where experiment=leader   the runs of some experiments, best first
whorl runs --where verdict=failed   what went wrong
whorl runs --parquet runs.parquet   a table for SQL: docs/campaigns.md
whorl runs --html runs/index.html   a page that sorts, filters and links to every run's page",
    ),
    (
        "compare-runs",
        "whorl compare-runs runs/2026-11-21T06-32-49Z_leader_follower runs/2026-11-21T07-10-02Z_leader_follower
whorl compare-runs BEST SECOND THIRD --html three.html   three or four in one page",
    ),
    (
        "import csv",
        "whorl import csv table.csv --channels params/channels/whorl.yaml --platform params/whorl_1.yaml --out runs/table",
    ),
    (
        "import bag",
        "whorl import bag foreign_bag --channels map.yaml --platform params/whorl_1.yaml --out runs/foreign",
    ),
    (
        "export csv",
        "whorl export csv RUN --out exported
whorl export csv RUN --out exported --topics   a file to each topic, with every field",
    ),
    ("export parquet", "whorl export parquet runs/* --out tables"),
    (
        "open",
        "whorl open laboratory   a folder with recordings and a platform's file
whorl open swing.csv   what is missing is made of the recording",
    ),
    (
        "compare",
        "whorl compare RUN --model params/whorl_1.yaml
whorl compare RUN --held-out OTHER_RUN --refit --json -",
    ),
    ("where", "whorl where RUN --model params/whorl_1.yaml"),
    (
        "diagnose",
        "whorl diagnose RUN --held-out OTHER_RUN --model params/whorl_1.yaml
whorl diagnose RUN --exclude harness_spring --json diagnosis.json",
    ),
    ("discover", "whorl discover RUN --held-out OTHER_RUN --write found_law.yaml"),
    (
        "adopt",
        "whorl adopt RUN bearing_viscous_friction --held-out OTHER_RUN --out params/whorl_1.yaml
whorl adopt RUN --try bearing_viscous_friction,harness_spring   compares, and writes nothing",
    ),
    (
        "history",
        "whorl history params/whorl_1.yaml
whorl history runs/2026-11-* --platform whorl_1
whorl history runs/2026-11-* --platform whorl_1 --since runs/2026-11-21T06-32-49Z_hold --json history.json",
    ),
    ("next", "whorl next RUN --held-out OTHER_RUN --out params/experiments/separate.yaml"),
    (
        "effects",
        "whorl effects
whorl effects bearing_viscous_friction
whorl effects params/effects/vane_drag.yaml   checks an effect of your own",
    ),
    (
        "parameters",
        "whorl parameters estimator
whorl parameters campaign",
    ),
    (
        "identify",
        "whorl identify RUN --platform whorl_1   look
whorl identify RUN --platform whorl_1 --out params/whorl_1.yaml   and write",
    ),
    ("excitation", "whorl excitation params/experiments/identify_whorl_1.yaml"),
    ("balance", "whorl balance RUN --platform whorl_1 --ballast battery:1,1,0:30:50"),
    ("calibrate imu", "whorl calibrate imu RUN --model params/whorl_1.yaml --dry-run"),
    ("security create", "whorl security create keystore --platforms whorl_1 whorl_2 --domain 7"),
    ("security list", "whorl security list keystore"),
    ("security check", "whorl security check keystore --domain 7"),
    (
        "demo",
        "whorl demo
whorl demo --outside --seed 7 --out my_demo   a law that no catalogue has; keeps everything in my_demo",
    ),
    (
        "reproduce",
        "whorl reproduce   lists the items
whorl reproduce table_4_3 fig_4_16",
    ),
    ("completions", "whorl completions bash > ~/.local/share/bash-completion/completions/whorl"),
    ("man", "whorl man manual_pages"),
];

/// Adds its examples to every command that does something itself.
pub fn with_examples(command: Command) -> Command {
    below(command, "")
}

fn below(command: Command, path: &str) -> Command {
    let names: Vec<String> = command.get_subcommands().map(|sub| sub.get_name().to_owned()).collect();
    let command = names.into_iter().fold(command, |command, name| {
        let path = format!("{path} {name}").trim_start().to_owned();
        command.mut_subcommand(name, |sub| below(sub, &path))
    });
    match EXAMPLES.iter().find(|(of, _)| *of == path) {
        Some((_, lines)) => command.after_help(shown(lines)),
        None => command,
    }
}

/// The examples, with what they are for in one column.
fn shown(lines: &str) -> String {
    let parts: Vec<(&str, &str)> =
        lines.lines().map(|line| line.split_once("   ").unwrap_or((line, ""))).collect();
    let width = parts.iter().filter(|(_, what)| !what.is_empty()).map(|(line, _)| line.chars().count()).max();
    let width = width.unwrap_or(0);
    let head = if parts.len() == 1 { "Example:" } else { "Examples:" };
    let lines = parts.iter().map(|(line, what)| format!("\n  {line:<width$}   {what}").trim_end().to_owned());
    // Trimming took the line's beginning of none.
    std::iter::once(head.to_owned()).chain(lines).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Commands that do something themselves, with their words.
    fn leaves(command: &Command, path: &str, found: &mut Vec<(String, Command)>) {
        if command.get_subcommands().next().is_none() {
            found.push((path.to_owned(), command.clone()));
        }
        for sub in command.get_subcommands().filter(|sub| sub.get_name() != "help") {
            leaves(sub, format!("{path} {}", sub.get_name()).trim_start(), found);
        }
    }

    fn all() -> Vec<(String, Command)> {
        let mut found = Vec::new();
        leaves(&crate::command_line(), "", &mut found);
        found
    }

    /// The words of a line as a shell splits them, without what comes behind `>`.
    fn words(line: &str) -> Vec<String> {
        let mut words = vec![String::new()];
        let mut quoted = false;
        for c in line.chars() {
            match c {
                '"' => quoted = !quoted,
                '>' if !quoted => break,
                ' ' if !quoted => words.push(String::new()),
                c => words.last_mut().unwrap().push(c),
            }
        }
        words.retain(|word| !word.is_empty());
        words
    }

    #[test]
    fn every_command_has_examples_that_it_understands() {
        for (path, command) in all() {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            assert!(help.starts_with("Example"), "whorl {path} has no example");
            let lines: Vec<&str> = help.lines().skip(1).collect();
            assert!(lines.iter().any(|line| line.starts_with(&format!("  whorl {path}"))), "{path}: {help}");
            for line in lines {
                let typed = line.trim_start().split("   ").next().unwrap();
                let parsed = crate::command_line().try_get_matches_from(words(typed));
                assert!(parsed.is_ok(), "{typed}: {}", parsed.unwrap_err());
            }
        }
    }

    #[test]
    fn every_example_is_of_a_command() {
        let known: Vec<String> = all().into_iter().map(|(path, _)| path).collect();
        for (path, _) in EXAMPLES.iter().copied() {
            assert!(known.iter().any(|of| of == path), "there is no command {path}");
        }
    }

    /// Commands that print no results: they start, stop, send or write something, or print text for a shell.
    const WITHOUT_RESULTS: &[&str] = &[
        "nodes platform",
        "nodes coordinator",
        "nodes recorder",
        "nodes stop",
        "emulators",
        "arm",
        "disarm",
        "init",
        "platforms",
        "start",
        "hold",
        "abort",
        "live",
        "open",
        "security create",
        "demo",
        "completions",
        "man",
        "nodes list",
    ];

    #[test]
    fn every_command_that_prints_results_gives_them_to_programs() {
        for (path, command) in all().iter().filter(|(path, _)| !WITHOUT_RESULTS.contains(&path.as_str())) {
            let json = command.get_arguments().find(|argument| argument.get_long() == Some("json"));
            let help = json.and_then(|json| json.get_help()).map(ToString::to_string).unwrap_or_default();
            assert!(help.contains("-: to the standard output"), "whorl {path} has no --json: {help}");
        }
    }
}
