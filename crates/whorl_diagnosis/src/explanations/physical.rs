//! Steps of a fit end at platforms that can exist.
//!
//! While a large effect is still missing, the base model bends to follow it, and a whole step may leave the
//! inertias that a rigid body can have. A shorter one does not; once the effect is in, the fit comes back.

use nalgebra::Vector3;
use whorl_dynamics::{Gyrostat, INERTIA_TOLERANCE};

use crate::parameters::{Point, Reference};

/// Halvings of a step.
const HALVINGS: u32 = 6;

/// How far the largest principal moment may exceed the sum of the others, as a share of that sum: somewhat less than
/// what a model is refused for, since sensitivities are taken from models around.
const TOLERANCE: f64 = 0.6 * INERTIA_TOLERANCE;

/// Corrections of a point that left what can exist: the axis of the largest moment turns a little with each.
const CORRECTIONS: usize = 4;

impl Reference {
    /// The point `to`, its moments of inertia corrected where no platform has them; else as far towards it from `from`
    /// as a platform can exist.
    pub(crate) fn towards(&self, from: &Point, to: Point) -> Point {
        let mut to = to;
        for _ in 0..CORRECTIONS {
            let Some(change) = self.correction(&to) else { break };
            to.moments.iter_mut().zip(&change).for_each(|(moment, change)| *moment += change);
        }
        for halvings in 0..=HALVINGS {
            let point = between(from, &to, 0.5_f64.powi(halvings as i32));
            if self.can_exist(&point) {
                return point;
            }
        }
        from.clone()
    }

    fn can_exist(&self, point: &Point) -> bool {
        self.correction(point).is_none()
            && self.model_at(point).and_then(|model| Ok(Gyrostat::new(&model)?)).is_ok()
    }

    /// The shortest way for the moments of inertia to where the largest principal moment is small enough, to first
    /// order [kg m^2]; `None` if it is.
    fn correction(&self, point: &Point) -> Option<Vector3<f64>> {
        let eigen = self.inertia_b_kg_m2(point).symmetric_eigen();
        let (axis, largest) = eigen.eigenvalues.argmax();
        let others = eigen.eigenvalues.sum() - largest;
        let excess = largest - (1.0 + TOLERANCE) * others;
        let slope = eigen.eigenvectors.column(axis).map(|x| x * x - (1.0 + TOLERANCE) * (1.0 - x * x));
        (excess > 0.0).then(|| slope * (-1.01 * excess / slope.norm_squared()))
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
            None if crate::parameters::is_base(id) => {
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
        // I_zz may hardly exceed I_xx + I_yy.
        let outside = Point { moments: [0.0, 0.0, 8.0], ..from.clone() };
        assert!(Gyrostat::new(&reference.model_at(&outside).unwrap_or_else(|_| model.clone())).is_ok());
        let reached = reference.towards(&from, outside);
        assert!(reached.moments[2] > 0.0 && reached.moments[2] < 8.0, "{reached:?}");
        assert!(reference.model_at(&reached).is_ok());
    }

    #[test]
    fn moments_that_no_body_has_do_not_stop_a_step() {
        let model = PlatformModel::whorl_1_reference();
        let reference = Reference::new(&model, &ModelPrior::typical(&model));
        let from = reference.point();
        let mut to = Point { moments: [-1.5, -1.5, 1.0], ..from.clone() };
        to.effects.insert("bearing_viscous_friction", vec![0.01]);
        let reached = reference.towards(&from, to.clone());
        assert_eq!(reached.effects, to.effects);
        // Just where the largest principal moment is what is allowed.
        let moved = reference.model_at(&reached).unwrap();
        let eigen = moved.mass_properties.inertia_b_kg_m2().symmetric_eigenvalues();
        let ratio = eigen.max() / (eigen.sum() - eigen.max());
        assert!((1.02..=1.03).contains(&ratio), "{ratio}");
        // Of the diagonal alone, 4.7, 6.0 and 13.1 exceed 1.03 (4.7 + 6.0) by 2.1 kg m^2, to be shared by three.
        let change: f64 = reached.moments.iter().zip(&to.moments).map(|(a, b)| (a - b).powi(2)).sum();
        assert!((2.0..2.6).contains(&(3.06 * change).sqrt()), "{reached:?}");
    }
}
