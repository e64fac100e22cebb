//! Parameters of the sensors, checked once.

use nalgebra::{Unit, Vector3};
use thiserror::Error;
use whorl_math::{GRAVITY_M_S2, rad_from_deg};

/// A parameter outside its allowed range.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{name} = {value}: must be {allowed}")]
pub struct ParameterError {
    /// The field, with its path.
    pub name: &'static str,
    /// The value given.
    pub value: f64,
    /// What is allowed, in words.
    pub allowed: &'static str,
}

/// How a vector measurement corrects the attitude.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VectorUse {
    /// Both directions across the vector: for a sensor as trustworthy as the accelerometer.
    Direction,
    /// Only the heading: for a magnetometer, whose dip and disturbances must not tilt the estimate.
    Heading,
}

/// What a gyro sample means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GyroSampling {
    /// The rate at the stamp: consecutive samples are averaged over the interval.
    Instantaneous,
    /// The mean rate over the interval that ends at the stamp.
    IntervalMean,
}

/// The optional second vector sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VectorParameters {
    /// The observed direction in world axes.
    pub reference_w: Unit<Vector3<f64>>,
    /// Standard deviation across the direction, per axis \[rad\].
    pub noise_rad: f64,
    /// What it may correct.
    pub usage: VectorUse,
    /// A sample older than this, against the newest IMU stamp, is refused as late \[s\].
    pub max_age_s: f64,
    /// Without an accepted sample for this long the heading counts as unobserved \[s\].
    pub stale_after_s: f64,
    /// After outliers for this long without a break the sensor is trusted and the heading
    /// restarts \[s\].
    pub recovery_s: f64,
}

/// Larger accelerometer noise while the sensor itself accelerates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AccelerationRejection {
    /// Standard deviation added per unit of the deviation `| |f| - g |` \[1\].
    pub gain: f64,
    /// The deviation's peak is held and decays with this time constant \[s\].
    pub decay_s: f64,
}

/// Parameters of [`crate::AttitudeBiasEstimator`]. Public because any value can be written; [`Self::check`]
/// (called by the filter) says which ones are allowed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Gyro white noise (angle random walk) \[rad/s/sqrt(Hz)\].
    pub gyro_noise_rad_s_sqrt_hz: f64,
    /// Gyro bias random walk \[rad/s^2/sqrt(Hz)\] (equal to rad/s/sqrt(s)).
    pub gyro_bias_walk_rad_s2_sqrt_hz: f64,
    /// Meaning of a gyro sample.
    pub gyro_sampling: GyroSampling,
    /// Accelerometer noise per sample and axis \[m/s^2\].
    pub accelerometer_noise_m_s2: f64,
    /// Accelerometer position from the centre of rotation, body axes \[m\] (`r_y` of eq. 4.40).
    pub accelerometer_position_b_m: Vector3<f64>,
    /// With a lever arm or a velocity sigma the specific force is averaged this long, in a frame that
    /// does not turn, before it corrects \[s\]; with neither every sample corrects. Longer: less noise
    /// from the lever arm's velocity; shorter: earlier correction.
    pub accelerometer_window_s: f64,
    /// Standard deviation of the accelerometer's unknown change of velocity over a window \[m/s\]: 0
    /// on a fixed pivot, some tenths for a sensor that moves freely.
    pub accelerometer_velocity_sigma_m_s: f64,
    /// Gravity \[m/s^2\].
    pub gravity_m_s2: f64,
    /// Adaptive accelerometer noise for a sensor that is not on a fixed pivot; `None`: off.
    pub acceleration_rejection: Option<AccelerationRejection>,
    /// The second vector sensor; `None` if there is none.
    pub vector: Option<VectorParameters>,
    /// Samples are averaged for this long before the first attitude \[s\].
    pub start_window_s: f64,
    /// How much longer the start waits for a first vector sample \[s\].
    pub start_vector_wait_s: f64,
    /// Initial azimuth of body x without a vector sample \[rad\].
    pub initial_heading_rad: f64,
    /// Its standard deviation \[rad\].
    pub initial_heading_sigma_rad: f64,
    /// Turn-on bias, standard deviation \[rad/s\].
    pub initial_bias_sigma_rad_s: f64,
    /// Rate below which the start counts as still, standard deviation \[rad/s\]. The bias then
    /// starts from the mean rate. `None`: never assume it.
    pub still_rate_sigma_rad_s: Option<f64>,
    /// Probability of refusing a good measurement as an outlier.
    pub outlier_probability: f64,
    /// After accelerometer outliers for this long without a break the attitude restarts \[s\].
    pub recovery_s: f64,
    /// Largest credible rate per axis \[rad/s\].
    pub gyro_range_rad_s: f64,
    /// Largest credible change of rate per axis between samples \[rad/s\]: a lone jump is a spike.
    pub gyro_step_rad_s: f64,
    /// Largest credible specific force per axis \[m/s^2\].
    pub accelerometer_range_m_s2: f64,
    /// A specific force whose length differs from gravity by more is refused \[m/s^2\].
    pub gravity_tolerance_m_s2: f64,
    /// This many identical consecutive samples mean a frozen sensor; 0: no check.
    pub frozen_samples: u32,
    /// A gap between IMU samples beyond this adds uncertainty \[s\].
    pub imu_gap_s: f64,
    /// A gap beyond this makes the IMU stale, and the attitude restarts when it returns \[s\].
    pub imu_timeout_s: f64,
    /// Angular acceleration assumed inside a gap, standard deviation \[rad/s^2\].
    pub gap_acceleration_rad_s2: f64,
    /// Tilt uncertainty above which the estimate is unhealthy, standard deviation \[rad\].
    pub unhealthy_tilt_sigma_rad: f64,
    /// Average NIS per degree of freedom above which the filter is inconsistent \[1\].
    pub inconsistent_nis: f64,
}

impl Parameters {
    /// MotionPak II class sensors at 100 Hz on a platform: gyro 0.1 deg/s and accelerometer
    /// 0.02 m/s^2 per sample, at the centre of rotation, without a vector sensor.
    #[must_use]
    pub fn motion_pak_ii() -> Self {
        Self {
            gyro_noise_rad_s_sqrt_hz: rad_from_deg(0.1) * 0.1,
            gyro_bias_walk_rad_s2_sqrt_hz: 1e-5,
            gyro_sampling: GyroSampling::Instantaneous,
            accelerometer_noise_m_s2: 0.02,
            accelerometer_position_b_m: Vector3::zeros(),
            accelerometer_window_s: 0.25,
            accelerometer_velocity_sigma_m_s: 0.0,
            acceleration_rejection: None,
            gravity_m_s2: GRAVITY_M_S2,
            vector: None,
            start_window_s: 0.5,
            start_vector_wait_s: 0.5,
            initial_heading_rad: 0.0,
            initial_heading_sigma_rad: 1.8,
            initial_bias_sigma_rad_s: rad_from_deg(1.0),
            still_rate_sigma_rad_s: None,
            outlier_probability: 1e-6,
            recovery_s: 1.0,
            gyro_range_rad_s: rad_from_deg(150.0),
            gyro_step_rad_s: 1.0,
            accelerometer_range_m_s2: 50.0,
            gravity_tolerance_m_s2: 3.0,
            frozen_samples: 20,
            imu_gap_s: 0.05,
            imu_timeout_s: 0.5,
            gap_acceleration_rad_s2: 0.5,
            unhealthy_tilt_sigma_rad: rad_from_deg(5.0),
            inconsistent_nis: 3.0,
        }
    }

    /// A small inertial unit that moves freely (in a hand, on a limb), not about a pivot.
    ///
    /// Its errors are not white: motion, scale and misalignment dominate, so the noises here are
    /// effective ones, chosen on recordings of a hand-held unit at 286 Hz. Gravity is averaged
    /// over a second, within which the sensor's velocity is taken to change by 0.05 m/s per
    /// axis on the whole.
    #[must_use]
    pub fn freely_moving() -> Self {
        Self {
            gyro_noise_rad_s_sqrt_hz: 3e-3,
            gyro_bias_walk_rad_s2_sqrt_hz: 2e-5,
            accelerometer_noise_m_s2: 0.05,
            accelerometer_window_s: 1.0,
            accelerometer_velocity_sigma_m_s: 0.05,
            initial_bias_sigma_rad_s: 0.01,
            outlier_probability: 1e-9,
            recovery_s: 5.0,
            gyro_range_rad_s: rad_from_deg(2000.0),
            gyro_step_rad_s: 20.0,
            accelerometer_range_m_s2: 16.0 * GRAVITY_M_S2,
            // Its own acceleration is averaged out rather than refused.
            gravity_tolerance_m_s2: 50.0,
            ..Self::motion_pak_ii()
        }
    }

    /// A magnetometer that corrects the heading alone; `north_azimuth_rad` is where magnetic north
    /// lies in the world, from east towards north: pi/2 in an east-north-up world aligned with it.
    ///
    /// Its noise is an effective one: the field inside a building is not uniform, so the error
    /// does not average out from sample to sample. There is no check of the field's strength or dip.
    #[must_use]
    pub fn with_magnetometer(mut self, north_azimuth_rad: f64) -> Self {
        let (sine, cosine) = north_azimuth_rad.sin_cos();
        self.vector = Some(VectorParameters {
            reference_w: Unit::new_unchecked(Vector3::new(cosine, sine, 0.0)),
            noise_rad: 1.0,
            usage: VectorUse::Heading,
            max_age_s: 0.2,
            stale_after_s: 1.0,
            recovery_s: 60.0,
        });
        self
    }

    /// A vector sensor of 3 mrad at 10 Hz that observes `reference_w`, as a star or sun
    /// simulator does.
    #[must_use]
    pub fn with_vector(mut self, reference_w: Unit<Vector3<f64>>) -> Self {
        self.vector = Some(VectorParameters {
            reference_w,
            noise_rad: 3e-3,
            usage: VectorUse::Direction,
            max_age_s: 0.2,
            stale_after_s: 0.5,
            recovery_s: 1.0,
        });
        self
    }

    /// Refuses values that the filter cannot work with.
    ///
    /// # Errors
    /// The first field that is not finite or outside its range.
    pub fn check(&self) -> Result<(), ParameterError> {
        let positive = [
            ("gyro_noise_rad_s_sqrt_hz", self.gyro_noise_rad_s_sqrt_hz),
            ("accelerometer_noise_m_s2", self.accelerometer_noise_m_s2),
            ("gravity_m_s2", self.gravity_m_s2),
            ("start_window_s", self.start_window_s),
            ("initial_heading_sigma_rad", self.initial_heading_sigma_rad),
            ("initial_bias_sigma_rad_s", self.initial_bias_sigma_rad_s),
            ("recovery_s", self.recovery_s),
            ("gyro_range_rad_s", self.gyro_range_rad_s),
            ("gyro_step_rad_s", self.gyro_step_rad_s),
            ("accelerometer_range_m_s2", self.accelerometer_range_m_s2),
            ("gravity_tolerance_m_s2", self.gravity_tolerance_m_s2),
            ("imu_gap_s", self.imu_gap_s),
            ("unhealthy_tilt_sigma_rad", self.unhealthy_tilt_sigma_rad),
            ("inconsistent_nis", self.inconsistent_nis),
            ("still_rate_sigma_rad_s", self.still_rate_sigma_rad_s.unwrap_or(1.0)),
        ];
        let not_negative = [
            ("gyro_bias_walk_rad_s2_sqrt_hz", self.gyro_bias_walk_rad_s2_sqrt_hz),
            ("accelerometer_window_s", self.accelerometer_window_s),
            ("accelerometer_velocity_sigma_m_s", self.accelerometer_velocity_sigma_m_s),
            ("start_vector_wait_s", self.start_vector_wait_s),
            ("gap_acceleration_rad_s2", self.gap_acceleration_rad_s2),
        ];
        let finite = [
            ("accelerometer_position_b_m.x", self.accelerometer_position_b_m.x),
            ("accelerometer_position_b_m.y", self.accelerometer_position_b_m.y),
            ("accelerometer_position_b_m.z", self.accelerometer_position_b_m.z),
            ("initial_heading_rad", self.initial_heading_rad),
        ];
        require(&positive, "finite and above zero", |v| v.is_finite() && v > 0.0)?;
        require(&not_negative, "finite and not negative", |v| v.is_finite() && v >= 0.0)?;
        require(&finite, "finite", f64::is_finite)?;
        require(&[("outlier_probability", self.outlier_probability)], "between 1e-12 and 0.1", |v| {
            (1e-12..=0.1).contains(&v)
        })?;
        require(&[("imu_timeout_s", self.imu_timeout_s)], "finite and at least imu_gap_s", |v| {
            v.is_finite() && v >= self.imu_gap_s
        })?;
        if let Some(rejection) = &self.acceleration_rejection {
            let fields = [
                ("acceleration_rejection.gain", rejection.gain),
                ("acceleration_rejection.decay_s", rejection.decay_s),
            ];
            require(&fields, "finite and above zero", |v| v.is_finite() && v > 0.0)?;
        }
        self.vector.as_ref().map_or(Ok(()), VectorParameters::check)
    }
}

impl VectorParameters {
    fn check(&self) -> Result<(), ParameterError> {
        let positive = [
            ("vector.noise_rad", self.noise_rad),
            ("vector.max_age_s", self.max_age_s),
            ("vector.stale_after_s", self.stale_after_s),
            ("vector.recovery_s", self.recovery_s),
        ];
        require(&positive, "finite and above zero", |v| v.is_finite() && v > 0.0)?;
        require(&[("vector.reference_w (length)", self.reference_w.norm())], "one", |v| {
            (v - 1.0).abs() < 1e-9
        })?;
        // A vertical reference repeats the accelerometer and leaves the heading unknown.
        let horizontal = self.reference_w.x.hypot(self.reference_w.y);
        require(
            &[("vector.reference_w (horizontal part)", horizontal)],
            "at least 0.05: a vertical reference does not determine the heading",
            |v| v >= 0.05,
        )
    }
}

fn require(
    fields: &[(&'static str, f64)],
    allowed: &'static str,
    accept: impl Fn(f64) -> bool,
) -> Result<(), ParameterError> {
    match fields.iter().find(|(_, value)| !accept(*value)) {
        Some(&(name, value)) => Err(ParameterError { name, value, allowed }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_are_allowed() {
        let with_vector = Parameters::motion_pak_ii().with_vector(Vector3::x_axis());
        assert_eq!(with_vector.check(), Ok(()));
        assert_eq!(Parameters::freely_moving().with_magnetometer(1.6).check(), Ok(()));
    }

    type Spoil = fn(&mut Parameters);

    #[test]
    fn errors_name_the_field() {
        let good = Parameters::motion_pak_ii().with_vector(Vector3::x_axis());
        let cases: [(&str, Spoil); 5] = [
            ("gyro_noise_rad_s_sqrt_hz", |p| p.gyro_noise_rad_s_sqrt_hz = 0.0),
            ("gyro_bias_walk_rad_s2_sqrt_hz", |p| p.gyro_bias_walk_rad_s2_sqrt_hz = f64::NAN),
            ("accelerometer_position_b_m.y", |p| p.accelerometer_position_b_m.y = f64::INFINITY),
            ("outlier_probability", |p| p.outlier_probability = 0.5),
            ("imu_timeout_s", |p| p.imu_timeout_s = 0.001),
        ];
        for (name, spoil) in cases {
            let mut parameters = good;
            spoil(&mut parameters);
            assert_eq!(parameters.check().expect_err("refused").name, name);
        }
        let vertical = Parameters::motion_pak_ii().with_vector(Vector3::z_axis());
        let message = vertical.check().expect_err("refused").to_string();
        assert!(message.contains("heading"), "{message}");
    }
}
