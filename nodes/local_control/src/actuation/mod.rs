//! From a torque to motor commands and jet pulses.
//!
//! **Motors** (mainly those of wheels) are allocated every control step in closed form. **Jets** are planned once a slot by the
//! quadratic program and the sigma-delta modulator.
//!
//! With **both**, wheels point the platform and jets do only what wheels cannot: take momentum out of
//! them, and help when they saturate. At a slot's start the program gets as desired torque of each
//! wheel the pointing torque plus the unloading torque, so that the jets' share is the unloading (and
//! torque beyond the wheels' limits) and not the noise of pointing. Within the slot the wheels
//! counter the *mean* torque of the slot's pulses: their net impulse is met exactly, the body moves by
//! less than `T_jet t_on (slot - t_on) / (2 J)`, a few thousandths of a degree, and neither the valves'
//! delays nor the wheels' torque limit matter, as they would when countering each edge.

mod jets;
mod motors;
mod steering;

use std::ops::Range;

use nalgebra::{Matrix3xX, Vector3};
use thiserror::Error;
use whorl_allocation::pulses::{PulseError, PulseModulator};
use whorl_allocation::{
    Allocation, Allocator, AllocatorError, EffectorError, EffectorLayout, Effectors, JetMask, Mode, Status,
    TorqueDemand,
};
use whorl_control::momentum::{MomentumUnloading, UnloadingError};
use whorl_dynamics::Gyrostat;
use whorl_dynamics::actuators::{Actuators, Joints, KINDS, Kind, Motor};
use whorl_dynamics::effects::ThrustLag;
use whorl_dynamics::platform::Jet;
use whorl_node::Timestamp;

use jets::effective_on_s;

use crate::excitation::Drive;
use crate::parameters::Parameters;

/// Why the actuators cannot be used as the parameters say.
#[derive(Debug, Error)]
pub enum ActuationError {
    /// Jets or motors are not usable.
    #[error("actuators: {0}")]
    Effectors(#[from] EffectorError),
    /// No allocator.
    #[error(transparent)]
    Allocator(#[from] AllocatorError),
    /// Slot or on-times do not fit.
    #[error("jet pulses: {0}")]
    Pulses(#[from] PulseError),
    /// Unloading settings.
    #[error(transparent)]
    Unloading(#[from] UnloadingError),
}

/// How an allocation was found; values of `ControlStatus.allocation`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Found {
    /// Optimum of the program.
    Solved,
    /// Unique solution.
    Unique,
    /// Bounded least squares.
    Fallback,
    /// No torque was commanded.
    Off,
}

/// The actuators' part of a step.
#[derive(Debug, Clone)]
pub struct Actuated {
    /// Share of the commanded torque that was attainable, 0..=1.
    pub alpha: f64,
    /// Torque on the body by the model, jets as their mean over the slot \[N m\].
    pub achieved_b_n_m: Vector3<f64>,
    /// How it was found.
    pub found: Found,
}

/// The actuators of a platform.
pub struct Actuation {
    mode: Mode,
    actuators: Actuators,
    /// Current bounds and torque of every motor, by kind.
    motors: Vec<Motor>,
    /// Each kind's among these.
    ranges: [Range<usize>; KINDS],
    jets: Vec<Jet>,
    lag: ThrustLag,
    gas_rate_kg_s: Vec<f64>,
    allocator: Allocator,
    modulator: PulseModulator,
    unloading: MomentumUnloading,
    wheel_target_rad_s: Vec<f64>,
    demand: TorqueDemand,
    /// Whether the motors' torques may come to lie in one plane.
    may_be_singular: bool,
    /// Command that each motor should have for its own sake.
    preferred: Vec<f64>,
    /// Time of this step.
    now: Timestamp,
    /// How far the motors' torques are from lying in one plane, if they ever may: det C C^T of [`steering`].
    measure: Option<f64>,
    /// Unloading torque desired of each motor.
    unload: Vec<f64>,
    /// Torque of the model's effects on each motor's rotor besides friction, in the unit of its command.
    effects: Vec<f64>,
    /// Command of each motor.
    command: Vec<f64>,
    on_time_s: Vec<f64>,
    slot: u64,
    slot_start: Option<Timestamp>,
    slot_length_s: f64,
    half_step_s: f64,
    /// Mean torque of this slot's pulses, body axes [N m].
    jet_torque_b_n_m: Vector3<f64>,
    jet_alpha: f64,
    jet_found: Found,
    saturated_jets: JetMask,
    failed_by_parameter: Vec<bool>,
    gas_used_kg: f64,
    fallbacks: u64,
    /// Whether allocations are compared with the exact oracle.
    checked: bool,
    checks: AllocationChecks,
}

/// Allocations that were compared with the exact oracle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AllocationChecks {
    /// Compared.
    pub compared: u64,
    /// Those that differ in share, torque, bounds or gas.
    pub disagreed: u64,
}

impl Actuation {
    /// The actuators of the gyrostat's platform.
    ///
    /// # Errors
    /// [`ActuationError`] when a jet or motor, the slot, or a setting is not usable.
    pub fn new(parameters: &Parameters, gyrostat: &Gyrostat) -> Result<Self, ActuationError> {
        let actuators = gyrostat.model().actuators.clone();
        let jets = gyrostat.model().jets().to_vec();
        let ranges = actuators.motor_ranges();
        let count = ranges.iter().map(Range::len).sum();
        let mut motors = vec![Motor::default(); count];
        actuators.motors(&Default::default(), &[], &mut motors);
        let lag = gyrostat.thrust_lag();
        let gas_rate_kg_s: Vec<f64> = jets.iter().map(|jet| gyrostat.gas_rate_kg_s(jet.thrust_n)).collect();
        let columns = |vectors: Vec<Vector3<f64>>| {
            Matrix3xX::from_fn(vectors.len(), |i, j| vectors.get(j).map_or(0.0, |vector| vector[i]))
        };
        let effectors = Effectors::new(EffectorLayout {
            jet_torque_b_n_m: columns(jets.iter().map(Jet::torque_b_n_m).collect()),
            jet_force_b_n: None,
            jet_gas_rate_kg_s: gas_rate_kg_s.clone(),
            motor_torque_b: columns(motors.iter().map(|motor| motor.torque_b).collect()),
            motor_limit: motors.iter().map(|motor| motor.limit).collect(),
        })?;
        let slot_length_s = parameters.jet_slot_length_s;
        let min_on_time_s = jets.iter().map(|jet| effective_on_s(jet, lag, jet.min_on_time_s)).collect();
        let modulator = PulseModulator::new(&effectors, min_on_time_s, slot_length_s)?;
        Ok(Self {
            mode: parameters.actuators,
            demand: TorqueDemand::nominal(&effectors, Mode::Motors, Vector3::zeros()),
            allocator: Allocator::new(effectors)?,
            modulator,
            unloading: MomentumUnloading::new(parameters.unloading)?,
            wheel_target_rad_s: parameters.wheel_speed_target_rad_s.clone(),
            may_be_singular: actuators.may_be_singular(),
            preferred: vec![0.0; motors.len()],
            now: Timestamp(0),
            measure: None,
            unload: vec![0.0; motors.len()],
            effects: vec![0.0; motors.len()],
            command: vec![0.0; motors.len()],
            on_time_s: vec![0.0; jets.len()],
            actuators,
            motors,
            ranges,
            jets,
            lag,
            gas_rate_kg_s,
            slot: 0,
            slot_start: None,
            slot_length_s,
            half_step_s: 0.5 / parameters.control_rate_hz,
            jet_torque_b_n_m: Vector3::zeros(),
            jet_alpha: 1.0,
            jet_found: Found::Off,
            saturated_jets: JetMask::NONE,
            failed_by_parameter: parameters.failed_jets.clone(),
            gas_used_kg: 0.0,
            fallbacks: 0,
            checked: parameters.check_allocation,
            checks: AllocationChecks::default(),
        }
        .with_weights(parameters))
    }

    fn with_weights(mut self, parameters: &Parameters) -> Self {
        self.demand.motor_weight = parameters.wheel_weight;
        self
    }

    /// Continues counting where `previous` stopped, for actuators that were reconfigured.
    pub fn continuing(mut self, previous: &Self) -> Self {
        // Always a new slot: the plan of the previous one is no longer known here.
        self.slot = previous.slot + 1;
        self.gas_used_kg = previous.gas_used_kg;
        self.fallbacks = previous.fallbacks;
        self.checks = previous.checks;
        self
    }

    /// Commands a torque on the body \[N m\] at `stamp`.
    pub fn apply(
        &mut self,
        stamp: Timestamp,
        torque_b_n_m: &Vector3<f64>,
        joints: &[Joints; KINDS],
        failed_by_driver: &[bool],
    ) -> Actuated {
        self.now = stamp;
        self.set_motors(joints);
        self.set_available(failed_by_driver);
        if self.mode != Mode::Motors && self.slot_begins(stamp) {
            self.plan_jets(torque_b_n_m, joints);
        }
        if self.mode == Mode::Jets {
            self.command.fill(0.0);
            return Actuated {
                alpha: self.jet_alpha,
                achieved_b_n_m: self.jet_torque_b_n_m,
                found: self.jet_found,
            };
        }
        let remainder = torque_b_n_m - self.jet_torque_b_n_m;
        let Some(allocation) = self.allocate(Mode::Motors, remainder) else {
            return self.off();
        };
        self.tell_motors(&allocation.motor_command);
        Actuated {
            alpha: allocation.alpha,
            achieved_b_n_m: allocation.achieved_torque_b_n_m + self.jet_torque_b_n_m,
            found: found(&allocation),
        }
    }

    /// Executes an excitation: control's torque on the body by the motors, if any \[N m\]; an additional motor torque
    /// for each wheel \[N m\]; and, if a jet fires in the slot that begins now, that jet and its on-time \[s\].
    /// True when that slot began.
    pub fn excite(
        &mut self,
        stamp: Timestamp,
        torque_b_n_m: Option<&Vector3<f64>>,
        drive: &Drive,
        joints: &[Joints; KINDS],
        failed_by_driver: &[bool],
    ) -> (Actuated, bool) {
        self.now = stamp;
        self.set_motors(joints);
        self.set_available(failed_by_driver);
        let begins = self.slot_begins(stamp);
        if begins {
            self.close_jets();
            self.modulator.reset();
            self.unloading.stop();
            if let Some((j, on_s)) = drive.pulse
                && self.demand.jet_available.contains(j)
                && let (Some(on), Some(jet)) = (self.on_time_s.get_mut(j), self.jets.get(j))
            {
                *on = on_s;
                let effective_s = effective_on_s(jet, self.lag, on_s);
                self.jet_torque_b_n_m = jet.torque_b_n_m() * (effective_s / self.slot_length_s);
                self.gas_used_kg += effective_s * self.gas_rate_kg_s.get(j).copied().unwrap_or(0.0);
            }
        }
        let mut actuated = Actuated { alpha: 1.0, achieved_b_n_m: self.jet_torque_b_n_m, found: Found::Off };
        self.command.fill(0.0);
        if let Some(allocation) = torque_b_n_m.and_then(|torque| self.allocate(Mode::Motors, *torque)) {
            self.tell_motors(&allocation.motor_command);
            actuated.alpha = allocation.alpha;
            actuated.achieved_b_n_m += allocation.achieved_torque_b_n_m;
            actuated.found = found(&allocation);
        }
        let wheels = self.ranges[Kind::Wheels as usize].clone();
        let told = self.command.iter_mut().zip(&self.motors).skip(wheels.start).take(wheels.len());
        for ((command, motor), more) in told.zip(&drive.wheel_torque_n_m) {
            let before = *command;
            *command = (before + more).clamp(-motor.limit, motor.limit);
            actuated.achieved_b_n_m += motor.torque_b * (*command - before);
        }
        (actuated, begins)
    }

    /// Everything off.
    pub fn off(&mut self) -> Actuated {
        if self.on_time_s.iter().any(|on| *on > 0.0) {
            // Only a new slot makes the driver close valves that are open.
            self.slot += 1;
        }
        self.command.fill(0.0);
        self.close_jets();
        self.slot_start = None;
        self.modulator.reset();
        self.unloading.stop();
        Actuated { alpha: 1.0, achieved_b_n_m: Vector3::zeros(), found: Found::Off }
    }

    /// `None` only for a torque that is not finite, which the caller's checks exclude.
    fn allocate(&mut self, mode: Mode, torque_b_n_m: Vector3<f64>) -> Option<Allocation> {
        self.demand.mode = mode;
        self.demand.torque_b_n_m = torque_b_n_m;
        if mode != Mode::Both {
            self.demand.motor_desired.copy_from_slice(&self.preferred);
        }
        if mode == Mode::Motors && self.may_be_singular {
            let period_ns = (steering::PERIOD_S * 1e9) as i64;
            let time_s = self.now.0.rem_euclid(period_ns) as f64 * 1e-9;
            let (attainable_b_n_m, measure) = steering::attainable(&self.motors, &torque_b_n_m, time_s);
            self.measure = Some(measure);
            self.demand.torque_b_n_m = attainable_b_n_m;
        }
        let allocation = self.allocator.allocate(&self.demand).ok();
        if allocation.as_ref().is_none_or(|a| matches!(a.status, Status::Fallback(_))) {
            self.fallbacks += 1;
        } else if self.checked
            && let Some(allocation) = &allocation
        {
            self.checks.compared += 1;
            let agrees = self.allocator.check(&self.demand, allocation).is_ok_and(|check| check.agrees());
            self.checks.disagreed += u64::from(!agrees);
        }
        // The share of what was asked, not of what could be given without excessive rates.
        let square = torque_b_n_m.norm_squared();
        allocation.map(|mut found| {
            if self.demand.torque_b_n_m != torque_b_n_m && square > 0.0 {
                let share = found.achieved_torque_b_n_m.dot(&torque_b_n_m) / square;
                found.alpha = found.alpha.min(share.clamp(0.0, 1.0));
            }
            found
        })
    }

    /// How far the torques of gimbals are from lying in one plane, 0 = singular; `None` without gimbals.
    pub fn singularity_measure(&self) -> Option<f64> {
        self.measure
    }

    /// Allocations that needed the fallback.
    pub fn fallbacks(&self) -> u64 {
        self.fallbacks
    }

    /// Allocations compared with the exact oracle; all zero unless asked for.
    pub fn checks(&self) -> AllocationChecks {
        self.checks
    }

    /// Whether the jets are unloading the wheels.
    pub fn unloading(&self) -> bool {
        self.unloading.active()
    }
}

fn found(allocation: &Allocation) -> Found {
    match allocation.status {
        Status::Solved { .. } => Found::Solved,
        Status::ClosedForm => Found::Unique,
        Status::Fallback(_) => Found::Fallback,
    }
}
