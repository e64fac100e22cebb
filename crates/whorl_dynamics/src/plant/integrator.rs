//! From one event to the next.

use super::{Plant, PlantError};
use crate::State;
use crate::gyrostat::{Derivative, MAX_WHEELS, sign};
use crate::sensing::Snapshot;

/// Times a segment may be cut where wheels come to a stop, before the rest is taken in one step.
const MAX_STOPS_PER_SEGMENT: usize = 2 * MAX_WHEELS;

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
            if self.valves.next_edge_ns() <= self.now_ns {
                self.valves.settle(self.now_ns);
                self.drive.valve_fraction = self.valves.fractions();
            }
            // Steps keep their grid whatever events cut them, so that results depend little on when
            // the caller looks.
            let elapsed_ns = self.now_ns - self.start_ns;
            let grid_ns = self.now_ns - elapsed_ns % self.step_ns + self.step_ns;
            let end_ns = time_ns.min(grid_ns).min(self.valves.next_edge_ns());
            self.integrate_segment((end_ns - self.now_ns) as f64 * 1e-9);
            self.now_ns = end_ns;
        }
        let motion = self.state.q_world_body.coords.iter().chain(&self.state.omega_wb_b_rad_s);
        if motion.chain(&self.state.wheel_speed_rad_s).copied().all(f64::is_finite) {
            Ok(())
        } else {
            Err(PlantError::Diverged { time_ns })
        }
    }

    /// Integrates over `length_s` without valve edges, cutting where wheels stop or break loose.
    fn integrate_segment(&mut self, length_s: f64) {
        let mut done_s = 0.0;
        let mut first = self.derivative_after(&self.state, 0.0);
        if self.history.is_needed() {
            self.history.push(Snapshot {
                time_ns: self.now_ns,
                q_world_body: self.state.q_world_body,
                omega_wb_b_rad_s: self.state.omega_wb_b_rad_s,
                omega_dot_wb_b_rad_s2: first.omega,
            });
        }
        for _ in 0..MAX_STOPS_PER_SEGMENT {
            if self.release_wheels(done_s, &first) {
                first = self.derivative_after(&self.state, done_s);
            }
            let remaining_s = length_s - done_s;
            let end = self.runge_kutta(done_s, remaining_s, &first);
            let Some((wheel, stop_s, at_stop)) = self.first_stop(done_s, remaining_s, &first, &end) else {
                self.state = end;
                self.add_hidden_noise(length_s);
                return;
            };
            self.state = at_stop;
            if let Some(speed) = self.state.wheel_speed_rad_s.get_mut(wheel) {
                *speed = 0.0;
            }
            self.set_sliding(wheel, 0.0);
            done_s += stop_s;
            first = self.derivative_after(&self.state, done_s);
        }
        self.state = self.runge_kutta(done_s, length_s - done_s, &first);
        self.add_hidden_noise(length_s);
    }

    /// One classical Runge-Kutta step over `h_s` that begins `offset_s` after now; `k1` is the
    /// derivative there.
    fn runge_kutta(&self, offset_s: f64, h_s: f64, k1: &Derivative) -> State {
        let (wheels, hidden) =
            (self.gyrostat.model().wheels().len(), self.gyrostat.effects().hidden_states());
        let x = &self.state;
        let half_s = 0.5 * h_s;
        let k2 = self.derivative_after(&x.moved(k1, half_s, wheels, hidden), offset_s + half_s);
        let k3 = self.derivative_after(&x.moved(&k2, half_s, wheels, hidden), offset_s + half_s);
        let k4 = self.derivative_after(&x.moved(&k3, h_s, wheels, hidden), offset_s + h_s);
        let sum = Derivative::runge_kutta_sum(k1, &k2, &k3, &k4, wheels, hidden);
        let mut end = x.moved(&sum, h_s / 6.0, wheels, hidden);
        end.gas_kg = end.gas_kg.max(0.0);
        end.normalised()
    }

    fn derivative_after(&self, state: &State, offset_s: f64) -> Derivative {
        let jets = self.valves.drive(self.now_ns, offset_s);
        self.gyrostat.derivative(self.time_s() + offset_s, state, &self.drive, &jets)
    }

    /// The first wheel with Coulomb friction whose speed changes sign on the way to `end`: its index,
    /// the time until then and the state there, found by the secant method.
    fn first_stop(
        &self,
        offset_s: f64,
        h_s: f64,
        first: &Derivative,
        end: &State,
    ) -> Option<(usize, f64, State)> {
        let mut found: Option<(usize, f64)> = None;
        for (j, wheel) in self.gyrostat.model().wheels().iter().enumerate() {
            let (sliding, from, to) =
                (self.drive.sliding[j], self.state.wheel_speed_rad_s[j], end.wheel_speed_rad_s[j]);
            if wheel.coulomb_friction_n_m > 0.0 && sliding * to < 0.0 && !self.drive.stuck[j] {
                // A wheel that has just broken loose starts from zero and cannot stop at once.
                let stop_s = if from == 0.0 { 0.0 } else { h_s * from / (from - to) };
                if found.is_none_or(|(_, earliest_s)| stop_s < earliest_s) {
                    found = Some((j, stop_s));
                }
            }
        }
        let (wheel, mut stop_s) = found?;
        let mut at_stop = self.runge_kutta(offset_s, stop_s, first);
        for _ in 0..3 {
            let (from, to) = (self.state.wheel_speed_rad_s[wheel], at_stop.wheel_speed_rad_s[wheel]);
            if to.abs() <= 1e-12 || from == to {
                break;
            }
            stop_s = (stop_s * from / (from - to)).clamp(0.0, h_s);
            at_stop = self.runge_kutta(offset_s, stop_s, first);
        }
        Some((wheel, stop_s, at_stop))
    }

    /// Lets stuck wheels go whose bearing cannot hold them; true if any did.
    fn release_wheels(&mut self, offset_s: f64, derivative: &Derivative) -> bool {
        let mut released = false;
        for j in 0..self.gyrostat.model().wheels().len() {
            if !self.drive.stuck[j] {
                continue;
            }
            let needed_n_m = self.gyrostat.holding_torque_n_m(
                j,
                self.time_s() + offset_s,
                &self.state,
                &self.drive,
                &derivative.omega,
            );
            let limit_n_m = self.gyrostat.model().wheels().get(j).map_or(0.0, |w| w.coulomb_friction_n_m);
            if needed_n_m.abs() > limit_n_m {
                // Friction gives its most in the direction that holds; the wheel slips the other way.
                self.set_sliding(j, -sign(needed_n_m));
                released = true;
            }
        }
        released
    }

    /// Sets the sense of sliding of a wheel's bearing; 0 = stuck, if it has Coulomb friction.
    pub(super) fn set_sliding(&mut self, wheel: usize, sense: f64) {
        let has_friction =
            self.gyrostat.model().wheels().get(wheel).is_some_and(|w| w.coulomb_friction_n_m > 0.0);
        let (Some(sliding), Some(stuck)) =
            (self.drive.sliding.get_mut(wheel), self.drive.stuck.get_mut(wheel))
        else {
            return;
        };
        *sliding = sense;
        *stuck = has_friction && sense == 0.0;
        self.drive.equation = self.gyrostat.rate_equation_with_stuck(&self.drive.stuck);
    }

    fn add_hidden_noise(&mut self, length_s: f64) {
        for (x, intensity) in self.state.hidden.iter_mut().zip(&self.hidden_noise_intensity) {
            *x += intensity * length_s.sqrt() * self.effect_noise.draw();
        }
    }
}
