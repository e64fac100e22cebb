//! An unmodelled torque.

use nalgebra::Vector3;

use super::named::{Named as _, Value as _, parameters};
use super::{Effect, EffectInfo, EffectKind, Evidence, ParameterSpec};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct UnmodelledTorque;

static INFO: EffectInfo = EffectInfo {
    id: "unmodelled_torque",
    title: "unmodelled torque",
    explanation: "A torque that wanders at random: the stand-in of estimator and diagnosis for what is not modelled yet, not an effect of its own. Stated in a model, it is simulated, the estimator expects it, and predictions leave it out: its mean is zero.",
    equation: "dg = -g decay dt + intensity dW, per body axis",
    source: "random-walk state of Kristensen, Madsen and Jorgensen, Comp. Chem. Eng. 28 (2004) 1431",
    kind: EffectKind::HiddenState,
    confusable_with: &[],
    separated_by: "",
    is_passive: false,
};

parameters! {
    Walk(_model: PlatformModel) {
        intensity_b_n_m_sqrt_s: [f64; 3] = ["x", "y", "z"].map(|axis| {
            ParameterSpec::new(
                format!("intensity_{axis}_n_m_sqrt_s"),
                "N m/sqrt(s)",
                (0.0, 1.0),
                1e-3,
                "Standard deviation after one second.",
            )
        }),
        decay_1_s: f64 = ParameterSpec::new(
            "decay_1_s",
            "1/s",
            (0.0, 100.0),
            0.1,
            "Inverse of its correlation time; 0: a random walk.",
        )
        .known(),
    }
}

impl Effect for UnmodelledTorque {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Walk::specs(model)
    }

    fn hidden_states(&self, _model: &PlatformModel) -> usize {
        3
    }

    fn hidden_derivative(
        &self,
        values: &[f64],
        _environment: &Environment<'_>,
        hidden: &[f64],
        derivative: &mut [f64],
    ) {
        let decay_1_s = Walk::of(values).decay_1_s;
        for (rate, torque) in derivative.iter_mut().zip(hidden) {
            *rate = -decay_1_s * torque;
        }
    }

    fn torque_walk_b_n_m_sqrt_s(&self, values: &[f64]) -> Vector3<f64> {
        Walk::of(values).intensity_b_n_m_sqrt_s.into()
    }

    fn hidden_noise(&self, values: &[f64], intensity: &mut [f64]) {
        for (slot, own) in intensity.iter_mut().zip(Walk::of(values).intensity_b_n_m_sqrt_s) {
            *slot = own;
        }
    }

    fn torque_b_n_m(&self, _values: &[f64], _environment: &Environment<'_>, hidden: &[f64]) -> Vector3<f64> {
        // The torque itself.
        Vector3::read(hidden)
    }

    fn evidence(&self) -> Evidence {
        // Not an effect of its own.
        &[]
    }
}
