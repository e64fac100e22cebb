//! Products of inertia other than the model's.

use nalgebra::Matrix3;

use super::parameter::value;
use super::{Effect, EffectError, EffectInfo, EffectKind, ParameterSpec};
use crate::{MassProperties, PlatformModel};

#[derive(Debug)]
pub(super) struct InertiaProducts;

static INFO: EffectInfo = EffectInfo {
    id: "inertia_products",
    title: "off-diagonal inertia",
    explanation: "A torque about one body axis also accelerates the others; every base model has products of inertia, the parameters are what is to be added to the model's matrix elements.",
    equation: "I <- I + [0 I_xy I_xz; I_xy 0 I_yz; I_xz I_yz 0]",
    source: "Schwartz 2004, eqs. 4.8 and 4.73 (dynamic unbalance of Table 3.1)",
    kind: EffectKind::Torque,
    confusable_with: &["thruster_misalignment", "wheel_misalignment"],
    separated_by: "torque from wheels and from jets about the same axis, and coasting spin about it",
    is_passive: false,
};

impl Effect for InertiaProducts {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, _model: &PlatformModel) -> Vec<ParameterSpec> {
        ["ixy_kg_m2", "ixz_kg_m2", "iyz_kg_m2"]
            .map(|name| {
                ParameterSpec::new(
                    name,
                    "kg m^2",
                    (-20.0, 20.0),
                    0.3,
                    "Matrix element (sign in the matrix) added to the model's.",
                )
            })
            .into()
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        let [xy, xz, yz] = [value(values, 0), value(values, 1), value(values, 2)];
        let properties = &model.mass_properties;
        let inertia = properties.inertia_b_kg_m2() + Matrix3::new(0.0, xy, xz, xy, 0.0, yz, xz, yz, 0.0);
        model.mass_properties =
            MassProperties::new(inertia, *properties.gravity_offset_b_n_m(), properties.mass_kg())
                .map_err(|error| EffectError::NotPhysical { effect: INFO.id, reason: error.to_string() })?;
        Ok(())
    }
}
