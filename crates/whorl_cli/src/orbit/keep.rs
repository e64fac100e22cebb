//! Days of formation keeping after a pass.

use anyhow::Context;
use serde::Serialize;
use whorl_coordinator::parameters::CoObservation;
use whorl_orbits::OrbitState;
use whorl_orbits::flight::Flight;
use whorl_orbits::formation::without_drift;
use whorl_orbits::formation_keeping::{Keeper, Kept, Place, holding_m_s_rev, keep};
use whorl_report::{DrawnCorrection, DrawnKeeping};

use crate::output::say;

const DAY_S: f64 = 86_400.0;

/// A deputy that was kept.
#[derive(Debug, Clone, Serialize)]
pub struct KeptRow {
    platform: String,
    days: f64,
    half_width_m: [f64; 3],
    /// Chief and deputy when the pass is over, and when keeping is; inertial axes.
    start: [StateRow; 2],
    end: [StateRow; 2],
    /// When keeping begins.
    mass_kg: f64,
    corrections: Vec<CorrectionRow>,
    given_m_s: f64,
    gas_kg: f64,
    /// What Gauss' equations and the secular rates ask for in as many days.
    expected_m_s: f64,
    /// When it came into the box to stay, after the pass; null if it is outside in the end.
    inside_since_day: Option<f64>,
    /// The furthest it was off from then on; null without.
    furthest_m: Option<[f64; 3]>,
    /// Where it would be in the end without corrections, relative to its place.
    uncorrected_m: [f64; 3],
    /// When its gas came to its end; null if it lasted.
    empty_day: Option<f64>,
}

/// Position and velocity, inertial axes.
#[derive(Debug, Clone, Serialize)]
struct StateRow {
    position_m: [f64; 3],
    velocity_m_s: [f64; 3],
}

impl StateRow {
    fn of(state: &OrbitState) -> Self {
        Self { position_m: state.position_m.into(), velocity_m_s: state.velocity_m_s.into() }
    }
}

/// A correction; all vectors along the deputy's own radius, track and orbit normal.
#[derive(Debug, Clone, Serialize)]
struct CorrectionRow {
    start_day: f64,
    length_s: f64,
    asked_m_s: [f64; 3],
    given_m_s: [f64; 3],
    gas_kg: f64,
}

/// Keeps every deputy of a pass that is to be kept, from the pass's end on; as rows and as drawn.
pub fn kept(
    pass: &CoObservation,
    flight: &Flight<'_>,
    platforms: &[String],
) -> anyhow::Result<Vec<(KeptRow, DrawnKeeping)>> {
    let (end_s, propagator) = (pass.mapping.orbit_span_s(), pass.pass.propagator());
    let epoch = pass.pass.chief.state();
    let chief = propagator.after(&epoch, end_s)?;
    let sights = flight.at(end_s)?;
    let mut all = Vec::new();
    for (k, ((platform, spacecraft), sight)) in
        platforms.iter().zip(&pass.pass.spacecraft).zip(&sights).enumerate()
    {
        let (Some(Some(keeper)), Some(formation)) = (pass.keepers.get(k), &spacecraft.formation) else {
            continue;
        };
        let of = || format!("{platform} cannot be kept in its formation");
        let begun: OrbitState = without_drift(propagator, &epoch, &formation.deputy(&pass.pass.chief)?);
        let place = Place::of(propagator, &epoch, &begun).with_context(of)?;
        let used_kg: f64 = flight.flown().iter().filter(|f| f.spacecraft == k).map(|f| f.gas_kg).sum();
        let keeper = Keeper {
            mass_kg: keeper.mass_kg - used_kg,
            gas_kg: (keeper.gas_kg - used_kg).max(0.0),
            ..*keeper
        };
        let kept = keep(propagator, &place, &chief, &sight.state, &keeper).with_context(of)?;
        let revolutions = keeper.duration_s / pass.pass.chief.period_s();
        let expected_m_s = holding_m_s_rev(propagator, &place, &chief)? * revolutions;
        let start = [&chief, &sight.state];
        all.push((row(platform, &keeper, &kept, start, expected_m_s), drawn(platform, &keeper, &kept)));
    }
    Ok(all)
}

fn row(platform: &str, keeper: &Keeper, kept: &Kept, start: [&OrbitState; 2], expected_m_s: f64) -> KeptRow {
    let since_s = kept.inside_since_s(&keeper.half_width_m);
    let (given_m_s, gas_kg) = kept.spent();
    let corrections = kept.corrections.iter().map(|c| CorrectionRow {
        start_day: c.span_s.0 / DAY_S,
        length_s: c.span_s.1 - c.span_s.0,
        asked_m_s: c.asked_m_s.into(),
        given_m_s: c.given_m_s.into(),
        gas_kg: c.gas_kg,
    });
    KeptRow {
        platform: platform.to_owned(),
        days: keeper.duration_s / DAY_S,
        half_width_m: keeper.half_width_m.into(),
        start: start.map(StateRow::of),
        mass_kg: keeper.mass_kg,
        end: kept.end.each_ref().map(StateRow::of),
        corrections: corrections.collect(),
        given_m_s,
        gas_kg,
        expected_m_s,
        inside_since_day: since_s.map(|s| s / DAY_S),
        furthest_m: since_s.map(|s| kept.furthest_m(s).into()),
        uncorrected_m: kept.uncorrected_hill_m.into(),
        empty_day: kept.empty_s.map(|s| s / DAY_S),
    }
}

fn drawn(platform: &str, keeper: &Keeper, kept: &Kept) -> DrawnKeeping {
    let days = |s: f64| s / DAY_S;
    DrawnKeeping {
        name: platform.to_owned(),
        half_width_m: keeper.half_width_m.into(),
        day: kept.samples.iter().map(|s| days(s.time_s)).collect(),
        off_m: kept.samples.iter().map(|s| s.off_hill_m.into()).collect(),
        given_m_s: kept.samples.iter().map(|s| s.given_m_s).collect(),
        gas_kg: kept.samples.iter().map(|s| s.gas_kg).collect(),
        corrections: kept
            .corrections
            .iter()
            .map(|c| DrawnCorrection { day: days(c.span_s.0), given_m_s: c.given_m_s.into() })
            .collect(),
    }
}

/// One sentence or two for each.
pub fn print(rows: &[KeptRow]) {
    for row in rows {
        let [x, y, z] = row.half_width_m;
        say!(
            "  {} is kept for {:.1} days after the pass within {x:.0} m radially, {y:.0} m along and {z:.0} m across: {} corrections, \
             {:.3} m/s, {:.1} g of gas. Holding it costs {:.3} m/s by the oblateness' rates; without corrections it would be {:.0} m off",
            row.platform,
            row.days,
            row.corrections.len(),
            row.given_m_s,
            row.gas_kg * 1e3,
            row.expected_m_s,
            row.uncorrected_m.iter().map(|m| m * m).sum::<f64>().sqrt(),
        );
        match (row.inside_since_day, row.furthest_m) {
            (Some(day), Some([x, y, z])) => say!(
                "    in the box {}; from then on at most {x:.0} m, {y:.0} m and {z:.0} m off",
                if day > 0.0 { format!("from {:.1} h on", day * 24.0) } else { "from the beginning".to_owned() }
            ),
            _ => say!(
                "    outside the box in the end: {}",
                row.empty_day.map_or_else(
                    || "what pulls it away in a revolution is too much for a box of this width; widen half_width_m".to_owned(),
                    |day| format!("its gas came to its end after {day:.2} days")
                )
            ),
        }
    }
}
