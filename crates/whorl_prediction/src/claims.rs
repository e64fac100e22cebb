//! What the model alone claims to know, along the way of a filter that allows for disturbances.

use nalgebra::DMatrix;

use crate::layout::Layout;
use crate::transition::Step;

/// What predictions ahead need of a filter.
pub(crate) struct Claims {
    /// Covariance if there were no disturbance; `None`: the filter allows for none.
    pub covariance: Option<DMatrix<f64>>,
    /// Motion of errors since the last instant, as far as they move.
    pub transition: DMatrix<f64>,
    /// What the model's own random torques have added since; `None`: it has none.
    pub noise: Option<DMatrix<f64>>,
}

impl Claims {
    /// Of a filter that begins with this covariance.
    pub fn new(covariance: &DMatrix<f64>, layout: Layout, has_own_noise: bool) -> Self {
        let m = layout.moving();
        let disturbances = layout.plant.size()..m;
        let without = (!disturbances.is_empty()).then(|| {
            let mut without = covariance.clone();
            for i in disturbances {
                without.row_mut(i).fill(0.0);
                without.column_mut(i).fill(0.0);
            }
            without
        });
        Self {
            covariance: without,
            transition: DMatrix::identity(m, m),
            noise: has_own_noise.then(|| DMatrix::zeros(m, m)),
        }
    }

    /// Sets out from an instant.
    pub fn set_out(&mut self) {
        self.transition.fill_with_identity();
        if let Some(noise) = &mut self.noise {
            noise.fill(0.0);
        }
    }

    /// Follows a step.
    pub fn follow(&mut self, step: &Step) {
        self.transition = &step.transition * &self.transition;
        if let Some((noise, added)) = self.noise.as_mut().zip(step.of_model.as_ref()) {
            *noise = &step.transition * &*noise * step.transition.transpose() + added;
        }
    }
}
