//! From one event to the next.

use whorl_math::vertical_b;

use super::{Plant, PlantError};
use crate::State;
use crate::actuators::{Forces, Part};
use crate::effects::{Touching, is_clear};
use crate::gyrostat::Derivative;
use crate::sensing::Snapshot;

/// Times a segment may be cut where parts come to a stop or contacts begin and end, before the rest is taken in one step:
/// twice for each of eight.
const MAX_STOPS_PER_SEGMENT: usize = 16;
/// How well the beginning and the end of a contact are located \[s\]: at 1 rad/s the torque's jump is then a nanoradian late.
const CONTACT_TIME_S: f64 = 1e-9;

/// What a step works with: only the parts that a platform has are written in every step, the rest stays zero. A plant keeps
/// it, as making it anew costs as much as a step.
#[derive(Debug, Clone)]
pub(super) struct Work {
    /// Derivative at the start of a step.
    first: Derivative,
    later: [Derivative; 3],
    sum: Derivative,
    forces: Forces,
    stage: State,
    /// State at the end of a step.
    end: State,
}

impl Work {
    fn new(state: &State) -> Self {
        let zero = Derivative::zero();
        Self {
            first: zero,
            later: [zero; 3],
            sum: zero,
            forces: Forces::default(),
            stage: *state,
            end: *state,
        }
    }
}

impl Plant {
    /// Moves on to `time_ns`. Valve edges due at `time_ns` itself happen at the start of the next
    /// move, so that a command given at `time_ns` can still prolong a pulse that ends there.
    ///
    /// # Errors
    /// Time before now; or a motion that is no longer finite.
    pub fn advance_to(&mut self, time_ns: i64) -> Result<(), PlantError> {
        if time_ns < self.now_ns {
            return Err(PlantError::BackInTime { now_ns: self.now_ns, asked_ns: time_ns });
        }
        let mut work = self.work.take().unwrap_or_else(|| Box::new(Work::new(&self.state)));
        while self.now_ns < time_ns {
            let actuators = &self.gyrostat.model().actuators;
            let mut event_ns = actuators.next_event_ns(&self.drive.actuators);
            if event_ns <= self.now_ns {
                actuators.settle(&mut self.drive.actuators, self.now_ns);
                event_ns = actuators.next_event_ns(&self.drive.actuators);
            }
            // Steps keep their grid whatever events cut them, so that results depend little on when
            // the caller looks.
            let elapsed_ns = self.now_ns - self.start_ns;
            let step_ns = if self.may_touch() { self.contact_step_ns } else { self.step_ns };
            let grid_ns = self.now_ns - elapsed_ns % step_ns + step_ns;
            let end_ns = time_ns.min(grid_ns).min(event_ns);
            self.integrate_segment((end_ns - self.now_ns) as f64 * 1e-9, &mut work);
            self.now_ns = end_ns;
        }
        self.work = Some(work);
        let motion = self.state.q_world_body.coords.iter().chain(&self.state.omega_wb_b_rad_s);
        let actuators = &self.gyrostat.model().actuators;
        if motion.copied().all(f64::is_finite) && actuators.is_finite(&self.state.actuators) {
            Ok(())
        } else {
            Err(PlantError::Diverged { time_ns })
        }
    }

    /// Integrates over `length_s` without valve edges, cutting where wheels stop or break loose, and where contacts begin
    /// or end.
    fn integrate_segment(&mut self, length_s: f64, work: &mut Work) {
        let mut done_s = 0.0;
        let mut touches = self.touches_after(&self.state, 0.0);
        self.keep_branches(Some(touches));
        self.find_first(0.0, work);
        if self.history.is_needed() {
            self.history.push(Snapshot {
                time_ns: self.now_ns,
                q_world_body: self.state.q_world_body,
                omega_wb_b_rad_s: self.state.omega_wb_b_rad_s,
                omega_dot_wb_b_rad_s2: work.first.omega,
                behind_filter: self.behind_filter,
            });
        }
        for _ in 0..MAX_STOPS_PER_SEGMENT {
            if self.release_parts(done_s, &work.first) {
                self.find_first(done_s, work);
            }
            let remaining_s = length_s - done_s;
            self.runge_kutta(done_s, remaining_s, work);
            let stop = self.first_stop(done_s, remaining_s, work);
            let step_s = stop.as_ref().map_or(remaining_s, |(_, s)| *s);
            if let Some(contact_s) = self.first_contact(touches, done_s, step_s, work) {
                self.move_on(done_s, contact_s, work);
                done_s += contact_s;
                touches = self.touches_after(&self.state, done_s);
                self.keep_branches(Some(touches));
                self.find_first(done_s, work);
                continue;
            }
            self.move_on(done_s, step_s, work);
            let Some((part, _)) = stop else {
                self.keep_branches(None);
                self.add_hidden_noise(length_s);
                return;
            };
            self.slide(part, 0.0);
            done_s += step_s;
            self.find_first(done_s, work);
        }
        self.keep_branches(None);
        self.runge_kutta(done_s, length_s - done_s, work);
        self.move_on(done_s, length_s - done_s, work);
        self.add_hidden_noise(length_s);
    }

    /// Whether something touches, or could within a step: while the tilt is closer to a limit than the motion goes in two.
    fn may_touch(&self) -> bool {
        if self.contact_step_ns == self.step_ns {
            return false;
        }
        let margin_rad = 2e-9 * self.state.omega_wb_b_rad_s.norm() * self.step_ns as f64;
        let vertical_b = vertical_b(&self.state.q_world_body);
        let own = self.gyrostat.model().tilt_limit;
        let is_near = |max_rad: f64| {
            let stop = own.with_max_rad((max_rad - margin_rad).max(0.0));
            !is_clear(&stop, &vertical_b, Touching::AsItIs)
        };
        own.stops() && is_near(own.max_rad())
            || self.gyrostat.effects().contact_tilt_rad().is_some_and(is_near)
    }

    fn touches_after(&self, state: &State, offset_s: f64) -> [bool; 2] {
        let torques_b_n_m = self.gyrostat.contact_torques_b_n_m(self.time_s() + offset_s, state, &self.drive);
        torques_b_n_m.map(|torque| torque != nalgebra::Vector3::zeros())
    }

    /// Keeps the branch of each contact for the steps to come; `None`: lets go of them.
    fn keep_branches(&mut self, touches: Option<[bool; 2]>) {
        let [stop, contact] = touches.map_or([Touching::AsItIs; 2], |t| t.map(Touching::branch));
        (self.drive.stop, self.drive.contact) = (stop, contact);
    }

    /// The time until a contact begins or ends on the way to `work.end`, by halving: it exists if the end lies on another
    /// branch. `work.end` is then the state there.
    fn first_contact(&self, touches: [bool; 2], offset_s: f64, h_s: f64, work: &mut Work) -> Option<f64> {
        if self.touches_after(&work.end, offset_s + h_s) == touches {
            return None;
        }
        let (mut before_s, mut after_s, mut found) = (0.0, h_s, work.end);
        while after_s - before_s > CONTACT_TIME_S {
            let middle_s = 0.5 * (before_s + after_s);
            self.runge_kutta(offset_s, middle_s, work);
            if self.touches_after(&work.end, offset_s + middle_s) == touches {
                before_s = middle_s;
            } else {
                (after_s, found) = (middle_s, work.end);
            }
        }
        work.end = found;
        Some(after_s)
    }

    /// Takes `work.end` as the state at the end of a step that begins `offset_s` after now, and carries the sensors'
    /// low-pass on.
    fn move_on(&mut self, offset_s: f64, step_s: f64, work: &mut Work) {
        if self.has_filter && self.carries_filter {
            let from = self.ideal_imu(&self.state, &work.first.omega);
            let (at, Work { end, later: [last, ..], forces, .. }) = (self.instant(offset_s + step_s), work);
            self.gyrostat.derivative(&at, end, &self.drive, forces, last);
            let to = self.ideal_imu(end, &last.omega);
            self.filter(&from, &to, step_s);
            self.state = *end;
        } else {
            self.state = work.end;
        }
    }

    /// One classical Runge-Kutta step, or one of the midpoint rule, over `h_s` that begins `offset_s` after now, with `work.first`
    /// the derivative there, to `work.end`.
    fn runge_kutta(&self, offset_s: f64, h_s: f64, work: &mut Work) {
        let actuators = &self.gyrostat.model().actuators;
        let hidden = self.gyrostat.effects().hidden_states();
        let (x, half_s) = (&self.state, 0.5 * h_s);
        let Work { first, later: [k2, k3, k4], sum, forces, stage, end } = work;
        let mut derivative = |stage: &State, after_s: f64, to: &mut Derivative| {
            self.gyrostat.derivative(&self.instant(offset_s + after_s), stage, &self.drive, forces, to);
        };
        x.moved(first, half_s, actuators, hidden, stage);
        derivative(stage, half_s, k2);
        if self.by_midpoint {
            x.moved(k2, h_s, actuators, hidden, end);
            actuators.bound(&mut end.actuators);
            end.normalise();
            return;
        }
        x.moved(k2, half_s, actuators, hidden, stage);
        derivative(stage, half_s, k3);
        x.moved(k3, h_s, actuators, hidden, stage);
        derivative(stage, h_s, k4);
        sum.set_runge_kutta_sum([first, k2, k3, k4], actuators, hidden);
        x.moved(sum, h_s / 6.0, actuators, hidden, end);
        actuators.bound(&mut end.actuators);
        end.normalise();
    }

    /// The derivative now, `offset_s` after the start of the segment, to `work.first`.
    fn find_first(&self, offset_s: f64, work: &mut Work) {
        let Work { first, forces, .. } = work;
        self.gyrostat.derivative(&self.instant(offset_s), &self.state, &self.drive, forces, first);
    }

    /// The first part with Coulomb friction whose speed changes sign on the way to `work.end` and the time until then,
    /// found by the secant method. `work.end` is then the state there.
    fn first_stop(&self, offset_s: f64, h_s: f64, work: &mut Work) -> Option<(Part, f64)> {
        let actuators = &self.gyrostat.model().actuators;
        let (start, drives) = (&self.state.actuators, &self.drive.actuators);
        let (part, mut stop_s) = actuators.first_stop(start, &work.end.actuators, drives, h_s)?;
        self.runge_kutta(offset_s, stop_s, work);
        for _ in 0..3 {
            let (from, to) = (actuators.speed(start, part), actuators.speed(&work.end.actuators, part));
            if to.abs() <= 1e-12 || from == to {
                break;
            }
            stop_s = (stop_s * from / (from - to)).clamp(0.0, h_s);
            self.runge_kutta(offset_s, stop_s, work);
        }
        Some((part, stop_s))
    }

    /// Releases stuck parts that are no longer held; true if there were any.
    fn release_parts(&mut self, offset_s: f64, derivative: &Derivative) -> bool {
        let mut released = false;
        loop {
            let (gyrostat, time_s) = (&self.gyrostat, self.time_s() + offset_s);
            let actuators = &gyrostat.model().actuators;
            let environment = || gyrostat.environment(time_s, &self.state, &self.drive);
            let drives = &self.drive.actuators;
            let slip = actuators.first_slip(gyrostat.effects(), &environment, drives, &derivative.omega);
            let Some((part, sense)) = slip else { return released };
            self.slide(part, sense);
            released = true;
        }
    }

    /// Lets a part slide in this sense, or stops it (0).
    fn slide(&mut self, part: Part, sense: f64) {
        let actuators = &self.gyrostat.model().actuators;
        actuators.slide(&mut self.state.actuators, &mut self.drive.actuators, part, sense);
        self.drive.equation = self.gyrostat.rate_equation_now(&self.drive.actuators);
    }

    /// Decides which parts stick, after their motion was set from outside.
    pub(super) fn set_out(&mut self) {
        self.gyrostat.model().actuators.set_out(&self.state.actuators, &mut self.drive.actuators);
        self.drive.equation = self.gyrostat.rate_equation_now(&self.drive.actuators);
        // As if the platform had moved so for a while.
        self.behind_filter = self.ideal_imu(&self.state, &self.angular_acceleration_b_rad_s2());
    }

    fn add_hidden_noise(&mut self, length_s: f64) {
        for (x, intensity) in self.state.hidden.iter_mut().zip(&self.hidden_noise_intensity) {
            *x += intensity * length_s.sqrt() * self.effect_noise.draw();
        }
    }
}
