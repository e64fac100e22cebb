//! Moving masses in the plant: the moment that they add to the gravity offset.

use nalgebra::Vector3;

use super::course::Course;
use super::{MAX_MASSES, MovingMasses};
use crate::Environment;
use crate::actuators::dynamics::{Instant, KindDynamics, OnBody};
use crate::effects::ThrustLag;
use crate::plant::Plant;

/// Share of the largest moment of a move below which it counts as none along a body axis: rounding.
const STILL: f64 = 1e-9;

/// Where they are follows from time and the last command alone: no states.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct State;

/// Where they are.
#[derive(Debug, Clone)]
pub(crate) struct Drive {
    /// Of ideal masses: weight times displacement along each body axis [N m].
    moment_b_n_m: Vector3<f64>,
    /// Sense of the last travel along each body axis.
    direction: Vector3<f64>,
    /// Of the listed masses.
    courses: [Course; MAX_MASSES],
    /// When one of these has its next kink.
    next_event_ns: i64,
}

impl Drive {
    /// Notes the sense of a move.
    fn turn(&mut self, travel_b_n_m: &Vector3<f64>, least_n_m: f64) {
        for (direction, moved) in self.direction.iter_mut().zip(travel_b_n_m) {
            if moved.abs() > least_n_m {
                *direction = moved.signum();
            }
        }
    }
}

/// Nothing within the kind.
pub(crate) type Forces = ();

impl MovingMasses {
    /// Moment of the masses `offset_s` after `now_ns`, body axes [N m].
    #[inline]
    fn moment_now_b_n_m(&self, drive: &Drive, now_ns: i64, offset_s: f64) -> Vector3<f64> {
        if self.0.is_empty() {
            return drive.moment_b_n_m;
        }
        self.0.iter().zip(&drive.courses).fold(Vector3::zeros(), |sum, (mass, course)| {
            sum + mass.weight_b_n() * course.mass_m(mass, now_ns, offset_s)
        })
    }

    fn next_of_all_ns(&self, drive: &Drive, now_ns: i64) -> i64 {
        let courses = self.0.iter().zip(&drive.courses);
        courses.map(|(mass, course)| course.next_event_ns(mass, now_ns)).min().unwrap_or(i64::MAX)
    }

    /// Sends the masses to a moment, or puts them there at once.
    fn send(&self, drive: &mut Drive, moment_b_n_m: &Vector3<f64>, now_ns: i64, at_once: bool) {
        if self.0.is_empty() {
            drive.turn(&(moment_b_n_m - drive.moment_b_n_m), 0.0);
            drive.moment_b_n_m = *moment_b_n_m;
            return;
        }
        let to_m = self.positions_m(moment_b_n_m);
        let mut travel_b_n_m = Vector3::zeros();
        for ((mass, course), to_m) in self.0.iter().zip(&mut drive.courses).zip(to_m) {
            let from_m = course.spindle_m(mass, now_ns, 0.0);
            travel_b_n_m += mass.weight_b_n() * (to_m - from_m);
            if at_once {
                course.put(mass, to_m, now_ns);
            } else if course.target_m() != to_m {
                course.turn_to(mass, to_m, now_ns);
            }
        }
        drive.turn(&travel_b_n_m, STILL * travel_b_n_m.amax());
        drive.next_event_ns = self.next_of_all_ns(drive, now_ns);
    }
}

impl KindDynamics for MovingMasses {
    type State = State;
    type Drive = Drive;
    type Forces = Forces;

    fn idle(&self, _lag: ThrustLag, _now_ns: i64) -> Drive {
        Drive {
            moment_b_n_m: Vector3::zeros(),
            direction: Vector3::zeros(),
            courses: [Course::resting(0.0); MAX_MASSES],
            next_event_ns: i64::MAX,
        }
    }

    #[inline]
    fn show<'a>(&'a self, _state: &'a State, drive: &'a Drive, environment: &mut Environment<'a>) -> f64 {
        environment.ballast_direction = drive.direction;
        0.0
    }

    #[inline]
    fn act(
        &self,
        at: &Instant,
        _state: &State,
        drive: &Drive,
        _omega_wb_b_rad_s: &Vector3<f64>,
        body: &mut OnBody,
        _to: &mut Forces,
    ) {
        body.gravity_offset_b_n_m += self.moment_now_b_n_m(drive, at.now_ns, at.offset_s);
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

    #[inline]
    fn next_event_ns(&self, drive: &Drive) -> i64 {
        drive.next_event_ns
    }

    fn settle(&self, drive: &mut Drive, now_ns: i64) {
        drive.next_event_ns = self.next_of_all_ns(drive, now_ns);
    }
}

impl Plant {
    /// Puts the linear mass actuators where they add `moment_b_n_m` (weight times displacement, body axes [N m]) to
    /// the gravity offset from now on, as far as their end stops let them, without the time that they need: for
    /// predictions that follow what was recorded. Ignored if it is not finite.
    pub fn set_ballast_moment(&mut self, moment_b_n_m: Vector3<f64>) {
        self.send_masses(&moment_b_n_m, true);
    }

    /// Sends them there, each at its largest speed. Ideal ones are there at once. Ignored if it is not finite.
    pub fn move_ballast(&mut self, moment_b_n_m: Vector3<f64>) {
        self.send_masses(&moment_b_n_m, false);
    }

    /// What they add to the gravity offset now, body axes [N m].
    #[must_use]
    pub fn ballast_moment_b_n_m(&self) -> Vector3<f64> {
        let masses = &self.gyrostat.model().actuators.moving_masses;
        masses.moment_now_b_n_m(&self.drive.actuators.moving_masses, self.now_ns, 0.0)
    }

    fn send_masses(&mut self, moment_b_n_m: &Vector3<f64>, at_once: bool) {
        if !moment_b_n_m.iter().copied().all(f64::is_finite) {
            return;
        }
        let masses = &self.gyrostat.model().actuators.moving_masses;
        masses.send(&mut self.drive.actuators.moving_masses, moment_b_n_m, self.now_ns, at_once);
    }
}
