//! Is there iron or a magnet on the sensor?

use super::axes::{AxisCheck, Contradiction};
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
    axes: AxisCheck,
    /// Samples of the gyro until the axes are looked at again.
    until_check: u32,
    /// What contradicts the gyro and is not used: accelerometer, magnetometer.
    wrong: [Option<Contradiction>; 2],
}

/// A field that rises by so much above the horizon is not that of a room's steel \[deg\].
const LEAST_ABOVE_DEG: f64 = 20.0;
/// The axes are looked at after so many samples.
const CHECKED_EVERY: u32 = 100;

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
        Self {
            filter: FreeMotionFilter::new(parameters),
            iron: None,
            begin: None,
            azimuth_rad: None,
            axes: AxisCheck::default(),
            until_check: CHECKED_EVERY,
            wrong: [None, None],
        }
    }

    /// As [`FreeMotionFilter::on_imu`].
    pub fn on_imu(&mut self, stamp_ns: i64, gyro_rad_s: &Vector3<f64>, force_m_s2: &Vector3<f64>) {
        self.filter.on_imu(stamp_ns, gyro_rad_s, force_m_s2);
        self.axes.on_imu(stamp_ns, gyro_rad_s, Some(force_m_s2));
        self.until_check = self.until_check.saturating_sub(1);
        if self.until_check == 0 {
            self.until_check = CHECKED_EVERY;
            self.check_axes();
        }
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
        if self.wrong.iter().last().is_some_and(Option::is_some) {
            return;
        }
        self.axes.on_field(field);
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

    /// Leaves out a sensor that turns against the gyro.
    fn check_axes(&mut self) {
        let [force, field] = self.axes.contradictions();
        let [wrong_force, wrong_field] = &mut self.wrong;
        if wrong_field.is_none() && field.is_some() {
            *wrong_field = field;
            self.filter.give_up_field();
            self.iron = None;
        }
        if wrong_force.is_none() && force.is_some() {
            *wrong_force = force;
            self.filter.give_up_force();
        }
    }

    /// What contradicts the gyro: accelerometer, magnetometer. It is not used.
    #[must_use]
    pub fn contradictions(&self) -> &[Option<Contradiction>; 2] {
        &self.wrong
    }

    /// What is odd about the sensors, in words.
    #[must_use]
    pub fn doubts(&self) -> Vec<String> {
        let clipping = &self.filter.clipping;
        let clipped = (clipping.count() > 0).then(|| clipping.to_string());
        let (gaps, longest_s) = self.filter.gaps;
        let gaps = (gaps > 0).then(|| {
            format!(
                "{gaps} gaps of more than a second, the longest {longest_s:.1} s: behind each the attitude starts anew; without a \
                 magnetometer the heading is that of before, as uncertain as a turn meanwhile makes it."
            )
        });
        let above_deg = self.filter.begin.map_or(0.0, |begin| begin.y.atan2(begin.x).to_degrees());
        let rises = (above_deg > LEAST_ABOVE_DEG).then(|| {
            format!(
                "The field points {above_deg:.0} deg above the horizon, as it does south of the equator. North of it the accelerometer's \
                 three signs are reversed (at rest it reads +1 g upwards, not gravity), or the magnetometer's are, and the heading is wrong."
            )
        });
        super::axes::doubts(&self.wrong).into_iter().chain(clipped).chain(gaps).chain(rises).collect()
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

/// A recording, smoothed.
#[derive(Clone, Debug)]
pub struct Smoothed {
    /// The orientation at each sample.
    pub orientations: Vec<Option<Orientation>>,
    /// Whether there is a magnet on the sensor.
    pub is_magnetised: bool,
    /// What is odd about the sensors, in words.
    pub doubts: Vec<String>,
}

/// [`super::smooth`] with [`FreeMotionEstimator`]; whether there is a magnet on the sensor, and whether its magnetometer turns
/// against the gyro, is found out first. The magnet's field is then subtracted from all samples, those before it was found included;
/// a magnetometer that is wrong is not used at all.
#[must_use]
pub fn smooth_free_motion(parameters: FreeMotionParameters, samples: &[Sample]) -> Smoothed {
    let new = || FreeMotionEstimator::new(parameters);
    let mut first = new();
    forward(&mut first, samples);
    let doubts = first.doubts();
    let [_, wrong_field] = first.contradictions();
    if wrong_field.is_some() {
        let mut without = samples.to_vec();
        without.iter_mut().filter_map(|sample| sample.vectors.first_mut()).for_each(|seen| *seen = None);
        return Smoothed { orientations: smooth(new, &without), is_magnetised: false, doubts };
    }
    let Some(iron) = first.estimate().filter(|_| first.is_magnetised()) else {
        return Smoothed { orientations: smooth(new, samples), is_magnetised: false, doubts };
    };
    let mut clean = samples.to_vec();
    for seen in clean.iter_mut().filter_map(|sample| sample.vectors.first_mut()?.as_mut()) {
        seen.body -= iron.iron_magnetometer_unit;
    }
    Smoothed { orientations: smooth(new, &clean), is_magnetised: true, doubts }
}
