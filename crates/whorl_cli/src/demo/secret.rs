//! The secret: an effect that the model does not have, drawn for the simulated hardware.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, bail};
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::{Rng, SeedableRng};
use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::find;
use whorl_params::{ParameterTree, Reader, any, load_effects_beside, read};

/// An effect with the range of each parameter.
type Candidate = (String, Vec<(String, [f64; 2])>);

/// What may be hidden: `params/demo/hidden_effect.yaml`.
#[derive(Debug)]
struct Choice {
    /// Effects among which one is drawn.
    drawn: Vec<String>,
    /// All effects.
    effects: Vec<Candidate>,
}

impl Choice {
    fn load(file: &Path) -> anyhow::Result<Self> {
        let (choice, _) = read(&ParameterTree::load_for(file, "demo")?, |r| Self {
            drawn: r.string_array("drawn", "effects among which one is drawn"),
            effects: r.group("effects", |r| {
                r.children("").into_iter().map(|id| (id.clone(), r.group(&id, ranges))).collect()
            }),
        })?;
        // Those that no catalogue has stand beside the file.
        load_effects_beside(&[file.to_owned()])?;
        if let Some(unknown) = choice.effects.iter().map(|(id, _)| id).find(|id| find(id).is_none()) {
            bail!("{}: {}", file.display(), crate::effects::unknown(unknown));
        }
        Ok(choice)
    }
}

fn ranges(r: &mut Reader<'_>) -> Vec<(String, [f64; 2])> {
    let mut ranges = Vec::new();
    for name in r.children("") {
        let range = r.f64_array(&name, any(), "smallest and largest size");
        match <[f64; 2]>::try_from(range.as_slice()) {
            Ok(range) if range[0] <= range[1] => ranges.push((name, range)),
            _ => r.reject(&name, "allowed: the smallest size, then the largest"),
        }
    }
    ranges
}

/// What the simulated hardware is like.
#[derive(Debug, PartialEq)]
pub struct Secret {
    /// Id of the hidden effect.
    pub effect: String,
    /// Its parameters in the notation of a parameter file.
    pub parameters: String,
    /// Its equation.
    pub equation: &'static str,
    /// The whole parameter file of the truth.
    pub truth: String,
}

impl Secret {
    /// Draws the effect, unless it is `named`, its size, and errors of the model: 2 % of inertia, 5 % of the gravity offset.
    pub fn draw(
        file: &Path,
        named: Option<&str>,
        platform: &str,
        model: &PlatformModel,
        seed: u64,
    ) -> anyhow::Result<Self> {
        let choice = Choice::load(file)?;
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        // 53 bits, as many as a double has.
        let mut draw = |low: f64, high: f64| {
            low + (high - low) * ((random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64)
        };
        let id = match named {
            Some(id) => id.to_owned(),
            None => {
                let at = draw(0.0, choice.drawn.len() as f64) as usize;
                choice
                    .drawn
                    .get(at)
                    .cloned()
                    .with_context(|| format!("{}: drawn is empty", file.display()))?
            }
        };
        let Some((_, ranges)) = choice.effects.iter().find(|(known, _)| *known == id) else {
            let known: Vec<&str> = choice.effects.iter().map(|(id, _)| id.as_str()).collect();
            bail!("no size for the effect {id} in {}; there are: {}", file.display(), known.join(", "));
        };
        let specs = find(&id).map(|effect| effect.parameters(model)).unwrap_or_default();
        let mut values = Vec::new();
        for (name, [low, high]) in ranges {
            let Some(spec) = specs.iter().find(|spec| spec.name == *name) else {
                bail!("{}: {id} has no parameter {name}", file.display());
            };
            let size = draw(*low, *high);
            let sign = if spec.min < 0.0 && draw(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
            values.push(format!("{name}: {:.4}", sign * size));
        }
        let parameters = format!("{{{}}}", values.join(", "));

        let inertia = model.mass_properties.inertia_b_kg_m2().diagonal().map(|x| x * draw(0.98, 1.02));
        let offset = model.mass_properties.gravity_offset_b_n_m().map(|x| x * draw(0.95, 1.05));
        let mut truth = String::from("# Drawn by `whorl demo`: what the model does not know.\n");
        // Writing to a String cannot fail.
        let _ = write!(
            truth,
            "/{platform}/driver:\n  ros__parameters:\n    truth:\n      \
             inertia_kg_m2: {{xx: {:.4}, yy: {:.4}, zz: {:.4}}}\n      \
             gravity_offset_n_m: [{:.5}, {:.5}, {:.4}]\n      effects:\n        {id}: {parameters}\n",
            inertia.x, inertia.y, inertia.z, offset.x, offset.y, offset.z
        );
        let equation = find(&id).map_or("", |effect| effect.info().equation);
        Ok(Self { effect: id, parameters, equation, truth })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn secrets_are_in_their_ranges_and_load_as_the_truth_of_the_platform() {
        let params = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params");
        let known = whorl_recording::read_model(&params.join("whorl_1.yaml"), None).unwrap();
        let file = params.join("demo/hidden_effect.yaml");
        let choice = Choice::load(&file).unwrap();
        let draw =
            |named: Option<&str>, seed| Secret::draw(&file, named, "whorl_1", &known.model, seed).unwrap();
        assert_eq!(draw(None, 3), draw(None, 3));
        for (id, ranges) in &choice.effects {
            for seed in 0..20 {
                let secret = draw(Some(id), seed);
                let common = std::fs::read_to_string(params.join("common.yaml")).unwrap();
                let own = std::fs::read_to_string(params.join("whorl_1.yaml")).unwrap();
                let texts = [("common.yaml", common.as_str()), ("own.yaml", &own), ("truth", &secret.truth)];
                let tree = ParameterTree::from_texts(&texts, &[]).unwrap();
                let truth =
                    whorl_params::read_shared(&tree.for_node("/whorl_1/driver"), whorl_params::truth_model)
                        .unwrap()
                        .unwrap();
                for (name, [low, high]) in ranges {
                    let size = truth.effects[id][name].abs();
                    assert!((*low..=*high).contains(&size), "{id} {name} {size}");
                }
            }
        }
        let drawn: std::collections::BTreeSet<String> = (0..50).map(|seed| draw(None, seed).effect).collect();
        assert_eq!(drawn.into_iter().collect::<Vec<_>>(), choice.drawn);
        let unknown = Secret::draw(&file, Some("no_such"), "whorl_1", &known.model, 1).unwrap_err();
        assert!(unknown.to_string().contains("no_such") && unknown.to_string().contains(&choice.drawn[0]));
    }
}
