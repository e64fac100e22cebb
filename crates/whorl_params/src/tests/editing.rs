//! Changing one value leaves every other byte alone.

use super::params_directory;
use crate::{ParameterTree, Value, set_in_file, set_in_text};

const FILE: &str = "\
# head
/**:
  ros__parameters:
    formation: {platforms: [whorl_1]}   # who

/whorl_1/**:
  ros__parameters:
    model:
      mass_kg: 80.0      # [kg] \u{b5} assumed
      inertia_kg_m2: {xx: 6.2, zz: 12.1}  # table
      name: 'it''s # not a comment'  # but this is
      list:
        - 1.0
        - 2.0   # two
      # end of the model

    # end of the section
# tail
";

fn edit(section: &str, key: &str, value: impl Into<Value>, comment: Option<&str>) -> String {
    set_in_text("p.yaml", FILE, section, key, &value.into(), comment).unwrap()
}

fn replaced(old: &str, new: &str) -> String {
    assert_eq!(FILE.matches(old).count(), 1, "{old}");
    FILE.replace(old, new)
}

#[test]
fn a_value_is_replaced_in_place() {
    let table: [(&str, Value, Option<&str>, &str, &str); 7] = [
        ("model.mass_kg", 81.5.into(), None, "80.0 ", "81.5 "),
        ("model.mass_kg", 81.5.into(), Some("fitted"), "80.0      # [kg] \u{b5} assumed", "81.5  # fitted"),
        ("model.inertia_kg_m2.xx", 6.3.into(), None, "xx: 6.2", "xx: 6.3"),
        ("model.inertia_kg_m2.zz", 12.0.into(), Some("new"), "zz: 12.1}  # table", "zz: 12.0}  # new"),
        ("model.name", "plain".into(), None, "'it''s # not a comment'", "plain"),
        ("model.name", "a".into(), Some("c"), "'it''s # not a comment'  # but this is", "a  # c"),
        ("model.list", vec![3.5].into(), None, "list:\n        - 1.0\n        - 2.0 ", "list: [3.5] "),
    ];
    for (key, value, comment, old, new) in table {
        assert_eq!(edit("/whorl_1/**", key, value, comment), replaced(old, new), "{key}");
    }
}

#[test]
fn a_new_key_goes_to_the_innermost_group() {
    let two = "        - 2.0   # two\n";
    assert_eq!(
        edit("/whorl_1/**", "model.effects.bearing_viscous_friction.c_n_m_s", 0.002, Some("adopted")),
        replaced(
            two,
            &format!(
                "{two}      effects:\n        bearing_viscous_friction:\n          c_n_m_s: 0.002  # adopted\n"
            )
        )
    );
    assert_eq!(
        edit("/whorl_1/**", "model.inertia_kg_m2.yy", 7.5, None),
        replaced("zz: 12.1}", "zz: 12.1, yy: 7.5}")
    );
    assert_eq!(
        edit("/whorl_1/**", "use_sim_time", true, None),
        replaced(two, &format!("{two}    use_sim_time: true\n"))
    );
    assert_eq!(
        edit("/**", "formation.a.b", 1, Some("c")),
        replaced("[whorl_1]}   # who", "[whorl_1], a: {b: 1}}  # c")
    );
}

#[test]
fn a_new_section_goes_to_the_end() {
    assert_eq!(
        edit("/whorl_1/driver", "truth.mass_kg", 79.0, Some("c")),
        format!("{FILE}\n/whorl_1/driver:\n  ros__parameters:\n    truth:\n      mass_kg: 79.0  # c\n")
    );
    assert_eq!(
        set_in_text("p", "", "/a", "k", &1.into(), None).unwrap(),
        "/a:\n  ros__parameters:\n    k: 1\n"
    );
    for empty in ["/a:\n  ros__parameters: {}\n# tail\n", "/a:\n  ros__parameters:\n# tail\n"] {
        assert_eq!(
            set_in_text("p", empty, "/a", "k", &1.into(), None).unwrap(),
            "/a:\n  ros__parameters:\n    k: 1\n# tail\n"
        );
    }
    assert_eq!(
        set_in_text("p", "/a:\n  ros__parameters:\n    k: 1", "/a", "m", &2.into(), None).unwrap(),
        "/a:\n  ros__parameters:\n    k: 1\n    m: 2\n"
    );
}

#[test]
fn line_ends_of_windows_stay() {
    let windows = FILE.replace('\n', "\r\n");
    let edited =
        |key: &str, comment| set_in_text("p", &windows, "/whorl_1/**", key, &1.5.into(), comment).unwrap();
    assert_eq!(
        edited("model.mass_kg", None),
        edit("/whorl_1/**", "model.mass_kg", 1.5, None).replace('\n', "\r\n")
    );
    assert_eq!(
        edited("model.new.k", Some("c")),
        edit("/whorl_1/**", "model.new.k", 1.5, Some("c")).replace('\n', "\r\n")
    );
}

#[test]
fn what_cannot_be_done_is_refused() {
    let refused =
        |key: &str| set_in_text("p.yaml", FILE, "/whorl_1/**", key, &1.into(), None).unwrap_err().to_string();
    assert_eq!(
        refused("model.inertia_kg_m2"),
        "p.yaml:10: model.inertia_kg_m2 = 1: is a group of parameters, not one; allowed: the key of a single value"
    );
    assert_eq!(
        refused("gain"),
        "p.yaml:15: gain = 1: not allowed in section /whorl_1/**; allowed there: formation.*, model.*, model_history.*, model_prior.*, truth.*, use_sim_time; keys of one node stand in its own section, such as /**/<node>"
    );
    assert_eq!(
        refused("model.mass_kg.x"),
        "p.yaml:9: model.mass_kg.x = 1: mass_kg is a single value here, not a group"
    );
    assert!(refused("a b").contains("not a parameter name"));
}

/// Every value of a real platform file, set to itself, gives the same file; set to another value,
/// it changes only its own line, and reads back.
#[test]
fn every_value_of_a_platform_can_be_set() {
    let path = params_directory().join("whorl_1.yaml");
    let text = std::fs::read_to_string(&path).unwrap();
    let tree = ParameterTree::from_texts(&[("w", &text)], &[]).unwrap();
    let parameters = tree.for_node("/whorl_1/any");
    for entry in parameters.iter() {
        let other: Value = match &entry.value {
            Value::Double(x) => (x + 0.125).into(),
            Value::DoubleArray(x) => x.iter().map(|x| x - 0.5).collect::<Vec<f64>>().into(),
            Value::String(_) => "other".into(),
            value => panic!("{}: {value:?}", entry.key),
        };
        let edited = set_in_text("w", &text, "/whorl_1/**", &entry.key, &other, None).unwrap();
        let changed: Vec<_> = text.lines().zip(edited.lines()).filter(|(a, b)| a != b).collect();
        assert_eq!(
            (text.lines().count(), changed.len()),
            (edited.lines().count(), 1),
            "{}: {changed:?}",
            entry.key
        );
        let back = ParameterTree::from_texts(&[("w", &edited)], &[]).unwrap().for_node("/whorl_1/any");
        assert_eq!(back.get(&entry.key).unwrap().value, other);
    }
}

#[test]
fn a_file_is_replaced_as_a_whole() {
    let path = std::env::temp_dir().join(format!("whorl_params_edit_{}.yaml", std::process::id()));
    std::fs::write(&path, FILE).unwrap();
    set_in_file(&path, "/whorl_1/**", "model.mass_kg", &81.5.into(), None).unwrap();
    assert_eq!(std::fs::read_to_string(&path).unwrap(), replaced("80.0 ", "81.5 "));
    std::fs::remove_file(&path).unwrap();
    let missing = set_in_file(&path, "/a", "k", &1.into(), None).unwrap_err().to_string();
    assert!(missing.contains("cannot be read"), "{missing}");
}
