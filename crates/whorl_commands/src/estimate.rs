//! Attitude of a recorded sensor or vehicle: the filter that was asked for.

use anyhow::bail;
use whorl_estimation::{Estimator, FilterKind, Health, ImuSample, Parameters};
use whorl_free_motion::{
    Clipping, DirectionFilter, DirectionParameters, FreeMotionEstimator, FreeMotionParameters, Orientation,
    OrientationFilter, Sample, smooth, smooth_free_motion,
};

use crate::axis_watch::AxisWatch;

/// The filter for sensors that do not turn about a fixed point.
const FREE_MOTION: &str = FilterKind::FREE_MOTION.name;
/// The filter for any vehicle with directions.
const DIRECTIONS: &str = "directions";

/// What is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct EstimateOptions {
    /// Name of the filter; `None`: free_motion with an accelerometer, else directions.
    pub filter: Option<String>,
    /// Each sample from the whole recording, not from its past alone.
    pub smooth: bool,
    /// Gyro white noise, filter directions [rad/s/sqrt(Hz)].
    pub gyro_noise: f64,
    /// Random walk of the gyro's bias, filter directions [rad/s/sqrt(s)].
    pub gyro_bias_walk: f64,
    /// Bias of the gyro at the start, one standard deviation, filter directions [rad/s].
    pub gyro_bias_sigma: f64,
    /// Noise of each vector sensor, filter directions; the last stands for all further ones \[deg\].
    pub vector_noise_deg: Vec<f64>,
}

impl Default for EstimateOptions {
    /// As of `whorl estimate`.
    fn default() -> Self {
        Self {
            filter: None,
            smooth: false,
            gyro_noise: 3e-4,
            gyro_bias_walk: 3e-5,
            gyro_bias_sigma: 0.02,
            vector_noise_deg: vec![1.0],
        }
    }
}

/// What was recorded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recorded {
    /// Name, for messages.
    pub name: String,
    /// Which axes the gyro has.
    pub gyro_axes: [bool; 3],
    /// Which axes the accelerometer has; none: there is no accelerometer.
    pub force_axes: [bool; 3],
    /// Vector sensors: name, and whether its direction in the world is known.
    pub vectors: Vec<(String, bool)>,
}

impl Recorded {
    /// What is not used of an accelerometer without all axes, in a sentence; `None` of one that has all, or none.
    #[must_use]
    pub fn partial_force(&self) -> Option<String> {
        let named = |there: bool| {
            let axes = ["x", "y", "z"].into_iter().zip(self.force_axes);
            axes.filter(|(_, has)| *has == there).map(|(axis, _)| axis).collect::<Vec<_>>().join(" and ")
        };
        let is_partial = self.force_axes != [true; 3] && self.force_axes != [false; 3];
        is_partial.then(|| {
            let (do_not, are) = if named(true).len() > 1 { ("do not", "are") } else { ("does not", "is") };
            format!(
                "the accelerometer has no axis {}: {} alone {do_not} tell the vertical, and {are} left out",
                named(false),
                named(true)
            )
        })
    }
}

/// The chosen filter.
#[derive(Debug)]
pub enum Chosen {
    /// For sensors that move freely; whether smoothing found a magnet, and what is odd about the sensors.
    FreeMotion(Box<FreeMotionEstimator>, bool, Vec<String>),
    /// For any vehicle with directions.
    Directions(Box<DirectionFilter>, DirectionParameters),
    /// A filter of the estimator node, its name, and what watches over the sensors' axes.
    Pivot(Box<Estimator>, &'static str, Box<AxisWatch>),
}

impl Chosen {
    /// Sets the filter up.
    ///
    /// # Errors
    /// A filter that does not exist, or that needs what was not recorded; a parameter out of range.
    pub fn new(arguments: &EstimateOptions, recorded: &Recorded) -> anyhow::Result<Self> {
        if recorded.gyro_axes != [true; 3] {
            bail!("{}: attitudes need a gyro of three axes", recorded.name);
        }
        let has_force = recorded.force_axes == [true; 3];
        let seen = recorded.vectors.len();
        if let Some(partial) = recorded.partial_force().filter(|_| seen < 2) {
            bail!(
                "{}: {partial}, and an attitude needs two directions; there {}. With a platform's file, whorl compare and diagnose use \
                 each axis for itself",
                recorded.name,
                if seen == 1 { "is one vector sensor" } else { "are no vector sensors" }
            );
        }
        let default = if has_force { FREE_MOTION } else { DIRECTIONS };
        let name = arguments.filter.as_deref().unwrap_or(default);
        if name == DIRECTIONS {
            let parameters = directions(arguments, recorded)?;
            return Ok(Self::Directions(Box::new(DirectionFilter::new(parameters.clone())), parameters));
        }
        if !has_force {
            let lack = recorded.partial_force().unwrap_or_else(|| "there is no accelerometer".to_owned());
            bail!("{}: {lack}, and --filter {name} needs all axes; allowed: {DIRECTIONS}", recorded.name);
        }
        if name == FREE_MOTION {
            let filter = FreeMotionEstimator::new(FreeMotionParameters::default());
            return Ok(Self::FreeMotion(Box::new(filter), false, Vec::new()));
        }
        let usable =
            || FilterKind::ALL.into_iter().filter(|kind| !kind.needs_body && kind.name != FREE_MOTION);
        let Some(kind) = usable().find(|kind| kind.name == name) else {
            let names: Vec<&str> = usable().map(|kind| kind.name).collect();
            bail!("--filter {name}: allowed: {FREE_MOTION}, {DIRECTIONS}, {}", names.join(", "));
        };
        if arguments.smooth {
            bail!("--smooth works with --filter {FREE_MOTION} and {DIRECTIONS}, not with {name}");
        }
        let parameters = Parameters::freely_moving().with_magnetometer(std::f64::consts::FRAC_PI_2);
        let filter = Box::new(Estimator::new(kind, parameters, None)?);
        Ok(Self::Pivot(filter, kind.name, Box::default()))
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::FreeMotion(..) => FREE_MOTION,
            Self::Directions(..) => DIRECTIONS,
            Self::Pivot(_, name, _) => name,
        }
    }

    /// Whether its attitudes are relative to the references of its vector sensors; else their heading counts from what the first
    /// sees.
    #[must_use]
    pub fn knows_references(&self) -> bool {
        matches!(self, Self::Directions(..))
    }

    /// Whether it needs an accelerometer.
    #[must_use]
    pub fn needs_force(&self) -> bool {
        !matches!(self, Self::Directions(..))
    }

    /// Whether it has found iron or a magnet on the sensor.
    #[must_use]
    pub fn is_magnetised(&self) -> bool {
        match self {
            Self::FreeMotion(filter, smoothed, _) => *smoothed || filter.is_magnetised(),
            _ => false,
        }
    }

    /// What is odd about the sensors, in words.
    #[must_use]
    pub fn doubts(&self) -> Vec<String> {
        let clipped = |clipping: &Clipping| (clipping.count() > 0).then(|| clipping.to_string());
        match self {
            Self::FreeMotion(filter, _, smoothed) => {
                if smoothed.is_empty() {
                    filter.doubts()
                } else {
                    smoothed.clone()
                }
            }
            Self::Directions(filter, _) => clipped(filter.clipping()).into_iter().collect(),
            Self::Pivot(filter, _, watch) => {
                watch.doubts().into_iter().chain(clipped(filter.clipping())).collect()
            }
        }
    }

    /// The estimate from this sample and those before.
    pub fn causal(&mut self, sample: &Sample) -> Option<Orientation> {
        match self {
            Self::FreeMotion(filter, ..) => {
                filter.on_sample(sample);
                filter.orientation()
            }
            Self::Directions(filter, _) => {
                filter.on_sample(sample);
                filter.orientation()
            }
            Self::Pivot(filter, _, watch) => {
                let stamp_ns = sample.stamp_ns;
                if watch.field_turns_out_wrong(sample) {
                    // Anew, without the magnetometer: the heading is relative from here on.
                    let without = Estimator::new(filter.kind(), Parameters::freely_moving(), None);
                    **filter = without.ok()?;
                }
                filter.on_imu(&ImuSample {
                    stamp_ns,
                    gyro_rad_s: sample.gyro_rad_s,
                    specific_force_m_s2: sample.force_m_s2?,
                });
                let seen = sample.vectors.first().copied().flatten();
                if let Some(seen) = seen.filter(|_| !watch.field_is_wrong()) {
                    filter.on_vector(stamp_ns, &seen.body);
                }
                let estimate = filter.estimate(stamp_ns);
                (estimate.health != Health::Initialising).then_some(Orientation {
                    q_world_body: estimate.q_world_body,
                    gyro_bias_rad_s: estimate.gyro_bias_b_rad_s,
                    covariance: estimate.covariance,
                })
            }
        }
    }

    /// The estimates from all samples.
    ///
    /// # Errors
    /// A filter that cannot smooth.
    pub fn smoothed(&mut self, samples: &[Sample]) -> anyhow::Result<Vec<Option<Orientation>>> {
        match self {
            Self::FreeMotion(_, magnetised, doubts) => {
                let found = smooth_free_motion(FreeMotionParameters::default(), samples);
                (*magnetised, *doubts) = (found.is_magnetised, found.doubts);
                Ok(found.orientations)
            }
            Self::Directions(_, parameters) => {
                Ok(smooth(|| DirectionFilter::new(parameters.clone()), samples))
            }
            Self::Pivot(_, name, _) => bail!("--smooth does not work with --filter {name}"),
        }
    }
}

fn directions(arguments: &EstimateOptions, recorded: &Recorded) -> anyhow::Result<DirectionParameters> {
    if recorded.vectors.is_empty() {
        bail!("{}: --filter {DIRECTIONS} needs directions: name them under vector or vectors", recorded.name);
    }
    for (k, (columns, is_known)) in recorded.vectors.iter().enumerate() {
        if !is_known {
            bail!(
                "{}: vector sensor {} ({columns}) has no direction in the world; --filter {DIRECTIONS} needs reference_world, or \
                 reference_columns where it varies in time",
                recorded.name,
                k + 1
            );
        }
    }
    let positive = |name: &str, value: f64, zero_too: bool| {
        if value.is_finite() && (value > 0.0 || zero_too && value == 0.0) {
            Ok(value)
        } else {
            bail!("{name} is {value}; allowed: {}", if zero_too { "0 or more" } else { "more than 0" })
        }
    };
    let mut direction_sigma_rad = Vec::new();
    for noise in &arguments.vector_noise_deg {
        direction_sigma_rad.push(positive("--vector-noise-deg", *noise, false)?.to_radians());
    }
    Ok(DirectionParameters {
        gyro_noise_rad_s_sqrt_hz: positive("--gyro-noise", arguments.gyro_noise, false)?,
        gyro_bias_walk_rad_s_sqrt_s: positive("--gyro-bias-walk", arguments.gyro_bias_walk, true)?,
        gyro_bias_sigma_rad_s: positive("--gyro-bias-sigma", arguments.gyro_bias_sigma, false)?,
        direction_sigma_rad,
    })
}

/// The estimates of all samples; none before the first attitude.
///
/// # Errors
/// As [`Chosen::new`], and when there are too few samples for an attitude.
pub fn estimates(
    options: &EstimateOptions,
    recorded: &Recorded,
    samples: &[Sample],
) -> anyhow::Result<(Chosen, Vec<Option<Orientation>>)> {
    let mut chosen = Chosen::new(options, recorded)?;
    let found: Vec<Option<Orientation>> = if options.smooth {
        chosen.smoothed(samples)?
    } else {
        samples.iter().map(|sample| chosen.causal(sample)).collect()
    };
    if found.iter().all(Option::is_none) {
        bail!("{}", too_few(&recorded.name, samples.len(), &chosen));
    }
    Ok((chosen, found))
}

/// Why there is no attitude at all.
#[must_use]
pub fn too_few(name: &str, samples: usize, chosen: &Chosen) -> String {
    let of = if chosen.needs_force() { "gyro and accelerometer" } else { "gyro and two directions" };
    format!("{name}: {samples} samples of {of} are too few for a first attitude")
}

#[cfg(test)]
mod tests {
    use super::{Chosen, EstimateOptions, Recorded};

    fn recorded(force_axes: [bool; 3], vectors: usize) -> Recorded {
        let vectors = (1..=vectors).map(|k| (format!("vector_{k}"), true)).collect();
        Recorded { name: "a.csv".to_owned(), gyro_axes: [true; 3], force_axes, vectors }
    }

    /// Name of the filter that is chosen, or what is wrong.
    fn chosen(recorded: &Recorded) -> Result<&'static str, String> {
        let chosen = Chosen::new(&EstimateOptions::default(), recorded);
        chosen.map(|chosen| chosen.name()).map_err(|error| error.to_string())
    }

    #[test]
    fn an_accelerometer_without_all_axes_is_left_out_in_words() {
        assert_eq!(chosen(&recorded([true; 3], 0)), Ok("free_motion"));
        assert_eq!(recorded([true; 3], 0).partial_force(), None);
        assert_eq!(recorded([false; 3], 2).partial_force(), None);
        let two = recorded([true, false, true], 2);
        assert_eq!(chosen(&two), Ok("directions"));
        assert_eq!(
            two.partial_force().unwrap(),
            "the accelerometer has no axis y: x and z alone do not tell the vertical, and are left out"
        );
        for (axes, vectors, said) in [
            (
                [true, false, false],
                0,
                "no axis y and z: x alone does not tell the vertical, and is left out, and an attitude needs",
            ),
            ([true, false, true], 1, "there is one vector sensor"),
        ] {
            let error = chosen(&recorded(axes, vectors)).unwrap_err();
            assert!(error.starts_with("a.csv: ") && error.contains(said), "{error}");
        }
        let needs_force =
            EstimateOptions { filter: Some("free_motion".to_owned()), ..EstimateOptions::default() };
        let error = Chosen::new(&needs_force, &two).unwrap_err().to_string();
        assert!(error.contains("--filter free_motion needs all axes; allowed: directions"), "{error}");
        let no_gyro = Recorded { gyro_axes: [true, true, false], ..recorded([true; 3], 0) };
        assert!(chosen(&no_gyro).unwrap_err().contains("gyro of three axes"));
    }
}
