//! The report page.

use std::fmt::Write as _;

use whorl_math::deg_from_rad;

use crate::data::RunData;
use crate::document::{Document, END, escaped, number};
use crate::events::happenings;
use crate::figure::Figure;
use crate::figures::{link_figure, pair_figures, platform_figures};
use crate::metrics::{Attitudes, Summary, hold_intervals, relative_errors};

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
pub fn html(run: &RunData, summary: &Summary, description: &Description) -> String {
    let mut page = Document::new(&description.title).into_body();
    for warning in &description.warnings {
        let _ = writeln!(page, "<p class=\"warning\">{}</p>", escaped(warning));
    }
    page.push_str(&summary_tables(summary));
    page.push_str(&facts(description));
    page.push_str(&figures(run));
    page.push_str(&happenings_table(run));
    page.push_str(&topics_table(&description.topics));
    page.push_str(END);
    page
}

fn summary_tables(summary: &Summary) -> String {
    let mut html = format!(
        "<p>Experiment <b>{}</b>, law <b>{}</b>: <b>{}</b> after {:.1} s.</p>\n<h2>Summary</h2>\n",
        escaped(&summary.experiment),
        escaped(&summary.law),
        escaped(&summary.outcome),
        summary.duration_s
    );
    if !summary.pairs.is_empty() {
        html.push_str(
            "<table><tr><th>relative pointing in hold</th><th class=n>RMS [deg]</th><th class=n>largest [deg]</th>\
             <th class=n>estimators' share, RMS [deg]</th><th class=n>control's share, RMS [deg]</th><th class=n>hold [s]</th><th class=n>acquired after [s]</th></tr>",
        );
        for pair in &summary.pairs {
            let _ = writeln!(
                html,
                "<tr><td>{} to {}{}</td>{}{}{}{}{}{}</tr>",
                escaped(&pair.follower),
                escaped(&pair.leader),
                if pair.from_truth { "" } else { " (from the estimates, without truth)" },
                angle(pair.relative_error_rms_rad),
                angle(pair.relative_error_max_rad),
                angle(pair.estimator_error_rms_rad),
                angle(pair.control_error_rms_rad),
                number(pair.hold_s, 1),
                number(pair.acquired_s, 1),
            );
        }
        html.push_str("</table>\n");
    }
    html.push_str("<table><tr><th></th>");
    for platform in &summary.platforms {
        let _ = write!(html, "<th class=n>{}</th>", escaped(&platform.name));
    }
    html.push_str("</tr>\n");
    type Cell = fn(&crate::metrics::PlatformSummary) -> String;
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
                format!("<td class=n>{text}</td>")
            } else {
                number(f64::NAN, 2)
            }
        }),
        ("rejected sensor samples", |p| number(f64::from(p.rejected_samples), 0)),
        ("time not tracking, after start [s]", |p| number(p.not_tracking_s, 2)),
    ];
    for (label, cell) in rows {
        let cells: String = summary.platforms.iter().map(cell).collect();
        let _ = writeln!(html, "<tr><td>{label}</td>{cells}</tr>");
    }
    html.push_str("</table>\n");
    html
}

fn facts(description: &Description) -> String {
    let mut html = "<h2>What was run</h2>\n<table>".to_owned();
    for (label, value) in &description.facts {
        let _ = writeln!(html, "<tr><td>{}</td><td class=code>{}</td></tr>", escaped(label), escaped(value));
    }
    html + "</table>\n"
}

fn figures(run: &RunData) -> String {
    let hold = hold_intervals(run);
    let mut html = String::new();
    let mut count = 0;
    let mut draw = |html: &mut String, figure: &Figure| {
        count += 1;
        let _ = writeln!(
            html,
            "<div class=figure><h3>{}</h3><p class=caption>{}</p><div class=plot>{}</div></div>",
            escaped(&figure.title),
            escaped(&figure.caption),
            figure.html(&format!("figure_{count}"), &hold, Some((0.0, run.duration_s)))
        );
    };
    let attitudes: std::collections::BTreeMap<_, _> =
        run.platforms.iter().map(|(name, data)| (name, Attitudes::new(data))).collect();
    html.push_str("<h2>Formation</h2>\n");
    for (follower, leader) in crate::metrics::pairs(run) {
        let (Some(f), Some(l)) = (attitudes.get(&follower), attitudes.get(&leader)) else { continue };
        let errors = relative_errors(run, &follower, &leader, [f, l]);
        for figure in pair_figures(&follower, &leader, &errors).iter().filter(|f| !f.is_empty()) {
            draw(&mut html, figure);
        }
    }
    let links = link_figure(run);
    if !links.is_empty() {
        draw(&mut html, &links);
    }
    for (name, data) in &run.platforms {
        let _ = writeln!(html, "<h2>Platform {}</h2>", escaped(name));
        let Some(attitudes) = attitudes.get(name) else { continue };
        for figure in platform_figures(data, attitudes) {
            draw(&mut html, &figure);
        }
    }
    html
}

fn happenings_table(run: &RunData) -> String {
    let all = happenings(run);
    let faults = all.iter().filter(|h| h.fault).count();
    let mut html = format!(
        "<h2>What happened</h2>\n<p>{} changes, {faults} of them faults or responses to faults (shaded).</p>\
         <table><tr><th class=n>time [s]</th><th>who</th><th>what</th></tr>\n",
        all.len()
    );
    for h in &all {
        let _ = writeln!(
            html,
            "<tr{}>{}<td>{}</td><td>{}</td></tr>",
            if h.fault { " class=fault" } else { "" },
            number(h.time_s, 2),
            escaped(&h.who),
            escaped(&h.what)
        );
    }
    html + "</table>\n"
}

fn topics_table(topics: &[TopicRow]) -> String {
    let mut html =
        "<h2>Recorded topics</h2>\n<table><tr><th>topic</th><th>type</th><th class=n>messages</th>\
                    <th class=n>rate [Hz]</th><th class=n>lost</th><th class=n>longest gap [ms]</th></tr>\n"
            .to_owned();
    for t in topics {
        let lost = t.lost.map_or_else(|| "<td class=n>?</td>".to_owned(), |n| number(n as f64, 0));
        let _ = writeln!(
            html,
            "<tr><td class=code>{}</td><td class=code>{}</td>{}{}{lost}{}</tr>",
            escaped(&t.name),
            escaped(&t.type_name),
            number(t.messages as f64, 0),
            number(t.rate_hz, 1),
            number(t.longest_gap_s * 1e3, 1),
        );
    }
    html + "</table>\n"
}

fn angle(rad: f64) -> String {
    number(deg_from_rad(rad), 4)
}
