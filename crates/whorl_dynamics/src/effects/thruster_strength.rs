//! Jets stronger or weaker than nominal.

use super::named::{Named as _, parameters, per_jet};
use super::{BasePrior, Effect, EffectError, EffectInfo, EffectKind, Evidence, Grouping, Need, ParameterSpec};
use crate::PlatformModel;
use crate::platform::Jet;

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

parameters! {
    Common(_model: PlatformModel) {
        all: f64 = ParameterSpec::new("all", "1", (-0.9, 1.0), 0.05, "Relative error of every jet."),
    }
}

parameters! {
    /// Of one jet.
    Own(_jet: Jet) {
        error: f64 = ParameterSpec::new("", "1", (-1.0, 1.0), 0.05, "Relative error of this jet.")
            .base(BasePrior::JetThrust),
    }
}

impl Effect for ThrusterStrength {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        let mut specs = Common::specs(model);
        specs.extend(per_jet::<Own>(model));
        specs
    }

    fn is_correction(&self) -> bool {
        true
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        let all = 1.0 + Common::of(values).all;
        let of_jets = Common::rest(values);
        for (j, jet) in model.jets_mut().iter_mut().enumerate() {
            jet.thrust_n *= all * (1.0 + Own::nth(of_jets, j).error);
        }
        Ok(())
    }

    fn is_base(&self) -> bool {
        true
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::Jets]]
    }

    fn grouping(&self) -> Grouping {
        // All jets alike, besides what each does within its own prior.
        Grouping::CommonEachParts
    }
}
