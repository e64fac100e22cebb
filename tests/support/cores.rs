//! The cores of a formation's nodes, without their shells.

use whorl_coordinator::CoordinatorCore;
use whorl_driver::DriverCore;
use whorl_estimator::EstimatorCore;
use whorl_local_control::LocalControlCore;
use whorl_model_monitor::ModelMonitorCore;
use whorl_node::NodeCore;

use super::simulation::parameters;

/// Platforms of the formation.
pub const PLATFORMS: [&str; 2] = ["whorl_1", "whorl_2"];

/// Every kind of core with its node's name, those of a platform of the first.
pub fn cores() -> Vec<(&'static str, Box<dyn NodeCore>)> {
    // The estimator identifies and the platform is balanced, so that those parts are reached too.
    let layer = "/**/estimator:\n  ros__parameters:\n    identification: {enabled: true}\n";
    let tree = parameters(&PLATFORMS, "leader_follower_short", &[layer]);
    let driver = whorl_params::read(&tree.for_node("/whorl_1/driver"), whorl_driver::parameters::read);
    let estimator =
        whorl_params::read(&tree.for_node("/whorl_1/estimator"), whorl_estimator::parameters::read);
    let control =
        whorl_params::read(&tree.for_node("/whorl_1/local_control"), whorl_local_control::parameters::read);
    let monitor =
        whorl_params::read(&tree.for_node("/whorl_1/model_monitor"), whorl_model_monitor::parameters::read);
    let coordinator = whorl_params::read(&tree.for_node("/coordinator"), whorl_coordinator::parameters::read);
    vec![
        (
            "/whorl_1/driver",
            Box::new(DriverCore::from_parameters(&driver.unwrap().0.unwrap(), vec![], None).unwrap()),
        ),
        ("/whorl_1/estimator", Box::new(EstimatorCore::new(estimator.unwrap().0.unwrap()).unwrap())),
        ("/whorl_1/local_control", Box::new(LocalControlCore::new(control.unwrap().0.unwrap()).unwrap())),
        ("/whorl_1/model_monitor", Box::new(ModelMonitorCore::new(monitor.unwrap().0.unwrap()).unwrap())),
        ("/coordinator", Box::new(CoordinatorCore::new(coordinator.unwrap().0.unwrap()).unwrap())),
    ]
}
