//! Which value wins.

use crate::{Override, ParameterTree, Value, any, effective_yaml, range};

const BASE: &str = "\
/**:
  ros__parameters: {model.a: 1, model.b: 1, model.c: 1, model.d: 1, model.e: 1, model.f: 1, model.g: 1}
/whorl_1/estimator:
  ros__parameters: {model.c: 4, model.d: 4, model.e: 4}
/**/estimator:
  ros__parameters: {model.b: 3, model.c: 3, model.d: 3}
/whorl_1/**:
  ros__parameters: {model.b: 2, model.a: 2}
";
const LATER: &str = "\
/**:
  ros__parameters: {model.e: 5, model.f: 5}
/whorl_2/**:
  ros__parameters: {model.a: 6}
";

#[test]
fn later_files_win_then_more_specific_sections_then_the_command_line() {
    let overrides: Vec<Override> = ["model.f:=7", "/whorl_2/estimator:model.g:=8", "/**/driver:model.g:=9"]
        .map(|argument| Override::parse(argument).unwrap())
        .into();
    let tree = ParameterTree::from_texts(&[("base", BASE), ("later", LATER)], &overrides).unwrap();
    // model.a ... model.g
    let table = [
        ("/whorl_1/estimator", [2, 3, 4, 4, 5, 7, 1]),
        ("/whorl_1/driver", [2, 2, 1, 1, 5, 7, 9]),
        ("/whorl_2/estimator", [6, 3, 3, 3, 5, 7, 8]),
        ("whorl_2/driver", [6, 1, 1, 1, 5, 7, 9]),
        ("/coordinator", [1, 1, 1, 1, 5, 7, 1]),
    ];
    for (node, expected) in table {
        let parameters = tree.for_node(node);
        let found = ["a", "b", "c", "d", "e", "f", "g"]
            .map(|key| parameters.get(&format!("model.{key}")).unwrap().value.clone());
        assert_eq!(found, expected.map(Value::Integer), "{node}");
    }
}

#[test]
fn origins_follow_the_value() {
    let tree = ParameterTree::from_texts(&[("base", BASE), ("later", LATER)], &[]).unwrap();
    let parameters = tree.for_node("/whorl_1/estimator");
    let origin = |key: &str| parameters.get(key).unwrap().origin.to_string();
    assert_eq!([origin("model.a"), origin("model.c"), origin("model.e")], ["base:8", "base:4", "later:2"]);
}

#[test]
fn order_is_that_of_the_first_file() {
    let first = "/a:\n  ros__parameters:\n    jets: {j2: {t: 1}, j1: {t: 1}}\n";
    let second = "/a:\n  ros__parameters:\n    jets: {j1: {t: 2}, j3: {t: 2}, j2: {u: 2}}\n";
    let tree = ParameterTree::from_texts(&[("1", first), ("2", second)], &[]).unwrap();
    assert_eq!(tree.for_node("/a").children("jets"), ["j2", "j1", "j3"]);
}

#[test]
fn defaults_and_options_are_in_the_descriptors() {
    let text = "/a:\n  ros__parameters:\n    gain: 2\n    truth.x: 1\n";
    let tree = ParameterTree::from_texts(&[("p", text)], &[]).unwrap();
    let (_, descriptors) = crate::read(&tree.for_node("/a"), |r| {
        r.f64("gain", range(0.0..=3.0), "gain [1]");
        r.fixed(|r| r.i64_or("depth", 5, range(1..=10), "queue depth"));
        r.optional_f64("spare", any(), "spare [1]");
        r.choice_or("mode", "jets", &["wheels", "jets"], "actuators");
    })
    .unwrap();
    let summary: Vec<(&str, Option<Value>, bool, u8)> = descriptors
        .iter()
        .map(|d| (d.name.as_str(), d.value.clone(), d.read_only, d.kind.ros_type()))
        .collect();
    assert_eq!(
        summary,
        [
            ("gain", Some(Value::Double(2.0)), false, 3),
            ("depth", Some(Value::Integer(5)), true, 2),
            ("spare", None, false, 3),
            ("mode", Some("jets".into()), false, 4),
        ]
    );
    assert_eq!(descriptors[0].range, Some(crate::NumericRange::Double { from: 0.0, to: 3.0 }));
    assert_eq!(descriptors[3].choices, ["wheels", "jets"]);
    assert_eq!(
        effective_yaml([("/a", descriptors.as_slice()), ("/b", &[])]),
        "/a:\n  ros__parameters:\n    gain: 2.0  # gain [1]\n    depth: 5  # queue depth\n    mode: jets  # actuators\n/b:\n  ros__parameters: {}\n"
    );
}

#[test]
fn shared_groups_can_be_read_without_being_the_node() {
    let text = "/a:\n  ros__parameters:\n    gain: 2\n    formation: {platforms: [p, q], links: 3}\n";
    let tree = ParameterTree::from_texts(&[("p", text)], &[]).unwrap();
    let error = crate::read_shared(&tree.for_node("/a"), crate::formation).unwrap_err();
    assert_eq!(error.to_string(), "p:4: formation.links = 3: unknown parameter of /a; known here: platforms");
    assert_eq!(
        crate::read_shared(&tree.for_node("/a"), |_| 1).unwrap(),
        1,
        "groups that are not read are ignored"
    );
}
