//! Is there iron or a magnet on the sensor?

use super::iron::IronEstimator;
use super::orientation::{Observed, Orientation, OrientationFilter, Sample, forward, smooth};
use super::{FreeMotionEstimate, FreeMotionFilter, FreeMotionParameters};
use nalgebra::{Matrix3, Matrix6, Vector3};

/// The filter for a clean sensor, and beside it an estimator of iron on the sensor.
///
/// A clean sensor must trust its field (the initial heading would be lost otherwise); one with a magnet must not. The two
/// are distinguished as soon as the sensor turns: a magnet turns with it, the world's field does not. Once the magnet is found, its
/// field is subtracted from all samples, the initial ones included, from which the heading is computed again.
#[derive(Clone, Debug, PartialEq)]
pub struct FreeMotionEstimator {
    filter: FreeMotionFilter,
    iron: Option<IronEstimator>,
    begin: Option<Begin>,
    /// Azimuth that the start's samples gave the heading's correction at the latest sample \[rad\].
    azimuth_rad: Option<f64>,
}

/// The field before the sensor moved.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Begin {
    /// Sensor axes into those that turn with the gyro's error only.
    rotation: Matrix3<f64>,
    /// In the latter axes.
    field: Vector3<f64>,
    samples: f64,
    moved: bool,
}

impl FreeMotionEstimator {
    /// An estimator that finds its first attitude from its first samples.
    #[must_use]
    pub fn new(parameters: FreeMotionParameters) -> Self {
        Self { filter: FreeMotionFilter::new(parameters), iron: None, begin: None, azimuth_rad: None }
    }

    /// As [`FreeMotionFilter::on_imu`].
    pub fn on_imu(&mut self, stamp_ns: i64, gyro_rad_s: &Vector3<f64>, force_m_s2: &Vector3<f64>) {
        self.filter.on_imu(stamp_ns, gyro_rad_s, force_m_s2);
        if self.filter.start.is_some() && self.begin.take().is_some() {
            // After a gap the orientation of the axes is unknown; the iron is still there.
            self.azimuth_rad = None;
            if let Some(iron) = &mut self.iron {
                iron.forget_surroundings();
            }
        }
    }

    /// As [`FreeMotionFilter::on_magnetometer`].
    pub fn on_magnetometer(&mut self, field: &Vector3<f64>) {
        let known = self.iron.as_ref().filter(|iron| iron.believed());
        let iron = known.map_or_else(Vector3::zeros, IronEstimator::iron);
        let Some(rotation) = self.filter.on_magnetometer(&(field - iron)) else { return };
        let p = self.filter.parameters;
        let resting = self.filter.rest.resting(&p);
        self.remember_begin(&rotation, field, resting);
        let estimator = self.iron.get_or_insert_with(|| IronEstimator::new(field, p.magnetometer_sigma));
        estimator.step(&rotation, field, p.magnetometer_interval_s, resting);
        self.count_heading_anew();
    }

    /// Whether a magnet on the sensor has been detected.
    #[must_use]
    pub fn is_magnetised(&self) -> bool {
        self.iron.as_ref().is_some_and(IronEstimator::believed)
    }

    /// Covariance of the attitude error (body axes \[rad\]) and the gyro's bias error [rad/s].
    #[must_use]
    pub fn covariance(&self) -> Matrix6<f64> {
        self.filter.covariance()
    }

    /// The estimate; `None` before the first attitude.
    #[must_use]
    pub fn estimate(&self) -> Option<FreeMotionEstimate> {
        let mut estimate = self.filter.estimate()?;
        if let Some(iron) = self.iron.as_ref().filter(|iron| iron.believed()) {
            estimate.iron_magnetometer_unit += iron.iron();
        }
        Some(estimate)
    }

    /// The mean of the samples until the sensor moves.
    fn remember_begin(&mut self, rotation: &Matrix3<f64>, field: &Vector3<f64>, resting: bool) {
        let begin = self.begin.get_or_insert(Begin {
            rotation: *rotation,
            field: rotation * field,
            samples: 1.0,
            moved: false,
        });
        let turned = (rotation - begin.rotation).norm();
        begin.moved = begin.moved || (turned > 0.02 && !resting);
        if !begin.moved {
            begin.samples += 1.0;
            begin.field += (rotation * field - begin.field) / begin.samples;
        }
    }

    /// The heading that the start's samples give without the iron.
    fn count_heading_anew(&mut self) {
        let (Some(begin), Some(iron)) = (&self.begin, self.iron.as_ref().filter(|i| i.believed())) else {
            return;
        };
        let field = begin.field - begin.rotation * iron.iron();
        let azimuth_rad = field.x.atan2(field.y);
        let change = azimuth_rad - self.azimuth_rad.unwrap_or(0.0);
        if self.azimuth_rad.replace(azimuth_rad).is_none() {
            let sigma_rad = (iron.sigma() / field.xy().norm().max(1e-9)).min(1.0);
            self.filter.restart_field(azimuth_rad, sigma_rad, &field, &iron.surroundings());
        } else {
            self.filter.turn_heading(whorl_math::wrap_angle_rad(change));
        }
    }
}

impl OrientationFilter for FreeMotionEstimator {
    const IS_COMPLETE: bool = false;
    const INTERVAL_MEANS: bool = true;

    fn on_imu(&mut self, stamp_ns: i64, sample: &Sample) {
        if let Some(force) = &sample.force_m_s2 {
            Self::on_imu(self, stamp_ns, &sample.gyro_rad_s, force);
        }
    }

    /// The first vector sensor is the magnetometer; any other is not used.
    fn on_vector(&mut self, sensor: usize, seen: &Observed) {
        if sensor == 0 {
            self.on_magnetometer(&seen.body);
        }
    }

    fn orientation(&self) -> Option<Orientation> {
        self.estimate().map(|estimate| Orientation {
            q_world_body: estimate.q_world_body,
            gyro_bias_rad_s: estimate.gyro_bias_rad_s,
            covariance: self.covariance(),
        })
    }
}

/// [`super::smooth`] with [`FreeMotionEstimator`]; whether there is a magnet on the sensor is found out first, and its field is
/// then subtracted from all samples, those before it was found included. Gives the orientations, and whether there is one.
#[must_use]
pub fn smooth_free_motion(
    parameters: FreeMotionParameters,
    samples: &[Sample],
) -> (Vec<Option<Orientation>>, bool) {
    let new = || FreeMotionEstimator::new(parameters);
    let mut first = new();
    forward(&mut first, samples);
    let Some(iron) = first.estimate().filter(|_| first.is_magnetised()) else {
        return (smooth(new, samples), false);
    };
    let mut clean = samples.to_vec();
    for seen in clean.iter_mut().filter_map(|sample| sample.vectors.first_mut()?.as_mut()) {
        seen.body -= iron.iron_magnetometer_unit;
    }
    (smooth(new, &clean), true)
}
