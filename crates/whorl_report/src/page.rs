//! The report page.

use maud::{Markup, html};
use whorl_math::deg_from_rad;

use crate::data::RunData;
use crate::document::{Document, code, heading_row, number, right, text};
use crate::events::{Happening, happenings};
use crate::figure::Figure;
use crate::figures::{link_figure, pair_figures, platform_figures};
use crate::metrics::{PairSummary, Summary};
use crate::replay::{self, PlatformShape};
use crate::timeline::Timeline;
use crate::verdict::Verdict;

/// Contents of the page besides the data.
#[derive(Debug, Clone, Default)]
pub struct Description {
    /// Heading.
    pub title: String,
    /// What was run: label and value, in order (version, commit, seed, parameter files, ...).
    pub facts: Vec<(String, String)>,
    /// Recorded topics.
    pub topics: Vec<TopicRow>,
    /// Sentences shown in a warning box on top (recording cut short, topics missing, ...).
    pub warnings: Vec<String>,
    /// What is known of the platforms' shapes and limits; the others are drawn plainly.
    pub shapes: Vec<PlatformShape>,
    /// Relative pointing error that was asked for \[rad\].
    pub target_rad: Option<f64>,
    /// Age at which a link counts as stale \[s\].
    pub link_stale_s: Option<f64>,
}

/// A recorded topic.
#[derive(Debug, Clone, PartialEq)]
pub struct TopicRow {
    /// Full name.
    pub name: String,
    /// ROS type.
    pub type_name: String,
    /// Messages recorded.
    pub messages: u64,
    /// Mean rate \[Hz\].
    pub rate_hz: f64,
    /// Messages known to be lost; `None`: not known.
    pub lost: Option<u64>,
    /// Longest time between two messages \[s\].
    pub longest_gap_s: f64,
}

/// The report as one self-contained HTML document.
#[must_use]
pub fn html(run: &RunData, summary: &Summary, verdict: &Verdict, description: &Description) -> String {
    let mut page = Document::new(&description.title);
    page.paragraph(if verdict.failed() { "warning" } else { "" }, &format!("Verdict: {}", verdict.line));
    for warning in &description.warnings {
        page.paragraph("warning", warning);
    }
    let happened = happenings(run);
    page.set_timeline(Timeline::new(run, &happened));
    let mut formation = formation_figures(run, description);
    // The first figure stands beside the replay, in the first screen.
    let first = if formation.is_empty() { Figure::default() } else { formation.remove(0) };
    page.replay(replay::stored(run, &description.shapes), &first);
    summary_tables(&mut page, summary);
    figures(&mut page, run, description, &formation);
    happenings_table(&mut page, &happened);
    topics_table(&mut page, &description.topics);
    facts(&mut page, description);
    page.finish()
}

fn summary_tables(page: &mut Document, summary: &Summary) {
    page.add(html! {
        p {
            "Experiment " b { (summary.experiment) } ", law " b { (summary.law) } ": " b { (summary.outcome) }
            (format!(" after {:.1} s.", summary.duration_s))
        }
    });
    page.heading("Summary");
    if !summary.pairs.is_empty() {
        let headings = [
            "relative pointing in hold",
            "#RMS [deg]",
            "#largest [deg]",
            "#estimators' share, RMS [deg]",
            "#control's share, RMS [deg]",
            "#hold [s]",
            "#acquired after [s]",
        ];
        let row = |pair: &PairSummary| {
            // Without numbers there is nothing that truth could be missing from.
            let estimated = !pair.from_truth && pair.relative_error_rms_rad.is_finite();
            let source = if estimated { " (from the estimates, without truth)" } else { "" };
            vec![
                text(&format!("{} to {}{source}", pair.follower, pair.leader)),
                angle(pair.relative_error_rms_rad),
                angle(pair.relative_error_max_rad),
                angle(pair.estimator_error_rms_rad),
                angle(pair.control_error_rms_rad),
                number(pair.hold_s, 1),
                number(pair.acquired_s, 1),
            ]
        };
        let rows: Vec<Vec<Markup>> = summary.pairs.iter().map(row).collect();
        page.table(&headings, &rows);
    }
    type Cell = fn(&crate::metrics::PlatformSummary) -> Markup;
    let rows: [(&str, Cell); 15] = [
        ("pointing error to the reference in hold, RMS [deg]", |p| angle(p.pointing_error_rms_rad)),
        ("estimator error, RMS [deg]", |p| angle(p.estimator_error_rms_rad)),
        ("estimator error, heading part [deg]", |p| angle(p.estimator_heading_error_rms_rad)),
        ("estimator error, inclination part [deg]", |p| angle(p.estimator_inclination_error_rms_rad)),
        ("gas used [g]", |p| number(p.gas_used_kg * 1e3, 3)),
        ("jet on-time, all jets [s]", |p| number(p.jet_on_time_s, 2)),
        ("largest wheel speed [rpm]", |p| number(whorl_math::rpm_from_rad_s(p.wheel_speed_max_rad_s), 0)),
        ("smallest attainable share of the requested torque", |p| number(p.alpha_min, 3)),
        ("allocation fallbacks", |p| number(p.allocation_fallbacks as f64, 0)),
        ("sensor stamp to command, median [ms]", |p| number(p.sensor_to_command_p50_s * 1e3, 2)),
        ("sensor stamp to command, 99th percentile [ms]", |p| number(p.sensor_to_command_p99_s * 1e3, 2)),
        ("largest link age [ms]", |p| number(p.link_age_max_s * 1e3, 1)),
        ("clock offset to the coordinator's computer [ms]", |p| {
            if p.clock_offset_s.is_finite() {
                let text =
                    format!("{:+.2} \u{b1} {:.2}", p.clock_offset_s * 1e3, p.clock_uncertainty_s * 1e3);
                right(&text)
            } else {
                number(f64::NAN, 2)
            }
        }),
        ("rejected sensor samples", |p| number(f64::from(p.rejected_samples), 0)),
        ("time not tracking, after start [s]", |p| number(p.not_tracking_s, 2)),
    ];
    let names: Vec<String> = summary.platforms.iter().map(|p| format!("#{}", p.name)).collect();
    let headings: Vec<&str> = std::iter::once("").chain(names.iter().map(String::as_str)).collect();
    let cells = |(label, cell): (&str, Cell)| {
        std::iter::once(text(label)).chain(summary.platforms.iter().map(cell)).collect()
    };
    page.table(&headings, &rows.map(cells));
}

fn facts(page: &mut Document, description: &Description) {
    page.heading("What was run");
    page.add(html! {
        table {
            @for (label, value) in &description.facts {
                tr { (text(label)) (code(value)) }
            }
        }
    });
}

/// Relative errors of all pairs, then the links.
fn formation_figures(run: &RunData, description: &Description) -> Vec<Figure> {
    let mut figures = Vec::new();
    for (follower, leader) in crate::metrics::pairs(run) {
        let Some(errors) = run.pairs.get(&(follower.clone(), leader.clone())) else { continue };
        figures.extend(pair_figures(&follower, &leader, errors, description.target_rad));
    }
    figures.push(link_figure(run, description.link_stale_s));
    figures.retain(|f| !f.is_empty());
    figures
}

fn figures(page: &mut Document, run: &RunData, description: &Description, formation: &[Figure]) {
    let span = Some((0.0, run.duration_s));
    if !formation.is_empty() {
        page.heading("Formation");
    }
    for figure in formation {
        page.figure(figure, span);
    }
    for (name, data) in &run.platforms {
        page.heading(&format!("Platform {name}"));
        let shape = description.shapes.iter().find(|s| &s.name == name);
        for mut figure in platform_figures(data, shape) {
            figure.platform.clone_from(name);
            page.figure(&figure, span);
        }
    }
}

fn happenings_table(page: &mut Document, all: &[Happening]) {
    let faults = all.iter().filter(|h| h.fault).count();
    page.heading("What happened");
    page.paragraph(
        "",
        &format!(
            "{} changes, {faults} of them faults or responses to faults (shaded). A click shows the instant in the replay.",
            all.len()
        ),
    );
    page.add(html! {
        div class="wide" {
            table {
                (heading_row(&["#time [s]", "who", "what"]))
                @for h in all {
                    tr class=[h.fault.then_some("fault")] data-time=(format!("{:.3}", h.time_s)) {
                        (number(h.time_s, 2)) (text(&h.who)) (text(&h.what))
                    }
                }
            }
        }
    });
}

fn topics_table(page: &mut Document, topics: &[TopicRow]) {
    page.heading("Recorded topics");
    let headings = ["topic", "type", "#messages", "#rate [Hz]", "#lost", "#longest gap [ms]"];
    let row = |t: &TopicRow| {
        vec![
            code(&t.name),
            code(&t.type_name),
            number(t.messages as f64, 0),
            number(t.rate_hz, 1),
            t.lost.map_or_else(|| right("?"), |n| number(n as f64, 0)),
            number(t.longest_gap_s * 1e3, 1),
        ]
    };
    let rows: Vec<Vec<Markup>> = topics.iter().map(row).collect();
    page.table(&headings, &rows);
    if topics.iter().any(|t| t.lost.is_none()) {
        page.paragraph(
            "rule",
            "?: these messages are not numbered, so that nobody can say how many were lost.",
        );
    }
}

fn angle(rad: f64) -> Markup {
    number(deg_from_rad(rad), 4)
}
