//! The table.

use super::judge::Outcome;
use crate::cases::Cell;

/// One line.
#[derive(Debug, Clone)]
pub struct Row {
    pub what: String,
    pub hits: usize,
    pub of: usize,
    /// A share between these is the target.
    pub target: (f64, f64),
    pub target_text: &'static str,
}

impl Row {
    /// The share, if there were cases.
    #[must_use]
    pub fn share(&self) -> Option<f64> {
        (self.of > 0).then(|| self.hits as f64 / self.of as f64)
    }

    /// Reached, if there were cases.
    #[must_use]
    pub fn is_reached(&self) -> Option<bool> {
        self.share().map(|s| s >= self.target.0 - 1e-12 && s <= self.target.1 + 1e-12)
    }
}

/// The score.
#[must_use]
pub fn table(outcomes: &[Outcome]) -> Vec<Row> {
    let built: Vec<&Outcome> = outcomes.iter().filter(|o| o.not_built.is_none()).collect();
    let mut rows = Vec::new();
    let mut row = |what: &str,
                   from: &[&Outcome],
                   hit: &dyn Fn(&Outcome) -> bool,
                   target: (f64, f64),
                   text: &'static str| {
        rows.push(Row {
            what: what.to_owned(),
            hits: from.iter().filter(|o| hit(o)).count(),
            of: from.len(),
            target,
            target_text: text,
        });
    };
    let pick =
        |keep: &dyn Fn(&Outcome) -> bool| built.iter().filter(|o| keep(o)).copied().collect::<Vec<_>>();
    let (at_least, at_most) = (|x: f64| (x, 1.0), |x: f64| (0.0, x));

    let one = |o: &Outcome| {
        matches!(o.spec.cell, Cell::Single | Cell::ClosedLoop | Cell::Bench) && !o.truth.is_empty()
    };
    // The effect shows, and so does its difference from the most similar one.
    let told_apart = |o: &Outcome| o.lambda >= 50.0 && o.separation >= 50.0;
    let high = pick(&|o| one(o) && o.lambda >= 85.0 && told_apart(o));
    row(
        "one effect, detectability >= 100: right effect first",
        &high,
        &|o| o.first_right,
        at_least(0.98),
        ">= 98 %",
    );
    row("  exact set", &high, &|o| o.exact, at_least(0.95), ">= 95 %");
    row("  truth in the set", &high, &|o| o.truth_in_set, at_least(0.98), ">= 98 %");
    let similar = pick(&|o| one(o) && o.lambda >= 50.0 && !told_apart(o));
    row(
        "detectability >= 50, hardly to be told from another: truth first or in the set",
        &similar,
        &|o| o.first_right || o.truth_in_set,
        at_least(0.90),
        ">= 90 %",
    );
    let well = pick(&|o| one(o) && o.lambda < 85.0 && told_apart(o));
    row(
        "one effect, detectability 70: right effect first",
        &well,
        &|o| o.first_right,
        at_least(0.90),
        ">= 90 %",
    );
    let middle = pick(&|o| one(o) && (20.0..50.0).contains(&o.lambda));
    row(
        "one effect, detectability 30: right first, a set with it, or abstained",
        &middle,
        &|o| o.first_right || o.truth_in_set || !matches!(o.verdict.as_str(), "named" | "confounded"),
        at_least(0.90),
        ">= 90 %",
    );
    row("  right effect first", &middle, &|o| o.first_right, at_least(0.0), "-");
    let low = pick(&|o| one(o) && o.lambda < 20.0);
    row(
        "one effect, detectability 10: a name or set without the truth",
        &low,
        &|o| o.wrong_name,
        at_most(0.02),
        "<= 2 %",
    );
    for (cell, name) in [(Cell::ClosedLoop, "closed loop"), (Cell::Bench, "clamped wheel bench")] {
        let some = pick(&|o| o.spec.cell == cell && !o.truth.is_empty());
        row(&format!("{name}: right effect first"), &some, &|o| o.first_right, at_least(0.98), ">= 98 %");
    }
    let nothing = pick(&|o| o.truth.is_empty() && o.spec.cell != Cell::Outside);
    row(
        "controls: false alarm (a name, a set or 'unknown')",
        &nothing,
        &|o| matches!(o.verdict.as_str(), "named" | "confounded" | "unknown"),
        at_most(0.01),
        "<= 1 %",
    );
    row("wrong name stated, all cases", &built, &|o| o.wrong_name, at_most(0.02), "<= 2 %");
    let pairs = pick(&|o| o.spec.cell == Cell::Pair && o.truth.len() == 2 && o.separation >= 85.0);
    row("two effects, both >= 100: exact set", &pairs, &|o| o.exact, at_least(0.85), ">= 85 %");
    row("  first is one of them", &pairs, &|o| o.first_right, at_least(0.98), ">= 98 %");
    let outside = pick(&|o| o.spec.cell == Cell::Outside);
    row(
        "outside the library: 'unknown'",
        &outside,
        &|o| o.unknown_right == Some(true),
        at_least(0.90),
        ">= 90 %",
    );
    row("  right driving variable", &outside, &|o| o.variable_right == Some(true), at_least(0.80), ">= 80 %");
    let confounded = pick(&|o| o.spec.cell == Cell::Confounded);
    row("confounded: truth in the set", &confounded, &|o| o.truth_in_set, at_least(0.98), ">= 98 %");
    row(
        "  resolved by the proposed manoeuvre",
        &confounded,
        &|o| o.resolved == Some(true),
        at_least(0.90),
        ">= 90 %",
    );
    let adopted = pick(&|o| o.exact && o.verdict == "named" && o.held_out_ratio.is_some());
    row(
        "held-out error after adoption <= 1.1 x noise floor",
        &adopted,
        &|o| o.held_out_ratio.is_some_and(|r| r <= 1.1),
        at_least(0.95),
        ">= 95 %",
    );
    let (intervals, covered) =
        built.iter().fold((0, 0), |(n, c), o| (n + o.intervals as usize, c + o.covered as usize));
    rows.push(Row {
        what: "95 % intervals that cover the truth".to_owned(),
        hits: covered,
        of: intervals,
        target: (0.92, 0.97),
        target_text: "92-97 %",
    });
    let failed = built.iter().filter(|o| o.error.is_some()).count();
    rows.push(Row {
        what: "refused with an error".to_owned(),
        hits: failed,
        of: built.len(),
        target: (0.0, 0.0),
        target_text: "0",
    });
    rows
}

/// 95 % interval of a share (Wilson).
#[must_use]
pub fn wilson(hits: usize, of: usize) -> (f64, f64) {
    if of == 0 {
        return (0.0, 1.0);
    }
    let (n, p, z) = (of as f64, hits as f64 / of as f64, 1.96);
    let centre = p + z * z / (2.0 * n);
    let half = z * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    let scale = 1.0 + z * z / n;
    ((centre - half).max(0.0) / scale, ((centre + half) / scale).min(1.0))
}

/// Prints the table in Markdown.
#[must_use]
pub fn markdown(rows: &[Row], outcomes: &[Outcome]) -> String {
    use std::fmt::Write as _;
    let mut text = String::from(
        "| measure | target | measured | 95 % interval | cases | |\n|---|---|---|---|---|---|\n",
    );
    for row in rows {
        let Some(share) = row.share() else { continue };
        let (low, high) = wilson(row.hits, row.of);
        let mark = if row.target_text == "-" {
            ""
        } else if row.is_reached() == Some(true) {
            "ok"
        } else {
            "**short**"
        };
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "| {} | {} | {:.1} % | {:.0}-{:.0} % | {} | {mark} |",
            row.what,
            row.target_text,
            100.0 * share,
            100.0 * low,
            100.0 * high,
            row.of
        );
    }
    let mut seconds: Vec<f64> = outcomes.iter().filter(|o| o.seconds > 0.0).map(|o| o.seconds).collect();
    seconds.sort_by(f64::total_cmp);
    if let (Some(median), Some(most)) = (seconds.get(seconds.len() / 2), seconds.last()) {
        let minutes = outcomes.iter().map(|o| o.minutes_of_data).fold(0.0, f64::max);
        let _ = writeln!(
            text,
            "| time of a diagnosis, {minutes:.1} min of data | <= 3 s for 10 min | median {median:.2} s, most {most:.2} s | | {} | |",
            seconds.len()
        );
    }
    text
}
