//! What a model may lack without anybody having a formula for it: laws that act in the state in which a filter is.

use nalgebra::Vector3;
use whorl_dynamics::Plant;
use whorl_dynamics::plant::{LinearisedPlant, ROTATION};
use whorl_recording::Channel;

use crate::rows::Row;

/// What a law adds in one state, per unit of its size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Push {
    /// A torque on the body, body axes [N m].
    Body(Vector3<f64>),
    /// A torque on a wheel, by its position, about its axis, and the opposite one on the body [N m].
    Wheel(usize, f64),
    /// To the gyro's reading, sensor axes [rad/s].
    Gyro(Vector3<f64>),
    /// What vector sensors see is turned by so much, body axes \[rad\].
    Turn(Vector3<f64>),
}

/// Laws that are looked for in a recording: what each adds in the state of a plant. What they do at the start of a step they do
/// throughout, so that they know nothing of readings to come.
pub struct Laws<'a> {
    /// How many there are, and from how far apart two take no part together.
    pub(crate) count: usize,
    pub(crate) apart: usize,
    /// Appends what each law adds in the state of a plant, in their order.
    of: Box<OfState<'a>>,
}

/// Appends what each law adds in the state of a plant, in their order.
type OfState<'a> = dyn Fn(&Plant, &mut Vec<Push>) + Send + Sync + 'a;

impl<'a> Laws<'a> {
    /// So many laws; `of` appends what each adds in the state of a plant, in their order. Those that it leaves out add nothing. Of two
    /// laws that are `apart` or further in that order nobody asks what they do together: that is not found.
    pub fn new(count: usize, apart: usize, of: impl Fn(&Plant, &mut Vec<Push>) + Send + Sync + 'a) -> Self {
        Self { count, apart, of: Box::new(of) }
    }

    pub(crate) fn at(&self, plant: &Plant, pushes: &mut Vec<Push>) {
        pushes.clear();
        (self.of)(plant, pushes);
        pushes.resize(self.count, Push::Body(Vector3::zeros()));
    }
}

impl Push {
    /// Whether it moves the platform; else it is an error of a sensor.
    pub(crate) fn is_torque(&self) -> bool {
        matches!(self, Self::Body(_) | Self::Wheel(..))
    }

    fn on_body_n_m(&self, plant: &Plant) -> Vector3<f64> {
        match *self {
            Self::Body(torque_n_m) => torque_n_m,
            Self::Wheel(position, torque_n_m) => {
                let wheel = plant.gyrostat().model().wheels().get(position);
                wheel.map_or(Vector3::zeros(), |wheel| *wheel.spin_axis_b * -torque_n_m)
            }
            Self::Gyro(_) | Self::Turn(_) => Vector3::zeros(),
        }
    }

    /// Adds how fast the coordinates of a plant move by it \[unit/s\], times a factor; a wheel that friction holds nothing pushes.
    pub(crate) fn add_rates(
        &self,
        plant: &Plant,
        linearised: &LinearisedPlant,
        factor: f64,
        add: &mut dyn FnMut(usize, f64),
    ) {
        if let Self::Wheel(position, torque_n_m) = *self {
            let wheel = plant.gyrostat().model().wheels().get(position);
            let is_held = plant.held_wheels().nth(position).unwrap_or(true);
            let Some(wheel) = wheel.filter(|_| !is_held) else { return };
            add(plant.tangent().wheels().start + position, factor * torque_n_m / wheel.spin_inertia_kg_m2);
        }
        let (by_torque, body_n_m) = (&linearised.rate_by_torque, self.on_body_n_m(plant) * factor);
        for i in (0..by_torque.nrows()).filter(|_| self.is_torque()) {
            let rate: f64 = (0..3).map(|axis| by_torque[(i, axis)] * body_n_m[axis]).sum();
            if rate != 0.0 {
                add(i, rate);
            }
        }
    }

    /// How much a reading less its prediction changes by it where the state does not.
    pub(crate) fn of_reading(
        &self,
        plant: &Plant,
        linearised: &LinearisedPlant,
        row: &Row,
        by_state: &[(usize, f64)],
    ) -> f64 {
        match (row.component.channel, *self) {
            (Channel::Gyro, Self::Gyro(error)) => -error[row.component.index()],
            (Channel::Accelerometer, Self::Body(_) | Self::Wheel(..)) => {
                -(linearised.force_by_torque * self.on_body_n_m(plant))[row.component.index()]
            }
            // As if the body were turned the other way.
            (Channel::Vector, Self::Turn(rotation)) => {
                by_state.iter().filter(|(i, _)| ROTATION.contains(i)).map(|(i, x)| x * rotation[*i]).sum()
            }
            _ => 0.0,
        }
    }
}
