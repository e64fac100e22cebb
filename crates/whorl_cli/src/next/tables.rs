//! A proposal as a table, and text in lines.

use whorl_explain::Proposal;
use whorl_math::three_digits;

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

/// A row for each manoeuvre, best first, after a row for the data at hand.
pub fn rows(proposal: &Proposal) -> Vec<Vec<String>> {
    let odds = |o: Option<f64>| o.map_or_else(|| "-".to_owned(), three_digits);
    let mut rows = vec![vec![
        "(the data at hand)".to_owned(),
        odds(proposal.now.log_odds),
        proposal.now.shown.len().to_string(),
    ]];
    rows[0].resize(HEADINGS.len(), String::new());
    rows.extend(proposal.judged.iter().map(|j| {
        vec![
            j.manoeuvre.name.to_owned(),
            odds(j.expected.log_odds),
            j.expected.shown.len().to_string(),
            format!("{:.0}", j.demand.duration_s),
            format!("{:.1}", j.demand.tilt_deg),
            format!("{:.1}", j.demand.rate_deg_s),
            format!("{:.0}", 100.0 * j.demand.wheel_speed_share),
            format!("{:.1}", 100.0 * j.demand.gas_share),
        ]
    }));
    rows
}

/// Text broken into lines of at most `width` characters, at spaces.
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
