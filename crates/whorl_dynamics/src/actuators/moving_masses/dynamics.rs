//! Moving masses in the plant: the moment that they add to the gravity offset.

use nalgebra::Vector3;

use super::MovingMasses;
use crate::effects::ThrustLag;
use crate::actuators::dynamics::{Instant, KindDynamics, OnBody};
use crate::plant::Plant;
use crate::Environment;

/// They are where they were commanded to be: no states.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct State;

/// Where they are.
#[derive(Debug, Clone)]
pub(crate) struct Drive {
    /// Weight times displacement along each body axis [N m].
    moment_b_n_m: Vector3<f64>,
    /// Sense of the last travel along each body axis.
    direction: Vector3<f64>,
}

/// Nothing within the kind.
pub(crate) type Forces = ();

impl KindDynamics for MovingMasses {
    type State = State;
    type Drive = Drive;
    type Forces = Forces;

    fn idle(&self, _lag: ThrustLag, _now_ns: i64) -> Drive {
        Drive { moment_b_n_m: Vector3::zeros(), direction: Vector3::zeros() }
    }

    #[inline]
    fn show<'a>(&'a self, _state: &'a State, drive: &'a Drive, environment: &mut Environment<'a>) -> f64 {
        environment.ballast_direction = drive.direction;
        0.0
    }

    #[inline]
    fn act(
        &self,
        _at: &Instant,
        _state: &State,
        drive: &Drive,
        _omega_wb_b_rad_s: &Vector3<f64>,
        body: &mut OnBody,
        _to: &mut Forces,
    ) {
        body.gravity_offset_b_n_m += drive.moment_b_n_m;
    }

    #[inline]
    fn rate(
        &self,
        _state: &State,
        _drive: &Drive,
        _forces: &Forces,
        _omega_dot_wb_b_rad_s2: &Vector3<f64>,
        _to: &mut State,
    ) {
    }
}

impl Plant {
    /// Moves the linear mass actuators: `moment_b_n_m` is weight times displacement along each body
    /// axis [N m], added to the gravity offset from now on. Ignored if it is not finite.
    pub fn set_ballast_moment(&mut self, moment_b_n_m: Vector3<f64>) {
        if !moment_b_n_m.iter().copied().all(f64::is_finite) {
            return;
        }
        let masses = &mut self.drive.actuators.moving_masses;
        let travel = moment_b_n_m - masses.moment_b_n_m;
        for (direction, moved) in masses.direction.iter_mut().zip(&travel) {
            if *moved != 0.0 {
                *direction = moved.signum();
            }
        }
        masses.moment_b_n_m = moment_b_n_m;
    }
}
