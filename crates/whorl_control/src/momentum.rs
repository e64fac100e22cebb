//! Keeping the wheels' momentum near its target with the jets.
//!
//! Wheels only store momentum. A constant torque on the body drives one of them to its speed limit;
//! then it can give no more torque in that direction. The jets can take the momentum out: a wheel
//! torque `u_j = -(h_j - h_target,j)/T` is desired, and the allocation lets the jets balance it on
//! the body. Because every pulse of a jet disturbs the pointing and costs gas, unloading starts
//! only when a wheel has strayed far from its target and ends when all are close (hysteresis).
//!
//! Source: M. J. Sidi, *Spacecraft Dynamics and Control*, Cambridge 1997, section 7.3 (wheel momentum
//! unloading with reaction jets).

use thiserror::Error;
use whorl_dynamics::platform::Wheel;

/// Settings of the unloading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnloadingSettings {
    /// Distance from the target, as a share of a wheel's largest momentum, at which unloading
    /// starts; 0 < release < engage <= 1.
    pub engage_share: f64,
    /// Share below which every wheel must be for unloading to end.
    pub release_share: f64,
    /// Time constant of the decay of the momentum \[s\], > 0.
    pub time_constant_s: f64,
}

/// Why settings were refused.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum UnloadingError {
    /// The shares are not in order.
    #[error("unloading needs 0 < release_share < engage_share <= 1, got {release_share} and {engage_share}")]
    Shares {
        /// The share at which unloading ends.
        release_share: f64,
        /// The share at which it starts.
        engage_share: f64,
    },
    /// The time constant is not positive and finite.
    #[error("unloading time constant of {0} s must be finite and > 0")]
    TimeConstant(f64),
}

/// Decides when to unload and what torque each wheel should get for it.
#[derive(Debug, Clone, PartialEq)]
pub struct MomentumUnloading {
    settings: UnloadingSettings,
    active: bool,
}

impl MomentumUnloading {
    /// Checked constructor; inactive at first.
    ///
    /// # Errors
    /// [`UnloadingError`] naming what is out of range.
    pub fn new(settings: UnloadingSettings) -> Result<Self, UnloadingError> {
        let UnloadingSettings { engage_share, release_share, time_constant_s } = settings;
        if !(release_share > 0.0 && release_share < engage_share && engage_share <= 1.0) {
            return Err(UnloadingError::Shares { release_share, engage_share });
        }
        if !(time_constant_s > 0.0 && time_constant_s.is_finite()) {
            return Err(UnloadingError::TimeConstant(time_constant_s));
        }
        Ok(Self { settings, active: false })
    }

    /// Whether unloading is under way.
    #[must_use]
    pub fn active(&self) -> bool {
        self.active
    }

    /// Stops unloading, e.g. when jets may not be used.
    pub fn stop(&mut self) {
        self.active = false;
    }

    /// Updates the decision and writes the motor torque \[N m\] that unloading desires of each wheel:
    /// zero while inactive, never beyond the motor's limit. Slices in the order of `wheels`; speeds
    /// relative to the body \[rad/s\]. Missing or non-finite speeds count as on target.
    pub fn update(
        &mut self,
        wheels: &[Wheel],
        speed_rad_s: &[f64],
        target_rad_s: &[f64],
        desired_torque_n_m: &mut [f64],
    ) -> bool {
        let stray = |j: usize| {
            let (speed, target) = (speed_rad_s.get(j), target_rad_s.get(j).copied().unwrap_or(0.0));
            speed.map(|s| s - target).filter(|x| x.is_finite()).unwrap_or(0.0)
        };
        let largest_share = wheels
            .iter()
            .enumerate()
            .map(|(j, wheel)| stray(j).abs() / wheel.max_speed_rad_s)
            .fold(0.0, f64::max);
        self.active = if self.active {
            largest_share > self.settings.release_share
        } else {
            largest_share > self.settings.engage_share
        };
        for ((j, wheel), desired) in wheels.iter().enumerate().zip(desired_torque_n_m) {
            *desired = if self.active {
                let torque = -wheel.spin_inertia_kg_m2 * stray(j) / self.settings.time_constant_s;
                torque.clamp(-wheel.max_torque_n_m, wheel.max_torque_n_m)
            } else {
                0.0
            };
        }
        self.active
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn wheels() -> Vec<Wheel> {
        [Vector3::x_axis(), Vector3::y_axis()]
            .map(|spin_axis_b| Wheel {
                name: String::new(),
                spin_axis_b,
                spin_inertia_kg_m2: 0.1,
                max_torque_n_m: 0.5,
                max_speed_rad_s: 200.0,
                viscous_friction_n_m_s: 0.0,
                coulomb_friction_n_m: 0.0,
            })
            .into()
    }

    fn settings() -> UnloadingSettings {
        UnloadingSettings { engage_share: 0.6, release_share: 0.1, time_constant_s: 20.0 }
    }

    #[test]
    fn starts_far_from_the_target_and_ends_close_to_it() {
        let mut unloading = MomentumUnloading::new(settings()).unwrap();
        let mut desired = [0.0; 2];
        let target = [50.0, 0.0];
        let mut at = |speed: [f64; 2]| {
            let active = unloading.update(&wheels(), &speed, &target, &mut desired);
            (active, desired)
        };
        assert_eq!(at([160.0, 0.0]), (false, [0.0, 0.0]), "110 of 200 rad/s away: not yet");
        let (active, torque) = at([180.0, -10.0]);
        assert!(active);
        // -0.1 kg m^2 * 130 rad/s / 20 s would be -0.65 N m: the motor's limit; the other +0.05.
        assert_eq!(torque[0], -0.5);
        assert!((torque[1] - 0.05).abs() < 1e-12);
        assert!(at([80.0, 0.0]).0, "still active inside the hysteresis");
        assert!(!at([65.0, 5.0]).0);
        assert!(!at([80.0, 0.0]).0, "and does not start again there");
    }

    #[test]
    fn the_momentum_decays_with_the_time_constant() {
        let mut unloading = MomentumUnloading::new(settings()).unwrap();
        let (mut speed, dt) = ([0.0, -130.0], 0.01);
        let mut desired = [0.0; 2];
        for _ in 0..2000 {
            unloading.update(&wheels(), &speed, &[0.0, 0.0], &mut desired);
            speed[1] += desired[1] / 0.1 * dt;
        }
        // 20 s: one time constant. The motor's limit of 5 rad/s^2 binds only above 100 rad/s.
        assert!(unloading.active());
        // 130 -> 100 at 5 rad/s^2 takes 6 s, then 14 s of decay.
        let expected = -100.0 * (-14.0_f64 / 20.0).exp();
        assert!((speed[1] - expected).abs() < 0.1, "{}", speed[1]);
    }

    #[test]
    fn bad_speeds_and_settings() {
        let mut unloading = MomentumUnloading::new(settings()).unwrap();
        let mut desired = [9.0; 2];
        assert!(!unloading.update(&wheels(), &[f64::NAN], &[], &mut desired));
        assert_eq!(desired, [0.0; 2]);
        for bad in [
            UnloadingSettings { release_share: 0.7, ..settings() },
            UnloadingSettings { engage_share: 1.1, ..settings() },
            UnloadingSettings { time_constant_s: 0.0, ..settings() },
        ] {
            assert!(MomentumUnloading::new(bad).is_err());
        }
    }
}
