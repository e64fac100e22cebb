//! Days of formation keeping on the page of a pass: how far off its place a spacecraft is, and what holding it costs.

use serde::Serialize;

use crate::document::Document;
use crate::figure::{Figure, Limit};
use crate::series::Curve;

/// A correction that was flown.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct DrawnCorrection {
    /// When it began \[days\].
    pub day: f64,
    /// What was given, along its own radius, track and orbit normal \[m/s\].
    pub given_m_s: [f64; 3],
}

/// A spacecraft that was kept in its formation, at the same instants in all lists.
#[derive(Debug, Clone, Default, Serialize)]
pub struct DrawnKeeping {
    /// The platform that stands for it.
    pub name: String,
    /// The box: half its width, radial, in-track and cross-track \[m\].
    pub half_width_m: [f64; 3],
    /// Time after the pass \[days\].
    pub day: Vec<f64>,
    /// Position relative to its place, radial, in-track and cross-track \[m\].
    pub off_m: Vec<[f64; 3]>,
    /// Velocity change given until then \[m/s\].
    pub given_m_s: Vec<f64>,
    /// Gas used until then \[kg\].
    pub gas_kg: Vec<f64>,
    /// Its corrections.
    pub corrections: Vec<DrawnCorrection>,
}

/// Names of the axes.
const AXES: [&str; 3] = ["radial", "in-track", "cross-track"];

impl DrawnKeeping {
    pub(crate) fn add_to(&self, page: &mut Document) {
        page.heading(&format!("{}, kept for {:.1} days", self.name, self.day.last().copied().unwrap_or(0.0)));
        for (k, axis) in AXES.iter().enumerate() {
            page.figure(&self.off(k, axis), None);
        }
        for figure in self.spent() {
            page.figure(&figure, None);
        }
        page.figure(&self.each(), None);
    }

    fn figure(&self, title: &str, caption: &str, y_label: &str, curves: Vec<Curve>) -> Figure {
        Figure {
            title: format!("{}: {title}", self.name),
            caption: caption.to_owned(),
            x_label: "time after the pass [days]".to_owned(),
            y_label: y_label.to_owned(),
            curves,
            ..Figure::default()
        }
    }

    fn off(&self, which: usize, axis: &str) -> Figure {
        let half_m = self.half_width_m.get(which).copied().unwrap_or(f64::NAN);
        let points = self.day.iter().zip(&self.off_m).map(|(day, off)| (*day, off[which]));
        let limit = |value| Limit { name: format!("box, {half_m:.0} m"), value };
        Figure {
            limits: vec![limit(half_m), limit(-half_m)],
            ..self.figure(
                &format!("off its place, {axis}"),
                "Relative to where its formation wants it. The lines are the box.",
                "off [m]",
                vec![Curve::new(axis, points)],
            )
        }
    }

    fn spent(&self) -> [Figure; 2] {
        let curve = |name: &str, values: &[f64], unit: f64| {
            Curve::new(name.to_owned(), self.day.iter().zip(values).map(|(day, value)| (*day, value * unit)))
        };
        let figure =
            |title, y_label, curve| self.figure(title, "All corrections until then.", y_label, vec![curve]);
        [
            figure("velocity change given", "velocity change [m/s]", curve("given", &self.given_m_s, 1.0)),
            figure("gas used", "gas [g]", curve("gas", &self.gas_kg, 1e3)),
        ]
    }

    fn each(&self) -> Figure {
        let curve = |which: usize| {
            let points = self.corrections.iter().map(|c| (c.day, c.given_m_s[which] * 1e3));
            Curve::new(AXES[which], points)
        };
        self.figure(
            "each correction",
            "Along its own track and across its orbit.",
            "velocity change [mm/s]",
            vec![curve(1), curve(2)],
        )
    }
}
