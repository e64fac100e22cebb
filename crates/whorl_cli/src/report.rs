//! `whorl report`: page and numbers of a recorded run.

use std::path::{Path, PathBuf};

use anyhow::bail;
pub use whorl_commands::report::{Written, effective_parameters, read, write};
use whorl_math::deg_from_rad;
use whorl_report::Summary;

/// Carries out `whorl report`.
pub fn run(runs: &[PathBuf], html: Option<&Path>) -> anyhow::Result<()> {
    if html.is_some() && runs.len() > 1 {
        bail!("--html needs exactly one RUN; {} were given", runs.len());
    }
    for path in runs {
        let report = write(path, html)?;
        print(&report);
    }
    Ok(())
}

/// The headline numbers, where the page is, and the verdict: the last line is what a run came to.
pub fn print(report: &Written) {
    print_headline(&report.summary);
    println!("report: {}", report.page.display());
    println!("verdict: {}", report.verdict.line);
}

/// The headline numbers.
pub fn print_headline(summary: &Summary) {
    println!(
        "{} ({}): {} after {:.1} s",
        summary.experiment, summary.law, summary.outcome, summary.duration_s
    );
    for pair in &summary.pairs {
        if !pair.relative_error_rms_rad.is_finite() {
            println!(
                "  {} to {}: no relative pointing error: the formation did not hold",
                pair.follower, pair.leader
            );
            continue;
        }
        let known = |rad: f64| {
            if rad.is_finite() { format!("{:.4}", deg_from_rad(rad)) } else { "unknown".to_owned() }
        };
        println!(
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
        println!("  {}: {}", platform.name, known.collect::<Vec<_>>().join(", "));
    }
}
