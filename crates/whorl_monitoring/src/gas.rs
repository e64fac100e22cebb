//! Whether there is gas, as far as the tank's pressure sensor shows it.
//!
//! Nobody knows the instant at which a tank ends: within the sensor's noise of nothing there is gas for some pulses more, or for none.
//! What jets do then is no evidence, until they have used more than there can have been.

use whorl_dynamics::PlatformModel;

/// Below so many standard deviations of its sensor a tank may end before the next reading.
const LOW_STDDEVS: f64 = 6.0;
/// What the sensor's noise exceeds once in 370 readings.
const CERTAIN_STDDEVS: f64 = 3.0;

/// What is known of the gas.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) enum Gas {
    /// There is some.
    #[default]
    There,
    /// There may be so much more, at most \[kg\], or none.
    InDoubt { at_most_kg: f64 },
    /// There is none.
    Gone,
}

impl Gas {
    /// What the sensor reads \[Pa\]. Returns the pressure to go on with.
    pub fn hear(&mut self, measured_pa: f64, model: &PlatformModel) -> f64 {
        let stddev_pa = model.sensors.tank_pressure.stddev();
        if measured_pa > LOW_STDDEVS * stddev_pa {
            *self = Self::There;
        } else if *self == Self::There {
            let most_pa = (LOW_STDDEVS + CERTAIN_STDDEVS) * stddev_pa;
            *self = Self::InDoubt { at_most_kg: model.tank().gas_kg(most_pa) };
        }
        if *self == Self::Gone { 0.0 } else { measured_pa }
    }

    /// A jet is open for so long \[s\]. Returns whether it is in doubt what it does.
    pub fn fire(&mut self, jet: usize, on_time_s: f64, model: &PlatformModel) -> bool {
        let Self::InDoubt { at_most_kg } = self else { return false };
        let thrust_n = model.jets().get(jet).map_or(0.0, |jet| jet.thrust_n);
        *at_most_kg -= model.tank().gas_rate_kg_s(thrust_n) * on_time_s;
        if *at_most_kg <= 0.0 {
            *self = Self::Gone;
        }
        true
    }
}

/// Whether the sensor's noise explains the difference of a reading from what was expected \[Pa\].
pub(crate) fn is_explained(measured_pa: f64, expected_pa: f64, model: &PlatformModel) -> bool {
    (measured_pa - expected_pa).abs() <= CERTAIN_STDDEVS * model.sensors.tank_pressure.stddev()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_jets_do_is_in_doubt_until_they_have_used_more_than_there_can_have_been() {
        let model = PlatformModel::whorl_1_reference();
        let stddev_pa = model.sensors.tank_pressure.stddev();
        let mut gas = Gas::default();
        assert!(!gas.fire(0, 1.0, &model));
        assert_eq!(gas.hear(2e7, &model), 2e7);
        assert_eq!(gas, Gas::There);
        gas.hear(5.0 * stddev_pa, &model);
        let full_s =
            model.tank().gas_kg(9.0 * stddev_pa) / model.tank().gas_rate_kg_s(model.jets()[0].thrust_n);
        let mut fired_s = 0.0;
        while gas.fire(0, 0.05, &model) {
            fired_s += 0.05;
            // Noise: it says nothing new.
            gas.hear(if fired_s > 0.5 * full_s { -1.0 } else { 1.0 } * stddev_pa, &model);
        }
        assert!((fired_s - full_s).abs() < 0.1, "{fired_s} {full_s}");
        assert_eq!(gas, Gas::Gone);
        assert_eq!(gas.hear(2.0 * stddev_pa, &model), 0.0);
        // It was filled again.
        assert_eq!(gas.hear(1e7, &model), 1e7);
        assert_eq!(gas, Gas::There);
    }

    #[test]
    fn a_sensor_without_noise_shows_the_end_at_once() {
        let mut model = PlatformModel::whorl_1_reference();
        model.sensors.tank_pressure.noise_stddev = 0.0;
        let mut gas = Gas::default();
        gas.hear(1.0, &model);
        assert!(!gas.fire(0, 0.05, &model));
        gas.hear(0.0, &model);
        assert!(gas.fire(0, 0.05, &model));
        assert_eq!(gas, Gas::Gone);
    }
}
