//! The page of a pass: spacecraft, target and lines of sight in three dimensions, ground tracks, and the angles that decide
//! whether boresight and thruster can both point.

use maud::html;
use serde::Serialize;
use serde_json::json;

use crate::document::{Document, number, text};
use crate::explanation::Facts;
use crate::figure::{Figure, Span};
use crate::orbit_keeping::DrawnKeeping;
use crate::series::Curve;

const SCRIPT: &str = include_str!("../assets/orbit.js");

/// A burn that was flown during the pass.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct DrawnBurn {
    /// When it begins and ends in the laboratory \[s\].
    pub laboratory_s: [f64; 2],
    /// When it begins and ends on the orbit \[s\].
    pub orbit_s: [f64; 2],
    /// Velocity change that was wanted \[m/s\].
    pub wanted_m_s: f64,
    /// What was given along it and across it \[m/s\].
    pub given_m_s: [f64; 2],
    /// Gas used \[kg\].
    pub gas_kg: f64,
}

/// One spacecraft over the pass; Earth-fixed axes (z: north pole, x: longitude 0 at the epoch).
#[derive(Debug, Clone, Default, Serialize)]
pub struct DrawnCraft {
    /// The platform that stands for it.
    pub name: String,
    /// Where it is \[km\].
    pub position_km: Vec<[f64; 3]>,
    /// Its boresight, unit vectors.
    pub boresight: Vec<[f64; 3]>,
    /// East longitude and geodetic latitude of the point below it \[deg\].
    pub ground_deg: Vec<[f64; 2]>,
    /// `theta_mission` \[deg\]; NaN without a wanted velocity change.
    pub mission_deg: Vec<f64>,
    /// `theta_config` \[deg\].
    pub config_deg: f64,
    /// Angles of boresight and thrust to what they are meant for \[deg\]; NaN where there is nothing.
    pub off_deg: Vec<[f64; 2]>,
    /// Elevation above the target's horizon \[deg\].
    pub elevation_deg: Vec<f64>,
    /// Distance to the chief \[km\].
    pub to_chief_km: Vec<f64>,
    /// Yaw, pitch and roll that the platform is given \[deg\].
    pub yaw_pitch_roll_deg: Vec<[f64; 3]>,
    /// Its burns.
    pub burns: Vec<DrawnBurn>,
}

/// A pass, at the same instants for all spacecraft.
#[derive(Debug, Clone, Default)]
pub struct DrawnPass {
    /// Name of the experiment's step.
    pub step: String,
    /// Time in the laboratory and on the orbit \[s\].
    pub time_s: Vec<[f64; 2]>,
    /// The target, Earth-fixed \[km\].
    pub target_km: Vec<[f64; 3]>,
    /// East longitude and geodetic latitude of the target \[deg\].
    pub target_deg: Vec<[f64; 2]>,
    /// The spacecraft.
    pub spacecraft: Vec<DrawnCraft>,
    /// Days of formation keeping after it.
    pub keeping: Vec<DrawnKeeping>,
}

/// The page.
#[must_use]
pub fn orbit_html(title: &str, passes: &[DrawnPass], facts: &Facts) -> String {
    let mut page = Document::new(title);
    for pass in passes {
        let (laboratory_s, orbit_s) = pass.time_s.last().map_or((0.0, 0.0), |[a, b]| (*a, *b));
        page.heading(&format!("Step {}", pass.step));
        page.paragraph("rule", &format!("{orbit_s:.0} s of orbit in {laboratory_s:.0} s of the laboratory."));
        scene(&mut page, pass);
        burns(&mut page, pass);
        page.figure(&ground_tracks(pass), None);
        for figure in over_time(pass) {
            page.figure(&figure, None);
        }
        pass.keeping.iter().for_each(|keeping| keeping.add_to(&mut page));
    }
    crate::explanation::facts(&mut page, facts);
    page.script(SCRIPT);
    page.finish()
}

fn burns(page: &mut Document, pass: &DrawnPass) {
    let row = |(craft, burn): (&DrawnCraft, &DrawnBurn)| {
        let [from, to] = burn.orbit_s;
        let [along, across] = burn.given_m_s;
        let mut row = vec![text(&craft.name), text(&format!("{from:.1} to {to:.1}"))];
        row.extend([burn.wanted_m_s, along, across].map(|speed| number(speed, 4)));
        row.push(number(burn.gas_kg * 1e3, 1));
        row
    };
    let rows: Vec<_> = each_burn(pass).map(row).collect();
    if !rows.is_empty() {
        page.table(
            &[
                "thrusts",
                "of orbit [s]",
                "#wanted [m/s]",
                "#given along it [m/s]",
                "#across it [m/s]",
                "#gas [g]",
            ],
            &rows,
        );
    }
}

fn each_burn(pass: &DrawnPass) -> impl Iterator<Item = (&DrawnCraft, &DrawnBurn)> {
    pass.spacecraft.iter().flat_map(|craft| craft.burns.iter().map(move |burn| (craft, burn)))
}

fn scene(page: &mut Document, pass: &DrawnPass) {
    let stored = json!({"time_s": pass.time_s, "target_km": pass.target_km, "spacecraft": pass.spacecraft});
    // A name cannot end the script.
    let stored = stored.to_string().replace('<', "\\u003c");
    page.add(html! {
        div class="scene orbit" {
            canvas tabindex="0" role="img"
                aria-label="The Earth, the spacecraft with their tracks and boresights, and the target in three dimensions. Drag or arrow keys turn the view, + and - zoom." {}
            div class="bar" role="group" aria-label="Pass" {
                button type="button" { "Play" }
                input type="range" min="0" max=(pass.time_s.len().saturating_sub(1)) value=(pass.time_s.len() / 2) aria-label="Time";
                output {}
            }
            p class="key" {
                @for (k, craft) in pass.spacecraft.iter().enumerate() {
                    span { i style=(format!("background: var(--c{})", k % 8)) {} (craft.name) }
                }
                span { i style=(format!("background: var(--c{})", pass.spacecraft.len() % 8)) {} "target" }
            }
            p class="caption" {
                "Bold: from the start to now. Dotted: ground track. Thin line to the target: boresight."
                @if each_burn(pass).next().is_some() { " Wide: while it thrusts." }
            }
            script type="application/json" { (maud::PreEscaped(stored)) }
        }
    });
}

fn ground_tracks(pass: &DrawnPass) -> Figure {
    let curve = |name: &str, points: &[[f64; 2]]| {
        Curve::new(name.to_owned(), points.iter().map(|[longitude, latitude]| (*longitude, *latitude)))
    };
    let mut curves: Vec<Curve> =
        pass.spacecraft.iter().map(|craft| curve(&craft.name, &craft.ground_deg)).collect();
    curves.push(curve("target", &pass.target_deg));
    for (craft, burn) in each_burn(pass) {
        let thrusts = |(_, at): &(_, &[f64; 2])| burn.orbit_s[0] <= at[1] && at[1] <= burn.orbit_s[1];
        let points: Vec<[f64; 2]> =
            craft.ground_deg.iter().copied().zip(&pass.time_s).filter(thrusts).map(|(at, _)| at).collect();
        curves.push(curve(&format!("{} thrusts", craft.name), &points));
    }
    // uPlot draws along increasing abscissas.
    for curve in &mut curves {
        if curve.time_s.first() > curve.time_s.last() {
            curve.time_s.reverse();
            curve.value.reverse();
        }
    }
    Figure {
        title: "Ground tracks".to_owned(),
        caption: "Points straight below the spacecraft, and the target. Longitude from the inertial x axis at the epoch.".to_owned(),
        x_label: "east longitude [deg]".to_owned(),
        y_label: "geodetic latitude [deg]".to_owned(),
        curves,
        ..Figure::default()
    }
}

fn over_time(pass: &DrawnPass) -> Vec<Figure> {
    let each = |value: &dyn Fn(&DrawnCraft, usize) -> f64| -> Vec<Curve> {
        let times = || pass.time_s.iter().map(|[laboratory, _]| *laboratory).enumerate();
        let curve =
            |craft: &DrawnCraft| Curve::new(craft.name.clone(), times().map(|(k, t)| (t, value(craft, k))));
        pass.spacecraft.iter().map(curve).collect()
    };
    let at = |values: &[f64], k: usize| values.get(k).copied().unwrap_or(f64::NAN);
    let component =
        |values: &[[f64; 2]], k: usize, which: usize| values.get(k).map_or(f64::NAN, |v| v[which]);
    let each_craft = pass.spacecraft.iter().enumerate();
    let spans: Vec<Span> = each_craft
        .flat_map(|(curve, craft)| craft.burns.iter().map(move |burn| (curve, craft, burn)))
        .map(|(curve, craft, burn)| Span {
            name: format!("{} thrusts", craft.name),
            from_to: burn.laboratory_s,
            curve,
        })
        .collect();
    let figure = |title: &str, caption: &str, y_label: &str, curves: Vec<Curve>, dashed: Vec<Curve>| Figure {
        title: title.to_owned(),
        caption: caption.to_owned(),
        x_label: "time in the laboratory [s]".to_owned(),
        y_label: y_label.to_owned(),
        curves,
        dashed,
        spans: spans.clone(),
        ..Figure::default()
    };
    let named = |curves: Vec<Curve>, suffix: &str| -> Vec<Curve> {
        curves.into_iter().map(|c| Curve { name: format!("{}{suffix}", c.name), ..c }).collect()
    };
    let mut figures = vec![
        figure(
            "theta_mission and theta_config",
            "Solid: the angle that the mission asks for between the line of sight and the wanted velocity change. Dashed: the angle between boresight and thruster as they are mounted. Where they meet, both can point.",
            "angle [deg]",
            named(each(&|craft, k| at(&craft.mission_deg, k)), " mission"),
            named(each(&|craft, _| craft.config_deg), " config"),
        ),
        figure(
            "What each mismatch costs",
            "Solid: angle between boresight and target. Dashed: angle between thrust and the wanted velocity change.",
            "off [deg]",
            named(each(&|craft, k| component(&craft.off_deg, k, 0)), " boresight"),
            named(each(&|craft, k| component(&craft.off_deg, k, 1)), " thrust"),
        ),
        figure(
            "Elevation",
            "Above the target's horizon.",
            "elevation [deg]",
            each(&|craft, k| at(&craft.elevation_deg, k)),
            Vec::new(),
        ),
        figure(
            "Distance to the chief",
            "",
            "distance [km]",
            each(&|craft, k| at(&craft.to_chief_km, k)),
            Vec::new(),
        ),
    ];
    for craft in &pass.spacecraft {
        let angle = |which: usize, name: &str| {
            let points =
                pass.time_s.iter().zip(&craft.yaw_pitch_roll_deg).map(|([t, _], angles)| (*t, angles[which]));
            Curve::new(name, points)
        };
        figures.push(figure(
            &format!("What {} is given", craft.name),
            "Its attitude reference in the laboratory.",
            "angle [deg]",
            vec![angle(0, "yaw"), angle(1, "pitch"), angle(2, "roll")],
            Vec::new(),
        ));
    }
    figures
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_cannot_end_the_script_and_tracks_run_eastwards() {
        let craft = DrawnCraft {
            name: "</script><b>".to_owned(),
            ground_deg: vec![[10.0, 1.0], [9.0, 2.0]],
            ..DrawnCraft::default()
        };
        let pass = DrawnPass {
            time_s: vec![[0.0, 0.0], [10.0, 20.0]],
            spacecraft: vec![craft],
            ..DrawnPass::default()
        };
        let page = orbit_html("t", std::slice::from_ref(&pass), &[]);
        assert!(!page.contains("</script><b>"));
        let tracks = ground_tracks(&pass);
        assert_eq!(
            (tracks.curves[0].time_s.as_slice(), tracks.curves[0].value.as_slice()),
            (&[9.0, 10.0][..], &[2.0, 1.0][..])
        );
    }
}
