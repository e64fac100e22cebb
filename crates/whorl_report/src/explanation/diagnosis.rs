//! The page of `whorl diagnose`.

use maud::Markup;
use whorl_explain::Explanation;
use whorl_identification::{Candidate, Diagnosis, ParameterEstimate, Verdict};
use whorl_math::three_digits;
use whorl_validation::UnexplainedTorques;

use super::versions::versions;
use super::{Facts, facts};
use crate::document::{Document, bold_code, code, judged, number, text};
use crate::figure::Figure;
use crate::series::Curve;

/// The page as one self-contained HTML document.
#[must_use]
pub fn diagnosis_html(found: &Explanation, about: &Facts) -> String {
    let diagnosis = &found.diagnosis;
    let mut page = Document::new("What is missing?");
    for sentence in found.answer() {
        page.paragraph("answer", &sentence);
    }
    if let Some(next) = &diagnosis.next {
        page.paragraph(
            "warning",
            &format!(
                "Next: {} (expected log odds between the remaining explanations: {:.1}).",
                next.manoeuvre, next.expected_log_odds
            ),
        );
    }
    let figures = unexplained(&found.torques);
    if !figures.is_empty() {
        page.heading("Unexplained torque");
        figures.iter().for_each(|figure| page.figure(figure, None));
    }
    versions(&mut page, &found.versions);
    slow_residual(&mut page, diagnosis);
    candidates(&mut page, diagnosis);
    page.list(&diagnosis.remarks);
    facts(&mut page, about);
    page.finish()
}

fn slow_residual(page: &mut Document, diagnosis: &Diagnosis) {
    let slow = &diagnosis.slow_residual;
    page.heading("Slow residual before and after");
    page.paragraph(
        "rule",
        "RMS of the whitened residual summed over stretches of 1 and 8 s, relative to noise alone. If a slow torque is missing, it grows with \
         the length of the stretch, so it is larger than the prediction error. The platform's own parameters are refitted \
         in both columns.",
    );
    let mut rows = vec![vec![text("training runs"), number(slow.before, 3), number(slow.after, 3)]];
    if let (Some(before), Some(after)) = (slow.held_out_before, slow.held_out_after) {
        rows.push(vec![text("held-out runs"), number(before, 3), number(after, 3)]);
    }
    page.table(&["", "#before", "#after"], &rows);
}

/// A figure for each axis with a visible torque, the largest first; `torques` without and with the named effects.
pub(super) fn unexplained(torques: &[UnexplainedTorques]) -> Vec<Figure> {
    let Some(before) = torques.first() else { return Vec::new() };
    let size = |r: &UnexplainedTorques, i: usize| {
        r.states.iter().map(|state| state.torque_b_n_m[i].powi(2)).sum::<f64>()
    };
    let mut axes = [0, 1, 2];
    axes.sort_by(|a, b| size(before, *b).total_cmp(&size(before, *a)));
    let largest = size(before, axes[0]);
    let one = |i: usize| {
        let curve = |name: &str, r: &UnexplainedTorques, sign: f64| {
            let points = r.states.iter().map(|state| {
                let stddev = state.torque_covariance_b[(i, i)].max(0.0).sqrt();
                (state.time_s, 1e3 * (state.torque_b_n_m[i] + sign * 2.0 * stddev))
            });
            Curve::new(name, points)
        };
        let both: Vec<(&str, &UnexplainedTorques)> =
            ["before", "with the effects named"].into_iter().zip(torques).collect();
        Figure {
            title: format!("{}: unexplained torque about body {}", before.run, ["x", "y", "z"][i]),
            caption: "The platform's own parameters are refitted in both cases. Bands: two standard deviations. A curve that stays within the band about zero is explained, and one that is zero throughout makes the run no likelier.".to_owned(),
            y_label: "torque [mN m]".to_owned(),
            curves: both.iter().map(|(name, r)| curve(name, r, 0.0)).collect(),
            bands: both.iter().map(|(name, r)| (curve(name, r, -1.0), curve(name, r, 1.0))).collect(),
            ..Figure::default()
        }
    };
    axes.into_iter().filter(|i| size(before, *i) > 0.02 * largest).map(one).collect()
}

fn candidates(page: &mut Document, diagnosis: &Diagnosis) {
    if diagnosis.candidates.is_empty() {
        return;
    }
    page.heading("Candidates");
    page.paragraph(
        "rule",
        "Log evidence: gained by adding the effect to the chosen set, or, for a member of the set, lost by removing it. Held out: log likelihood gained \
         on data that took no part in the fit, where it was fitted. Swallowed: share of its signal that refitting inertia and centre of mass would hide. \
         Detectability: drop of the misfit in units of noise; below 25 nothing can be said.",
    );
    let named = |c: &Candidate| {
        diagnosis.effects.contains(&c.effect)
            && matches!(diagnosis.verdict, Verdict::Named | Verdict::Confounded)
    };
    let rows: Vec<Vec<Markup>> = diagnosis
        .candidates
        .iter()
        .map(|c| {
            vec![
                if named(c) { bold_code(&c.effect) } else { code(&c.effect) },
                number(c.delta_log_evidence, 1),
                c.held_out_gain.map_or_else(|| text("-"), |gain| judged(gain, 1, gain > 0.0)),
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
            "#absorbed [%]",
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
