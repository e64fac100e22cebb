//! The filter that was asked for.

use anyhow::bail;
use whorl_bag::{Channel, CsvMap};
use whorl_estimation::{Estimator, FilterKind, Health, ImuSample, Parameters};
use whorl_free_motion::{
    DirectionFilter, DirectionParameters, FreeMotionEstimator, FreeMotionParameters, Orientation,
    OrientationFilter, Sample, smooth, smooth_free_motion,
};

use super::Arguments;

/// The filter for sensors that do not turn about a fixed point.
const FREE_MOTION: &str = FilterKind::FREE_MOTION.name;
/// The filter for any vehicle with directions.
const DIRECTIONS: &str = "directions";

/// The chosen filter.
pub enum Chosen {
    FreeMotion(Box<FreeMotionEstimator>, bool),
    Directions(Box<DirectionFilter>, DirectionParameters),
    Pivot(Box<Estimator>, &'static str),
}

impl Chosen {
    pub fn new(arguments: &Arguments, map: &CsvMap) -> anyhow::Result<Self> {
        let has_force = map.has(Channel::Accelerometer);
        let default = if has_force { FREE_MOTION } else { DIRECTIONS };
        let name = arguments.filter.as_deref().unwrap_or(default);
        if name == DIRECTIONS {
            let parameters = directions(arguments, map)?;
            return Ok(Self::Directions(Box::new(DirectionFilter::new(parameters.clone())), parameters));
        }
        if !has_force {
            bail!(
                "{}: the map has no accelerometer, and --filter {name} needs one; allowed: {DIRECTIONS}",
                arguments.channels.display()
            );
        }
        if name == FREE_MOTION {
            let filter = FreeMotionEstimator::new(FreeMotionParameters::default());
            return Ok(Self::FreeMotion(Box::new(filter), false));
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
        Ok(Self::Pivot(Box::new(Estimator::new(kind, parameters, None)?), kind.name))
    }

    pub fn name(&self) -> &'static str {
        match self {
            Self::FreeMotion(..) => FREE_MOTION,
            Self::Directions(..) => DIRECTIONS,
            Self::Pivot(_, name) => name,
        }
    }

    pub fn needs_force(&self) -> bool {
        !matches!(self, Self::Directions(..))
    }

    pub fn is_magnetised(&self) -> bool {
        match self {
            Self::FreeMotion(filter, smoothed) => *smoothed || filter.is_magnetised(),
            _ => false,
        }
    }

    /// The estimate from this sample and those before.
    pub fn causal(&mut self, sample: &Sample) -> Option<Orientation> {
        match self {
            Self::FreeMotion(filter, _) => {
                filter.on_sample(sample);
                filter.orientation()
            }
            Self::Directions(filter, _) => {
                filter.on_sample(sample);
                filter.orientation()
            }
            Self::Pivot(filter, _) => {
                let stamp_ns = sample.stamp_ns;
                filter.on_imu(&ImuSample {
                    stamp_ns,
                    gyro_rad_s: sample.gyro_rad_s,
                    specific_force_m_s2: sample.force_m_s2?,
                });
                if let Some(seen) = sample.vectors.first().copied().flatten() {
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
    pub fn smoothed(&mut self, samples: &[Sample]) -> anyhow::Result<Vec<Option<Orientation>>> {
        match self {
            Self::FreeMotion(_, magnetised) => {
                let (found, with_magnet) = smooth_free_motion(FreeMotionParameters::default(), samples);
                *magnetised = with_magnet;
                Ok(found)
            }
            Self::Directions(_, parameters) => {
                Ok(smooth(|| DirectionFilter::new(parameters.clone()), samples))
            }
            Self::Pivot(_, name) => bail!("--smooth does not work with --filter {name}"),
        }
    }
}

fn directions(arguments: &Arguments, map: &CsvMap) -> anyhow::Result<DirectionParameters> {
    if map.vectors.is_empty() {
        bail!(
            "{}: --filter {DIRECTIONS} needs directions: name them under vector or vectors",
            arguments.channels.display()
        );
    }
    for (k, vector) in map.vectors.iter().enumerate() {
        if vector.reference_world.is_none() && vector.reference_columns.is_none() {
            bail!(
                "{}: vector sensor {} ({}) has no direction in the world; --filter {DIRECTIONS} needs reference_world, or \
                 reference_columns where it varies in time",
                arguments.channels.display(),
                k + 1,
                vector.columns.join(", ")
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
