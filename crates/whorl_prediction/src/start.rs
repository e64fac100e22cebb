//! The state at the first reading, and what is known of it before anything is filtered: a guess by the first readings, as wide as these leave it.

use nalgebra::{DMatrix, DVector, Matrix3, Unit, UnitQuaternion, Vector3};
use whorl_dynamics::Plant;
use whorl_dynamics::plant::{RATE, ROTATION};
use whorl_dynamics::platform::TriaxialErrors;
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
    pub fn moved(&self, change: &DVector<f64>) -> Self {
        let mut moved = self.clone();
        let of = |from: usize| Vector3::from_fn(|i, _| change[from + i]);
        moved.q_world_body *= quaternion_exp(&of(ROTATION.start));
        moved.omega_wb_b_rad_s += of(RATE.start);
        let plant = self.layout.plant;
        plant.wheels().zip(&mut moved.wheel_speed_rad_s).for_each(|(i, speed)| *speed += change[i]);
        plant.hidden().zip(&mut moved.hidden).for_each(|(i, x)| *x += change[i]);
        (plant.size()..self.layout.size()).for_each(|i| moved.beside[i] += change[i]);
        moved
    }

    /// The same about the mean of another, whose disturbances it does not have.
    pub(crate) fn about(mut self, other: &Self) -> Self {
        (self.q_world_body, self.omega_wb_b_rad_s) = (other.q_world_body, other.omega_wb_b_rad_s);
        self.wheel_speed_rad_s.clone_from(&other.wheel_speed_rad_s);
        self.hidden.clone_from(&other.hidden);
        self.layout.own().zip(other.layout.own()).for_each(|(i, k)| self.beside[i] = other.beside[k]);
        self
    }

    /// The same with other disturbances, of which nothing is known but their levels.
    pub(crate) fn with_levels(&self, case: &Prepared<'_>, noise: &Noise) -> Self {
        let mut start = Self::wide(case, noise).about(self);
        start.covariance = start.embedded(&self.covariance, self.layout);
        start
    }

    /// A covariance in coordinates of another layout, with the disturbances of this start.
    pub(crate) fn embedded(&self, covariance: &DMatrix<f64>, of: Layout) -> DMatrix<f64> {
        let mut embedded = self.covariance.clone();
        for (i, from_i) in self.layout.own().zip(of.own()) {
            for (k, from_k) in self.layout.own().zip(of.own()) {
                embedded[(i, k)] = covariance[(from_i, from_k)];
            }
        }
        embedded
    }

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

    /// What is known before anything is filtered, about the likeliest guess: readings at the start with the widths of
    /// [`crate::Settings`], the sensors' biases as the model states them, hidden states at rest.
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
    let stddevs = [&sensors.gyro.errors, &sensors.accelerometer.errors].map(|of| of.bias_turn_on_stddev);
    let biases = [layout.gyro_bias(), layout.force_bias()].into_iter().zip(stddevs);
    biases.flat_map(|(biases, stddev)| biases.zip((0..3).map(move |axis| stddev[axis])))
}

fn layout(case: &Prepared<'_>, noise: &Noise) -> Layout {
    let (sensors, disturbance) = (&case.model().sensors, &noise.disturbance);
    let biased = |channel, errors: &TriaxialErrors| {
        case.reads(channel) && [errors.bias_turn_on_stddev, errors.bias_walk] != [Vector3::zeros(); 2]
    };
    Layout::new(
        case.plant.tangent(),
        if case.clamped { 0 } else { disturbance.body.len() },
        if case.reads(Channel::WheelSpeed) { disturbance.motors_n_m.len() } else { 0 },
        biased(Channel::Gyro, &sensors.gyro.errors),
        biased(Channel::Accelerometer, &sensors.accelerometer.errors),
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

/// Attitude from the first readings of what sees a direction, gravity and references, level where nothing does; with its covariance, body axes \[rad^2\].
fn attitude_guess(
    case: &Prepared<'_>,
    noise: &Noise,
    rate_rad_s: &Vector3<f64>,
    rate_stddev_rad_s: f64,
) -> (UnitQuaternion<f64>, Matrix3<f64>) {
    let (settings, freedom) = (case.settings(), &case.model().freedom);
    // A direction in the body at the first reading, where it is in the world, and how well it is known [rad].
    type Seen = (Unit<Vector3<f64>>, Unit<Vector3<f64>>, f64);
    let seen = |channel, sensor, in_world: Unit<Vector3<f64>>, stddev_rad: f64| -> Option<Seen> {
        let mut tracks = case.tracks.iter().filter(|track| track.is_whole());
        let track = tracks.find(|track| (track.channel, track.sensor) == (channel, sensor))?;
        // A reading that comes later than the first is turned back by as far as the body went, whose rate may have changed by itself meanwhile.
        let late_s = (track.instant_ns(0)? - case.first_ns()) as f64 * 1e-9;
        let back = quaternion_exp(&(rate_rad_s * late_s));
        let turned_rad = late_s * (rate_stddev_rad_s + rate_rad_s.norm());
        Some((unit_or(back * track.vector(0)?, in_world), in_world, stddev_rad.hypot(turned_rad)))
    };
    let vectors = case.recording().vectors.iter().zip(&noise.vector_rad).enumerate();
    let vectors = vectors.filter_map(|(sensor, (of, stddev))| {
        seen(Channel::Vector, sensor, of.reference_world, settings.start_readings * stddev)
    });
    let gravity = || seen(Channel::Accelerometer, 0, Vector3::z_axis(), settings.start_force_rad);
    let mut directions: Vec<Seen> = vectors.chain(freedom.has_weight().then(gravity).flatten()).collect();
    directions.retain(|direction| direction.2.is_finite());
    directions.sort_by(|a, b| a.2.total_cmp(&b.2));
    // What was not seen is as it is level.
    let unknown_rad = settings.start_attitude_rad;
    directions.extend([Vector3::z_axis(), Vector3::x_axis()].map(|axis| (axis, axis, unknown_rad)));
    let (in_body, in_world, first_rad) = directions[0];
    let mut both = directions[1..].iter().filter_map(|(second, second_in_world, second_rad)| {
        let q = attitude_from_two_vectors(&in_body, &in_world, second, second_in_world);
        Some((q.ok()?, *second_rad))
    });
    let (q_world_body, second_rad) =
        both.next().unwrap_or_else(|| (attitude_from_vertical(in_body, 0.0), unknown_rad));
    let along = in_body.into_inner() * in_body.transpose();
    let across = Matrix3::identity() - along;
    let covariance =
        across * first_rad.min(unknown_rad).powi(2) + along * second_rad.min(unknown_rad).powi(2);
    (q_world_body, covariance)
}

/// Attitudes from which a filter finds the likeliest: one where directions are seen, else several about each axis that weight acts on.
pub(crate) fn guesses(case: &Prepared<'_>, wide: &Start) -> Vec<Start> {
    let model = case.model();
    // An accelerometer that lacks axes sees no direction.
    let sees = |channel| case.tracks.iter().any(|track| track.channel == channel && track.is_whole());
    let offset_b = model.mass_properties.gravity_offset_b_n_m();
    let weight = model.freedom.has_weight() && offset_b.norm() > 0.0;
    if case.clamped || !weight || sees(Channel::Accelerometer) || sees(Channel::Vector) {
        return vec![wide.clone()];
    }
    let turn = |k: i32| {
        let angle = std::f64::consts::TAU * f64::from(k) / 6.0;
        let q_world_body = match model.freedom.hinge_axis_b() {
            // The shaft may lie level, and the body hang anywhere about it: down at first.
            Some(axis) => {
                let across = offset_b - axis.into_inner() * axis.dot(offset_b);
                let (below, down) = (unit_or(across, -Vector3::z_axis()), -Vector3::z_axis());
                let down = attitude_from_two_vectors(&below, &down, &axis, &Vector3::x_axis());
                down.unwrap_or_default() * quaternion_exp(&(axis.into_inner() * angle))
            }
            // Tilted to every side.
            None => {
                let tilt = Vector3::new(angle.cos(), angle.sin(), 0.0) * case.settings().start_force_rad;
                wide.q_world_body * quaternion_exp(&tilt)
            }
        };
        Start { q_world_body, ..wide.clone() }
    };
    std::iter::once(wide.clone()).chain((0..6).map(turn)).collect()
}
