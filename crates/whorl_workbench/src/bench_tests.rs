//! The state: jobs in order, stopped and failed ones, answers that hold and answers that do not.

use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::api::{Ask, Choice, SetChannel, State, Stretch};
use crate::bench::Workbench;

/// A pendulum with viscous friction that its model does not have, for some seconds at 100 Hz: small, and quickly compared.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut lines = String::from("t,gz,ux,uy,uz\n");
    let (mut angle, mut rate) = (0.05_f64, 0.0_f64);
    // A regular sequence in place of noise.
    let noise = |k: usize, of: usize| (((k * 7_919 + of) % 211) as f64 / 211.0 - 0.5) * 0.01;
    for k in 0..800 {
        lines += &format!(
            "{:.3},{:.6},{:.6},{:.6},0.0\n",
            k as f64 * 0.01,
            rate + noise(k, 3),
            (angle + noise(k, 57)).cos(),
            -(angle + noise(k, 57)).sin()
        );
        for _ in 0..10 {
            rate += 1e-3 * (-0.66 * angle.sin() - 3.5e-3 * rate) / 0.0075;
            angle += 1e-3 * rate;
        }
    }
    std::fs::write(folder.path().join("swing.csv"), lines).unwrap();
    let rig = "/rig/**:\n  ros__parameters:\n    model:\n      mass_kg: 0.77\n      inertia_kg_m2: {xx: 0.009, xy: 0.0, xz: 0.0, yy: 0.009, yz: 0.0, zz: 0.0075}\n      gravity_offset_n_m: [-0.66, 0.0, 0.0]\n      freedom: {kind: hinge, axis: [0.0, 0.0, 1.0]}\n      sensors:\n        rate_hz: 100.0\n        gyro: {axes: [z], noise_stddev_rad_s: 0.003, bias_turn_on_stddev_rad_s: 0.001}\n        vector: {reference_direction: [0.0, 0.0, 1.0], noise_stddev_rad: 0.003, rate_hz: 100.0}\n";
    std::fs::write(folder.path().join("rig.yaml"), rig).unwrap();
    let map = "csv:\n  ros__parameters:\n    time: {column: t, unit: s}\n    gyro: {columns: [~, ~, gz], unit: rad/s}\n    vector: {columns: [ux, uy, uz], reference_world: [0.0, 0.0, 1.0]}\n";
    std::fs::write(folder.path().join("map.yaml"), map).unwrap();
    folder
}

fn until(bench: &Arc<Workbench>, what: &str, holds: impl Fn(&State) -> bool) -> State {
    let begun = Instant::now();
    loop {
        let state = bench.state();
        if holds(&state) {
            return state;
        }
        assert!(begun.elapsed() < Duration::from_secs(300), "waited for {what}: {state:?}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn is_idle(state: &State) -> bool {
    state.job.is_none() && state.queue.is_empty()
}

fn error_of(bench: &Workbench) -> f64 {
    bench.answer("compare", None).unwrap().json["prediction_error"].as_f64().unwrap()
}

#[test]
fn an_answer_holds_as_long_as_its_files_and_undo_brings_it_back() {
    let folder = folder();
    let bench = crate::open(folder.path(), &[]).unwrap();
    let state = until(&bench, "a comparison", |state| is_idle(state) && !state.answers.is_empty());
    assert_eq!(state.choice.runs, ["swing.csv"]);
    assert_eq!((state.problem, state.looked[0].file.as_str()), (None, "swing.csv"));
    let before = error_of(&bench);
    assert!(before > 1.3, "the friction that is missing shows: {before}");

    // A number of the model is a step: the answer holds no longer, and another is asked for.
    let change = crate::work::set_parameter(&bench, "model.mass_kg", "0.8").unwrap().unwrap();
    assert!(
        change.before.contains("mass_kg: 0.77") && change.after.contains("mass_kg: 0.8"),
        "{}",
        change.after
    );
    bench.did("set", String::new());
    let state = bench.state();
    assert!(state.answers[0].is_stale && state.model.unwrap().steps == 1);
    for (key, value) in [
        ("model.mass_kg", "-1.0"),
        ("model.mass_kg", "heavy"),
        ("model.no_such", "1.0"),
        ("history.x", "1"),
        ("model.mass_kg", "1\nx: 2"),
    ] {
        assert!(crate::work::set_parameter(&bench, key, value).is_err(), "{key} = {value}");
        assert_eq!(
            std::fs::read_to_string(folder.path().join("rig.yaml")).unwrap(),
            change.after,
            "{key} = {value}"
        );
    }
    let (undone, said) = crate::work::undo(&bench).unwrap();
    assert_eq!(undone.unwrap().after, change.before);
    assert!(said.contains("rig.yaml is as before step 1"), "{said}");
    bench.did("undo", said);
    assert!(!bench.state().answers[0].is_stale, "it holds again");

    // An effect is adopted, and compared at once.
    bench.ask(Ask::Adopt { effects: vec!["bearing_viscous_friction".to_owned()], anyway: false }).unwrap();
    until(&bench, "an adoption", |state| {
        is_idle(state) && state.answers.iter().any(|a| a.what == "adopt" && !a.is_stale)
    });
    let after = error_of(&bench);
    assert!(after < 0.8 * before, "{before} -> {after}");
    assert_eq!(bench.answer("adopt", None).unwrap().changes[0].file, "rig.yaml");
    let page = crate::export::export(&bench).unwrap();
    assert!(page.contains("whorl adopt swing.csv bearing_viscous_friction --out rig.yaml"), "{page}");
    crate::work::undo(&bench).unwrap();
    bench.did("undo", String::new());
    assert_eq!(error_of(&bench), before, "kept from before");
}

#[test]
fn what_is_stopped_or_fails_leaves_the_rest_as_it_was() {
    let folder = folder();
    let bench = crate::open(folder.path(), &[]).unwrap();
    until(&bench, "a comparison", |state| is_idle(state) && !state.answers.is_empty());
    bench.ask(Ask::Diagnose).unwrap();
    bench.ask(Ask::Diagnose).unwrap();
    let state =
        until(&bench, "a diagnosis", |state| state.job.as_ref().is_some_and(|job| job.what == "diagnose"));
    let job = state.job.unwrap();
    bench.stop(job.number + 1);
    assert!(!bench.state().job.unwrap().stops, "another one");
    bench.clear();
    bench.stop(job.number);
    let state = until(&bench, "its end", is_idle);
    assert_eq!(state.notices.last().unwrap().kind, "stopped");
    assert!(state.answers.iter().all(|answer| answer.what != "diagnose"));

    bench.ask(Ask::Adopt { effects: vec!["no_such_effect".to_owned()], anyway: false }).unwrap();
    let state =
        until(&bench, "a failure", |state| state.notices.iter().any(|notice| notice.kind == "failed"));
    assert!(
        state.notices.last().unwrap().text.contains("there is no effect \"no_such_effect\""),
        "{:?}",
        state.notices
    );
    assert!(bench.ask(Ask::Look { file: "../x.csv".to_owned() }).is_err());
    for k in 0..20 {
        let asked = bench.ask(Ask::Adopt { effects: vec![format!("effect_{k}")], anyway: false });
        assert!(k < 10 || asked.is_ok() || asked.unwrap_err().to_string().contains("wait already"));
    }

    // Of a choice that cannot be nothing is kept.
    let given = bench.choice();
    let twice = Choice { held_out: given.runs.clone(), ..given.clone() };
    assert!(bench.choose(twice).unwrap_err().to_string().contains("both"));
    let gone = Choice { runs: vec!["gone.csv".to_owned()], ..given.clone() };
    assert!(bench.choose(gone).is_err());
    assert_eq!(bench.choice(), given);
    // The next time it is as it was left.
    let excluding = Choice { exclude: vec!["sloshing".to_owned()], ..given };
    bench.choose(excluding.clone()).unwrap();
    assert_eq!(crate::open(folder.path(), &[]).unwrap().choice(), excluding);
}

#[test]
fn columns_are_corrected_and_a_stretch_takes_the_place_of_the_whole() {
    let folder = folder();
    let bench = crate::open(folder.path(), &[]).unwrap();
    until(&bench, "a comparison", |state| is_idle(state) && !state.answers.is_empty());
    let shown = crate::work::map(&bench).unwrap();
    assert_eq!(shown.columns, ["t", "gz", "ux", "uy", "uz"]);
    let gyro = shown.rows.iter().find(|row| row.key == "gyro").unwrap();
    assert_eq!(
        (gyro.columns.as_slice(), gyro.unit.as_deref()),
        (["~", "~", "gz"].map(str::to_owned).as_slice(), Some("rad/s"))
    );
    let wanted = |columns: [&str; 3], unit: &str| SetChannel {
        key: "gyro".to_owned(),
        columns: columns.map(str::to_owned).to_vec(),
        unit: Some(unit.to_owned()),
    };
    let change = crate::work::set_channel(&bench, &wanted(["~", "~", "-gz"], "deg/s")).unwrap().unwrap();
    assert!(change.after.contains("-gz") && change.after.contains("deg/s"), "{}", change.after);
    let gyro = crate::work::map(&bench).unwrap().rows.into_iter().find(|row| row.key == "gyro").unwrap();
    assert_eq!((gyro.columns[2].as_str(), gyro.unit.as_deref()), ("-gz", Some("deg/s")));
    for wrong in [
        wanted(["~", "~", "gz"], "furlong"),
        SetChannel { key: "smell".to_owned(), ..wanted(["~", "~", "gz"], "rad/s") },
    ] {
        assert!(crate::work::set_channel(&bench, &wrong).is_err(), "{wrong:?}");
        assert_eq!(std::fs::read_to_string(folder.path().join("map.yaml")).unwrap(), change.after);
    }

    let asked = |from_s: f64, to_s: f64, held_out: bool| Stretch {
        file: "swing.csv".to_owned(),
        from_s,
        to_s,
        held_out,
    };
    let name = crate::work::stretch(&bench, &asked(0.0, 5.0, false)).unwrap();
    assert_eq!(name, "swing_0.00_to_5.00_s.csv");
    let lines = std::fs::read_to_string(folder.path().join(&name)).unwrap();
    assert_eq!(lines.lines().count(), 1 + 501);
    assert!(crate::work::stretch(&bench, &asked(0.0, 5.0, true)).is_err(), "it is there");
    assert!(crate::work::stretch(&bench, &asked(5.0, 5.0, true)).is_err());
}

#[test]
fn files_that_change_by_other_hands_are_noticed() {
    let folder = folder();
    let bench = crate::open(folder.path(), &[folder.path().join("swing.csv")]).unwrap();
    until(&bench, "a comparison", |state| is_idle(state) && !state.answers.is_empty());
    let rig = folder.path().join("rig.yaml");
    let text = std::fs::read_to_string(&rig).unwrap();
    std::fs::write(&rig, text.replace("mass_kg: 0.77", "mass_kg: 0.9 # weighed")).unwrap();
    until(&bench, "a stale answer", |state| state.answers[0].is_stale);
    std::fs::write(&rig, text.replace("mass_kg", "mass_of")).unwrap();
    // A look while the file is being written sees no text.
    until(&bench, "the problem", |state| state.problem.as_ref().is_some_and(|text| text.contains("mass_of")));
    assert!(crate::open(folder.path(), &[folder.path().join("none.csv")]).is_err());
}
