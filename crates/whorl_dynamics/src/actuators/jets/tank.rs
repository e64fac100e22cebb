//! The gas supply.

use whorl_math::GRAVITY_M_S2;

use super::super::{ActuatorError, Allowed, Field, kind::check_positive};

/// Specific gas constant of nitrogen.
const NITROGEN_J_KG_K: f64 = 296.8;
/// A tank with less pressure gives no thrust: it is a hundred thousandth of the air outside.
const EMPTY_PA: f64 = 1.0;
/// 20 degC.
const ROOM_K: f64 = 293.15;

/// The gas supply: an isothermal tank that blows down through a regulator-free line, thrust
/// proportional to (pressure / reference pressure).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tank {
    /// Volume [m^3], > 0.
    pub volume_m3: f64,
    /// Pressure at the start of a run \[Pa\], > 0.
    pub initial_pressure_pa: f64,
    /// Pressure at which jets give their nominal thrust \[Pa\], > 0.
    pub reference_pressure_pa: f64,
    /// Exponent of thrust over pressure: 0 = a perfect regulator, 1 = plain blow-down.
    pub thrust_pressure_exponent: f64,
    /// Gas temperature \[K\], > 0.
    pub temperature_k: f64,
    /// Specific gas constant [J/(kg K)] (nitrogen: 296.8), > 0.
    pub gas_constant_j_kg_k: f64,
    /// Specific impulse \[s\], > 0: gas rate of a jet = thrust / (g0 Isp).
    pub specific_impulse_s: f64,
}

impl Default for Tank {
    /// A supply that neither falls nor runs out.
    fn default() -> Self {
        Self {
            volume_m3: 1.0e3,
            initial_pressure_pa: 1.0e6,
            reference_pressure_pa: 1.0e6,
            thrust_pressure_exponent: 0.0,
            temperature_k: ROOM_K,
            gas_constant_j_kg_k: NITROGEN_J_KG_K,
            specific_impulse_s: 60.0,
        }
    }
}

impl Tank {
    /// Gas in the full tank \[kg\].
    #[must_use]
    pub fn initial_gas_kg(&self) -> f64 {
        self.gas_kg(self.initial_pressure_pa)
    }

    /// Gas at this pressure \[kg\], isothermal.
    #[must_use]
    pub fn gas_kg(&self, pressure_pa: f64) -> f64 {
        pressure_pa * self.volume_m3 / (self.gas_constant_j_kg_k * self.temperature_k)
    }

    /// Pressure of this much gas \[Pa\], isothermal.
    #[must_use]
    #[inline]
    pub fn pressure_pa(&self, gas_kg: f64) -> f64 {
        gas_kg * self.gas_constant_j_kg_k * self.temperature_k / self.volume_m3
    }

    /// Thrust over nominal thrust at this pressure over reference pressure.
    #[must_use]
    #[inline]
    pub fn thrust_factor(&self, pressure_ratio: f64) -> f64 {
        let exponent = self.thrust_pressure_exponent;
        if pressure_ratio * self.reference_pressure_pa < EMPTY_PA {
            0.0
        } else if exponent == 0.0 {
            1.0
        } else if exponent == 1.0 {
            pressure_ratio
        } else {
            pressure_ratio.powf(exponent)
        }
    }

    /// Gas used per second by this much thrust [kg/s].
    #[must_use]
    #[inline]
    pub fn gas_rate_kg_s(&self, thrust_n: f64) -> f64 {
        thrust_n / (GRAVITY_M_S2 * self.specific_impulse_s)
    }

    pub(super) fn fields(&mut self) -> Vec<Field<'_>> {
        use Allowed::{Between, Positive};
        vec![
            Field::number("volume_m3", "volume of the tank", "m^3", Positive, &mut self.volume_m3),
            Field::number(
                "initial_pressure_pa",
                "pressure at the start of a run",
                "Pa",
                Positive,
                &mut self.initial_pressure_pa,
            ),
            Field::number(
                "reference_pressure_pa",
                "tank pressure at which jets give their nominal thrust",
                "Pa",
                Positive,
                &mut self.reference_pressure_pa,
            ),
            Field::number(
                "thrust_pressure_exponent",
                "exponent of thrust over tank pressure: 0 = perfect regulator, 1 = plain blow-down",
                "1",
                Between(0.0, 2.0),
                &mut self.thrust_pressure_exponent,
            ),
            Field::number("temperature_k", "gas temperature", "K", Positive, &mut self.temperature_k)
                .or(ROOM_K),
            Field::number(
                "gas_constant_j_kg_k",
                "specific gas constant",
                "J/(kg K)",
                Positive,
                &mut self.gas_constant_j_kg_k,
            )
            .or(NITROGEN_J_KG_K),
            Field::number(
                "specific_impulse_s",
                "specific impulse of the jets",
                "s",
                Positive,
                &mut self.specific_impulse_s,
            ),
        ]
    }

    pub(super) fn check(&self) -> Result<(), ActuatorError> {
        check_positive([
            (self.volume_m3, "the tank's volume"),
            (self.initial_pressure_pa, "the tank's initial pressure"),
            (self.reference_pressure_pa, "the tank's reference pressure"),
            (self.temperature_k, "the tank's temperature"),
            (self.gas_constant_j_kg_k, "the gas constant"),
            (self.specific_impulse_s, "the specific impulse"),
        ])
    }
}
