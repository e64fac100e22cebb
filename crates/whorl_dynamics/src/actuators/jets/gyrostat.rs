//! Jets and gas in the model.

use nalgebra::Vector3;

use crate::{Environment, Gyrostat};

impl Environment<'_> {
    /// Force of the jets that are open now, at the current tank pressure, body axes \[N\].
    #[must_use]
    pub fn jet_force_b_n(&self) -> Vector3<f64> {
        let mut force = Vector3::zeros();
        for (jet, fraction) in self.model.jets().iter().zip(self.valve_fraction) {
            if *fraction != 0.0 {
                force += jet.force_direction_b.into_inner() * (jet.thrust_n * *fraction);
            }
        }
        force * self.model.tank().thrust_factor(self.pressure_ratio())
    }
}

impl Gyrostat {
    /// Torque of the jets that are open now, at the current tank pressure and as effects scale it, body axes [N m].
    #[must_use]
    pub fn jet_torque_b_n_m(&self, environment: &Environment<'_>) -> Vector3<f64> {
        let mut torque = Vector3::zeros();
        for (jet, fraction) in self.model().jets().iter().zip(environment.valve_fraction) {
            if *fraction != 0.0 {
                torque += jet.torque_b_n_m() * *fraction;
            }
        }
        torque * self.jet_factor(environment)
    }

    /// What the torque of every open jet is multiplied by now: the tank's pressure, and effects.
    #[must_use]
    pub fn jet_factor(&self, environment: &Environment<'_>) -> f64 {
        self.thrust_factor(environment.pressure_ratio()) * self.effects().thrust_factor(environment)
    }

    /// Thrust over nominal thrust at this pressure over reference pressure.
    #[must_use]
    pub fn thrust_factor(&self, pressure_ratio: f64) -> f64 {
        self.model().tank().thrust_factor(pressure_ratio)
    }

    /// Gas in the full tank \[kg\].
    #[must_use]
    pub fn initial_gas_kg(&self) -> f64 {
        self.model().tank().initial_gas_kg()
    }

    /// Pressure of this much gas in the tank \[Pa\], isothermal.
    #[must_use]
    pub fn pressure_pa(&self, gas_kg: f64) -> f64 {
        self.model().tank().pressure_pa(gas_kg)
    }

    /// Gas used per second by this much thrust [kg/s].
    #[must_use]
    pub fn gas_rate_kg_s(&self, thrust_n: f64) -> f64 {
        self.model().tank().gas_rate_kg_s(thrust_n)
    }
}
