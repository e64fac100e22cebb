//! Gains of a damped, saturated motion towards a goal, which several laws plan: their settings and proven ranges.

use super::{Allowed, LawError, Roster, Settings};

/// Gains and limits of the motion. `virtual_structure.rs` has its equations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PlanGains {
    /// Natural frequency \[rad/s\], > 0.
    pub bandwidth_rad_s: f64,
    /// Damping ratio, >= 1.
    pub damping: f64,
    /// Largest rate \[rad/s\], > 0.
    pub rate_max_rad_s: f64,
    /// Largest acceleration \[rad/s^2\], >= `bandwidth * rate_max / 2.718`.
    pub acceleration_max_rad_s2: f64,
}

impl PlanGains {
    /// Reads the user's settings. `moving` is what moves: "structure".
    pub fn read(settings: &mut dyn Settings, roster: &Roster<'_>, moving: &str, damping_doc: &str) -> Self {
        let (rate_max_rad_s, acceleration_max_rad_s2) = settings.motion_limits(roster);
        Self {
            bandwidth_rad_s: settings.number_or(
                "bandwidth_rad_s",
                0.3,
                Allowed::POSITIVE,
                &format!(
                    "natural frequency of the {moving} towards its goal; at most 2.718 acceleration / rate [rad/s]"
                ),
            ),
            damping: settings.damping(damping_doc),
            rate_max_rad_s,
            acceleration_max_rad_s2,
        }
    }

    /// The first gain outside its range, with the bound.
    pub fn check(&self, law: &'static str) -> Result<(), LawError> {
        for (gain, value) in [
            ("bandwidth_rad_s", self.bandwidth_rad_s),
            ("rate_max_rad_s", self.rate_max_rad_s),
            ("acceleration_max_rad_s2", self.acceleration_max_rad_s2),
        ] {
            require_positive(law, gain, value)?;
        }
        if !(self.damping >= 1.0 && self.damping.is_finite()) {
            let allowed = "at least 1: less overshoots".to_owned();
            return Err(LawError::Gain { law, gain: "damping", value: self.damping, allowed });
        }
        let fastest = std::f64::consts::E * self.acceleration_max_rad_s2 / self.rate_max_rad_s;
        if self.bandwidth_rad_s > fastest {
            let allowed = format!(
                "at most {fastest:.3}, 2.718 acceleration_max / rate_max: it could not brake in time"
            );
            return Err(LawError::Gain {
                law,
                gain: "bandwidth_rad_s",
                value: self.bandwidth_rad_s,
                allowed,
            });
        }
        Ok(())
    }
}

/// Refuses a gain that is not positive and finite.
pub(super) fn require_positive(law: &'static str, gain: &'static str, value: f64) -> Result<(), LawError> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(LawError::Gain { law, gain, value, allowed: "positive and finite".to_owned() })
}
