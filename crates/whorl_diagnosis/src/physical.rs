//! Steps of a fit end at platforms that can exist.
//!
//! While a large effect is still missing, the base model bends to follow it, and a whole step may leave the
//! inertias that a rigid body can have. A shorter one does not; once the effect is in, the fit comes back.

use whorl_dynamics::Gyrostat;

use crate::parameters::{Point, Reference};

/// Halvings of a step.
const HALVINGS: u32 = 6;

/// Distance from the edge of what can exist, as a share of the trace of the inertia.
const MARGIN: f64 = 0.01;

impl Reference {
    /// The point `to`, or as far towards it from `from` as the platform can exist.
    pub(crate) fn towards(&self, from: &Point, to: Point) -> Point {
        for halvings in 0..=HALVINGS {
            let point = between(from, &to, 0.5_f64.powi(halvings as i32));
            if self.is_well_inside(&point) {
                return point;
            }
        }
        from.clone()
    }

    /// Whether the platform can exist, and its neighbours too, from which sensitivities are taken: its largest
    /// principal moment stays below the sum of the others.
    fn is_well_inside(&self, point: &Point) -> bool {
        let Ok(gyrostat) = self.model_at(point).and_then(|model| Ok(Gyrostat::new(&model)?)) else {
            return false;
        };
        let inertia = gyrostat.model().mass_properties.inertia_b_kg_m2();
        let trace = inertia.trace();
        let largest = inertia.symmetric_eigenvalues().max();
        trace - 2.0 * largest > MARGIN * trace
    }
}

/// The share `share` of the way; effects that `from` does not have come with the values of `to`.
pub(crate) fn between(from: &Point, to: &Point, share: f64) -> Point {
    let mix = |a: f64, b: f64| a + share * (b - a);
    let mut point = to.clone();
    for (moment, start) in point.moments.iter_mut().zip(&from.moments) {
        *moment = mix(*start, *moment);
    }
    for (id, values) in &mut point.effects {
        match from.effects.get(id) {
            Some(start) => values.iter_mut().zip(start).for_each(|(v, s)| *v = mix(*s, *v)),
            // Corrections of the base model start from nothing.
            None if crate::parameters::BASE_EFFECTS.contains(id) => {
                values.iter_mut().for_each(|v| *v = mix(0.0, *v));
            }
            None => {}
        }
    }
    point
}

#[cfg(test)]
mod tests {
    use whorl_dynamics::{ModelPrior, PlatformModel};

    use super::*;

    #[test]
    fn a_step_beyond_what_a_body_can_have_is_shortened() {
        let model = PlatformModel::whorl_1_reference();
        let reference = Reference::new(&model, &ModelPrior::typical(&model));
        let from = reference.point();
        let inside = Point { moments: [0.3, -0.2, 0.1], ..from.clone() };
        assert_eq!(reference.towards(&from, inside.clone()), inside);
        // I_zz may not exceed I_xx + I_yy.
        let outside = Point { moments: [0.0, 0.0, 8.0], ..from.clone() };
        assert!(Gyrostat::new(&reference.model_at(&outside).unwrap_or_else(|_| model.clone())).is_ok());
        let reached = reference.towards(&from, outside);
        assert!(reached.moments[2] > 0.0 && reached.moments[2] < 8.0, "{reached:?}");
        assert!(reference.model_at(&reached).is_ok());
    }
}
