//! The command, as a shell starts it. Cargo builds it because of this test: `tests/support/binaries.rs` relies on that.

use std::process::{Command, Output, Stdio};

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_whorl"));
    command.args(arguments);
    command
}

fn whorl(arguments: &[&str]) -> Output {
    #[allow(clippy::unwrap_used, reason = "a test fails by panicking")]
    command(arguments).output().unwrap()
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

/// What a command says on its standard error, as lines; it must fail.
fn refused(arguments: &[&str]) -> Vec<String> {
    let output = whorl(arguments);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && output.stdout.is_empty(), "{arguments:?}: {text}");
    text.lines().map(str::to_owned).collect()
}

/// The folder of parameters, from that of this crate.
fn params(file: &str) -> String {
    format!("{}/../../params/{file}", env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn what_was_mistyped_is_suggested_everywhere_in_one_line() {
    let experiment = params("experiments/swing.yaml");
    let model = params("whorl_1.yaml");
    let folder = params("");
    let cases: &[(&[&str], &str)] = &[
        (
            &["simulate", "--experiment", "leader_folower", "--params", &folder],
            "did you mean leader_follower?",
        ),
        (&["simulate", "--experiment", &experiment.replace("swing", "swnig")], "experiments/swing.yaml?"),
        (&["excitation", "hodl", "--params", &folder], "did you mean hold?"),
        (&["effects", "bearing_viscus_friction"], "did you mean bearing_viscous_friction?"),
        (&["effects", "--model", &model.replace("whorl_1", "whorl1")], "whorl_1.yaml?"),
        (&["history", &model, "--platform", "whorl_l"], "did you mean whorl_1?"),
        (&["parameters", "estimater", "--params", &folder], "did you mean estimator?"),
        (&["reproduce", "tabel_4_3"], "did you mean table_4_3?"),
        (&["campaign", &params("campaigns/lnik.yaml")], "campaigns/link.yaml?"),
        (&["runs", "--where", "verdit=failed"], "did you mean verdict?"),
    ];
    for (arguments, expected) in cases {
        let lines = refused(arguments);
        assert!(lines[0].contains(expected), "{arguments:?}: {lines:?}");
        // Usage follows what clap refuses.
        assert!(
            lines.len() == 1 || lines.iter().any(|line| line.contains("--help")),
            "{arguments:?}: {lines:?}"
        );
    }
}

/// Not one line for every parameter that the file would have had.
#[test]
#[allow(clippy::unwrap_used, reason = "a test fails by panicking")]
fn a_missing_file_of_a_platform_is_one_line() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("experiments")).unwrap();
    for file in ["common.yaml", "whorl_1.yaml", "experiments/leader_follower.yaml"] {
        std::fs::copy(params(file), folder.path().join(file)).unwrap();
    }
    let experiment = folder.path().join("experiments/leader_follower.yaml").display().to_string();
    let lines = refused(&["simulate", "--experiment", &experiment, "--no-record"]);
    assert_eq!(lines.len(), 1, "{lines:?}");
    assert!(lines[0].contains("whorl_2.yaml") && lines[0].contains("names whorl_2"), "{lines:?}");
}

/// One JSON value on the standard output and nothing else; with a file, the words stay.
#[test]
#[allow(clippy::unwrap_used, reason = "a test fails by panicking")]
fn json_has_the_standard_output_for_itself() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run").display().to_string();
    let experiment = params("experiments/leader_follower_short.yaml");
    let only_json = |arguments: &[&str]| -> serde_json::Value {
        let output = whorl(arguments);
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{arguments:?}: {error}"))
    };
    let simulated = only_json(&["simulate", "--experiment", &experiment, "--out", &run, "--json", "-"]);
    assert_eq!(simulated["run"], run.as_str());
    // The same numbers as in the run's own file.
    let summary = std::fs::read(format!("{run}/summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_slice(&summary).unwrap();
    assert_eq!(simulated["report"]["pairs"], summary["pairs"]);
    assert_eq!(only_json(&["report", &run, "--json", "-"])["verdict"], summary["verdict"]);
    let listed = only_json(&["runs", &folder.path().display().to_string(), "--json", "-"]);
    assert_eq!(listed[0]["experiment"], "leader_follower_short");
    let compared = only_json(&["compare-runs", &run, &run, "--json", "-"]);
    assert_eq!(compared["pairs"][0]["significant"], false);
    let compared = only_json(&["compare", &run, "--platform", "whorl_1", "--json", "-"]);
    assert_eq!(compared["platform"], "whorl_1");
    let each = only_json(&["compare", &run, "--json", "-"]);
    assert_eq!([&each[0]["platform"], &each[1]["platform"]], ["whorl_1", "whorl_2"]);
    let effects = only_json(&["effects", "--json", "-"]);
    let ids = effects.as_array().unwrap().iter().map(|e| e["id"].as_str().unwrap()).collect::<Vec<_>>();
    assert!(ids.contains(&"bearing_viscous_friction"), "{ids:?}");
    let planned =
        only_json(&["campaign", &params("campaigns/link.yaml"), "--seeds", "2", "--dry-run", "--json", "-"]);
    assert_eq!(planned["runs"].as_array().unwrap().len(), 2 * 5 * 4);
    assert_eq!(planned["runs"][2]["swept"], serde_json::json!({"delay_s": "0.001", "loss": "0.05"}));
    let pass = only_json(&["orbit", &params("experiments/co_observation.yaml"), "--json", "-"]);
    assert_eq!(pass["passes"][0]["rows"][0]["platform"], "whorl_1");
    // Every correction that was flown is listed, and its gas is what was counted.
    let days = only_json(&["orbit", &params("experiments/formation_keeping.yaml"), "--json", "-"]);
    let kept = &days["passes"][0]["kept"][0];
    assert_eq!((&kept["platform"], &kept["inside_since_day"]), (&"whorl_2".into(), &0.0.into()));
    let gas_kg = kept["corrections"].as_array().unwrap().iter().map(|c| c["gas_kg"].as_f64().unwrap());
    assert!((gas_kg.sum::<f64>() - kept["gas_kg"].as_f64().unwrap()).abs() < 1e-9);
    assert!(days["passes"][0]["keeping"][0]["along_m_rev"].as_f64().unwrap().abs() < 5.0);
    for (key, value, said) in [
        ("spacecraft.whorl_2.keep.gas_kg", "70.0", "less than mass_kg of the burn"),
        ("model", "nonlinear", "the model must be two_body or j2"),
        ("spacecraft.whorl_2.formation", "chief", "is for a spacecraft with a formation"),
    ] {
        let changed = format!("/coordinator:steps.observe.{key}:={value}");
        let refused = whorl(&["orbit", &params("experiments/formation_keeping.yaml"), "-p", &changed]);
        let error = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(!refused.status.success() && error.contains(said), "{error}");
    }
    let listed = only_json(&["parameters", "campaign", "--params", &params(""), "--json", "-"]);
    assert!(listed["campaign"].as_array().unwrap().iter().any(|p| p["key"] == "keep_every"));

    let file = folder.path().join("effects.json").display().to_string();
    let both = whorl(&["effects", "--json", &file]);
    assert!(String::from_utf8_lossy(&both.stdout).contains("bearing_viscous_friction"));
    let written: serde_json::Value = serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap();
    assert_eq!(written, effects);
}

/// `whorl ... | head`: the reader is gone before the first word, and every file is written all the same.
#[test]
#[allow(clippy::unwrap_used, reason = "a test fails by panicking")]
fn a_closed_pipe_loses_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run").display().to_string();
    let without_reader = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_whorl"));
        let mut child =
            command.args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success() && said.is_empty(), "{arguments:?}: {:?} {said}", output.status);
    };
    let experiment = params("experiments/leader_follower_short.yaml");
    without_reader(&["simulate", "--experiment", &experiment, "--out", &run]);
    assert!(folder.path().join("run/report.html").is_file());
    without_reader(&["compare", &run, "--platform", "whorl_1"]);
    assert!(folder.path().join("run/compare.html").is_file());
    without_reader(&["effects", "--all"]);
    without_reader(&["completions", "bash"]);
    without_reader(&["--help"]);
}

/// What cannot be written is lost, and said to be.
#[test]
#[allow(clippy::unwrap_used, reason = "a test fails by panicking")]
fn a_full_disk_behind_the_standard_output_is_an_error() {
    let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_whorl")).arg("effects").stdout(full).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && said.contains("standard output"), "{said}");
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

/// A pendulum in a file of somebody: two commands to a first comparison, without a question.
#[test]
#[allow(clippy::unwrap_used, reason = "a test fails by panicking")]
fn a_file_of_somebody_is_compared_after_two_commands() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let mut text = "t,gz,ax,ay,az\n".to_owned();
    let (omega, mut seed) = (9.4_f64, 1_u32);
    let mut noise = || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        0.02 * (f64::from(seed) / f64::from(u32::MAX) - 0.5)
    };
    for k in 0..2000 {
        let t = f64::from(k) * 0.01;
        let (angle, rate) = (0.1 * (omega * t).cos(), -0.1 * omega * (omega * t).sin());
        let force = [9.81 * angle.cos(), -9.81 * angle.sin(), 0.0].map(|f| f + 3.0 * noise());
        text += &format!("{t:.2},{:.5},{:.4},{:.4},{:.4}\n", rate + noise(), force[0], force[1], force[2]);
    }
    std::fs::write(at("swing.csv"), text).unwrap();
    let made = whorl(&["new", &at("swing.csv"), "--out", &at("rigs"), "--json", "-"]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let answer: serde_json::Value = serde_json::from_slice(&made.stdout).unwrap();
    assert_eq!(answer["to_be_mended"], serde_json::json!([]));
    let (map, model) = (at("rigs/swing.channels.yaml"), at("rigs/swing.yaml"));
    let compared = whorl(&[
        "compare",
        &at("swing.csv"),
        "--channels",
        &map,
        "--model",
        &model,
        "--html",
        &at("page.html"),
    ]);
    let said = String::from_utf8_lossy(&compared.stdout);
    assert!(compared.status.success() && said.contains("swing.csv, swing: the model"), "{said}");
    // Without --html the page is named by the file, and none is written over.
    for page in ["swing.compare.html", "swing.compare_2.html"] {
        let compared = whorl(&["compare", &at("swing.csv"), "--channels", &map, "--model", &model]);
        let said = String::from_utf8_lossy(&compared.stdout);
        assert!(
            compared.status.success() && said.contains(page) && folder.path().join(page).is_file(),
            "{said}"
        );
    }
    for command in ["compare", "report"] {
        let lines = refused(&[command, &at("swing.csv")]);
        assert!(lines[0].contains(&format!("`whorl new {}`", at("swing.csv"))), "{lines:?}");
    }
    // What is there is somebody's.
    let again = refused(&["new", &at("swing.csv"), "--out", &at("rigs")]);
    assert!(again[0].contains("is there already"), "{again:?}");
}

/// Whatever goes wrong, the secret is told, and where everything is.
#[test]
#[allow(clippy::unwrap_used, reason = "a test fails by panicking")]
fn a_demonstration_that_fails_tells_its_secret() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    assert!(whorl(&["init", &at("")]).status.success());
    let experiment = at("params/experiments/swing.yaml");
    let spoilt = std::fs::read_to_string(&experiment).unwrap().replace("kind: settle", "kind: stettle");
    std::fs::write(&experiment, spoilt).unwrap();
    let given = ["--effect", "bearing_viscous_friction", "--seed", "3", "--no-open"];
    let output = whorl(&[&["demo", "--root", &at(""), "--out", &at("demo")], &given[..]].concat());
    let (said, wrong) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(!output.status.success() && wrong.contains("kind = stettle: allowed: "), "{wrong}");
    assert!(
        said.contains("the secret was") && said.contains("bearing_viscous_friction: {c_n_m_s: 0.2"),
        "{said}"
    );
    assert!(said.contains("found: nothing so far") && said.contains(&at("demo")), "{said}");
}

#[test]
fn a_model_among_runs_is_said_to_be_one() {
    let lines = refused(&["history", &params("whorl_1.yaml"), "runs/a"]);
    let [line] = lines.as_slice() else { panic!("{lines:?}") };
    assert!(
        line.contains("is a platform's file and no run") && line.contains("whorl history runs/a --model"),
        "{line}"
    );
}

#[test]
fn no_text_of_a_file_steers_the_terminal() -> Result<(), std::io::Error> {
    let folder = tempfile::tempdir()?;
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).map(|()| path.display().to_string())
    };
    // Clipboard, title, screen.
    let hostile = "\x1b]52;c;cHduZWQ=\x07\x1b]0;T\x07\x1b[2J";
    let table = file("a.csv", &format!("t,wx,wy,wz,{hostile}evil\n0,0,0,1,2\n0.01,0,0,1,2\n"))?;
    let key = file("model.yaml", "\"\\e[31m\\e]0;T\\a\": 1\n")?;
    for arguments in [vec!["new", &table, "--no-questions"], vec!["history", &key]] {
        // What it writes stays there.
        let output = command(&arguments).current_dir(folder.path()).output()?;
        let said = [output.stdout, output.stderr].concat();
        let text = String::from_utf8_lossy(&said);
        assert!(!said.contains(&0x1b) && !said.contains(&7), "{arguments:?}: {text:?}");
        assert!(text.contains("\\u001b"), "{arguments:?} does not say what there is: {text}");
    }
    Ok(())
}
