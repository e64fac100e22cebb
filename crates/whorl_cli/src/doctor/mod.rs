//! `whorl doctor`: whether this computer is fit to carry a platform: clock, network, devices, disk, heat, load.
//!
//! Every check is a function from what files and programs of the computer say to a [`Check`]; [`Machine`] is where they ask.

mod clock;
mod computer;
mod devices;
mod machine;
mod network;
#[cfg(test)]
mod tests;

use std::process::ExitCode;

use clap::Args;
use serde::Serialize;
use serde_json::json;

use crate::output::say;
use crate::run::{AboutPlatform, exit_code};
use machine::Machine;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Platform whose devices are looked for as well [default: none].
    platform: Option<String>,
    #[command(flatten)]
    about: AboutPlatform,
}

/// How something is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum Verdict {
    /// As it should be.
    Good,
    /// An experiment can run, and will be worse for it.
    Warning,
    /// An experiment cannot run.
    Wrong,
    /// Nobody could be asked.
    Unknown,
}

/// What was found of one thing.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
struct Check {
    /// What was looked at.
    name: String,
    verdict: Verdict,
    /// What was found.
    found: String,
    /// What to do.
    #[serde(rename = "mend")]
    remedy: Option<String>,
}

impl Check {
    fn good(name: &str, found: impl Into<String>) -> Self {
        Self { name: name.into(), verdict: Verdict::Good, found: found.into(), remedy: None }
    }

    fn new(name: &str, verdict: Verdict, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { name: name.into(), verdict, found: found.into(), remedy: Some(remedy.into()) }
    }

    fn warning(name: &str, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::new(name, Verdict::Warning, found, remedy)
    }

    fn wrong(name: &str, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::new(name, Verdict::Wrong, found, remedy)
    }

    fn unknown(name: &str, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::new(name, Verdict::Unknown, found, remedy)
    }
}

/// Carries out `whorl doctor`. The exit status is 1 when something is wrong.
pub fn run(arguments: &Arguments) -> ExitCode {
    exit_code(try_run(arguments))
}

fn try_run(arguments: &Arguments) -> anyhow::Result<u8> {
    let machine = Machine::this();
    let mut checks = computer::all(&machine, &arguments.about.folders);
    checks.extend(clock::all(&machine));
    checks.extend(network::all(&machine));
    if let Some(platform) = &arguments.platform {
        checks.extend(devices::all(arguments.about.options(), platform)?);
    }
    for check in &checks {
        let mark = match check.verdict {
            Verdict::Good => "good",
            Verdict::Warning => "WARNING",
            Verdict::Wrong => "WRONG",
            Verdict::Unknown => "unknown",
        };
        say!("{mark:8} {:22} {}", check.name, check.found);
        if let Some(remedy) = &check.remedy {
            say!("{:8} {:22} -> {remedy}", "", "");
        }
    }
    let count = |verdict| checks.iter().filter(|check| check.verdict == verdict).count();
    let (wrong, warnings) = (count(Verdict::Wrong), count(Verdict::Warning));
    let unknown = count(Verdict::Unknown);
    say!();
    say!("{} checks: {wrong} wrong, {warnings} warnings, {unknown} unknown", checks.len());
    let platform = &arguments.platform;
    arguments.about.json.write(|| {
        Ok(json!({"schema": 1, "platform": platform, "wrong": wrong, "warnings": warnings, "checks": checks}))
    })?;
    Ok(u8::from(wrong > 0))
}
