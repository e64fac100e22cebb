//! What a manoeuvre takes of a platform.

use whorl_dynamics::PlatformModel;
use whorl_math::{deg_from_rad, vertical_b};
use whorl_recording::Recording;

use super::family::tilt_rad;

/// Largest shares of the tilt limit, of the wheels' speed and of the tank that a manoeuvre may use.
const TILT_MOST: f64 = 0.92;
const WHEELS_MOST: f64 = 0.8;
const GAS_MOST: f64 = 0.2;

/// Demands of a manoeuvre.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct ManoeuvreDemand {
    /// Length \[s\].
    pub duration_s: f64,
    /// Largest tilt that counts against the platform's limit \[deg\].
    pub tilt_deg: f64,
    /// The limit \[deg\].
    pub tilt_limit_deg: f64,
    /// Fastest rate [deg/s].
    pub rate_deg_s: f64,
    /// Largest share of a wheel's speed limit.
    pub wheel_speed_share: f64,
    /// Share of a full tank.
    pub gas_share: f64,
}

impl ManoeuvreDemand {
    /// From a simulated run.
    #[must_use]
    pub fn of(recording: &Recording, model: &PlatformModel) -> Self {
        let largest = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
        let truth = recording.truth.iter();
        let attitudes = truth.clone().flat_map(|truth| &truth.q_world_body.value);
        let rates = truth.flat_map(|truth| &truth.omega_wb_b_rad_s.value);
        let speeds = recording.wheel_speed_rad_s.value.iter();
        let shares = speeds
            .flat_map(|speeds| speeds.iter().zip(model.wheels()).map(|(s, w)| s.abs() / w.max_speed_rad_s));
        let pulses = recording.jet_pulses.iter().zip(model.jets());
        let impulse_n_s: f64 = pulses
            .map(|(pulses, jet)| pulses.iter().map(|p| p.off_s - p.on_s).sum::<f64>() * jet.thrust_n)
            .sum();
        let (tank, limit) = (model.tank(), model.tilt_limit);
        Self {
            duration_s: recording.duration_s(),
            tilt_deg: deg_from_rad(largest(&mut attitudes.map(|q| tilt_rad(limit, &vertical_b(q))))),
            tilt_limit_deg: deg_from_rad(limit.max_rad()),
            rate_deg_s: deg_from_rad(largest(&mut rates.map(|w| w.norm()))),
            wheel_speed_share: largest(&mut { shares }),
            // As a thrust's rate of gas, so an impulse's gas.
            gas_share: tank.gas_rate_kg_s(impulse_n_s) / tank.initial_gas_kg().max(1e-9) + 0.0,
        }
    }

    /// The exceeded limit, if any.
    #[must_use]
    pub fn objection(&self) -> Option<String> {
        if self.tilt_deg > TILT_MOST * self.tilt_limit_deg {
            Some(format!("tilts by {:.1} deg of {:.1}", self.tilt_deg, self.tilt_limit_deg))
        } else if self.wheel_speed_share > WHEELS_MOST {
            Some(format!("brings a wheel to {:.0} % of its speed", 100.0 * self.wheel_speed_share))
        } else {
            (self.gas_share > GAS_MOST)
                .then(|| format!("uses {:.0} % of a full tank", 100.0 * self.gas_share))
        }
    }
}
