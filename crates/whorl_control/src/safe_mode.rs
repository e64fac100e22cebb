//! Safe mode, when a platform may not point: damp the rate, then coast.
//!
//! ```text
//!            fault                    rate low for dwell_s, time used up, or no gyro
//! Nominal ----------> Damping -----------------------------------------------> Coasting
//!    ^                   ^                                                         |
//!    |                   +------------- rate above redamp, time left -------------+
//!    +------ no fault for recovery_s (from Damping and Coasting) -----------------+
//! ```
//!
//! Damping needs the rate gyro alone: `tau = -J omega / T`. The rotational energy then only falls
//! (`tau . omega < 0`; weight and gyroscopic torques do no net work on it), whatever the attitude. Its
//! total time per episode is limited so that a gyro with a large unknown bias does not spin up the
//! wheels or empty the tank.

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

/// Settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SafeModeSettings {
    /// Time constant T of the damping \[s\], > 0.
    pub damping_time_constant_s: f64,
    /// Rate below which damping ends \[rad/s\], > 0.
    pub coast_rate_rad_s: f64,
    /// Time constant of the low-pass before rates are compared with limits \[s\], >= 0: a single
    /// noisy sample decides nothing.
    pub rate_time_constant_s: f64,
    /// How long the rate must stay below \[s\], >= 0.
    pub dwell_s: f64,
    /// Rate above which coasting goes back to damping \[rad/s\], > `coast_rate_rad_s`.
    pub redamp_rate_rad_s: f64,
    /// Longest time spent damping in one episode \[s\], > 0.
    pub max_damping_s: f64,
    /// How long there must be no fault before the nominal mode returns \[s\], >= 0.
    pub recovery_s: f64,
}

/// A setting out of range.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("safe mode: {field} = {value}: must be {allowed}")]
pub struct SafeModeError {
    /// The field.
    pub field: &'static str,
    /// Its value.
    pub value: f64,
    /// What is allowed, in words.
    pub allowed: &'static str,
}

/// Where the state machine stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SafeState {
    /// No fault.
    Nominal,
    /// Damping the rate.
    Damping,
    /// Actuators off.
    Coasting,
}

/// The state machine.
#[derive(Debug, Clone, PartialEq)]
pub struct SafeMode {
    settings: SafeModeSettings,
    state: SafeState,
    /// Body rate behind its low-pass [rad/s].
    rate: Option<Vector3<f64>>,
    /// Time spent damping in this episode [s].
    damped_s: f64,
    /// Time for which the rate has been low [s].
    low_s: f64,
    /// Time without a fault [s].
    clear_s: f64,
}

impl SafeMode {
    /// Checked constructor; nominal at first.
    ///
    /// # Errors
    /// [`SafeModeError`] naming the first setting out of range.
    pub fn new(settings: SafeModeSettings) -> Result<Self, SafeModeError> {
        let s = &settings;
        for (field, value, valid, allowed) in [
            ("damping_time_constant_s", s.damping_time_constant_s, s.damping_time_constant_s > 0.0, "> 0"),
            ("coast_rate_rad_s", s.coast_rate_rad_s, s.coast_rate_rad_s > 0.0, "> 0"),
            ("rate_time_constant_s", s.rate_time_constant_s, s.rate_time_constant_s >= 0.0, ">= 0"),
            ("dwell_s", s.dwell_s, s.dwell_s >= 0.0, ">= 0"),
            (
                "redamp_rate_rad_s",
                s.redamp_rate_rad_s,
                s.redamp_rate_rad_s > s.coast_rate_rad_s,
                "> coast_rate_rad_s",
            ),
            ("max_damping_s", s.max_damping_s, s.max_damping_s > 0.0, "> 0"),
            ("recovery_s", s.recovery_s, s.recovery_s >= 0.0, ">= 0"),
        ] {
            if !(valid && value.is_finite()) {
                return Err(SafeModeError { field, value, allowed });
            }
        }
        Ok(Self { settings, state: SafeState::Nominal, rate: None, damped_s: 0.0, low_s: 0.0, clear_s: 0.0 })
    }

    /// Back to nominal, as after an episode.
    pub fn reset(&mut self) {
        self.state = SafeState::Nominal;
    }

    /// Takes over the settings of another state machine, keeping the state.
    pub fn reconfigure(&mut self, settings_of: &Self) {
        self.settings = settings_of.settings;
    }

    /// The current state.
    #[must_use]
    pub fn state(&self) -> SafeState {
        self.state
    }

    /// Moves on by `dt_s`. `gyro_rate_rad_s` is the measured body rate, `None` without a fresh sample.
    pub fn step(&mut self, dt_s: f64, fault: bool, gyro_rate_rad_s: Option<&Vector3<f64>>) -> SafeState {
        let dt_s = if dt_s > 0.0 { dt_s } else { 0.0 };
        if self.state == SafeState::Nominal {
            self.rate = None;
        }
        let rate = self.filtered_rate(dt_s, gyro_rate_rad_s);
        if self.state == SafeState::Nominal {
            if fault {
                self.damped_s = 0.0;
                self.low_s = 0.0;
                self.clear_s = 0.0;
                self.state = if rate.is_some() { SafeState::Damping } else { SafeState::Coasting };
            }
            return self.state;
        }
        self.clear_s = if fault { 0.0 } else { self.clear_s + dt_s };
        if !fault && self.clear_s >= self.settings.recovery_s {
            self.state = SafeState::Nominal;
            return self.state;
        }
        let time_left = self.damped_s < self.settings.max_damping_s;
        match (self.state, rate) {
            (SafeState::Damping, Some(rate)) => {
                self.damped_s += dt_s;
                self.low_s = if rate < self.settings.coast_rate_rad_s { self.low_s + dt_s } else { 0.0 };
                let done = rate < self.settings.coast_rate_rad_s && self.low_s >= self.settings.dwell_s;
                if done || !time_left {
                    self.state = SafeState::Coasting;
                }
            }
            (SafeState::Damping, None) => self.state = SafeState::Coasting,
            (SafeState::Coasting, Some(rate)) if rate > self.settings.redamp_rate_rad_s && time_left => {
                self.low_s = 0.0;
                self.state = SafeState::Damping;
            }
            _ => {}
        }
        self.state
    }

    fn filtered_rate(&mut self, dt_s: f64, sample_rad_s: Option<&Vector3<f64>>) -> Option<f64> {
        let sample = sample_rad_s.filter(|omega| omega.iter().all(|x| x.is_finite()))?;
        let time_constant_s = self.settings.rate_time_constant_s;
        let filtered = match self.rate {
            Some(rate) if time_constant_s > 0.0 => {
                rate + (sample - rate) * (1.0 - (-dt_s / time_constant_s).exp())
            }
            _ => *sample,
        };
        self.rate = Some(filtered);
        Some(filtered.norm())
    }

    /// The damping torque, body axes \[N m\], for the inertia that resists \[kg m^2\].
    #[must_use]
    pub fn damping_torque_b_n_m(
        &self,
        resisting_inertia_b_kg_m2: &Matrix3<f64>,
        omega_wb_b_rad_s: &Vector3<f64>,
    ) -> Vector3<f64> {
        -(resisting_inertia_b_kg_m2 * omega_wb_b_rad_s) / self.settings.damping_time_constant_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings() -> SafeModeSettings {
        SafeModeSettings {
            damping_time_constant_s: 2.0,
            coast_rate_rad_s: 0.01,
            rate_time_constant_s: 0.0,
            dwell_s: 0.5,
            redamp_rate_rad_s: 0.05,
            max_damping_s: 30.0,
            recovery_s: 1.0,
        }
    }

    const DT_S: f64 = 0.1;

    struct Bench(SafeMode);

    impl Bench {
        fn new() -> Self {
            Self(SafeMode::new(settings()).unwrap())
        }

        fn run(&mut self, duration_s: f64, fault: bool, rate: Option<f64>) -> SafeState {
            let rate = rate.map(|r| Vector3::x() * r);
            for _ in 0..(duration_s / DT_S).round() as usize {
                self.0.step(DT_S, fault, rate.as_ref());
            }
            self.0.state()
        }
    }

    #[test]
    fn stays_nominal_without_a_fault_whatever_the_gyro_says() {
        assert_eq!(Bench::new().run(10.0, false, None), SafeState::Nominal);
    }

    #[test]
    fn damps_then_coasts_then_recovers() {
        let mut bench = Bench::new();
        assert_eq!(bench.run(0.1, true, Some(0.2)), SafeState::Damping);
        assert_eq!(bench.run(5.0, true, Some(0.02)), SafeState::Damping);
        assert_eq!(bench.run(0.4, true, Some(0.005)), SafeState::Damping, "dwell not over");
        assert_eq!(bench.run(0.2, true, Some(0.005)), SafeState::Coasting);
        assert_eq!(bench.run(5.0, true, Some(0.03)), SafeState::Coasting, "inside the hysteresis");
        assert_eq!(bench.run(0.8, false, Some(0.03)), SafeState::Coasting, "not clear for long enough");
        assert_eq!(bench.run(0.3, false, Some(0.03)), SafeState::Nominal);
    }

    #[test]
    fn recovers_straight_from_damping() {
        let mut bench = Bench::new();
        bench.run(0.5, true, Some(0.2));
        assert_eq!(bench.run(1.2, false, Some(0.2)), SafeState::Nominal);
    }

    #[test]
    fn a_flickering_fault_does_not_recover() {
        let mut bench = Bench::new();
        for _ in 0..20 {
            bench.run(0.1, true, Some(0.2));
            assert_ne!(bench.run(0.8, false, Some(0.2)), SafeState::Nominal);
        }
    }

    #[test]
    fn without_a_gyro_it_coasts_at_once() {
        let mut bench = Bench::new();
        assert_eq!(bench.run(0.1, true, None), SafeState::Coasting);
        let mut bench = Bench::new();
        bench.run(0.5, true, Some(0.2));
        assert_eq!(bench.run(0.1, true, None), SafeState::Coasting);
        assert_eq!(bench.run(0.1, true, Some(f64::NAN)), SafeState::Coasting);
        assert_eq!(bench.run(0.1, true, Some(0.2)), SafeState::Damping, "the gyro is back");
    }

    #[test]
    fn damping_time_is_limited_per_episode() {
        let mut bench = Bench::new();
        bench.run(29.0, true, Some(0.2));
        assert_eq!(bench.0.state(), SafeState::Damping);
        assert_eq!(bench.run(2.0, true, Some(0.2)), SafeState::Coasting);
        assert_eq!(bench.run(60.0, true, Some(0.9)), SafeState::Coasting, "no time left");
        bench.run(2.0, false, Some(0.0));
        assert_eq!(bench.run(0.1, true, Some(0.2)), SafeState::Damping, "a new episode");
    }

    #[test]
    fn noise_does_not_keep_it_from_coasting() {
        let noisy = SafeModeSettings { rate_time_constant_s: 0.5, ..settings() };
        let mut safe = SafeMode::new(noisy).unwrap();
        // Twice the limit in alternate directions: no motion at all on average.
        for k in 0..100 {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            safe.step(0.01, true, Some(&(Vector3::y() * (0.02 * sign))));
        }
        assert_eq!(safe.state(), SafeState::Coasting);
    }

    #[test]
    fn damping_takes_energy_out_in_every_direction() {
        let safe = SafeMode::new(settings()).unwrap();
        let inertia = Matrix3::new(6.2, -0.9, -0.2, -0.9, 7.5, 0.1, -0.2, 0.1, 12.1);
        for omega in [Vector3::x(), Vector3::new(-0.3, 0.2, 0.9), Vector3::new(0.0, -1.0, 0.1)] {
            assert!(safe.damping_torque_b_n_m(&inertia, &omega).dot(&omega) < 0.0);
        }
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        let refused = |s: SafeModeSettings| SafeMode::new(s).unwrap_err().field;
        assert_eq!(refused(SafeModeSettings { redamp_rate_rad_s: 0.005, ..settings() }), "redamp_rate_rad_s");
        assert_eq!(refused(SafeModeSettings { dwell_s: f64::NAN, ..settings() }), "dwell_s");
        assert_eq!(refused(SafeModeSettings { max_damping_s: 0.0, ..settings() }), "max_damping_s");
    }
}
