//! Which levels of noise a run shows, one after the other.

use whorl_recording::{Channel, Component};

use crate::noise::Noise;
use crate::prepared::Prepared;

/// A standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Level {
    /// Of a random torque on the body, about one of its axes [N m].
    Body { process: usize, axis: usize },
    /// Of a motor's random torque [N m].
    Motor(usize),
    /// Of a reading, in its channel's unit; of components that share it the first.
    Reading(Component),
}

/// All that are not zero: torques first, in the order of a state's coordinates, then readings.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Levels(Vec<Level>);

impl Levels {
    pub fn of(case: &Prepared<'_>, noise: &Noise) -> Self {
        let disturbance = &noise.disturbance;
        let body = (0..disturbance.body.len())
            .flat_map(|process| (0..3).map(move |axis| Level::Body { process, axis }))
            .chain((0..disturbance.motors_n_m.len()).map(Level::Motor));
        let mut list: Vec<Level> = body.filter(|level| level.stddev(noise) > 0.0).collect();
        for component in case.components().map(pooled) {
            let level = Level::Reading(component);
            if !list.contains(&level) {
                list.push(level);
            }
        }
        Self(list)
    }

    pub fn iter(&self) -> impl ExactSizeIterator<Item = Level> + '_ {
        self.0.iter().copied()
    }

    pub fn count(&self) -> usize {
        self.0.len()
    }

    pub fn position(&self, level: Level) -> Option<usize> {
        self.0.iter().position(|one| *one == level)
    }

    /// That of a reading.
    pub fn of_reading(&self, component: Component) -> Option<usize> {
        self.position(Level::Reading(pooled(component)))
    }
}

impl Level {
    pub fn is_torque(self) -> bool {
        !matches!(self, Self::Reading(_))
    }

    pub fn stddev(self, noise: &Noise) -> f64 {
        let of = &noise.disturbance;
        match self {
            Self::Body { process, axis } => of.body[process].stddev_b_n_m[axis],
            Self::Motor(motor) => of.motors_n_m[motor],
            Self::Reading(component) => noise.of(component),
        }
    }

    pub fn set(self, noise: &mut Noise, stddev: f64) {
        let of = &mut noise.disturbance;
        match self {
            Self::Body { process, axis } => of.body[process].stddev_b_n_m[axis] = stddev,
            Self::Motor(motor) => of.motors_n_m[motor] = stddev,
            Self::Reading(component) => noise.set(component, stddev),
        }
    }
}

/// Components that share a level, by the first of them: the axes across a direction; all tachometers.
fn pooled(component: Component) -> Component {
    match component.channel {
        Channel::Vector | Channel::WheelSpeed => Component::new(component.channel, component.sensor(), 0),
        _ => component,
    }
}
