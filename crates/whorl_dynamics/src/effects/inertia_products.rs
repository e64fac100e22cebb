//! Products of inertia other than the model's.

use nalgebra::Matrix3;

use super::named::{Named as _, parameters};
use super::{BasePrior, Effect, EffectError, EffectInfo, EffectKind, ParameterSpec};
use crate::{MassProperties, PlatformModel};

#[derive(Debug)]
pub(super) struct InertiaProducts;

static INFO: EffectInfo = EffectInfo {
    id: "inertia_products",
    title: "off-diagonal inertia",
    explanation: "A torque about one body axis also accelerates the others; every base model has products of inertia, the parameters are corrections of the model's matrix elements.",
    equation: "I <- I + [0 I_xy I_xz; I_xy 0 I_yz; I_xz I_yz 0]",
    source: "Schwartz 2004, eqs. 4.8 and 4.73 (dynamic unbalance of Table 3.1)",
    kind: EffectKind::Torque,
    confusable_with: &["thruster_misalignment", "wheel_misalignment"],
    separated_by: "torque from wheels and from jets about the same axis, and coasting spin about it",
    is_passive: false,
};

/// Each parameter's name, row and column.
const ELEMENTS: [(&str, usize, usize); 3] = [("ixy_kg_m2", 0, 1), ("ixz_kg_m2", 0, 2), ("iyz_kg_m2", 1, 2)];

parameters! {
    Products(_model: PlatformModel) {
        elements_kg_m2: [f64; 3] = ELEMENTS.map(|(name, row, column)| {
            ParameterSpec::new(
                name,
                "kg m^2",
                (-20.0, 20.0),
                0.3,
                "Matrix element (sign in the matrix) added to the model's.",
            )
            .base(BasePrior::Inertia(row, column))
        }),
    }
}

impl Effect for InertiaProducts {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Products::specs(model)
    }

    fn is_correction(&self) -> bool {
        true
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        let properties = &model.mass_properties;
        let inertia = properties.inertia_b_kg_m2() + self.added_inertia_b_kg_m2(values);
        model.mass_properties =
            MassProperties::new(inertia, *properties.gravity_offset_b_n_m(), properties.mass_kg())
                .map_err(|error| EffectError::NotPhysical { effect: INFO.id, reason: error.to_string() })?;
        Ok(())
    }

    fn is_base(&self) -> bool {
        true
    }

    fn added_inertia_b_kg_m2(&self, values: &[f64]) -> Matrix3<f64> {
        let [xy, xz, yz] = Products::of(values).elements_kg_m2;
        Matrix3::new(0.0, xy, xz, xy, 0.0, yz, xz, yz, 0.0)
    }
}
