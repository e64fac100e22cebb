//! The page of `whorl diagnose`.

use whorl_diagnosis::{Candidate, ChannelError, Diagnosis, ParameterEstimate, Verdict};
use whorl_trajectory::ResidualTorque;

use super::{Facts, facts};
use crate::document::{Document, code, judged, number, significant, text, three_digits};
use crate::figure::Figure;
use crate::series::Curve;

/// The torque that a model leaves unexplained in one run, without and with the effects that were named.
#[derive(Debug, Clone, PartialEq)]
pub struct UnexplainedTorque {
    /// Name of the run.
    pub run: String,
    /// Without.
    pub before: ResidualTorque,
    /// With; `None` when no effect was named.
    pub after: Option<ResidualTorque>,
}

/// The page as one self-contained HTML document; `answer` is the verdict in words, one paragraph each.
#[must_use]
pub fn diagnosis_html(
    diagnosis: &Diagnosis,
    answer: &[String],
    torque: Option<&UnexplainedTorque>,
    about: &Facts,
) -> String {
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
    if let Some(torque) = torque {
        page.heading("Unexplained torque");
        unexplained(torque).iter().for_each(|figure| page.figure(figure, None));
    }
    errors(&mut page, diagnosis);
    page.figure(&errors_over_horizon(diagnosis), None);
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
            let (unit, factor) = display(&c.unit, &c.channel);
            vec![
                text(&c.channel),
                text(unit),
                number(c.horizon_s, 1),
                significant(c.before * factor),
                significant(c.after * factor),
                significant(c.noise_floor * factor),
            ]
        })
        .collect();
    page.table(&["channel", "unit", "#horizon [s]", "#before", "#after", "#noise floor"], &rows);
}

/// Degrees for the body's angles and rates; wheels turn too fast for them.
fn display<'a>(unit: &'a str, channel: &str) -> (&'a str, f64) {
    match unit {
        "rad" => ("deg", whorl_math::deg_from_rad(1.0)),
        "rad/s" if !channel.starts_with("wheel") => ("deg/s", whorl_math::deg_from_rad(1.0)),
        other => (other, 1.0),
    }
}

/// Largest error over noise of each kind of channel at each horizon, before and after.
fn errors_over_horizon(diagnosis: &Diagnosis) -> Figure {
    let channels = &diagnosis.error.channels;
    let mut horizons: Vec<f64> = channels.iter().map(|c| c.horizon_s).collect();
    horizons.sort_by(f64::total_cmp);
    horizons.dedup();
    let curve = |name: &str, of: &dyn Fn(&ChannelError) -> f64| {
        let worst = |h: f64| {
            let ratios = channels.iter().filter(|c| c.horizon_s == h).map(|c| of(c) / c.noise_floor);
            ratios.filter(|r| r.is_finite()).fold(f64::NAN, f64::max)
        };
        Curve::new(name, horizons.iter().map(|h| (*h, worst(*h))))
    };
    let curves = if horizons.is_empty() {
        Vec::new()
    } else {
        vec![curve("before", &|c| c.before), curve("with the effects named", &|c| c.after)]
    };
    Figure {
        title: "Error over horizon".to_owned(),
        caption: "Of the worst channel, over its noise floor; 1 = noise.".to_owned(),
        x_label: "horizon [s]".to_owned(),
        y_label: "RMS / noise floor".to_owned(),
        curves,
        log: true,
        log_x: true,
        ..Figure::default()
    }
}

/// A figure for each axis on which there is something to see, the largest first.
fn unexplained(torque: &UnexplainedTorque) -> Vec<Figure> {
    let size = |r: &ResidualTorque, i: usize| r.torque_b_n_m.iter().map(|g| g[i] * g[i]).sum::<f64>();
    let mut axes = [0, 1, 2];
    axes.sort_by(|a, b| size(&torque.before, *b).total_cmp(&size(&torque.before, *a)));
    let largest = size(&torque.before, axes[0]);
    let one = |i: usize| {
        let curve = |name: &str, r: &ResidualTorque, sign: f64| {
            let points = r.time_s.iter().zip(&r.torque_b_n_m).zip(&r.stddev_b_n_m);
            Curve::new(name, points.map(|((t, g), s)| (*t, 1e3 * (g[i] + sign * 2.0 * s[i]))))
        };
        let both: Vec<(&str, &ResidualTorque)> = std::iter::once(("before", &torque.before))
            .chain(torque.after.as_ref().map(|after| ("with the effects named", after)))
            .collect();
        Figure {
            title: format!("{}: torque about body {} that is not explained", torque.run, ["x", "y", "z"][i]),
            caption: "The platform's own parameters refitted both times; bands of two standard deviations. What stays in the band about zero is explained.".to_owned(),
            y_label: "torque [mN m]".to_owned(),
            curves: both.iter().map(|(name, r)| curve(name, r, 0.0)).collect(),
            bands: both.iter().map(|(name, r)| (curve(name, r, -1.0), curve(name, r, 1.0))).collect(),
            ..Figure::default()
        }
    };
    axes.into_iter().filter(|i| size(&torque.before, *i) > 0.02 * largest).map(one).collect()
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
