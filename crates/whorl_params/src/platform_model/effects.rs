//! Physical effects beyond the base model, checked against the catalogue.

use std::collections::BTreeMap;

use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::catalogue;
use whorl_math::words::did_you_mean;

use crate::effect_file::{EFFECTS_FOLDER, find_or_load};
use crate::limits::range;
use crate::reader::Reader;

/// Effect id -> parameter -> value. Parameters that are left out stay out and keep the neutral
/// value of the catalogue.
pub(super) fn read(r: &mut Reader<'_>, model: &PlatformModel) -> BTreeMap<String, BTreeMap<String, f64>> {
    let mut effects = BTreeMap::new();
    r.whole_group("effects", |r, of_truth| {
        for id in r.children("") {
            let files = r.parameters().files().iter().map(|file| &**file);
            let found = find_or_load(&id, files, of_truth);
            if let Some(Err(errors)) = &found {
                r.reject_group(&id, format!("its file is wrong: {errors}"));
                continue;
            }
            let Some(Ok(effect)) = found else {
                let ids = || catalogue().iter().map(|effect| effect.info().id);
                let hint = did_you_mean(&id, ids()).unwrap_or_else(|| {
                    format!("the catalogue has: {}", ids().collect::<Vec<_>>().join(", "))
                });
                r.reject_group(
                    &id,
                    format!(
                        "unknown effect, and there is no {EFFECTS_FOLDER}/{id}.yaml beside the file; {hint}"
                    ),
                );
                continue;
            };
            let mut values = BTreeMap::new();
            r.group(&id, |r| {
                for spec in effect.parameters(model) {
                    let doc = format!("{}: {} [{}]", effect.info().title, spec.doc, spec.unit);
                    if let Some(value) = r.optional_f64(&spec.name, range(spec.min..=spec.max), &doc) {
                        values.insert(spec.name.clone(), value);
                    }
                }
            });
            effects.insert(id, values);
        }
    });
    effects
}
