//! Written effects beside those that are compiled in, and what is refused.

use nalgebra::{UnitQuaternion, Vector3};

use super::*;
use crate::effects::{
    RegisterError, built_in, catalogue, find, register, register_secret, registered, withdraw,
};

fn parameter(name: &str, unit: &str, range: (f64, f64), neutral: f64) -> WrittenParameter {
    WrittenParameter {
        name: name.into(),
        unit: unit.into(),
        range,
        neutral,
        prior: 0.05 * (range.1 - range.0),
        role: Role::Amplitude,
        known: false,
        starts: Vec::new(),
        meaning: "A parameter.".into(),
    }
}

fn torque(id: &str, equation: &str, parameters: Vec<WrittenParameter>) -> Definition {
    Definition {
        id: id.into(),
        title: "an effect".into(),
        explanation: "It acts.".into(),
        equation: equation.into(),
        parameters,
        source: "a test".into(),
        ..Definition::default()
    }
}

fn shape(p: WrittenParameter) -> WrittenParameter {
    WrittenParameter { role: Role::Shape, ..p }
}

/// States over a wide range, the same every time.
fn states(model: &PlatformModel, check: impl Fn(&Environment<'_>)) {
    let mut state = 0.25_f64;
    let mut next = move || {
        state = (state + 0.754_877_666_246_692_8).fract();
        2.0 * state - 1.0
    };
    for _ in 0..200 {
        let scale = 10f64.powf(2.0 * next() - 1.0);
        let q = UnitQuaternion::from_euler_angles(0.5 * next(), 0.4 * next(), 3.1 * next());
        let rate = Vector3::new(next(), next(), next()) * scale;
        let speeds = [200.0 * next(), 100.0 * next(), -50.0 * next()];
        let environment = Environment {
            wheel_speed_rad_s: &speeds,
            time_s: 20.0 * next(),
            ..Environment::new(model, q, rate)
        };
        check(&environment);
    }
}

/// The same torque as a built-in effect's, with these of its parameters in the order of the written one's.
fn same_torque(id: &str, values: &[(&str, f64)], definition: Definition) {
    let model = PlatformModel::whorl_1_reference();
    let known = find(id).unwrap();
    let specs = known.parameters(&model);
    let mut all: Vec<f64> = specs.iter().map(|s| s.neutral).collect();
    for (name, value) in values {
        all[specs.iter().position(|s| s.name == *name).unwrap()] = *value;
    }
    let own: Vec<f64> = values.iter().map(|(_, value)| *value).collect();
    let written = WrittenEffect::new(definition).unwrap();
    states(&model, |environment| {
        let expected = known.torque_b_n_m(&all, environment, &[]);
        let found = written.torque_b_n_m(&own, environment, &[]);
        assert!((expected - found).norm() <= 1e-12 * expected.norm().max(1e-9), "{id}: {expected} {found}");
    });
}

#[test]
fn built_in_effects_written_as_data_give_the_same_numbers() {
    let friction = torque("t_viscous", "-c * rate", vec![parameter("c", "N m s", (0.0, 5.0), 0.0)]);
    same_torque(
        "bearing_viscous_friction",
        &[("c_n_m_s", 0.02)],
        Definition { is_passive: true, ..friction },
    );
    let dry = "-t * unit(rate, 5e-4 [rad/s])";
    let dry = torque("t_dry", dry, vec![parameter("t", "N m", (0.0, 0.5), 0.0)]);
    same_torque("bearing_coulomb_friction", &[("torque_n_m", 0.01)], Definition { is_passive: true, ..dry });
    let power = torque(
        "t_power",
        "-d * (norm(rate) / 0.1 [rad/s])^p * unit(rate, 1e-12 [rad/s])",
        vec![parameter("d", "N m", (0.0, 1.0), 0.0), shape(parameter("p", "1", (1.0, 2.5), 1.5))],
    );
    same_torque(
        "air_drag_power",
        &[("d_n_m", 0.03), ("exponent", 1.7)],
        Definition { is_passive: true, ..power },
    );
    let draught = torque(
        "t_draught",
        "(x, y, z)",
        ["x", "y", "z"].map(|name| parameter(name, "N m", (-0.5, 0.5), 0.0)).to_vec(),
    );
    let draught = Definition { axes: Some(Axes::World), ..draught };
    let values = [("t_x_n_m", 0.01), ("t_y_n_m", -0.02), ("t_z_n_m", 0.03)];
    same_torque("air_current", &values, draught);
    let magnet = torque(
        "t_magnet",
        "cross((x, y, z), body((-3.0e-6 [T], 21.0e-6 [T], -47.0e-6 [T])))",
        ["x", "y", "z"].map(|name| parameter(name, "A m^2", (-100.0, 100.0), 0.0)).to_vec(),
    );
    let values = [("dipole_x_a_m2", 10.0), ("dipole_y_a_m2", -20.0), ("dipole_z_a_m2", 5.0)];
    same_torque("magnetic_torque", &values, magnet);
    // A cable: the twist is linear, and falls to zero over the last 0.05 rad before half a turn.
    let twist = "wrap(heading - yaw0)";
    let cable = torque(
        "t_cable",
        &format!(
            "-(k * sign({twist}, 1e-15) * min(abs({twist}), (pi - 0.05) * (pi - abs({twist})) / 0.05) + c * dot(rate, vertical)) * vertical"
        ),
        vec![
            parameter("k", "N m/rad", (0.0, 5.0), 0.0),
            WrittenParameter { role: Role::FloatingShape, ..parameter("yaw0", "rad", (-3.2, 3.2), 0.0) },
            parameter("c", "N m s", (0.0, 5.0), 0.0),
        ],
    );
    same_torque("harness_spring", &[("k_n_m_rad", 0.1), ("yaw0_rad", 0.4), ("c_n_m_s", 0.2)], cable);
}

#[test]
fn a_wheel_effect_written_as_data_gives_the_same_numbers() {
    let model = PlatformModel::whorl_1_reference();
    let known = find("wheel_windage").unwrap();
    let written = WrittenEffect::new(Definition {
        acts_on: ActsOn::WheelTorque,
        is_passive: true,
        ..torque("t_windage", "-d * speed * abs(speed)", vec![parameter("d", "N m s^2", (0.0, 1e-3), 0.0)])
    })
    .unwrap();
    let names: Vec<String> = written.parameters(&model).into_iter().map(|s| s.name).collect();
    assert_eq!(
        names.first().map(String::as_str),
        Some("wheel_1_d")
            .filter(|_| model.wheels()[0].name == "wheel_1")
            .or(names.first().map(String::as_str))
    );
    let values: Vec<f64> = (0..model.wheels().len()).map(|j| 1e-6 * (j as f64 + 1.0)).collect();
    states(&model, |environment| {
        let (mut expected, mut found) = (vec![0.0; values.len()], vec![0.0; values.len()]);
        known.add_wheel_torque_n_m(&values, environment, &mut expected);
        written.add_wheel_torque_n_m(&values, environment, &mut found);
        for (a, b) in expected.iter().zip(&found) {
            assert!((a - b).abs() <= 1e-14 * a.abs(), "{a} {b}");
        }
    });
}

fn refused(definition: Definition) -> String {
    WrittenEffect::new(definition).unwrap_err().to_string()
}

#[test]
fn mistakes_are_named() {
    let k = |unit: &str| vec![parameter("k", unit, (0.0, 1.0), 0.0)];
    let cases = [
        ("k * voltage^2 * vertical", k("N m/V"), "gives N m V: not a torque (N m)"),
        ("k * rate", k("N m"), "not a torque"),
        ("k * norm(rate)", k("N m s"), "gives a number; a torque of the body is a vector"),
        ("k * vertical + 1.0 [N m] * vertical", k("N m"), "neutral value"),
        (
            "k * rate / norm(rate)",
            k("N m"),
            "not finite at neutral values, at a rate of (0.000, 0.000, 0.000)",
        ),
        ("k * vertcal", k("N m"), "nearest: vertical"),
        ("k * vertical + rate", k("N m"), "cannot be added"),
        ("k * sin(time) * vertical", k("N m"), "what sin is of has none"),
        ("k * norm(rate)^1.8 * vertical", k("N m"), "divide it by a size first"),
        ("k * (vertical + world(vertical))", k("N m"), "body axes meets one in world axes"),
        ("k * vertical * rate", k("N m"), "write dot(v, w) or cross(v, w)"),
        ("k * speed * vertical", k("N m s"), "wheel_speed[1]"),
        ("k * wheel_speed * vertical", k("N m s"), "wheel_speed[1]"),
        ("k * vertical)", k("N m"), "follows the end"),
        ("k * (1, 0)", k("N m"), "a vector has 3 components, not 2"),
        ("k * vertical.w", k("N m"), "follows the end"),
        ("k * sinn(heading) * vertical", k("N m"), "nearest: sin"),
        ("k * ", k("N m"), "a value is missing"),
        ("k * 3 [N q] * vertical", k("1"), "no unit"),
        ("1.0 [N m] * (vertical - vertical)", k("N m"), "no equation uses it"),
    ];
    for (equation, parameters, expected) in cases {
        let error = refused(torque("t_wrong", equation, parameters));
        assert!(error.contains(expected), "{equation}: {error}");
    }
    let pushes = torque("t_pushes", "k * rate", k("N m s"));
    assert!(refused(Definition { is_passive: true, ..pushes }).contains("passive"));
    assert!(refused(torque("t_x", "k * vertical", k("mN m"))).contains("without prefixes"));
    assert!(refused(torque("Bad id", "k * vertical", k("N m"))).contains("no name"));
    let deep = format!("{}k{} * vertical", "(".repeat(500), ")".repeat(500));
    assert!(refused(torque("t_deep", &deep, k("N m"))).contains("nested deeper"));
    let minus = format!("{}k * vertical", "-".repeat(900));
    assert!(refused(torque("t_minus", &minus, k("N m"))).contains("too many signs"));
    let long = (0..150).map(|i| format!("k*{i}.5")).collect::<Vec<_>>().join("+");
    assert!(refused(torque("t_long", &format!("({long}) * vertical"), k("N m"))).contains("too long"));
}

/// A first-order state follows its input with the lag of a low pass: at w = 1/tau, by the share 1/sqrt(2).
#[test]
fn states_are_integrated_by_the_plant() {
    let definition = Definition {
        states: vec![WrittenState {
            name: "late".into(),
            unit: "rad/s".into(),
            derivative: "(rate.z - late) / tau".into(),
        }],
        ..torque(
            "t_late",
            "-c * late * vertical",
            vec![
                parameter("c", "N m s", (0.0, 5.0), 0.0),
                WrittenParameter { role: Role::FloatingShape, ..parameter("tau", "s", (0.1, 20.0), 2.0) },
            ],
        )
    };
    let effect = WrittenEffect::new(definition).unwrap();
    let model = PlatformModel::whorl_1_reference();
    assert_eq!(effect.hidden_states(&model), 1);
    let environment = Environment::new(&model, UnitQuaternion::identity(), Vector3::new(0.0, 0.0, 0.3));
    let mut derivative = [0.0];
    effect.hidden_derivative(&[0.2, 2.0], &environment, &[0.1], &mut derivative);
    assert!((derivative[0] - 0.1).abs() < 1e-15);
    assert!((effect.torque_b_n_m(&[0.2, 2.0], &environment, &[0.1]).z + 0.02).abs() < 1e-15);
    let starts = effect.starts(&model, &Clues::default()).unwrap();
    assert_eq!(starts.len(), 6);
    assert!(starts.iter().all(|s| s.len() == 1 && s[0].name == "c" && s[0].origin[0] == 0.0));
}

#[test]
fn a_registered_effect_is_in_the_catalogue_until_it_is_withdrawn() {
    let definition = torque("t_registered", "-k * rate", vec![parameter("k", "N m s", (0.0, 1.0), 0.0)]);
    let of = |equation: &str| {
        WrittenEffect::new(Definition { equation: equation.into(), ..definition.clone() }).unwrap()
    };
    let first = register(of("-k * rate")).unwrap();
    assert!(std::ptr::addr_eq(find("t_registered").unwrap(), first));
    assert!(std::ptr::addr_eq(register(of("-k * rate")).unwrap(), first));
    assert_eq!(register(of("-2 * k * rate")).unwrap_err(), RegisterError::Differs("t_registered".into()));
    let taken = Definition { id: built_in()[2].info().id.into(), ..definition.clone() };
    assert!(matches!(register(WrittenEffect::new(taken).unwrap()), Err(RegisterError::BuiltIn(_))));
    withdraw("t_registered");
    assert!(find("t_registered").is_none());
    register(of("-2 * k * rate")).unwrap();
    assert!(register(of("-k * rate")).is_err());
    withdraw("t_registered");
}

#[test]
fn a_secret_effect_is_known_to_who_asks_for_it_alone() {
    let definition = torque("t_secret", "-k * rate", vec![parameter("k", "N m s", (0.0, 1.0), 0.0)]);
    let of = |equation: &str| {
        WrittenEffect::new(Definition { equation: equation.into(), ..definition.clone() }).unwrap()
    };
    let is_listed = || catalogue().iter().any(|effect| effect.info().id == "t_secret");
    let secret = register_secret(of("-k * rate")).unwrap();
    assert!(std::ptr::addr_eq(find("t_secret").unwrap(), secret));
    assert!(!is_listed() && registered().iter().all(|effect| effect.info().id != "t_secret"));
    assert!(register(of("-2 * k * rate")).is_err());
    // Who adopts it makes it known to all, and hardware that has it does not take that back.
    register(of("-k * rate")).unwrap();
    register_secret(of("-k * rate")).unwrap();
    assert!(is_listed());
    withdraw("t_secret");
    assert!(find("t_secret").is_none());
}

/// Brake by a measured curve: at every rate the torque is what the closed form of the curve's coefficients gives.
#[test]
fn a_curve_is_an_effect() {
    let definition = Definition {
        is_passive: true,
        curves: vec![WrittenCurve {
            name: "brake".into(),
            of: "norm(rate)".into(),
            of_unit: "rad/s".into(),
            knots: vec![0.0, 1.0],
            unit: "N m".into(),
            largest: 1.0,
            prior: 0.01,
            shape: CurveShape::Increasing,
        }],
        ..torque("t_curve", "-brake * unit(rate, 1e-9 [rad/s])", Vec::new())
    };
    let effect = WrittenEffect::new(definition).unwrap();
    let model = PlatformModel::whorl_1_reference();
    assert_eq!(effect.parameters(&model).len(), 3);
    // One piece: Bernstein's polynomials with coefficients 0, 0.1, 0.1, 0.4.
    let values = [0.1, 0.0, 0.3];
    for rate in [0.1_f64, 0.5, 0.9] {
        let environment = Environment::new(&model, UnitQuaternion::identity(), Vector3::new(rate, 0.0, 0.0));
        let up = 1.0 - rate;
        let expected = 0.1 * 3.0 * rate * up * up + 0.1 * 3.0 * rate * rate * up + 0.4 * rate.powi(3);
        assert!((effect.torque_b_n_m(&values, &environment, &[]).x + expected).abs() < 1e-9);
    }
}
