//! Centre of mass away from the centre of rotation.

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::parameter::per_axis;
use super::{Aid, BasePrior, Effect, EffectError, EffectInfo, EffectKind, ParameterSpec};
use crate::{MassProperties, PlatformModel};

#[derive(Debug)]
pub(super) struct GravityOffset;

static INFO: EffectInfo = EffectInfo {
    id: "gravity_offset",
    title: "centre of mass away from the centre of rotation",
    explanation: "Weight acts off the bearing's centre, so the platform swings like a pendulum; every base model has it, the parameters are corrections of the model's m g r_cg.",
    equation: "g = -(m g r_cg) x k_b",
    source: "Schwartz 2004, eq. 4.74 and Table 4.1 (static unbalance of Table 3.1)",
    kind: EffectKind::Torque,
    confusable_with: &["anisoelastic_sag", "magnetic_torque"],
    separated_by: "tilt to several azimuths and amplitudes",
    is_passive: false,
};

parameters! {
    Offset(_model: PlatformModel) {
        mgr_b_n_m: Vector3<f64> = {
            let doc = "Weight times offset of the centre of mass, added to the model's.";
            let [x, y, z] = per_axis("mgr", "_n_m", "N m", 20.0, 0.1, doc);
            [x.base(BasePrior::GravityOffset(0)), y.base(BasePrior::GravityOffset(1)), z.base(BasePrior::GravityOffset(2))]
        },
    }
}

impl Effect for GravityOffset {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Offset::specs(model)
    }

    fn is_correction(&self) -> bool {
        true
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        let properties = &model.mass_properties;
        let offset: Vector3<f64> = properties.gravity_offset_b_n_m() + Offset::of(values).mgr_b_n_m;
        model.mass_properties = MassProperties::new(*properties.inertia_b_kg_m2(), offset, properties.mass_kg())
            .map_err(|error| EffectError::NotPhysical { effect: INFO.id, reason: error.to_string() })?;
        Ok(())
    }

    fn is_base(&self) -> bool {
        true
    }

    fn aids(&self) -> &'static [Aid] {
        &[Aid::Tilt]
    }
}
