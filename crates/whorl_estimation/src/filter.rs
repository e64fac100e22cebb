//! The attitude-error / gyro-bias filter.

use crate::covariance::{Correction, Covariance, Measurement, Outlier, ScalarMeasurement};
use crate::estimate::{Estimate, Flags, Health};
use crate::history::History;
use crate::monitor::{SampleMonitor, SensorMonitor};
use crate::parameters::{GyroSampling, ParameterError, Parameters, VectorParameters, VectorUse};
use crate::residual::{across, centripetal, components, direction_residual, heading_residual};
use crate::start::Start;
use crate::verdict::{FilterEvent, ImuOutcome, Rejection, RejectionCounts, Verdict};
use nalgebra::{Matrix2, Matrix3, Matrix3x2, Matrix6, Unit, UnitQuaternion, Vector3};
use whorl_math::{quaternion_exp, unit};

/// Heading variance above which a vector sample corrects the heading alone, whose innovation is
/// exact for any angle \[rad^2\] (18 deg).
const COARSE_HEADING_VARIANCE: f64 = 0.1;

/// Heading variance of "unknown" \[rad^2\]: a uniform angle has pi^2/3; some margin.
const UNKNOWN_HEADING_VARIANCE: f64 = 4.0;

/// So many stamps in a row before the newest one mean that the clock was set back.
const CLOCK_STEP_SAMPLES: u32 = 20;

/// One sample of the inertial unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// Measurement time \[ns\], any fixed epoch.
    pub stamp_ns: i64,
    /// Rate gyro, body axes \[rad/s\].
    pub gyro_rad_s: Vector3<f64>,
    /// Specific force, body axes \[m/s^2\]: +9.81 on z at rest.
    pub specific_force_m_s2: Vector3<f64>,
    /// Angular acceleration from a model of the platform \[rad/s^2\]; `None`: from the gyro.
    pub angular_acceleration_rad_s2: Option<Vector3<f64>>,
}

/// Attitude and gyro bias from gyro, accelerometer and an optional vector sensor.
///
/// The filter of the dissertation's section 4.5.4 (eqs. 4.69-4.72): the gyro drives the
/// attitude, its bias is a state, the accelerometer keeps its lever-arm terms. Three things
/// differ from the printed one:
///
/// - the attitude error is a rotation vector in world axes instead of a Gibbs vector in body
///   axes (equal to first order). Its transition and its sensitivities then do not depend on the
///   estimate, so an unobserved heading cannot become falsely certain, and large errors
///   converge (S. Bonnabel, P. Martin, E. Salaun, "Invariant extended Kalman filter", CDC 2009);
/// - the accelerometer is used as a direction (two components across the vertical): an error of
///   its scale does not matter, and its innovation is valid for any angle;
/// - the gyro is integrated in an undisturbed inertial frame, and corrections turn that frame:
///   a late vector sample meets the attitude of its own time.
///
/// A pure state machine without allocation: `Clone` is the save and the restore.
#[derive(Clone, Debug, PartialEq)]
pub struct Filter {
    parameters: Parameters,
    constants: Constants,
    /// The averages of the start; `None` once the attitude is known.
    start: Option<Start>,
    previous: Option<PreviousImu>,
    q_world_inertial: UnitQuaternion<f64>,
    q_inertial_body: UnitQuaternion<f64>,
    /// Rotation matrix of `q_world_inertial * q_inertial_body`.
    rotation: Matrix3<f64>,
    bias_rad_s: Vector3<f64>,
    angular_acceleration_rad_s2: Vector3<f64>,
    /// Peak-held deviation of the specific force's length from gravity \[m/s^2\].
    deviation_m_s2: f64,
    covariance: Covariance,
    history: History,
    /// A vector sample ahead of the IMU.
    pending: Option<(i64, Unit<Vector3<f64>>)>,
    gyro: SampleMonitor,
    accelerometer: SensorMonitor,
    vector: SensorMonitor,
    /// Latest normalised innovation squared and its degrees of freedom.
    nis: Option<(f64, u8)>,
    backward_stamps: u32,
}

/// The last accepted gyro sample, and a suspected spike after it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct PreviousImu {
    stamp_ns: i64,
    gyro_rad_s: Vector3<f64>,
    suspect_rad_s: Option<Vector3<f64>>,
}

/// Worked out once from the parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Constants {
    gyro_noise_density: f64,
    bias_walk_density: f64,
    has_lever: bool,
    gate_one: f64,
    gate_two: f64,
    vector_across: Matrix3x2<f64>,
}

impl Constants {
    fn new(parameters: &Parameters) -> Self {
        let reference = parameters.vector.map_or(Vector3::x_axis(), |v| v.reference_w);
        Self {
            gyro_noise_density: parameters.gyro_noise_rad_s_sqrt_hz.powi(2),
            bias_walk_density: parameters.gyro_bias_walk_rad_s2_sqrt_hz.powi(2),
            has_lever: parameters.accelerometer_position_b_m != Vector3::zeros(),
            gate_one: crate::consistency::chi_squared_quantile(1.0 - parameters.outlier_probability, 1),
            // The quantile of two degrees of freedom has a closed form.
            gate_two: -2.0 * parameters.outlier_probability.ln(),
            vector_across: across(&reference),
        }
    }
}

impl Filter {
    /// A filter that finds its first attitude from its first samples.
    ///
    /// # Errors
    /// [`ParameterError`] names the first parameter that is not allowed.
    pub fn new(parameters: Parameters) -> Result<Self, ParameterError> {
        parameters.check()?;
        let bias_variance = parameters.initial_bias_sigma_rad_s.powi(2);
        Ok(Self {
            constants: Constants::new(&parameters),
            start: None,
            previous: None,
            q_world_inertial: UnitQuaternion::identity(),
            q_inertial_body: UnitQuaternion::identity(),
            rotation: Matrix3::identity(),
            bias_rad_s: Vector3::zeros(),
            angular_acceleration_rad_s2: Vector3::zeros(),
            deviation_m_s2: 0.0,
            covariance: Covariance::diagonal(Vector3::repeat(10.0), bias_variance),
            history: History::new(),
            pending: None,
            gyro: SampleMonitor::default(),
            accelerometer: SensorMonitor::default(),
            vector: SensorMonitor::default(),
            nis: None,
            backward_stamps: 0,
            parameters,
        })
    }

    /// A filter that starts from a known attitude and bias at `stamp_ns` instead of averaging.
    ///
    /// `covariance` is that of [`Estimate::covariance`]: symmetric, attitude error in body axes
    /// \[rad\], bias error \[rad/s\]. The first IMU sample continues from `stamp_ns`.
    ///
    /// # Errors
    /// [`ParameterError`] for a parameter that is not allowed, or a covariance that is not
    /// symmetric and positive definite.
    pub fn with_attitude(
        parameters: Parameters,
        stamp_ns: i64,
        q_world_body: UnitQuaternion<f64>,
        gyro_bias_rad_s: Vector3<f64>,
        covariance: &Matrix6<f64>,
    ) -> Result<Self, ParameterError> {
        let mut filter = Self::new(parameters)?;
        let asymmetry = (covariance - covariance.transpose()).amax();
        if asymmetry.is_nan() || asymmetry > 1e-9 * covariance.amax() || covariance.cholesky().is_none() {
            return Err(ParameterError {
                name: "covariance (smallest eigenvalue)",
                value: covariance.symmetric_eigenvalues().min(),
                allowed: "above zero, of a symmetric matrix",
            });
        }
        let rotation = *q_world_body.to_rotation_matrix().matrix();
        filter.covariance = Covariance {
            attitude: rotation * covariance.fixed_view::<3, 3>(0, 0) * rotation.transpose(),
            cross: rotation * covariance.fixed_view::<3, 3>(0, 3),
            bias: covariance.fixed_view::<3, 3>(3, 3).into(),
        };
        filter.q_inertial_body = q_world_body;
        filter.rotation = rotation;
        filter.bias_rad_s = gyro_bias_rad_s;
        filter.history.push(stamp_ns, q_world_body);
        filter.previous = Some(PreviousImu { stamp_ns, gyro_rad_s: gyro_bias_rad_s, suspect_rad_s: None });
        Ok(filter)
    }

    /// The parameters in use.
    #[must_use]
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// Takes in one IMU sample: propagates to its stamp, then corrects with the specific force.
    ///
    /// Any input is safe; what was not used is named in the outcome, and counted.
    pub fn on_imu(&mut self, sample: &ImuSample) -> ImuOutcome {
        self.nis = None;
        let mut event = None;
        if let Err(rejection) = self.accept_gyro(sample, &mut event) {
            self.gyro.reject(rejection);
            return ImuOutcome {
                gyro: Verdict::Rejected(rejection),
                accelerometer: Verdict::Rejected(Rejection::NotUsable),
                vector: None,
                event,
            };
        }
        self.gyro.accept(sample.stamp_ns);
        self.propagate(sample, &mut event);
        let vector = match self.pending {
            Some((stamp_ns, direction_b)) if stamp_ns <= sample.stamp_ns => {
                self.pending = None;
                Some(self.apply_vector(stamp_ns, direction_b, &mut event))
            }
            _ => None,
        };
        let accelerometer = self.use_specific_force(sample, &mut event);
        self.try_finish_start(sample.stamp_ns, &mut event);
        if !self.is_finite() {
            let bias_variance = self.parameters.initial_bias_sigma_rad_s.powi(2);
            (self.q_world_inertial, self.q_inertial_body) =
                (UnitQuaternion::identity(), UnitQuaternion::identity());
            self.rotation = Matrix3::identity();
            self.bias_rad_s = Vector3::zeros();
            self.angular_acceleration_rad_s2 = Vector3::zeros();
            self.deviation_m_s2 = 0.0;
            self.covariance = Covariance::diagonal(Vector3::repeat(10.0), bias_variance);
            self.restart(sample.stamp_ns);
            event = Some(FilterEvent::RestartedAfterDivergence);
        }
        let gyro = if self.start.is_some() { Verdict::Collected } else { Verdict::Used };
        ImuOutcome { gyro, accelerometer, vector, event }
    }

    /// Takes in one direction of the vector sensor, body axes, any length above zero.
    ///
    /// It may be late by up to the sensor's `max_age_s`; ahead of the IMU it waits for the sample
    /// that follows.
    pub fn on_vector(&mut self, stamp_ns: i64, direction_b: &Vector3<f64>) -> (Verdict, Option<FilterEvent>) {
        self.nis = None;
        let mut event = None;
        let verdict = match self.accept_vector(stamp_ns, direction_b) {
            Err(rejection) => {
                self.vector.samples.reject(rejection);
                Verdict::Rejected(rejection)
            }
            Ok((direction_b, true)) => {
                self.pending = Some((stamp_ns, direction_b));
                Verdict::Deferred
            }
            Ok((direction_b, false)) => self.apply_vector(stamp_ns, direction_b, &mut event),
        };
        (verdict, event)
    }

    /// The estimate at the newest IMU sample; `now_ns` decides only what is stale.
    #[must_use]
    pub fn estimate(&self, now_ns: i64) -> Estimate {
        let stamp_ns = self.previous.map_or(now_ns, |p| p.stamp_ns);
        let q_world_body = self.q_world_inertial * self.q_inertial_body;
        let gyro_rad_s = self.previous.map_or(self.bias_rad_s, |p| p.gyro_rad_s);
        let (health, flags) = self.health(now_ns);
        Estimate {
            stamp_ns,
            q_world_body,
            omega_wb_b_rad_s: gyro_rad_s - self.bias_rad_s,
            gyro_bias_b_rad_s: self.bias_rad_s,
            covariance: self.covariance.in_body_axes(&self.rotation),
            nis: self.nis.map(|(nis, _)| nis),
            nis_dof: self.nis.map_or(0, |(_, dof)| dof),
            health,
            flags,
            rejected_samples: self
                .gyro
                .counts
                .total()
                .saturating_add(self.accelerometer.samples.counts.total())
                .saturating_add(self.vector.samples.counts.total()),
        }
    }

    /// Refused samples of gyro, accelerometer and vector sensor since the start.
    #[must_use]
    pub fn rejections(&self) -> [RejectionCounts; 3] {
        [self.gyro.counts, self.accelerometer.samples.counts, self.vector.samples.counts]
    }

    fn health(&self, now_ns: i64) -> (Health, Flags) {
        let parameters = &self.parameters;
        let since =
            |stamp_ns: Option<i64>| stamp_ns.map_or(f64::INFINITY, |stamp_ns| seconds(now_ns, stamp_ns));
        let imu_stale = since(self.gyro.accepted_ns) > parameters.imu_timeout_s;
        let vector_stale = parameters
            .vector
            .is_none_or(|vector| since(self.vector.samples.accepted_ns) > vector.stale_after_s);
        let limit = parameters.inconsistent_nis;
        let inconsistent = self.accelerometer.average_nis > limit || self.vector.average_nis > limit;
        let mut flags = Flags::default();
        flags.set(Flags::GYRO_REJECTED, self.gyro.latest_rejected);
        flags.set(Flags::ACCELEROMETER_REJECTED, self.accelerometer.samples.latest_rejected);
        flags.set(Flags::VECTOR_REJECTED, self.vector.samples.latest_rejected);
        flags.set(Flags::VECTOR_STALE, vector_stale);
        flags.set(Flags::IMU_STALE, imu_stale);
        flags.set(Flags::INCONSISTENT, inconsistent);
        let tilt_variance = self.covariance.attitude.m11.max(self.covariance.attitude.m22);
        let accelerometer_missing = since(self.accelerometer.samples.accepted_ns) > parameters.recovery_s;
        let health = if imu_stale && self.previous.is_some() && self.start.is_none() {
            Health::Unhealthy
        } else if self.start.is_some() || self.gyro.accepted_ns.is_none() {
            Health::Initialising
        } else if tilt_variance > parameters.unhealthy_tilt_sigma_rad.powi(2) {
            Health::Unhealthy
        } else if vector_stale || inconsistent || accelerometer_missing {
            Health::Degraded
        } else {
            Health::Ok
        };
        (health, flags)
    }

    /// Gates on the gyro half; a step back of the clock restarts the filter.
    fn accept_gyro(&mut self, sample: &ImuSample, event: &mut Option<FilterEvent>) -> Result<(), Rejection> {
        let gyro = &sample.gyro_rad_s;
        if !gyro.iter().all(|c| c.is_finite()) {
            return Err(Rejection::NotFinite);
        }
        if let Some(previous) = self.previous
            && sample.stamp_ns <= previous.stamp_ns
        {
            if sample.stamp_ns == previous.stamp_ns {
                return Err(Rejection::DuplicateStamp);
            }
            self.backward_stamps += 1;
            if self.backward_stamps < CLOCK_STEP_SAMPLES {
                return Err(Rejection::OutOfOrder);
            }
            self.previous = None;
            self.vector.samples.accepted_ns = None;
            self.vector.samples.newest_ns = None;
            self.accelerometer.samples.accepted_ns = None;
            self.restart(sample.stamp_ns);
            *event = Some(FilterEvent::RestartedAfterClockStep);
        }
        self.backward_stamps = 0;
        if gyro.amax() > self.parameters.gyro_range_rad_s {
            return Err(Rejection::OutOfRange);
        }
        if self.gyro.is_frozen(gyro, self.parameters.frozen_samples) {
            return Err(Rejection::Frozen);
        }
        let step = self.parameters.gyro_step_rad_s;
        if let Some(previous) = &mut self.previous
            && (gyro - previous.gyro_rad_s).amax() > step
        {
            // Twice in a row near the same value is a motion, not a spike.
            let confirmed = previous.suspect_rad_s.is_some_and(|suspect| (gyro - suspect).amax() <= step);
            previous.suspect_rad_s = Some(*gyro);
            if !confirmed {
                return Err(Rejection::Spike);
            }
        }
        Ok(())
    }

    /// Carries attitude and covariance to the sample's stamp.
    fn propagate(&mut self, sample: &ImuSample, event: &mut Option<FilterEvent>) {
        let gyro = sample.gyro_rad_s;
        let now = PreviousImu { stamp_ns: sample.stamp_ns, gyro_rad_s: gyro, suspect_rad_s: None };
        let Some(previous) = self.previous.replace(now) else {
            self.restart(sample.stamp_ns);
            return;
        };
        let dt_s = seconds(sample.stamp_ns, previous.stamp_ns);
        let mut noise = self.constants.gyro_noise_density;
        if dt_s > self.parameters.imu_timeout_s {
            self.covariance.bias += Matrix3::identity() * (self.constants.bias_walk_density * dt_s);
            self.restart(sample.stamp_ns);
            *event = Some(FilterEvent::RestartedAfterGap);
            return;
        } else if dt_s > self.parameters.imu_gap_s {
            // What a rate that wandered between the samples may have turned.
            let lost = 0.25 * self.parameters.gap_acceleration_rad_s2 * dt_s * dt_s;
            noise += lost * lost / dt_s;
        }
        let turn = match self.parameters.gyro_sampling {
            GyroSampling::IntervalMean => (gyro - self.bias_rad_s) * dt_s,
            GyroSampling::Instantaneous => {
                let (before, after) = (previous.gyro_rad_s - self.bias_rad_s, gyro - self.bias_rad_s);
                // Linear rate: the mean, and the first term of the Magnus series (coning).
                (before + after) * (0.5 * dt_s) + before.cross(&after) * (dt_s * dt_s / 12.0)
            }
        };
        if self.constants.has_lever {
            let weight = dt_s / (self.parameters.angular_acceleration_filter_s + dt_s);
            let difference = (gyro - previous.gyro_rad_s) / dt_s;
            self.angular_acceleration_rad_s2 += (difference - self.angular_acceleration_rad_s2) * weight;
        }
        self.q_inertial_body *= quaternion_exp(&turn);
        self.q_inertial_body.renormalize_fast();
        let before = self.rotation;
        self.update_rotation();
        let mean_rotation = (before + self.rotation) * 0.5;
        match &mut self.start {
            Some(start) => {
                start.advance(&mean_rotation, dt_s);
                start.add_rate(&(gyro - self.bias_rad_s));
                self.covariance.bias += Matrix3::identity() * (self.constants.bias_walk_density * dt_s);
            }
            None => self.covariance.propagate(&mean_rotation, dt_s, noise, self.constants.bias_walk_density),
        }
        self.history.push(sample.stamp_ns, self.q_inertial_body);
        if let Some(rejection) = &self.parameters.acceleration_rejection {
            self.deviation_m_s2 *= rejection.decay_s / (rejection.decay_s + dt_s);
        }
    }

    /// The accelerometer half of a sample, at the attitude just propagated.
    fn use_specific_force(&mut self, sample: &ImuSample, event: &mut Option<FilterEvent>) -> Verdict {
        let force = &sample.specific_force_m_s2;
        let rejection = if !force.iter().all(|c| c.is_finite()) {
            Some(Rejection::NotFinite)
        } else if force.amax() > self.parameters.accelerometer_range_m_s2 {
            Some(Rejection::OutOfRange)
        } else if self.accelerometer.samples.is_frozen(force, self.parameters.frozen_samples) {
            Some(Rejection::Frozen)
        } else {
            None
        };
        if let Some(rejection) = rejection {
            self.accelerometer.samples.reject(rejection);
            return Verdict::Rejected(rejection);
        }
        let vertical = self.vertical_measurement(sample);
        let deviation = (vertical.length_m_s2 - self.parameters.gravity_m_s2).abs();
        if deviation > self.parameters.gravity_tolerance_m_s2 {
            self.accelerometer.samples.reject(Rejection::NotGravity);
            return Verdict::Rejected(Rejection::NotGravity);
        }
        if let Some(start) = &mut self.start {
            start.add_gravity(&self.parameters, sample.stamp_ns, &vertical.force_b, &self.rotation);
            self.accelerometer.samples.accept(sample.stamp_ns);
            return Verdict::Collected;
        }
        let result = self.covariance.update(&vertical.measurement, self.constants.gate_two);
        let (verdict, lost) =
            self.accelerometer.record(&result, 2, sample.stamp_ns, self.parameters.recovery_s);
        match result {
            Ok(correction) => self.apply(&correction, 2),
            Err(Outlier(nis)) => self.nis = Some((nis, 2)),
        }
        if lost {
            let bias_variance = self.parameters.initial_bias_sigma_rad_s.powi(2);
            self.covariance.bias = Matrix3::identity() * bias_variance;
            self.restart(sample.stamp_ns);
            *event = Some(FilterEvent::RestartedAfterOutliers);
        }
        verdict
    }

    /// Specific force less its lever-arm terms as a measurement of the vertical.
    fn vertical_measurement(&mut self, sample: &ImuSample) -> Vertical {
        let parameters = &self.parameters;
        let gravity = parameters.gravity_m_s2;
        let mut noise_m_s2_squared = parameters.accelerometer_noise_m_s2.powi(2);
        let mut force_b = sample.specific_force_m_s2;
        let mut bias = None;
        let mut noise = Matrix2::zeros();
        if self.constants.has_lever {
            let lever_b = parameters.accelerometer_position_b_m;
            let omega = sample.gyro_rad_s - self.bias_rad_s;
            let (centripetal_b, slope) = centripetal(&omega, &lever_b);
            let (angular_acceleration, variance) = self.angular_acceleration(sample);
            force_b -= angular_acceleration.cross(&lever_b) + centripetal_b;
            // A force n across the vertical looks like the rotation n x k / g.
            let slope_w = self.rotation * slope / gravity;
            let column = |row: nalgebra::RowVector3<f64>| row.transpose();
            bias = Some(Matrix3x2::from_columns(&[
                -column(slope_w.row(1).into_owned()),
                column(slope_w.row(0).into_owned()),
            ]));
            // n = -d(omega_dot) x r has covariance s^2 (r^2 1 - r r^T).
            let lever_w = self.rotation * lever_b;
            let scale = variance / (gravity * gravity);
            let squared = lever_w.norm_squared();
            let (x, y) = (lever_w.x, lever_w.y);
            noise = Matrix2::new(squared - y * y, x * y, x * y, squared - x * x) * scale;
            let rate_slope = 2.0 * omega.norm();
            noise_m_s2_squared += rate_slope * rate_slope * squared * self.constants.gyro_noise_density
                / self.history.interval_s();
        }
        let length_m_s2 = force_b.norm();
        if let Some(rejection) = &parameters.acceleration_rejection {
            self.deviation_m_s2 = self.deviation_m_s2.max((length_m_s2 - gravity).abs());
            noise_m_s2_squared += (rejection.gain * self.deviation_m_s2).powi(2);
        }
        // The length was checked against gravity before use; any positive value will do here.
        let direction_w = self.rotation * force_b / length_m_s2.max(1e-3);
        let residual = direction_residual(&direction_w, &Vector3::z_axis());
        let variance = noise_m_s2_squared / (gravity * gravity);
        noise.m11 += variance;
        noise.m22 += variance;
        Vertical {
            length_m_s2,
            force_b,
            measurement: Measurement {
                innovation: residual.xy(),
                attitude: Matrix3x2::identity(),
                bias,
                noise,
            },
        }
    }

    /// Angular acceleration and its variance \[(rad/s^2)^2\].
    fn angular_acceleration(&self, sample: &ImuSample) -> (Vector3<f64>, f64) {
        let model_variance = self.parameters.angular_acceleration_sigma_rad_s2.powi(2);
        if let Some(modelled) = sample.angular_acceleration_rad_s2
            && modelled.iter().all(|c| c.is_finite())
        {
            return (modelled, model_variance);
        }
        // White noise of the samples through the filtered difference x' = a x + c (w' - w):
        // variance 2 c^2 s^2 / (1 + a); the sample interval cancels but for the density.
        let (tau_s, dt_s) = (self.parameters.angular_acceleration_filter_s, self.history.interval_s());
        let c = 1.0 / (tau_s + dt_s);
        let sample_variance = self.constants.gyro_noise_density / dt_s;
        let noise = 2.0 * c * c * sample_variance / (1.0 + tau_s * c);
        (self.angular_acceleration_rad_s2, model_variance + noise)
    }

    /// Gates on a vector sample; true: it must wait for the IMU.
    fn accept_vector(
        &mut self,
        stamp_ns: i64,
        direction_b: &Vector3<f64>,
    ) -> Result<(Unit<Vector3<f64>>, bool), Rejection> {
        let vector = self.parameters.vector.ok_or(Rejection::NotUsable)?;
        let direction = unit(*direction_b).map_err(|_| Rejection::NotFinite)?;
        let imu = self.previous.ok_or(Rejection::TooEarly)?;
        if let Some(newest_ns) = self.vector.samples.newest_ns {
            if stamp_ns == newest_ns {
                return Err(Rejection::DuplicateStamp);
            }
            if stamp_ns < newest_ns {
                return Err(Rejection::OutOfOrder);
            }
        }
        let age_s = seconds(imu.stamp_ns, stamp_ns);
        if age_s > vector.max_age_s {
            return Err(Rejection::Late);
        }
        if -age_s > vector.max_age_s {
            return Err(Rejection::TooEarly);
        }
        self.vector.samples.newest_ns = Some(stamp_ns);
        if self.vector.samples.is_frozen(direction_b, self.parameters.frozen_samples) {
            return Err(Rejection::Frozen);
        }
        Ok((direction, age_s < 0.0))
    }

    /// Corrects with a direction taken at `stamp_ns`, not after the newest IMU sample.
    fn apply_vector(
        &mut self,
        stamp_ns: i64,
        direction_b: Unit<Vector3<f64>>,
        event: &mut Option<FilterEvent>,
    ) -> Verdict {
        let (Some(vector), Some(imu)) = (self.parameters.vector, self.previous) else {
            return Verdict::Rejected(Rejection::NotUsable);
        };
        let Some(q_inertial_then) = self.history.at(stamp_ns) else {
            self.vector.samples.reject(Rejection::Late);
            return Verdict::Rejected(Rejection::Late);
        };
        let measured_w = self.q_world_inertial * (q_inertial_then * direction_b.into_inner());
        if let Some(start) = &mut self.start {
            start.add_vector(&self.parameters, stamp_ns, measured_w, direction_b.into_inner());
            self.vector.samples.accept(stamp_ns);
            return Verdict::Collected;
        }
        // What the bias error turned since: delta(then) = delta(now) + R age bias_error.
        let since = self.rotation * seconds(imu.stamp_ns, stamp_ns);
        let (result, dof) = self.vector_update(&vector, &measured_w, &since);
        let (verdict, lost) = self.vector.record(&result, dof, stamp_ns, vector.recovery_s);
        match result {
            Ok(correction) => self.apply(&correction, dof),
            Err(Outlier(nis)) => self.nis = Some((nis, dof)),
        }
        if lost {
            self.covariance.forget_heading(UNKNOWN_HEADING_VARIANCE);
            *event = Some(FilterEvent::HeadingForgotten);
        }
        verdict
    }

    fn vector_update(
        &mut self,
        vector: &VectorParameters,
        measured_w: &Vector3<f64>,
        since: &Matrix3<f64>,
    ) -> (Result<Correction, Outlier>, u8) {
        let variance = vector.noise_rad * vector.noise_rad;
        let coarse = self.covariance.attitude.m33 > COARSE_HEADING_VARIANCE;
        if vector.usage == VectorUse::Heading || coarse {
            let (innovation, attitude) = heading_residual(measured_w, &vector.reference_w);
            let horizontal = vector.reference_w.x.powi(2) + vector.reference_w.y.powi(2);
            let heading_only = vector.usage == VectorUse::Heading;
            let measurement = ScalarMeasurement {
                innovation,
                attitude,
                bias: since.tr_mul(&attitude),
                noise: variance / horizontal,
                corrects: if heading_only { Vector3::z() } else { Vector3::repeat(1.0) },
            };
            return (self.covariance.update_scalar(&measurement, self.constants.gate_one), 1);
        }
        let columns = &self.constants.vector_across;
        let residual = direction_residual(measured_w, &vector.reference_w);
        let measurement = Measurement {
            innovation: components(columns, &residual),
            attitude: *columns,
            bias: Some(since.tr_mul(columns)),
            noise: Matrix2::identity() * variance,
        };
        (self.covariance.update(&measurement, self.constants.gate_two), 2)
    }

    /// Moves the estimate and resets the error to zero. The error is kept in world axes, where
    /// the reset leaves the unobserved heading direction in place; it needs no transport.
    fn apply(&mut self, correction: &Correction, dof: u8) {
        self.q_world_inertial = quaternion_exp(&correction.attitude_rad) * self.q_world_inertial;
        self.q_world_inertial.renormalize_fast();
        self.bias_rad_s += correction.bias_rad_s;
        self.update_rotation();
        self.nis = Some((correction.nis, dof));
    }

    fn try_finish_start(&mut self, now_ns: i64, event: &mut Option<FilterEvent>) {
        let Some(start) = &self.start else {
            return;
        };
        let q_carried_body = self.q_world_inertial * self.q_inertial_body;
        let bias = &self.covariance.bias;
        if let Some(first) = start.finish(&self.parameters, now_ns, bias, &q_carried_body) {
            self.q_world_inertial = first.q_world_carried * self.q_world_inertial;
            self.bias_rad_s += first.bias_change_rad_s;
            self.covariance = first.covariance;
            self.update_rotation();
            self.start = None;
            *event = Some(if first.with_vector {
                FilterEvent::StartedWithVector
            } else {
                FilterEvent::StartedWithoutVector
            });
        }
    }

    /// Begins a start window at `stamp_ns`, keeping the bias and the frame carried so far.
    fn restart(&mut self, stamp_ns: i64) {
        self.start = Some(Start::new(stamp_ns));
        self.history = History::new();
        self.history.push(stamp_ns, self.q_inertial_body);
        self.pending = None;
        self.accelerometer.forget_outliers();
        self.vector.forget_outliers();
    }

    fn update_rotation(&mut self) {
        let q = self.q_world_inertial * self.q_inertial_body;
        self.rotation = *q.to_rotation_matrix().matrix();
    }

    fn is_finite(&self) -> bool {
        let covariance = &self.covariance;
        (self.rotation.sum()
            + self.bias_rad_s.sum()
            + covariance.attitude.trace()
            + covariance.bias.trace()
            + covariance.cross.sum())
        .is_finite()
    }
}

/// The vertical as the accelerometer sees it.
struct Vertical {
    /// Length of the specific force without lever-arm terms \[m/s^2\].
    length_m_s2: f64,
    /// That force, body axes \[m/s^2\].
    force_b: Vector3<f64>,
    measurement: Measurement,
}

fn seconds(later_ns: i64, earlier_ns: i64) -> f64 {
    later_ns.saturating_sub(earlier_ns) as f64 * 1e-9
}
