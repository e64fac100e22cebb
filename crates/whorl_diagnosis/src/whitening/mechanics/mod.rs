//! The equations of motion and of the sensors along a trajectory.

mod lag;
mod steps;

use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use whorl_dynamics::effects::MAX_HIDDEN_STATES;
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_dynamics::gyrostat::equation::gravity_torque_n_m;
use whorl_dynamics::platform::{TiltLimit, TriaxialErrors, Wheel};
use whorl_dynamics::sensing::specific_force_b_m_s2;
use whorl_dynamics::{Environment, Gyrostat, PlatformModel};
use whorl_math::{quaternion_exp, vertical_b};

use crate::DiagnosisError;
use crate::bins::inputs::Inputs;
use crate::bins::motion::Motion;
use crate::bins::run::{Run, Wheels};

pub(crate) use steps::{StepEnvironments, Steps};

/// A platform model ready for use along trajectories.
#[derive(Debug, Clone)]
pub(crate) struct Mechanics {
    pub gyrostat: Gyrostat,
    gyro: TriaxialErrors,
    accel: TriaxialErrors,
}

/// What the model predicts of a run from node to node.
#[derive(Debug, Clone, Default)]
pub(crate) struct Prediction {
    /// Mean angular acceleration of each interval.
    pub omega_dot: Vec<Vector3<f64>>,
    /// Mean wheel acceleration of each interval.
    pub wheel_dot: Vec<Wheels>,
    /// What the jets' and wheels' edges within a node's samples add to its mean rate.
    pub edge_rate: Vec<Vector3<f64>>,
    /// The same for the wheels' speeds.
    pub edge_speed: Vec<Wheels>,
    /// Readings at each node; empty if not asked for.
    pub gyro: Vec<Vector3<f64>>,
    pub accel: Vec<Vector3<f64>>,
    /// What the sensors' low-pass holds back of the readings at each node; empty if they have none.
    pub held_back: HeldBack,
    /// First by vector sensor.
    pub vectors: Vec<Vec<Vector3<f64>>>,
    /// How the effects' torque changes with the motion, by interval; empty if there are none.
    pub torque_slope: Vec<TorqueSlope>,
}

/// Motors and wheels at one instant; a wheel that sticks has neither speed nor torque.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Drive {
    /// Motors' torques [N m].
    pub motor_n_m: Wheels,
    /// Speeds relative to the body [rad/s].
    pub speed_rad_s: Wheels,
}

/// How the effects' torque changes with the motion, body axes.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct TorqueSlope {
    /// By the rate [N m s].
    pub by_rate: Matrix3<f64>,
    /// By a small rotation of the body about its own axes [N m].
    pub by_attitude: Matrix3<f64>,
}

/// What the low-pass of gyro and accelerometer holds back at each node; empty without one.
#[derive(Debug, Clone, Default)]
pub(crate) struct HeldBack {
    pub gyro: Vec<Vector3<f64>>,
    pub accel: Vec<Vector3<f64>>,
}

impl HeldBack {
    fn at(&self, k: usize) -> (Vector3<f64>, Vector3<f64>) {
        (self.gyro.get(k).copied().unwrap_or_default(), self.accel.get(k).copied().unwrap_or_default())
    }
}

impl Mechanics {
    pub fn new(model: &PlatformModel) -> Result<Self, DiagnosisError> {
        let gyrostat = Gyrostat::new(model)?;
        let adjusted = gyrostat.model();
        // The quantum is part of the noise.
        let linear = |errors: TriaxialErrors| TriaxialErrors { quantum: 0.0, ..errors };
        let (gyro, accel) =
            (linear(adjusted.sensors.gyro.errors), linear(adjusted.sensors.accelerometer.errors));
        Ok(Self { gyro, accel, gyrostat })
    }

    pub fn model(&self) -> &PlatformModel {
        self.gyrostat.model()
    }

    /// Inverse of the inertia that resists with every wheel free [1/(kg m^2)].
    pub fn inverse_inertia(&self) -> &Matrix3<f64> {
        self.gyrostat.rate_equation().inverse_resisting()
    }

    /// The jets of a run as this platform's valves carry them out.
    pub fn inputs(&self, run: &Run) -> Inputs {
        let model = self.model();
        Inputs::jets(&run.jet_pulses, &self.gyrostat, &run.times, &|t| run.environment(model, run.node_at(t)))
    }

    /// The motors' torques in interval `k`.
    pub fn motors(&self, run: &Run, k: usize) -> Wheels {
        let mut torque = [0.0; MAX_WHEELS];
        for (slot, command) in torque.iter_mut().zip(&run.wheel_command) {
            *slot = command.mean_at(k);
        }
        torque
    }

    /// Motors and wheels half-way through interval `k`.
    pub fn drive(&self, run: &Run, motion: &Motion, k: usize) -> Drive {
        let speed = motion.wheel_mid.get(k).copied().unwrap_or_default();
        let mut drive = Drive { motor_n_m: self.motors(run, k), speed_rad_s: speed };
        for (j, wheel) in self.model().wheels().iter().enumerate() {
            if self.sticks(run, wheel, k, drive.speed_rad_s[j], drive.motor_n_m[j]) {
                (drive.motor_n_m[j], drive.speed_rad_s[j]) = (0.0, 0.0);
            }
        }
        drive
    }

    /// Whether dry friction holds a wheel: it turns no faster than its tachometer's noise lets one see, or than friction
    /// stops within the interval, and its motor is no stronger than its friction (Karnopp 1985).
    pub fn sticks(&self, run: &Run, wheel: &Wheel, k: usize, speed_rad_s: f64, motor_n_m: f64) -> bool {
        let stopped = wheel.coulomb_friction_n_m / wheel.spin_inertia_kg_m2 * run.length_or_zero(k);
        run.has_wheel_speed
            && motor_n_m.abs() <= wheel.coulomb_friction_n_m
            && speed_rad_s.abs() < stopped + run.noise.wheel
    }

    /// What effects see half-way through interval `k`; `None` after the last node.
    pub fn interval_environment<'a>(
        &'a self,
        run: &'a Run,
        motion: &'a Motion,
        inputs: &'a Inputs,
        drive: &'a Drive,
        k: usize,
    ) -> Option<Environment<'a>> {
        if k + 1 >= run.nodes() {
            return None;
        }
        let wheels = self.model().wheels().len();
        let (q, omega) = (motion.q_mid.get(k)?, motion.omega_mid.get(k)?);
        let mut environment = run.environment(self.model(), k);
        environment.time_s += 0.5 * run.length(k);
        environment.q_world_body = *q;
        environment.vertical_b = vertical_b(q);
        environment.omega_wb_b_rad_s = *omega;
        environment.wheel_speed_rad_s = drive.speed_rad_s.get(..wheels).unwrap_or(&[]);
        environment.wheel_motor_torque_n_m = drive.motor_n_m.get(..wheels).unwrap_or(&[]);
        environment.valve_fraction = inputs.jets_at(k);
        Some(environment)
    }

    /// Accelerations of body and wheels in one state with an input.
    pub fn rates(
        &self,
        run: &Run,
        k: usize,
        environment: &Environment<'_>,
        hidden: &[f64],
    ) -> (Vector3<f64>, Wheels) {
        let accelerations = if run.clamped {
            self.gyrostat.clamped_accelerations(environment)
        } else {
            let [x, y, z] = &run.body_torque;
            let mut outside = Vector3::new(x.mean_at(k), y.mean_at(k), z.mean_at(k));
            if let Some(ballast) = run.ballast_moment.get(k) {
                outside += gravity_torque_n_m(ballast, &environment.vertical_b);
            }
            self.gyrostat.accelerations(environment, hidden, &outside)
        };
        (accelerations.omega_dot_wb_b_rad_s2, accelerations.wheel_rad_s2)
    }

    /// Mean accelerations over interval `k`, the hidden states of the effects carried on to its end.
    pub fn rates_with_hidden(
        &self,
        run: &Run,
        k: usize,
        steps: &StepEnvironments<'_>,
        hidden: &mut [f64],
    ) -> (Vector3<f64>, Wheels) {
        let effects = self.gyrostat.effects();
        let (mut sum, mut wheel_sum) = (Vector3::zeros(), [0.0; MAX_WHEELS]);
        steps.carry(
            hidden,
            |environment, x, rate| effects.hidden_derivative(environment, x, rate),
            |environment, x| {
                let (omega_dot, wheel_dot) = self.rates(run, k, environment, x);
                sum += omega_dot;
                for (s, w) in wheel_sum.iter_mut().zip(&wheel_dot) {
                    *s += w;
                }
            },
        );
        let share = 1.0 / steps.count() as f64;
        (sum * share, wheel_sum.map(|x| x * share))
    }

    /// Accelerations over every interval.
    pub fn accelerations(&self, run: &Run, motion: &Motion, inputs: &Inputs) -> Prediction {
        let nodes = run.nodes();
        let mut prediction = Prediction {
            omega_dot: vec![Vector3::zeros(); nodes],
            wheel_dot: vec![[0.0; MAX_WHEELS]; nodes],
            edge_rate: vec![Vector3::zeros(); nodes],
            edge_speed: vec![[0.0; MAX_WHEELS]; nodes],
            ..Prediction::default()
        };
        let hidden_states = self.gyrostat.effects().hidden_states().min(MAX_HIDDEN_STATES);
        let mut hidden = motion.hidden_start(self.gyrostat.effects());
        let mut steps = Steps::default();
        for k in 0..nodes {
            let edge = if run.clamped { Vector3::zeros() } else { self.edge_rate(run, inputs, k) };
            let speeds = prediction.edge_speed[k].iter_mut();
            for ((slot, wheel), command) in speeds.zip(self.model().wheels()).zip(&run.wheel_command) {
                *slot = command.mean_integral_at(k) / wheel.spin_inertia_kg_m2 - wheel.spin_axis_b.dot(&edge);
            }
            prediction.edge_rate[k] = edge;
            let drive = self.drive(run, motion, k);
            let Some(environment) = self.interval_environment(run, motion, inputs, &drive, k) else {
                continue;
            };
            let (omega_dot, wheel_dot) = if hidden_states == 0 {
                self.rates(run, k, &environment, &[])
            } else if steps.fill(run, motion, k) {
                self.rates_with_hidden(
                    run,
                    k,
                    &steps.environments(&environment),
                    &mut hidden[..hidden_states],
                )
            } else {
                continue;
            };
            prediction.omega_dot[k] = omega_dot;
            prediction.wheel_dot[k] = wheel_dot;
        }
        prediction
    }

    /// How the effects' torque changes with the motion over every interval. Differences reach as far as a sample of the
    /// gyro is uncertain: within that, a law that jumps is as steep as it is on average.
    pub fn torque_slopes(&self, run: &Run, motion: &Motion, inputs: &Inputs) -> Vec<TorqueSlope> {
        let effects = self.gyrostat.effects();
        if run.clamped || effects.iter().next().is_none() {
            return Vec::new();
        }
        let hidden = vec![0.0; effects.hidden_states()];
        let rate_step = run.noise.gyro.mean().max(SMALL);
        let slope = |k: usize| -> Option<TorqueSlope> {
            let drive = self.drive(run, motion, k);
            let here = self.interval_environment(run, motion, inputs, &drive, k)?;
            let torque = |environment: &Environment<'_>| effects.torque_b_n_m(environment, &hidden);
            let by_rate = differences(rate_step, |change| {
                let omega_wb_b_rad_s = here.omega_wb_b_rad_s + change;
                torque(&Environment { omega_wb_b_rad_s, ..here })
            });
            let by_attitude = differences(SMALL, |change| {
                let q_world_body = here.q_world_body * quaternion_exp(&change);
                torque(&Environment { q_world_body, vertical_b: vertical_b(&q_world_body), ..here })
            });
            Some(TorqueSlope { by_rate, by_attitude })
        };
        (0..run.nodes()).map(|k| slope(k).unwrap_or_default()).collect()
    }

    /// Mean over node `k`'s samples of the rate that edges within them add.
    pub fn edge_rate(&self, run: &Run, inputs: &Inputs, k: usize) -> Vector3<f64> {
        let mut impulse = Vector3::zeros();
        if inputs.jet_integrals_at(k).iter().any(|x| *x != 0.0) {
            let mut environment = run.environment(self.model(), k);
            environment.valve_fraction = inputs.jet_integrals_at(k);
            impulse += self.gyrostat.jet_torque_b_n_m(&environment);
        }
        for (wheel, command) in self.model().wheels().iter().zip(&run.wheel_command) {
            impulse -= wheel.spin_axis_b.into_inner() * command.mean_integral_at(k);
        }
        let [x, y, z] = &run.body_torque;
        impulse += Vector3::new(x.mean_integral_at(k), y.mean_integral_at(k), z.mean_integral_at(k));
        self.gyrostat.rate_equation().rate_change_b_rad_s(&impulse)
    }

    /// What effects see while the samples of node `k` are taken.
    pub fn node_environment<'a>(
        &'a self,
        run: &'a Run,
        motion: &'a Motion,
        inputs: &'a Inputs,
        prediction: &Prediction,
        motors: &'a Wheels,
        k: usize,
    ) -> Option<Environment<'a>> {
        let wheels = self.model().wheels().len();
        let (q, omega, speed) = (motion.q.get(k)?, motion.omega.get(k)?, motion.wheel.get(k)?);
        // Stamps were set back by the latency of the model that laid out the run.
        let later_s = self.latency_s() - run.latency_s;
        let omega_dot = node_acceleration(prediction, k, run.nodes());
        let mut environment = run.environment(self.model(), k);
        let q_then = q * quaternion_exp(&(omega * -later_s));
        environment.time_s -= later_s;
        environment.q_world_body = q_then;
        environment.vertical_b = vertical_b(&q_then);
        // A controller answers the noise of a reading at once, so that the acceleration near a sample would
        // correlate with what it is compared with: there, what was felt before the node's first sample.
        let several = run.times.samples_s.get(k).is_some_and(|samples| samples.len() > 1);
        let before = match run.answers_gyro {
            true => prediction.omega_dot.get(k.saturating_sub(if several { 2 } else { 1 })).copied(),
            false => None,
        };
        let before = before.unwrap_or(omega_dot);
        environment.omega_wb_b_rad_s = omega - before * later_s;
        environment.omega_dot_wb_b_rad_s2 = omega_dot;
        environment.wheel_speed_rad_s = speed.get(..wheels).unwrap_or(&[]);
        environment.wheel_motor_torque_n_m = motors.get(..wheels).unwrap_or(&[]);
        environment.valve_fraction = inputs.jets_at(k);
        Some(environment)
    }

    /// What the low-pass of the inertial sensors holds back along a motion with these accelerations.
    pub fn held_back(&self, run: &Run, motion: &Motion, omega_dot: &[Vector3<f64>]) -> HeldBack {
        let arm = self.model().sensors.accelerometer.lever_arm_b_m;
        let has_weight = self.model().freedom.has_weight();
        let slow = |k: usize| match (motion.q.get(k), motion.omega.get(k)) {
            (Some(q), Some(w)) => {
                let weight_b = if has_weight { vertical_b(q) } else { Vector3::zeros() };
                specific_force_b_m_s2(&arm, w, &Vector3::zeros(), &weight_b)
            }
            _ => Vector3::zeros(),
        };
        let slope = |k: usize| match run.length_or_zero(k) {
            length if length > 0.0 => (slow(k + 1) - slow(k)) / length,
            _ => Vector3::zeros(),
        };
        self.held_back_of(run, omega_dot, slope)
    }

    /// The same of a change of the accelerations alone.
    pub fn held_back_of_change(&self, run: &Run, omega_dot: &[Vector3<f64>]) -> HeldBack {
        self.held_back_of(run, omega_dot, |_| Vector3::zeros())
    }

    fn held_back_of(
        &self,
        run: &Run,
        omega_dot: &[Vector3<f64>],
        force_slope: impl Fn(usize) -> Vector3<f64>,
    ) -> HeldBack {
        let at = |k: usize| omega_dot.get(k).copied().unwrap_or_default();
        let arm = self.model().sensors.accelerometer.lever_arm_b_m;
        // After the last node nothing is known to change.
        let jump = |k: usize| {
            if k == 0 || k + 1 >= run.nodes() { Vector3::zeros() } else { (at(k) - at(k - 1)).cross(&arm) }
        };
        let (gyro_s, accel_s) = (self.gyro.time_constant_s, self.accel.time_constant_s);
        let mut held = HeldBack::default();
        if gyro_s > 0.0 {
            held.gyro = lag::held_back(run, gyro_s, at, |_| Vector3::zeros());
        }
        if accel_s > 0.0 {
            held.accel = lag::held_back(run, accel_s, force_slope, jump);
        }
        held
    }

    /// Whether the inertial sensors have the same low-pass as another platform's.
    pub fn filters_alike(&self, other: &Self) -> bool {
        self.gyro.time_constant_s == other.gyro.time_constant_s
            && self.accel.time_constant_s == other.accel.time_constant_s
    }

    /// Latency of the inertial sensors \[s\].
    pub fn latency_s(&self) -> f64 {
        self.model().sensors.gyro.errors.latency_s
    }

    /// Readings of gyro and accelerometer at node `k`, `edge_rate` added to the rate.
    pub fn imu(
        &self,
        environment: &Environment<'_>,
        edge_rate: &Vector3<f64>,
        held_back: &HeldBack,
        k: usize,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let mut imu = self.gyrostat.true_imu(environment);
        let (rate, force) = held_back.at(k);
        imu.angular_velocity_b_rad_s += edge_rate - rate;
        imu.specific_force_b_m_s2 -= force;
        let zero = Vector3::zeros();
        (
            self.gyro.reading(&imu.angular_velocity_b_rad_s, &self.gyro.bias, &zero),
            self.accel.reading(&imu.specific_force_b_m_s2, &self.accel.bias, &zero),
        )
    }

    /// Direction that vector sensor `v` sees at node `k`.
    pub fn direction_b(&self, run: &Run, motion: &Motion, v: usize, k: usize) -> Option<Vector3<f64>> {
        let (q, omega, vector) = (motion.q.get(k)?, motion.omega.get(k)?, run.vectors.get(v)?);
        let late_s = vector.mean.get(k).map_or(0.0, |m| m.late_s);
        let q_then = q * quaternion_exp(&(omega * late_s));
        let seen = q_then.inverse_transform_vector(&vector.reference_world);
        // The model describes one vector sensor; others are taken as aligned.
        let misalignment = self.model().sensors.vector.filter(|_| v == 0).map(|s| s.misalignment_rad);
        Some(misalignment.map_or(seen, |angle| quaternion_exp(&angle).inverse() * seen))
    }

    /// Readings at every node; `prediction` holds the accelerations.
    pub fn readings(&self, run: &Run, motion: &Motion, inputs: &Inputs, prediction: &mut Prediction) {
        let nodes = run.nodes();
        let mut gyro = vec![Vector3::zeros(); nodes];
        let mut accel = vec![Vector3::zeros(); nodes];
        prediction.held_back = self.held_back(run, motion, &prediction.omega_dot);
        for (k, (gyro, accel)) in gyro.iter_mut().zip(&mut accel).enumerate() {
            let motors = self.motors(run, k);
            let edge = prediction.edge_rate.get(k).copied().unwrap_or_default();
            if let Some(environment) = self.node_environment(run, motion, inputs, prediction, &motors, k) {
                (*gyro, *accel) = self.imu(&environment, &edge, &prediction.held_back, k);
            }
        }
        prediction.gyro = gyro;
        prediction.accel = accel;
        prediction.vectors = (0..run.vectors.len())
            .map(|v| (0..nodes).map(|k| self.direction_b(run, motion, v, k).unwrap_or_default()).collect())
            .collect();
    }

    /// Near the bearing's own stop in this attitude, where contact may act.
    pub fn near_stop(&self, q: &UnitQuaternion<f64>) -> bool {
        let vertical = vertical_b(q);
        match self.model().tilt_limit {
            TiltLimit::Cone { max_rad } => vertical.x.hypot(vertical.y).atan2(vertical.z) > max_rad - 0.003,
            TiltLimit::Pitch { max_rad } => vertical.x.clamp(-1.0, 1.0).asin().abs() > max_rad - 0.003,
        }
    }
}

/// Step of a difference [rad, rad/s].
const SMALL: f64 = 1e-4;

/// Columns by central differences.
fn differences(step: f64, of: impl Fn(Vector3<f64>) -> Vector3<f64>) -> Matrix3<f64> {
    let column = |axis: usize| {
        let change = Vector3::ith(axis, step);
        (of(change) - of(-change)) / (2.0 * step)
    };
    Matrix3::from_columns(&[column(0), column(1), column(2)])
}

/// Angular acceleration at node `k`: mean of the intervals on both sides.
fn node_acceleration(prediction: &Prediction, k: usize, nodes: usize) -> Vector3<f64> {
    let at = |i: usize| prediction.omega_dot.get(i).copied().unwrap_or_default();
    match k {
        0 => at(0),
        k if k + 1 >= nodes => at(k - 1),
        k => (at(k - 1) + at(k)) * 0.5,
    }
}
