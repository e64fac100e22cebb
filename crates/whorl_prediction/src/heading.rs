//! The heading of a platform on which nothing shows a heading.

use nalgebra::{DMatrix, Matrix3, Vector3};
use whorl_dynamics::plant::{LinearisedPlant, Plant, ROTATION};
use whorl_recording::Channel;

use crate::prepared::Prepared;

/// Share of the derivatives by attitude below which motion and readings do not depend on the heading: differences that make them
/// err by less than a hundredth of it.
const NOTHING: f64 = 1e-6;

/// The vertical in the body, where neither the motion nor a reading depends on how far the platform is turned about it.
///
/// Such a heading can be anything, and a filter takes the one that it has. With a heading that is uncertain every correction of the
/// tilt would make the axis of what is uncertain a little another one, and the filter would learn of it what no reading says:
/// Huang, Mourikis, Roumeliotis 2010, "Observability-based rules for designing consistent EKF SLAM estimators".
#[derive(Debug, Clone, Copy)]
pub(crate) struct UnseenHeading(Option<Vector3<f64>>);

impl UnseenHeading {
    /// In the present state of a plant.
    pub fn of(case: &Prepared<'_>, plant: &Plant, linearised: &LinearisedPlant) -> Self {
        let vertical_b = plant.state().q_world_body.inverse_transform_vector(&Vector3::z());
        let seen = case.tracks().iter().any(|track| track.channel == Channel::Vector);
        Self((!seen && !matters(linearised, &vertical_b)).then_some(vertical_b))
    }

    /// A covariance without it.
    pub fn out_of(self, covariance: &DMatrix<f64>) -> DMatrix<f64> {
        let Some(vertical_b) = self.0 else { return covariance.clone() };
        let n = covariance.nrows();
        let mut tilts = DMatrix::identity(n, n);
        let level = Matrix3::identity() - vertical_b * vertical_b.transpose();
        tilts.view_mut((ROTATION.start, ROTATION.start), (3, 3)).copy_from(&level);
        &tilts * covariance * &tilts
    }
}

/// Whether a turn about the vertical changes what the plant does next, or what its sensors read.
fn matters(linearised: &LinearisedPlant, vertical_b: &Vector3<f64>) -> bool {
    let motion = linearised.rate_by_state.fixed_columns::<3>(ROTATION.start);
    let readings = linearised.imu_by_state.fixed_columns::<3>(ROTATION.start);
    // By row: a torque is no speed. How a turn itself goes on does not count.
    let mut rows = motion.row_iter().skip(ROTATION.end).chain(readings.row_iter());
    rows.any(|row| (row * vertical_b).x.abs() > NOTHING * row.norm())
}
