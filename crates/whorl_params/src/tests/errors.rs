//! Every kind of error, with its exact text: file, line, key, value, what is allowed.

use super::{estimator, load_error, read_error, tree};
use crate::{Origin, Override, ParameterTree, Reader, Value, any, formation, non_negative, positive, range};

fn one(r: &mut Reader<'_>) {
    r.f64("gain", range(0.0..=2.0), "control gain [1/s]");
}

#[test]
fn a_number_names_file_line_key_value_and_range() {
    let table = [
        ("gain: 2.5", "p.yaml:3: gain = 2.5: allowed: a number from 0 to 2 (control gain [1/s])"),
        ("gain: 3", "p.yaml:3: gain = 3.0: allowed: a number from 0 to 2 (control gain [1/s])"),
        ("gain: -1.0e-9", "p.yaml:3: gain = -1.0e-9: allowed: a number from 0 to 2 (control gain [1/s])"),
        ("gain: .nan", "p.yaml:3: gain = .nan: allowed: a number from 0 to 2 (control gain [1/s])"),
        ("gain: -.inf", "p.yaml:3: gain = -.inf: allowed: a number from 0 to 2 (control gain [1/s])"),
        ("gain: true", "p.yaml:3: gain = true: allowed: a number from 0 to 2 (control gain [1/s])"),
        ("gain: \"1.0\"", "p.yaml:3: gain = \"1.0\": allowed: a number from 0 to 2 (control gain [1/s])"),
        ("gain: 1,5", "p.yaml:3: gain = \"1,5\": allowed: a number from 0 to 2 (control gain [1/s])"),
        ("gain: [1.0]", "p.yaml:3: gain = [1.0]: allowed: a number from 0 to 2 (control gain [1/s])"),
        (
            "# nothing",
            "/whorl_1/estimator: gain: missing; needed: a number from 0 to 2 (control gain [1/s]); looked in p.yaml",
        ),
        (
            "gain: 1.0\ngian: 1.0",
            "p.yaml:4: gian = 1.0: unknown parameter of /whorl_1/estimator; did you mean gain?",
        ),
        (
            "gain: 1.0\ncolour: red",
            "p.yaml:4: colour = red: unknown parameter of /whorl_1/estimator; known here: gain",
        ),
        (
            "gain: {p: 1.0}",
            "/whorl_1/estimator: gain: missing; needed: a number from 0 to 2 (control gain [1/s]); looked in p.yaml\n\
             p.yaml:3: gain.p = 1.0: unknown parameter of /whorl_1/estimator; did you mean gain?",
        ),
    ];
    for (lines, expected) in table {
        assert_eq!(read_error(&estimator(lines), one), expected, "{lines}");
    }
}

#[test]
fn allowed_says_what_each_type_allows() {
    type Read = fn(&mut Reader<'_>);
    let table: [(Read, &str, &str); 20] = [
        (
            |r| {
                r.f64("k", any(), "d");
            },
            "a",
            "k = a: allowed: a number (d)",
        ),
        (
            |r| {
                r.f64("k", positive(), "d");
            },
            "0.0",
            "k = 0.0: allowed: a number above 0 (d)",
        ),
        (
            |r| {
                r.f64("k", non_negative(), "d");
            },
            "-1.0",
            "k = -1.0: allowed: a number of at least 0 (d)",
        ),
        (
            |r| {
                r.f64("k", range(..0.5), "d");
            },
            "0.5",
            "k = 0.5: allowed: a number below 0.5 (d)",
        ),
        (
            |r| {
                r.f64("k", range(1.0e-9..1.0e9), "d");
            },
            "0.0",
            "k = 0.0: allowed: a number from 1e-9 to below 1e9 (d)",
        ),
        (
            |r| {
                r.f64("k", positive().or_not_finite(), "d");
            },
            "-1.0",
            "k = -1.0: allowed: a number above 0, or .nan, .inf, -.inf (d)",
        ),
        (
            |r| {
                r.i64("k", range(1..), "d");
            },
            "0",
            "k = 0: allowed: an integer of at least 1 (d)",
        ),
        (
            |r| {
                r.i64("k", range(1..5), "d");
            },
            "5",
            "k = 5: allowed: an integer from 1 to 4 (d)",
        ),
        (
            |r| {
                r.i64("k", any(), "d");
            },
            "1.0",
            "k = 1.0: allowed: an integer (d)",
        ),
        (
            |r| {
                r.bool("k", "d");
            },
            "yes",
            "k = \"yes\": allowed: true or false (d)",
        ),
        (
            |r| {
                r.string("k", "d");
            },
            "1.5",
            "k = 1.5: allowed: a text (d)",
        ),
        (
            |r| {
                r.choice("k", &["wheels", "jets"], "d");
            },
            "wheel",
            "k = wheel: allowed: one of wheels, jets (d); did you mean wheels?",
        ),
        (
            |r| {
                r.vector3("k", range(-1.0..=1.0), "d");
            },
            "[0, 0.5, 2]",
            "k = [0.0, 0.5, 2.0]: allowed: three numbers [x, y, z], each from -1 to 1 (d)",
        ),
        (
            |r| {
                r.vector3("k", any(), "d");
            },
            "[1, 2]",
            "k = [1.0, 2.0]: allowed: three numbers [x, y, z] (d)",
        ),
        (
            |r| {
                r.vector3("k", any(), "d");
            },
            "[1, 2, .nan]",
            "k = [1.0, 2.0, .nan]: allowed: three numbers [x, y, z] (d)",
        ),
        (
            |r| {
                r.direction("k", "d");
            },
            "[0, 0, 0]",
            "k = [0.0, 0.0, 0.0]: allowed: three numbers [x, y, z], not all zero (d)",
        ),
        (
            |r| {
                r.per_axis("k", non_negative(), "d");
            },
            "-1",
            "k = -1: allowed: a number of at least 0 for all axes, or three numbers [x, y, z] (d)",
        ),
        (
            |r| {
                r.f64_array("k", positive(), "d");
            },
            "[1, 0]",
            "k = [1.0, 0.0]: allowed: a list of numbers, each above 0 (d)",
        ),
        (
            |r| {
                r.i64_array("k", any(), "d");
            },
            "[1.5]",
            "k = [1.5]: allowed: a list of integers (d)",
        ),
        (
            |r| {
                r.string_array("k", "d");
            },
            "[1]",
            "k = [1]: allowed: a list of texts (d)",
        ),
    ];
    for (read, value, expected) in table {
        assert_eq!(read_error(&estimator(&format!("k: {value}")), read), format!("p.yaml:3: {expected}"));
    }
}

#[test]
fn all_errors_are_reported_at_once_one_a_line() {
    let read = |r: &mut Reader<'_>| {
        one(r);
        r.group("gyro", |r| r.f64("noise_rad_s", non_negative(), "noise [rad/s]"));
        r.choice("mode", &["wheels", "jets"], "actuators");
        if r.f64("low", any(), "low") > r.f64("high", any(), "high") {
            r.reject("low", "above high; allowed: at most high");
        }
        r.reject("gyro", "one about the group");
    };
    let parameters =
        estimator("gain: 9.0\ngyro:\n  noise_rad_s: -1\n  noise_rads: 1\nlow: 2\nhigh: 1\nmode: both");
    assert_eq!(
        read_error(&parameters, read),
        "p.yaml:3: gain = 9.0: allowed: a number from 0 to 2 (control gain [1/s])\n\
         p.yaml:5: gyro.noise_rad_s = -1.0: allowed: a number of at least 0 (noise [rad/s])\n\
         p.yaml:9: mode = both: allowed: one of wheels, jets (actuators)\n\
         p.yaml:7: low = 2: above high; allowed: at most high\n\
         p.yaml:5: gyro: one about the group\n\
         p.yaml:6: gyro.noise_rads = 1: unknown parameter of /whorl_1/estimator; did you mean gyro.noise_rad_s?"
    );
}

#[test]
fn the_form_of_a_file_is_checked() {
    let table = [
        ("", "p.yaml: is empty; allowed: at least one section `<node name>: ros__parameters:`"),
        (
            "# only a comment\n",
            "p.yaml: is empty; allowed: at least one section `<node name>: ros__parameters:`",
        ),
        (
            "- a\n- b\n",
            "p.yaml:1: expected a map of node names; allowed: sections `<node name>: ros__parameters:`",
        ),
        (
            "/a:\n  gain: 1.0\n",
            "p.yaml:1: /a: expected `ros__parameters:` with a map below this node name; allowed: `<node name>: \
             ros__parameters:`, where `/**` stands for every node",
        ),
        (
            "ros__parameters:\n  gain: 1.0\n",
            "p.yaml:1: ros__parameters stands outside a node's section; allowed: `<node name>: ros__parameters:`",
        ),
        ("/a:\n  ros__parameters: 3\n", "p.yaml:2: ros__parameters must hold a map of parameters"),
        (
            "/a b:\n  ros__parameters:\n    gain: 1.0\n",
            "p.yaml:2: `/a b` is not a node name; allowed: parts of letters, digits and _ (the first no digit), `*` or `**`, joined by /",
        ),
        (
            "/a:\n  ros__parameters:\n    gain: 1.0\n    gain: 2.0\n",
            "p.yaml:4: gain: the key stands here and on line 3; allowed: once",
        ),
        (
            "/a:\n  ros__parameters:\n    g:\n      p: 1.0\n    g.p: 2.0\n",
            "p.yaml:5: g.p = 2.0: the key was already given at p.yaml:4; allowed: once for a node name in a file",
        ),
        (
            "/a/b:\n  ros__parameters:\n    p: 1.0\na:\n  b:\n    ros__parameters:\n      p: 2.0\n",
            "p.yaml:7: p = 2.0: the key was already given at p.yaml:3; allowed: once for a node name in a file",
        ),
        (
            "/a:\n  ros__parameters:\n    g: 1.0\n    g.p: 2.0\n",
            "p.yaml:4: g.p = 2.0: g is a single value at p.yaml:3; allowed: either a value or a group",
        ),
        ("/a:\n  ros__parameters:\n    gain:\n", "p.yaml:3: gain: has no value; leave the key out instead"),
        (
            "/a:\n  ros__parameters:\n    gain: ~\n",
            "p.yaml:3: gain = ~: has no value; leave the key out instead",
        ),
        (
            "/a:\n  ros__parameters:\n    my gain: 1\n",
            "p.yaml:3: my gain: not a parameter name; allowed: letters, digits and _, joined by dots",
        ),
        (
            "/a:\n  ros__parameters:\n    n: 9223372036854775808\n",
            "p.yaml:3: n = 9223372036854775808: is an integer beyond 64 bits; allowed: -9223372036854775808 to 9223372036854775807",
        ),
        (
            "/a:\n  ros__parameters:\n    n: 1.0e+999\n",
            "p.yaml:3: n = 1.0e+999: is beyond the largest double, 1.8e308",
        ),
        (
            "/a:\n  ros__parameters:\n    n: [1, a]\n",
            "p.yaml:3: n = [1, a]: the list mixes types; allowed: lists of booleans, of integers, of numbers or of texts",
        ),
        (
            "/a:\n  ros__parameters:\n    n: [[1]]\n",
            "p.yaml:3: n = [[1]]: element 1 of the list is not a single value; allowed: lists of booleans, of integers, of numbers or of texts",
        ),
        (
            "/**:\n  ros__parameters:\n    gain: 1.0\n",
            "p.yaml:3: gain = 1.0: not allowed in section /**; allowed there: formation.*, model.*, model_history.*, model_prior.*, truth.*, use_sim_time; keys of one node stand in its own section, such as /**/<node>",
        ),
        (
            "/a:\n  ros__parameters:\n    n: &x 1\n",
            "p.yaml:3: YAML anchors (&name) are not allowed in parameter files",
        ),
        (
            "/a:\n  ros__parameters:\n    n: !!float 1\n",
            "p.yaml:3: YAML tags (!name) are not allowed in parameter files",
        ),
        (
            "/a:\n  ros__parameters:\n    n: 1\n---\n/b: 1\n",
            "p.yaml:5: a second YAML document; allowed: one document a file",
        ),
        ("/a:\n  ros__parameters:\n    [1]: 1\n", "p.yaml:3: a key must be a single word, not a list or map"),
    ];
    for (text, expected) in table {
        assert_eq!(load_error(text), expected, "{text}");
    }
}

#[test]
fn broken_yaml_names_its_line() {
    for (text, start) in [
        ("/a:\n  ros__parameters:\n\tgain: 1.0\n", "p.yaml:3: not valid YAML: "),
        ("/a:\n  ros__parameters:\n    gain: [1.0, 2.0\n", "p.yaml:"),
        ("/a:\n  ros__parameters:\n    gain: \"open\n", "p.yaml:"),
        ("/a:\n  ros__parameters:\n    gain: 1.0\n   rate: 2.0\n", "p.yaml:4: not valid YAML: "),
        ("/a: *b\n", "p.yaml:1: "),
        (&format!("/a: {}", "[".repeat(100_000)), "p.yaml:1: "),
        (&format!("/a: {}", "{a: ".repeat(5_000)), "p.yaml:1: "),
    ] {
        let error = load_error(text);
        assert!(error.starts_with(start), "{text:.80}: {error}");
        assert_eq!(error.lines().count(), 1, "{error}");
    }
}

#[test]
fn errors_of_several_files_come_together() {
    let good = "/a:\n  ros__parameters:\n    n: 1\n";
    let bad = "/a:\n  ros__parameters:\n    n:\n";
    let error = ParameterTree::from_texts(&[("one.yaml", bad), ("two.yaml", good), ("three.yaml", bad)], &[])
        .unwrap_err();
    assert_eq!(
        error.to_string(),
        "one.yaml:3: n: has no value; leave the key out instead\nthree.yaml:3: n: has no value; leave the key out instead"
    );
    assert_eq!(error.len(), 2);
    let missing = ParameterTree::load(&["/nowhere/params.yaml".into()], &[]).unwrap_err().to_string();
    assert!(
        missing.starts_with("/nowhere/params.yaml: does not exist; there is no folder /nowhere"),
        "{missing}"
    );
}

#[test]
fn a_mistyped_node_name_is_found() {
    let tree =
        tree("/whorl_1/estimater:\n  ros__parameters:\n    n: 1\n/**/driver:\n  ros__parameters: {}\n");
    let nodes = ["/whorl_1/estimator", "/whorl_1/driver"];
    assert_eq!(
        tree.check_sections(nodes).unwrap_err().to_string(),
        "p.yaml:2: section /whorl_1/estimater matches no node; did you mean /whorl_1/estimator?"
    );
}

#[test]
fn an_argument_for_a_mistyped_node_is_found() {
    let text = "/**:\n  ros__parameters:\n    formation: {platforms: [whorl_1]}\n";
    let given = |arguments: &[&str]| {
        let overrides: Vec<Override> = arguments.iter().map(|text| Override::parse(text).unwrap()).collect();
        ParameterTree::from_texts(&[("p.yaml", text)], &overrides).unwrap().check_overrides()
    };
    given(&["gain:=1.0", "/coordinator:law.kind:=x", "/**/driver:n:=1", "/whorl_1/estimator:n:=1"]).unwrap();
    assert_eq!(
        given(&["/cordinator:law.kind:=x"]).unwrap_err().to_string(),
        "command line (-p): /cordinator:law.kind: /cordinator matches no node; did you mean /coordinator?"
    );
}

#[test]
fn command_line_arguments_are_checked() {
    let table = [
        ("gain", "command line (-p): gain: not of the form key:=value or node:key:=value"),
        ("gain:=", "command line (-p): gain:=: has no value"),
        ("gain:={a: 1}", "command line (-p): gain:={a: 1}: expected a value, found a map"),
        (
            "my gain:=1",
            "command line (-p): my gain:=1: `my gain` is not a parameter name; allowed: letters, digits and _, joined by dots",
        ),
    ];
    for (argument, expected) in table {
        assert_eq!(Override::parse(argument).unwrap_err().to_string(), expected);
    }
    let argument = Override::parse("gain:=5").unwrap();
    let tree = ParameterTree::from_texts(&[], &[argument]).unwrap();
    assert_eq!(
        read_error(&tree.for_node("/a"), one),
        "command line (-p): gain = 5.0: allowed: a number from 0 to 2 (control gain [1/s])"
    );
    assert_eq!(
        read_error(&ParameterTree::default().for_node("/a"), one),
        "/a: gain: missing; needed: a number from 0 to 2 (control gain [1/s]); no parameter file was given"
    );
}

#[test]
fn a_change_at_run_time_is_validated_like_the_rest() {
    let parameters = estimator("gain: 1.0");
    let changed = parameters.with("gain", Value::Double(3.0));
    assert_eq!(changed.get("gain").unwrap().origin, Origin::RunTime);
    assert_eq!(
        read_error(&changed, one),
        "parameter set at run time: gain = 3.0: allowed: a number from 0 to 2 (control gain [1/s])"
    );
    let (gain, _) =
        crate::read(&parameters.with("gain", Value::Integer(2)), |r| r.f64("gain", any(), "d")).unwrap();
    assert_eq!(gain, 2.0);
    assert!(crate::read(&parameters, one).is_ok(), "the original is unchanged");
}

#[test]
fn formation_names_are_checked() {
    let table = [
        ("[whorl_1, whorl_1]", "[whorl_1, whorl_1]: a name stands twice; allowed: every platform once"),
        (
            "[whorl_1, 2nd]",
            "[whorl_1, \"2nd\"]: `2nd` is not a ROS name; allowed: letters, digits and _, the first no digit",
        ),
        ("[]", "[]: the list is empty; allowed: at least one platform"),
    ];
    for (value, expected) in table {
        let parameters = estimator(&format!("formation.platforms: {value}"));
        assert_eq!(read_error(&parameters, formation), format!("p.yaml:3: formation.platforms = {expected}"));
    }
}
