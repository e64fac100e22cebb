//! Parameters of effects: names, units, ranges, priors, and what each does in a fit.

use std::f64::consts::TAU;

use whorl_math::wrap_angle_rad;

use super::BasePrior;

/// The part of the platform that a parameter belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// No single part: the platform, or all its wheels or jets together.
    Platform,
    /// This wheel of the model.
    Wheel(usize),
    /// This jet of the model.
    Jet(usize),
    /// This control moment gyro of the model.
    Gyro(usize),
}

impl Part {
    /// The wheel's, jet's or gyro's number.
    #[must_use]
    pub fn index(self) -> Option<usize> {
        match self {
            Self::Platform => None,
            Self::Wheel(index) | Self::Jet(index) | Self::Gyro(index) => Some(index),
        }
    }
}

/// What a parameter does to the signal of its effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Makes it larger: its prior is a scale, and the effect is absent where it is neutral.
    Amplitude,
    /// Shapes it without making it larger, about a usual value (a damping ratio): the prior holds whatever the
    /// amplitude.
    Shape,
    /// Shapes it and may be anywhere in its range (a frequency, a phase): while the amplitude is zero it has no
    /// meaning, and no value of it is likelier than another.
    FloatingShape,
}

/// When a regression about given values of an effect can move a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Regressed {
    /// At any values.
    Always,
    /// Only where it is not zero itself: an axis that takes no part in an effect that is there.
    UnlessZero,
    /// Only where an amplitude of its part is not zero; without one the shape has no meaning.
    WithAmplitude,
    /// Never: the readings themselves show it ([`super::Signature`]).
    Never,
}

/// One parameter of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterSpec {
    /// Name in parameter files and reports.
    pub name: String,
    /// Unit, "1" for none.
    pub unit: &'static str,
    /// What it is a parameter of.
    pub part: Part,
    /// Smallest plausible value; also the sign constraint.
    pub min: f64,
    /// Largest plausible value.
    pub max: f64,
    /// The value at which the effect is absent, which is also its default. For a `known` parameter:
    /// the default of the site or platform.
    pub neutral: f64,
    /// Prior standard deviation about `neutral` for fits, > 0.
    pub prior_stddev: f64,
    /// False: fitted. True: known beforehand (latitude, field), never fitted.
    pub known: bool,
    /// Its role in the signal.
    pub role: Role,
    /// When a regression can move it.
    pub regressed: Regressed,
    /// Without it the other parameters are another effect under this one's name.
    pub essential: bool,
    /// Values that differ by this much are the same (a turn of an angle), in its unit.
    pub period: Option<f64>,
    /// The standard deviation of the platform's own parameter that it corrects; `None`: it is no correction of
    /// the base model.
    pub base: Option<BasePrior>,
    /// One sentence.
    pub doc: &'static str,
}

impl ParameterSpec {
    /// An amplitude that is fitted, absent at zero.
    #[must_use]
    pub fn new(
        name: impl Into<String>,
        unit: &'static str,
        (min, max): (f64, f64),
        prior_stddev: f64,
        doc: &'static str,
    ) -> Self {
        Self {
            name: name.into(),
            unit,
            part: Part::Platform,
            min,
            max,
            neutral: 0.0,
            prior_stddev,
            known: false,
            role: Role::Amplitude,
            regressed: Regressed::Always,
            essential: false,
            period: None,
            base: None,
            doc,
        }
    }

    /// The same with another neutral value.
    #[must_use]
    pub fn with_neutral(self, neutral: f64) -> Self {
        Self { neutral, ..self }
    }

    /// The same, known beforehand and not fitted.
    #[must_use]
    pub fn known(self) -> Self {
        Self { known: true, ..self }
    }

    /// The same as a shape about its neutral value.
    #[must_use]
    pub fn shape(self) -> Self {
        Self { role: Role::Shape, ..self }
    }

    /// The same as a shape that may be anywhere in its range.
    #[must_use]
    pub fn floating_shape(self) -> Self {
        Self { role: Role::FloatingShape, ..self }
    }

    /// The same, with when a regression can move it.
    #[must_use]
    pub fn regressed(self, regressed: Regressed) -> Self {
        Self { regressed, ..self }
    }

    /// The same as one without which the effect is absent.
    #[must_use]
    pub fn essential(self) -> Self {
        Self { essential: true, ..self }
    }

    /// The same as an angle \[rad\]: a whole turn more is the same.
    #[must_use]
    pub fn angle(self) -> Self {
        Self { period: Some(TAU), ..self }
    }

    /// The same as a correction of one of the platform's own parameters.
    #[must_use]
    pub fn base(self, base: BasePrior) -> Self {
        Self { base: Some(base), ..self }
    }

    /// `value` within the range; where the parameter is periodic, wrapped to half a period either side of zero.
    #[must_use]
    pub fn limited(&self, value: f64) -> f64 {
        match self.period {
            Some(period) => wrap_angle_rad(value * (TAU / period)) * (period / TAU),
            None => value.max(self.min).min(self.max),
        }
    }
}

/// Size that a disturbance torque usually has on the dissertation's platform [N m]; on others in proportion
/// ([`super::size`]).
pub(super) const USUAL_TORQUE_N_M: f64 = 5e-3;

/// Three parameters `{prefix}_x{suffix}`, `_y`, `_z` with a range symmetric about zero.
pub(super) fn per_axis(
    prefix: &str,
    suffix: &str,
    unit: &'static str,
    largest: f64,
    prior_stddev: f64,
    doc: &'static str,
) -> [ParameterSpec; 3] {
    ["x", "y", "z"].map(|axis| {
        ParameterSpec::new(format!("{prefix}_{axis}{suffix}"), unit, (-largest, largest), prior_stddev, doc)
    })
}
