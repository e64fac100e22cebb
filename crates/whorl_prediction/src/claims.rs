//! What the model alone claims to know, along the way of a filter that allows for disturbances.

use nalgebra::Vector3;

use crate::lanes::{Lanes, Sparse};
use crate::layout::Layout;
use crate::transition::Step;

/// What predictions ahead need of a filter.
pub(crate) struct Claims {
    /// Covariance if there were no disturbance; `None`: the filter allows for none.
    pub covariance: Option<Lanes>,
    /// Motion of errors since the last instant, less one, as far as they move.
    pub transition: Sparse,
    /// What the model's own random torques have added since; `None`: it has none.
    pub noise: Option<Lanes>,
    carried: Lanes,
}

impl Claims {
    /// Of a filter that begins with this covariance.
    pub fn new(covariance: &Lanes, layout: Layout, has_own_noise: bool) -> Self {
        let m = layout.moving();
        let disturbances = layout.plant.size()..m;
        let without = (!disturbances.is_empty()).then(|| {
            let mut without = covariance.clone();
            disturbances.for_each(|i| without.hold(i));
            without
        });
        let carried = Lanes::zeros(m, layout.size());
        Self {
            covariance: without,
            transition: Sparse::default(),
            noise: has_own_noise.then(|| carried.clone()),
            carried,
        }
    }

    /// Sets out from an instant.
    pub fn set_out(&mut self) {
        let moving = self.carried.rows();
        self.carried.clear(moving);
        (0..moving).for_each(|i| self.carried.row_mut(i)[i] = 1.0);
        if let Some(noise) = &mut self.noise {
            noise.clear(moving);
        }
    }

    /// Follows a step, without turns about an axis.
    pub fn follow(&mut self, step: &Step, unseen_axis: Option<&Vector3<f64>>) {
        self.carried.carry(&step.transition);
        if let Some(noise) = &mut self.noise {
            noise.grow(&step.transition, step.of_model.as_ref());
        }
        if let Some(axis) = unseen_axis {
            self.carried.level(axis);
            self.noise.iter_mut().for_each(|noise| noise.level_covariance(axis));
        }
    }

    /// At the next instant.
    pub fn arrive(&mut self) {
        let moving = self.carried.rows();
        self.transition.clear();
        for i in 0..moving {
            let row = self.carried.row(i).iter().take(moving).enumerate();
            self.transition.push(row.map(|(k, x)| if k == i { x - 1.0 } else { *x }));
        }
    }
}
