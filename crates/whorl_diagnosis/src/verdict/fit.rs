//! The best values of chosen effects along a smoothed motion, and implausible values.

use whorl_dynamics::Effect;

use crate::DiagnosisError;
use crate::search::Search;
use crate::search::step::point_of;

impl Search<'_> {
    /// Makes these effects, and only these, the best hypothesis, and converges on them.
    pub(crate) fn adopt(&mut self, effects: &[&'static dyn Effect]) -> Result<(), DiagnosisError> {
        for effect in effects {
            let id = effect.info().id;
            if self.problem.reference.model.effects.contains_key(id) {
                continue;
            }
            let found = self
                .design
                .candidates
                .iter()
                .position(|c| c.id == id)
                .and_then(|c| self.best.with(&self.design, &self.data.total, c));
            // Against its sign constraint it stays at its neutral value: there is nothing to adopt.
            let Some(next) = found else {
                return Err(DiagnosisError::NoEffect { id: id.to_owned() });
            };
            self.best = next;
        }
        // A second time where the first did not come to its minimum.
        if self.relinearise()?.predicted_decrease > 2.0 * self.options.settings.unfinished_nats {
            self.relinearise()?;
        }
        self.regress_held()
    }

    /// The moment of inertia that the best explanation has moved to an implausible value, if one is: data of another platform
    /// bias the model until some effect is named, and that effect is not what the model lacks.
    pub(crate) fn implausible_inertia(&self) -> Option<String> {
        let point = point_of(self.problem, &self.design, &self.point, &self.best);
        let (reference, settings) = (&self.problem.reference, &self.options.settings);
        let inertia = reference.model.mass_properties.inertia_b_kg_m2();
        (0..3).zip(["xx", "yy", "zz"]).zip(point.moments).find_map(|((axis, name), moved)| {
            let given = inertia[(axis, axis)];
            let stddev = reference.prior.inertia_b_kg_m2[(axis, axis)].max(settings.least_inertia_share * given);
            (moved.abs() > settings.other_platform_stddevs * stddev).then(|| {
                format!(
                    "the fit requires a moment of inertia {name} of {:.2} kg m^2, but the model says {given:.2} +- {stddev:.2}",
                    given + moved
                )
            })
        })
    }
}
