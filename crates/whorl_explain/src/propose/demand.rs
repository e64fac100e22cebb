//! Demands of a manoeuvre on tilt, wheels and gas.

use whorl_dynamics::PlatformModel;
use whorl_dynamics::platform::TiltLimit;
use whorl_recording::Recording;

/// Largest share of the wheels' speed and of the tank that a manoeuvre may use.
const WHEELS_MOST: f64 = 0.8;
const GAS_MOST: f64 = 0.2;
/// Largest share of the tilt limit that it may use.
const TILT_MOST: f64 = 0.92;
/// Largest share of the time during which a wheel may be at its torque limit.
const SATURATED_MOST: f64 = 0.02;

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
    /// Share of the time that a wheel is at its torque limit.
    pub saturated_share: f64,
    /// Share of a full tank.
    pub gas_share: f64,
}

impl ManoeuvreDemand {
    /// From a simulated run.
    #[must_use]
    pub fn of(recording: &Recording, model: &PlatformModel) -> Self {
        let (limit, pitch_only) = match model.tilt_limit {
            TiltLimit::Cone { max_rad } => (max_rad, false),
            TiltLimit::Pitch { max_rad } => (max_rad, true),
        };
        let attitudes = recording.truth.iter().flat_map(|t| &t.q_world_body.value);
        let tilt = attitudes
            .map(|q| {
                if pitch_only {
                    (q * nalgebra::Vector3::x()).z.asin().abs()
                } else {
                    (q * nalgebra::Vector3::z()).z.clamp(-1.0, 1.0).acos()
                }
            })
            .fold(0.0, f64::max);
        let rates = recording.truth.iter().flat_map(|t| &t.omega_wb_b_rad_s.value);
        let shares =
            recording.wheel_speed_rad_s.value.iter().flat_map(|speeds| {
                speeds.iter().zip(model.wheels()).map(|(s, w)| s.abs() / w.max_speed_rad_s)
            });
        let commands = &recording.wheel_torque_command_n_m.value;
        let at_limit = commands
            .iter()
            .filter(|u| u.iter().zip(model.wheels()).any(|(u, w)| u.abs() > 0.98 * w.max_torque_n_m))
            .count();
        let open_n_s: f64 = recording
            .jet_pulses
            .iter()
            .zip(model.jets())
            .map(|(pulses, jet)| pulses.iter().map(|p| p.off_s - p.on_s).sum::<f64>() * jet.thrust_n)
            .sum();
        let tank = model.tank();
        Self {
            duration_s: recording.duration_s(),
            tilt_deg: tilt.to_degrees(),
            tilt_limit_deg: limit.to_degrees(),
            rate_deg_s: rates.map(|w| w.norm()).fold(0.0, f64::max).to_degrees(),
            wheel_speed_share: shares.fold(0.0, f64::max),
            saturated_share: at_limit as f64 / commands.len().max(1) as f64,
            // As a thrust's rate of gas, so an impulse's gas.
            gas_share: tank.gas_rate_kg_s(open_n_s) / tank.initial_gas_kg().max(1e-9) + 0.0,
        }
    }

    /// The exceeded limit, if any.
    #[must_use]
    pub fn objection(&self) -> Option<String> {
        if self.tilt_deg > TILT_MOST * self.tilt_limit_deg {
            Some(format!("tilts by {:.1} deg of {:.1}", self.tilt_deg, self.tilt_limit_deg))
        } else if self.wheel_speed_share > WHEELS_MOST {
            Some(format!("brings a wheel to {:.0} % of its speed", 100.0 * self.wheel_speed_share))
        } else if self.saturated_share > SATURATED_MOST {
            Some(format!("saturates a wheel's torque for {:.0} % of the time", 100.0 * self.saturated_share))
        } else if self.gas_share > GAS_MOST {
            Some(format!("uses {:.0} % of a full tank", 100.0 * self.gas_share))
        } else {
            None
        }
    }
}
