//! The command, as a shell starts it. Cargo builds it because of this test: `tests/support/binaries.rs` relies on that.

use std::process::{Command, Output};

fn whorl(arguments: &[&str]) -> Output {
    #[allow(clippy::unwrap_used, reason = "a test fails by panicking")]
    Command::new(env!("CARGO_BIN_EXE_whorl")).args(arguments).output().unwrap()
}

#[test]
fn help_lists_the_commands() {
    let help = whorl(&["--help"]);
    let text = String::from_utf8_lossy(&help.stdout);
    assert!(help.status.success());
    for command in ["simulate", "diagnose", "discover", "adopt", "reproduce", "report"] {
        assert!(text.contains(&format!("\n  {command} ")), "{text}");
    }
}

#[test]
fn an_experiment_that_does_not_exist_is_an_error_in_words() {
    let refused = whorl(&["simulate", "--experiment", "/no/such/experiment.yaml"]);
    let text = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(1), "{text}");
    assert!(text.starts_with("error: ") && text.contains("/no/such/experiment.yaml"), "{text}");
}

#[test]
fn an_unknown_command_is_wrong_usage() {
    assert_eq!(whorl(&["no_such_command"]).status.code(), Some(2));
}

/// A satellite without an accelerometer, its magnetic reference from columns of the file: half a turn of spin about z while the
/// sun stands along x, in closed form. From the first line on, and smoothed, the attitude is right.
#[test]
#[allow(clippy::unwrap_used, reason = "a test fails by panicking")]
fn a_satellite_is_estimated_from_directions() {
    let folder = tempfile::tempdir().unwrap();
    let (data, map) = (folder.path().join("orbit.csv"), folder.path().join("orbit.yaml"));
    let mut text = "t,wx,wy,wz,mx,my,mz,rx,ry,rz,sx,sy,sz,qw,qx,qy,qz\n".to_owned();
    let rate: f64 = 0.01;
    for k in 0..300 {
        let t = f64::from(k);
        let (sine, cosine) = (rate * t).sin_cos();
        // Into body axes: turned back about z.
        let seen = |x: f64, y: f64, z: f64| {
            format!("{:.9},{:.9},{z:.9}", cosine * x + sine * y, cosine * y - sine * x)
        };
        let (north, up) = (2e-3 * t).sin_cos();
        let (half_sine, half_cosine) = (0.5 * rate * t).sin_cos();
        text += &format!(
            "{t},0,0,{rate},{},0,{north:.9},{up:.9},{},{half_cosine:.9},0,0,{half_sine:.9}\n",
            seen(0.0, north, up),
            seen(1.0, 0.0, 0.0)
        );
    }
    std::fs::write(&data, text).unwrap();
    let columns = "csv:\n  ros__parameters:\n    time: {column: t}\n    gyro: {columns: [wx, wy, wz]}\n    vectors:\n      \
                   field: {columns: [mx, my, mz], reference_columns: [rx, ry, rz]}\n      \
                   sun: {columns: [sx, sy, sz], reference_world: [1.0, 0.0, 0.0]}\n    \
                   true_attitude: {columns: [qw, qx, qy, qz]}\n";
    std::fs::write(&map, columns).unwrap();
    let (data, map) = (data.to_str().unwrap(), map.to_str().unwrap());
    for smooth in [&[][..], &["--smooth"][..]] {
        let arguments = [&["estimate", data, "--channels", map][..], smooth].concat();
        let told = whorl(&arguments);
        let text = String::from_utf8_lossy(&told.stdout);
        assert!(told.status.success(), "{}", String::from_utf8_lossy(&told.stderr));
        assert!(text.contains("filter directions") && text.contains("RMS: 0.00 deg total"), "{text}");
        assert!(text.contains("(300 samples)"), "{text}");
    }
    let refused = whorl(&["estimate", data, "--channels", map, "--filter", "free_motion"]);
    let text = String::from_utf8_lossy(&refused.stderr);
    assert!(text.contains("no accelerometer") && text.contains("directions"), "{text}");
}

/// An effect in `effects/` beside the parameter files is known to commands without a rebuild; the simulated hardware has it, and
/// the run carries its file. A mistake in it is reported with its line.
#[test]
#[allow(clippy::unwrap_used, reason = "a test fails by panicking")]
fn effects_are_read_from_files() {
    let folder = tempfile::tempdir().unwrap();
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params");
    let params = folder.path().join("params");
    for inner in ["effects", "truth/effects", "experiments"] {
        std::fs::create_dir_all(params.join(inner)).unwrap();
    }
    for file in ["common.yaml", "whorl_1.yaml", "whorl_2.yaml", "experiments/swing.yaml"] {
        std::fs::copy(root.join(file), params.join(file)).unwrap();
    }
    let effect = "effect:\n  title: \"a push\"\n  equation: \"push * vertical\"\n  parameters:\n    push: {unit: \"N m\", range: [-1.0, 1.0], prior: 0.1}\n";
    std::fs::write(params.join("effects/known_push.yaml"), effect).unwrap();
    std::fs::write(params.join("truth/effects/hidden_push.yaml"), effect).unwrap();
    let truth = "/whorl_1/driver:\n  ros__parameters:\n    truth:\n      effects:\n        hidden_push: {push: 0.002}\n";
    std::fs::write(params.join("truth/whorl_1.yaml"), truth).unwrap();
    let model = params.join("whorl_1.yaml").display().to_string();
    let listed = whorl(&["effects", "--model", &model]);
    let text = String::from_utf8_lossy(&listed.stdout);
    assert!(text.contains("\n  known_push ") && !text.contains("hidden_push"), "{text}");

    let run = folder.path().join("run").display().to_string();
    let experiment = params.join("experiments/swing.yaml").display().to_string();
    let simulated = whorl(&["simulate", "--experiment", &experiment, "--out", &run, "--no-report"]);
    assert!(simulated.status.success(), "{}", String::from_utf8_lossy(&simulated.stderr));
    for file in ["params/effects/known_push.yaml", "params/truth/effects/hidden_push.yaml"] {
        assert_eq!(std::fs::read_to_string(std::path::Path::new(&run).join(file)).unwrap(), effect);
    }
    // From the run alone: what the truth knows is no candidate.
    let listed = whorl(&["effects", "--model", &format!("{run}/params/whorl_1.yaml")]);
    let text = String::from_utf8_lossy(&listed.stdout);
    assert!(text.contains("\n  known_push ") && !text.contains("hidden_push"), "{text}");

    let wrong = params.join("effects/known_push.yaml");
    std::fs::write(&wrong, effect.replace("N m", "N m/V")).unwrap();
    let refused = whorl(&["effects", &wrong.display().to_string()]);
    let text = String::from_utf8_lossy(&refused.stderr);
    assert!(text.contains("known_push.yaml:3: equation") && text.contains("not a torque (N m)"), "{text}");
}
