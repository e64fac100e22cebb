//! The page of `whorl diagnose`.

use whorl_diagnosis::{Candidate, Diagnosis, ParameterEstimate, Verdict};

use super::{Facts, facts};
use crate::document::{Document, code, judged, number, significant, text, three_digits};

/// The page as one self-contained HTML document; `answer` is the verdict in words, one paragraph each.
#[must_use]
pub fn diagnosis_html(diagnosis: &Diagnosis, answer: &[String], about: &Facts) -> String {
    let mut page = Document::new("What is missing?");
    for sentence in answer {
        page.paragraph("answer", sentence);
    }
    if let Some(next) = &diagnosis.next {
        page.paragraph(
            "warning",
            &format!(
                "Next: {} (expected log odds between the explanations left: {:.1}).",
                next.manoeuvre, next.expected_log_odds
            ),
        );
    }
    errors(&mut page, diagnosis);
    candidates(&mut page, diagnosis);
    page.list(&diagnosis.remarks);
    if !diagnosis.odd_runs.is_empty() {
        page.paragraph(
            "warning",
            &format!("These runs disagree with the others: {}.", diagnosis.odd_runs.join(", ")),
        );
    }
    facts(&mut page, about);
    page.finish()
}

fn errors(page: &mut Document, diagnosis: &Diagnosis) {
    let error = &diagnosis.error;
    page.heading("Error before and after");
    page.paragraph(
        "rule",
        "RMS of the whitened residual; 1 = noise. Base parameters are refitted in both columns.",
    );
    let mut rows = vec![vec![
        text("training runs"),
        number(error.before, 3),
        number(error.after, 3),
        number(error.noise_floor, 3),
    ]];
    if let (Some(before), Some(after)) = (error.held_out_before, error.held_out_after) {
        rows.push(vec![
            text("held-out runs"),
            number(before, 3),
            number(after, 3),
            number(error.noise_floor, 3),
        ]);
    }
    page.table(&["", "#before", "#after", "#noise"], &rows);
    if error.channels.is_empty() {
        return;
    }
    let rows: Vec<Vec<String>> = error
        .channels
        .iter()
        .map(|c| {
            vec![
                text(&c.channel),
                text(&c.unit),
                number(c.horizon_s, 1),
                significant(c.before),
                significant(c.after),
                significant(c.noise_floor),
            ]
        })
        .collect();
    page.table(&["channel", "unit", "#horizon [s]", "#before", "#after", "#noise floor"], &rows);
}

fn candidates(page: &mut Document, diagnosis: &Diagnosis) {
    if diagnosis.candidates.is_empty() {
        return;
    }
    page.heading("Candidates");
    page.paragraph(
        "rule",
        "Log evidence: gained by adding the effect to the chosen set, or, for a member of the set, lost by removing it. Held out: log likelihood gained \
         on data that took no part in the fit. Swallowed: share of its signal that refitting inertia and centre of mass would hide. \
         Detectability: drop of the misfit in units of noise; below 25 nothing can be said.",
    );
    let named = |c: &Candidate| {
        diagnosis.effects.contains(&c.effect)
            && matches!(diagnosis.verdict, Verdict::Named | Verdict::Confounded)
    };
    let rows: Vec<Vec<String>> = diagnosis
        .candidates
        .iter()
        .map(|c| {
            vec![
                if named(c) { format!("<td class=code><b>{}</b></td>", c.effect) } else { code(&c.effect) },
                number(c.delta_log_evidence, 1),
                judged(c.held_out_gain, 1, c.held_out_gain > 0.0),
                number(c.share_of_excess * 100.0, 0),
                number(c.swallowed_by_base * 100.0, 0),
                number(c.detectability, 0),
                text(&c.parameters.iter().map(parameter).collect::<Vec<_>>().join(", ")),
            ]
        })
        .collect();
    page.table(
        &[
            "effect",
            "#log evidence",
            "#held out",
            "#explains [%]",
            "#swallowed [%]",
            "#detectability",
            "estimates",
        ],
        &rows,
    );
}

fn parameter(p: &ParameterEstimate) -> String {
    format!(
        "{} = {} ± {} {}{}",
        p.name,
        three_digits(p.estimate),
        three_digits(p.stddev),
        p.unit,
        if p.at_bound { " (at its bound)" } else { "" }
    )
}
