//! A design in words and as a table.

use whorl_diagnosis::Verdict;
use whorl_dynamics::effects::find;

use super::design::{Design, Judged};

/// Log odds from which an explanation counts as told apart.
const DECIDED: f64 = 6.0;

/// Headings of [`rows`].
pub const HEADINGS: [&str; 8] = [
    "manoeuvre",
    "#log odds",
    "#effects shown",
    "#time [s]",
    "#tilt [deg]",
    "#rate [deg/s]",
    "#wheels [%]",
    "#gas [%]",
];

/// A row for each manoeuvre, best first, after what the data at hand say.
pub fn rows(design: &Design) -> Vec<Vec<String>> {
    let odds = |o: Option<f64>| o.map_or_else(|| "-".to_owned(), number);
    let mut rows = vec![vec![
        "(the data at hand)".to_owned(),
        odds(design.now.log_odds),
        design.now.shown.len().to_string(),
    ]];
    rows[0].resize(HEADINGS.len(), String::new());
    rows.extend(design.judged.iter().map(|j| {
        vec![
            j.manoeuvre.name.to_owned(),
            odds(j.prospect.log_odds),
            j.prospect.shown.len().to_string(),
            format!("{:.0}", j.demand.duration_s),
            format!("{:.1}", j.demand.tilt_deg),
            format!("{:.1}", j.demand.rate_deg_s),
            format!("{:.0}", 100.0 * j.demand.wheel_speed_share),
            format!("{:.1}", 100.0 * j.demand.gas_share),
        ]
    }));
    rows
}

/// Log odds; digits of large ones mean nothing.
fn number(odds: f64) -> String {
    if odds > 1000.0 { "> 1000".to_owned() } else { format!("{odds:.1}") }
}

fn title(set: &[String]) -> String {
    if set.is_empty() {
        return "the model as it is".to_owned();
    }
    let one = |id: &String| find(id).map_or_else(|| id.clone(), |e| format!("{} ({id})", e.info().title));
    set.iter().map(one).collect::<Vec<_>>().join(" with ")
}

/// What is proposed, why, and what it asks of the platform.
pub fn answer(design: &Design, best: &Judged, verdict: Verdict, platform: &str) -> Vec<String> {
    let mut text = Vec::new();
    let sets: Vec<String> = design.explanations.iter().map(|s| title(s)).collect();
    let odds = best.prospect.log_odds.unwrap_or(0.0);
    let now = design.now.log_odds.unwrap_or(0.0);
    text.push(match verdict {
        Verdict::Confounded => {
            format!("The data leave open: {} (log odds now {}).", sets.join("; or "), number(now))
        }
        Verdict::Named => format!(
            "The data name {}; the next run can only confirm it, for example against {}.",
            sets.first().map_or("", String::as_str),
            sets.get(1).map_or("none", String::as_str)
        ),
        Verdict::Unknown => "Something is missing that no effect explains: the more effects a run can show, the more of them it rules out.".to_owned(),
        Verdict::NothingMissing => format!(
            "Nothing is missing as far as the data can say; {} of {} effects would have shown.",
            design.now.shown.len(),
            design.now.shown.len() + design.now.not_shown.len()
        ),
        Verdict::NotEnoughInformation => format!(
            "The data cannot say whether an effect is missing: only {} of {} would have shown at their ordinary size.",
            design.now.shown.len(),
            design.now.shown.len() + design.now.not_shown.len()
        ),
    });
    text.push(format!("Next: {platform} {} ({}).", best.manoeuvre.words, best.manoeuvre.name));
    if design.separates {
        let worth = format!("Whichever is true, it is expected to lead by {} in log odds", number(odds));
        text.push(if odds >= DECIDED {
            format!("{worth}, which decides.")
        } else if odds > 0.5 {
            format!("{worth}. Once does not decide; {:.0} times would.", (DECIDED / odds).ceil())
        } else {
            format!("{worth}. No manoeuvre of the family separates them on this platform: at their present size they predict the same.")
        });
    } else {
        text.push(format!(
            "With it {} of {} effects would show at their ordinary size.",
            best.prospect.shown.len(),
            best.prospect.shown.len() + best.prospect.not_shown.len()
        ));
        let new: Vec<&str> = best
            .prospect
            .shown
            .iter()
            .filter(|id| !design.now.shown.contains(id))
            .map(String::as_str)
            .collect();
        if !new.is_empty() {
            text.push(format!("New among them: {}.", new.join(", ")));
        }
    }
    let d = &best.demand;
    text.push(format!(
        "In simulation it takes {:.0} s, tilts by up to {:.1} of {:.1} deg, turns at up to {:.1} deg/s, brings the wheels to {:.0} % of their speed, and uses {:.1} % of a full tank.",
        d.duration_s,
        d.tilt_deg,
        d.tilt_limit_deg,
        d.rate_deg_s,
        100.0 * d.wheel_speed_share,
        100.0 * d.gas_share
    ));
    text
}

/// Broken into lines of at most `width` characters, at spaces.
pub fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}
