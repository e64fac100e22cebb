//! Information that a search for an effect needs: the data, ways to start, how its parameters go together.

use nalgebra::Vector3;

use super::{Effect, ParameterSpec, catalogue};
use crate::PlatformModel;

/// Data that recordings must contain for an effect to show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// The body is free to turn in some run.
    FreeBody,
    /// Jets fire while the body is free.
    Jets,
    /// Wheels are driven.
    Wheels,
    /// Gimbals of control moment gyros turn while the body is free, and their motion is recorded.
    Gimbals,
    /// Commanded torques of wheels are recorded.
    WheelCommands,
    /// The accelerometer is recorded.
    Accelerometer,
    /// A vector sensor is recorded.
    VectorSensor,
    /// Temperature is recorded.
    Temperature,
    /// The bus voltage is recorded.
    BusVoltage,
    /// The linear mass actuators move.
    Ballast,
    /// Some run turns by more than half a turn about an axis of the body.
    HalfATurn,
    /// No readings of the gyro pile up at a limit: those that do show it by themselves and are left out.
    UnclippedGyro,
}

impl Need {
    /// Whether recordings of this platform can hold it at all.
    fn fits(self, model: &PlatformModel) -> bool {
        match self {
            Self::Jets => !model.jets().is_empty(),
            Self::Wheels | Self::WheelCommands => !model.wheels().is_empty(),
            Self::Gimbals => !model.gyros().is_empty(),
            _ => true,
        }
    }
}

/// Data without which an effect is hard to tell from others, though a regression may look for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Aid {
    /// Where down is, by the accelerometer.
    Tilt,
    /// Where the platform points in the room, by a vector sensor.
    Heading,
    /// How fast the wheels turn.
    WheelSpeed,
    /// The pressure of the tank.
    TankPressure,
    /// The bus voltage.
    BusVoltage,
}

/// Ids of the effects of this platform that no recording without `need` can show.
#[must_use]
pub fn untold_without(need: Need, model: &PlatformModel) -> Vec<&'static str> {
    ids_of(model, |effect| {
        let mut sets = effect.evidence().iter().filter(|set| fit(set, model)).peekable();
        sets.peek().is_some() && sets.all(|set| set.contains(&need))
    })
}

/// Ids of the effects of this platform that are hard to tell without `aid`.
#[must_use]
pub fn hard_without(aid: Aid, model: &PlatformModel) -> Vec<&'static str> {
    ids_of(model, |effect| {
        let sets = effect.evidence();
        effect.aids().contains(&aid) && (sets.is_empty() || sets.iter().any(|set| fit(set, model)))
    })
}

fn fit(set: &[Need], model: &PlatformModel) -> bool {
    set.iter().all(|need| need.fits(model))
}

fn ids_of(model: &PlatformModel, is_meant: impl Fn(&dyn Effect) -> bool) -> Vec<&'static str> {
    let effects =
        catalogue().iter().filter(|effect| !effect.parameters(model).is_empty() && is_meant(**effect));
    effects.map(|effect| effect.info().id).collect()
}

/// Sets of needs; with all of any one set the effect can be tested. None: no regression looks for it.
pub type Evidence = &'static [&'static [Need]];

/// Ways in which the parameters of an effect may enter a fit together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Grouping {
    /// All together; those of each wheel or jet; each alone; and these named sets.
    AllPartsEach(&'static [&'static [&'static str]]),
    /// All together only.
    All,
    /// Each alone, and two at a time; all together would fit anything.
    EachAndPairs,
    /// What all wheels or jets have in common; each parameter alone; those of the wheels or jets together.
    CommonEachParts,
}

/// Properties of the data, known before a search.
#[derive(Debug, Clone, Copy, Default)]
pub struct Clues<'a> {
    /// Time over which the data were averaged \[s\], > 0.
    pub bin_s: f64,
    /// Largest rate about any axis that lasted [rad/s].
    pub largest_rate_rad_s: f64,
    /// Largest tilt that lasted \[rad\].
    pub largest_tilt_rad: f64,
    /// Lines in the spectrum of the unexplained torque \[Hz\].
    pub torque_lines_hz: &'a [f64],
    /// Lines in the spectrum of the inertial sensors \[Hz\].
    pub sensor_lines_hz: &'a [f64],
    /// Resonances that the motion drives.
    pub resonances: &'a [Resonance],
}

/// A resonance that the motion drives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resonance {
    /// Frequency \[Hz\].
    pub hz: f64,
    /// Damping over critical.
    pub damping_ratio: f64,
    /// Body axis that drives it and that it turns.
    pub axis_b: Vector3<f64>,
}

/// One way in which an effect that is absent may enter a fit: the directions that open.
pub type Start = Vec<Direction>;

/// A direction in which the values of an effect move from a place where it is still absent.
#[derive(Debug, Clone, PartialEq)]
pub struct Direction {
    /// The parameter's name, or what moves together.
    pub name: String,
    /// Values of all parameters to start from.
    pub origin: Vec<f64>,
    /// Position of each parameter that moves in [`Effect::parameters`], and by how much per unit.
    pub moves: Vec<(usize, f64)>,
    /// The signal grows with the square of the units. With moves of zero: all of the effect or nothing.
    pub squared: bool,
}

/// Makes the starts of one effect from the names of its parameters.
#[derive(Debug, Clone)]
pub struct Starter {
    specs: Vec<ParameterSpec>,
}

impl Starter {
    /// For an effect on this platform.
    #[must_use]
    pub fn new(effect: &dyn Effect, model: &PlatformModel) -> Self {
        Self { specs: effect.parameters(model) }
    }

    fn position(&self, name: &str) -> Option<usize> {
        let found = self.specs.iter().position(|spec| spec.name == name);
        debug_assert!(found.is_some(), "the effect has no parameter {name}");
        found
    }

    /// Neutral values but for these.
    #[must_use]
    pub fn at(&self, values: &[(&str, f64)]) -> Vec<f64> {
        let mut origin: Vec<f64> = self.specs.iter().map(|spec| spec.neutral).collect();
        for (name, value) in values {
            if let Some(slot) = self.position(name).and_then(|i| origin.get_mut(i)) {
                *slot = *value;
            }
        }
        origin
    }

    /// Prior standard deviation of a parameter.
    #[must_use]
    pub fn prior_stddev(&self, name: &str) -> f64 {
        self.position(name).and_then(|i| self.specs.get(i)).map_or(1.0, |spec| spec.prior_stddev)
    }

    /// One parameter alone, by its prior's standard deviation.
    #[must_use]
    pub fn along(&self, origin: &[f64], name: &str) -> Direction {
        let moves = self.position(name).map(|i| (i, self.prior_stddev(name))).into_iter().collect();
        Direction { name: name.to_owned(), origin: origin.to_vec(), moves, squared: false }
    }

    /// Several parameters at once, each by so much; the signal goes with the square of the units.
    #[must_use]
    pub fn squared(&self, origin: &[f64], name: &str, moves: &[(&str, f64)]) -> Direction {
        let moves = moves.iter().filter_map(|(name, by)| Some((self.position(name)?, *by))).collect();
        Direction { name: name.to_owned(), origin: origin.to_vec(), moves, squared: true }
    }

    /// Nothing moves: the effect as it is at `origin`, or not at all. `name` is the parameter that says where.
    #[must_use]
    pub fn place(&self, origin: &[f64], name: &str) -> Direction {
        self.squared(origin, name, &[(name, 0.0)])
    }
}

/// `count` values from `from` to `to`, in equal ratios.
pub(super) fn geometric(from: f64, to: f64, count: usize) -> Vec<f64> {
    let ratio = (to / from).max(1.0).powf(1.0 / (count.max(2) - 1) as f64);
    (0..count).map(|i| from * ratio.powi(i as i32)).collect()
}

/// Result of a fit along one direction of a start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contribution<'a> {
    /// The direction's name.
    pub name: &'a str,
    /// The values it started from.
    pub origin: &'a [f64],
    /// How far it went, in the parameter's unit.
    pub amount: f64,
}

/// A frequency of the effect by which it may be confused with another effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Periodicity {
    /// A torque from outside at one frequency, whatever the motion.
    Torque,
    /// The sensors shake at one frequency, whatever the motion.
    Sensors,
    /// The platform's own ringing, so lightly damped that it shows as a line.
    Ringing,
}

/// What the samples show directly, without a regression, and the names of the parameters that describe it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signature {
    /// The gyro's output stops at a range, and moves in steps.
    GyroDigits {
        /// Parameter of the range [rad/s].
        range: &'static str,
        /// Parameter of the step [rad/s].
        step: &'static str,
    },
    /// A torque across each wheel's axis that turns with it and goes with its speed squared; the parameter of each
    /// wheel is its size [kg m^2].
    WheelTurn,
    /// One frequency in the inertial sensors, too fast for a regression.
    SensorLine {
        /// Parameters of the amplitude in each gyro axis [rad/s].
        gyro: [&'static str; 3],
        /// Parameters of the amplitude in each accelerometer axis [m/s^2].
        accelerometer: [&'static str; 3],
        /// Parameter of the frequency \[Hz\].
        frequency: &'static str,
        /// Parameter of the share that is there with all valves shut.
        background: &'static str,
    },
}
