//! How the prediction of a run changes per unit of each column of a group.
//!
//! All columns of a group go through the run together, so that what they share is computed once: the state in
//! each interval, and the base model's accelerations, from which a column that adds one torque differs by that
//! torque alone.

use nalgebra::{Matrix3, Vector3};
use whorl_dynamics::Environment;
use whorl_dynamics::effects::MAX_HIDDEN_STATES;
use whorl_dynamics::gyrostat::MAX_WHEELS;

use super::Linearised;
use super::moved::{Moved, OneEffect, Way};
use crate::bins::inputs::Inputs;
use crate::bins::motion::{Hidden, Motion};
use crate::bins::run::{Run, Wheels};
use crate::whitening::mechanics::{HeldBack, Mechanics, StepEnvironments, Steps};

/// How a run's prediction changes per unit of a column; what is empty does not change.
#[derive(Debug, Default)]
pub(super) struct Change {
    pub omega_dot: Vec<Vector3<f64>>,
    pub wheel_dot: Vec<Wheels>,
    pub gyro: Vec<Vector3<f64>>,
    pub accel: Vec<Vector3<f64>>,
    pub vectors: Vec<Vec<Vector3<f64>>>,
}

/// Changes of a run for a group of columns.
pub(super) fn changes(run: &Run, motion: &Motion, base: &Linearised, moved: &[Moved]) -> Vec<Change> {
    let mut changes: Vec<Change> = moved.iter().map(|_| Change::default()).collect();
    dynamics(run, motion, base, moved, &mut changes);
    readings(run, motion, base, moved, &mut changes);
    changes
}

/// A column on its way through the run.
struct Walker<'a> {
    lane: usize,
    mechanics: &'a Mechanics,
    per_unit: f64,
    way: &'a Way,
    /// Its own inputs, if they are not the base's.
    inputs: Option<Inputs>,
    hidden: Hidden,
    hidden_before: Hidden,
    /// Acceleration per base acceleration because other inertia resists; `None` where it does not.
    resistance: Option<Matrix3<f64>>,
}

impl<'a> Walker<'a> {
    fn new(run: &Run, motion: &Motion, base: &Linearised, lane: usize, moved: &'a Moved) -> Option<Self> {
        let way = moved.motion.as_ref()?;
        let inputs = moved.valves.then(|| {
            let mut inputs = moved.mechanics.inputs(run);
            for (slot, active) in inputs.jet_active.iter_mut().zip(&base.inputs.jet_active) {
                *slot |= active;
            }
            inputs
        });
        let mechanics = &moved.mechanics;
        let (own, before) = (mechanics.gyrostat.rate_equation(), base.mechanics.gyrostat.rate_equation());
        let resistance = (own.inverse_resisting() != before.inverse_resisting())
            .then(|| own.inverse_resisting() * before.resisting_b_kg_m2() - Matrix3::identity());
        let hidden = match way {
            Way::Torque(one) => motion.hidden_start_of(one.effect.info().id),
            _ => motion.hidden_start(mechanics.gyrostat.effects()),
        };
        Some(Self {
            lane,
            mechanics,
            per_unit: 1.0 / moved.units,
            way,
            inputs,
            hidden,
            hidden_before: hidden,
            resistance,
        })
    }

    fn has_hidden_states(&self) -> bool {
        match self.way {
            Way::Torque(one) => one.hidden_states > 0,
            _ => self.mechanics.gyrostat.effects().hidden_states() > 0,
        }
    }

    /// Change of the accelerations in interval `k`.
    fn rates(
        &mut self,
        run: &Run,
        base: &Linearised,
        k: usize,
        interval: &Environment<'_>,
        motion_steps: &Steps,
        steps: &StepEnvironments<'_>,
    ) -> (Vector3<f64>, Wheels) {
        let before = (base.prediction.omega_dot[k], &base.prediction.wheel_dot[k]);
        if let Way::Torque(one) = self.way {
            let (torque, wheel_torque) =
                one.difference(interval, steps, &mut self.hidden, &mut self.hidden_before);
            return self.pushed(run, &before.0, torque, &wheel_torque);
        }
        let own = Environment {
            model: self.mechanics.model(),
            valve_fraction: self.inputs.as_ref().map_or(interval.valve_fraction, |i| i.jets_at(k)),
            ..*interval
        };
        let hidden_states = self.mechanics.gyrostat.effects().hidden_states().min(MAX_HIDDEN_STATES);
        let (omega_dot, mut wheel_dot) = if hidden_states > 0 && steps.count() > 0 {
            let hidden = &mut self.hidden[..hidden_states];
            self.mechanics.rates_with_hidden(run, k, &motion_steps.environments(&own), hidden)
        } else {
            self.mechanics.rates(run, k, &own, &[])
        };
        for (after, before) in wheel_dot.iter_mut().zip(before.1) {
            *after -= before;
        }
        (omega_dot - before.0, wheel_dot)
    }

    /// What a torque on body and wheels adds to the base's accelerations.
    fn pushed(
        &self,
        run: &Run,
        before: &Vector3<f64>,
        mut torque: Vector3<f64>,
        wheel_torque: &Wheels,
    ) -> (Vector3<f64>, Wheels) {
        let (gyrostat, stuck) = (&self.mechanics.gyrostat, [false; MAX_WHEELS]);
        let mut omega_dot = Vector3::zeros();
        if !run.clamped {
            torque -= gyrostat.on_wheels_b_n_m(wheel_torque, &stuck);
            omega_dot = self.mechanics.inverse_inertia() * torque;
            if let Some(resistance) = &self.resistance {
                omega_dot += resistance * before;
            }
        }
        (omega_dot, gyrostat.wheel_accelerations_rad_s2(wheel_torque, &stuck, &omega_dot))
    }

    /// Change of the rate that edges within node `k`'s samples add.
    fn edge_rate(&self, run: &Run, base: &Linearised, k: usize) -> Vector3<f64> {
        let before = base.prediction.edge_rate[k];
        match (self.way, &self.resistance) {
            (Way::Torque(_), None) => Vector3::zeros(),
            (Way::Torque(_), Some(resistance)) => resistance * before,
            _ => {
                let inputs = self.inputs.as_ref().unwrap_or(&base.inputs);
                self.mechanics.edge_rate(run, inputs, k) - before
            }
        }
    }
}

impl OneEffect {
    /// Torque on body and wheels after less before, mean over an interval.
    fn difference(
        &self,
        interval: &Environment<'_>,
        steps: &StepEnvironments<'_>,
        hidden: &mut Hidden,
        hidden_before: &mut Hidden,
    ) -> (Vector3<f64>, Wheels) {
        let mut torque = self.torque(&self.after, 1.0, interval, steps, hidden);
        if let Some(values) = &self.before {
            let before = self.torque(values, -1.0, interval, steps, hidden_before);
            torque.0 += before.0;
            torque.1.iter_mut().zip(before.1).for_each(|(a, b)| *a += b);
        }
        torque
    }

    /// `factor` times the torque with `values`.
    fn torque(
        &self,
        values: &[f64],
        factor: f64,
        interval: &Environment<'_>,
        steps: &StepEnvironments<'_>,
        hidden: &mut Hidden,
    ) -> (Vector3<f64>, Wheels) {
        let wheels = interval.model.wheels().len();
        let at = |environment: &Environment<'_>, hidden: &[f64]| {
            let mut wheel_torque = [0.0; MAX_WHEELS];
            self.effect.add_wheel_torque_n_m(values, environment, &mut wheel_torque[..wheels]);
            (self.effect.torque_b_n_m(values, environment, hidden) * factor, wheel_torque.map(|u| u * factor))
        };
        let states = self.hidden_states.min(MAX_HIDDEN_STATES);
        if states == 0 || steps.count() == 0 {
            return at(interval, &[]);
        }
        let mut sum = (Vector3::zeros(), [0.0; MAX_WHEELS]);
        steps.carry(
            &mut hidden[..states],
            |environment, x, rate| self.effect.hidden_derivative(values, environment, x, rate),
            |environment, x| {
                let (torque, wheel_torque) = at(environment, x);
                sum.0 += torque;
                sum.1.iter_mut().zip(wheel_torque).for_each(|(a, b)| *a += b);
            },
        );
        let share = 1.0 / steps.count() as f64;
        (sum.0 * share, sum.1.map(|u| u * share))
    }
}

fn dynamics(run: &Run, motion: &Motion, base: &Linearised, moved: &[Moved], changes: &mut [Change]) {
    let nodes = run.nodes();
    let mut walkers: Vec<Walker<'_>> =
        moved.iter().enumerate().filter_map(|(lane, m)| Walker::new(run, motion, base, lane, m)).collect();
    for walker in &walkers {
        let change = &mut changes[walker.lane];
        change.omega_dot = vec![Vector3::zeros(); nodes];
        change.wheel_dot = vec![[0.0; MAX_WHEELS]; nodes];
        if !run.clamped {
            change.gyro = vec![Vector3::zeros(); nodes];
        }
    }
    let with_steps = walkers.iter().any(Walker::has_hidden_states);
    let mut steps = Steps::default();
    for k in 0..nodes {
        let drive = base.mechanics.drive(run, motion, k);
        let interval = base.mechanics.interval_environment(run, motion, &base.inputs, &drive, k);
        let shared = match &interval {
            Some(interval) if with_steps && steps.fill(run, motion, k) => steps.environments(interval),
            _ => StepEnvironments::default(),
        };
        for walker in &mut walkers {
            let inputs = walker.inputs.as_ref().unwrap_or(&base.inputs);
            if matches!(walker.way, Way::Jets) && !inputs.is_active(k) {
                continue;
            }
            let change = &mut changes[walker.lane];
            if let Some(interval) = &interval {
                let (omega_dot, wheel_dot) = walker.rates(run, base, k, interval, &steps, &shared);
                change.omega_dot[k] = omega_dot * walker.per_unit;
                change.wheel_dot[k] = wheel_dot.map(|x| x * walker.per_unit);
            }
            if !run.clamped {
                change.gyro[k] = walker.edge_rate(run, base, k) * walker.per_unit;
            }
        }
    }
    if run.clamped {
        return;
    }
    // The accelerometer feels the angular acceleration at its lever arm.
    let lever = base.mechanics.model().sensors.accelerometer.lever_arm_b_m;
    for walker in &walkers {
        let change = &mut changes[walker.lane];
        let at = |k: usize| change.omega_dot.get(k).copied().unwrap_or_default();
        change.accel = (0..nodes)
            .map(|k| if k == 0 { at(0) } else { (at(k - 1) + at(k)) * 0.5 }.cross(&lever))
            .collect();
        let held_back = base.mechanics.held_back_of_change(run, &change.omega_dot);
        change.gyro.iter_mut().zip(&held_back.gyro).for_each(|(rate, held)| *rate -= held);
        change.accel.iter_mut().zip(&held_back.accel).for_each(|(force, held)| *force -= held);
    }
}

fn readings(run: &Run, motion: &Motion, base: &Linearised, moved: &[Moved], changes: &mut [Change]) {
    let nodes = run.nodes();
    let reading: Vec<(usize, &Moved)> = moved.iter().enumerate().filter(|(_, m)| m.readings).collect();
    if reading.is_empty() {
        return;
    }
    for (lane, _) in &reading {
        let change = &mut changes[*lane];
        change.gyro.resize(nodes, Vector3::zeros());
        change.accel.resize(nodes, Vector3::zeros());
    }
    let (inputs, prediction) = (&base.inputs, &base.prediction);
    let own: Vec<Option<HeldBack>> = reading
        .iter()
        .map(|(_, moved)| {
            let differ = !moved.mechanics.filters_alike(&base.mechanics);
            differ.then(|| moved.mechanics.held_back(run, motion, &prediction.omega_dot))
        })
        .collect();
    for k in 0..nodes {
        let motors = base.mechanics.motors(run, k);
        let shared = base.mechanics.node_environment(run, motion, inputs, prediction, &motors, k);
        let Some(shared) = shared else { continue };
        for ((lane, moved), own) in reading.iter().zip(&own) {
            let mechanics = &moved.mechanics;
            let held_back = own.as_ref().unwrap_or(&prediction.held_back);
            let (gyro, accel) = if mechanics.latency_s() == base.mechanics.latency_s() {
                let environment = Environment { model: mechanics.model(), ..shared };
                mechanics.imu(&environment, &prediction.edge_rate[k], held_back, k)
            } else {
                let Some(environment) =
                    mechanics.node_environment(run, motion, inputs, prediction, &motors, k)
                else {
                    continue;
                };
                mechanics.imu(&environment, &prediction.edge_rate[k], held_back, k)
            };
            let change = &mut changes[*lane];
            change.gyro[k] += (gyro - prediction.gyro[k]) / moved.units;
            change.accel[k] += (accel - prediction.accel[k]) / moved.units;
        }
    }
    for (lane, moved) in &reading {
        let mechanics = &moved.mechanics;
        if mechanics.model().sensors.vector == base.mechanics.model().sensors.vector {
            continue;
        }
        let of_sensor = |v: usize, before: &[Vector3<f64>]| -> Vec<Vector3<f64>> {
            let after = |k: usize| mechanics.direction_b(run, motion, v, k).unwrap_or_default();
            before.iter().enumerate().map(|(k, b)| (after(k) - b) / moved.units).collect()
        };
        changes[*lane].vectors =
            prediction.vectors.iter().enumerate().map(|(v, before)| of_sensor(v, before)).collect();
    }
}
