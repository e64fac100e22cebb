//! Drag in a gimbal's bearing.

use super::named::{Named as _, parameters, per_gyro};
use super::{Effect, EffectError, EffectInfo, EffectKind, Evidence, ParameterSpec};
use crate::PlatformModel;
use crate::actuators::control_moment_gyros::Gyro;

#[derive(Debug)]
pub(super) struct GimbalFriction;

static INFO: EffectInfo = EffectInfo {
    id: "gimbal_friction",
    title: "gimbal bearing friction",
    explanation: "A gimbal turns slower than it is told, and not at all when it is told to turn slowly: the platform gets less torque than the allocation has planned.",
    equation: "torque on gimbal j = -b_j dgamma/dt - T_j sign(dgamma/dt), stuck at dgamma/dt = 0 while |drive| <= T_j; the body takes the opposite",
    source: "viscous and Coulomb friction, sticking as in Karnopp, Computer simulation of stick-slip friction in mechanical dynamic systems, J. Dynamic Systems, Measurement, and Control 107, 1985",
    kind: EffectKind::Actuator,
    confusable_with: &[],
    separated_by: "",
    is_passive: false,
};

parameters! {
    /// Of one gyro.
    Drag(gyro: Gyro) {
        viscous_n_m_s: f64 = ParameterSpec::new(
            "_viscous_n_m_s",
            "N m s",
            (0.0, 10.0 * gyro.gimbal_inertia_kg_m2 / gyro.time_constant_s),
            0.1 * gyro.gimbal_inertia_kg_m2 / gyro.time_constant_s,
            "Viscous drag added to the model's.",
        ),
        coulomb_n_m: f64 = ParameterSpec::new(
            "_coulomb_n_m",
            "N m",
            (0.0, gyro.gimbal_inertia_kg_m2 * gyro.max_rate_rad_s / gyro.time_constant_s),
            0.05 * gyro.gimbal_inertia_kg_m2 * gyro.max_rate_rad_s / gyro.time_constant_s,
            "Coulomb drag added to the model's.",
        ),
    }
}

impl Effect for GimbalFriction {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        per_gyro::<Drag>(model)
    }

    fn is_correction(&self) -> bool {
        true
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        for (j, gyro) in model.gyros_mut().iter_mut().enumerate() {
            let drag = Drag::nth(values, j);
            gyro.viscous_friction_n_m_s += drag.viscous_n_m_s;
            gyro.coulomb_friction_n_m += drag.coulomb_n_m;
        }
        Ok(())
    }

    /// The body's motion does not show it: the gimbals' does, which is taken as measured.
    fn evidence(&self) -> Evidence {
        &[]
    }
}
