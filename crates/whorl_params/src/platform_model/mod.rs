//! The shared groups `model` and `truth`: what a platform is made of.

mod actuators;
mod effects;
mod mass_properties;
mod sensors;

use whorl_dynamics::platform::TiltLimit;
use whorl_dynamics::{Gyrostat, PlatformModel};

use crate::limits::{non_negative, range};
use crate::reader::{Absent, Reader, Request};
use crate::value::{Kind, Value};

/// Priors of model parameters for later fits: `model_prior.<parameter key>: standard deviation`.
const PRIOR_GROUP: &str = "model_prior";

/// Reads a platform model, usually of the group `model`. `None` when anything in it is wrong; the
/// reader then holds the errors.
pub fn platform_model(r: &mut Reader<'_>, group: &str) -> Option<PlatformModel> {
    r.claim_group(group);
    r.claim_group(PRIOR_GROUP);
    priors(r);
    r.group(group, model)
}

/// Reads the platform of a simulation: the group `model`, where every key may be overridden in the
/// group `truth` (`truth.inertia_kg_m2.zz`, `truth.jets.jet_3.thrust_n`), and effects may be added
/// there. Estimator and control must not call this.
pub fn truth_model(r: &mut Reader<'_>) -> Option<PlatformModel> {
    r.claim_group("model");
    r.claim_group("truth");
    r.claim_group(PRIOR_GROUP);
    priors(r);
    r.overlay("model", "truth", |r| r.group("model", model))
}

fn model(r: &mut Reader<'_>) -> Option<PlatformModel> {
    let errors_before = r.error_count();
    let mass_properties = mass_properties::read(r);
    let wheels = actuators::wheels(r);
    let jets = actuators::jets(r);
    let tank = actuators::tank(r);
    let bus = actuators::bus(r);
    let tilt_limit = tilt_limit(r);
    let sensors = sensors::read(r);
    let mut model = PlatformModel {
        mass_properties: mass_properties?,
        wheels,
        jets,
        tank,
        bus,
        tilt_limit,
        sensors,
        effects: std::collections::BTreeMap::new(),
    };
    // Parameters of effects depend on the platform's wheels and jets.
    model.effects = effects::read(r, &model);
    if r.error_count() == errors_before
        && let Err(error) = Gyrostat::new(&model)
    {
        let part = if model.effects.is_empty() { "inertia_kg_m2" } else { "effects" };
        r.reject(part, format!("no such platform: {error}"));
    }
    (r.error_count() == errors_before).then_some(model)
}

fn tilt_limit(r: &mut Reader<'_>) -> TiltLimit {
    r.group("tilt_limit", |r| {
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
    })
}

/// Accepts every key below the group; later fits use them.
fn priors(r: &mut Reader<'_>) {
    let prefix = format!("{PRIOR_GROUP}.");
    let keys: Vec<String> = r
        .parameters()
        .iter()
        .filter_map(|entry| entry.key.strip_prefix(&prefix))
        .map(str::to_owned)
        .collect();
    r.group(PRIOR_GROUP, |r| {
        for key in keys {
            let limits = non_negative();
            let request = Request {
                key: &key,
                kind: Kind::Double,
                allowed: "a number of at least 0".into(),
                range: None,
                choices: Vec::new(),
                doc: "standard deviation of the model parameter's prior, in that parameter's unit",
            };
            r.request(request, Absent::Leave, |value| match value {
                Value::Double(x) => limits.allows(*x).then_some(()),
                _ => None,
            });
        }
    });
}
