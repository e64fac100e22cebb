//! What a fit says of a constant and what it hands on to the next fit are one number.

use whorl_dynamics::PlatformModel;

use super::generator::{map, record, wrong_model};
use crate::{Fit, Options, fit};

/// Standard deviations of the moments of inertia and of the gravity offset: given, handed on, said.
fn stddevs(given: &whorl_dynamics::ModelPrior, fit: &Fit) -> Vec<(String, f64, f64, f64)> {
    let said = |group: &str, name: &str| {
        let found = fit.estimates.iter().find(|p| p.group == group && p.name == name);
        found.map_or(f64::NAN, |p| p.stddev)
    };
    let moments = ["ixx_kg_m2", "iyy_kg_m2", "izz_kg_m2"].into_iter().enumerate().map(|(i, name)| {
        let of = |prior: &whorl_dynamics::ModelPrior| prior.inertia_b_kg_m2[(i, i)];
        (name.to_owned(), of(given), of(&fit.prior), said("mass_properties", name))
    });
    let offsets = ["mgr_x_n_m", "mgr_y_n_m", "mgr_z_n_m"].into_iter().enumerate().map(|(i, name)| {
        let of = |prior: &whorl_dynamics::ModelPrior| prior.gravity_offset_b_n_m[i];
        (name.to_owned(), of(given), of(&fit.prior), said("gravity_offset", name))
    });
    moments.chain(offsets).collect()
}

#[test]
#[ignore = "slow: the uncertainty of constants from fit to fit"]
fn a_constant_has_one_uncertainty() {
    let mut truth = PlatformModel::whorl_1_reference();
    truth.effects = map(&[("bearing_viscous_friction", &[("c_n_m_s", 0.3)])]);
    let run = record(&truth, 31, 40.0, None);
    let (model, prior) = wrong_model(&truth, 31);
    let fitted = |effects: &[&str]| {
        fit(std::slice::from_ref(&run), &model, &prior, effects, &Options::default()).unwrap()
    };
    // While a strong friction is missing, the constants bend: what is known of them is what was known.
    let missing = fitted(&[]);
    for (name, given, handed_on, said) in stddevs(&prior, &missing) {
        assert_eq!((handed_on, said), (given, given), "{name}");
    }
    // With it the data add to what was known, and cannot take away from it.
    let complete = fitted(&["bearing_viscous_friction"]);
    assert!(complete.is_explained && !missing.is_explained);
    for (name, given, handed_on, said) in stddevs(&prior, &complete) {
        assert!(said == handed_on && said <= given, "{name}: {given} {handed_on} {said}");
    }
    // Of jets that fired little the data say next to nothing.
    for (given, handed_on) in
        prior.actuators.jets.direction_rad.iter().zip(&complete.prior.actuators.jets.direction_rad)
    {
        assert!(*handed_on <= *given && *handed_on > 0.1 * given, "{given} {handed_on}");
    }
    let yaw = stddevs(&prior, &complete)[2].clone();
    assert!(yaw.3 < 0.5 * yaw.1, "{yaw:?}");
}

/// With friction stated to 30 % the fit finds it within that; stated without a deviation it stays as it is.
#[test]
#[ignore = "slow: two fits of forty seconds"]
fn friction_of_wheels_is_refitted_within_its_prior() {
    let mut truth = PlatformModel::whorl_1_reference();
    for wheel in truth.wheels_mut() {
        (wheel.viscous_friction_n_m_s, wheel.coulomb_friction_n_m) = (1e-4, 0.0);
    }
    let run = record(&truth, 31, 40.0, None);
    let (mut model, prior) = wrong_model(&truth, 31);
    for wheel in model.wheels_mut() {
        wheel.viscous_friction_n_m_s = 1.3e-4;
    }
    let fitted = |prior: &whorl_dynamics::ModelPrior| {
        let fit = fit(std::slice::from_ref(&run), &model, prior, &[], &Options::default()).unwrap();
        let named: Vec<_> = fit.estimates.iter().filter(|p| p.group == "wheel_friction").cloned().collect();
        (fit, named)
    };
    let (kept, none) = fitted(&prior);
    assert!(none.is_empty());
    assert!(kept.model.wheels().iter().all(|wheel| wheel.viscous_friction_n_m_s == 1.3e-4));
    let mut prior = prior;
    prior.actuators.wheels.viscous_friction_n_m_s.fill(4e-5);
    let (found, named) = fitted(&prior);
    assert!(found.is_explained);
    assert_eq!(named.len(), truth.wheels().len());
    for ((wheel, parameter), known) in
        found.model.wheels().iter().zip(&named).zip(&found.prior.actuators.wheels.viscous_friction_n_m_s)
    {
        let off = wheel.viscous_friction_n_m_s - 1e-4;
        assert!(off.abs() < 4.0 * parameter.stddev && parameter.stddev < 4e-6, "{off} {parameter:?}");
        assert_eq!(*known, parameter.stddev);
        assert!(wheel.viscous_friction_n_m_s > 0.0);
    }
}
