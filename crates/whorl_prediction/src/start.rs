//! The state at the first reading, and what is known of it before anything is filtered: a guess by the first readings, as wide as these leave it.

use std::ops::Range;

use nalgebra::{DMatrix, DVector, Matrix3, Unit, UnitQuaternion, Vector3};
use whorl_dynamics::Plant;
use whorl_dynamics::plant::{RATE, ROTATION};
use whorl_math::{attitude_from_two_vectors, attitude_from_vertical, quaternion_exp, unit_or};
use whorl_recording::Channel;

use crate::noise::{Layout, Noise};
use crate::prepared::{Prepared, fastest};

/// The state at the first reading: a normal distribution.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// What the coordinates of `covariance` and `beside` are.
    pub layout: Layout,
    /// Attitude, v_world = q v_body.
    pub q_world_body: UnitQuaternion<f64>,
    /// Body rate, body axes [rad/s].
    pub omega_wb_b_rad_s: Vector3<f64>,
    /// Wheel speeds relative to the body [rad/s].
    pub wheel_speed_rad_s: Vec<f64>,
    /// Hidden states of effects.
    pub hidden: Vec<f64>,
    /// Disturbance and biases at their places in the layout; the plant's entries are zero.
    pub beside: DVector<f64>,
    /// Covariance, in the layout's coordinates and units.
    pub covariance: DMatrix<f64>,
}

impl Start {
    /// The same distribution about another mean: changed by coordinates of the layout.
    #[must_use]
    pub fn moved(&self, change: &DVector<f64>) -> Self {
        let mut moved = self.clone();
        let of = |from: usize| Vector3::from_fn(|i, _| change[from + i]);
        moved.q_world_body *= quaternion_exp(&of(ROTATION.start));
        moved.omega_wb_b_rad_s += of(RATE.start);
        for (i, speed) in self.layout.plant.wheels().zip(&mut moved.wheel_speed_rad_s) {
            *speed += change[i];
        }
        for (i, x) in self.layout.plant.hidden().zip(&mut moved.hidden) {
            *x += change[i];
        }
        for i in self.layout.plant.size()..self.layout.size() {
            moved.beside[i] += change[i];
        }
        moved
    }

    /// The same about the mean of another, whose disturbances it does not have.
    #[must_use]
    pub(crate) fn about(mut self, other: &Self) -> Self {
        (self.q_world_body, self.omega_wb_b_rad_s) = (other.q_world_body, other.omega_wb_b_rad_s);
        self.wheel_speed_rad_s.clone_from(&other.wheel_speed_rad_s);
        self.hidden.clone_from(&other.hidden);
        for (i, k) in self.layout.own().zip(other.layout.own()) {
            self.beside[i] = other.beside[k];
        }
        self
    }

    /// The same with other disturbances, of which nothing is known but their levels.
    #[must_use]
    pub(crate) fn with_levels(&self, case: &Prepared<'_>, noise: &Noise) -> Self {
        let mut start = Self::wide(case, noise).about(self);
        start.covariance = start.embedded(&self.covariance, self.layout);
        start
    }

    /// A covariance in coordinates of another layout, with the disturbances of this start.
    #[must_use]
    pub(crate) fn embedded(&self, covariance: &DMatrix<f64>, of: Layout) -> DMatrix<f64> {
        let mut embedded = self.covariance.clone();
        for (i, from_i) in self.layout.own().zip(of.own()) {
            for (k, from_k) in self.layout.own().zip(of.own()) {
                embedded[(i, k)] = covariance[(from_i, from_k)];
            }
        }
        embedded
    }

    /// Whether it has the states of this model.
    pub(crate) fn is_of(&self, case: &Prepared<'_>) -> bool {
        self.layout.plant == case.plant.tangent()
    }

    pub(crate) fn put(&self, plant: &mut Plant) {
        // Of another number of wheels it cannot be: the recording was checked against the model.
        let _ = plant.set_motion(&self.q_world_body, &self.omega_wb_b_rad_s, &self.wheel_speed_rad_s);
        let mut change = vec![0.0; self.layout.plant.size()];
        for ((i, wanted), now) in self.layout.plant.hidden().zip(&self.hidden).zip(plant.state().hidden) {
            change[i] = wanted - now;
        }
        plant.change_state(&change);
    }
}

impl Start {
    /// What is known before anything is filtered, about the likeliest guess: readings at the start with the widths of
    /// [`crate::Settings`], the sensors' biases as the model states them, hidden states at rest.
    #[must_use]
    pub fn wide(case: &Prepared<'_>, noise: &Noise) -> Self {
        let layout = layout(case, noise);
        let (model, recording, settings) = (case.model(), case.recording(), case.settings());
        let first = recording.gyro_b_rad_s.value.first().copied().unwrap_or_default();
        let rate = model.freedom.rate_from_gyro_b_rad_s(&first, recording.gyro_axes()).unwrap_or_default();
        let turn_on = &model.sensors.gyro.errors.bias_turn_on_stddev;
        let rate_stddev =
            settings.start_readings * Vector3::from(noise.gyro_rad_s).amax().hypot(turn_on.amax());
        let speeds = &recording.wheel_speed_rad_s.value;
        let mut covariance = DMatrix::zeros(layout.size(), layout.size());
        let is_read = |j: usize| speeds.iter().any(|speeds| speeds.get(j).is_some_and(|x| x.is_finite()));
        let of_wheels = layout.plant.wheels().enumerate().filter(|(j, _)| is_read(*j));
        let of_wheels = of_wheels.map(|(_, i)| (i, settings.start_readings * noise.wheel_speed_rad_s));
        // What is left of an earlier motion may push so much.
        let rest_torque = fastest_change(case).0;
        let hidden = case.plant.gyrostat().effects().hidden_start_stddev(model, rest_torque);
        let known = of_wheels
            .chain(layout.plant.hidden().zip(hidden))
            .chain(noise.disturbance.coordinates(layout).map(|(i, stddev, _)| (i, stddev)))
            .chain(known_biases(case, layout));
        known.for_each(|(i, stddev)| covariance[(i, i)] = stddev * stddev);
        let (q_world_body, of_attitude) = attitude_guess(case, noise, &rate, rate_stddev);
        if !case.clamped {
            let share = model.freedom.projection() * (rate_stddev * rate_stddev);
            covariance.view_mut((RATE.start, RATE.start), (3, 3)).copy_from(&share);
            covariance.view_mut((ROTATION.start, ROTATION.start), (3, 3)).copy_from(&of_attitude);
        }
        Self {
            layout,
            q_world_body,
            omega_wb_b_rad_s: if case.clamped { Vector3::zeros() } else { rate },
            wheel_speed_rad_s: speeds.first().cloned().unwrap_or_else(|| vec![0.0; model.wheels().len()]),
            hidden: vec![0.0; layout.plant.hidden().len()],
            beside: DVector::zeros(layout.size()),
            covariance,
        }
    }
}

/// Standard deviations of the sensors' biases before a run, about none, as the model states them; in their units.
pub(crate) fn known_biases(case: &Prepared<'_>, layout: Layout) -> impl Iterator<Item = (usize, f64)> {
    let sensors = &case.model().sensors;
    let of = |biases: Range<usize>, stddev: Vector3<f64>| (0..3).map(move |axis| stddev[axis]).zip(biases);
    let gyro = of(layout.gyro_bias(), sensors.gyro.errors.bias_turn_on_stddev);
    let force = of(layout.force_bias(), sensors.accelerometer.errors.bias_turn_on_stddev);
    gyro.chain(force).map(|(stddev, i)| (i, stddev))
}

fn layout(case: &Prepared<'_>, noise: &Noise) -> Layout {
    let sensors = &case.model().sensors;
    let there = |channel| case.tracks.iter().any(|track| track.channel == channel);
    let biased = |errors: &whorl_dynamics::platform::TriaxialErrors| {
        errors.bias_turn_on_stddev != Vector3::zeros() || errors.bias_walk != Vector3::zeros()
    };
    Layout::new(
        case.plant.tangent(),
        if case.clamped { 0 } else { noise.disturbance.processes().count() },
        if there(Channel::WheelSpeed) { noise.disturbance.motors() } else { 0 },
        there(Channel::Gyro) && biased(&sensors.gyro.errors),
        there(Channel::Accelerometer) && biased(&sensors.accelerometer.errors),
    )
}

/// Torques that give the body, and each wheel, the fastest motion of the run within a second [N m].
pub(crate) fn fastest_change(case: &Prepared<'_>) -> (f64, Vec<f64>) {
    let wheels = case.model.wheels();
    let (rate, speeds) = fastest(case.recording, wheels.len());
    let inertia = case.model.mass_properties.inertia_b_kg_m2().trace() / 3.0;
    let wheels = wheels.iter().zip(&speeds).map(|(wheel, speed)| wheel.spin_inertia_kg_m2 * speed.abs());
    (inertia * rate.norm(), wheels.collect())
}

/// A direction that was seen, in the body at the first reading, where it is in the world, and how well it is known \[rad\].
struct Seen {
    in_body: Unit<Vector3<f64>>,
    in_world: Unit<Vector3<f64>>,
    stddev_rad: f64,
}

/// Attitude from the first readings of what sees a direction: gravity and references; level where nothing does. With the covariance of a rotation
/// about the body's axes \[rad^2\].
fn attitude_guess(
    case: &Prepared<'_>,
    noise: &Noise,
    rate_rad_s: &Vector3<f64>,
    rate_stddev_rad_s: f64,
) -> (UnitQuaternion<f64>, Matrix3<f64>) {
    let (settings, freedom) = (case.settings(), &case.model().freedom);
    // A reading that comes later than the first is turned back by as far as the body went.
    let seen = |channel, sensor, in_world: Unit<Vector3<f64>>, stddev_rad: f64| {
        let mut tracks = case.tracks.iter().filter(|track| track.is_whole());
        let track = tracks.find(|track| (track.channel, track.sensor) == (channel, sensor))?;
        let late_s = (track.instant_ns(0)? - case.first_ns()) as f64 * 1e-9;
        let back = quaternion_exp(&(rate_rad_s * late_s));
        // The rate may have changed by itself meanwhile.
        let turned = late_s * (rate_stddev_rad_s + rate_rad_s.norm());
        let in_body = unit_or(back * track.vector(0)?, in_world);
        Some(Seen { in_body, in_world, stddev_rad: stddev_rad.hypot(turned) })
    };
    let vectors = case.recording().vectors.iter().zip(&noise.vector_rad).enumerate();
    let mut directions: Vec<Seen> = vectors
        .filter_map(|(sensor, (of, stddev))| {
            seen(Channel::Vector, sensor, of.reference_world, settings.start_readings * stddev)
        })
        .collect();
    if freedom.has_weight() {
        directions.extend(seen(Channel::Accelerometer, 0, Vector3::z_axis(), settings.start_force_rad));
    }
    directions.retain(|direction| direction.stddev_rad.is_finite());
    directions.sort_by(|a, b| a.stddev_rad.total_cmp(&b.stddev_rad));
    // What was not seen is as it is level.
    let unknown_rad = settings.start_attitude_rad;
    let level = [Vector3::z_axis(), Vector3::x_axis()];
    directions.extend(level.map(|axis| Seen { in_body: axis, in_world: axis, stddev_rad: unknown_rad }));
    let (primary, rest) = (&directions[0], &directions[1..]);
    let (q_world_body, second_rad) = rest
        .iter()
        .find_map(|second| {
            let q = attitude_from_two_vectors(
                &primary.in_body,
                &primary.in_world,
                &second.in_body,
                &second.in_world,
            );
            Some((q.ok()?, second.stddev_rad))
        })
        .unwrap_or_else(|| (attitude_from_vertical(primary.in_body, 0.0), unknown_rad));
    let along = primary.in_body.into_inner() * primary.in_body.transpose();
    let across = Matrix3::identity() - along;
    let covariance =
        across * primary.stddev_rad.min(unknown_rad).powi(2) + along * second_rad.min(unknown_rad).powi(2);
    (q_world_body, covariance)
}

/// Attitudes from which a filter finds the likeliest: one where directions are seen, else several about each axis that
/// weight acts on.
pub(crate) fn guesses(case: &Prepared<'_>, wide: &Start) -> Vec<Start> {
    let model = case.model();
    // An accelerometer that lacks axes sees no direction.
    let sees = |channel| case.tracks.iter().any(|track| track.channel == channel && track.is_whole());
    let weight = model.freedom.has_weight() && model.mass_properties.gravity_offset_b_n_m().norm() > 0.0;
    if case.clamped || !weight || sees(Channel::Accelerometer) || sees(Channel::Vector) {
        return vec![wide.clone()];
    }
    let from = |q_world_body| Start { q_world_body, ..wide.clone() };
    let turns = (0..6).map(|k| std::f64::consts::TAU * f64::from(k) / 6.0);
    let others: Vec<Start> = match model.freedom.hinge_axis_b() {
        // The shaft may lie, and the body hang anywhere about it.
        Some(axis) => {
            let down = hanging(&axis, model.mass_properties.gravity_offset_b_n_m());
            turns.map(|angle| from(down * quaternion_exp(&(axis.into_inner() * angle)))).collect()
        }
        // Tilted to every side.
        None => turns
            .map(|angle| Vector3::new(angle.cos(), angle.sin(), 0.0) * case.settings().start_force_rad)
            .map(|tilt| from(wide.q_world_body * quaternion_exp(&tilt)))
            .collect(),
    };
    std::iter::once(wide.clone()).chain(others).collect()
}

/// The attitude in which the shaft lies level and the centre of mass hangs below it.
fn hanging(axis_b: &Unit<Vector3<f64>>, offset_b: &Vector3<f64>) -> UnitQuaternion<f64> {
    let across = offset_b - axis_b.into_inner() * axis_b.dot(offset_b);
    let below = unit_or(across, -Vector3::z_axis());
    attitude_from_two_vectors(&below, &-Vector3::z_axis(), axis_b, &Vector3::x_axis())
        .unwrap_or_else(|_| UnitQuaternion::identity())
}
