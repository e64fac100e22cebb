//! Fits that are implausible for a platform of this model.

use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_math::three_digits;

/// Prior standard deviations beyond which a mass property is implausible.
const IMPLAUSIBLE: f64 = 12.0;

/// The parameter of mass properties, wheels and jets that a fit has moved farthest: its name, and the change in prior
/// standard deviations.
pub fn farthest(model: &PlatformModel, prior: &ModelPrior, fitted: &PlatformModel) -> Option<(String, f64)> {
    let mut moved: Vec<(String, f64)> = mass_properties(model, prior, fitted)
        .into_iter()
        .map(|(name, before, after, stddev)| (name, (after - before).abs() / stddev))
        .collect();
    let mut add = |name: String, change: f64, stddev: Option<&f64>| {
        moved.extend(stddev.filter(|s| **s > 0.0).map(|stddev| (name, change / stddev)));
    };
    let of = &prior.actuators;
    for (j, (old, new)) in model.wheels().iter().zip(fitted.wheels()).enumerate() {
        let change = (new.spin_inertia_kg_m2 / old.spin_inertia_kg_m2 - 1.0).abs();
        add(format!("{}'s spin inertia", old.name), change, of.wheels.spin_inertia.get(j));
        let angle = new.spin_axis_b.angle(&old.spin_axis_b);
        add(format!("{}'s axis", old.name), angle, of.wheels.axis_rad.get(j));
    }
    for (j, (old, new)) in model.jets().iter().zip(fitted.jets()).enumerate() {
        add(
            format!("{}'s thrust", old.name),
            (new.thrust_n / old.thrust_n - 1.0).abs(),
            of.jets.thrust.get(j),
        );
        let angle = new.force_direction_b.angle(&old.force_direction_b);
        add(format!("{}'s direction", old.name), angle, of.jets.direction_rad.get(j));
    }
    moved.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))
}

/// A sentence about a mass property that a fit has moved implausibly far.
pub fn strangest(model: &PlatformModel, prior: &ModelPrior, fitted: &PlatformModel) -> Option<String> {
    let parts = mass_properties(model, prior, fitted);
    let sigmas = |part: &(String, f64, f64, f64)| (part.2 - part.1).abs() / part.3;
    let worst = parts.into_iter().max_by(|a, b| sigmas(a).total_cmp(&sigmas(b)))?;
    (sigmas(&worst) > IMPLAUSIBLE).then(|| {
        format!(
            "the fit asks for {} = {}, and the model says {} +- {}: {:.0} standard deviations. Are these data of \
             another platform? Or is the excitation too weak to estimate it: add a run with more motion",
            worst.0,
            three_digits(worst.2),
            three_digits(worst.1),
            three_digits(worst.3),
            sigmas(&worst)
        )
    })
}

/// Name, value before and after, and prior standard deviation of every mass property that has a prior.
fn mass_properties(
    model: &PlatformModel,
    prior: &ModelPrior,
    fitted: &PlatformModel,
) -> Vec<(String, f64, f64, f64)> {
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
    parts.retain(|part| part.3 > 0.0);
    parts
}
