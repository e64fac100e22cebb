//! A valve that does not seal.

use nalgebra::Vector3;
use whorl_math::GRAVITY_M_S2;

use super::named::{Named as _, parameters, per_jet};
use super::{Aid, Effect, EffectInfo, EffectKind, Grouping, ParameterSpec};
use crate::platform::Jet;
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct ThrusterLeak;

static INFO: EffectInfo = EffectInfo {
    id: "thruster_leak",
    title: "leaking jet",
    explanation: "A valve that never closes fully pushes all the time: a constant torque in the body that falls with the tank's pressure.",
    equation: "F_j += leak_j (p / p_ref) while valve j is shut",
    source: "choked flow through a fixed area is proportional to pressure (Sutton, Rocket Propulsion Elements, eq. 3-24)",
    kind: EffectKind::Actuator,
    confusable_with: &["bearing_turbine", "air_current", "gravity_offset"],
    separated_by: "level rest at full and low pressure; both spin directions",
    is_passive: false,
};

parameters! {
    /// Of one jet.
    Leak(jet: Jet) {
        thrust_n: f64 = ParameterSpec::new(
            "_n",
            "N",
            (0.0, jet.thrust_n),
            0.01 * jet.thrust_n,
            "Thrust of the leak at the reference pressure.",
        ),
    }
}

/// Thrust of the leak of jet `j` now \[N\].
fn leak_n(values: &[f64], environment: &Environment<'_>, j: usize) -> f64 {
    let shut = 1.0 - environment.valve_fraction.get(j).copied().unwrap_or(0.0);
    Leak::nth(values, j).thrust_n * shut * environment.pressure_ratio()
}

impl Effect for ThrusterLeak {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        per_jet::<Leak>(model)
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        let mut torque = Vector3::zeros();
        for (j, jet) in environment.model.jets().iter().enumerate() {
            if Leak::nth(values, j).thrust_n > 0.0 {
                let force = jet.force_direction_b.into_inner() * leak_n(values, environment, j);
                torque += jet.position_b_m.cross(&force);
            }
        }
        torque
    }

    fn gas_rate_kg_s(&self, values: &[f64], environment: &Environment<'_>) -> f64 {
        let jets = environment.model.jets().len();
        let thrust_n: f64 = (0..jets).map(|j| leak_n(values, environment, j)).sum();
        thrust_n / (GRAVITY_M_S2 * environment.model.tank().specific_impulse_s)
    }

    fn grouping(&self) -> Grouping {
        // One jet or two, because all of them together could make any torque.
        Grouping::EachAndPairs
    }

    fn aids(&self) -> &'static [Aid] {
        &[Aid::TankPressure]
    }
}
