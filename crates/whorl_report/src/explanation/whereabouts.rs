//! The page of `whorl where`.

use whorl_explain::Located;
use whorl_trajectory::ResidualTorque;
use whorl_validation::Whereabouts;
use whorl_validation::dependence::{Dependence, Frame};

use super::{Facts, facts};
use crate::document::{Document, code, number, text};
use crate::figure::Figure;
use crate::series::Curve;

/// Quantities whose curves are drawn.
const DRAWN: usize = 4;

/// The page as one self-contained HTML document.
#[must_use]
pub fn whereabouts_html(found: &Located, about: &Facts) -> String {
    let mut page = Document::new("Where does the model fail?");
    for sentence in found.pooled.answer() {
        page.paragraph("answer", &sentence);
    }
    let refitted = match &found.not_refitted {
        None => {
            "The platform's own parameters were refitted to the training runs first, within their priors."
                .to_owned()
        }
        Some(reason) => format!("The platform's own parameters are as given: {reason}"),
    };
    page.paragraph("rule", &refitted);
    if found.pooled.is_anything_left() {
        page.heading(&found.pooled.run);
        section(&mut page, &found.pooled);
    }
    let each = if found.runs.is_empty() { std::slice::from_ref(&found.pooled) } else { &found.runs };
    for run in each {
        page.heading(&format!("{} over time", run.run));
        if !found.runs.is_empty() {
            run.answer().iter().for_each(|sentence| page.paragraph("answer", sentence));
        }
        for figure in run.residuals.iter().flat_map(over_time) {
            page.figure(&figure, None);
        }
    }
    facts(&mut page, about);
    page.finish()
}

fn section(page: &mut Document, run: &Whereabouts) {
    let found = &run.dependences;
    page.paragraph(
        "rule",
        "Share: how much of the residual torque's mean square beyond noise a smooth curve of each quantity predicts on stretches of \
         time that it was not fitted to. Shares of quantities that move together overlap: they do not add up.",
    );
    let constant = |name: &str, share: f64, frame: &str| {
        vec![code(name), text(frame), number(share * 100.0, 0), text(""), text(""), text("")]
    };
    let mut rows = vec![
        constant("constant", found.constant_body_share, "body"),
        constant("constant", found.constant_world_share, "world"),
    ];
    rows.extend(found.ranked.iter().map(|d| {
        vec![
            code(&d.variable),
            text(if d.frame == Frame::Body { "body" } else { "world" }),
            number(d.share * 100.0, 0),
            text(axes(d.frame)[d.axis.min(2)]),
            text(&lower(&d.parity)),
            text(&lower(&d.growth)),
        ]
    }));
    page.table(&["quantity", "frame", "#share [%]", "axis", "symmetry", "growth"], &rows);
    for dependence in found.ranked.iter().take(DRAWN).filter(|d| d.share > 0.05) {
        page.figure(&shape(dependence), None);
    }
}

fn axes(frame: Frame) -> [&'static str; 3] {
    match frame {
        Frame::Body => ["x", "y", "z"],
        Frame::World => ["east", "north", "up"],
    }
}

fn lower(value: &impl std::fmt::Debug) -> String {
    format!("{value:?}").to_lowercase()
}

fn display(unit: &str) -> (&str, f64) {
    match unit {
        "rad" => ("deg", whorl_math::deg_from_rad(1.0)),
        "rad/s" => ("deg/s", whorl_math::deg_from_rad(1.0)),
        "Pa" => ("MPa", 1e-6),
        other => (other, 1.0),
    }
}

fn shape(d: &Dependence) -> Figure {
    // Wheel speeds are large, so they are not converted to degrees.
    let (unit, factor) =
        if d.variable.starts_with("wheel") { (d.unit.as_str(), 1.0) } else { display(&d.unit) };
    let at = |values: &[f64]| -> Vec<(f64, f64)> {
        d.shape.x.iter().map(|x| x * factor).zip(values.iter().map(|v| v * 1e3)).collect()
    };
    let edge = |i: usize, sign: f64| {
        let values: Vec<f64> = d.shape.torque_n_m[i]
            .iter()
            .zip(&d.shape.stddev_n_m[i])
            .map(|(g, s)| g + sign * 2.0 * s)
            .collect();
        Curve::new("band", at(&values))
    };
    let name = d.variable.replace('_', " ");
    Figure {
        title: format!("Residual torque over {name} ({:.0} % of the excess)", d.share * 100.0),
        caption: format!(
            "About {} axes, with bands of two standard deviations.",
            if d.frame == Frame::Body { "body" } else { "world" }
        ),
        x_label: format!("{name} [{unit}]"),
        y_label: "torque [mN m]".to_owned(),
        curves: (0..3).map(|i| Curve::new(axes(d.frame)[i], at(&d.shape.torque_n_m[i]))).collect(),
        bands: (0..3).map(|i| (edge(i, -1.0), edge(i, 1.0))).collect(),
        ..Figure::default()
    }
}

/// The residual over time, in both frames.
fn over_time(torque: &ResidualTorque) -> [Figure; 2] {
    let figure = |frame: Frame| {
        let values: Vec<nalgebra::Vector3<f64>> = torque
            .torque_b_n_m
            .iter()
            .zip(&torque.q_world_body)
            .map(|(g, q)| if frame == Frame::World { q * g } else { *g })
            .collect();
        let curve = |i: usize, sign: f64| {
            let points = torque.time_s.iter().zip(&values).zip(&torque.stddev_b_n_m);
            Curve::new(axes(frame)[i], points.map(|((t, g), s)| (*t, (g[i] + sign * 2.0 * s[i]) * 1e3)))
        };
        let name = if frame == Frame::Body { "body" } else { "world" };
        Figure {
            title: format!("Residual torque over time, {name} axes"),
            caption: "Torque that the model does not explain, smoothed, with two standard deviations. A torque that is steadier in one of the two \
                      frames is fixed to that frame."
                .to_owned(),
            y_label: "torque [mN m]".to_owned(),
            curves: (0..3).map(|i| curve(i, 0.0)).collect(),
            bands: if frame == Frame::Body { (0..3).map(|i| (curve(i, -1.0), curve(i, 1.0))).collect() } else { Vec::new() },
            ..Figure::default()
        }
    };
    [figure(Frame::Body), figure(Frame::World)]
}
