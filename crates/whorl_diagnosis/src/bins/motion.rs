//! The trajectory about which everything is linearised.

use std::collections::BTreeMap;

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::{EffectSet, MAX_HIDDEN_STATES};
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_math::{quaternion_exp, rotation_vector, unit};
use whorl_trajectory::rough_attitude::{pull, start_attitude};

use crate::bins::run::{Run, Wheels};

/// Attitude, rate and wheel speeds at the nodes of a run, and half-way between them.
#[derive(Debug, Clone, Default)]
pub(crate) struct Motion {
    pub q: Vec<UnitQuaternion<f64>>,
    pub omega: Vec<Vector3<f64>>,
    pub wheel: Vec<Wheels>,
    /// Half-way to the next node.
    pub q_mid: Vec<UnitQuaternion<f64>>,
    pub omega_mid: Vec<Vector3<f64>>,
    pub wheel_mid: Vec<Wheels>,
    /// Angle that each wheel has turned since the first node \[rad\].
    pub wheel_angle: Vec<Wheels>,
    /// How far from rest each effect's hidden states are at the start, by the effect's id.
    hidden_start: BTreeMap<&'static str, Vec<f64>>,
}

/// Room for the hidden states of all effects.
pub(crate) type Hidden = [f64; MAX_HIDDEN_STATES];

impl Motion {
    /// From the gyro, pulled towards the vertical and the vector sensors' directions (Mahony et al. 2008,
    /// explicit complementary filter), twice over so that the bias has settled.
    pub fn rough(run: &Run, model: &PlatformModel) -> Self {
        let nodes = run.nodes();
        let mut motion = Self { wheel: rough_wheels(run, model), ..Self::default() };
        if run.clamped {
            motion.q = vec![UnitQuaternion::identity(); nodes];
            motion.omega = vec![Vector3::zeros(); nodes];
            motion.fill_middle(run);
            return motion;
        }
        let rates = filled_rates(run, model);
        let mut bias = model.sensors.gyro.errors.bias;
        let start = initial_attitude(run);
        let sees_vertical = run.accel_axes == [true; 3];
        for pass in 0..2 {
            let mut q = start;
            motion.q.clear();
            motion.omega.clear();
            for (k, rate) in rates.iter().enumerate() {
                motion.q.push(q);
                motion.omega.push(rate - bias);
                let dt = if k + 1 < nodes { run.length(k) } else { 0.0 };
                let mut total = Vector3::zeros();
                if let Some(accel) = run.accel.get(k).filter(|a| a.count > 0.0 && sees_vertical)
                    && let Ok(measured) = unit(accel.value)
                {
                    total += pull(&q, &measured, &Vector3::z());
                }
                for vector in &run.vectors {
                    if let Some(sample) = vector.mean.get(k).filter(|v| v.count > 0.0)
                        && let Ok(measured) = unit(sample.value)
                    {
                        // Rarer than the accelerometer's samples, and as good as several of them.
                        total += 4.0 * pull(&q, &measured, &vector.reference_world);
                    }
                }
                // Steps that turn it by more than it is off would never settle.
                let gain = if pass == 0 && run.time(k) - run.time(0) < 10.0 { 1.0 } else { 0.2 };
                let gain = f64::min(gain, 0.1 / dt.max(1e-9));
                let total = model.freedom.share(&total);
                bias -= total * (0.02 * gain * dt);
                q *= quaternion_exp(&((rate - bias + total * gain) * dt));
            }
        }
        motion.fill_middle(run);
        motion
    }

    /// The states half-way between nodes.
    pub fn fill_middle(&mut self, run: &Run) {
        let nodes = run.nodes();
        self.q_mid.clear();
        self.omega_mid.clear();
        self.wheel_mid.clear();
        self.wheel_angle.clear();
        let mut angle = [0.0; MAX_WHEELS];
        for k in 0..nodes {
            self.wheel_angle.push(angle);
            let next = (k + 1).min(nodes - 1);
            let (Some(q0), Some(q1)) = (self.q.get(k), self.q.get(next)) else { continue };
            let half = rotation_vector(&(q0.inverse() * q1)) * 0.5;
            self.q_mid.push(q0 * quaternion_exp(&half));
            if let (Some(w0), Some(w1)) = (self.omega.get(k), self.omega.get(next)) {
                self.omega_mid.push((w0 + w1) * 0.5);
            }
            if let (Some(a), Some(b)) = (self.wheel.get(k), self.wheel.get(next)) {
                let mut middle = [0.0; MAX_WHEELS];
                for ((m, x), y) in middle.iter_mut().zip(a).zip(b) {
                    *m = 0.5 * (x + y);
                }
                for (a, m) in angle.iter_mut().zip(&middle) {
                    *a += m * run.length_or_zero(k);
                }
                self.wheel_mid.push(middle);
            }
        }
    }

    /// How far from rest the hidden states of effects are at the start: those of a set in its order.
    pub fn hidden_start(&self, effects: &EffectSet) -> Hidden {
        let mut all = [0.0; MAX_HIDDEN_STATES];
        for effect in effects.iter() {
            let own = self.hidden_start_of(effect.effect().info().id);
            let slots = all.get_mut(effect.hidden_range()).unwrap_or_default();
            slots.iter_mut().zip(own).for_each(|(slot, x)| *slot = x);
        }
        all
    }

    /// The same of one effect.
    pub fn hidden_start_of(&self, id: &str) -> Hidden {
        let mut all = [0.0; MAX_HIDDEN_STATES];
        let own = self.hidden_start.get(id).map_or(&[][..], Vec::as_slice);
        all.iter_mut().zip(own).for_each(|(slot, x)| *slot = *x);
        all
    }

    /// Moves the hidden states of a set at the start by small errors.
    pub fn correct_hidden_start(&mut self, effects: &EffectSet, errors: &[f64]) {
        for effect in effects.iter() {
            let range = effect.hidden_range();
            let Some(errors) = errors.get(range.clone()).filter(|errors| !errors.is_empty()) else {
                continue;
            };
            let own = self.hidden_start.entry(effect.effect().info().id).or_default();
            own.resize(range.len(), 0.0);
            own.iter_mut().zip(errors).for_each(|(x, error)| *x += error);
        }
    }

    /// Moves node `k` by small errors.
    pub fn correct(&mut self, k: usize, angle: &Vector3<f64>, rate: &Vector3<f64>, wheels: &[f64]) {
        if let Some(q) = self.q.get_mut(k) {
            *q *= quaternion_exp(angle);
        }
        if let Some(omega) = self.omega.get_mut(k) {
            *omega += rate;
        }
        if let Some(speeds) = self.wheel.get_mut(k) {
            for (speed, change) in speeds.iter_mut().zip(wheels) {
                *speed += change;
            }
        }
    }

    pub fn is_finite(&self) -> bool {
        self.q.iter().all(|q| q.coords.iter().all(|x| x.is_finite()))
            && self.omega.iter().all(|w| w.iter().all(|x| x.is_finite()))
    }
}

/// Gyro means with gaps bridged linearly.
fn filled_rates(run: &Run, model: &PlatformModel) -> Vec<Vector3<f64>> {
    let known: Vec<usize> =
        run.gyro.iter().enumerate().filter(|(_, g)| g.count > 0.0).map(|(k, _)| k).collect();
    let value = |k: usize| {
        let read = run.gyro.get(k).map_or_else(Vector3::zeros, |g| g.value);
        model.freedom.rate_from_gyro_b_rad_s(&read, run.gyro_axes).unwrap_or(read)
    };
    (0..run.nodes())
        .map(|k| {
            let after = known.partition_point(|i| *i < k);
            match (known.get(after), after.checked_sub(1).and_then(|i| known.get(i))) {
                (Some(&b), _) if b == k => value(k),
                (Some(&b), Some(&a)) => value(a).lerp(&value(b), (k - a) as f64 / (b - a) as f64),
                (Some(&b), None) => value(b),
                (None, Some(&a)) => value(a),
                (None, None) => Vector3::zeros(),
            }
        })
        .collect()
}

fn initial_attitude(run: &Run) -> UnitQuaternion<f64> {
    let early = run.nodes().min(run.node_at(run.time(0) + 0.5) + 1);
    let mean = |means: &[whorl_trajectory::bins::Mean3], until: usize| {
        let sum: Vector3<f64> = means.iter().take(until).map(|m| m.value * m.count.min(1.0)).sum();
        unit(sum).ok()
    };
    let accel = if run.accel_axes == [true; 3] { run.accel.as_slice() } else { &[] };
    let up = mean(accel, early.max(1)).unwrap_or_else(Vector3::z_axis);
    // The first vector that is not nearly vertical.
    let seen = run.vectors.iter().find_map(|vector| {
        let reference = unit(vector.reference_world).ok().filter(|r| r.z.abs() <= 0.98)?;
        let first = vector.mean.iter().position(|m| m.count > 0.0).unwrap_or(0);
        Some((mean(&vector.mean, (first + 1).max(early))?.into_inner(), reference))
    });
    match seen {
        // Without a vertical, the shortest turn to what one sensor sees.
        Some((seen_b, reference)) if accel.iter().all(|a| a.count == 0.0) => {
            UnitQuaternion::rotation_between(&seen_b, &reference).unwrap_or_default()
        }
        _ => start_attitude(up, seen),
    }
}

/// Wheel speeds at the nodes: measured with gaps bridged; without a tachometer, integrated commands.
fn rough_wheels(run: &Run, model: &PlatformModel) -> Vec<Wheels> {
    let nodes = run.nodes();
    let mut speeds = vec![[0.0; MAX_WHEELS]; nodes];
    let known: Vec<usize> =
        run.wheel_speed.iter().enumerate().filter(|(_, s)| s.1 > 0.0).map(|(k, _)| k).collect();
    if known.is_empty() {
        for (j, wheel) in model.wheels().iter().enumerate() {
            let mut speed = 0.0;
            for k in 0..nodes {
                if let Some(slot) = speeds.get_mut(k).and_then(|s| s.get_mut(j)) {
                    *slot = speed;
                }
                let torque = run.wheel_command.get(j).map_or(0.0, |c| c.mean_at(k));
                let drag = wheel.viscous_friction_n_m_s * speed;
                let length = if k + 1 < nodes { run.length(k) } else { 0.0 };
                speed += (torque - drag) * length / wheel.spin_inertia_kg_m2;
                speed = speed.max(-wheel.max_speed_rad_s).min(wheel.max_speed_rad_s);
            }
        }
        return speeds;
    }
    let value = |k: usize| run.wheel_speed.get(k).map_or([0.0; MAX_WHEELS], |s| s.0);
    for (k, slot) in speeds.iter_mut().enumerate() {
        let after = known.partition_point(|i| *i < k);
        let (a, b) = match (after.checked_sub(1).and_then(|i| known.get(i)), known.get(after)) {
            (_, Some(&b)) if b == k => (b, b),
            (Some(&a), Some(&b)) => (a, b),
            (Some(&a), None) => (a, a),
            (None, Some(&b)) => (b, b),
            (None, None) => continue,
        };
        let share = if b > a { (k - a) as f64 / (b - a) as f64 } else { 0.0 };
        for ((x, from), to) in slot.iter_mut().zip(value(a)).zip(value(b)) {
            *x = from + (to - from) * share;
        }
    }
    speeds
}
