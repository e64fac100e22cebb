//! From one event to the next.

use super::{Plant, PlantError};
use crate::State;
use crate::actuators::Part;
use crate::effects::Touching;
use crate::gyrostat::Derivative;
use crate::sensing::Snapshot;

/// Times a segment may be cut where parts come to a stop or contacts begin and end, before the rest is taken in one step:
/// twice for each of eight.
const MAX_STOPS_PER_SEGMENT: usize = 16;
/// How well the beginning and the end of a contact are located \[s\]: at 1 rad/s the torque's jump is then a nanoradian late.
const CONTACT_TIME_S: f64 = 1e-9;

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
            let grid_ns = self.now_ns - elapsed_ns % self.step_ns + self.step_ns;
            let end_ns = time_ns.min(grid_ns).min(event_ns);
            self.integrate_segment((end_ns - self.now_ns) as f64 * 1e-9);
            self.now_ns = end_ns;
        }
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
    fn integrate_segment(&mut self, length_s: f64) {
        let mut done_s = 0.0;
        let mut touches = self.touches_after(&self.state, 0.0);
        self.keep_branches(Some(touches));
        let mut first = self.derivative_after(&self.state, 0.0);
        if self.history.is_needed() {
            self.history.push(Snapshot {
                time_ns: self.now_ns,
                q_world_body: self.state.q_world_body,
                omega_wb_b_rad_s: self.state.omega_wb_b_rad_s,
                omega_dot_wb_b_rad_s2: first.omega,
                behind_filter: self.behind_filter,
            });
        }
        for _ in 0..MAX_STOPS_PER_SEGMENT {
            if self.release_parts(done_s, &first) {
                first = self.derivative_after(&self.state, done_s);
            }
            let remaining_s = length_s - done_s;
            let end = self.runge_kutta(done_s, remaining_s, &first);
            let stop = self.first_stop(done_s, remaining_s, &first, &end);
            let (end, step_s) = stop.as_ref().map_or((&end, remaining_s), |(_, s, state)| (state, *s));
            if let Some((contact_s, at_contact)) = self.first_contact(touches, done_s, step_s, &first, end) {
                self.move_on(at_contact, &first, done_s, contact_s);
                done_s += contact_s;
                touches = self.touches_after(&self.state, done_s);
                self.keep_branches(Some(touches));
                first = self.derivative_after(&self.state, done_s);
                continue;
            }
            let end = *end;
            self.move_on(end, &first, done_s, step_s);
            let Some((part, ..)) = stop else {
                self.keep_branches(None);
                self.add_hidden_noise(length_s);
                return;
            };
            self.slide(part, 0.0);
            done_s += step_s;
            first = self.derivative_after(&self.state, done_s);
        }
        self.keep_branches(None);
        let end = self.runge_kutta(done_s, length_s - done_s, &first);
        self.move_on(end, &first, done_s, length_s - done_s);
        self.add_hidden_noise(length_s);
    }

    fn touches_after(&self, state: &State, offset_s: f64) -> [bool; 2] {
        self.gyrostat.touches(self.time_s() + offset_s, state, &self.drive)
    }

    /// Keeps the branch of each contact for the steps to come; `None`: lets go of them.
    fn keep_branches(&mut self, touches: Option<[bool; 2]>) {
        let [stop, contact] = touches.map_or([Touching::AsItIs; 2], |t| t.map(Touching::branch));
        (self.drive.stop, self.drive.contact) = (stop, contact);
    }

    /// The time until a contact begins or ends on the way to `end`, and the state there, by halving: it exists if the end
    /// lies on another branch.
    fn first_contact(
        &self,
        touches: [bool; 2],
        offset_s: f64,
        h_s: f64,
        first: &Derivative,
        end: &State,
    ) -> Option<(f64, State)> {
        if self.touches_after(end, offset_s + h_s) == touches {
            return None;
        }
        let (mut before_s, mut after_s, mut found) = (0.0, h_s, *end);
        while after_s - before_s > CONTACT_TIME_S {
            let middle_s = 0.5 * (before_s + after_s);
            let middle = self.runge_kutta(offset_s, middle_s, first);
            if self.touches_after(&middle, offset_s + middle_s) == touches {
                before_s = middle_s;
            } else {
                (after_s, found) = (middle_s, middle);
            }
        }
        Some((after_s, found))
    }

    /// Takes the state at the end of a step that begins `offset_s` after now, and carries the sensors' low-pass on.
    fn move_on(&mut self, end: State, first: &Derivative, offset_s: f64, step_s: f64) {
        if self.has_filter {
            let from = self.ideal_imu(&self.state, &first.omega);
            let last = self.derivative_after(&end, offset_s + step_s);
            let to = self.ideal_imu(&end, &last.omega);
            self.filter(&from, &to, step_s);
        }
        self.state = end;
    }

    /// One classical Runge-Kutta step over `h_s` that begins `offset_s` after now; `k1` is the
    /// derivative there.
    fn runge_kutta(&self, offset_s: f64, h_s: f64, k1: &Derivative) -> State {
        let actuators = &self.gyrostat.model().actuators;
        let hidden = self.gyrostat.effects().hidden_states();
        let x = &self.state;
        let half_s = 0.5 * h_s;
        let k2 = self.derivative_after(&x.moved(k1, half_s, actuators, hidden), offset_s + half_s);
        let k3 = self.derivative_after(&x.moved(&k2, half_s, actuators, hidden), offset_s + half_s);
        let k4 = self.derivative_after(&x.moved(&k3, h_s, actuators, hidden), offset_s + h_s);
        let sum = Derivative::runge_kutta_sum([k1, &k2, &k3, &k4], actuators, hidden);
        let mut end = x.moved(&sum, h_s / 6.0, actuators, hidden);
        actuators.bound(&mut end.actuators);
        end.normalised()
    }

    fn derivative_after(&self, state: &State, offset_s: f64) -> Derivative {
        self.gyrostat.derivative(&self.instant(offset_s), state, &self.drive)
    }

    /// The first part with Coulomb friction whose speed changes sign on the way to `end`, the time until then and the
    /// state there, found by the secant method.
    fn first_stop(
        &self,
        offset_s: f64,
        h_s: f64,
        first: &Derivative,
        end: &State,
    ) -> Option<(Part, f64, State)> {
        let actuators = &self.gyrostat.model().actuators;
        let (start, drives) = (&self.state.actuators, &self.drive.actuators);
        let (part, mut stop_s) = actuators.first_stop(start, &end.actuators, drives, h_s)?;
        let mut at_stop = self.runge_kutta(offset_s, stop_s, first);
        for _ in 0..3 {
            let (from, to) = (actuators.speed(start, part), actuators.speed(&at_stop.actuators, part));
            if to.abs() <= 1e-12 || from == to {
                break;
            }
            stop_s = (stop_s * from / (from - to)).clamp(0.0, h_s);
            at_stop = self.runge_kutta(offset_s, stop_s, first);
        }
        Some((part, stop_s, at_stop))
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
