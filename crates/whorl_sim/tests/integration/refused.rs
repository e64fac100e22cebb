//! A refused value is one error: nothing is said of what depends on it.

use std::fmt::Write as _;
use std::path::Path;

use whorl_params::{
    NodeParameters, ParameterErrors, ParameterTree, Reader, Value, standard_layers, try_read,
};

/// What a node says of these parameters.
type Read = fn(&NodeParameters) -> Result<(), ParameterErrors>;

fn read<T>(
    parameters: &NodeParameters,
    read: impl FnOnce(&mut Reader<'_>) -> Option<T>,
) -> Result<(), ParameterErrors> {
    try_read(parameters, read).map(|_| ())
}

const NODES: [(&str, Read); 5] = [
    ("/whorl_1/driver", |p| read(p, whorl_driver::parameters::read)),
    ("/whorl_1/estimator", |p| read(p, whorl_estimator::parameters::read)),
    ("/whorl_1/local_control", |p| read(p, whorl_local_control::parameters::read)),
    ("/whorl_1/model_monitor", |p| read(p, whorl_model_monitor::parameters::read)),
    ("/coordinator", |p| read(p, whorl_coordinator::parameters::read)),
];

#[allow(clippy::unwrap_used, reason = "a test fails by panicking")]
fn tree() -> ParameterTree {
    let params = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params");
    let experiment = params.join("experiments/leader_follower.yaml");
    let layers = standard_layers(&params, &["whorl_1", "whorl_2"], Some(&experiment));
    ParameterTree::load(&layers, &[]).unwrap()
}

/// Every value of the files in turn is replaced by one of a type that no parameter has.
#[test]
fn every_refused_value_is_one_error_of_every_node() {
    let (tree, mut refused, mut more) = (tree(), 0, String::new());
    for (name, node) in NODES {
        let own = tree.for_node(name);
        node(&own).unwrap();
        for entry in own.iter().filter(|entry| !entry.key.ends_with("source")) {
            let wrong = Value::BoolArray(vec![true, false]);
            // A node does not read every shared group.
            let Err(errors) = node(&own.with(&entry.key, wrong)) else { continue };
            refused += 1;
            if !errors.iter().all(|error| error.key.as_deref() == Some(&entry.key)) {
                let _ = writeln!(more, "{name}, {}:\n{errors}", entry.key);
            }
        }
    }
    assert!(more.is_empty(), "{more}");
    assert!(refused > 400, "{refused}");
}

#[test]
fn what_is_unknown_beside_a_refused_value_is_said_too() {
    let own = tree().for_node("/whorl_1/driver");
    let wrong = own
        .with("model.jets.jet_3.thrust_n", Value::Double(-0.4))
        .with("model.jets.jet_3.thrst_n", Value::Double(0.4))
        .with("watchdog", Value::Double(0.2));
    let errors = read(&wrong, whorl_driver::parameters::read).unwrap_err();
    let keys: Vec<&str> = errors.iter().filter_map(|error| error.key.as_deref()).collect();
    assert_eq!(keys, ["model.jets.jet_3.thrust_n", "model.jets.jet_3.thrst_n", "watchdog"], "{errors}");
}
