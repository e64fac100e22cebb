//! What is known of the start before anything is filtered: a guess by the first readings, as wide as these leave it.

use std::ops::Range;

use nalgebra::{DMatrix, DVector, Matrix3, Unit, UnitQuaternion, Vector3};
use whorl_dynamics::plant::{RATE, ROTATION};
use whorl_math::{attitude_from_two_vectors, attitude_from_vertical, quaternion_exp, unit_or};
use whorl_recording::Channel;

use crate::layout::Layout;
use crate::noise::Noise;
use crate::prepared::Prepared;
use crate::start::Start;

impl Start {
    /// What is known before anything is filtered, about the likeliest guess: readings at the start with the widths of
    /// [`crate::Settings`], the sensors' biases as the model states them, hidden states at rest.
    #[must_use]
    pub fn wide(case: &Prepared<'_>, noise: &Noise) -> Self {
        let layout = layout(case, noise);
        let (model, recording, settings) = (case.model(), case.recording(), case.settings());
        let gyro = &recording.gyro_b_rad_s.value;
        let first = gyro.first().copied().unwrap_or_default();
        let rate_stddev = settings.start_readings
            * Vector3::from(noise.gyro_rad_s)
                .amax()
                .hypot(model.sensors.gyro.errors.bias_turn_on_stddev.amax());
        let rate = model.freedom.rate_from_gyro_b_rad_s(&first, recording.gyro_axes()).unwrap_or_default();
        let speeds = &recording.wheel_speed_rad_s.value;
        let wheels = model.wheels().len();
        let wheel_speed_rad_s = speeds.first().cloned().unwrap_or_else(|| vec![0.0; wheels]);
        let mut covariance = DMatrix::zeros(layout.size(), layout.size());
        let mut set = |i: usize, stddev: f64| covariance[(i, i)] = stddev * stddev;
        let turns = !case.is_clamped();
        for (j, i) in layout.plant.wheels().enumerate() {
            let read = speeds.iter().any(|speeds| speeds.get(j).is_some_and(|x| x.is_finite()));
            set(i, if read { settings.start_readings * noise.wheel_speed_rad_s } else { 0.0 });
        }
        // What is left of an earlier motion may push so much.
        let rest_torque = fastest_change(case).0;
        for (i, stddev) in layout.plant.hidden().zip(case.hidden_start_stddev(rest_torque)) {
            set(i, stddev);
        }
        for (i, stddev) in noise.disturbance.coordinates(layout) {
            set(i, stddev);
        }
        for (i, stddev) in known_biases(case, layout) {
            set(i, stddev);
        }
        let guess = attitude_guess(case, noise, rate_stddev);
        if turns {
            let share = model.freedom.projection() * (rate_stddev * rate_stddev);
            covariance.view_mut((RATE.start, RATE.start), (3, 3)).copy_from(&share);
            covariance.view_mut((ROTATION.start, ROTATION.start), (3, 3)).copy_from(&guess.covariance);
        }
        Self {
            layout,
            q_world_body: guess.q_world_body,
            omega_wb_b_rad_s: if turns { rate } else { Vector3::zeros() },
            wheel_speed_rad_s,
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
    let there = |channel| case.tracks().iter().any(|track| track.channel == channel);
    let biased = |errors: &whorl_dynamics::platform::TriaxialErrors| {
        errors.bias_turn_on_stddev != Vector3::zeros() || errors.bias_walk != Vector3::zeros()
    };
    Layout::new(
        case.plant().tangent(),
        if case.is_clamped() { 0 } else { noise.disturbance.processes().count() },
        if there(Channel::WheelSpeed) { noise.disturbance.motors() } else { 0 },
        there(Channel::Gyro) && biased(&sensors.gyro.errors),
        there(Channel::Accelerometer) && biased(&sensors.accelerometer.errors),
    )
}

/// Torques that give the body, and each wheel, the fastest motion of the run within a second [N m].
pub(crate) fn fastest_change(case: &Prepared<'_>) -> (f64, Vec<f64>) {
    let (recording, model) = (case.recording(), case.model());
    let inertia = model.mass_properties.inertia_b_kg_m2().trace() / 3.0;
    let fastest = recording.gyro_b_rad_s.value.iter().map(Vector3::norm).fold(0.0, f64::max);
    let speeds = &recording.wheel_speed_rad_s.value;
    let wheels = model.wheels().iter().enumerate().map(|(j, wheel)| {
        let of_wheel = speeds.iter().filter_map(|speeds| speeds.get(j));
        wheel.spin_inertia_kg_m2 * of_wheel.map(|speed| speed.abs()).fold(0.0, f64::max)
    });
    (inertia * fastest, wheels.collect())
}

/// The first sample of a channel as a vector.
fn first(case: &Prepared<'_>, channel: Channel, sensor: usize) -> Option<Vector3<f64>> {
    let track = case.tracks().iter().find(|track| (track.channel, track.sensor) == (channel, sensor))?;
    track.vector(0).filter(|_| track.is_whole())
}

/// A guess of the attitude, and how well its readings tell it.
struct AttitudeGuess {
    q_world_body: UnitQuaternion<f64>,
    /// Of a rotation about the body's axes [rad^2].
    covariance: Matrix3<f64>,
}

/// A direction that was seen, in the body at the first reading, where it is in the world, and how well it is known \[rad\].
struct SeenDirection {
    in_body: Unit<Vector3<f64>>,
    in_world: Unit<Vector3<f64>>,
    stddev_rad: f64,
}

/// Attitude from the first readings of what sees a direction: gravity and references; level where nothing does.
fn attitude_guess(case: &Prepared<'_>, noise: &Noise, rate_stddev_rad_s: f64) -> AttitudeGuess {
    let (settings, recording, freedom) = (case.settings(), case.recording(), &case.model().freedom);
    let first_ns = case.first_ns();
    let gyro = recording.gyro_b_rad_s.value.first();
    let rate =
        gyro.and_then(|rate| freedom.rate_from_gyro_b_rad_s(rate, recording.gyro_axes())).unwrap_or_default();
    // A reading that comes later than the first is turned back by as far as the body went.
    let seen = |channel, sensor, in_world: Unit<Vector3<f64>>, stddev_rad: f64| {
        let track = case.tracks().iter().find(|track| (track.channel, track.sensor) == (channel, sensor));
        let late_s = (track?.instant_ns(0)? - first_ns) as f64 * 1e-9;
        let reading = first(case, channel, sensor)?;
        let back = quaternion_exp(&(rate * late_s));
        // The rate may have changed by itself meanwhile.
        let turned = late_s * (rate_stddev_rad_s + rate.norm());
        Some(SeenDirection {
            in_body: unit_or(back * reading, in_world),
            in_world,
            stddev_rad: stddev_rad.hypot(turned),
        })
    };
    let mut directions: Vec<SeenDirection> = Vec::new();
    for sensor in 0..recording.vectors.len() {
        let stddev = settings.start_readings * noise.vector_rad.get(sensor).copied().unwrap_or(f64::NAN);
        let reference = case.reference(sensor);
        directions.extend(reference.and_then(|reference| seen(Channel::Vector, sensor, reference, stddev)));
    }
    if freedom.has_weight() {
        directions.extend(seen(Channel::Accelerometer, 0, Vector3::z_axis(), settings.start_force_rad));
    }
    directions.retain(|direction| direction.stddev_rad.is_finite());
    directions.sort_by(|a, b| a.stddev_rad.total_cmp(&b.stddev_rad));
    let known = directions.len();
    // What was not seen is as it is level.
    for axis in [Vector3::z_axis(), Vector3::x_axis()] {
        directions.push(SeenDirection {
            in_body: axis,
            in_world: axis,
            stddev_rad: settings.start_attitude_rad,
        });
    }
    let unknown = Matrix3::identity() * settings.start_attitude_rad.powi(2);
    let Some((primary, rest)) = directions.split_first() else {
        return AttitudeGuess { q_world_body: UnitQuaternion::identity(), covariance: unknown };
    };
    let (q_world_body, second) = rest
        .iter()
        .enumerate()
        .find_map(|(k, second)| {
            let q = attitude_from_two_vectors(
                &primary.in_body,
                &primary.in_world,
                &second.in_body,
                &second.in_world,
            );
            Some((q.ok()?, if k + 1 < known { second.stddev_rad } else { settings.start_attitude_rad }))
        })
        .unwrap_or_else(|| (attitude_from_vertical(primary.in_body, 0.0), settings.start_attitude_rad));
    let along = primary.in_body.into_inner() * primary.in_body.transpose();
    let across = Matrix3::identity() - along;
    let covariance = across * primary.stddev_rad.min(settings.start_attitude_rad).powi(2)
        + along * second.min(settings.start_attitude_rad).powi(2);
    AttitudeGuess { q_world_body, covariance }
}

/// Attitudes from which a filter finds the likeliest: one where directions are seen, else several about each axis that
/// weight acts on.
pub(crate) fn guesses(case: &Prepared<'_>, wide: &Start) -> Vec<Start> {
    let model = case.model();
    // An accelerometer that lacks axes sees no direction.
    let sees = |channel| case.tracks().iter().any(|track| track.channel == channel && track.is_whole());
    let weight = model.freedom.has_weight() && model.mass_properties.gravity_offset_b_n_m().norm() > 0.0;
    if case.is_clamped() || !weight || sees(Channel::Accelerometer) || sees(Channel::Vector) {
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
