//! The experiments that come with Whorl, with ideal platforms.

use std::path::PathBuf;

use whorl_dynamics::platform::TiltLimit;
use whorl_params::{Reader, formation, standard_layers};

use super::*;

#[test]
fn every_experiment_runs_to_its_end_without_a_warning() {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../params"));
    let mut seen = 0;
    for entry in std::fs::read_dir(folder.join("experiments")).unwrap() {
        let file = entry.unwrap().path();
        let tree = ParameterTree::load(&standard_layers(&folder, &[], Some(&file)), &[]).unwrap();
        let platforms = formation(&mut Reader::new(&tree.for_node("/coordinator"))).platforms;
        if platforms.len() < 2 {
            continue;
        }
        let names: Vec<&str> = platforms.iter().map(String::as_str).collect();
        let tree = ParameterTree::load(&standard_layers(&folder, &names, Some(&file)), &[]).unwrap();
        let (parameters, _) = whorl_params::try_read(&tree.for_node("/coordinator"), parameters::read)
            .unwrap_or_else(|e| panic!("{e}"));
        if parameters.role == parameters::Role::Observer {
            // Each platform runs itself: `crates/whorl_sim/tests/integration/on_platforms.rs`.
            continue;
        }
        let stem = file.file_stem().unwrap().to_string_lossy();
        assert_eq!(parameters.experiment.name, stem, "the run directory is named after it");
        let length_s: f64 = parameters.steps.iter().map(|step| step.duration_s).sum();

        let mut lab = Laboratory::with(parameters);
        lab.run_until(FormationState::PHASE_FINISHED, length_s + 2.0);
        assert!(!lab.log.iter().any(|line| line.contains("within the limits")), "{stem}: {:?}", lab.log);
        assert!(lab.states.iter().all(|state| state.reference_clipped == [false, false]), "{stem}");
        let error = Vector3::from(lab.state().relative_error_rad[1]).norm();
        // With a cap on traffic neighbours may be wrong by the trigger.
        let allowed = if stem.contains("capped") { 2e-3 } else { 2e-4 };
        assert!(error < allowed, "{stem}: {error}");
        seen += 1;
    }
    assert!(seen >= 12);
}

/// The coordinator does not read the platforms' models: their stops stand in its own parameters too.
#[test]
fn references_stop_where_the_platforms_bearings_do() {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../params"));
    let names = ["whorl_1", "whorl_2"];
    let experiment = folder.join("experiments/leader_follower.yaml");
    let tree = ParameterTree::load(&standard_layers(&folder, &names, Some(&experiment)), &[]).unwrap();
    let (coordinator, _) = whorl_params::try_read(&tree.for_node("/coordinator"), parameters::read).unwrap();
    for (name, limits) in names.iter().zip(&coordinator.limits) {
        let node = tree.for_node(&format!("/{name}/local_control"));
        let model = whorl_params::platform_model(&mut Reader::new(&node), "model").unwrap();
        let (stop_rad, known_rad) = match (model.tilt_limit, limits.envelope.limit()) {
            (TiltLimit::Cone { max_rad: stop }, TiltLimit::Cone { max_rad: known })
            | (TiltLimit::Pitch { max_rad: stop }, TiltLimit::Pitch { max_rad: known }) => (stop, known),
            (stop, known) => panic!("{name}: {stop:?} and {known:?}"),
        };
        assert!(known_rad <= stop_rad && stop_rad - known_rad < 1e-3, "{name}: {known_rad} of {stop_rad}");
    }
}
