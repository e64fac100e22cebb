//! The noise that drives the error dynamics, and what is known at the start.

use nalgebra::Vector3;
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_math::{azimuth_rad, vertical_b};

use super::{ACCEL_BIAS, ANGLE, GYRO_BIAS, RATE, Settings, System, WHEEL};

/// Rates and wheel speeds, the states that torques turn.
const TURNED: usize = 3 + MAX_WHEELS;

/// A direction in these states, or a covariance of them.
type Direction = [f64; TURNED];
type Covariance = [Direction; TURNED];

/// Shape of the noise of a platform: what does not change along a run.
pub(super) struct Noise {
    /// Covariance for a unit walk of the rate about every axis.
    rate: Covariance,
    /// Covariance for a unit torque of each wheel's motor.
    wheel: Vec<Covariance>,
    /// Squared acceleration that each jet gives [rad^2/s^4].
    edge: Vec<f64>,
}

fn add_square(sum: &mut Covariance, direction: &Direction) {
    for (row, x) in sum.iter_mut().zip(direction) {
        for (slot, y) in row.iter_mut().zip(direction) {
            *slot += x * y;
        }
    }
}

/// State of the filter of a turned state.
fn state(i: usize) -> usize {
    if i < 3 { RATE + i } else { WHEEL + i - 3 }
}

/// An interval so long is a gap \[s\]: what happened within is beyond one step of the equations,
const GAP_S: f64 = 0.5;

/// if it is also so many times longer than usual.
const GAP: f64 = 5.0;

/// Walk of the rates while the torques are not known [rad/s/sqrt(s)]: any motion that a platform makes.
const BLIND_WALK: f64 = 1.0;

/// How far the attitude that the first readings give may be off \[rad\].
const TILT_RAD: f64 = 0.2;

/// Standard deviation of a heading of which nothing is known: uniform over a turn \[rad\].
const ANY_HEADING_RAD: f64 = 1.813_799_364_234_217_8;

impl System<'_> {
    pub(super) fn noise(&self) -> Noise {
        let wheels = self.mechanics.model().wheels();
        let mut rate = [[0.0; TURNED]; TURNED];
        for i in 0..3 {
            // Free wheels keep their speed in space: what turns the body turns against them.
            let mut direction = [0.0; TURNED];
            let turn = self.mechanics.model().freedom.share(&Vector3::ith(i, 1.0));
            direction[..3].copy_from_slice(turn.as_slice());
            for (slot, wheel) in direction[3..].iter_mut().zip(wheels) {
                *slot = -wheel.spin_axis_b.dot(&turn);
            }
            add_square(&mut rate, &direction);
        }
        let of_wheel = |(j, wheel): (usize, &whorl_dynamics::platform::Wheel)| {
            // The motor's torque turns wheel and body against each other.
            let axis = wheel.spin_axis_b.into_inner();
            let body =
                if self.run.clamped { Vector3::zeros() } else { -(self.mechanics.inverse_inertia() * axis) };
            let mut direction = [0.0; TURNED];
            for (slot, x) in direction.iter_mut().zip(body.iter()) {
                *slot = *x;
            }
            for (other, (slot, w)) in direction[3..].iter_mut().zip(wheels).enumerate() {
                let own = if other == j { 1.0 / wheel.spin_inertia_kg_m2 } else { 0.0 };
                *slot = own - w.spin_axis_b.dot(&body);
            }
            let mut covariance = [[0.0; TURNED]; TURNED];
            add_square(&mut covariance, &direction);
            covariance
        };
        let of_jet = |jet: &whorl_dynamics::platform::Jet| {
            let torque = jet.position_b_m.cross(&(jet.force_direction_b.into_inner() * jet.thrust_n));
            (self.mechanics.inverse_inertia() * torque).norm_squared()
        };
        Noise {
            rate,
            wheel: wheels.iter().enumerate().map(of_wheel).collect(),
            edge: self.mechanics.model().jets().iter().map(of_jet).collect(),
        }
    }

    /// Random-walk intensity of the rate while dry friction holds the body: the friction then balances all other torques, up
    /// to its size either way, and does not follow from the measured rate [rad/s/sqrt(s)].
    pub(crate) fn stiction_walk(&self, k: usize) -> f64 {
        let Settings { stands_rad_s, sticks_s, .. } = self.settings;
        let Some(rate) = self.motion.omega_mid.get(k).map(|w| w.norm()).filter(|w| *w < stands_rad_s) else {
            return 0.0;
        };
        let effects = self.mechanics.gyrostat.effects().iter();
        let torque_n_m: f64 = effects.map(|a| a.effect().holding_torque_n_m(a.values())).sum();
        // The formula comes into its own as the body gets going.
        let share = 1.0 - rate / stands_rad_s;
        share * torque_n_m * self.mechanics.inverse_inertia().trace() / 3.0 * (2.0 * sticks_s).sqrt()
    }

    /// Whether the torques of interval `k` are not known: after a gap any motion is possible, and so it is where the
    /// platform may touch the bearing's stop.
    fn blind(&self, k: usize) -> bool {
        self.run.length(k) > f64::max(GAP_S, GAP * self.run.node_s())
            || match self.run.near_stop.get(k) {
                Some(known) => *known,
                None => self.motion.q_mid.get(k).is_some_and(|q| self.mechanics.near_stop(q)),
            }
    }

    /// Variance of the angular acceleration at node `k` that intervals beside it leave unknown [rad^2/s^4].
    pub(super) fn unknown_acceleration(&self, k: usize) -> f64 {
        let beside = k.saturating_sub(1)..=k;
        beside
            .filter(|i| i + 1 < self.run.nodes() && self.blind(*i))
            .map(|i| BLIND_WALK * BLIND_WALK / self.run.length(i))
            .fold(0.0, f64::max)
    }

    /// Adds the process noise of interval `k`.
    pub(super) fn add_noise<const S: usize>(&self, noise: &Noise, k: usize, p: &mut [[f64; S]; S]) {
        let h = self.run.length(k);
        let model = self.mechanics.model();
        let s = &self.settings;
        let sensors = &model.sensors;
        let mut sum = [[0.0; TURNED]; TURNED];
        let mut add = |covariance: &Covariance, variance: f64| {
            for (row, of) in sum.iter_mut().zip(covariance) {
                for (slot, x) in row.iter_mut().zip(of) {
                    *slot += variance * x;
                }
            }
        };
        if !self.run.clamped {
            let rate = if self.blind(k) { BLIND_WALK } else { s.rate_walk.hypot(self.stiction_walk(k)) };
            let relative = |walk: f64, least: f64| walk.max(least).powi(2) * h;
            // A valve's edge is as uncertain as the stamp that tells of it.
            let edges: f64 =
                self.run.edges.get(k).into_iter().flatten().filter_map(|j| noise.edge.get(*j)).sum();
            add(&noise.rate, rate * rate * h + edges * self.run.stamp_jitter_s.powi(2));
            for i in 0..3 {
                let mut diagonal = |state: usize, variance: f64| p[state][state] += variance;
                diagonal(ANGLE + i, 1e-14 * h);
                diagonal(GYRO_BIAS + i, relative(sensors.gyro.errors.bias_walk[i], s.gyro_bias_walk));
                diagonal(ACCEL_BIAS + i, relative(sensors.accelerometer.errors.bias_walk[i], 1e-6));
                if s.has_torque() {
                    diagonal(WHEEL + self.wheels() + i, s.torque_intensity() * h);
                }
            }
        }
        let motors = self.mechanics.motors(self.run, k);
        for (j, (wheel, covariance)) in model.wheels().iter().zip(&noise.wheel).enumerate() {
            let speed = self.motion.wheel_mid.get(k).and_then(|w| w.get(j)).copied().unwrap_or(0.0);
            let at_limit = speed.abs() > 0.985 * wheel.max_speed_rad_s;
            // Dry friction that pulls either way, anew in each interval.
            let either_way = wheel.coulomb_friction_n_m * (2.0 * h).sqrt();
            let motor = motors[j];
            let intensity = if !self.run.has_wheel_command {
                0.5 * wheel.max_torque_n_m
            } else if self.run.has_wheel_speed && at_limit {
                (2.0 * wheel.coulomb_friction_n_m).max(0.02 * wheel.max_torque_n_m)
            } else if self.mechanics.sticks(self.run, wheel, k, speed, motor) {
                // The faster it seems to turn, the less sure it is that it stands.
                let moves = (speed / self.run.standstill_rad_s(s.wheel_stands_rad_s)).abs().min(1.0);
                s.wheel_noise.max(moves * either_way)
            } else {
                // Just off standstill friction is still not what it is at speed.
                let off = (self.run.standstill_rad_s(s.wheel_stands_rad_s) / speed).powi(2).min(1.0);
                s.wheel_noise.max(off * either_way)
            };
            let intensity = intensity.max(self.run.wheel_jitter[j]);
            add(covariance, intensity * intensity * h);
        }
        let turned = 3 + self.wheels();
        for (i, row) in sum.iter().enumerate().take(turned) {
            for (j, x) in row.iter().enumerate().take(turned) {
                p[state(i)][state(j)] += x;
            }
        }
    }

    /// Where the states are expected at the start of a run. What nothing measures stays about a heading of zero, where every
    /// run is taken to begin: if each fit were a new beginning, headings and a spring's zero would wander off together.
    pub(super) fn initial_state<const S: usize>(&self) -> [f64; S] {
        let mut x = [0.0; S];
        if let Some(q) = self.motion.q.first().filter(|_| !self.run.clamped && !self.run.has_heading()) {
            let back = vertical_b(q) * -azimuth_rad(q);
            x[ANGLE..ANGLE + 3].copy_from_slice(back.as_slice());
        }
        // Rest is where hidden states are expected.
        let start = self.motion.hidden_start(self.mechanics.gyrostat.effects());
        let slots = x.iter_mut().skip(self.first_hidden()).take(self.hidden_states());
        slots.zip(start).for_each(|(slot, from_rest)| *slot = -from_rest);
        x
    }

    /// What is known of the states at the start of a run.
    pub(super) fn initial_covariance<const S: usize>(&self) -> [[f64; S]; S] {
        let mut variance = [0.0; S];
        let sensors = &self.mechanics.model().sensors;
        let clamped = self.run.clamped;
        for i in 0..3 {
            let angle = if clamped { 1e-9 } else { TILT_RAD };
            variance[ANGLE + i] = angle * angle;
            // On a shaft, about it alone.
            let turns = self.mechanics.model().freedom.projection()[(i, i)];
            variance[RATE + i] = if clamped { 1e-20 } else { 0.25 * turns };
            let bias = (3.0 * sensors.gyro.errors.bias_turn_on_stddev[i]).max(0.02);
            variance[GYRO_BIAS + i] = bias * bias;
            let bias = sensors.accelerometer.errors.bias_turn_on_stddev[i].max(1e-4);
            variance[ACCEL_BIAS + i] = bias * bias;
        }
        for (j, limits) in self.mechanics.model().wheels().iter().enumerate() {
            // Where no tachometer says more, anything up to the limit.
            let wheel = if self.run.has_wheel_speed { 5.0 } else { 0.3 * limits.max_speed_rad_s };
            variance[WHEEL + j] = wheel * wheel;
        }
        if self.settings.has_torque() {
            let walked = if self.settings.torque_walk > 0.0 { 0.1 } else { 0.0 };
            for i in 0..3 {
                let background = &self.settings.background;
                variance[WHEEL + self.wheels() + i] = walked * walked + background.stddev_n_m.powi(2);
            }
        }
        let slots = variance.iter_mut().skip(self.first_hidden()).take(self.hidden_states());
        slots.zip(self.hidden_start_stddev()).for_each(|(slot, stddev)| *slot = stddev * stddev);
        let mut p = [[0.0; S]; S];
        for (i, (row, x)) in p.iter_mut().zip(variance).enumerate() {
            row[i] = x;
        }
        let along = self.mechanics.model().freedom.projection();
        for i in 0..3 {
            for j in (0..3).filter(|j| *j != i && !clamped) {
                p[RATE + i][RATE + j] = 0.25 * along[(i, j)];
            }
        }
        if let Some(q) = self.motion.q.first().filter(|_| !clamped && !self.run.has_heading()) {
            // What nothing measures, springs alone can tell.
            let up = vertical_b(q);
            for i in 0..3 {
                for j in 0..3 {
                    p[ANGLE + i][ANGLE + j] += ANY_HEADING_RAD * ANY_HEADING_RAD * up[i] * up[j];
                }
            }
        }
        p
    }
}
