//! Which cases there are.

use serde::{Deserialize, Serialize};

use super::catalogue::SINGLES;
use super::foreign::FOREIGN;

/// What a case asks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cell {
    /// One effect of the catalogue.
    Single,
    /// None.
    Control,
    /// Two.
    Pair,
    /// One, with data that cannot separate it from another; then follow-up data that can.
    Confounded,
    /// One that the catalogue does not have.
    Outside,
    /// One, recorded with a controller running.
    ClosedLoop,
    /// One, wheels on a clamped platform.
    Bench,
}

/// A case, before anything is drawn.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Spec {
    pub cell: Cell,
    /// Effect ids; for [`Cell::Outside`] the name of the foreign effect.
    pub effects: Vec<String>,
    /// Detectability aimed at.
    pub lambda: u32,
    pub seed: u32,
}

impl Spec {
    /// Names the case and its random numbers.
    #[must_use]
    pub fn key(&self) -> String {
        let cell = match self.cell {
            Cell::Single => "single",
            Cell::Control => "control",
            Cell::Pair => "pair",
            Cell::Confounded => "confounded",
            Cell::Outside => "outside",
            Cell::ClosedLoop => "closed_loop",
            Cell::Bench => "bench",
        };
        let effects = if self.effects.is_empty() { "none".to_owned() } else { self.effects.join("+") };
        format!("{cell}/{effects}/{}/{}", self.lambda, self.seed)
    }
}

/// Torques for closed-loop runs.
const CLOSED_LOOP: [&str; 6] = [
    "bearing_viscous_friction",
    "air_current",
    "bearing_turbine",
    "harness_spring",
    "wheel_misalignment",
    "gyro_scale",
];

/// Every case for `seeds` seeds, seed by seed; `quick` thins out.
#[must_use]
pub fn all_specs(seeds: u32, quick: bool) -> Vec<Spec> {
    let mut specs = Vec::new();
    let spec = |cell: Cell, effects: &[&str], lambda: u32, seed: u32| Spec {
        cell,
        effects: effects.iter().map(|e| (*e).to_owned()).collect(),
        lambda,
        seed,
    };
    for seed in 0..seeds {
        let levels: &[u32] = if quick { &[100] } else { &[10, 30, 70, 100, 1000] };
        for effect in SINGLES {
            for lambda in levels {
                specs.push(spec(Cell::Single, &[effect], *lambda, seed));
            }
        }
        for i in 0..if quick { 6 } else { 24 } {
            specs.push(spec(Cell::Control, &[], 0, seed * 1000 + i));
        }
        for i in 0..if quick { 4 } else { 12 } {
            // The two effects are drawn with the case.
            specs.push(spec(Cell::Pair, &[], 200, seed * 1000 + i));
        }
        for (style, truth) in [
            ("spin", "bearing_viscous_friction"),
            ("spin", "bearing_coulomb_friction"),
            ("spin", "air_drag_quadratic"),
            ("heading", "air_current"),
            ("heading", "bearing_turbine"),
            ("heading", "magnetic_torque"),
            ("heading", "thruster_leak"),
            ("jets", "thruster_strength"),
            ("jets", "thruster_delay"),
            ("wheels", "wheel_friction"),
            ("wheels", "wheel_windage"),
        ] {
            specs.push(spec(Cell::Confounded, &[style, truth], 200, seed));
        }
        for name in FOREIGN {
            specs.push(spec(Cell::Outside, &[name], 1000, seed));
        }
        for effect in CLOSED_LOOP {
            specs.push(spec(Cell::ClosedLoop, &[effect], 200, seed));
        }
        specs.push(spec(Cell::ClosedLoop, &[], 0, seed));
        for effect in ["wheel_friction", "wheel_windage"] {
            specs.push(spec(Cell::Bench, &[effect], 200, seed));
        }
        specs.push(spec(Cell::Bench, &[], 0, seed));
    }
    specs
}
