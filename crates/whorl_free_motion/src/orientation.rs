//! What filters of a recording take in and give, and smoothing over a whole recording.
//!
//! # Fixed-interval smoothing
//!
//! A filter knows the past. Run over the reversed recording (time and rates change their signs, directions and specific force
//! do not) the same filter knows the future. Both are joined by their information, errors in body axes with the gyro bias
//! (D. C. Fraser, J. E. Potter, "The optimum linear smoother as a combination of two optimum linear filters", IEEE
//! Transactions on Automatic Control 14(4), 1969):
//!
//! ```text
//! P = (Pf^-1 + Pb^-1)^-1,   x = xf + P Pb^-1 (xb - xf)
//! ```
//!
//! A sample's own directions are in the forward estimate only. For linear models with independent noise this is the
//! optimum; knowledge before the first sample (of biases, of north at the place of both ends) is counted twice.

use nalgebra::{Matrix3, Matrix6, Unit, UnitQuaternion, Vector3, Vector6};
use whorl_math::{quaternion_exp, rotation_vector};

/// A direction, or a field, that was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observed {
    /// In sensor axes; its length counts for magnetometers, in any unit.
    pub body: Vector3<f64>,
    /// The same direction in the world at that time; `None` where the filter needs none or it is unknown.
    pub reference_w: Option<Unit<Vector3<f64>>>,
}

/// One line of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Time \[ns\].
    pub stamp_ns: i64,
    /// Gyro, sensor axes [rad/s].
    pub gyro_rad_s: Vector3<f64>,
    /// Specific force, sensor axes [m/s^2], of sensors that have an accelerometer.
    pub force_m_s2: Option<Vector3<f64>>,
    /// New measurements of each vector sensor.
    pub vectors: Vec<Option<Observed>>,
}

/// An orientation with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orientation {
    /// Rotates sensor axes into world axes.
    pub q_world_body: UnitQuaternion<f64>,
    /// Gyro bias, sensor axes [rad/s].
    pub gyro_bias_rad_s: Vector3<f64>,
    /// Of the attitude error (rotation vector, sensor axes \[rad\]) and the bias error [rad/s].
    pub covariance: Matrix6<f64>,
}

impl Orientation {
    /// Covariance of the attitude error in world axes \[rad^2\].
    #[must_use]
    pub fn covariance_w_rad2(&self) -> Matrix3<f64> {
        let rotation = *self.q_world_body.to_rotation_matrix().matrix();
        rotation * self.covariance.fixed_view::<3, 3>(0, 0) * rotation.transpose()
    }
}

/// A filter that is run over recordings.
pub trait OrientationFilter {
    /// Whether it takes a gyro sample for the mean over the interval that ends with it, or else for that instant's.
    const INTERVAL_MEANS: bool;
    /// Whether attitude and bias are all of its state. A filter with further states (scale, field) is joined by its attitude
    /// alone: what it knows of the bias hangs on the states that are left out.
    const IS_COMPLETE: bool;
    /// Gyro and accelerometer of a sample.
    fn on_imu(&mut self, stamp_ns: i64, sample: &Sample);
    /// A measurement of a vector sensor, at the time of the latest inertial sample.
    fn on_vector(&mut self, sensor: usize, seen: &Observed);
    /// The estimate; `None` before the first attitude.
    fn orientation(&self) -> Option<Orientation>;

    /// A whole sample.
    fn on_sample(&mut self, sample: &Sample) {
        self.on_imu(sample.stamp_ns, sample);
        for (sensor, seen) in sample.vectors.iter().enumerate() {
            if let Some(seen) = seen {
                self.on_vector(sensor, seen);
            }
        }
    }
}

/// The estimate after each sample.
pub fn forward<F: OrientationFilter>(filter: &mut F, samples: &[Sample]) -> Vec<Option<Orientation>> {
    let one = |sample: &Sample| {
        filter.on_sample(sample);
        filter.orientation()
    };
    samples.iter().map(one).collect()
}

/// The estimate from all that follows a sample, its own directions left out.
pub fn backward<F: OrientationFilter>(filter: &mut F, samples: &[Sample]) -> Vec<Option<Orientation>> {
    let mut found = vec![None; samples.len()];
    let end_ns = samples.last().map_or(0, |sample| sample.stamp_ns);
    for index in (0..samples.len()).rev() {
        let Some(sample) = samples.get(index) else { continue };
        // The mean rate over the interval that is passed now came with its later end.
        let measured = if F::INTERVAL_MEANS { samples.get(index + 1).unwrap_or(sample) } else { sample };
        let reversed = Sample {
            stamp_ns: end_ns - sample.stamp_ns,
            gyro_rad_s: -measured.gyro_rad_s,
            force_m_s2: sample.force_m_s2,
            vectors: Vec::new(),
        };
        filter.on_imu(reversed.stamp_ns, &reversed);
        if let Some(slot) = found.get_mut(index) {
            *slot = filter.orientation().map(reversed_in_time);
        }
        for (sensor, seen) in sample.vectors.iter().enumerate() {
            if let Some(seen) = seen {
                filter.on_vector(sensor, seen);
            }
        }
    }
    found
}

/// A rate that changes its sign does so with its bias.
fn reversed_in_time(mut o: Orientation) -> Orientation {
    o.gyro_bias_rad_s = -o.gyro_bias_rad_s;
    let flip = Matrix6::from_diagonal(&Vector6::new(1.0, 1.0, 1.0, -1.0, -1.0, -1.0));
    o.covariance = flip * o.covariance * flip;
    o
}

/// The estimate of each sample from all samples; see the module. `new` makes a filter.
pub fn smooth<F: OrientationFilter>(new: impl Fn() -> F, samples: &[Sample]) -> Vec<Option<Orientation>> {
    let past = forward(&mut new(), samples);
    let future = backward(&mut new(), samples);
    join::<F>(&past, &future)
}

/// The estimates from both sides of each sample, joined.
pub(super) fn join<F: OrientationFilter>(
    past: &[Option<Orientation>],
    future: &[Option<Orientation>],
) -> Vec<Option<Orientation>> {
    let both = |(past, future): (&Option<Orientation>, &Option<Orientation>)| {
        let (Some(past), Some(future)) = (past, future) else { return past.or(*future) };
        let [a, b] = [past, future].map(|o| if F::IS_COMPLETE { *o } else { without_correlation(o) });
        joined(&a, &b).or(Some(*past))
    };
    past.iter().zip(future).map(both).collect()
}

fn without_correlation(o: &Orientation) -> Orientation {
    let mut o = *o;
    o.covariance.fixed_view_mut::<3, 3>(0, 3).fill(0.0);
    o.covariance.fixed_view_mut::<3, 3>(3, 0).fill(0.0);
    o
}

fn joined(past: &Orientation, future: &Orientation) -> Option<Orientation> {
    let [of_past, of_future] = [past, future].map(|o| o.covariance.cholesky().map(|c| c.inverse()));
    let (of_past, of_future) = (of_past?, of_future?);
    let covariance = (of_past + of_future).cholesky()?.inverse();
    let mut apart = Vector6::zeros();
    let turn = rotation_vector(&(past.q_world_body.inverse() * future.q_world_body));
    apart.fixed_rows_mut::<3>(0).copy_from(&turn);
    apart.fixed_rows_mut::<3>(3).copy_from(&(future.gyro_bias_rad_s - past.gyro_bias_rad_s));
    let correction = covariance * of_future * apart;
    Some(Orientation {
        q_world_body: past.q_world_body * quaternion_exp(&Vector3::from(correction.fixed_rows::<3>(0))),
        gyro_bias_rad_s: past.gyro_bias_rad_s + Vector3::from(correction.fixed_rows::<3>(3)),
        covariance,
    })
}
