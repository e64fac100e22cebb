//! The files in `params/`: they load, every node can read its shared groups, and the platforms
//! they describe can do their work.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use whorl_dynamics::effects::catalogue;
use whorl_dynamics::{Gyrostat, PlatformModel};

use super::params_directory;
use crate::{
    ParameterTree, formation, layers_of_experiment, platform_model, read_shared, standard_layers, truth_model,
};

fn layers(experiment: Option<&Path>) -> Vec<PathBuf> {
    // The platforms decide which further files there are.
    let tree = ParameterTree::load(&standard_layers(&params_directory(), &[], experiment), &[]).unwrap();
    let platforms = read_shared(&tree.for_node("/coordinator"), formation).unwrap().platforms;
    let names: Vec<&str> = platforms.iter().map(String::as_str).collect();
    standard_layers(&params_directory(), &names, experiment)
}

fn model(platform: &str) -> PlatformModel {
    let tree = ParameterTree::load(&layers(None), &[]).unwrap();
    let parameters = tree.for_node(&format!("/{platform}/local_control"));
    read_shared(&parameters, |r| platform_model(r, "model")).unwrap().unwrap()
}

#[test]
fn every_file_loads_for_every_node() {
    let mut experiments: Vec<Option<PathBuf>> = vec![None];
    let entries = std::fs::read_dir(params_directory().join("experiments")).unwrap();
    let paths = entries.map(|entry| entry.unwrap().path());
    experiments.extend(paths.filter(|path| path.extension().is_some_and(|ext| ext == "yaml")).map(Some));
    assert!(experiments.len() > 1, "there is no experiment");
    for experiment in experiments {
        let load = |platforms: &[&str]| {
            ParameterTree::load(&standard_layers(&params_directory(), platforms, experiment.as_deref()), &[])
                .unwrap_or_else(|errors| panic!("{experiment:?}:\n{errors}"))
        };
        // An experiment may be of one platform alone.
        let platforms = read_shared(&load(&[]).for_node("/coordinator"), formation)
            .unwrap_or_else(|errors| panic!("{experiment:?}:\n{errors}"));
        let platform_names: Vec<&str> = platforms.platforms.iter().map(String::as_str).collect();
        let known = ["whorl_1", "whorl_2"].starts_with(&platform_names) || platform_names == ["whorl_c"];
        assert!(known, "{experiment:?}: {platform_names:?}");
        let tree = load(&platform_names);
        let nodes = tree.node_set();
        let on_platforms = if tree.law_on_platforms() { platform_names.len() } else { 0 };
        assert_eq!(nodes.len(), platform_names.len() * 4 + on_platforms + 3);
        tree.check_nodes().unwrap_or_else(|errors| panic!("{errors}"));
        for name in nodes.iter().map(|instance| &instance.name) {
            let node = tree.for_node(name);
            read_shared(&node, formation).unwrap_or_else(|errors| panic!("{name}:\n{errors}"));
            if platforms.platform_of_node(name).is_some() {
                let models = |r: &mut crate::Reader<'_>| {
                    let model = platform_model(r, "model");
                    let truth = truth_model(r);
                    model.zip(truth)
                };
                let both = read_shared(&node, models).unwrap_or_else(|errors| panic!("{name}:\n{errors}"));
                assert!(both.is_some(), "{name}");
            }
        }
    }
}

/// The coordinator that runs on a platform has a section of its own where there is such a coordinator.
#[test]
fn a_platforms_own_coordinator_is_a_node_where_the_law_runs_on_platforms() {
    let own = "/whorl_1/coordinator:\n  ros__parameters:\n    waiting: {healthy_for_s: 2.5}\n";
    let tree = |experiment: &str| {
        let experiment = params_directory().join("experiments").join(experiment);
        let mut texts: Vec<(String, String)> = layers_of_experiment(&params_directory(), &experiment)
            .unwrap()
            .iter()
            .map(|path| (path.display().to_string(), std::fs::read_to_string(path).unwrap()))
            .collect();
        texts.push(("own.yaml".into(), own.into()));
        let texts: Vec<(&str, &str)> =
            texts.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
        ParameterTree::from_texts(&texts, &[]).unwrap()
    };
    let decentralised = tree("decentralised_on_platforms.yaml");
    decentralised.check_nodes().unwrap();
    let effective = decentralised.effective_yaml();
    let section = effective.split("/whorl_1/coordinator:\n").nth(1).unwrap();
    assert!(section.split("\n/").next().unwrap().contains("2.5"), "{section}");
    assert!(effective.contains("/whorl_2/coordinator:\n"));

    let central = tree("leader_follower_short.yaml");
    let error = central.check_nodes().unwrap_err().to_string();
    assert!(
        error.contains("own.yaml:2") && error.contains("/whorl_1/coordinator matches no node"),
        "{error}"
    );
    assert!(!central.effective_yaml().contains("/whorl_1/coordinator"));
}

#[test]
fn no_parameter_file_is_left_out_of_that() {
    let mut unseen: BTreeSet<PathBuf> = BTreeSet::new();
    let mut known: Vec<PathBuf> = layers(None);
    // A platform that only some experiment names.
    known.extend(layers(Some(&params_directory().join("experiments/cmg_slew.yaml"))));
    for directory in [params_directory(), params_directory().join("truth")] {
        for entry in std::fs::read_dir(directory).unwrap().flatten() {
            let path = entry.path();
            if path.extension().is_some_and(|ext| ext == "yaml") && !known.contains(&path) {
                unseen.insert(path);
            }
        }
    }
    assert!(unseen.is_empty(), "{unseen:?}");
}

/// Table 4.1 of the dissertation, as printed.
#[test]
fn whorl_1_has_the_mass_properties_of_table_4_1() {
    let whorl_1 = model("whorl_1");
    let inertia = whorl_1.mass_properties.inertia_b_kg_m2();
    let printed =
        [((0, 0), 6.2), ((0, 1), -0.9), ((0, 2), -0.2), ((1, 1), 7.5), ((1, 2), 0.1), ((2, 2), 12.1)];
    for ((i, j), value) in printed {
        assert_eq!(inertia[(i, j)], value);
        assert_eq!(inertia[(j, i)], value);
    }
    assert_eq!(*whorl_1.mass_properties.gravity_offset_b_n_m(), Vector3::new(-0.02, -0.07, -2.0));
}

/// Largest torque that jets can give in every direction: the least distance from zero to a facet of
/// the zonotope of their torques. A facet's normal is the cross product of two of them.
fn attainable_in_every_direction_n_m(torques: &[Vector3<f64>]) -> f64 {
    let mut least = f64::INFINITY;
    for (i, a) in torques.iter().enumerate() {
        for b in &torques[i + 1..] {
            let Some(normal) = a.cross(b).try_normalize(1e-12) else { continue };
            for normal in [normal, -normal] {
                least = least.min(torques.iter().map(|t| normal.dot(t).max(0.0)).sum());
            }
        }
    }
    least
}

#[test]
fn any_single_jet_may_fail() {
    // Four unit torques along +-x and +-y cannot turn about z; adding +-z gives the unit ball.
    let mut octahedron = vec![Vector3::x(), -Vector3::x(), Vector3::y(), -Vector3::y()];
    assert_eq!(attainable_in_every_direction_n_m(&octahedron), 0.0);
    octahedron.extend([Vector3::z(), -Vector3::z()]);
    assert_eq!(attainable_in_every_direction_n_m(&octahedron), 1.0);

    for (platform, all_n_m, one_failed_n_m) in [("whorl_1", 0.36, 0.18), ("whorl_2", 0.48, 0.33)] {
        let torques: Vec<Vector3<f64>> =
            model(platform).jets().iter().map(|jet| jet.torque_b_n_m()).collect();
        assert_eq!(torques.len(), 12);
        let all = attainable_in_every_direction_n_m(&torques);
        let worst = (0..torques.len())
            .map(|failed| {
                let mut left = torques.clone();
                left.remove(failed);
                attainable_in_every_direction_n_m(&left)
            })
            .fold(f64::INFINITY, f64::min);
        assert!((all - all_n_m).abs() < 0.005, "{platform}: {all}");
        assert!((worst - one_failed_n_m).abs() < 0.005 && worst >= 0.1, "{platform}: {worst}");
    }
}

#[test]
fn truth_differs_from_the_model_where_it_says_so() {
    let tree = ParameterTree::load(&layers(None), &[]).unwrap();
    let driver = tree.for_node("/whorl_1/driver");
    let models = |r: &mut crate::Reader<'_>| platform_model(r, "model").zip(truth_model(r));
    let (model, truth) = read_shared(&driver, models).unwrap().unwrap();
    assert_eq!(truth.mass_properties.inertia_b_kg_m2()[(2, 2)], 12.28);
    assert_eq!(model.mass_properties.inertia_b_kg_m2()[(2, 2)], 12.1);
    assert_eq!(
        (model.jets()[2].thrust_n, truth.jets()[2].thrust_n, truth.jets()[3].thrust_n),
        (0.4, 0.39, 0.4)
    );
    assert_eq!(truth.sensors.gyro.errors.scale, Vector3::new(1.0e-3, -0.5e-3, 1.0e-3));
    assert_eq!(truth.effects["bearing_viscous_friction"]["c_n_m_s"], 0.002);
    assert!(model.effects.is_empty());
    assert_eq!(truth.wheels()[1].coulomb_friction_n_m, 1.3e-3);
    assert_eq!(truth.wheels()[0].coulomb_friction_n_m, 1.0e-3);
    // Everything else is the model's.
    assert_eq!(truth.tank(), model.tank());
    assert_eq!(truth.tilt_limit, model.tilt_limit);

    // Estimator and control never see the truth.
    for node in ["/whorl_1/estimator", "/whorl_1/local_control", "/coordinator", "/recorder"] {
        assert!(tree.for_node(node).iter().all(|entry| !entry.key.starts_with("truth")), "{node}");
    }
}

/// What a model adopts explains what the hardware had all along: it must not be added to it.
#[test]
fn hardware_has_the_effects_that_its_truth_lists_and_no_others() {
    let with = |lines: &str| {
        let [common, own] = ["common.yaml", "whorl_1.yaml"]
            .map(|file| std::fs::read_to_string(params_directory().join(file)).unwrap());
        let adopted = "/whorl_1/**:\n  ros__parameters:\n    model:\n      effects:\n        air_current: {t_x_n_m: 0.01}\n        \
                       bearing_viscous_friction: {c_n_m_s: 0.004}\n";
        let truth = format!("/whorl_1/driver:\n  ros__parameters:\n    truth:\n{lines}");
        let texts = [("common", common.as_str()), ("own", &own), ("adopted", adopted), ("truth", &truth)];
        let tree = ParameterTree::from_texts(&texts, &[]).unwrap();
        read_shared(&tree.for_node("/whorl_1/driver"), truth_model).unwrap().unwrap().effects
    };
    let listed = with("      effects:\n        bearing_viscous_friction: {c_n_m_s: 0.002}\n");
    assert_eq!(listed.keys().collect::<Vec<_>>(), ["bearing_viscous_friction"]);
    assert_eq!(listed["bearing_viscous_friction"]["c_n_m_s"], 0.002);
    // Nor does a parameter that the model has adopted join those of the truth.
    let sideways = with("      effects:\n        air_current: {t_y_n_m: 0.03}\n");
    assert_eq!(sideways["air_current"].iter().collect::<Vec<_>>(), [(&"t_y_n_m".to_owned(), &0.03)]);
    // A truth that says nothing of effects has the model's.
    let none = with("      mass_kg: 100.0\n");
    assert_eq!(none.keys().collect::<Vec<_>>(), ["air_current", "bearing_viscous_friction"]);
}

/// What only simulated hardware has is nothing to those who look for what its model lacks, until the model has it.
#[test]
fn an_effect_of_a_truth_alone_is_in_no_catalogue() {
    let is_listed = || catalogue().iter().any(|effect| effect.info().id == "t_hidden_swirl");
    let folder = tempfile::tempdir().unwrap();
    let at = |file: &str| folder.path().join(file);
    std::fs::create_dir_all(at("truth/effects")).unwrap();
    for file in ["common.yaml", "whorl_1.yaml"] {
        std::fs::copy(params_directory().join(file), at(file)).unwrap();
    }
    std::fs::copy(
        params_directory().join("demo/effects/swirl.yaml"),
        at("truth/effects/t_hidden_swirl.yaml"),
    )
    .unwrap();
    let section = |group: &str| {
        format!("  ros__parameters:\n    {group}:\n      effects: {{t_hidden_swirl: {{k: 3.0}}}}\n")
    };
    std::fs::write(at("truth/whorl_1.yaml"), format!("/whorl_1/driver:\n{}", section("truth"))).unwrap();
    let read = |files: &[&str]| {
        let files: Vec<PathBuf> = files.iter().map(|file| at(file)).collect();
        let own = ParameterTree::load(&files, &[]).unwrap().for_node("/whorl_1/driver");
        read_shared(&own, |r| (platform_model(r, "model").unwrap(), truth_model(r).unwrap())).unwrap()
    };
    let (model, truth) = read(&["common.yaml", "whorl_1.yaml", "truth/whorl_1.yaml"]);
    assert_eq!(truth.effects["t_hidden_swirl"]["k"], 3.0);
    assert!(model.effects.is_empty() && !is_listed());
    Gyrostat::new(&truth).unwrap();

    std::fs::rename(at("truth/effects"), at("effects")).unwrap();
    std::fs::write(at("adopted.yaml"), format!("/whorl_1/**:\n{}", section("model"))).unwrap();
    let (model, _) = read(&["common.yaml", "whorl_1.yaml", "adopted.yaml"]);
    assert!(model.effects.contains_key("t_hidden_swirl") && is_listed());
}

/// What a platform must say about itself; all else has a value that means "none".
#[test]
fn a_short_platform_file_is_complete() {
    let text = "
/tab/**:
  ros__parameters:
    model:
      mass_kg: 52.0
      inertia_kg_m2: {xx: 3.4, xy: 0.0, xz: 0.0, yy: 3.7, yz: 0.0, zz: 5.9}
      gravity_offset_n_m: [0.0, 0.0, -0.9]
      tilt_limit: {kind: cone, max_rad: 0.2}
      wheels:
        w: {spin_axis: [0.0, 0.0, 1.0], spin_inertia_kg_m2: 0.006, max_torque_n_m: 0.25, max_speed_rad_s: 500.0}
      jets:
        j: {position_m: [0.3, 0.0, 0.0], force_direction: [0.0, 1.0, 0.0], thrust_n: 0.25}
      sensors:
        rate_hz: 200.0
        gyro: {noise_stddev_rad_s: 1.0e-3, bias_turn_on_stddev_rad_s: 2.0e-3}
        accelerometer: {noise_stddev_m_s2: 0.03, bias_turn_on_stddev_m_s2: 2.0e-3, lever_arm_m: [0.0, 0.0, 0.0]}
";
    let tree = ParameterTree::from_texts(&[("tab.yaml", text)], &[]).unwrap();
    let model =
        read_shared(&tree.for_node("/tab/estimator"), |r| platform_model(r, "model")).unwrap().unwrap();
    assert_eq!(model.wheels()[0].coulomb_friction_n_m, 0.0);
    assert_eq!(model.jets()[0].opening_delay_s, 0.0);
    let gyro = model.sensors.gyro.errors;
    assert_eq!((gyro.scale, gyro.bias, gyro.quantum), (Vector3::zeros(), Vector3::zeros(), 0.0));
    assert!(gyro.range > 10.0 && model.sensors.vector.is_none());
    // No wheel's speed is known exactly: edges of 1/4096 turn, counted for 10 ms, with an error between that of one
    // uniform rounding and of two.
    let step_rad_s = std::f64::consts::TAU / 4096.0 / 0.01;
    let noise = model.sensors.wheel_speed.noise_stddev_rad_s;
    assert!((step_rad_s / 12_f64.sqrt()..step_rad_s / 6_f64.sqrt()).contains(&noise), "{noise}");
    // Thrust neither falls with use nor runs out.
    assert_eq!(model.tank().thrust_pressure_exponent, 0.0);
    assert!(model.tank().initial_pressure_pa * model.tank().volume_m3 > 1e8);
    assert_eq!((model.bus.discharge_v_s, model.bus.sag_v_n_m), (0.0, 0.0));
}
