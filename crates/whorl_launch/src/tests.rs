use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use whorl_node::Node;

use super::*;

fn params() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params")
}

fn options(experiment: &str) -> SetupOptions {
    SetupOptions {
        experiment: experiment.into(),
        params: params(),
        params_of_whorl: params(),
        seed: 7,
        ..SetupOptions::default()
    }
}

/// Arguments with the parameter folder left out of the paths.
fn words(process: &Process) -> String {
    let folder = format!("{}/", params().display());
    let words: Vec<String> =
        process.arguments.iter().map(|word| word.to_string_lossy().into_owned()).collect();
    words.join(" ").replace(&folder, "")
}

#[test]
fn an_experiment_starts_the_recorder_first_and_the_coordinator_last() {
    let setup = Setup::new(options("leader_follower_short")).unwrap();
    let processes = setup.everything(Path::new("runs/x"), Some("123"));
    let labels: Vec<&str> = processes.iter().map(|p| p.label.as_str()).collect();
    assert_eq!(
        labels,
        [
            "recorder",
            "whorl_1_driver",
            "whorl_1_estimator",
            "whorl_1_local_control",
            "whorl_1_model_monitor",
            "whorl_2_driver",
            "whorl_2_estimator",
            "whorl_2_local_control",
            "whorl_2_model_monitor",
            "coordinator"
        ]
    );
    assert_eq!(
        words(&processes[0]),
        "--ros-args --params-file common.yaml --params-file whorl_1.yaml --params-file truth/whorl_1.yaml \
         --params-file whorl_2.yaml --params-file truth/whorl_2.yaml --params-file \
         experiments/leader_follower_short.yaml -p formation.platforms:=[whorl_1,whorl_2] -p \
         run_directory:=runs/x -p seed:=7 -p git_commit:='123'"
    );
    // Truth is the driver's alone; who commands does not know it.
    assert_eq!(
        words(&processes[5]),
        "--ros-args -r __ns:=/whorl_2 --params-file common.yaml --params-file whorl_2.yaml --params-file \
         truth/whorl_2.yaml --params-file experiments/leader_follower_short.yaml -p backend:=sim -p seed:=7"
    );
    for process in processes.iter().filter(|p| !matches!(p.node, Node::Driver | Node::Recorder)) {
        assert!(!words(process).contains("truth/"), "{}", words(process));
    }
}

#[test]
fn each_platform_gets_a_coordinator_where_the_law_runs_on_platforms() {
    let setup = Setup::new(options("decentralised_on_platforms")).unwrap();
    let own: Vec<String> = setup.platform("whorl_2").into_iter().map(|p| p.label).collect();
    let expected = ["driver", "estimator", "local_control", "model_monitor", "coordinator"]
        .map(|node| format!("whorl_2_{node}"));
    assert_eq!(own, expected);
}

#[test]
fn drivers_are_told_what_they_drive() {
    let replayed = DriverSource {
        backend: Backend::Replay,
        source: Some("a.csv".into()),
        channels: None,
        emulated: None,
    };
    let drivers = BTreeMap::from([("whorl_1".to_owned(), replayed)]);
    let options =
        SetupOptions { drivers, backend_of_others: Backend::Hardware, ..options("leader_follower_short") };
    let setup = Setup::new(options).unwrap();
    let driver = |platform: &str| words(&setup.platform(platform)[0]);
    assert!(driver("whorl_1").ends_with("-p backend:=replay -p seed:=7 -p replay.source:=a.csv"));
    assert!(driver("whorl_2").ends_with("-p backend:=hardware -p seed:=7"));
}

#[test]
fn what_is_not_there_is_named_before_anything_starts() {
    let refused = |options: SetupOptions| Setup::new(options).unwrap_err().to_string();
    let text = refused(options("nothing"));
    assert!(text.contains("'nothing'") && text.contains("leader_follower_short"), "{text}");
    let platforms = Some(vec!["whorl_9".to_owned()]);
    let text = refused(SetupOptions { platforms, ..options("swing") });
    assert!(text.contains("'whorl_9'") && text.contains("whorl_9.yaml"), "{text}");
    let drivers = BTreeMap::from([("whorl_7".to_owned(), DriverSource::default())]);
    let text = refused(SetupOptions { drivers, ..options("leader_follower_short") });
    assert!(text.contains("'whorl_7' among: whorl_1 whorl_2"), "{text}");

    let text = refused(options(""));
    assert!(text.starts_with("name an experiment: ") && text.contains(" swing "), "{text}");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mistyped.yaml");
    let experiment =
        std::fs::read_to_string(params().join("experiments/leader_follower_short.yaml")).unwrap();
    std::fs::write(&file, experiment.replace("/whorl_2/driver:", "/whorl_2/drivr:")).unwrap();
    let text = refused(options(file.to_str().unwrap()));
    assert!(text.contains("section /whorl_2/drivr matches no node; did you mean /whorl_2/driver?"), "{text}");
}

/// An experiment with one of its platforms only: what it says of the other is no mistake.
#[test]
fn a_platform_may_be_left_out() {
    let platforms = Some(vec!["whorl_1".to_owned()]);
    let setup = Setup::new(SetupOptions { platforms, ..options("leader_follower_short") }).unwrap();
    // Driver, estimator, local control and model monitor; coordinator and recorder.
    assert_eq!(setup.everything(Path::new("x"), None).len(), 6);
}

#[test]
fn a_domain_is_for_one_experiment_or_for_pieces_that_are_there_once() {
    let folder = tempfile::tempdir().unwrap();
    let domain = || Domain::at(3, folder.path().join("state"), folder.path());
    let experiment = domain().take().unwrap();
    let text = domain().take().unwrap_err().to_string();
    assert!(text.contains("ROS domain 3") && text.contains("stop_all.sh"), "{text}");
    assert!(domain().share("whorl_1").unwrap_err().to_string().contains("an experiment"));
    // A program that inherits the lease and has nothing to do with it does not keep the domain.
    let mut stranger = Command::new("sleep").arg("60").spawn().unwrap();
    drop(experiment);
    let first = domain().share("whorl_1");
    stranger.kill().unwrap();
    stranger.wait().unwrap();
    let _first = first.unwrap();
    let _second = domain().share("whorl_2").unwrap();
    assert!(domain().share("whorl_1").unwrap_err().to_string().contains("another whorl_1"));
    assert!(domain().take().is_err());
    // Another domain is another matter.
    Domain::at(4, folder.path().join("other"), folder.path()).take().unwrap();
}

/// Programs that write down when they start and end. Another process makes them executable: a file that this process
/// has written could still be open for writing in a child that another test has just forked ("text file busy").
fn programs(folder: &Path, text: &str) -> Programs {
    for node in [Node::Driver, Node::Recorder, Node::Coordinator] {
        let path = folder.join(node.name());
        let text = text.replace("NAME", node.name()).replace("FOLDER", &folder.display().to_string());
        let script = path.with_extension("sh");
        std::fs::write(&script, format!("#!/bin/sh\n{text}\n")).unwrap();
        let copied = Command::new("install").args(["-m", "755"]).args([&script, &path]).status().unwrap();
        assert!(copied.success());
    }
    Programs::in_folder(folder)
}

fn started(folder: &Path, text: &str) -> Supervisor {
    let programs = programs(folder, text);
    let mut supervisor = Supervisor::new(Domain::at(1, folder.join("state"), folder));
    for node in [Node::Recorder, Node::Driver] {
        let process = Process { label: node.name().to_owned(), node, arguments: Vec::new() };
        supervisor.start(&programs, process, &folder.join("logs")).unwrap();
    }
    supervisor
}

fn wait_for(what: &str, mut condition: impl FnMut() -> bool) {
    let began = Instant::now();
    while !condition() {
        assert!(began.elapsed() < Duration::from_secs(120), "waited for {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn the_recorder_is_stopped_last() {
    let folder = tempfile::tempdir().unwrap();
    let text =
        "trap 'sleep 0.2; echo NAME >>FOLDER/order; exit 0' TERM; echo up; while :; do sleep 0.01; done";
    let mut supervisor = started(folder.path(), text);
    let log = |name: &str| {
        std::fs::read_to_string(folder.path().join(format!("logs/{name}.log"))).unwrap_or_default()
    };
    wait_for("both", || log("driver") == "up\n" && log("recorder") == "up\n");
    assert!(folder.path().join("state/driver.pid").is_file());
    assert!(supervisor.ended().is_none());
    let stopped = supervisor.stop();
    assert!(stopped.killed.is_empty() && stopped.failed.is_empty(), "{stopped:?}");
    assert_eq!(std::fs::read_to_string(folder.path().join("order")).unwrap(), "driver\nrecorder\n");
    assert!(!folder.path().join("state/driver.pid").exists());
}

#[test]
fn what_does_not_stop_is_killed_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let mut supervisor =
        started(folder.path(), "[ NAME = recorder ] || trap '' TERM; echo up; while :; do sleep 0.01; done");
    wait_for("the driver", || {
        std::fs::read_to_string(folder.path().join("logs/driver.log")).is_ok_and(|text| text == "up\n")
    });
    let stopped = supervisor.stop();
    assert_eq!(stopped.killed, ["driver"]);
    assert!(stopped.failed.is_empty(), "{stopped:?}");
}

#[test]
fn a_process_that_fails_is_reported_once_with_its_last_words() {
    // One that ended as it began has said why at once.
    for (status, first, last) in [(3, "12\n", "30\nno device"), (2, "1\n", "\n20")] {
        let folder = tempfile::tempdir().unwrap();
        let text =
            format!("[ NAME = driver ] && {{ seq 1 30; echo no device >&2; exit {status}; }}; exec sleep 60");
        let mut supervisor = started(folder.path(), &text);
        let mut ended = None;
        wait_for("its end", || {
            ended = supervisor.ended();
            ended.is_some()
        });
        let ended = ended.unwrap();
        assert_eq!((ended.label.as_str(), ended.status.code()), ("driver", Some(status)));
        let words = ended.last_words();
        assert!(words.starts_with(first) && words.ends_with(last), "{words}");
        assert!(supervisor.ended().is_none());
    }
}

#[test]
fn a_process_that_ends_by_accident_is_started_again_and_then_waits() {
    let folder = tempfile::tempdir().unwrap();
    // As when the kernel refuses memory.
    let text = "[ NAME = driver ] && { echo up; kill -ABRT $$; }; exec sleep 60";
    let mut supervisor = started(folder.path(), text);
    let mut started_again = 0;
    loop {
        let mut ended = None;
        wait_for("its end", || {
            ended = supervisor.ended();
            ended.is_some()
        });
        let ended = ended.unwrap();
        assert!(ended.by_accident() && ended.label == "driver", "{ended:?}");
        let wait = supervisor.restart("driver").unwrap().unwrap();
        if wait > Duration::ZERO {
            assert_eq!(wait, Duration::from_secs(5));
            break;
        }
        started_again += 1;
    }
    assert_eq!(started_again, 5);
    let log = std::fs::read_to_string(folder.path().join("logs/driver.log")).unwrap();
    assert_eq!(log.matches("up").count(), 6, "its log goes on: {log}");
    assert!(supervisor.restart("recorder").unwrap().is_none(), "it runs");
    assert!(supervisor.start_due().is_empty(), "not yet");
    let mut due = Vec::new();
    wait_for("its time", || {
        due = supervisor.start_due();
        !due.is_empty()
    });
    assert!(due.len() == 1 && due[0].0 == "driver" && due[0].1.is_ok(), "{due:?}");
    wait_for("its end", || supervisor.ended().is_some());
    assert_eq!(supervisor.restart("driver").unwrap(), Some(Duration::from_secs(10)), "it is not given up");
}

#[test]
fn a_recorder_that_is_started_again_records_into_a_directory_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let text = "echo $2; [ $2 = run_directory:=runs/a_part3 ] && exec sleep 60; kill -KILL $$";
    let programs = programs(folder.path(), text);
    let mut supervisor = Supervisor::new(Domain::at(1, folder.path().join("state"), folder.path()));
    let arguments = ["-p", "run_directory:=runs/a"].map(Into::into).to_vec();
    let process = Process { label: "recorder".to_owned(), node: Node::Recorder, arguments };
    let logs = folder.path().join("logs");
    supervisor.start(&programs, process, &logs).unwrap();
    for _ in 0..2 {
        wait_for("its end", || supervisor.ended().is_some());
        assert_eq!(supervisor.restart("recorder").unwrap(), Some(Duration::ZERO));
    }
    let log = || std::fs::read_to_string(logs.join("recorder.log")).unwrap();
    wait_for("the third", || log().lines().count() == 3);
    let lines = ["run_directory:=runs/a", "run_directory:=runs/a_part2", "run_directory:=runs/a_part3"];
    assert_eq!(log().lines().collect::<Vec<_>>(), lines);
}

#[test]
fn a_coordinator_that_is_started_again_finds_what_it_kept_and_a_new_experiment_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let text = "f=$WHORL_PROGRESS_FILE; cat $f 2>/dev/null && exec sleep 60; echo begins; echo goes on >$f; kill -KILL $$";
    let programs = programs(folder.path(), text);
    let logs = folder.path().join("logs");
    let log = || std::fs::read_to_string(logs.join("coordinator.log")).unwrap_or_default();
    let domain = || Domain::at(1, folder.path().join("state"), folder.path());
    let process =
        || Process { label: "coordinator".to_owned(), node: Node::Coordinator, arguments: Vec::new() };
    for _ in 0..2 {
        let mut supervisor = Supervisor::new(domain());
        supervisor.start(&programs, process(), &logs).unwrap();
        wait_for("its end", || supervisor.ended().is_some());
        // As after a launcher that was killed.
        let left = std::fs::read(domain().progress("coordinator")).unwrap();
        supervisor.restart("coordinator").unwrap();
        wait_for("the second", || log() == "begins\ngoes on\n");
        supervisor.stop();
        assert!(!domain().progress("coordinator").exists(), "an experiment that is over leaves nothing");
        std::fs::write(domain().progress("coordinator"), left).unwrap();
    }
}

#[test]
fn a_process_that_says_at_its_end_that_it_failed_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let text = "[ NAME = recorder ] && trap 'echo the disk was full; exit 1' TERM; echo up; while :; do sleep 0.01; done";
    let mut supervisor = started(folder.path(), text);
    wait_for("the recorder", || {
        std::fs::read_to_string(folder.path().join("logs/recorder.log")).is_ok_and(|text| text == "up\n")
    });
    let stopped = supervisor.stop();
    let failed: Vec<_> =
        stopped.failed.iter().map(|ended| (ended.label.as_str(), ended.last_words())).collect();
    assert_eq!(failed, [("recorder", "up\nthe disk was full".to_owned())]);
}

/// A node is told of the launcher's end, however it ends, by the end of its standard input.
#[test]
fn a_node_reads_an_input_that_ends_with_the_launcher() {
    let folder = tempfile::tempdir().unwrap();
    let text = "trap '' TERM; echo $WHORL_ENDS_WITH_INPUT; cat; echo ended >>FOLDER/NAME.ended";
    let mut supervisor = started(folder.path(), text);
    let log = || std::fs::read_to_string(folder.path().join("logs/driver.log")).unwrap_or_default();
    wait_for("the driver", || log() == "1\n");
    assert!(supervisor.ended().is_none(), "it reads");
    // As the kernel does for a process that is killed.
    supervisor.let_go();
    wait_for("its end", || folder.path().join("driver.ended").exists());
}

#[test]
fn stopping_a_domain_ends_nodes_of_other_supervisors_and_no_other_program() {
    let folder = tempfile::tempdir().unwrap();
    let domain = Domain::at(1, folder.path().join("state"), folder.path());
    // This test is no node: its id may stand in a file of a node that has ended long ago.
    domain.remember_self("recorder");
    assert_eq!(domain.stop(), (0, 0));
    assert!(!folder.path().join("state").exists());
}

#[test]
fn real_time_is_for_the_control_loop_alone_and_from_its_first_instruction_on() {
    let refused = RealTime::on(vec![100_000]).unwrap_err().to_string();
    assert!(refused.contains("--cpus 100000") || refused.contains("limits.d"), "{refused}");
    let real_time = match RealTime::on(vec![0]) {
        Ok(real_time) => real_time,
        Err(error) => {
            eprintln!("SKIPPED real-time priority: {error}");
            return;
        }
    };
    let folder = tempfile::tempdir().unwrap();
    // What the kernel says of the shell, and of a program that it starts.
    let text = "sed -n 1p /proc/$$/stat; echo $WHORL_LOCK_MEMORY; grep Cpus_allowed_list /proc/self/status; exec sleep 60";
    let programs = programs(folder.path(), text);
    let mut supervisor = Supervisor::new(Domain::at(1, folder.path().join("state"), folder.path()))
        .with_real_time(Some(real_time));
    let logs = folder.path().join("logs");
    for node in [Node::Recorder, Node::Driver] {
        let process = Process { label: node.name().to_owned(), node, arguments: Vec::new() };
        supervisor.start(&programs, process, &logs).unwrap();
    }
    let log = |name: &str| std::fs::read_to_string(logs.join(format!("{name}.log"))).unwrap_or_default();
    wait_for("both", || log("driver").contains("Cpus") && log("recorder").contains("Cpus"));
    // proc(5): fields 40 and 41 are the real-time priority and the policy, 1 SCHED_FIFO; the name may hold blanks.
    let scheduling = |name: &str| {
        let log = log(name);
        let fields: Vec<u32> = log
            .lines()
            .next()
            .unwrap()
            .rsplit(") ")
            .next()
            .unwrap()
            .split(' ')
            .skip(37)
            .take(2)
            .map(|field| field.parse().unwrap())
            .collect();
        (fields[0], fields[1])
    };
    assert_eq!((scheduling("driver"), scheduling("recorder")), ((49, 1), (0, 0)));
    assert_eq!(log("driver").lines().skip(1).collect::<Vec<_>>(), ["1", "Cpus_allowed_list:\t0"]);
    assert_eq!(log("recorder").lines().nth(1), Some(""));
    // This process is what it was.
    let own = std::fs::read_to_string("/proc/self/stat").unwrap();
    assert_eq!(own.rsplit(") ").next().unwrap().split(' ').nth(38), Some("0"));
}

/// Links, folders and files that another user of the computer may have prepared in the temporary directory.
#[test]
fn a_folder_that_others_prepared_is_not_written_to() {
    use std::os::unix::fs::{PermissionsExt as _, symlink};
    let temporary = tempfile::tempdir().unwrap();
    let victim = temporary.path().join("victim");
    std::fs::write(&victim, "precious").unwrap();
    let state = temporary.path().join("state");
    let domain = || Domain::at(7, state.clone(), temporary.path());
    let refused = |what: &str| {
        let text = domain().take().unwrap_err().to_string();
        assert!(text.contains(what) && text.contains("XDG_RUNTIME_DIR"), "{what}: {text}");
        domain().remember_supervisor("experiment");
        assert_eq!(domain().stop(), (0, 0));
        assert!(domain().emulated("whorl_1").is_none());
    };

    // A folder that all may write to, with links in it.
    std::fs::create_dir(&state).unwrap();
    std::fs::set_permissions(&state, std::fs::Permissions::from_mode(0o777)).unwrap();
    symlink(&victim, state.join("experiment.supervisor")).unwrap();
    refused("other users");
    // A link to a folder of this user.
    std::fs::remove_dir_all(&state).unwrap();
    let elsewhere = temporary.path().join("elsewhere");
    std::fs::create_dir(&elsewhere).unwrap();
    symlink(&elsewhere, &state).unwrap();
    refused("is no folder");
    assert_eq!(std::fs::read_dir(&elsewhere).unwrap().count(), 0);
    // A folder of another user, where this test may make one.
    std::fs::remove_file(&state).unwrap();
    std::fs::create_dir(&state).unwrap();
    if std::os::unix::fs::chown(&state, Some(65534), Some(65534)).is_ok() {
        refused("belongs to the user with the number 65534");
    }
    std::fs::remove_dir(&state).unwrap();

    // Made here, it is for this user alone, and links in it are replaced.
    let lease = domain().take().unwrap();
    assert_eq!(std::fs::metadata(&state).unwrap().permissions().mode() & 0o777, 0o700);
    symlink(&victim, state.join("experiment.supervisor")).unwrap();
    domain().remember_supervisor("experiment");
    assert!(std::fs::symlink_metadata(state.join("experiment.supervisor")).unwrap().is_file());
    drop(lease);
    // The lock, which all users share.
    let lock = temporary.path().join("whorl-domain-7.lock");
    std::fs::remove_file(&lock).unwrap();
    let nowhere = temporary.path().join("nowhere");
    symlink(&nowhere, &lock).unwrap();
    assert!(domain().take().is_err());
    assert!(!nowhere.exists(), "a link was followed to make its target");
    assert_eq!(std::fs::read_to_string(&victim).unwrap(), "precious");
}
