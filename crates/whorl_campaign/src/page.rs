//! Percentiles over what was swept, as one page that opens offline.

use whorl_report::{Sweep, SweptAxis, SweptGroup, campaign_html};

use crate::plan::Plan;
use crate::row::{MEANINGS, METRICS};
use crate::table::Group;

/// The page: a drawing for each metric that the campaign names, and the table of medians.
#[must_use]
pub fn html(plan: &Plan, groups: &[Group]) -> String {
    let definition = &plan.definition;
    let axes = definition.axes.iter().map(|axis| SweptAxis {
        name: axis.name.clone(),
        labels: axis.choices.iter().map(|choice| choice.label.clone()).collect(),
    });
    let group = |group: &Group| SweptGroup {
        experiment: group.experiment.clone(),
        labels: group.labels.clone(),
        runs: [group.runs, group.finished],
        otherwise: group.otherwise.clone(),
        percentiles: group.percentiles.clone(),
    };
    let metrics =
        METRICS.iter().zip(MEANINGS).map(|(name, meaning)| ((*name).to_owned(), meaning.to_owned()));
    let drawn = definition.plots.iter().filter_map(|metric| METRICS.iter().position(|known| known == metric));
    campaign_html(&Sweep {
        name: definition.name.clone(),
        axes: axes.collect(),
        groups: groups.iter().map(group).collect(),
        metrics: metrics.collect(),
        drawn: drawn.collect(),
    })
}
