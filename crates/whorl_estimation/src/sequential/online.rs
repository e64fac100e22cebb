//! The joint filter on samples as they arrive.

use std::collections::VecDeque;

use nalgebra::{Unit, UnitQuaternion, Vector3};
use whorl_dynamics::platform::TiltLimit;
use whorl_dynamics::{ModelPrior, PlatformModel};

use super::sample::{AveragedSample, CONTACT_LASTS_S, Direction, Surroundings, touches};
use super::{JointFilter, JointUpdate, SequentialEstimate};

/// Samples are averaged for this long \[s\].
const BLOCK_S: f64 = 0.05;
/// Samples at the end of a sensor's range are clipped: this share of it counts as the end.
const CLIPPED: f64 = 0.999;
/// Speeds of the wheels, less what their motors gave, are smoothed over this long before and after \[s\].
const WHEELS_HALF_S: f64 = 0.5;
/// After a longer silence the state of the wheels is unknown \[s\].
const WHEELS_GAP_S: f64 = 0.1;

/// Sums over one block.
#[derive(Debug, Clone, Default)]
struct Block {
    begin_s: Option<f64>,
    time_s: f64,
    gyro: Vector3<f64>,
    samples: f64,
    force: Vector3<f64>,
    forces: f64,
    /// Not to be used.
    clipped: bool,
    directions: Vec<(f64, Vector3<f64>, Unit<Vector3<f64>>)>,
    jet_on_time_s: Vec<f64>,
}

/// One sample of the wheels.
#[derive(Debug, Clone)]
struct WheelSample {
    time_s: f64,
    /// Speed that the motors have given since the first sample [rad/s].
    given: Vec<f64>,
    /// Measured speed less that.
    rest: Vec<f64>,
    /// What the motors give now [rad/s^2].
    rate: Vec<f64>,
}

/// [`JointFilter`] on means over twentieths of a second, sample by sample.
///
/// The wheels' momentum is an input of the filter, and noise of an input biases the result. So their speeds are
/// smoothed around each point, which makes the estimate half a second late.
#[derive(Debug, Clone)]
pub struct OnlineFilter {
    filter: JointFilter,
    gyro_range_rad_s: f64,
    force_range_m_s2: f64,
    spin_inertia_kg_m2: Vec<f64>,
    jets: usize,
    tilt_limit: TiltLimit,
    surroundings: Surroundings,
    /// Latest block at the bearing's stop \[s\].
    contact_s: f64,
    block: Block,
    /// Full blocks whose wheels are not known yet.
    waiting: VecDeque<Block>,
    pending: Option<(AveragedSample, Vec<f64>)>,
    wheels: VecDeque<WheelSample>,
    ballast_moment_b_n_m: Vector3<f64>,
}

impl OnlineFilter {
    /// As [`JointFilter::new`].
    #[must_use]
    pub fn new(
        model: &PlatformModel,
        prior: &ModelPrior,
        update: JointUpdate,
        forgetting_per_s: f64,
        q_world_body: UnitQuaternion<f64>,
    ) -> Self {
        Self {
            filter: JointFilter::new(model, prior, update, forgetting_per_s, q_world_body),
            gyro_range_rad_s: model.sensors.gyro.errors.range,
            force_range_m_s2: model.sensors.accelerometer.errors.range,
            spin_inertia_kg_m2: model.wheels().iter().map(|w| w.spin_inertia_kg_m2).collect(),
            jets: model.jets().len(),
            tilt_limit: model.tilt_limit,
            // Gas use and temperature changes are not followed here.
            surroundings: Surroundings::at_start(model),
            contact_s: f64::NEG_INFINITY,
            block: Block::default(),
            waiting: VecDeque::new(),
            pending: None,
            wheels: VecDeque::new(),
            ballast_moment_b_n_m: Vector3::zeros(),
        }
    }

    /// Speeds of all wheels relative to the body [rad/s], and the torques that their motors give them from now on [N m].
    pub fn on_wheels(&mut self, time_s: f64, speed_rad_s: &[f64], motor_n_m: &[f64]) {
        let count = self.spin_inertia_kg_m2.len();
        let finite = (speed_rad_s.iter().chain(motor_n_m).sum::<f64>() + time_s).is_finite();
        if speed_rad_s.len() != count || motor_n_m.len() != count || !finite {
            return;
        }
        let mut given = vec![0.0; count];
        if let Some(last) = self.wheels.back() {
            let dt_s = time_s - last.time_s;
            if dt_s <= 0.0 {
                return;
            }
            if dt_s > WHEELS_GAP_S {
                self.wheels.clear();
            } else {
                given = last.given.iter().zip(&last.rate).map(|(g, r)| g + r * dt_s).collect();
            }
        }
        let rest = speed_rad_s.iter().zip(&given).map(|(speed, given)| speed - given).collect();
        let rate = motor_n_m.iter().zip(&self.spin_inertia_kg_m2).map(|(torque, j)| torque / j).collect();
        self.wheels.push_back(WheelSample { time_s, given, rest, rate });
        // Two windows: the oldest block that waits is one behind.
        while self.wheels.front().is_some_and(|w| w.time_s < time_s - 2.5 * WHEELS_HALF_S) {
            self.wheels.pop_front();
        }
    }

    /// For how long each jet was open since the last call \[s\].
    pub fn on_jets(&mut self, on_time_s: &[f64]) {
        if on_time_s.len() != self.jets || !on_time_s.iter().sum::<f64>().is_finite() {
            return;
        }
        self.block.jet_on_time_s.resize(self.jets, 0.0);
        for (sum, on) in self.block.jet_on_time_s.iter_mut().zip(on_time_s) {
            *sum += on;
        }
    }

    /// A direction of a vector sensor, body axes, and the same in the world.
    pub fn on_direction(
        &mut self,
        time_s: f64,
        direction_b: &Vector3<f64>,
        reference_w: &Unit<Vector3<f64>>,
    ) {
        if let Some(seen) = Unit::try_new(*direction_b, 1e-9).filter(|d| d.sum().is_finite()) {
            self.block.directions.push((time_s, seen.into_inner(), *reference_w));
        }
    }

    /// Moment that the linear mass actuators have from now on, body axes [N m].
    pub fn on_ballast(&mut self, moment_b_n_m: &Vector3<f64>) {
        if moment_b_n_m.sum().is_finite() {
            self.ballast_moment_b_n_m = *moment_b_n_m;
        }
    }

    /// Gyro [rad/s] and specific force [m/s^2], body axes; the estimate when a block is full and could be used.
    pub fn on_imu(
        &mut self,
        time_s: f64,
        gyro_b_rad_s: &Vector3<f64>,
        specific_force_b_m_s2: &Vector3<f64>,
    ) -> Option<SequentialEstimate> {
        if !(gyro_b_rad_s.sum() + specific_force_b_m_s2.sum() + time_s).is_finite() {
            return None;
        }
        let begin_s = *self.block.begin_s.get_or_insert(time_s);
        let estimate = if time_s - begin_s >= BLOCK_S - 1e-6 || time_s < begin_s {
            let full = std::mem::take(&mut self.block);
            self.block.begin_s = Some(time_s);
            self.take(full);
            self.finish()
        } else {
            None
        };
        let block = &mut self.block;
        block.clipped |= gyro_b_rad_s.amax() >= CLIPPED * self.gyro_range_rad_s
            || specific_force_b_m_s2.amax() >= CLIPPED * self.force_range_m_s2;
        block.time_s += time_s;
        block.gyro += gyro_b_rad_s;
        block.samples += 1.0;
        block.force += specific_force_b_m_s2;
        block.forces += 1.0;
        estimate
    }

    /// A full block waits, unless the platform touched its stop, whose contact no model here knows: then neither it nor
    /// what was shortly before and comes shortly after counts.
    fn take(&mut self, mut block: Block) {
        let time_s = block.time_s / block.samples.max(1.0);
        if touches(&block.force, self.tilt_limit) {
            self.contact_s = time_s;
            for waiting in &mut self.waiting {
                waiting.clipped |= waiting.time_s / waiting.samples.max(1.0) >= time_s - CONTACT_LASTS_S;
            }
        }
        block.clipped |= (0.0..=CONTACT_LASTS_S).contains(&(time_s - self.contact_s));
        self.waiting.push_back(block);
    }

    /// The oldest waiting block, once the wheels around it are known.
    fn finish(&mut self) -> Option<SequentialEstimate> {
        if (self.waiting.len() as f64) * BLOCK_S < WHEELS_HALF_S {
            return None;
        }
        let block = self.waiting.pop_front()?;
        let time_s = block.time_s / block.samples.max(1.0);
        let (Some((wheel_speed_rad_s, wheel_acceleration_rad_s2)), false) =
            (self.wheels_at(time_s), block.clipped)
        else {
            // Missing measurements are a gap: the filter restarts its motion after it.
            self.pending = None;
            return None;
        };
        let rate = block.gyro / block.samples;
        let directions = block.directions.iter().map(|(t, seen, reference_world)| Direction {
            direction_b: seen - rate.cross(seen) * (time_s - t),
            reference_world: *reference_world,
        });
        let point = AveragedSample {
            time_s,
            gyro_b_rad_s: rate,
            gyro_samples: block.samples,
            specific_force_b_m_s2: (block.forces > 0.0).then(|| (block.force / block.forces, block.forces)),
            directions: directions.collect(),
            wheel_speed_rad_s,
            wheel_acceleration_rad_s2,
            jet_share: Vec::new(),
            body_torque_b_n_m: Vector3::zeros(),
            ballast_moment_b_n_m: self.ballast_moment_b_n_m,
            surroundings: self.surroundings,
        };
        let on = block.jet_on_time_s;
        let (mut before, on_before) = self.pending.replace((point, on.clone()))?;
        // Points lie in the middle of their blocks: half of each block's thrust is between them.
        let open = |all: &[f64], j: usize| all.get(j).copied().unwrap_or(0.0);
        let jets = if on.is_empty() && on_before.is_empty() { 0 } else { self.jets };
        before.jet_share = (0..jets).map(|j| 0.5 * (open(&on, j) + open(&on_before, j)) / BLOCK_S).collect();
        self.filter.step(&before)
    }

    /// Speed and acceleration of each wheel: a straight line through the part not due to the motors.
    fn wheels_at(&self, time_s: f64) -> Option<(Vec<f64>, Vec<f64>)> {
        if self.spin_inertia_kg_m2.is_empty() {
            return Some((Vec::new(), Vec::new()));
        }
        let first = self.wheels.partition_point(|w| w.time_s < time_s - WHEELS_HALF_S);
        let last = self.wheels.partition_point(|w| w.time_s <= time_s + WHEELS_HALF_S);
        let at = self.wheels.partition_point(|w| w.time_s <= time_s).checked_sub(1)?;
        let now = self.wheels.get(at)?;
        let near: Vec<&WheelSample> = self.wheels.range(first..last).collect();
        if near.len() < 3 {
            return None;
        }
        let count = near.len() as f64;
        let mean_s = near.iter().map(|w| w.time_s).sum::<f64>() / count;
        let spread: f64 = near.iter().map(|w| (w.time_s - mean_s).powi(2)).sum();
        let pairs = now.given.iter().zip(&now.rate).enumerate().map(|(j, (given, rate))| {
            let rest = |w: &WheelSample| w.rest.get(j).copied().unwrap_or(0.0);
            let mean = near.iter().map(|w| rest(w)).sum::<f64>() / count;
            let slope = near.iter().map(|w| (w.time_s - mean_s) * rest(w)).sum::<f64>() / spread.max(1e-12);
            let motor = given + rate * (time_s - now.time_s);
            (mean + slope * (time_s - mean_s) + motor, slope + rate)
        });
        Some(pairs.unzip())
    }
}
