//! The shared groups `model` and `truth`: the description of a platform.

mod actuators;
mod effects;
mod freedom;
mod history;
mod mass_properties;
mod priors;
mod sensors;

use whorl_dynamics::platform::TiltLimit;
use whorl_dynamics::{Freedom, Gyrostat, PlatformModel};

use crate::limits::range;
use crate::reader::Reader;
use crate::shared_groups::{MODEL_GROUP, PRIOR_GROUP};
pub use history::{ModelStep, model_history};
pub use priors::{PlatformPrior, PriorEntry};

/// Reads a platform model, usually of the group `model`. `None` when anything in it is wrong; the
/// reader then holds the errors.
pub fn platform_model(r: &mut Reader<'_>, group: &str) -> Option<PlatformModel> {
    if group == MODEL_GROUP {
        return platform_model_with_prior(r).map(|(model, _)| model);
    }
    r.claim_group(group);
    r.group(group, model)
}

/// Reads the platform model of the group `model`, and from the group `model_prior` how well it is known.
/// Every key of the latter must be that of a model parameter.
pub fn platform_model_with_prior(r: &mut Reader<'_>) -> Option<(PlatformModel, PlatformPrior)> {
    r.claim_group(MODEL_GROUP);
    r.claim_group(PRIOR_GROUP);
    let model = r.group(MODEL_GROUP, model);
    let entries = priors::read(r, model.is_some());
    let model = model?;
    let prior = priors::prior(&model, &entries);
    Some((model, PlatformPrior { prior, entries }))
}

/// Reads the platform of a simulation: the group `model`, where every key may be overridden in the
/// group `truth` (`truth.inertia_kg_m2.zz`, `truth.jets.jet_3.thrust_n`). Where effects are listed there, the platform has
/// these and no others, each with the parameters that stand there and no others: hardware does not change because its model
/// adopts something. What stands in `model` alone is checked by [`platform_model`]. Estimator and control must not call this.
pub fn truth_model(r: &mut Reader<'_>) -> Option<PlatformModel> {
    r.claim_group("truth");
    r.overlay(MODEL_GROUP, "truth", |r| r.group(MODEL_GROUP, model))
}

fn model(r: &mut Reader<'_>) -> Option<PlatformModel> {
    let errors_before = r.error_count();
    let freedom = freedom::read(r);
    // A bench that holds the body needs neither mass nor inertia.
    let is_held = freedom == Freedom::Clamped && !r.has("mass_kg") && !r.has("inertia_kg_m2");
    let mass_properties = if is_held { None } else { mass_properties::read(r, &freedom) };
    let actuators = actuators::read(r);
    let mass_properties = if is_held { mass_properties::held(r, &actuators) } else { mass_properties };
    let bus = actuators::bus(r);
    let tilt_limit = tilt_limit(r, &freedom);
    let sensors = sensors::read(r, &freedom);
    let mut model = PlatformModel {
        mass_properties: mass_properties?,
        freedom,
        actuators,
        bus,
        tilt_limit,
        sensors,
        effects: std::collections::BTreeMap::new(),
    };
    // Parameters of effects depend on the platform's actuators.
    model.effects = effects::read(r, &model);
    if r.error_count() == errors_before
        && let Err(error) = Gyrostat::new(&model)
    {
        let part = if model.effects.is_empty() { "inertia_kg_m2" } else { "effects" };
        r.reject(part, format!("no such platform: {error}"));
    }
    (r.error_count() == errors_before).then_some(model)
}

/// Only a bearing must say where it stops. What a spacecraft or a bench says of a stop is read and has no meaning.
fn tilt_limit(r: &mut Reader<'_>, freedom: &Freedom) -> TiltLimit {
    if *freedom != Freedom::OnBearing && !r.has("tilt_limit") {
        return TiltLimit::NONE;
    }
    let limit = r.group("tilt_limit", |r| {
        let kind = r.choice(
            "kind",
            &["cone", "pitch"],
            "cone: angle between body z and the vertical; pitch: elevation of body x",
        );
        let (largest, words) = if kind == "pitch" {
            (std::f64::consts::FRAC_PI_2, "pi/2")
        } else {
            (std::f64::consts::PI, "pi")
        };
        let inside = (std::ops::Bound::Excluded(0.0), std::ops::Bound::Excluded(largest));
        let max_rad =
            r.f64("max_rad", range(inside), &format!("where the bearing stops [rad], below {words}"));
        if kind == "pitch" { TiltLimit::Pitch { max_rad } } else { TiltLimit::Cone { max_rad } }
    });
    if matches!(freedom, Freedom::Free | Freedom::Clamped) { TiltLimit::NONE } else { limit }
}
