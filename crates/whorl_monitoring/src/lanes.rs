//! What directions in which the model can change do to a bin's prediction.

use nalgebra::{DMatrix, DVector, Vector3};
use whorl_dynamics::{EffectKind, Gyrostat};
use whorl_identification::{Direction, Directions};

use crate::places::Places;
use crate::predictor::Bin;

/// What a bin changes per unit of each direction: accelerations of body and wheels, and readings of the gyro.
#[derive(Debug, Clone)]
pub struct Changes {
    /// Motion by direction [1/s^2 in the motion's units].
    pub rates: DMatrix<f64>,
    /// Gyro by direction [rad/s].
    pub readings: DMatrix<f64>,
}

/// How directions change what a bin predicts.
#[derive(Debug, Clone)]
pub struct Lanes {
    directions: Vec<Lane>,
    base: Gyrostat,
}

#[derive(Debug, Clone)]
struct Lane {
    moved: Gyrostat,
    per_unit: f64,
    of_sensor: bool,
    of_jets: bool,
}

impl Lanes {
    /// Of all directions.
    #[must_use]
    pub fn new(all: &Directions) -> Self {
        let of = |direction: &Direction| {
            let (moved, base) = (direction.moved.model(), all.base.model());
            let of_sensor = moved.sensors != base.sensors
                || whorl_dynamics::effects::find(direction.effect)
                    .is_some_and(|effect| effect.info().kind == EffectKind::Sensor);
            Lane {
                of_jets: moved.jets() != base.jets()
                    && moved.wheels() == base.wheels()
                    && moved.mass_properties == base.mass_properties,
                moved: direction.moved.clone(),
                per_unit: 1.0 / direction.units,
                of_sensor,
            }
        };
        Self { directions: all.directions.iter().map(of).collect(), base: all.base.clone() }
    }

    /// The platform as it is.
    #[must_use]
    pub fn base(&self) -> &Gyrostat {
        &self.base
    }

    fn motion(gyrostat: &Gyrostat, bin: &Bin, wheels: usize) -> DVector<f64> {
        let environment = bin.environment(gyrostat.model());
        let found = gyrostat.accelerations(&environment, &bin.hidden, &Vector3::zeros());
        let body = found.omega_dot_wb_b_rad_s2;
        DVector::from_iterator(
            3 + wheels,
            body.iter().copied().chain(found.wheel_rad_s2.iter().copied().take(wheels)),
        )
    }

    fn reading(gyrostat: &Gyrostat, bin: &Bin) -> Vector3<f64> {
        let mut environment = bin.environment(gyrostat.model());
        environment.omega_dot_wb_b_rad_s2 = bin.omega_dot_b_rad_s2;
        let errors = &gyrostat.model().sensors.gyro.errors;
        errors.ideal(&gyrostat.true_imu(&environment).angular_velocity_b_rad_s) + errors.bias
    }

    /// Per unit of every direction.
    #[must_use]
    pub fn changes(&self, bin: &Bin, places: &Places) -> Changes {
        let count = self.directions.len();
        let mut changes =
            Changes { rates: DMatrix::zeros(places.motion(), count), readings: DMatrix::zeros(3, count) };
        let (rates, reading) = (Self::motion(&self.base, bin, places.wheels), Self::reading(&self.base, bin));
        let flows = bin.valve_fraction.iter().any(|share| *share != 0.0);
        for (k, lane) in self.directions.iter().enumerate() {
            if flows || !lane.of_jets {
                let change = (Self::motion(&lane.moved, bin, places.wheels) - &rates) * lane.per_unit;
                changes.rates.set_column(k, &change);
            }
            if lane.of_sensor {
                let change = (Self::reading(&lane.moved, bin) - reading) * lane.per_unit;
                changes.readings.set_column(k, &change);
            }
        }
        changes
    }
}
