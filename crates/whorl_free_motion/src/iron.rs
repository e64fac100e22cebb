//! Iron or a magnet on the sensor: its field turns with the sensor, that of the surroundings does not.

use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3, Vector6};
use whorl_math::covariance;

/// What is known of both fields before the first sample, relative to the first sample's length \[1\].
const PRIOR_SIGMA: f64 = 3.0;
/// How fast the field of the surroundings changes as the sensor moves, relative to the same [1/sqrt(s)].
const FIELD_WALK_PER_SQRT_S: f64 = 0.01;
/// Over this time in motion the surroundings deviate from their mean in the same direction \[s\].
const SAME_DEVIATION_S: f64 = 0.5;
/// The mean square deviation is taken over \[s\].
const DEVIATION_S: f64 = 5.0;
/// A magnet is accepted when its field is this many standard deviations ...
const BELIEVED_SIGMAS: f64 = 7.0;
/// ... and larger than this, relative to the field of the surroundings (of six trials of BROAD without a magnet on the
/// sensor, one shows 8 % that are not there, because the field differs where the sensor is turned) \[1\], ...
const BELIEVED_SIZE: f64 = 0.12;
/// ... and this many times the root mean square of what it leaves unexplained: a magnet in the room changes the field too, but
/// not with the sensor's attitude, and an iron that is fitted to it explains little \[1\], ...
const BELIEVED_RATIO: f64 = 2.0;
/// ... and known to this \[1\].
const BELIEVED_KNOWN: f64 = 0.05;

/// Recursive least squares of the field of the surroundings, in axes that turn with the gyro's error only, and of the
/// field of iron, in sensor axes. Both enter linearly, so no first guess is needed: half a turn of heading that a
/// magnet causes is found like any other.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct IronEstimator {
    /// Surroundings, then iron, in the unit of the magnetometer.
    state: Vector6<f64>,
    covariance: Matrix6<f64>,
    length: f64,
    noise: f64,
    /// Mean square deviation of a sample, squared unit.
    deviation: f64,
    /// Sum of the deviations of all samples in motion, and their number.
    unexplained: (f64, f64),
    believed: bool,
}

impl IronEstimator {
    /// `noise`: of one sample, relative to its length.
    pub(super) fn new(first: &Vector3<f64>, noise: f64) -> Self {
        let length = first.norm();
        let mut estimator = Self {
            state: Vector6::zeros(),
            covariance: Matrix6::identity() * (PRIOR_SIGMA * length).powi(2),
            length,
            noise: noise * length,
            deviation: (noise * length).powi(2),
            unexplained: (0.0, 0.0),
            believed: false,
        };
        estimator.forget_surroundings();
        estimator
    }

    /// Changes to new axes of the surroundings.
    pub(super) fn forget_surroundings(&mut self) {
        for n in 0..3 {
            self.covariance.fill_row(n, 0.0);
            self.covariance.fill_column(n, 0.0);
            self.covariance[(n, n)] = (PRIOR_SIGMA * self.length).powi(2);
            self.state[n] = 0.0;
        }
    }

    /// One sample; `rotation` takes sensor axes into those of the surroundings. `moved_s`: time since the sample before,
    /// in motion.
    pub(super) fn step(
        &mut self,
        rotation: &Matrix3<f64>,
        measured: &Vector3<f64>,
        interval_s: f64,
        resting: bool,
    ) {
        if !resting {
            let walk = (FIELD_WALK_PER_SQRT_S * self.length).powi(2) * interval_s;
            for n in 0..3 {
                self.covariance[(n, n)] += walk;
            }
        }
        let mut h = SMatrix::<f64, 3, 6>::identity();
        h.fixed_view_mut::<3, 3>(0, 3).copy_from(rotation);
        let innovation = rotation * measured - h * self.state;
        let spread = h * self.covariance * h.transpose();
        // The part explained by the uncertainty of the state does not count as a deviation.
        let excess = (innovation.norm_squared() - spread.trace()).max(0.0) / 3.0;
        self.deviation += (excess - self.deviation) * (interval_s / DEVIATION_S).min(1.0);
        if !resting {
            self.unexplained.0 += excess * 3.0;
            self.unexplained.1 += 1.0;
        }
        let places = 1.0 + 2.0 * SAME_DEVIATION_S / interval_s.max(1e-3);
        let variance = (self.noise.powi(2) + self.deviation) * places;
        let noise = Matrix3::identity() * variance;
        let Some(update) = covariance::update(&mut self.covariance, &h, &noise, &innovation, |_| true) else {
            return;
        };
        self.state += update.correction;
        self.believed = self.believed || self.clear();
    }

    /// The iron's field, sensor axes.
    pub(super) fn iron(&self) -> Vector3<f64> {
        self.state.fixed_rows::<3>(3).into_owned()
    }

    /// The current field of the surroundings.
    pub(super) fn surroundings(&self) -> Vector3<f64> {
        self.state.fixed_rows::<3>(0).into_owned()
    }

    /// Largest standard deviation of the iron's field along any direction.
    pub(super) fn sigma(&self) -> f64 {
        self.iron_covariance().symmetric_eigenvalues().max().max(0.0).sqrt()
    }

    /// Whether there is iron; once seen it stays.
    pub(super) fn believed(&self) -> bool {
        self.believed
    }

    fn iron_covariance(&self) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(3, 3).into_owned()
    }

    fn clear(&self) -> bool {
        let (iron, size) = (self.iron(), self.surroundings().norm());
        if iron.norm() < BELIEVED_SIZE * size || self.sigma() > BELIEVED_KNOWN * size {
            return false;
        }
        let left = self.unexplained.0 / self.unexplained.1.max(1.0);
        if iron.norm_squared() < BELIEVED_RATIO.powi(2) * left {
            return false;
        }
        let Some(weight) = self.iron_covariance().try_inverse() else { return false };
        iron.dot(&(weight * iron)) > BELIEVED_SIGMAS.powi(2)
    }
}
