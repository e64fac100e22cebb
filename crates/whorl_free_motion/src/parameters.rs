//! Assumptions about the motion, the sensors and the field.

/// Parameters of [`super::FreeMotionFilter`]; all sigmas are standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FreeMotionParameters {
    /// Gravity [m/s^2].
    pub gravity_m_s2: f64,
    /// Gyro white noise [rad/s/sqrt(Hz)].
    pub gyro_noise_rad_s_sqrt_hz: f64,
    /// Further angle noise per rate, for what scale and misalignment leave: a nonlinearity of 0.05 % (data sheets of MEMS gyros have
    /// 0.01 to 0.1 %) that lasts for a second [rad/sqrt(s) per rad/s].
    pub gyro_scale_noise_sqrt_s: f64,
    /// Gyro scale and misalignment, each axis for itself: data sheets have up to 1 % \[1\].
    pub gyro_matrix_sigma: f64,
    /// Gyro scale, all axes together: a wrong range, or a sensor without calibration \[1\].
    pub gyro_scale_sigma: f64,
    /// Initial gyro bias [rad/s].
    pub gyro_bias_sigma_rad_s: f64,
    /// Its random walk [rad/s/sqrt(s)].
    pub gyro_bias_walk_rad_s_sqrt_s: f64,
    /// Accelerometer noise [m/s^2/sqrt(Hz)].
    pub accelerometer_noise_m_s2_sqrt_hz: f64,
    /// Further noise per acceleration of the sensor, for its scale [sqrt(s)].
    pub accelerometer_scale_noise_sqrt_s: f64,
    /// Initial accelerometer bias: 5 mg, of a calibrated MEMS unit [m/s^2].
    pub accelerometer_bias_sigma_m_s2: f64,
    /// Its random walk [m/s^2/sqrt(s)].
    pub accelerometer_bias_walk_m_s2_sqrt_s: f64,
    /// Velocity of the motion: hands and feet move at up to 2 m/s [m/s].
    pub velocity_sigma_m_s: f64,
    /// Distance from the middle of the motion \[m\].
    pub position_sigma_m: f64,
    /// How fast that middle wanders [m/sqrt(s)].
    pub position_walk_m_sqrt_s: f64,
    /// Correlation time of velocity and position \[s\].
    pub motion_time_s: f64,
    /// East component of the field's inhomogeneity, relative to its horizontal length \[1\].
    pub field_east_sigma: f64,
    /// The same at the start, which says what north is \[1\].
    pub start_east_sigma: f64,
    /// Correlation time of the inhomogeneity, counted in motion \[s\].
    pub field_time_s: f64,
    /// How fast the field's north and up components wander in motion, relative to its length [1/sqrt(s)].
    pub field_walk_per_sqrt_s: f64,
    /// Noise of a used magnetometer sample, relative to the field's length \[1\].
    pub magnetometer_sigma: f64,
    /// Interval of used magnetometer samples \[s\].
    pub magnetometer_interval_s: f64,
    /// How strongly a disagreement of the north and up components adds to the noise \[1\].
    pub disagreement_gain: f64,
    /// Deviation of the field's north and up components at the start, relative to its length \[1\].
    pub inhomogeneity_start: f64,
    /// How fast the estimate of that deviation rises \[s\] ...
    pub field_rise_s: f64,
    /// ... and falls \[s\].
    pub field_fall_s: f64,
    /// Over this time the field's components are averaged to see how far the place is off the start \[s\].
    pub field_place_s: f64,
    /// Over this time in motion the field's small-scale inhomogeneity is the same \[s\].
    pub field_short_time_s: f64,
    /// Field of iron on the sensor, relative to the field's length: what a calibration leaves, 0.5 uT \[1\].
    pub iron_sigma: f64,
    /// Samples are averaged for this long before the first attitude \[s\].
    pub start_window_s: f64,
    /// The sensor rests when rates stay within this of their mean for [`Self::rest_time_s`] [rad/s] ...
    pub rest_rate_rad_s: f64,
    /// ... and the specific force within this [m/s^2].
    pub rest_force_m_s2: f64,
    /// See above \[s\].
    pub rest_time_s: f64,
    /// Rate that a resting sensor may have [rad/s].
    pub rest_rate_sigma_rad_s: f64,
    /// Largest bias that rest may show [rad/s].
    pub rest_rate_limit_rad_s: f64,
}

impl Default for FreeMotionParameters {
    fn default() -> Self {
        Self {
            gravity_m_s2: 9.81,
            gyro_noise_rad_s_sqrt_hz: 3e-4,
            gyro_scale_noise_sqrt_s: 5e-4,
            gyro_matrix_sigma: 7e-3,
            gyro_scale_sigma: 0.1,
            gyro_bias_sigma_rad_s: 0.01,
            gyro_bias_walk_rad_s_sqrt_s: 3e-5,
            accelerometer_noise_m_s2_sqrt_hz: 0.01,
            accelerometer_scale_noise_sqrt_s: 0.01,
            accelerometer_bias_sigma_m_s2: 0.05,
            accelerometer_bias_walk_m_s2_sqrt_s: 2e-3,
            velocity_sigma_m_s: 1.5,
            position_sigma_m: 0.5,
            position_walk_m_sqrt_s: 0.2,
            motion_time_s: 0.5,
            field_east_sigma: 0.05,
            start_east_sigma: 0.05,
            field_time_s: 100.0,
            field_walk_per_sqrt_s: 0.005,
            magnetometer_sigma: 0.03,
            magnetometer_interval_s: 0.05,
            disagreement_gain: 2.0,
            inhomogeneity_start: 0.03,
            field_rise_s: 1.0,
            field_fall_s: 4.0,
            field_place_s: 3.0,
            field_short_time_s: 0.5,
            iron_sigma: 0.01,
            start_window_s: 0.5,
            rest_rate_rad_s: 0.035,
            rest_force_m_s2: 0.5,
            rest_time_s: 1.0,
            rest_rate_sigma_rad_s: 1e-3,
            rest_rate_limit_rad_s: 0.05,
        }
    }
}
