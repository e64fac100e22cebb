//! What must be right before a platform of devices may move, in words: what its sensors say, against its model.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_dynamics::platform::TiltLimit;
use whorl_params::{Reader, non_negative};

/// Means are over this.
const WINDOW: Duration = Duration::from_secs(1);
/// Samples that a mean needs, and that are kept.
const FEWEST: usize = 20;
const MOST: usize = 4000;
/// Rate of the samples against the model's.
const RATE_TOLERANCE: f64 = 0.2;
/// A platform that is let go turns slower \[rad/s\]; so does a gyro's bias.
const FASTEST_RAD_S: f64 = 0.15;
const GRAVITY_M_S2: f64 = 9.81;
/// Of the specific force at rest.
const FORCE_TOLERANCE: f64 = 0.1;
/// Beyond a stop: bias of the accelerometer, mounting \[rad\].
const TILT_MARGIN_RAD: f64 = 0.05;
/// Shares of what the model begins with, where no limit is given.
const VOLTAGE_SHARE: f64 = 0.8;
const PRESSURE_SHARE: f64 = 0.05;

/// Least supplies, from the parameter file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Supplies {
    /// Bus voltage \[V\].
    pub bus_voltage_min_v: f64,
    /// Tank pressure \[Pa\].
    pub tank_pressure_min_pa: f64,
}

impl Supplies {
    /// Reads the group `prearm`.
    pub fn read(r: &mut Reader<'_>, model: &PlatformModel) -> Self {
        r.group("prearm", |r| Self {
            bus_voltage_min_v: r
                .optional_f64(
                    "bus_voltage_min_v",
                    non_negative(),
                    "a platform of devices is not armed below this bus voltage [V]; left out: 80 % of model.bus.initial_v",
                )
                .unwrap_or(model.bus.initial_v * VOLTAGE_SHARE),
            tank_pressure_min_pa: r
                .optional_f64(
                    "tank_pressure_min_pa",
                    non_negative(),
                    "a platform of devices is not armed below this tank pressure [Pa]; left out: 5 % of \
                     model.tank.initial_pressure_pa",
                )
                .unwrap_or(model.tank().initial_pressure_pa * PRESSURE_SHARE),
        })
    }
}

/// What the sensors have said lately.
#[derive(Debug, Clone, Default)]
pub struct PreArm {
    samples: VecDeque<(Instant, Vector3<f64>, Vector3<f64>)>,
    bus_voltage_v: Option<f64>,
    tank_pressure_pa: Option<f64>,
}

impl PreArm {
    /// Angular rate and specific force, body axes [rad/s], [m/s^2].
    pub fn sampled(&mut self, at: Instant, rate_b_rad_s: Vector3<f64>, specific_force_b_m_s2: Vector3<f64>) {
        self.samples.push_back((at, rate_b_rad_s, specific_force_b_m_s2));
        while self.samples.len() > MOST
            || self.samples.front().is_some_and(|(then, ..)| at.saturating_duration_since(*then) > WINDOW)
        {
            self.samples.pop_front();
        }
    }

    /// Voltage of the power bus \[V\].
    pub fn bus_voltage(&mut self, volt: f64) {
        self.bus_voltage_v = Some(volt);
    }

    /// Pressure in the tank \[Pa\].
    pub fn tank_pressure(&mut self, pascal: f64) {
        self.tank_pressure_pa = Some(pascal);
    }

    /// Why the platform should not be let go, a sentence each, with what to do. What is not measured hinders nobody.
    #[must_use]
    pub fn hindrances(&self, model: &PlatformModel, supplies: &Supplies) -> Vec<String> {
        let mut found = Vec::new();
        if self.samples.len() >= FEWEST {
            let count = self.samples.len() as f64;
            let rate = self.samples.iter().map(|sample| sample.1).sum::<Vector3<f64>>() / count;
            let force = self.samples.iter().map(|sample| sample.2).sum::<Vector3<f64>>() / count;
            found.extend(self.rate_of_samples(model));
            found.extend(turning(rate));
            if model.sensors.accelerometer.shows_vertical() {
                found.extend(tilted(force, model));
            }
        }
        if let Some(volt) = self.bus_voltage_v.filter(|volt| *volt < supplies.bus_voltage_min_v) {
            found.push(format!(
                "bus voltage {volt:.1} V, at least {:.1} V needed (prearm.bus_voltage_min_v): charge the battery",
                supplies.bus_voltage_min_v
            ));
        }
        let pressure = self.tank_pressure_pa.filter(|_| !model.jets().is_empty());
        if let Some(pascal) = pressure.filter(|pascal| *pascal < supplies.tank_pressure_min_pa) {
            found.push(format!(
                "tank pressure {:.2} MPa, at least {:.2} MPa needed (prearm.tank_pressure_min_pa): is the gas on?",
                pascal * 1e-6,
                supplies.tank_pressure_min_pa * 1e-6
            ));
        }
        found
    }

    fn rate_of_samples(&self, model: &PlatformModel) -> Option<String> {
        let span = self.samples.back()?.0.saturating_duration_since(self.samples.front()?.0).as_secs_f64();
        let (measured, wanted) = ((self.samples.len() - 1) as f64 / span, model.sensors.rate_hz);
        // A mean over a part of a second is not judged: the first samples come together.
        if span < 0.5 * WINDOW.as_secs_f64() || (measured / wanted - 1.0).abs() < RATE_TOLERANCE {
            return None;
        }
        Some(format!(
            "the inertial sensor gives {measured:.0} samples a second, and model.sensors.rate_hz is {wanted:.0}: make them the same"
        ))
    }
}

fn turning(rate_b_rad_s: Vector3<f64>) -> Option<String> {
    // Axes without a gyro are NaN.
    let rate = rate_b_rad_s.map(|x| if x.is_finite() { x } else { 0.0 }).norm();
    (rate > FASTEST_RAD_S).then(|| {
        format!(
            "the gyro says {:.1} deg/s, at most {:.1} deg/s allowed: bring the platform to rest; if it is at rest, that is the gyro's \
             bias or its unit",
            rate.to_degrees(),
            FASTEST_RAD_S.to_degrees()
        )
    })
}

fn tilted(force_b_m_s2: Vector3<f64>, model: &PlatformModel) -> Option<String> {
    let size = force_b_m_s2.norm();
    let off = (size / GRAVITY_M_S2 - 1.0).abs();
    if off.is_nan() || off >= FORCE_TOLERANCE {
        return Some(format!(
            "the accelerometer says {size:.2} m/s^2 in all, at rest it must be {GRAVITY_M_S2} m/s^2: is it in m/s^2, with gravity?"
        ));
    }
    let up_b = force_b_m_s2 / size;
    let (tilt_rad, max_rad) = match model.tilt_limit {
        TiltLimit::Cone { max_rad } => (up_b.z.clamp(-1.0, 1.0).acos(), max_rad),
        TiltLimit::Pitch { max_rad } => (up_b.x.clamp(-1.0, 1.0).asin().abs(), max_rad),
    };
    (tilt_rad > max_rad + TILT_MARGIN_RAD).then(|| {
        format!(
            "tilted by {:.1} deg, and its stop is at {:.1} deg (model.tilt_limit): is the sensor mounted as mounting_deg says?",
            tilt_rad.to_degrees(),
            max_rad.to_degrees()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const WELL: Supplies = Supplies { bus_voltage_min_v: 20.0, tank_pressure_min_pa: 1e6 };

    /// What is said of a second of the same sample, so many times.
    fn said(count: u32, rate: [f64; 3], force: [f64; 3]) -> Vec<String> {
        let (mut prearm, begin) = (PreArm::default(), Instant::now());
        for k in 0..=count {
            let at = begin + Duration::from_secs_f64(f64::from(k) / f64::from(count));
            prearm.sampled(at, rate.into(), force.into());
        }
        prearm.hindrances(&PlatformModel::whorl_1_reference(), &WELL)
    }

    #[test]
    fn a_platform_at_rest_is_let_go() {
        assert_eq!(said(100, [0.01, 0.0, -0.02], [0.3, -0.2, 9.8]), [""; 0]);
        // Nothing is known yet.
        assert_eq!(PreArm::default().hindrances(&PlatformModel::whorl_1_reference(), &WELL), [""; 0]);
    }

    #[test]
    fn each_hindrance_names_size_limit_and_remedy() {
        for (count, rate, force, words) in [
            (200, [0.0; 3], [0.0, 0.0, 9.81], ["200 samples a second", "model.sensors.rate_hz is 100"]),
            // 0.3 rad/s.
            (100, [0.0, 0.0, 0.3], [0.0, 0.0, 9.81], ["17.2 deg/s", "at most 8.6 deg/s"]),
            (100, [0.0; 3], [0.0, 0.0, 1.0], ["1.00 m/s^2", "9.81 m/s^2"]),
            (100, [0.0; 3], [0.0, 0.0, 0.0], ["0.00 m/s^2", "with gravity"]),
            // Upside down.
            (100, [0.0; 3], [0.0, 0.0, -9.81], ["tilted by 180.0 deg", "stop is at 5.0 deg"]),
            // atan(2 / 9.6) = 11.8 deg.
            (100, [0.0; 3], [2.0, 0.0, 9.6], ["tilted by 11.8 deg", "mounting_deg"]),
        ] {
            let all = said(count, rate, force);
            assert_eq!(all.len(), 1, "{all:?}");
            assert!(words.iter().all(|word| all[0].contains(word)), "{all:?}");
        }
    }

    #[test]
    fn supplies_are_needed_once_they_are_measured() {
        let model = PlatformModel::whorl_1_reference();
        let mut prearm = PreArm::default();
        prearm.bus_voltage(19.6);
        prearm.tank_pressure(0.4e6);
        let all = prearm.hindrances(&model, &WELL);
        assert!(all[0].contains("19.6 V") && all[0].contains("20.0 V"), "{all:?}");
        assert!(all[1].contains("0.40 MPa") && all[1].contains("1.00 MPa"), "{all:?}");
        prearm.bus_voltage(20.1);
        prearm.tank_pressure(1.1e6);
        assert_eq!(prearm.hindrances(&model, &WELL), [""; 0]);
    }
}
