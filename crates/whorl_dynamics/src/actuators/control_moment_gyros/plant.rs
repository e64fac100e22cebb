//! The plant's gyros: gimbals that follow a recorded motion.

use nalgebra::Vector3;

use crate::plant::{CommandError, Plant};

impl Plant {
    /// Moves the gimbals along a motion that was measured: from these angles \[rad\] at these rates [rad/s], which hold until
    /// the next call, whatever their drives and friction would do. The body takes the impulse of the change of rates.
    ///
    /// # Errors
    /// Another number of angles or rates than gyros, or one that is not finite.
    pub fn move_gimbals_along(&mut self, angle_rad: &[f64], rate_rad_s: &[f64]) -> Result<(), CommandError> {
        let gyros = self.gyrostat.model().gyros();
        for given in [angle_rad.len(), rate_rad_s.len()] {
            if given != gyros.len() {
                return Err(CommandError::MotorCount { given, needed: gyros.len() });
            }
        }
        if !angle_rad.iter().chain(rate_rad_s).copied().all(f64::is_finite) {
            return Err(CommandError::NotFinite);
        }
        let state = &mut self.state.actuators.control_moment_gyros;
        let drive = &mut self.drive.actuators.control_moment_gyros;
        let mut impulse_b_n_m_s = Vector3::zeros();
        for (j, gyro) in gyros.iter().enumerate() {
            let change_rad_s = rate_rad_s[j] - state.rate_rad_s[j];
            if drive.along[j] {
                impulse_b_n_m_s -=
                    gyro.gimbal_axis_b.into_inner() * (gyro.gimbal_inertia_kg_m2 * change_rad_s);
            }
            (state.angle_rad[j], state.rate_rad_s[j], drive.along[j]) = (angle_rad[j], rate_rad_s[j], true);
        }
        self.drive.equation = self.gyrostat.rate_equation_now(&self.drive.actuators);
        if !self.drive.clamped {
            self.state.omega_wb_b_rad_s += self.drive.equation.rate_change_b_rad_s(&impulse_b_n_m_s);
        }
        Ok(())
    }
}
