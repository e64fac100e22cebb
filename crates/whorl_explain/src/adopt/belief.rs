//! Fits that no platform of this model can have.

use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_math::three_digits;

/// Standard deviations of its prior beyond which no mass property is.
const BEYOND_BELIEF: f64 = 12.0;

/// The mass property that a fit has moved beyond belief, in a sentence.
pub fn strangest(model: &PlatformModel, prior: &ModelPrior, fitted: &PlatformModel) -> Option<String> {
    let inertia = |model: &PlatformModel, i, j| model.mass_properties.inertia_b_kg_m2()[(i, j)];
    let offset = |model: &PlatformModel, i: usize| model.mass_properties.gravity_offset_b_n_m()[i];
    let mut parts = Vec::new();
    for (name, i, j) in [("xx", 0, 0), ("yy", 1, 1), ("zz", 2, 2), ("xy", 0, 1), ("xz", 0, 2), ("yz", 1, 2)] {
        let stddev = prior.inertia_b_kg_m2[(i, j)];
        let name = format!("inertia_kg_m2.{name}");
        parts.push((name, inertia(model, i, j), inertia(fitted, i, j), stddev));
    }
    for (name, i) in [("x", 0), ("y", 1), ("z", 2)] {
        let stddev = prior.gravity_offset_b_n_m[i];
        let name = format!("gravity_offset_n_m.{name}");
        parts.push((name, offset(model, i), offset(fitted, i), stddev));
    }
    let sigmas = |part: &(String, f64, f64, f64)| (part.2 - part.1).abs() / part.3;
    let worst = parts.into_iter().filter(|p| p.3 > 0.0).max_by(|a, b| sigmas(a).total_cmp(&sigmas(b)))?;
    (sigmas(&worst) > BEYOND_BELIEF).then(|| {
        format!(
            "the fit asks for {} = {}, and the model says {} +- {}: {:.0} standard deviations. Are these data of \
             another platform? Or is there too little motion in them to fit it: take in a livelier run",
            worst.0,
            three_digits(worst.2),
            three_digits(worst.1),
            three_digits(worst.3),
            sigmas(&worst)
        )
    })
}
