//! `whorl report`: page and numbers of a recorded run.

use std::path::{Path, PathBuf};

use anyhow::bail;
use serde_json::Value;
pub use whorl_commands::report::{Written, effective_parameters, read, write};
use whorl_math::deg_from_rad;
use whorl_report::Summary;

use crate::output::{JsonArgument, say, shown, tell};
use crate::progress;

/// Carries out `whorl report`.
pub fn run(runs: &[PathBuf], html: Option<&Path>, json: &JsonArgument) -> anyhow::Result<()> {
    if html.is_some() && runs.len() > 1 {
        bail!("--html needs exactly one RUN; {} were given", runs.len());
    }
    let mut written = Vec::with_capacity(runs.len());
    for path in runs {
        let report = progress::during("writing the report", || write(path, html))?;
        print(&report);
        written.push(as_json(path, &report)?);
    }
    // One run as such, so that its numbers are found where summary.json has them.
    json.write(|| Ok(if let [only] = written.as_slice() { only.clone() } else { Value::Array(written) }))
}

/// What summary.json holds, with the run, its page and its verdict.
pub fn as_json(run: &Path, report: &Written) -> anyhow::Result<Value> {
    let mut value = serde_json::to_value(&report.summary)?;
    value["run"] = shown(run).into();
    value["page"] = shown(&report.page).into();
    value["verdict"] = serde_json::to_value(&report.verdict)?;
    Ok(value)
}

/// The headline numbers, where the page is, and the verdict: the last line is what a run came to.
pub fn print(report: &Written) {
    print_headline(&report.summary);
    if let Some(why) = &report.moved {
        tell(format_args!("warning: {why}: the page is in the working directory"));
    }
    if let Some(why) = &report.not_kept {
        tell(format_args!("warning: the numbers are not kept with the run: {why}"));
    }
    say!("report: {}", report.page.display());
    say!("verdict: {}", report.verdict.line);
}

/// The headline numbers.
pub fn print_headline(summary: &Summary) {
    say!("{} ({}): {} after {:.1} s", summary.experiment, summary.law, summary.outcome, summary.duration_s);
    for pair in &summary.pairs {
        if !pair.relative_error_rms_rad.is_finite() {
            say!(
                "  {} to {}: no relative pointing error: the formation did not hold",
                pair.follower,
                pair.leader
            );
            continue;
        }
        let known = |rad: f64| {
            if rad.is_finite() { format!("{:.4}", deg_from_rad(rad)) } else { "unknown".to_owned() }
        };
        say!(
            "  {} to {}: relative pointing error in hold {:.4} deg RMS ({:.4} max); estimators' share {}, control's share {}{}",
            pair.follower,
            pair.leader,
            deg_from_rad(pair.relative_error_rms_rad),
            deg_from_rad(pair.relative_error_max_rad),
            known(pair.estimator_error_rms_rad),
            known(pair.control_error_rms_rad),
            if pair.from_truth { "" } else { " (from the estimates, without truth)" },
        );
    }
    for platform in &summary.platforms {
        let numbers = [
            ("estimator error", deg_from_rad(platform.estimator_error_rms_rad), 4, "deg RMS"),
            ("gas", platform.gas_used_kg * 1e3, 2, "g"),
            ("sensor to command", platform.sensor_to_command_p99_s * 1e3, 2, "ms (99 %)"),
        ];
        // Numbers that the run does not provide are left out.
        let known = numbers.iter().filter(|(_, value, ..)| value.is_finite());
        let known = known.map(|(label, value, digits, unit)| format!("{label} {value:.digits$} {unit}"));
        say!("  {}: {}", platform.name, known.collect::<Vec<_>>().join(", "));
    }
}
