//! How a model came to be: what was adopted when, and what it improved.

use whorl_dynamics::effects::find;
use whorl_params::ModelStep;
use whorl_recording::KnownPlatform;

/// How a model came to be.
#[derive(Debug, Clone, PartialEq)]
pub struct History {
    /// Name of the platform.
    pub platform: String,
    /// The changes that commands made, oldest first.
    pub steps: Vec<ModelStep>,
    /// The effects that the model has now, by their ids.
    pub effects: Vec<EffectInModel>,
    /// Where standard deviations of the model are from, with the keys of the parameters: in the order of the files.
    pub sources: Vec<(String, Vec<String>)>,
}

/// An effect of the model.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectInModel {
    /// Its id.
    pub effect: String,
    /// Its parameters.
    pub parameters: Vec<ParameterInModel>,
    /// The steps that adopted it, oldest first; none if it was written by hand.
    pub adopted_in: Vec<u32>,
}

/// A parameter of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterInModel {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: &'static str,
    /// Its value.
    pub value: f64,
    /// Its standard deviation; `None` if the files give none.
    pub stddev: Option<f64>,
}

/// The history of a platform's model, as its files have it.
#[must_use]
pub fn history(known: &KnownPlatform) -> History {
    let effects = known.model.effects.iter().map(|(id, values)| {
        let specs = find(id).map(|effect| effect.parameters(&known.model)).unwrap_or_default();
        let stddevs = known.prior.effects.get(id);
        let parameters = values.iter().map(|(name, value)| ParameterInModel {
            name: name.clone(),
            unit: specs.iter().find(|spec| spec.name == *name).map_or("1", |spec| spec.unit),
            value: *value,
            stddev: stddevs.and_then(|of| of.get(name)).copied(),
        });
        let steps = known.history.iter().filter(|step| step.effects.contains(id));
        EffectInModel {
            effect: id.clone(),
            parameters: parameters.collect(),
            adopted_in: steps.map(|step| step.number).collect(),
        }
    });
    let mut sources: Vec<(String, Vec<String>)> = Vec::new();
    for entry in &known.prior_entries {
        let Some(source) = &entry.source else { continue };
        match sources.iter_mut().find(|(known, _)| known == source) {
            Some((_, keys)) => keys.push(entry.key.clone()),
            None => sources.push((source.clone(), vec![entry.key.clone()])),
        }
    }
    History {
        platform: known.platform.clone(),
        steps: known.history.clone(),
        effects: effects.collect(),
        sources,
    }
}
