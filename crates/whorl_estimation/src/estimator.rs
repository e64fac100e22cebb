//! A chosen filter, supervised by the attitude and gyro-bias estimator.

use crate::body::BodyModel;
use crate::estimate::{Estimate, Health};
use crate::kernels::{AnyKernel, FilterKind, FilterStep, Kernel, KernelStart, Solution, Update};
use crate::parameters::{ParameterError, Parameters};
use crate::supervision::{
    AttitudeBiasEstimator, FilterEvent, ImuOutcome, ImuSample, Rejection, RejectionCounts, SampleOutcome,
    UsedDirection,
};
use nalgebra::{Matrix6, UnitQuaternion, Vector3};
use thiserror::Error;
use whorl_free_motion::{Clipping, Contradiction};
use whorl_math::rotation_vector;

/// Wheel speeds older than this are not used \[s\].
const WHEELS_MAX_AGE_S: f64 = 0.1;

/// A kernel that differs from the supervising filter by more than this many standard deviations (of both
/// together) ...
const DISAGREEMENT_SIGMAS: f64 = 8.0;
/// ... for this many samples restarts from it.
const DISAGREEMENT_SAMPLES: u32 = 200;

/// Why an estimator cannot be built.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum EstimatorError {
    /// A parameter is outside its range.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// The filter computes with the body's dynamics and was given none.
    #[error("filter {0} needs the body's inertia and gravity offset")]
    NoBody(&'static str),
}

/// Any filter of [`FilterKind`], or another kernel, with gates, start, late samples and health.
///
/// A pure state machine without allocation: `Clone` is the save and the restore.
#[derive(Clone, Debug)]
pub struct Estimator<K = AnyKernel> {
    kind: FilterKind<K>,
    supervisor: AttitudeBiasEstimator,
    body: Option<BodyModel>,
    kernel: Option<K>,
    /// What the kernel says, where it has been asked since it last changed.
    solution: Option<Solution>,
    update: Update,
    wheels: Option<Wheels>,
    jet_impulse_b_n_m_s: Vector3<f64>,
    gyro_before_rad_s: Vector3<f64>,
    disagreements: u32,
    /// Latest sample of a filter with gates of its own.
    ungated_ns: Option<i64>,
}

#[derive(Clone, Copy, Debug)]
struct Wheels {
    stamp_ns: i64,
    momentum_b_n_m_s: Vector3<f64>,
    torque_b_n_m: Vector3<f64>,
}

impl<K: Kernel> Estimator<K> {
    /// An estimator that finds its first attitude from its first samples.
    ///
    /// # Errors
    /// A parameter that is not allowed, or no body for a filter that needs one.
    pub fn new(
        kind: FilterKind<K>,
        parameters: Parameters,
        body: Option<BodyModel>,
    ) -> Result<Self, EstimatorError> {
        Self::around(kind, AttitudeBiasEstimator::new(parameters)?, body)
    }

    /// An estimator that starts from a known attitude; see [`AttitudeBiasEstimator::with_attitude`].
    ///
    /// # Errors
    /// As [`Self::new`], and an invalid covariance.
    pub fn with_attitude(
        kind: FilterKind<K>,
        parameters: Parameters,
        body: Option<BodyModel>,
        stamp_ns: i64,
        q_world_body: UnitQuaternion<f64>,
        gyro_bias_rad_s: Vector3<f64>,
        covariance: &Matrix6<f64>,
    ) -> Result<Self, EstimatorError> {
        let filter = AttitudeBiasEstimator::with_attitude(
            parameters,
            stamp_ns,
            q_world_body,
            gyro_bias_rad_s,
            covariance,
        )?;
        Self::around(kind, filter, body)
    }

    fn around(
        kind: FilterKind<K>,
        supervisor: AttitudeBiasEstimator,
        body: Option<BodyModel>,
    ) -> Result<Self, EstimatorError> {
        match &body {
            Some(body) => body.check()?,
            None if kind.needs_body => return Err(EstimatorError::NoBody(kind.name)),
            None => {}
        }
        Ok(Self {
            kind,
            supervisor,
            body,
            kernel: None,
            solution: None,
            update: Update::default(),
            wheels: None,
            jet_impulse_b_n_m_s: Vector3::zeros(),
            gyro_before_rad_s: Vector3::zeros(),
            disagreements: 0,
            ungated_ns: None,
        })
    }

    /// Which filter this is.
    #[must_use]
    pub fn kind(&self) -> FilterKind<K> {
        self.kind
    }

    /// Whether the estimate is that of the chosen filter. Without what it needs (wheel speeds), and for a moment at the start,
    /// it is the supervising estimator's.
    #[must_use]
    pub fn chosen_filter_runs(&self) -> bool {
        self.kind.start.is_none() || self.kernel.is_some()
    }

    /// Momentum of the wheels, or of whatever else stores it, relative to the body, and the rate at which motors change
    /// it (the torque on the wheels), body axes.
    pub fn on_wheels(&mut self, stamp_ns: i64, momentum_b_n_m_s: Vector3<f64>, torque_b_n_m: Vector3<f64>) {
        let finite = (momentum_b_n_m_s.sum() + torque_b_n_m.sum()).is_finite();
        if finite
            && self.wheels.is_none_or(|w| stamp_ns > w.stamp_ns || w.stamp_ns - stamp_ns > 1_000_000_000)
        {
            self.wheels = Some(Wheels { stamp_ns, momentum_b_n_m_s, torque_b_n_m });
        }
    }

    /// Angular impulse that the jets gave since the last call, body axes [N m s].
    pub fn on_jets(&mut self, impulse_b_n_m_s: &Vector3<f64>) {
        if impulse_b_n_m_s.sum().is_finite() {
            self.jet_impulse_b_n_m_s += impulse_b_n_m_s;
        }
    }

    /// Takes in one IMU sample; see [`AttitudeBiasEstimator::on_imu`].
    pub fn on_imu(&mut self, sample: &ImuSample) -> ImuOutcome {
        (self.update, self.solution) = (Update::default(), None);
        let (outcome, used) = self.supervisor.supervise_imu(sample);
        let spike = self.kind.own_gates && outcome.gyro.rejection() == Some(Rejection::Spike);
        if self.kind.start.is_none() || (outcome.gyro.rejection().is_some() && !spike) {
            return outcome;
        }
        if self.kind.own_gates {
            self.ungated_step(sample, &outcome);
            return outcome;
        }
        if self.supervisor.is_clipped() {
            // It goes on from the supervising filter, whose covariance has grown by what was not measured.
            self.kernel = None;
        }
        let impulse = std::mem::take(&mut self.jet_impulse_b_n_m_s);
        let before = std::mem::replace(&mut self.gyro_before_rad_s, sample.gyro_rad_s);
        let wheels = self.wheels_at(sample.stamp_ns);
        let started_anew = outcome.event.is_some_and(|e| e != FilterEvent::HeadingForgotten);
        if outcome.gyro != SampleOutcome::Used || wheels.is_none() || started_anew {
            self.kernel = None;
        }
        let Some(wheel_momentum_b_n_m_s) = wheels else { return outcome };
        if outcome.gyro != SampleOutcome::Used {
            return outcome;
        }
        let Some(kernel) = &mut self.kernel else {
            self.start(wheel_momentum_b_n_m_s);
            return outcome;
        };
        let accepted = outcome.accelerometer.rejection().is_none();
        self.update = kernel.step(&FilterStep {
            dt_s: used.interval_s,
            gyro_rad_s: sample.gyro_rad_s,
            gyro_before_rad_s: before,
            force_b_m_s2: accepted.then_some(sample.specific_force_m_s2),
            wheel_momentum_b_n_m_s,
            jet_impulse_b_n_m_s: impulse,
        });
        if let Some(vertical) = used.vertical.filter(|_| !kernel.takes_raw_force()) {
            self.update = kernel.correct_direction(&vertical.seen(Vector3::z_axis()));
        }
        self.use_vector(used.vector);
        if matches!(outcome.event, Some(FilterEvent::HeadingForgotten | FilterEvent::VectorContradicted)) {
            self.kernel = None;
        }
        self.supervise();
        outcome
    }

    /// Takes in one direction of the vector sensor; see [`AttitudeBiasEstimator::on_vector`].
    pub fn on_vector(
        &mut self,
        stamp_ns: i64,
        direction_b: &Vector3<f64>,
    ) -> (SampleOutcome, Option<FilterEvent>) {
        (self.update, self.solution) = (Update::default(), None);
        let (outcome, used, event) = self.supervisor.supervise_vector(stamp_ns, direction_b);
        if let Some(kernel) = self.kernel.as_mut().filter(|_| self.kind.own_gates) {
            if matches!(outcome.rejection(), None | Some(Rejection::Outlier { .. })) {
                kernel.take_raw_vector(direction_b);
            }
            return (outcome, event);
        }
        self.use_vector(used);
        if matches!(event, Some(FilterEvent::HeadingForgotten | FilterEvent::VectorContradicted)) {
            self.kernel = None;
        }
        (outcome, event)
    }

    /// The estimate at the newest IMU sample; `now_ns` decides only what is stale.
    #[must_use]
    pub fn estimate(&self, now_ns: i64) -> Estimate {
        let mut estimate = self.supervisor.estimate(now_ns);
        let Some(kernel) = &self.kernel else { return estimate };
        let solution = self.solution.unwrap_or_else(|| kernel.solution());
        estimate.q_world_body = solution.q_world_body;
        estimate.omega_wb_b_rad_s = solution.omega_rad_s;
        estimate.gyro_bias_b_rad_s = solution.gyro_bias_rad_s;
        estimate.covariance = solution.covariance;
        estimate.nis = (self.update.dof > 0).then_some(self.update.nis);
        estimate.nis_dof = self.update.dof;
        estimate
    }

    /// Samples at the end of the gyro's range.
    #[must_use]
    pub fn clipping(&self) -> &Clipping {
        self.supervisor.clipping()
    }

    /// What turns against the gyro and is not used: accelerometer, vector sensor.
    #[must_use]
    pub fn contradictions(&self) -> &[Option<Contradiction>; 2] {
        self.supervisor.contradictions()
    }

    /// Refused samples of gyro, accelerometer and vector sensor since the start.
    #[must_use]
    pub fn rejections(&self) -> [RejectionCounts; 3] {
        self.supervisor.rejections()
    }

    fn use_vector(&mut self, used: Option<UsedDirection>) {
        let (Some(kernel), Some(used), Some(vector)) =
            (&mut self.kernel, used, self.supervisor.parameters().vector)
        else {
            return;
        };
        self.update = kernel.correct_direction(&used.seen(vector.reference_w));
    }

    /// Momentum of the wheels at a stamp, carried on from the last message; zero without wheels.
    fn wheels_at(&self, stamp_ns: i64) -> Option<Vector3<f64>> {
        if !self.kind.needs_body || !self.body.is_some_and(|body| body.stores_momentum) {
            return Some(Vector3::zeros());
        }
        let wheels = self.wheels?;
        let age_s = stamp_ns.saturating_sub(wheels.stamp_ns) as f64 * 1e-9;
        let fresh = (-WHEELS_MAX_AGE_S..=WHEELS_MAX_AGE_S).contains(&age_s);
        fresh.then(|| wheels.momentum_b_n_m_s + wheels.torque_b_n_m * age_s)
    }

    fn start(&mut self, wheel_momentum_b_n_m_s: Vector3<f64>) {
        let estimate = self.supervisor.estimate(i64::MIN);
        let solution = Solution {
            q_world_body: estimate.q_world_body,
            omega_rad_s: estimate.omega_wb_b_rad_s,
            gyro_bias_rad_s: estimate.gyro_bias_b_rad_s,
            covariance: estimate.covariance,
            wheel_momentum_b_n_m_s,
        };
        let start = KernelStart {
            parameters: self.supervisor.parameters(),
            body: self.body.as_ref(),
            solution: &solution,
        };
        self.kernel = self.kind.start.and_then(|kernel| kernel(&start));
        self.disagreements = 0;
    }

    /// A filter with gates of its own models the motion better than the supervising one: only samples that are not
    /// measurements at all are kept from it.
    fn ungated_step(&mut self, sample: &ImuSample, outcome: &ImuOutcome) {
        let broken = |outcome: &SampleOutcome| {
            matches!(
                outcome.rejection(),
                Some(
                    Rejection::NotFinite
                        | Rejection::OutOfRange
                        | Rejection::Frozen
                        | Rejection::Contradicted
                )
            )
        };
        if broken(&outcome.accelerometer) {
            return;
        }
        let before_ns = self.ungated_ns.replace(sample.stamp_ns);
        let before_rad_s = std::mem::replace(&mut self.gyro_before_rad_s, sample.gyro_rad_s);
        let dt_s = before_ns.map_or(0.0, |before| sample.stamp_ns.saturating_sub(before) as f64 * 1e-9);
        if !(0.0..1.0).contains(&dt_s) || outcome.event == Some(FilterEvent::RestartedAfterClockStep) {
            self.kernel = None;
        }
        if self.kernel.is_none() {
            self.start(Vector3::zeros());
        } else if let Some(kernel) = &mut self.kernel
            && dt_s > 0.0
        {
            kernel.step(&FilterStep {
                dt_s,
                gyro_rad_s: sample.gyro_rad_s,
                gyro_before_rad_s: before_rad_s,
                force_b_m_s2: Some(sample.specific_force_m_s2),
                wheel_momentum_b_n_m_s: Vector3::zeros(),
                jet_impulse_b_n_m_s: Vector3::zeros(),
            });
        }
    }

    /// Drops a diverged kernel; it restarts with the next sample.
    fn supervise(&mut self) {
        let Some(kernel) = &self.kernel else { return };
        let solution = kernel.solution();
        self.solution = Some(solution);
        let supervisor = self.supervisor.estimate(i64::MIN);
        let apart = rotation_vector(&(supervisor.q_world_body.inverse() * solution.q_world_body)).norm();
        let variance = supervisor.covariance.fixed_view::<3, 3>(0, 0).trace()
            + solution.covariance.fixed_view::<3, 3>(0, 0).trace();
        if !(apart + variance + solution.omega_rad_s.sum()).is_finite() {
            self.kernel = None;
            return;
        }
        let apart = apart > DISAGREEMENT_SIGMAS * variance.sqrt();
        self.disagreements = if apart { self.disagreements + 1 } else { 0 };
        if self.disagreements > DISAGREEMENT_SAMPLES && supervisor.health != Health::Unhealthy {
            self.kernel = None;
        }
    }
}
