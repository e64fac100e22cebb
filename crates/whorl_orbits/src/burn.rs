//! A burn of a spacecraft: thrust, mass and gas.

/// Standard gravity, of which the specific impulse is a multiple [m/s^2].
pub const STANDARD_GRAVITY_M_S2: f64 = 9.80665;

/// A burn that gives the wanted velocity change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Burn {
    /// When it begins, after the epoch \[s\], at least 0.
    pub start_s: f64,
    /// Thrust \[N\], > 0.
    pub thrust_n: f64,
    /// Mass of the spacecraft at its start \[kg\], > 0.
    pub mass_kg: f64,
    /// Specific impulse \[s\], > 0.
    pub specific_impulse_s: f64,
}

impl Burn {
    pub(crate) fn gas_rate_kg_s(&self) -> f64 {
        self.thrust_n / (STANDARD_GRAVITY_M_S2 * self.specific_impulse_s)
    }

    /// Gas that a velocity change takes \[kg\].
    #[must_use]
    pub fn gas_kg(&self, delta_v_m_s: f64) -> f64 {
        -self.mass_kg * (-delta_v_m_s / (STANDARD_GRAVITY_M_S2 * self.specific_impulse_s)).exp_m1()
    }

    /// How long it takes \[s\].
    #[must_use]
    pub fn duration_s(&self, delta_v_m_s: f64) -> f64 {
        self.gas_kg(delta_v_m_s) / self.gas_rate_kg_s()
    }

    pub(crate) fn acceleration_m_s2(&self, since_s: f64) -> f64 {
        self.thrust_n / (self.mass_kg - self.gas_rate_kg_s() * since_s)
    }
}
