//! The page of `whorl next`.

use maud::Markup;
use nalgebra::UnitQuaternion;

use super::{Facts, facts};
use crate::document::{Document, text_below};
use crate::figure::Figure;
use crate::series::Curve;

/// The proposed manoeuvre in simulation; attitudes v_world = q v_body.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PlannedMotion {
    /// Its name.
    pub name: String,
    /// Times of the attitudes \[s\].
    pub time_s: Vec<f64>,
    /// Attitudes.
    pub q_world_body: Vec<UnitQuaternion<f64>>,
    /// Times of the wheel speeds \[s\].
    pub wheel_time_s: Vec<f64>,
    /// Wheel speeds [rad/s].
    pub wheel_speed_rad_s: Vec<Vec<f64>>,
}

/// Contents of the page.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct NextPage {
    /// The answer, one paragraph each.
    pub answer: Vec<String>,
    /// Headings of the table of manoeuvres; headings of numeric columns begin with `#`.
    pub headings: Vec<String>,
    /// Its rows.
    pub rows: Vec<Vec<String>>,
    /// The best manoeuvre.
    pub motion: PlannedMotion,
}

/// The page as one self-contained HTML document.
#[must_use]
pub fn next_html(next: &NextPage, about: &Facts) -> String {
    let mut page = Document::new("What to do next?");
    for sentence in &next.answer {
        page.paragraph("answer", sentence);
    }
    page.heading("Manoeuvres that were compared");
    page.paragraph(
        "rule",
        "Log odds: expected lead of the true explanation over the best of the others, including the data at hand. \
         Effects shown: number of effects that would be detected at their ordinary size.",
    );
    let headings: Vec<&str> = next.headings.iter().map(String::as_str).collect();
    let rows: Vec<Vec<Markup>> = next
        .rows
        .iter()
        .map(|row| row.iter().zip(&headings).map(|(cell, heading)| text_below(heading, cell)).collect())
        .collect();
    page.table(&headings, &rows);
    page.heading(&format!("The best one in simulation: {}", next.motion.name.replace('_', " ")));
    for figure in figures(&next.motion) {
        page.figure(&figure, None);
    }
    facts(&mut page, about);
    page.finish()
}

fn figures(motion: &PlannedMotion) -> Vec<Figure> {
    let angles: Vec<(f64, [f64; 3])> = motion
        .time_s
        .iter()
        .zip(&motion.q_world_body)
        .map(|(t, q)| {
            let (roll, pitch, yaw) = q.euler_angles();
            (*t, [yaw, pitch, roll].map(whorl_math::deg_from_rad))
        })
        .collect();
    let curve = |name: &str, i: usize| {
        Curve::new(name, angles.iter().map(|(t, a)| (*t, a.get(i).copied().unwrap_or(f64::NAN))))
    };
    let wheels = motion.wheel_speed_rad_s.first().map_or(0, Vec::len);
    let wheel = |j: usize| {
        let speeds = motion.wheel_time_s.iter().zip(&motion.wheel_speed_rad_s);
        Curve::new(
            format!("wheel {}", j + 1).as_str(),
            speeds.map(|(t, s)| (*t, s.get(j).copied().unwrap_or(f64::NAN))),
        )
    };
    let figure = |title: &str, y_label: &str, curves: Vec<Curve>| Figure {
        title: title.to_owned(),
        y_label: y_label.to_owned(),
        curves,
        ..Figure::default()
    };
    vec![
        figure("Yaw", "yaw [deg]", vec![curve("yaw", 0)]),
        figure("Pitch and roll", "angle [deg]", vec![curve("pitch", 1), curve("roll", 2)]),
        figure("Wheel speeds", "speed [rad/s]", (0..wheels).map(wheel).collect()),
    ]
}
