//! Proposed experiments can be run.

use std::path::{Path, PathBuf};

use whorl_explain::propose::family;
use whorl_node::Timestamp;
use whorl_params::{ParameterTree, standard_layers};
use whorl_sim::NodeSet;

fn parameters() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params")
}

#[test]
fn every_manoeuvre_is_an_experiment_that_the_nodes_accept() {
    let directory = tempfile::tempdir().unwrap();
    for platform in ["whorl_1", "whorl_2"] {
        let known =
            whorl_recording::read_model(&parameters().join(format!("{platform}.yaml")), None).unwrap();
        let all = family(&known.model, 1.0);
        assert_eq!(all.len(), 4);
        for manoeuvre in &all {
            let text = manoeuvre.yaml(manoeuvre.name, platform, &["why: because".to_owned()]);
            let file = directory.path().join(format!("{}.yaml", manoeuvre.name));
            std::fs::write(&file, text).unwrap();
            let layers = standard_layers(&parameters(), &[platform], Some(&file));
            let tree = ParameterTree::load(&layers, &[]).unwrap();
            let set = NodeSet::build(&tree, 1, Timestamp(0))
                .unwrap_or_else(|error| panic!("{platform} {}: {error}", manoeuvre.name));
            assert_eq!(set.platforms, [platform]);
        }
    }
}
