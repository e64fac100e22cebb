//! Covariance of the free-motion filter.

use nalgebra::{Matrix1, Matrix3, SMatrix, SVector, Vector3};
use whorl_math::covariance;

/// Standard deviation of a heading that nothing is known of: a uniform distribution over the whole turn \[rad\].
pub(super) const UNKNOWN_RAD: f64 = 1.8;

pub(super) const STATES: usize = 30;
/// Rotation vector, world axes \[rad\].
pub(super) const ATTITUDE: usize = 0;
/// World axes [m/s].
pub(super) const VELOCITY: usize = 3;
/// World axes \[m\].
pub(super) const POSITION: usize = 6;
/// Sensor axes [rad/s].
pub(super) const GYRO_BIAS: usize = 9;
/// Sensor axes [m/s^2].
pub(super) const FORCE_BIAS: usize = 12;
/// East, north and up component of the field, relative to the first field's length.
pub(super) const FIELD: usize = 15;
/// Field of iron on the sensor, sensor axes, in the same unit.
pub(super) const IRON: usize = 18;

/// Error of the gyro's scale and axes, row by row: `omega = (1 + K) y - b`.
pub(super) const GYRO_MATRIX: usize = 21;

pub(super) type Covariance = SMatrix<f64, STATES, STATES>;
pub(super) type Row = SVector<f64, STATES>;

/// What the covariance needs of an interval.
pub(super) struct Interval {
    pub dt_s: f64,
    /// Integral of the rotation matrix \[s\].
    pub rotation_s: Matrix3<f64>,
    /// Integral of the rotation matrix times each rate of the gyro \[rad\].
    pub rotation_rate: [Matrix3<f64>; 3],
    /// Integral of the specific force in world axes [m/s].
    pub force_w_m_s: Vector3<f64>,
    /// What is left of the field's east component \[1\].
    pub east_left: f64,
    /// Variances added to the states.
    pub noise: Row,
}

/// Growth over an interval: `F P F^T + Q` with the [`transition`] F, which is the identity but for a few blocks. As P is
/// symmetric, `F (F P)^T` is that: F acts on columns twice, at a tenth of the cost of dense products.
pub(super) fn propagate(p: &mut Covariance, interval: &Interval) {
    let force_skew = whorl_math::skew(&interval.force_w_m_s);
    for _ in 0..2 {
        for mut column in p.column_iter_mut() {
            let part = |at: usize| Vector3::new(column[at], column[at + 1], column[at + 2]);
            let (attitude, velocity) = (part(ATTITUDE), part(VELOCITY));
            let mut turned = -(interval.rotation_s * part(GYRO_BIAS));
            for (k, of_rate) in interval.rotation_rate.iter().enumerate() {
                let gains = Vector3::from_fn(|row, _| column[GYRO_MATRIX + 3 * row + k]);
                turned += of_rate * gains;
            }
            let pushed = -(force_skew * attitude) - interval.rotation_s * part(FORCE_BIAS);
            for axis in 0..3 {
                column[POSITION + axis] += velocity[axis] * interval.dt_s;
                column[VELOCITY + axis] += pushed[axis];
                column[ATTITUDE + axis] += turned[axis];
            }
            column[FIELD] *= interval.east_left;
        }
        p.transpose_mut();
    }
    covariance::symmetrise(p);
    for (state, noise) in interval.noise.iter().enumerate() {
        p[(state, state)] += noise;
    }
}

/// The transition of the errors over an interval.
#[cfg(test)]
pub(super) fn transition(interval: &Interval) -> Covariance {
    let mut f = Covariance::identity();
    let force_skew = whorl_math::skew(&interval.force_w_m_s);
    f.fixed_view_mut::<3, 3>(ATTITUDE, GYRO_BIAS).copy_from(&-interval.rotation_s);
    f.fixed_view_mut::<3, 3>(VELOCITY, ATTITUDE).copy_from(&-force_skew);
    f.fixed_view_mut::<3, 3>(VELOCITY, FORCE_BIAS).copy_from(&-interval.rotation_s);
    f.fixed_view_mut::<3, 3>(POSITION, VELOCITY).copy_from(&(Matrix3::identity() * interval.dt_s));
    for row in 0..3 {
        for column in 0..3 {
            let turned = interval.rotation_rate[column].column(row);
            f.fixed_view_mut::<3, 1>(ATTITUDE, GYRO_MATRIX + 3 * row + column).copy_from(&turned);
        }
    }
    f[(FIELD, FIELD)] = interval.east_left;
    f
}

/// A scalar update whose gain is limited to some states. Returns the correction and the
/// variance of the innovation.
pub(super) fn update(p: &mut Covariance, h: &Row, z: f64, variance: f64, mask: Option<&Row>) -> (Row, f64) {
    let on = *p * h;
    let s = h.dot(&on) + variance;
    let gain = match mask {
        Some(mask) => {
            let gain = (on / s).component_mul(mask);
            covariance::correct(p, &gain, &on, &Matrix1::new(s));
            gain
        }
        None => {
            let gain = covariance::correct_scalar(p, &on, s);
            covariance::symmetrise(p);
            gain
        }
    };
    (gain * z, s)
}
