//! The attitude-error / gyro-bias estimator, and what supervises every filter: gates, start, late samples, restarts and
//! health.

mod contradicted;
mod gravity_window;
mod history;
mod imu;
mod monitor;
mod outcome;
mod start;
mod vector;

pub use outcome::{FilterEvent, ImuOutcome, Rejection, RejectionCounts, SampleOutcome};
pub(crate) use outcome::{UsedDirection, UsedSample};

use crate::estimate::{Estimate, Flags, Health};
use crate::kernels::attitude_bias::AttitudeBias;
use crate::kernels::attitude_bias::covariance::Correction;
use crate::parameters::{ParameterError, Parameters};
use crate::residual::across;
use gravity_window::GravityWindow;
use history::History;
use monitor::{SampleMonitor, SensorMonitor};
use nalgebra::{Matrix3, Matrix3x2, Matrix6, Unit, UnitQuaternion, Vector3};
use start::{Carried, Start};
use whorl_free_motion::{AxisCheck, Clipping, Contradiction};
use whorl_math::quaternion_exp;

/// Heading variance above which a vector sample corrects the heading alone, whose innovation is
/// exact for any angle \[rad^2\] (18 deg).
const COARSE_HEADING_VARIANCE: f64 = 0.1;

/// Heading variance of "unknown" \[rad^2\]: a uniform angle has pi^2/3; some margin.
const UNKNOWN_HEADING_VARIANCE: f64 = 4.0;

/// This many consecutive stamps before the newest one mean that the clock was set back.
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
}

/// Attitude and gyro bias from gyro, accelerometer and an optional vector sensor.
///
/// The filter of the dissertation's section 4.5.4 (eqs. 4.69-4.72): the gyro drives the
/// attitude, its bias is a state, the accelerometer keeps its lever-arm terms (as a difference of
/// velocities over a window, so that no rate is differentiated). It differs from the
/// printed one in three ways:
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
/// A pure state machine, without allocation while its sensors agree: `Clone` is the save and the restore.
#[derive(Clone, Debug, PartialEq)]
pub struct AttitudeBiasEstimator {
    parameters: Parameters,
    constants: Constants,
    /// The averages of the start; `None` once the attitude is known.
    start: Option<Start>,
    previous: Option<PreviousImu>,
    state: AttitudeBias,
    /// The running average of the specific force; `None` until a good sample starts it.
    gravity: Option<GravityWindow>,
    /// The latest propagation interval, for the accelerometer half of the sample.
    interval: Interval,
    /// Peak-held deviation of the specific force's length from gravity \[m/s^2\].
    deviation_m_s2: f64,
    history: History,
    /// A vector sample ahead of the IMU.
    pending: Option<(i64, Unit<Vector3<f64>>)>,
    gyro: SampleMonitor,
    accelerometer: SensorMonitor,
    vector: SensorMonitor,
    /// Latest normalised innovation squared and its degrees of freedom.
    nis: Option<(f64, u8)>,
    backward_stamps: u32,
    clipping: Clipping,
    /// Whether the latest sample stood at the end of the gyro's range.
    is_clipped: bool,
    axes: AxisCheck,
    /// What turns against the gyro and is not used: accelerometer, vector sensor.
    contradicted: [Option<Contradiction>; 2],
}

/// The last accepted gyro sample, and a suspected spike after it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct PreviousImu {
    stamp_ns: i64,
    gyro_rad_s: Vector3<f64>,
    suspect_rad_s: Option<Vector3<f64>>,
}

/// The step of the latest propagation.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Interval {
    dt_s: f64,
    /// Rotation matrix, mean of the start and the end of the step.
    mean_rotation: Matrix3<f64>,
}

/// Worked out once from the parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Constants {
    gyro_noise_density: f64,
    bias_walk_density: f64,
    /// Only gravity acts on the accelerometer: every sample is a separate measurement.
    every_sample: bool,
    gate_one: f64,
    gate_two: f64,
    vector_across: Matrix3x2<f64>,
}

impl Constants {
    fn new(parameters: &Parameters) -> Self {
        let moves = parameters.accelerometer_position_b_m != Vector3::zeros()
            || parameters.accelerometer_velocity_sigma_m_s > 0.0;
        let reference = parameters.vector.map_or(Vector3::x_axis(), |v| v.reference_w);
        Self {
            gyro_noise_density: parameters.gyro_noise_rad_s_sqrt_hz.powi(2),
            bias_walk_density: parameters.gyro_bias_walk_rad_s2_sqrt_hz.powi(2),
            every_sample: !moves,
            gate_one: whorl_math::statistics::chi_squared_quantile(1.0 - parameters.outlier_probability, 1),
            // The quantile of two degrees of freedom has a closed form.
            gate_two: -2.0 * parameters.outlier_probability.ln(),
            vector_across: across(&reference),
        }
    }
}

impl AttitudeBiasEstimator {
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
            state: AttitudeBias::unknown(bias_variance),
            gravity: None,
            deviation_m_s2: 0.0,
            interval: Interval { dt_s: 0.0, mean_rotation: Matrix3::identity() },
            history: History::new(),
            pending: None,
            gyro: SampleMonitor::default(),
            accelerometer: SensorMonitor::default(),
            vector: SensorMonitor::default(),
            nis: None,
            backward_stamps: 0,
            clipping: Clipping::default(),
            is_clipped: false,
            axes: AxisCheck::default(),
            contradicted: [None, None],
            parameters,
        })
    }

    /// Samples at the end of the gyro's range.
    #[must_use]
    pub fn clipping(&self) -> &Clipping {
        &self.clipping
    }

    /// Whether the latest sample stood at the end of the gyro's range: filters that do not know must not go on by themselves.
    pub(crate) fn is_clipped(&self) -> bool {
        self.is_clipped
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
        filter.state = AttitudeBias::known(q_world_body, gyro_bias_rad_s, covariance);
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
        self.supervise_imu(sample).0
    }

    /// The same, with what a filter that runs beside may use of the sample.
    pub(crate) fn supervise_imu(&mut self, sample: &ImuSample) -> (ImuOutcome, UsedSample) {
        self.nis = None;
        let mut used = UsedSample::default();
        let mut event = None;
        if let Err(rejection) = self.accept_gyro(sample, &mut event) {
            self.gyro.reject(rejection);
            let outcome = ImuOutcome {
                gyro: SampleOutcome::Rejected(rejection),
                accelerometer: SampleOutcome::Rejected(Rejection::NotUsable),
                vector: None,
                event,
            };
            return (outcome, used);
        }
        self.gyro.accept(sample.stamp_ns);
        self.propagate(sample, &mut event);
        let vector = match self.pending {
            Some((stamp_ns, direction_b)) if stamp_ns <= sample.stamp_ns => {
                self.pending = None;
                let (outcome, direction) = self.apply_vector(stamp_ns, direction_b, &mut event);
                used.vector = direction;
                Some(outcome)
            }
            _ => None,
        };
        self.compare_axes(sample, &mut event);
        let (accelerometer, vertical) = self.use_specific_force(sample, &mut event);
        used.vertical = vertical;
        self.try_finish_start(sample.stamp_ns, &mut event);
        if !self.state.is_finite() {
            self.state = AttitudeBias::unknown(self.parameters.initial_bias_sigma_rad_s.powi(2));
            self.deviation_m_s2 = 0.0;
            self.restart(sample.stamp_ns);
            event = Some(FilterEvent::RestartedAfterDivergence);
        }
        let gyro = if self.start.is_some() { SampleOutcome::Collected } else { SampleOutcome::Used };
        used.interval_s = self.interval.dt_s;
        (ImuOutcome { gyro, accelerometer, vector, event }, used)
    }

    /// Takes in one direction of the vector sensor, body axes, any length above zero.
    ///
    /// It may be late by up to the sensor's `max_age_s`; ahead of the IMU it waits for the sample
    /// that follows.
    pub fn on_vector(
        &mut self,
        stamp_ns: i64,
        direction_b: &Vector3<f64>,
    ) -> (SampleOutcome, Option<FilterEvent>) {
        let (outcome, _, event) = self.supervise_vector(stamp_ns, direction_b);
        (outcome, event)
    }

    /// The same, with what a filter that runs beside may use of the sample.
    pub(crate) fn supervise_vector(
        &mut self,
        stamp_ns: i64,
        direction_b: &Vector3<f64>,
    ) -> (SampleOutcome, Option<UsedDirection>, Option<FilterEvent>) {
        self.nis = None;
        let mut event = None;
        let (outcome, used) = match self.accept_vector(stamp_ns, direction_b) {
            Err(rejection) => {
                self.vector.samples.reject(rejection);
                (SampleOutcome::Rejected(rejection), None)
            }
            Ok((direction_b, true)) => {
                self.pending = Some((stamp_ns, direction_b));
                (SampleOutcome::Deferred, None)
            }
            Ok((direction_b, false)) => self.apply_vector(stamp_ns, direction_b, &mut event),
        };
        (outcome, used, event)
    }

    /// The estimate at the newest IMU sample; `now_ns` decides only what is stale.
    #[must_use]
    pub fn estimate(&self, now_ns: i64) -> Estimate {
        let stamp_ns = self.previous.map_or(now_ns, |p| p.stamp_ns);
        let gyro_rad_s = self.previous.map_or(self.state.bias_rad_s, |p| p.gyro_rad_s);
        let (health, flags) = self.health(now_ns);
        Estimate {
            stamp_ns,
            q_world_body: self.state.q_world_body(),
            omega_wb_b_rad_s: gyro_rad_s - self.state.bias_rad_s,
            gyro_bias_b_rad_s: self.state.bias_rad_s,
            covariance: self.state.covariance.in_body_axes(self.state.rotation()),
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
        let tilt_variance = self.state.covariance.attitude.m11.max(self.state.covariance.attitude.m22);
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

    /// Moves the estimate, and with it what was averaged in its frame.
    fn apply(&mut self, correction: &Correction, dof: u8) {
        if let Some(window) = &mut self.gravity {
            let turn = quaternion_exp(&correction.attitude_rad);
            window.correct(&turn, &correction.bias_rad_s, &self.parameters);
        }
        self.state.apply(correction);
        self.nis = Some((correction.nis, dof));
    }

    fn try_finish_start(&mut self, now_ns: i64, event: &mut Option<FilterEvent>) {
        let Some(start) = &self.start else {
            return;
        };
        let gyro_rad_s = self.previous.map_or(self.state.bias_rad_s, |p| p.gyro_rad_s);
        let carried = Carried {
            q_carried_body: self.state.q_world_body(),
            omega: gyro_rad_s - self.state.bias_rad_s,
            bias_covariance: &self.state.covariance.bias,
        };
        if let Some(first) = start.finish(&self.parameters, now_ns, &carried) {
            self.state.begin(&first.q_world_carried, &first.bias_change_rad_s, first.covariance);
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
        self.start = Some(Start::new(stamp_ns, self.state.q_world_body()));
        self.gravity = None;
        self.interval = Interval { dt_s: 0.0, mean_rotation: *self.state.rotation() };
        self.history = History::new();
        self.history.push(stamp_ns, self.state.q_inertial_body);
        self.pending = None;
        self.accelerometer.forget_outliers();
        self.vector.forget_outliers();
    }
}

fn seconds(later_ns: i64, earlier_ns: i64) -> f64 {
    later_ns.saturating_sub(earlier_ns) as f64 * 1e-9
}
