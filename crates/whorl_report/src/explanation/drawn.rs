//! Figures of answers by themselves, for who draws them on a page of its own: the same as on the pages of the commands.

use serde_json::Value;
use whorl_explain::{Adoption, ComparedRun, Explanation, Located};

use super::comparison::{overlay_figures, staircase};
use super::{adoption, diagnosis, localisation, versions};
use crate::figure::Figure;
use crate::svg::svg;
use crate::times::Interval;

/// A figure, and what it is of.
#[derive(Debug, Clone)]
pub struct Drawn {
    /// The run that it is about; empty: all.
    pub run: String,
    figure: Figure,
    x_range: Option<Interval>,
}

impl Drawn {
    fn new(run: &str, figure: Figure, x_range: Option<Interval>) -> Self {
        Self { run: run.to_owned(), figure, x_range }
    }

    /// Heading above it.
    #[must_use]
    pub fn title(&self) -> &str {
        &self.figure.title
    }

    /// One sentence on how to read it.
    #[must_use]
    pub fn caption(&self) -> &str {
        &self.figure.caption
    }

    /// What a reader hears who does not see it.
    #[must_use]
    pub fn spoken(&self) -> String {
        self.figure.spoken()
    }

    /// As `plots.js` draws it. Figures over time share one cursor.
    #[must_use]
    pub fn stored(&self, id: &str) -> Value {
        self.figure.stored(id, self.x_range, self.x_range.is_some())
    }

    /// As a drawing that needs no script.
    #[must_use]
    pub fn svg(&self) -> String {
        svg(&self.figure, self.x_range)
    }
}

fn kept(figures: Vec<Drawn>) -> Vec<Drawn> {
    figures.into_iter().filter(|drawn| !drawn.figure.is_empty()).collect()
}

/// Of a comparison: of each run what was measured and predicted, errors, and errors over the horizon.
#[must_use]
pub fn comparison_figures(runs: &[ComparedRun]) -> Vec<Drawn> {
    let of = |run: &ComparedRun| {
        let comparison = &run.comparison;
        let span = Some((0.0, comparison.duration_s));
        let over_time = comparison.channels.iter().flat_map(overlay_figures);
        let over_time = over_time.map(|figure| Drawn::new(&comparison.run, figure, span));
        over_time.chain([Drawn::new(&comparison.run, staircase(comparison), None)]).collect::<Vec<_>>()
    };
    kept(runs.iter().flat_map(of).collect())
}

/// Of a localisation: the unexplained torque over what it depends on, then over time, run by run.
#[must_use]
pub fn localisation_figures(found: &Located) -> Vec<Drawn> {
    let shapes = localisation::shapes(&found.pooled).into_iter().map(|figure| Drawn::new("", figure, None));
    let wheels: Vec<&str> = found.model.wheels().iter().map(|wheel| wheel.name.as_str()).collect();
    let over_time = found.torques.iter().flat_map(|torques| {
        let last = torques.states.last().map_or(0.0, |state| state.time_s);
        let figures = localisation::over_time(torques, &wheels);
        figures.into_iter().map(move |figure| Drawn::new(&torques.run, figure, Some((0.0, last))))
    });
    kept(shapes.chain(over_time).collect())
}

/// Of a diagnosis: the unexplained torque without and with the named effects, and the errors of each version.
#[must_use]
pub fn diagnosis_figures(found: &Explanation) -> Vec<Drawn> {
    let torque = found.torques.first().into_iter().flat_map(|before| {
        let last = before.states.last().map_or(0.0, |state| state.time_s);
        let figures = diagnosis::unexplained(&found.torques);
        figures.into_iter().map(move |figure| Drawn::new(&before.run, figure, Some((0.0, last))))
    });
    kept(torque.chain(of_versions(&found.versions)).collect())
}

/// Of an adoption: the worst channel with the model as given and with the last version, and the errors of each version.
#[must_use]
pub fn adoption_figures(found: &Adoption) -> Vec<Drawn> {
    let pair = adoption::pair(found);
    let curves = pair.into_iter().flat_map(|(run, figures)| {
        let span = Some((0.0, run.comparison.duration_s));
        figures.into_iter().map(move |figure| Drawn::new(&run.comparison.run, figure, span))
    });
    kept(curves.chain(of_versions(&found.versions)).collect())
}

fn of_versions(versions: &[whorl_explain::Version]) -> impl Iterator<Item = Drawn> {
    let runs = versions.first().map_or(&[][..], |version| &version.runs);
    runs.iter().enumerate().map(|(k, run)| {
        let name = &run.comparison.run;
        Drawn::new(name, versions::over_horizon(versions, k, name), None)
    })
}
