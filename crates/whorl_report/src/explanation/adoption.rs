//! The page of `whorl adopt`.

use maud::Markup;
use whorl_explain::{Adoption, ComparedRun, Version};
use whorl_validation::comparison::{Channel, ChannelErrors, Comparison};

use super::comparison::{measured_and_predicted, title};
use super::versions::versions;
use super::{Facts, facts};
use crate::document::{Document, code, significant, text};
use crate::figure::Figure;

/// The page as one self-contained HTML document.
#[must_use]
pub fn adoption_html(adoption: &Adoption, about: &Facts) -> String {
    let mut page = Document::new("What does the effect bring?");
    for sentence in adoption.answer() {
        page.paragraph("answer", &sentence);
    }
    before_and_after(&mut page, adoption);
    versions(&mut page, &adoption.versions);
    page.heading("Parameters");
    let adopted = adoption.versions.last().and_then(|v| v.fit.as_ref());
    let rows: Vec<Vec<Markup>> = adopted
        .iter()
        .flat_map(|fit| &fit.estimates)
        .map(|p| {
            vec![
                code(&p.group),
                code(&p.name),
                text(&p.unit),
                significant(p.before),
                significant(p.estimate),
                significant(p.stddev),
            ]
        })
        .collect();
    page.table(&["of", "parameter", "unit", "#before", "#after", "#standard deviation"], &rows);
    facts(&mut page, about);
    page.finish()
}

/// The channel that the model as given predicts worst, measured and predicted: with the model as given, and with the last
/// version; of the first held-out run, or of the first where none was held out.
fn before_and_after(page: &mut Document, adoption: &Adoption) {
    let Some((run, figures)) = pair(adoption) else { return };
    page.heading(&title(run));
    figures.iter().for_each(|figure| page.figure(figure, None));
}

/// The run that judges, and its worst channel before and after.
pub(super) fn pair(adoption: &Adoption) -> Option<(&ComparedRun, Vec<Figure>)> {
    let (given, adopted) = (adoption.versions.first()?, adoption.versions.last()?);
    let held_out = given.runs.iter().position(|run| run.held_out).unwrap_or(0);
    let (before, after) = (given.runs.get(held_out)?, adopted.runs.get(held_out)?);
    let name = worst_channel(&before.comparison)?;
    let figure = |run: &ComparedRun, version: &Version| {
        let channel = run.comparison.channels.iter().find(|channel| channel.name == name)?;
        let overlay = channel.overlay.as_ref()?;
        Some(measured_and_predicted(channel, overlay, &format!(", {}", version.name)))
    };
    Some((
        before,
        [(before, given), (after, adopted)].into_iter().filter_map(|(run, v)| figure(run, v)).collect(),
    ))
}

/// The channel with the largest error over its predicted deviation at the longest horizon.
fn worst_channel(comparison: &Comparison) -> Option<String> {
    let ratio = |channel: &ChannelErrors| {
        channel.horizons.iter().rev().find(|h| h.horizon_s.is_some()).map(|h| h.ratio)
    };
    // How an accelerometer moves tells a reader nothing.
    let is_shown = |of: &&ChannelErrors| of.overlay.is_some() && of.quantity != Channel::Accelerometer;
    let shown = comparison.channels.iter().filter(is_shown);
    let worst = shown.filter_map(|channel| Some((channel, ratio(channel)?)));
    worst.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(channel, _)| channel.name.clone())
}
