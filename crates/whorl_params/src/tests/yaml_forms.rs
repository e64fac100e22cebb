//! The same parameters in the forms that people write them, and back.

use std::f64::consts::PI;

use super::{estimator, params_directory, tree};
use crate::{ParameterTree, Value};

fn value(text: &str) -> Value {
    estimator(&format!("k: {text}")).get("k").unwrap().value.clone()
}

#[test]
fn scalars_follow_the_core_schema() {
    let table: [(&str, Value); 25] = [
        ("true", true.into()),
        ("False", false.into()),
        ("yes", "yes".into()),
        ("1", 1.into()),
        ("-0", 0.into()),
        ("+7", 7.into()),
        ("010", 10.into()),
        ("0x1F", 31.into()),
        ("0o17", 15.into()),
        ("9223372036854775807", i64::MAX.into()),
        ("-9223372036854775808", i64::MIN.into()),
        ("1.0", 1.0.into()),
        (".5", 0.5.into()),
        ("5.", 5.0.into()),
        ("-1e-3", (-1.0e-3).into()),
        ("1.7976931348623157e308", f64::MAX.into()),
        ("3.141592653589793", PI.into()),
        ("1.2.3", "1.2.3".into()),
        ("1e", "1e".into()),
        ("infinity", "infinity".into()),
        ("nan", "nan".into()),
        ("'1'", "1".into()),
        ("[]", Vec::<i64>::new().into()),
        ("[1, 2.5]", vec![1.0, 2.5].into()),
        ("[true, false]", vec![true, false].into()),
    ];
    for (text, expected) in table {
        assert_eq!(value(text), expected, "{text}");
    }
    assert!(matches!(value(".NaN"), Value::Double(x) if x.is_nan()));
    assert_eq!(value("\n  - 1\n  - 2"), vec![1, 2].into());
}

#[test]
fn values_read_back_to_the_same_bits() {
    let table: Vec<Value> = vec![
        0.1.into(),
        1e-7.into(),
        1e300.into(),
        (-0.0).into(),
        f64::MIN_POSITIVE.into(),
        5e-324.into(),
        f64::INFINITY.into(),
        100.0.into(),
        i64::MIN.into(),
        "plain/text-1.0".into(),
        "true".into(),
        "No".into(),
        "1e5".into(),
        "".into(),
        "a: b # c".into(),
        "quote \" back \\ tab \t line \n bell \u{7} umlaut ü".into(),
        vec!["a".to_owned(), "1".to_owned(), "x, y".to_owned()].into(),
        vec![0.5, -1e-9, 3.0].into(),
        vec![true].into(),
    ];
    for expected in table {
        let found = value(&expected.to_string());
        assert_eq!(format!("{found:?}"), format!("{expected:?}"), "{expected}");
    }
    // As PyYAML (YAML 1.1) needs it: with a point, and a sign in the exponent.
    assert_eq!(Value::Double(1e-7).to_string(), "1.0e-7");
    assert_eq!(Value::Double(1.5e300).to_string(), "1.5e+300");
}

#[test]
fn integers_become_numbers_only_when_exact() {
    use crate::Kind;
    assert_eq!(Value::Integer(1 << 53).converted(Kind::Double), Some(Value::Double(9_007_199_254_740_992.0)));
    assert_eq!(Value::Integer((1 << 53) + 1).converted(Kind::Double), None);
    assert_eq!(Value::Double(1.0).converted(Kind::Integer), None);
}

#[test]
fn line_ends_and_marks_of_windows_change_nothing() {
    let text = "# c\n/a:\n  ros__parameters:\n    x: 1.5  # c\n    y: [1, 2]\n    z: text\n";
    let unix = tree(text).for_node("/a");
    for other in [text.replace('\n', "\r\n"), format!("\u{feff}{text}")] {
        let windows = tree(&other).for_node("/a");
        let entries = |p: &crate::NodeParameters| {
            p.iter().map(|e| (e.key.clone(), e.value.clone(), e.origin.clone())).collect::<Vec<_>>()
        };
        assert_eq!(entries(&windows), entries(&unix));
    }
}

#[test]
fn node_names_may_be_nested_or_joined() {
    for text in [
        "/whorl_1/estimator:\n  ros__parameters: {k: 1}\n",
        "whorl_1/estimator:\n  ros__parameters: {k: 1}\n",
        "whorl_1:\n  estimator:\n    ros__parameters: {k: 1}\n",
        "/whorl_1:\n  estimator: {ros__parameters: {k: 1}}\n",
        "/*/estimator:\n  ros__parameters:\n    k: 1\n",
    ] {
        assert_eq!(
            tree(text).for_node("/whorl_1/estimator").get("k").unwrap().value,
            Value::Integer(1),
            "{text}"
        );
    }
}

#[test]
fn layered_parameters_read_back_as_a_file() {
    let files =
        ["common.yaml", "whorl_1.yaml", "truth/whorl_1.yaml"].map(|name| params_directory().join(name));
    let driver = ParameterTree::load(&files, &[]).unwrap().for_node("/whorl_1/driver");
    let again = tree(&driver.to_yaml()).for_node("/whorl_1/driver");
    let entries =
        |p: &crate::NodeParameters| p.iter().map(|e| (e.key.clone(), e.value.clone())).collect::<Vec<_>>();
    assert!(entries(&driver).len() > 100);
    assert_eq!(entries(&again), entries(&driver));
}

/// A file for one reader: with the section and `ros__parameters`, without, and the keys alone.
#[test]
fn a_file_for_one_reader_needs_no_wrapper() {
    let folder = tempfile::tempdir().unwrap();
    let load = |text: &str| {
        let path = folder.path().join("map.yaml");
        std::fs::write(&path, text).unwrap();
        ParameterTree::load_for(&path, "csv").map_err(|e| e.to_string())
    };
    for text in [
        "csv:\n  ros__parameters:\n    time: {unit: ms}\n",
        "csv:\n  time: {unit: ms}\n",
        "time: {unit: ms}\n",
    ] {
        let found = load(text).unwrap();
        assert_eq!(found.get("time.unit").unwrap().value, "ms".into(), "{text}");
    }
    assert!(
        load("bag:\n  ros__parameters: {time: 1}\n")
            .unwrap_err()
            .contains("section /bag matches no node; the nodes are /csv")
    );
    assert!(
        load("time: {unit: ms}\ntime.unit: s\n")
            .unwrap_err()
            .contains("map.yaml:2: time.unit = s: the key was already given at")
    );
}
