//! The table of quantities, and shapes as functions and as equations.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::effects::written::Formula;
use whorl_dynamics::{Environment, PlatformModel};

use crate::{SHAPES, quantities};

#[test]
fn quantities_are_equations_of_their_units() {
    let model = PlatformModel::whorl_1_reference();
    let all = quantities(&model, []);
    assert_eq!(all.len(), 9 + 2 * model.wheels().len() + 3);
    for quantity in &all {
        let one = Formula::new(&format!("1 [{}]", quantity.unit)).unwrap();
        assert_eq!(Formula::new(&quantity.text).unwrap().dimension(), one.dimension(), "{}", quantity.name);
    }
}

#[test]
fn a_shape_is_its_equation() {
    let model = PlatformModel::whorl_1_reference();
    let scale = 0.3;
    for shape in &SHAPES {
        for u in [-2.0, -0.7, -0.1, 0.02, 0.5, 1.9] {
            let omega = Vector3::z() * (scale * u);
            let environment = Environment::new(&model, UnitQuaternion::identity(), omega);
            let parameter = shape.parameter.map_or(0.0, |(_, share, _)| share * scale);
            let text = shape.text.replace("{x}", "rate.z").replace("{p}", &format!("{parameter} [rad/s]"));
            let as_equation = Formula::new(&text).unwrap().number(&environment);
            let expected = (shape.of)(u) * scale.powi(shape.power);
            assert!((as_equation - expected).abs() < 1e-12, "{text} at {u}: {as_equation} {expected}");
        }
    }
}
