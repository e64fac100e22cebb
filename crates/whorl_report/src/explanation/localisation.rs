//! The page of `whorl where`.

use whorl_explain::Located;
use whorl_validation::{Dependence, Dependences, Frame, Localisation, UnexplainedTorques};

use super::{Facts, facts};
use crate::document::{Document, code, right, text};
use crate::figure::Figure;
use crate::series::Curve;

/// Quantities whose curves are drawn.
const DRAWN: usize = 4;
/// Of the excess: what explains less is not drawn.
const LEAST_SHARE: f64 = 0.05;
const OF_BODY: &str = "Unexplained torque";

/// The page as one self-contained HTML document.
#[must_use]
pub fn localisation_html(found: &Located, about: &Facts) -> String {
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
    page.list(&found.pooled.remarks);
    section(&mut page, &found.pooled);
    for (k, torques) in found.torques.iter().enumerate() {
        page.heading(&format!("{} over time", torques.run));
        if let Some(run) = found.runs.get(k) {
            run.answer().iter().for_each(|sentence| page.paragraph("answer", sentence));
        }
        let wheels: Vec<&str> = found.model.wheels().iter().map(|wheel| wheel.name.as_str()).collect();
        let figures = over_time(torques, &wheels);
        if figures.is_empty() {
            page.paragraph("rule", "No torque beside the model's makes the run likelier.");
        }
        figures.iter().for_each(|figure| page.figure(figure, None));
    }
    facts(&mut page, about);
    page.finish()
}

fn section(page: &mut Document, run: &Localisation) {
    if !run.is_anything_left() {
        return;
    }
    page.heading(&run.run);
    page.paragraph(
        "rule",
        "Share: how much of the unexplained torque's mean square beyond noise a curve of each quantity explains, of the simple shape that fits \
         best. Shares of quantities that move together overlap: they do not add up.",
    );
    if let Some(found) = &run.dependences {
        table(page, found);
        drawn(found, OF_BODY).iter().for_each(|figure| page.figure(figure, None));
    }
    for motor in &run.motors {
        if let Some(found) = &motor.dependences {
            page.heading(&format!("{}: motor of {}", run.run, motor.wheel));
            table(page, found);
            drawn(found, &of_motor(&motor.wheel)).iter().for_each(|figure| page.figure(figure, None));
        }
    }
}

fn of_motor(wheel: &str) -> String {
    format!("Unexplained torque of {wheel}'s motor")
}

/// The torque over the quantities that explain most of it.
fn drawn(found: &Dependences, title: &str) -> Vec<Figure> {
    let told = found.ranked.iter().take(DRAWN).filter(|d| d.share > LEAST_SHARE);
    told.map(|d| shape(d, title)).collect()
}

/// The same of body and motors.
pub(super) fn shapes(run: &Localisation) -> Vec<Figure> {
    let of_body = run.dependences.iter().flat_map(|found| drawn(found, OF_BODY));
    let of_motors = run
        .motors
        .iter()
        .flat_map(|motor| motor.dependences.iter().flat_map(|found| drawn(found, &of_motor(&motor.wheel))));
    of_body.chain(of_motors).collect()
}

/// What tables call the columns of [`shares`].
pub const SHARES: [&str; 6] = ["quantity", "frame", "#share [%]", "axis", "symmetry", "growth"];

/// The share of the excess that a constant torque explains, and each quantity, as cells.
#[must_use]
pub fn shares(found: &Dependences) -> Vec<[String; 6]> {
    let percent = |share: f64| format!("{:.0}", share * 100.0);
    let constant =
        |share: f64, frame: Frame| ["constant", frame.name(), &percent(share), "", "", ""].map(str::to_owned);
    let mut rows = vec![constant(found.constant_body_share, found.frame)];
    if found.frame == Frame::Body {
        rows.push(constant(found.constant_world_share, Frame::World));
    }
    rows.extend(found.ranked.iter().map(|d| {
        let axis = d.frame.axes().get(d.axis).unwrap_or(&"");
        let (parity, growth) = (format!("{:?}", d.parity), format!("{:?}", d.growth));
        let cells = [d.frame.name(), &percent(d.share), axis, &parity, &growth].map(str::to_lowercase);
        let [frame, share, axis, parity, growth] = cells;
        [d.variable.clone(), frame, share, axis, parity, growth]
    }));
    rows
}

fn table(page: &mut Document, found: &Dependences) {
    let row = |[quantity, frame, share, axis, parity, growth]: [String; 6]| {
        vec![code(&quantity), text(&frame), right(&share), text(&axis), text(&parity), text(&growth)]
    };
    let rows: Vec<_> = shares(found).into_iter().map(row).collect();
    page.table(&SHARES, &rows);
}

fn display(unit: &str) -> (&str, f64) {
    match unit {
        "rad" => ("deg", whorl_math::deg_from_rad(1.0)),
        "rad/s" => ("deg/s", whorl_math::deg_from_rad(1.0)),
        "Pa" => ("MPa", 1e-6),
        other => (other, 1.0),
    }
}

fn shape(d: &Dependence, title: &str) -> Figure {
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
    let drawn = || d.frame.axes().iter().enumerate();
    Figure {
        title: format!("{title} over {name} ({:.0} % of the excess)", d.share * 100.0),
        caption: match d.frame {
            one @ (Frame::Wheel | Frame::Hinge) => {
                format!("About {}, with a band of two standard deviations.", one.about(0))
            }
            frame => format!("About {} axes, with bands of two standard deviations.", frame.name()),
        },
        x_label: format!("{name} [{unit}]"),
        y_label: "torque [mN m]".to_owned(),
        curves: drawn().map(|(i, axis)| Curve::new(*axis, at(&d.shape.torque_n_m[i]))).collect(),
        bands: drawn().map(|(i, _)| (edge(i, -1.0), edge(i, 1.0))).collect(),
        ..Figure::default()
    }
}

/// The torques over time: on the body in both frames, and of the motors; those that there are.
pub(super) fn over_time(torques: &UnexplainedTorques, wheels: &[&str]) -> Vec<Figure> {
    let mut figures = Vec::new();
    if torques.levels.body_stddev_b_n_m().iter().any(|level| *level > 0.0) {
        figures.extend([Frame::Body, Frame::World].map(|frame| body_over_time(torques, frame)));
    }
    let motors =
        torques.levels.motors_n_m.iter().zip(wheels).enumerate().filter(|(_, (level, _))| **level > 0.0);
    let shown: Vec<(usize, &str)> = motors.map(|(j, (_, wheel))| (j, *wheel)).collect();
    if !shown.is_empty() {
        let curve = |(j, wheel): (usize, &str), sign: f64| {
            let points = torques.states.iter().filter_map(|state| {
                let (torque, stddev) =
                    (state.motor_torque_n_m.get(j)?, state.motor_torque_stddev_n_m.get(j)?);
                Some((state.time_s, (torque + sign * 2.0 * stddev) * 1e3))
            });
            Curve::new(wheel, points)
        };
        figures.push(Figure {
            title: "Unexplained torque of the motors over time".to_owned(),
            caption: "Torque about each wheel's axis beyond the commanded one and the model's friction, given all readings of the run, with two \
                      standard deviations."
                .to_owned(),
            y_label: "torque [mN m]".to_owned(),
            curves: shown.iter().map(|of| curve(*of, 0.0)).collect(),
            bands: shown.iter().map(|of| (curve(*of, -1.0), curve(*of, 1.0))).collect(),
            ..Figure::default()
        });
    }
    figures
}

fn body_over_time(torques: &UnexplainedTorques, frame: Frame) -> Figure {
    let curve = |i: usize, sign: f64| {
        let points = torques.states.iter().map(|state| {
            let (torque, covariance) = match frame {
                Frame::World => {
                    let r = state.q_world_body.to_rotation_matrix().into_inner();
                    (r * state.torque_b_n_m, r * state.torque_covariance_b * r.transpose())
                }
                _ => (state.torque_b_n_m, state.torque_covariance_b),
            };
            (state.time_s, (torque[i] + sign * 2.0 * covariance[(i, i)].max(0.0).sqrt()) * 1e3)
        });
        Curve::new(frame.axes().get(i).copied().unwrap_or_default(), points)
    };
    Figure {
        title: format!("Unexplained torque over time, {} axes", frame.name()),
        caption: "Torque that the model does not explain, given all readings of the run, with two standard deviations. A torque that is \
                  steadier in one of the two frames is fixed to that frame."
            .to_owned(),
        y_label: "torque [mN m]".to_owned(),
        curves: (0..3).map(|i| curve(i, 0.0)).collect(),
        bands: (0..3).map(|i| (curve(i, -1.0), curve(i, 1.0))).collect(),
        ..Figure::default()
    }
}
