//! What is kept of one platform, gathered while a run is read.

use std::collections::VecDeque;

use nalgebra::Vector3;
use whorl_math::{EulerAngles, EulerSequence, deg_from_rad, rpm_from_rad_s};
use whorl_msgs::geometry_msgs::Quaternion;
use whorl_msgs::sensor_msgs::JointState;
use whorl_msgs::whorl::{AttitudeEstimate, ControlStatus, ModelFit, ParameterEstimate, ThrusterState};

use crate::frames::Frame;
use crate::series::{AttitudeSeries, GrowingCurve, Rms};
use crate::times::{GAP_S, Holds, Recorded, Span};

/// A sample older than this is not shown in the replay \[s\].
const STALE_S: f64 = 1.0;
/// How long samples are kept for interpolation \[s\].
const KEPT_S: f64 = 2.0;
/// Share of the first pressure at which a tank is empty: below it a regulator has nothing left to regulate.
const EMPTY: f64 = 0.02;

/// A state and since when \[s\].
pub(crate) type Change<T> = (f64, T);

/// Everything one platform published or was sent, as far as a report needs it.
#[derive(Debug, Clone, Default)]
pub struct PlatformData {
    /// Mass properties estimated while the platform moved; about one a second.
    pub parameters: Vec<Recorded<ParameterEstimate>>,
    /// Whether it moved as its model says; about one a second.
    pub fit: Vec<Recorded<ModelFit>>,
    /// z-y-x angles \[deg\].
    pub(crate) estimate: AngleCurves,
    pub(crate) truth: AngleCurves,
    pub(crate) reference: AngleCurves,
    /// Error of the estimate, world axes \[deg\].
    pub(crate) estimator_error: [GrowingCurve; 3],
    /// Three sigma of the filter's largest axis \[deg\].
    pub(crate) three_sigma: GrowingCurve,
    /// Estimated and true gyro bias \[deg/s\].
    pub(crate) bias: [GrowingCurve; 3],
    pub(crate) true_bias: [GrowingCurve; 3],
    /// Angle that the bearing limits \[deg\].
    pub(crate) tilt: GrowingCurve,
    /// Control error, body axes \[deg\].
    pub(crate) control_error: [GrowingCurve; 3],
    /// Torque achieved and asked for, body axes \[mN m\].
    pub(crate) torque: [GrowingCurve; 3],
    pub(crate) torque_asked: [GrowingCurve; 3],
    /// Name and speed of each wheel \[rpm\].
    pub(crate) wheels: Vec<(String, GrowingCurve)>,
    /// Name, angle \[deg\] and rate \[deg/s\] of each gimbal.
    pub(crate) gimbals: Vec<(String, [GrowingCurve; 2])>,
    /// Open time of each jet \[s\].
    pub(crate) jets: Vec<GrowingCurve>,
    /// Gas used \[g\].
    pub(crate) gas: GrowingCurve,
    /// \[MPa\]
    pub(crate) tank_pressure: GrowingCurve,
    pub(crate) numbers: Numbers,
    /// Mode and reason of control, its failed jets, health of the estimate.
    pub(crate) modes: Vec<Change<(u8, u8)>>,
    pub(crate) failed_jets: Vec<Change<Vec<bool>>>,
    pub(crate) health: Vec<Change<u8>>,
    /// Of the last status of control \[s\].
    pub(crate) last_status_s: f64,
    pub(crate) tank: Tank,
    /// On the replay's grid.
    pub(crate) frames: Vec<Frame>,
    /// Without curves and frames.
    pub(crate) numbers_only: bool,
}

/// Sums over a run.
#[derive(Debug, Clone)]
pub(crate) struct Numbers {
    /// Error of the estimate: angle, about the vertical, across it \[rad\].
    pub estimator: [Rms; 3],
    /// Angle between truth and reference in hold \[rad\].
    pub pointing: Rms,
    pub gas_used_kg: f64,
    pub jet_on_time_s: f64,
    pub wheel_speed_max_rad_s: f64,
    pub allocation_fallbacks: u64,
    pub rejected_samples: u32,
    /// While the experiment ran: age of the estimate at each step \[s\].
    pub ages_s: Vec<f64>,
    pub alpha_min: f64,
    pub not_tracking_s: f64,
    pub safe_s: f64,
    pub uncommanded_s: f64,
}

impl Default for Numbers {
    fn default() -> Self {
        Self {
            estimator: [Rms::default(); 3],
            pointing: Rms::default(),
            gas_used_kg: f64::NAN,
            jet_on_time_s: f64::NAN,
            wheel_speed_max_rad_s: f64::NAN,
            allocation_fallbacks: 0,
            rejected_samples: 0,
            ages_s: Vec::new(),
            alpha_min: f64::NAN,
            not_tracking_s: 0.0,
            safe_s: 0.0,
            uncommanded_s: 0.0,
        }
    }
}

/// The pressure of a tank.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Tank {
    first: Option<f64>,
    /// Before there was any pressure.
    full_s: Option<f64>,
    last: Option<(f64, f64)>,
}

impl Tank {
    fn add(&mut self, time_s: f64, pressure: f64) {
        if self.first.is_none() && pressure > 0.0 {
            self.first = Some(pressure);
        }
        if self.first.is_some_and(|first| !Self::is_empty(pressure, first)) {
            self.full_s = Some(time_s);
        }
        self.last = Some((time_s, pressure));
    }

    fn is_empty(pressure: f64, first: f64) -> bool {
        pressure < EMPTY * first
    }

    /// When the pressure fell below [`EMPTY`] of what it was at first \[s\]. It stays low; one reading may be a
    /// disturbance.
    pub fn empty_since_s(self) -> Option<f64> {
        let (time_s, _) =
            self.last.filter(|(_, pressure)| Self::is_empty(*pressure, self.first.unwrap_or(0.0)))?;
        Some(self.full_s.unwrap_or(time_s))
    }
}

/// The three z-y-x angles of an attitude over time \[deg\], unwrapped so that a full turn draws no vertical line.
#[derive(Debug, Clone, Default)]
pub(crate) struct AngleCurves {
    pub curves: [GrowingCurve; 3],
    previous_rad: Option<[f64; 3]>,
    /// Time of the first attitude \[s\].
    pub first_s: Option<f64>,
}

impl AngleCurves {
    fn push(&mut self, time_s: f64, q: &nalgebra::UnitQuaternion<f64>) {
        let angles = EulerAngles::from_quaternion(q, EulerSequence::E321).angles_rad;
        let previous = self.previous_rad.unwrap_or(angles.into());
        let continuous =
            std::array::from_fn(|i| previous[i] + whorl_math::wrap_angle_rad(angles[i] - previous[i]));
        for (curve, angle) in self.curves.iter_mut().zip(continuous) {
            curve.push(time_s, deg_from_rad(angle));
        }
        self.previous_rad = Some(continuous);
        self.first_s.get_or_insert(time_s);
    }
}

/// The last few seconds of a platform, for what needs more than one topic.
#[derive(Debug, Clone, Default)]
pub(crate) struct Window {
    pub truth: AttitudeSeries,
    pub estimate: AttitudeSeries,
    pub reference: AttitudeSeries,
    control: VecDeque<Status>,
    /// Statuses in `control` that have been evaluated.
    evaluated: usize,
    /// The last status while the experiment ran.
    before: Option<Status>,
    thrusters: VecDeque<(f64, Vec<f64>)>,
    /// Estimates and references up to here have been evaluated \[s\].
    pub estimates_to_s: Option<f64>,
    references_to_s: Option<f64>,
}

/// What later evaluation needs of a status of control.
#[derive(Debug, Clone, Copy)]
struct Status {
    time_s: f64,
    mode: u8,
    reason: u8,
    age_s: f64,
    alpha: f64,
    momentum: Vector3<f64>,
    gas_used_kg: f64,
}

impl Status {
    fn safe(&self) -> bool {
        matches!(self.mode, ControlStatus::MODE_SAFE_DAMPING | ControlStatus::MODE_SAFE_COAST)
    }

    fn uncommanded(&self) -> bool {
        matches!(self.mode, ControlStatus::MODE_IDLE | ControlStatus::MODE_HOLD)
            && matches!(
                self.reason,
                ControlStatus::REASON_NO_AUTHORITY | ControlStatus::REASON_REFERENCE_STALE
            )
    }
}

impl Window {
    /// What the platform looked like at a time.
    pub fn frame(&self, time_s: f64) -> Frame {
        let actual = if self.truth.is_empty() { &self.estimate } else { &self.truth };
        let status = latest(&self.control, time_s, |s| s.time_s);
        Frame {
            q_world_body: actual.at(time_s, STALE_S),
            q_world_reference: self.reference.at(time_s, STALE_S),
            momentum_and_gas: status.map(|s| (s.momentum, s.gas_used_kg)),
            on_time_s: latest(&self.thrusters, time_s, |t| t.0).map(|t| t.1.clone()),
        }
    }

    /// Drops what is older than any later evaluation needs.
    pub fn forget(&mut self, until_s: f64) {
        let from_s = until_s - KEPT_S;
        for series in [&mut self.truth, &mut self.estimate, &mut self.reference] {
            series.forget_before(from_s);
        }
        while self.evaluated > 1 && self.control.front().is_some_and(|s| s.time_s < from_s) {
            self.control.pop_front();
            self.evaluated -= 1;
        }
        while self.thrusters.len() > 1 && self.thrusters.front().is_some_and(|t| t.0 < from_s) {
            self.thrusters.pop_front();
        }
    }
}

/// The latest sample at a time, unless it is stale.
fn latest<T>(samples: &VecDeque<T>, time_s: f64, of: impl Fn(&T) -> f64) -> Option<&T> {
    let after = samples.partition_point(|sample| of(sample) <= time_s);
    let latest = samples.get(after.checked_sub(1)?)?;
    (time_s - of(latest) <= STALE_S).then_some(latest)
}

fn push3(curves: &mut [GrowingCurve; 3], time_s: f64, scale: f64, vector: impl Into<Vector3<f64>>) {
    let vector = vector.into();
    curves.iter_mut().zip(vector.iter()).for_each(|(curve, value)| curve.push(time_s, value * scale));
}

fn note<T: PartialEq>(changes: &mut Vec<Change<T>>, time_s: f64, state: T) {
    if changes.last().is_none_or(|(_, last)| *last != state) {
        changes.push((time_s, state));
    }
}

impl PlatformData {
    pub(crate) fn add_estimate(&mut self, window: &mut Window, time_s: f64, m: &AttitudeEstimate) {
        note(&mut self.health, time_s, m.health);
        self.numbers.rejected_samples = m.rejected_samples;
        if !m.usable() {
            return;
        }
        let q = window.estimate.push(time_s, m.q_world_body);
        if self.numbers_only {
            return;
        }
        if let Some(q) = q {
            self.estimate.push(time_s, &q);
        }
        push3(&mut self.bias, time_s, deg_from_rad(1.0), m.gyro_bias_b_rad_s);
        let diagonal = [0, 7, 14].into_iter().filter_map(|i| m.covariance.get(i));
        let variance = diagonal.fold(0.0, |a, b| f64::max(a, *b));
        self.three_sigma.push(time_s, 3.0 * deg_from_rad(variance.sqrt()));
    }

    pub(crate) fn add_truth(&mut self, window: &mut Window, time_s: f64, m: &AttitudeEstimate) {
        let q = window.truth.push(time_s, m.q_world_body);
        if self.numbers_only {
            return;
        }
        if let Some(q) = q {
            self.truth.push(time_s, &q);
        }
        if m.usable() {
            push3(&mut self.true_bias, time_s, deg_from_rad(1.0), m.gyro_bias_b_rad_s);
        }
    }

    pub(crate) fn add_reference(&mut self, window: &mut Window, time_s: f64, q: Quaternion) {
        if let Some(q) = window.reference.push(time_s, q).filter(|_| !self.numbers_only) {
            self.reference.push(time_s, &q);
        }
    }

    pub(crate) fn add_control(&mut self, window: &mut Window, time_s: f64, m: &ControlStatus) {
        note(&mut self.modes, time_s, (m.mode, m.reason));
        if self.failed_jets.last().is_none_or(|(_, last)| *last != m.jet_failed) {
            self.failed_jets.push((time_s, m.jet_failed.clone()));
        }
        self.last_status_s = time_s;
        // Control counts what it commands. From an empty tank nothing flows.
        if self.tank.empty_since_s().is_none() || self.numbers.gas_used_kg.is_nan() {
            self.numbers.gas_used_kg = m.gas_used_kg;
        }
        let gas_used_kg = self.numbers.gas_used_kg;
        self.numbers.allocation_fallbacks = m.allocation_fallbacks;
        if !self.numbers_only {
            self.tilt.push(time_s, deg_from_rad(m.tilt_rad));
            push3(&mut self.control_error, time_s, deg_from_rad(1.0), m.attitude_error_b_rad);
            push3(&mut self.torque, time_s, 1e3, m.torque_achieved_b_n_m);
            push3(&mut self.torque_asked, time_s, 1e3, m.torque_commanded_b_n_m);
            self.gas.push(time_s, gas_used_kg * 1e3);
        }
        window.control.push_back(Status {
            time_s,
            mode: m.mode,
            reason: m.reason,
            age_s: m.estimate_age_s,
            alpha: m.alpha,
            momentum: m.wheel_momentum_b_n_m_s.into(),
            gas_used_kg,
        });
    }

    pub(crate) fn add_wheels(&mut self, time_s: f64, m: &JointState) {
        let largest = &mut self.numbers.wheel_speed_max_rad_s;
        *largest = m.velocity.iter().fold(*largest, |max, speed| max.max(speed.abs()));
        if self.numbers_only {
            return;
        }
        // The wheels are those of the first message.
        if self.wheels.is_empty() {
            self.wheels.extend(m.name.iter().map(|name| (name.clone(), GrowingCurve::default())));
        }
        for ((_, curve), speed) in self.wheels.iter_mut().zip(&m.velocity) {
            curve.push(time_s, rpm_from_rad_s(*speed));
        }
    }

    pub(crate) fn add_gimbals(&mut self, time_s: f64, m: &JointState) {
        if self.numbers_only {
            return;
        }
        if self.gimbals.is_empty() {
            self.gimbals.extend(m.name.iter().map(|name| (name.clone(), Default::default())));
        }
        for ((_, [angle, rate]), (q, v)) in self.gimbals.iter_mut().zip(m.position.iter().zip(&m.velocity)) {
            angle.push(time_s, deg_from_rad(*q));
            rate.push(time_s, deg_from_rad(*v));
        }
    }

    pub(crate) fn add_thrusters(&mut self, window: &mut Window, time_s: f64, m: &ThrusterState) {
        self.numbers.jet_on_time_s = m.total_on_time_s.iter().sum();
        if self.numbers_only {
            return;
        }
        let jets = m.total_on_time_s.len().max(self.jets.len());
        self.jets.resize_with(jets, GrowingCurve::default);
        for (curve, total) in self.jets.iter_mut().zip(&m.total_on_time_s) {
            curve.push(time_s, *total);
        }
        window.thrusters.push_back((time_s, m.total_on_time_s.clone()));
    }

    pub(crate) fn add_tank_pressure(&mut self, time_s: f64, pressure_pa: f64) {
        self.tank.add(time_s, pressure_pa);
        if !self.numbers_only {
            self.tank_pressure.push(time_s, pressure_pa * 1e-6);
        }
    }

    /// Evaluates the window up to a time.
    pub(crate) fn evaluate(&mut self, window: &mut Window, until_s: f64, running: Span, holds: &Holds) {
        for (t, q) in window.estimate.between(window.estimates_to_s, until_s) {
            window.estimates_to_s = Some(t);
            let Some(truth) = window.truth.at(t, GAP_S) else { continue };
            // Rotation from the estimated to the true attitude, in world axes.
            let error = whorl_math::rotation_vector(&(truth * q.inverse()));
            if !self.numbers_only {
                push3(&mut self.estimator_error, t, deg_from_rad(1.0), error);
            }
            let parts = [error.norm(), error.z, error.x.hypot(error.y)];
            self.numbers.estimator.iter_mut().zip(parts).for_each(|(rms, part)| rms.add(part));
        }
        for (t, reference) in window.reference.between(window.references_to_s, until_s) {
            window.references_to_s = Some(t);
            if holds.contain(t)
                && let Some(truth) = window.truth.at(t, GAP_S)
            {
                self.numbers.pointing.add(truth.angle_to(&reference));
            }
        }
        while let Some(status) = window.control.get(window.evaluated).filter(|s| s.time_s < until_s) {
            window.evaluated += 1;
            // Before the start the controller idles; its numbers are not part of the run's.
            if !running.contains(status.time_s) {
                continue;
            }
            self.numbers.add(window.before.as_ref(), status);
            window.before = Some(*status);
        }
    }
}

impl Numbers {
    fn add(&mut self, before: Option<&Status>, status: &Status) {
        self.ages_s.push(status.age_s);
        self.alpha_min = self.alpha_min.min(status.alpha);
        let Some(before) = before else { return };
        let dt_s = status.time_s - before.time_s;
        let states = [before.mode != ControlStatus::MODE_TRACK, before.safe(), before.uncommanded()];
        let totals = [&mut self.not_tracking_s, &mut self.safe_s, &mut self.uncommanded_s];
        totals.into_iter().zip(states).filter(|(_, holds)| *holds).for_each(|(total, _)| *total += dt_s);
    }
}
