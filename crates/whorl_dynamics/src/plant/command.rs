//! Commands to the platform.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::{UnitQuaternion, Vector3};
use thiserror::Error;

use super::{Plant, PlantError};
use crate::MeasuredSupplies;
use crate::actuators::Kind;
use crate::actuators::wheels::MAX_WHEELS;
use crate::gyrostat::Fading;

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
    /// The number of commands differs from the number of motors of that kind.
    #[error("{given} commands for {needed} motors")]
    MotorCount {
        /// Commands given.
        given: usize,
        /// Motors of the kind.
        needed: usize,
    },
    /// A value is NaN or infinite.
    #[error("a commanded value is not finite")]
    NotFinite,
    /// The pulse would begin before now.
    #[error("a pulse cannot start at {start_ns} ns: it is {now_ns} ns already")]
    InThePast {
        /// Start asked for.
        start_ns: i64,
        /// Current time.
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
    /// Sets the commands of one kind's motors, one per actuator, from now until the next; each is limited to what its
    /// motor can do.
    ///
    /// # Errors
    /// Wrong number of commands, or one that is not finite.
    pub fn command_motors(&mut self, kind: Kind, command: &[f64]) -> Result<(), CommandError> {
        let actuators = &self.gyrostat.model().actuators;
        let needed = actuators.motor_ranges().get(kind as usize).map_or(0, Range::len);
        if command.len() != needed {
            return Err(CommandError::MotorCount { given: command.len(), needed });
        }
        if !command.iter().copied().all(f64::is_finite) {
            return Err(CommandError::NotFinite);
        }
        actuators.command(&mut self.drive.actuators, kind, command);
        Ok(())
    }

    /// All motor commands zero.
    pub fn stop_motors(&mut self) {
        let actuators = &self.gyrostat.model().actuators;
        for (kind, range) in Kind::ALL.into_iter().zip(actuators.motor_ranges()) {
            actuators.command(&mut self.drive.actuators, kind, &vec![0.0; range.len()]);
        }
    }

    /// Sets a torque on the body from outside, body axes [N m], from now until the next. Ignored if it is
    /// not finite.
    pub fn set_body_torque(&mut self, torque_b_n_m: Vector3<f64>) {
        if torque_b_n_m.iter().copied().all(f64::is_finite) {
            self.drive.body_torque_b_n_m = torque_b_n_m;
        }
    }

    /// Sets one of up to three torques on the body that nobody commands, beside [`Self::set_body_torque`], body axes
    /// [N m]: a filter's estimate of it, which fades at this rate from now on [1/s]. Ignored if it is not finite, or one too many.
    pub fn set_disturbance(&mut self, which: usize, torque_b_n_m: Vector3<f64>, rate_1_s: f64) {
        let since_s = self.time_s();
        if let Some(slot) = self.drive.disturbances.get_mut(which)
            && torque_b_n_m.iter().chain([&rate_1_s]).copied().all(f64::is_finite)
        {
            *slot = Fading { torque_n_m: torque_b_n_m, since_s, rate_1_s };
        }
    }

    /// The same of the wheels' motors, about their axes, beside what is commanded; a wheel that dry friction holds it does not move.
    pub fn set_motor_disturbances(&mut self, torque_n_m: impl Iterator<Item = f64>, rate_1_s: f64) {
        let mut of = Fading { torque_n_m: [0.0; MAX_WHEELS], since_s: self.time_s(), rate_1_s };
        of.torque_n_m.iter_mut().zip(torque_n_m).for_each(|(slot, torque_n_m)| *slot = torque_n_m);
        if of.torque_n_m.iter().chain([&rate_1_s]).all(|x| x.is_finite()) {
            self.drive.motor_disturbances = of;
        }
    }

    /// No such torque.
    pub fn clear_disturbances(&mut self) {
        self.drive.disturbances = Default::default();
        self.drive.motor_disturbances = Default::default();
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
            self.state.omega_wb_b_rad_s = self.gyrostat.model().freedom.share(omega_wb_b_rad_s);
        }
        self.state.set_wheel_speed_rad_s(wheel_speed_rad_s);
        // The history of sensors with latency belongs to the motion before.
        self.history.forget();
        self.set_out();
        Ok(())
    }

    /// From now on it has supplies as they were measured, and as much gas as they begin with.
    pub fn set_supplies(&mut self, supplies: Arc<MeasuredSupplies>) {
        if let Some(pressure_pa) = supplies.first_tank_pressure_pa {
            self.set_tank_pressure(pressure_pa);
        }
        self.gyrostat.set_supplies(supplies);
    }

    /// Clamps the body where it is (wheel bench test), or releases it.
    pub fn set_clamped(&mut self, clamped: bool) {
        self.drive.clamped = clamped;
        if clamped {
            self.state.omega_wb_b_rad_s = Vector3::zeros();
        }
    }
}
