//! What burns of a pass give and cost, and what it costs to stay.

use nalgebra::Vector3;
use serde::Serialize;
use whorl_coordinator::parameters::CoObservation;
use whorl_orbits::Elements;
use whorl_orbits::flight::Flight;
use whorl_orbits::mean_elements::{self, MeanElementsError};
use whorl_orbits::pass::RelativeModel;

use crate::output::say;

/// A burn that was flown.
#[derive(Debug, Clone, Serialize)]
pub struct BurnRow {
    platform: String,
    start_s: f64,
    end_s: f64,
    wanted_m_s: f64,
    given_along_m_s: f64,
    given_across_m_s: f64,
    given_hill_m_s: [f64; 3],
    gas_kg: f64,
    drift_before_m_rev: f64,
    drift_after_m_rev: f64,
}

/// What the oblateness does to a deputy.
#[derive(Debug, Clone, Serialize)]
pub struct KeepingRow {
    platform: String,
    along_m_rev: f64,
    across_m_rev: f64,
    perigee_deg_rev: f64,
    each_revolution_m_s: f64,
    once_m_s: f64,
    /// By the mass and the specific impulse of its burn; null without one.
    gas_kg_day: Option<f64>,
}

/// A velocity change that was wanted, and what was given along it and across it, in the units of both.
pub fn speeds_m_s(wanted: &Vector3<f64>, given: &Vector3<f64>) -> [f64; 3] {
    let wanted_m_s = wanted.norm();
    let along = if wanted_m_s > 0.0 { given.dot(wanted) / wanted_m_s } else { 0.0 };
    let across2 = given.norm_squared() - along * along;
    [wanted_m_s, along, across2.max(0.0).sqrt()]
}

/// The burns of a pass.
pub fn burns(flight: &Flight<'_>, platforms: &[String]) -> Vec<BurnRow> {
    let each = flight.flown().iter().filter_map(|flown| {
        let [wanted_m_s, given_along_m_s, given_across_m_s] =
            speeds_m_s(&flown.wanted_hill_m_s, &flown.given_hill_m_s);
        Some(BurnRow {
            platform: platforms.get(flown.spacecraft)?.clone(),
            start_s: flown.span_s.0,
            end_s: flown.span_s.1,
            wanted_m_s,
            given_along_m_s,
            given_across_m_s,
            given_hill_m_s: flown.given_hill_m_s.into(),
            gas_kg: flown.gas_kg,
            drift_before_m_rev: flown.drift_m_rev.0,
            drift_after_m_rev: flown.drift_m_rev.1,
        })
    });
    each.collect()
}

/// What it costs each deputy to stay once the pass is over, by mean elements; nothing where the pass knows no oblateness.
pub fn keeping(
    pass: &CoObservation,
    flight: &Flight<'_>,
    platforms: &[String],
) -> anyhow::Result<Vec<KeepingRow>> {
    if pass.pass.model != RelativeModel::J2 {
        return Ok(Vec::new());
    }
    // When the pass is over, and what was to be thrust has been.
    let end_s = pass.mapping.orbit_span_s();
    let chief = pass.pass.propagator().after(&pass.pass.chief.state(), end_s)?;
    let chief = match mean_elements::mean(&Elements::of(&chief)?) {
        Err(error @ MeanElementsError::Critical { .. }) => {
            say!("  mean elements: {error}");
            return Ok(Vec::new());
        }
        found => found?,
    };
    let mut rows = Vec::new();
    let sights = flight.at(end_s)?;
    for ((platform, sight), spacecraft) in platforms.iter().zip(&sights).zip(&pass.pass.spacecraft) {
        if spacecraft.formation.is_none() {
            continue;
        }
        let deputy = mean_elements::mean(&Elements::of(&sight.state)?)?;
        let keeping = mean_elements::keeping(&chief, &deputy);
        let revolutions_day = 86_400.0 / chief.period_s();
        rows.push(KeepingRow {
            platform: platform.clone(),
            along_m_rev: keeping.along_m_rev,
            across_m_rev: keeping.across_m_rev,
            perigee_deg_rev: keeping.perigee_rad_rev.to_degrees(),
            each_revolution_m_s: keeping.each_revolution_m_s,
            once_m_s: keeping.once_m_s,
            gas_kg_day: spacecraft.burn.map(|b| b.gas_kg(keeping.each_revolution_m_s * revolutions_day)),
        });
    }
    Ok(rows)
}

/// Prints both.
pub fn print(burns: &[BurnRow], keeping: &[KeepingRow]) {
    for row in burns {
        say!(
            "  {} thrusts from {:.1} s to {:.1} s of orbit: {:.4} m/s wanted, {:.4} m/s given along it and {:.4} m/s across; \
             {:.1} g of gas. Drift along the track: {:+.0} m a revolution before, {:+.0} m after",
            row.platform,
            row.start_s,
            row.end_s,
            row.wanted_m_s,
            row.given_along_m_s,
            row.given_across_m_s,
            row.gas_kg * 1e3,
            row.drift_before_m_rev,
            row.drift_after_m_rev,
        );
    }
    for row in keeping {
        let gas = row.gas_kg_day.map_or_else(String::new, |kg| format!(", {:.1} g of gas a day", kg * 1e3));
        say!(
            "  {} drifts after the pass, the oblateness included, by {:+.1} m along the track and {:+.1} m across it a revolution (mean \
             elements). Node and perigee held: {:.4} m/s a revolution{gas}; drift ended: {:.4} m/s once",
            row.platform,
            row.along_m_rev,
            row.across_m_rev,
            row.each_revolution_m_s,
            row.once_m_s,
        );
    }
    let costs: Vec<f64> = keeping.iter().map(|row| row.each_revolution_m_s).collect();
    if costs.len() > 1 {
        say!(
            "  the most expensive to keep takes {:.2} times the mean: the formation lasts as long as its gas does",
            mean_elements::imbalance(&costs)
        );
    }
}
