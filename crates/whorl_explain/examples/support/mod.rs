//! Runs for every example: those named as arguments, else a simulated one.

#[path = "../../../whorl_prediction/src/tests/generator.rs"]
#[allow(dead_code, reason = "each example uses a part of it")]
#[allow(clippy::unwrap_used, reason = "simulates a platform that is known to be valid")]
mod generator;

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Context;
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_explain::Case;
use whorl_recording::{Recording, read_model, read_run};

/// Runs with the model that they are explained with.
pub struct Material {
    runs: Vec<Recording>,
    model: PlatformModel,
    prior: ModelPrior,
}

impl Material {
    /// Reads the run directories named as arguments; without any, simulates two minutes of a platform with friction in its
    /// bearing that the model does not include.
    pub fn read() -> anyhow::Result<Self> {
        let paths: Vec<String> = std::env::args().skip(1).collect();
        let Some(first) = paths.first() else { return Ok(Self::simulated()) };
        let known = read_model(Path::new(first), None)?;
        let read = |path: &String| -> anyhow::Result<Recording> {
            let run = read_run(Path::new(path), Some(&known.platform))?;
            run.into_iter().next().with_context(|| format!("{path} holds no measurements"))
        };
        let runs = paths.iter().map(read).collect::<anyhow::Result<_>>()?;
        Ok(Self { runs, model: known.model, prior: known.prior })
    }

    fn simulated() -> Self {
        let model = generator::platform();
        let mut truth = model.clone();
        let friction = BTreeMap::from([("c_n_m_s".to_owned(), 0.3)]);
        truth.effects.insert("bearing_viscous_friction".to_owned(), friction);
        let run = |seed| generator::record(&truth, &generator::Manoeuvre { seed, ..generator::turning() });
        let prior = ModelPrior::typical(&model);
        Self { runs: vec![run(1), run(2)], model, prior }
    }

    /// If there are several runs, the last one is held out.
    pub fn case(&self) -> Case<'_> {
        let fitted = if self.runs.len() > 1 { self.runs.len() - 1 } else { self.runs.len() };
        let (training, held_out) = self.runs.split_at(fitted);
        Case { training, held_out, model: &self.model, prior: &self.prior }
    }
}
