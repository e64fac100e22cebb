//! Jets stronger or weaker than nominal.

use super::parameter::value;
use super::{Effect, EffectError, EffectInfo, EffectKind, ParameterSpec};
use crate::PlatformModel;

#[derive(Debug)]
pub(super) struct ThrusterStrength;

static INFO: EffectInfo = EffectInfo {
    id: "thruster_strength",
    title: "jet thrust other than nominal",
    explanation: "A jet, or all of them, gives more or less than its nominal thrust: a pulse-shaped residual in the jet's own direction.",
    equation: "F_j = F_nominal_j (1 + all) (1 + e_j)",
    source: "nozzle and regulator tolerance; definition",
    kind: EffectKind::Actuator,
    confusable_with: &["inertia_products", "thruster_delay", "thruster_rise", "thruster_pressure"],
    separated_by: "one jet alone, two pulse lengths",
    is_passive: false,
};

impl Effect for ThrusterStrength {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        let mut specs =
            vec![ParameterSpec::new("all", "1", (-0.9, 1.0), 0.05, "Relative error of every jet.")];
        specs.extend(model.jets().iter().enumerate().map(|(j, jet)| {
            ParameterSpec::new(jet.name.as_str(), "1", (-1.0, 1.0), 0.05, "Relative error of this jet.").of_jet(j)
        }));
        specs
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        let all = 1.0 + value(values, 0);
        for (j, jet) in model.jets_mut().iter_mut().enumerate() {
            jet.thrust_n *= all * (1.0 + value(values, 1 + j));
        }
        Ok(())
    }
}
