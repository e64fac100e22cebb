//! A wheel whose mass is not balanced about its axis.

use nalgebra::Vector3;
use whorl_math::unit_or;

use super::named::{Named as _, parameters, per_wheel};
use super::{Aid, Effect, EffectInfo, EffectKind, Evidence, ParameterSpec, Signature};
use crate::platform::Wheel;
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct WheelImbalance;

static INFO: EffectInfo = EffectInfo {
    id: "wheel_imbalance",
    title: "unbalanced wheel",
    explanation: "A wheel's unbalanced mass shakes the platform once per turn with a torque that grows with the square of its speed.",
    equation: "g = U_j Om_j^2 (cos(phi_j) e1 + sin(phi_j) e2), d(phi_j)/dt = Om_j, e1 and e2 across the axis",
    source: "Masterson, Miller and Grogan, Development and validation of reaction wheel disturbance models, J. Sound and Vibration 249(3), 2002 (fundamental harmonic)",
    kind: EffectKind::Actuator,
    confusable_with: &["vibration_alias", "flexible_mode"],
    separated_by: "wheel sweep: the line follows the wheel's speed",
    is_passive: false,
};

parameters! {
    /// Of one wheel.
    Imbalance(_wheel: Wheel) {
        size_kg_m2: f64 = ParameterSpec::new(
            "_kg_m2",
            "kg m^2",
            (0.0, 1e-3),
            1e-6,
            "Imbalance about axes across the spin axis, static imbalance times its arm included.",
        ),
    }
}

impl Effect for WheelImbalance {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        per_wheel::<Imbalance>(model)
    }

    fn hidden_states(&self, model: &PlatformModel) -> usize {
        // The angle of each wheel.
        model.wheels().len()
    }

    fn hidden_derivative(
        &self,
        _values: &[f64],
        environment: &Environment<'_>,
        _hidden: &[f64],
        derivative: &mut [f64],
    ) {
        for (j, rate) in derivative.iter_mut().enumerate() {
            *rate = environment.wheel_speed(j);
        }
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, hidden: &[f64]) -> Vector3<f64> {
        let mut torque = Vector3::zeros();
        for (j, wheel) in environment.model.wheels().iter().enumerate() {
            let axis = wheel.spin_axis_b;
            let helper = if axis.z.abs() > 0.7 { Vector3::x() } else { Vector3::z() };
            let e1 = unit_or(axis.cross(&helper), Vector3::x_axis()).into_inner();
            let (sine, cosine) = hidden.get(j).copied().unwrap_or(0.0).sin_cos();
            let size = Imbalance::nth(values, j).size_kg_m2 * environment.wheel_speed(j).powi(2);
            torque += size * (e1 * cosine + axis.cross(&e1) * sine);
        }
        torque
    }

    fn evidence(&self) -> Evidence {
        // The samples themselves show it, where the phase of each run is free.
        &[]
    }

    fn signature(&self) -> Option<Signature> {
        Some(Signature::WheelTurn)
    }

    fn aids(&self) -> &'static [Aid] {
        &[Aid::WheelSpeed]
    }
}
