//! Sizes of effects relative to the rig.
//!
//! Effects state their usual sizes for the dissertation's platform. On another rig a usual friction, draught or imbalance is
//! in proportion to what it acts on: torques on the body to its inertia (the same accelerations), places in it to its
//! radius of gyration. So one catalogue serves from grams on a string to a satellite. Effects on wheels and jets state their sizes relative to these.

use super::ParameterSpec;
use crate::PlatformModel;
use crate::actuators::control_moment_gyros::Gyro;
use crate::platform::{Jet, Wheel};

/// Mean moment of inertia of the platform for which sizes are stated [kg m^2].
const INERTIA_KG_M2: f64 = 8.6;

/// Its mass \[kg\].
const MASS_KG: f64 = 110.0;

/// What parameters belong to, and how large it is.
pub(super) trait RigSize {
    /// Usual size here over that on the dissertation's platform, of a parameter of this unit. Effects on a part state their
    /// sizes relative to it.
    fn factor(&self, _unit: &str) -> f64 {
        1.0
    }
}

impl RigSize for PlatformModel {
    fn factor(&self, unit: &str) -> f64 {
        let ratio = self.mass_properties.inertia_b_kg_m2().trace() / 3.0 / INERTIA_KG_M2;
        let mass_ratio = self.mass_properties.mass_kg() / MASS_KG;
        match unit {
            "m" => (ratio / mass_ratio).sqrt(),
            "sqrt(kg) m" => ratio.sqrt(),
            "A m^2" | "kg m^2" => ratio,
            _ if unit.starts_with("N m") => ratio,
            _ => 1.0,
        }
    }
}

impl RigSize for Wheel {}

impl RigSize for Jet {}

impl RigSize for Gyro {}

/// A parameter with its usual size on a rig; its range grows with it, and never shrinks.
pub(super) fn for_size_of(part: &impl RigSize, spec: ParameterSpec) -> ParameterSpec {
    let factor = part.factor(spec.unit);
    if spec.known || !factor.is_finite() || factor <= 0.0 {
        return spec;
    }
    let wider = factor.max(1.0);
    // How well the platform's own parameters are known says its file.
    let prior_factor = if spec.base.is_some() { 1.0 } else { factor };
    ParameterSpec {
        neutral: spec.neutral * prior_factor,
        prior_stddev: spec.prior_stddev * prior_factor,
        min: spec.min * wider,
        max: spec.max * wider,
        ..spec
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MassProperties;
    use crate::effects::find;

    #[test]
    fn usual_sizes_follow_the_rig() {
        let mut model = PlatformModel::whorl_1_reference();
        let size = |model: &PlatformModel, id: &str| {
            let spec = find(id).unwrap().parameters(model).into_iter().next().unwrap();
            (spec.prior_stddev, spec.max)
        };
        let (stddev, max) = size(&model, "bearing_viscous_friction");
        assert!((stddev - 0.01).abs() < 1e-3 * stddev && max == 5.0);
        let own = model.mass_properties;
        let scaled = |factor: f64| {
            MassProperties::new(own.inertia_b_kg_m2() * factor, *own.gravity_offset_b_n_m(), 110.0).unwrap()
        };
        model.mass_properties = scaled(1e-4);
        let small = size(&model, "bearing_viscous_friction");
        assert!((small.0 / stddev - 1e-4).abs() < 1e-9 && small.1 == max);
        model.mass_properties = scaled(100.0);
        let large = size(&model, "bearing_viscous_friction");
        assert!((large.0 / stddev - 100.0).abs() < 1e-9 && large.1 > 90.0 * max);
        // Nor may a correction of the platform's own parameters end where that of a small platform would.
        assert!(size(&model, "inertia_products").1 > 90.0 * 20.0);
        // Places in it follow its radius of gyration: a hundredth of the inertia at the same mass is a tenth of the size.
        model.mass_properties = scaled(0.01);
        let heights = find("slosh").unwrap().parameters(&model);
        let height = heights.iter().find(|spec| spec.name == "height_m").unwrap();
        assert!((height.neutral - 0.02).abs() < 1e-4 && (height.prior_stddev - 0.01).abs() < 1e-4);
        // A sensor does not care.
        assert_eq!(size(&model, "gyro_scale"), size(&PlatformModel::whorl_1_reference(), "gyro_scale"));
    }
}
