//! From a torque to the number that a motor is given, and back.

/// What a motor makes of `T=`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Drive {
    /// A share of the bus voltage (D-style motors: "MT does not regulate torque in the D-style motor", page 589).
    Voltage {
        /// Torque per current, which is also voltage per speed [N m/A, V s/rad].
        torque_constant: f64,
        /// Of the winding \[ohm\].
        resistance_ohm: f64,
    },
    /// A share of a torque.
    Current {
        /// Torque at full scale \[N m\].
        full_scale_torque_n_m: f64,
    },
}

impl Drive {
    /// The share of full scale that gives this torque at this speed and bus voltage, within -1 and 1.
    #[must_use]
    pub fn share(&self, torque_n_m: f64, speed_rad_s: f64, bus_v: f64) -> f64 {
        let share = match *self {
            Self::Voltage { torque_constant, resistance_ohm } => {
                (torque_n_m / torque_constant * resistance_ohm + torque_constant * speed_rad_s) / bus_v
            }
            Self::Current { full_scale_torque_n_m } => torque_n_m / full_scale_torque_n_m,
        };
        if share.is_finite() { share.clamp(-1.0, 1.0) } else { 0.0 }
    }

    /// The torque that this share gives \[N m\].
    #[must_use]
    pub fn torque_n_m(&self, share: f64, speed_rad_s: f64, bus_v: f64) -> f64 {
        match *self {
            Self::Voltage { torque_constant, resistance_ohm } => {
                torque_constant * (share * bus_v - torque_constant * speed_rad_s) / resistance_ohm
            }
            Self::Current { full_scale_torque_n_m } => share * full_scale_torque_n_m,
        }
    }
}
