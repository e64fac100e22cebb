use whorl_dynamics::{Gyrostat, ModelPrior, PlatformModel};

use crate::directions::{Direction, Directions, MASS_PROPERTIES, STEP};

fn found() -> (PlatformModel, Directions) {
    let model = PlatformModel::whorl_1_reference();
    let found = Directions::of(&model, &ModelPrior::typical(&model), 1e-3).unwrap();
    (model, found)
}

fn moved(direction: &Direction) -> &Gyrostat {
    &direction.moved.gyrostat
}

/// Thrusts and moments of inertia of a moved platform are those written in its direction.
#[test]
fn a_direction_moves_the_constant_that_it_names() {
    let (model, found) = found();
    let place = |effect: &str, parameter: &str| {
        found.all.iter().position(|d| d.effect == effect && d.parameter == parameter).unwrap()
    };
    let third = place("thruster_strength", "jet_3");
    assert!(third < found.constants && place("thruster_strength", "all") >= found.constants);
    let third = &found.all[third];
    let (before, after) = (model.jets()[2].thrust_n, moved(third).model().jets()[2].thrust_n);
    assert!((after / before - 1.0 - third.scale * STEP).abs() < 1e-12);
    let moment = &found.all[place(MASS_PROPERTIES, "izz_kg_m2")];
    let inertia = moved(moment).model().mass_properties.inertia_b_kg_m2()[(2, 2)];
    assert!((inertia - moment.origin - moment.scale * STEP).abs() < 1e-9);
}

#[test]
fn an_effect_enters_by_whole_wheels_and_jets() {
    let (model, found) = found();
    let names = |id: &str| -> Vec<Vec<&str>> {
        let ways = found.ways.iter().filter(|(effect, _)| *effect == id);
        ways.map(|(_, way)| way.iter().map(|k| found.all[*k].parameter.as_str()).collect()).collect()
    };
    // Wheel by wheel, never one of the two drags alone; all six at once would fit anything.
    let friction = names("wheel_friction");
    assert_eq!(friction.len(), model.wheels().len());
    for (way, wheel) in friction.iter().zip(model.wheels()) {
        let own = [format!("{}_viscous_n_m_s", wheel.name), format!("{}_coulomb_n_m", wheel.name)];
        assert_eq!(*way, own);
    }
    assert_eq!(names("wheel_windage").len(), model.wheels().len());
    let strength = names("thruster_strength");
    assert_eq!(strength[0], ["all"]);
    assert_eq!(strength.len(), 1 + model.jets().len());
    assert!(names("thruster_misalignment").iter().all(|way| way.len() == 2));
    // What needs an accelerometer, hidden states or the timing of valves, or a shape to start from is left out.
    for id in ["accel_bias", "slosh", "thruster_delay", "winding_cable"] {
        assert!(names(id).is_empty(), "{id}");
    }
}
