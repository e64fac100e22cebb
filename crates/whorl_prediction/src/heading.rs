//! The heading of a platform on which nothing shows a heading.

use nalgebra::{DMatrix, Vector3};
use whorl_dynamics::plant::{LinearisedPlant, Plant, ROTATION};
use whorl_math::vertical_b;
use whorl_recording::Channel;

use crate::lanes::Lanes;
use crate::prepared::Prepared;

/// Share of the derivatives by attitude below which motion and readings do not depend on the heading: differences that make them
/// err by less than a hundredth of it.
const NOTHING: f64 = 1e-6;

/// Whether neither the motion nor a reading depends on how far the platform is turned about the vertical.
///
/// Such a heading can be anything, and a filter takes the one that it has, at the start and all the way. With a heading that is
/// uncertain every correction of the tilt would make the axis of what is uncertain a little another one, and the filter would learn
/// of it what no reading says: Huang, Mourikis, Roumeliotis 2010, "Observability-based rules for designing consistent EKF SLAM
/// estimators". What a body's axes are turned by about others than the vertical does not depend on the heading, so that nothing is lost.
#[derive(Debug, Clone, Copy)]
pub(crate) struct UnseenHeading {
    is_unseen: bool,
    /// The vertical at the start, body axes.
    at_start_b: Vector3<f64>,
}

impl UnseenHeading {
    /// Every heading matters.
    pub const NONE: Self = Self { is_unseen: false, at_start_b: Vector3::new(0.0, 0.0, 0.0) };

    /// Of a plant at its start.
    pub fn of(case: &Prepared<'_>, plant: &Plant, linearised: &LinearisedPlant) -> Self {
        let at_start_b = vertical_b(&plant.state().q_world_body);
        let seen = case.tracks().iter().any(|track| track.channel == Channel::Vector);
        Self { is_unseen: !seen && !matters(linearised, &at_start_b), at_start_b }
    }

    /// The axis at the start turns about which are of no consequence; `None`: all are.
    pub fn at_start(self) -> Option<Vector3<f64>> {
        self.is_unseen.then_some(self.at_start_b)
    }

    /// The same where a plant is now.
    pub fn now(self, plant: &Plant) -> Option<Vector3<f64>> {
        self.is_unseen.then(|| vertical_b(&plant.state().q_world_body))
    }

    /// A covariance of the start without it.
    pub fn out_of(self, covariance: &DMatrix<f64>) -> DMatrix<f64> {
        let Some(axis) = self.at_start() else { return covariance.clone() };
        let mut lanes = Lanes::of(covariance);
        lanes.level_covariance(&axis);
        lanes.matrix(covariance.nrows(), covariance.ncols())
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
