//! What the platform can be told.

use nalgebra::{UnitQuaternion, Vector3};
use thiserror::Error;

use super::valves::{JetFailure, Pulse};
use super::{Plant, PlantError, ns_from_s};
use crate::gyrostat::sign;

/// Why a command was refused. The plant is then unchanged.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum CommandError {
    /// No such jet.
    #[error("there is no jet {jet}; the platform has {jets}")]
    UnknownJet {
        /// Index asked for, from 0.
        jet: usize,
        /// Number of jets.
        jets: usize,
    },
    /// Another number of values than wheels.
    #[error("{given} wheel torques for {wheels} wheels")]
    WheelCount {
        /// Values given.
        given: usize,
        /// Wheels of the platform.
        wheels: usize,
    },
    /// A value is NaN or infinite.
    #[error("a commanded value is not finite")]
    NotFinite,
    /// The pulse would begin before now.
    #[error("a pulse cannot start at {start_ns} ns: it is {now_ns} ns already")]
    InThePast {
        /// Start asked for.
        start_ns: i64,
        /// Present time.
        now_ns: i64,
    },
    /// The valve cannot make a pulse so short; it stays shut.
    #[error("a pulse of {on_time_s} s is shorter than the valve can make ({min_on_time_s} s)")]
    BelowMinimumOnTime {
        /// On-time asked for.
        on_time_s: f64,
        /// Shortest pulse of this jet.
        min_on_time_s: f64,
    },
}

impl Plant {
    /// Sets the motor torques [N m], from now until the next command; each is limited to what its
    /// motor can give. Torque u on a wheel reacts as -u on the body.
    ///
    /// # Errors
    /// Wrong number of torques, or one that is not finite.
    pub fn command_wheels(&mut self, torque_n_m: &[f64]) -> Result<(), CommandError> {
        let wheels = self.gyrostat.model().wheels();
        if torque_n_m.len() != wheels.len() {
            return Err(CommandError::WheelCount { given: torque_n_m.len(), wheels: wheels.len() });
        }
        if !torque_n_m.iter().copied().all(f64::is_finite) {
            return Err(CommandError::NotFinite);
        }
        for ((slot, wheel), asked) in self.drive.motor_torque_n_m.iter_mut().zip(wheels).zip(torque_n_m) {
            *slot = asked.max(-wheel.max_torque_n_m).min(wheel.max_torque_n_m);
        }
        Ok(())
    }

    /// Switches a valve on for `on_time_s`, beginning at `start_ns`. Gas flows from the opening delay
    /// after the start to the closing delay after the end. A pulse that begins when, or before, the
    /// jet's last one ends prolongs it: the valve stays open. Returns the pulse as carried out.
    ///
    /// # Errors
    /// Unknown jet, start in the past, on-time not finite or below the valve's minimum.
    pub fn command_jet_pulse(
        &mut self,
        jet: usize,
        start_ns: i64,
        on_time_s: f64,
    ) -> Result<Pulse, CommandError> {
        let jets = self.gyrostat.model().jets();
        let Some(data) = jets.get(jet) else {
            return Err(CommandError::UnknownJet { jet, jets: jets.len() });
        };
        if !on_time_s.is_finite() {
            return Err(CommandError::NotFinite);
        }
        if start_ns < self.now_ns {
            return Err(CommandError::InThePast { start_ns, now_ns: self.now_ns });
        }
        let (later_opening_s, later_closing_s) = self
            .gyrostat
            .effects()
            .valve_delay_s(&self.gyrostat.environment(self.time_s(), &self.state, &self.drive));
        let min_on_time_s = data.min_on_time_s;
        let off_ns = start_ns.saturating_add(ns_from_s(on_time_s));
        let pulse = Pulse {
            on_ns: start_ns,
            off_ns,
            opens_ns: start_ns.saturating_add(ns_from_s(data.opening_delay_s + later_opening_s)),
            closes_ns: off_ns.saturating_add(ns_from_s(data.closing_delay_s + later_closing_s)),
        };
        // One nanosecond of grace: the shortest pulse must survive its rounding.
        let min_on_time_ns = (ns_from_s(min_on_time_s) - 1).max(1);
        self.valves
            .add(jet, pulse, min_on_time_ns, self.now_ns)
            .ok_or(CommandError::BelowMinimumOnTime { on_time_s, min_on_time_s })
    }

    /// Switches every valve off at `at_ns` (now, if that is past) and forgets later pulses. Gas stops
    /// after each valve's closing delay.
    pub fn close_all_valves(&mut self, at_ns: i64) {
        let at_ns = at_ns.max(self.now_ns);
        let jets = self.gyrostat.model().jets();
        let closing_delay_ns = |j: usize| jets.get(j).map_or(0, |jet| ns_from_s(jet.closing_delay_s));
        self.valves.close_all(at_ns, closing_delay_ns, self.now_ns);
    }

    /// Breaks a valve, or mends it, from now on.
    ///
    /// # Errors
    /// Unknown jet.
    pub fn set_jet_failure(&mut self, jet: usize, failure: JetFailure) -> Result<(), CommandError> {
        if self.valves.fail(jet, failure, self.now_ns) {
            self.drive.valve_fraction = self.valves.fractions();
            Ok(())
        } else {
            Err(CommandError::UnknownJet { jet, jets: self.gyrostat.model().jets().len() })
        }
    }

    /// Whether a valve is broken.
    #[must_use]
    pub fn jet_failure(&self, jet: usize) -> JetFailure {
        self.valves.failure(jet)
    }

    /// Time a valve's driver has been switched on since the start \[s\], as its electronics know it (a
    /// stuck valve counts all the same). Differences of two calls give the on-time between them.
    #[must_use]
    pub fn valve_driven_s(&self, jet: usize) -> f64 {
        self.valve_driven_ns(jet) as f64 * 1e-9
    }

    /// [`Self::valve_driven_s`] in nanoseconds, exact.
    #[must_use]
    pub fn valve_driven_ns(&self, jet: usize) -> i64 {
        self.valves.driven_ns(jet, self.now_ns)
    }

    /// Moves the linear mass actuators: `moment_b_n_m` is weight times displacement along each body
    /// axis [N m], added to the gravity offset from now on. Ignored if it is not finite.
    pub fn set_ballast_moment(&mut self, moment_b_n_m: Vector3<f64>) {
        if !moment_b_n_m.iter().copied().all(f64::is_finite) {
            return;
        }
        let travel = moment_b_n_m - self.drive.ballast_moment_b_n_m;
        for (direction, moved) in self.drive.ballast_direction.iter_mut().zip(&travel) {
            if *moved != 0.0 {
                *direction = moved.signum();
            }
        }
        self.drive.ballast_moment_b_n_m = moment_b_n_m;
    }

    /// Sets a torque on the body from outside, body axes [N m], from now until the next. Ignored if it is
    /// not finite.
    pub fn set_body_torque(&mut self, torque_b_n_m: Vector3<f64>) {
        if torque_b_n_m.iter().copied().all(f64::is_finite) {
            self.drive.body_torque_b_n_m = torque_b_n_m;
        }
    }

    /// Puts body and wheels into another motion now, as where a prediction starts from a new estimate.
    /// Time, gas, valves, commands and hidden states go on as they were.
    ///
    /// # Errors
    /// Another number of wheel speeds than wheels, or a number that is not finite; the plant is then
    /// unchanged.
    pub fn set_motion(
        &mut self,
        q_world_body: &UnitQuaternion<f64>,
        omega_wb_b_rad_s: &Vector3<f64>,
        wheel_speed_rad_s: &[f64],
    ) -> Result<(), PlantError> {
        let wheels = self.gyrostat.model().wheels().len();
        if wheel_speed_rad_s.len() != wheels {
            return Err(PlantError::WheelCount { given: wheel_speed_rad_s.len(), wheels });
        }
        let numbers = q_world_body.coords.iter().chain(omega_wb_b_rad_s).chain(wheel_speed_rad_s);
        if !numbers.copied().all(f64::is_finite) {
            return Err(PlantError::NotFinite);
        }
        self.state.q_world_body = *q_world_body;
        if !self.drive.clamped {
            self.state.omega_wb_b_rad_s = *omega_wb_b_rad_s;
        }
        for (slot, speed) in self.state.wheel_speed_rad_s.iter_mut().zip(wheel_speed_rad_s) {
            *slot = *speed;
        }
        // What sensors with latency recall belongs to the motion before.
        self.history.forget();
        for (wheel, speed) in wheel_speed_rad_s.iter().enumerate() {
            self.set_sliding(wheel, sign(*speed));
        }
        Ok(())
    }

    /// Clamps the body where it is (wheel bench test), or releases it.
    pub fn set_clamped(&mut self, clamped: bool) {
        self.drive.clamped = clamped;
        if clamped {
            self.state.omega_wb_b_rad_s = Vector3::zeros();
        }
    }
}
