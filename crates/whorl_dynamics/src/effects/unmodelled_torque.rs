//! A torque without a name.

use nalgebra::Vector3;

use super::parameter::{value, vector};
use super::{Effect, EffectInfo, EffectKind, ParameterSpec};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct UnmodelledTorque;

static INFO: EffectInfo = EffectInfo {
    id: "unmodelled_torque",
    title: "torque without a name",
    explanation: "A torque that wanders at random: the stand-in of estimator and diagnosis for what has no name yet, not an effect of its own.",
    equation: "dg = intensity dW, per body axis",
    source: "random-walk state of Kristensen, Madsen and Jorgensen, Comp. Chem. Eng. 28 (2004) 1431",
    kind: EffectKind::HiddenState,
    confusable_with: &[],
    separated_by: "",
    is_passive: false,
};

impl Effect for UnmodelledTorque {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, _model: &PlatformModel) -> Vec<ParameterSpec> {
        ["intensity_x_n_m_sqrt_s", "intensity_y_n_m_sqrt_s", "intensity_z_n_m_sqrt_s"]
            .map(|name| {
                ParameterSpec::new(name, "N m/sqrt(s)", (0.0, 1.0), 1e-3, "Standard deviation after one second.")
            })
            .into()
    }

    fn hidden_states(&self, _model: &PlatformModel) -> usize {
        3
    }

    fn hidden_noise(&self, values: &[f64], intensity: &mut [f64]) {
        for (i, slot) in intensity.iter_mut().enumerate() {
            *slot = value(values, i);
        }
    }

    fn torque_b_n_m(&self, _values: &[f64], _environment: &Environment<'_>, hidden: &[f64]) -> Vector3<f64> {
        vector(hidden, 0)
    }
}
