//! Parameters of effects: names, units, ranges, priors.

/// The part of the platform that a parameter belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// No single one: the platform, or all its wheels or jets together.
    Platform,
    /// This wheel of the model.
    Wheel(usize),
    /// This jet of the model.
    Jet(usize),
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
    /// One sentence.
    pub doc: &'static str,
}

impl ParameterSpec {
    /// A parameter that is fitted, absent at zero.
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
            doc,
        }
    }

    /// The same for wheel `wheel` of the model alone.
    #[must_use]
    pub fn of_wheel(self, wheel: usize) -> Self {
        Self { part: Part::Wheel(wheel), ..self }
    }

    /// The same for jet `jet` of the model alone.
    #[must_use]
    pub fn of_jet(self, jet: usize) -> Self {
        Self { part: Part::Jet(jet), ..self }
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
}

/// Three parameters `{prefix}_x{suffix}`, `_y`, `_z` with a range symmetric about zero.
pub(crate) fn per_axis(
    prefix: &str,
    suffix: &str,
    unit: &'static str,
    largest: f64,
    prior_stddev: f64,
    doc: &'static str,
) -> Vec<ParameterSpec> {
    ["x", "y", "z"]
        .into_iter()
        .map(|axis| {
            ParameterSpec::new(
                format!("{prefix}_{axis}{suffix}"),
                unit,
                (-largest, largest),
                prior_stddev,
                doc,
            )
        })
        .collect()
}

/// The three values starting at `first`; zero where there are none.
pub(crate) fn vector(values: &[f64], first: usize) -> nalgebra::Vector3<f64> {
    nalgebra::Vector3::from_fn(|i, _| value(values, first + i))
}

/// The value at `index`; zero where there is none, so that a short slice cannot panic.
pub(crate) fn value(values: &[f64], index: usize) -> f64 {
    values.get(index).copied().unwrap_or(0.0)
}
