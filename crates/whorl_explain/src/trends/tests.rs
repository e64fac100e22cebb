use super::*;

fn trend(values: &[f64], stddev: f64) -> Trend {
    let estimate = |(run, value): (usize, &f64)| Estimate { run, value: *value, stddev };
    Trend {
        group: "thruster_strength".to_owned(),
        name: "jet_4".to_owned(),
        unit: "1".to_owned(),
        model: 0.0,
        estimates: values.iter().enumerate().map(estimate).collect(),
        scatter: 1.0,
        change: None,
    }
}

/// A model that was adopted knows each jet to a thousandth; a valve that loses a tenth is far outside.
#[test]
fn what_an_earlier_fit_left_is_widened_to_what_is_typical() {
    let model = PlatformModel::whorl_1_reference();
    let typical = ModelPrior::typical(&model);
    let mut adopted = typical.clone().with_mass_properties_scaled(0.01);
    adopted.actuators.jets.thrust.iter_mut().for_each(|s| *s = 1e-3);
    adopted.inertia_b_kg_m2[(0, 1)] = 0.0;
    adopted.gravity_offset_b_n_m.z = 10.0;
    adopted
        .effects
        .entry("bearing_viscous_friction".to_owned())
        .or_default()
        .insert("c_n_m_s".to_owned(), 1e-9);
    let wide = widened(&model, &adopted);
    assert_eq!(wide.actuators.jets.thrust, typical.actuators.jets.thrust);
    assert_eq!(wide.inertia_b_kg_m2[(0, 0)], typical.inertia_b_kg_m2[(0, 0)]);
    assert_eq!(wide.gravity_offset_b_n_m.x, typical.gravity_offset_b_n_m.x);
    // What is exact, and what is wider still, stay.
    assert_eq!((wide.inertia_b_kg_m2[(0, 1)], wide.gravity_offset_b_n_m.z), (0.0, 10.0));
    assert!(wide.effects["bearing_viscous_friction"]["c_n_m_s"] > 1e-4);
}

/// Three runs at 0 and three at -0.12, each known to 0.03: 0.12 over 0.03 sqrt(2/3) are 4.9 standard deviations, and
/// with five tests the chance is five times as large.
#[test]
fn a_step_is_found_where_it_is_with_its_chance_after_all_tests() {
    let mut own = [trend(&[0.0, 0.0, 0.0, -0.12, -0.12, -0.12], 0.03)];
    judge(&mut own, None);
    let found = own[0].change.as_ref().unwrap();
    assert_eq!(found.from, 3);
    let sigma = 0.12 / (0.03 * (2.0_f64 / 3.0).sqrt());
    assert!((found.size + 0.12).abs() < 1e-12 && (found.sigma - sigma).abs() < 1e-12);
    let expected = 5.0 * 2.0 * normal_probability(-sigma);
    assert!((found.chance / expected - 1.0).abs() < 1e-5, "{} {expected}", found.chance);
}

#[test]
fn a_steady_motion_is_a_step_in_the_middle() {
    let mut own = [trend(&[0.0, 0.1, 0.2, 0.3, 0.4, 0.5], 0.01)];
    judge(&mut own, None);
    let found = own[0].change.as_ref().unwrap();
    assert!(found.from == 3 && (found.size - 0.3).abs() < 1e-12 && found.chance < 0.05, "{found:?}");
}

/// The same step among runs that scatter four times as much as they say is no discovery.
#[test]
fn scatter_beyond_the_standard_deviations_widens_them() {
    let mut own = [trend(&[0.12, -0.12, 0.0, 0.0, -0.24, -0.12], 0.03)];
    judge(&mut own, None);
    let found = own[0].change.as_ref().unwrap();
    assert!(own[0].scatter > 2.5 && found.chance > 0.05, "{found:?}");
    // Two sets of runs, one test.
    let mut own = [trend(&[0.0, 0.0, 0.0, -0.12, -0.12, -0.12], 0.03)];
    judge(&mut own, Some(2));
    let found = own[0].change.as_ref().unwrap();
    assert_eq!(found.from, 2);
    assert!((found.chance - 2.0 * normal_probability(-found.sigma)).abs() < 1e-9);
}
