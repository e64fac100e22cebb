//! The launch scripts, as a user runs them.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use rustix::process::Signal;
use tempfile::TempDir;
use whorl_bag::{RunDirectory, RunState};
use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::FormationState;

use crate::support::formation::STARTUP;
use crate::support::machine::{Load, Share};
use crate::support::process::Process;
use crate::support::watch::{Watch, route};
use crate::support::{binaries, measured, root, wait_for};
use whorl_tests::Domain;

const NODES: usize = 10;
/// For an experiment of half a minute, on a busy machine.
const RUN: Duration = Duration::from_secs(300);

/// The launch scripts in their own domain.
struct Laboratory {
    scripts: Vec<Process>,
    folder: TempDir,
    domain: Domain,
    _share: Share,
}

impl Laboratory {
    fn new() -> Self {
        let share = Load::Formation.take();
        binaries::folder();
        Self {
            scripts: Vec::new(),
            folder: tempfile::tempdir().unwrap(),
            domain: Domain::take(),
            _share: share,
        }
    }

    /// Starts `run_experiment.sh`.
    fn experiment(arguments: &[&str]) -> Self {
        let mut laboratory = Self::new();
        let out = laboratory.folder.path().join("runs");
        let arguments = [arguments, &["--out", out.to_str().unwrap()]].concat();
        let command = laboratory.command("run_experiment.sh", &arguments);
        let log = laboratory.folder.path().join("script_0.log");
        laboratory.scripts.push(Process::start_in_group("run_experiment.sh", command, &log));
        laboratory
    }

    fn command(&self, script: &str, arguments: &[&str]) -> Command {
        // A shell that was started with Ctrl-C ignored (in the background of another) could not obey it.
        let mut command = Command::new("env");
        command.arg("--default-signal=INT").arg(root().join("launch_scripts").join(script)).args(arguments);
        command.env("WHORL_BIN", binaries::folder()).env("ROS_DOMAIN_ID", self.domain.id.to_string());
        // Process ids of what was started, for stop_all.sh.
        command.env("XDG_RUNTIME_DIR", self.folder.path());
        command.env_remove("ROS_AUTOMATIC_DISCOVERY_RANGE");
        command
    }

    fn start(&mut self, script: &str, arguments: &[&str]) {
        let log = self.folder.path().join(format!("script_{}.log", self.scripts.len()));
        self.scripts.push(Process::start(script, self.command(script, arguments), &log));
    }

    /// The run directory, once there is one.
    fn run(&self) -> Option<PathBuf> {
        std::fs::read_dir(self.folder.path().join("runs")).ok()?.next()?.ok().map(|entry| entry.path())
    }

    /// Processes with our domain in their environment, the script's own children among them.
    fn processes(&self) -> Vec<String> {
        let wanted = format!("ROS_DOMAIN_ID={}", self.domain.id);
        let runtime = format!("XDG_RUNTIME_DIR={}", self.folder.path().display());
        let mut found = Vec::new();
        for entry in std::fs::read_dir("/proc").unwrap().flatten() {
            let Ok(environment) = std::fs::read(entry.path().join("environ")) else { continue };
            let has = |text: &str| environment.split(|b| *b == 0).any(|v| v == text.as_bytes());
            if has(&wanted) && has(&runtime) {
                let command = std::fs::read_to_string(entry.path().join("cmdline")).unwrap_or_default();
                found.push(format!("{} {}", entry.file_name().display(), command.replace('\0', " ")));
            }
        }
        found
    }

    fn log(&self) -> String {
        let mut text: String = self.scripts.iter().map(Process::log).collect();
        let logs = self.run().map(|run| run.join("logs"));
        for entry in logs.and_then(|folder| std::fs::read_dir(folder).ok()).into_iter().flatten().flatten() {
            let lines = std::fs::read_to_string(entry.path()).unwrap_or_default();
            let lines: Vec<&str> = lines.lines().collect();
            let last = lines[lines.len().saturating_sub(6)..].join("\n");
            text += &format!("--- {}:\n{last}\n", entry.path().display());
        }
        text
    }

    /// Waits for the end of the first script, and fails unless nothing is left.
    fn finish(&mut self, timeout: Duration) -> Option<i32> {
        let status = self.scripts[0].wait(timeout);
        let left = self.processes();
        assert!(left.is_empty(), "processes are left: {left:?}\n{}", self.log());
        status.code()
    }
}

fn assert_report(run: &Path, log: &str) {
    let page =
        std::fs::read_to_string(run.join("report.html")).unwrap_or_else(|e| panic!("no report: {e}\n{log}"));
    assert!(page.len() > 100_000, "a report of {} bytes", page.len());
    // Scripts, styles and pictures come with the page. (The plotting library's own text names addresses
    // that it would ask for maps.)
    for tag in ["<script", "<link", "<img", "<iframe"] {
        for (at, _) in page.match_indices(tag) {
            let text = &page[at..];
            let text = &text[..text.find('>').unwrap_or(text.len())];
            assert!(!text.contains("http") && !text.contains("//"), "the report needs the network: {text}");
        }
    }
}

fn readable(run: &Path) -> usize {
    let bag = RunDirectory::open(run).unwrap().bag().unwrap();
    bag.messages().inspect(|message| _ = message.as_ref().unwrap().decode().unwrap()).count()
}

/// How well it points is asserted in virtual time (`closed_loop::accuracy`): here, that the chain has it too, whatever else
/// keeps the machine busy.
#[test]
fn a_short_experiment_ends_well_and_leaves_a_run_with_its_report() {
    let mut script = Laboratory::experiment(&["leader_follower_short"]);
    wait_for("all processes", STARTUP, || {
        let nodes = script.processes().iter().filter(|p| p.contains("--ros-args")).count();
        (nodes >= NODES).then_some(())
    });
    let code = script.finish(RUN);
    let run = script.run().unwrap();
    assert_report(&run, &script.log());
    let summary = std::fs::read_to_string(run.join("summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    assert_eq!(summary["outcome"], "finished", "{}", script.log());
    let pair = &summary["pairs"][0];
    let error_deg = pair["relative_error_rms_rad"].as_f64().unwrap_or(f64::NAN).to_degrees();
    measured(&format!(
        "run_experiment.sh leader_follower_short: relative error in hold {error_deg:.4} deg RMS"
    ));
    assert!(error_deg.is_finite(), "{summary:#}");
    assert_eq!(pair["from_truth"], true, "{summary:#}");
    // One verdict: in the file, on the page, as the last line, and by the exit status.
    let verdict = &summary["verdict"];
    let line = verdict["line"].as_str().unwrap();
    let reasons = verdict["reasons"].as_array().unwrap();
    let (word, result, status) =
        if reasons.is_empty() { ("PASSED", "passed", 0) } else { ("FAILED", "failed", 1) };
    assert!(line.starts_with(word), "{line}: {reasons:?}");
    assert_eq!((verdict["result"].as_str().unwrap(), code), (result, Some(status)), "{}", script.log());
    let last = script.scripts[0].log().trim_end().lines().last().map(str::to_owned);
    assert_eq!(last, Some(format!("verdict: {line}")));
    // Pages have a sign for what a terminal writes as two.
    let page = std::fs::read_to_string(run.join("report.html")).unwrap().replace('\u{b1}', "+-");
    assert!(page.contains(line), "{line}: not on {}", run.join("report.html").display());

    let directory = RunDirectory::open(&run).unwrap();
    let manifest = directory.manifest().unwrap();
    assert_eq!(manifest.state, RunState::Complete);
    assert_eq!(readable(&run), usize::try_from(manifest.message_count()).unwrap());
    assert_eq!(manifest.description.experiment, "leader_follower_short");
    for platform in ["whorl_1", "whorl_2"] {
        for topic in
            ["imu/data_raw", "attitude/estimate", "attitude/reference", "control/status", "truth/state"]
        {
            let count = manifest.topic(&format!("/{platform}/{topic}")).map_or(0, |t| t.count);
            assert!(count > 100, "{platform}/{topic}: {count} messages");
        }
    }
}

#[test]
fn ctrl_c_in_the_middle_leaves_no_process_a_readable_bag_and_a_report() {
    let mut script = Laboratory::experiment(&["leader_follower_short"]);
    wait_for("the bag to grow", STARTUP, || {
        let bag = script.run()?.join("bag/bag_0.mcap");
        (std::fs::metadata(bag).ok()?.len() > 3_000_000).then_some(())
    });
    // The domain has its experiment: a second one does not mix with it.
    let second = script.command("run_experiment.sh", &["leader_follower_short"]).output().unwrap();
    let text = String::from_utf8_lossy(&second.stderr);
    assert!(second.status.code() == Some(2) && text.contains("in use"), "{:?}: {text}", second.status);
    script.scripts[0].signal(Signal::INT);
    let code = script.finish(STARTUP);
    assert_eq!(code, Some(130), "{}", script.log());
    let text = script.scripts[0].log();
    assert!(
        text.contains("verdict: FAILED: the experiment did not end") || text.contains("aborted"),
        "{text}"
    );
    assert!(!text.contains("NaN"), "{text}");
    let run = script.run().unwrap();
    assert_report(&run, &script.log());
    assert!(readable(&run) > 5000);
    assert_eq!(RunDirectory::open(&run).unwrap().manifest().unwrap().state, RunState::Complete);
}

#[test]
fn ctrl_c_at_any_moment_leaves_no_process_and_only_readable_runs() {
    // From the first line of the script on.
    ctrl_c_after(&[0.02, 1.0, 2.5]);
}

#[test]
#[ignore = "slow: Ctrl-C at five more moments"]
fn ctrl_c_at_more_moments_leaves_no_process_and_only_readable_runs() {
    ctrl_c_after(&[0.1, 0.3, 1.5, 4.0, 8.7]);
}

fn ctrl_c_after(moments_s: &[f64]) {
    for after_s in moments_s {
        let mut script = Laboratory::experiment(&["leader_follower_short"]);
        std::thread::sleep(Duration::from_secs_f64(*after_s));
        script.scripts[0].ctrl_c();
        // Impatience must not make it worse.
        std::thread::sleep(Duration::from_millis(300));
        script.scripts[0].ctrl_c();
        let code = script.finish(STARTUP);
        assert!(matches!(code, None | Some(130)), "after {after_s} s: {code:?}\n{}", script.log());
        let Some(run) = script.run().filter(|run| run.join("bag/metadata.yaml").exists()) else { continue };
        readable(&run);
        // Recovered by the report: the recorder was ended before it listened to signals.
        let state = RunDirectory::open(&run).unwrap().manifest().unwrap().state.clone();
        assert!(matches!(state, RunState::Complete | RunState::Recovered), "after {after_s} s: {state:?}");
    }
}

#[test]
fn a_node_that_dies_is_started_again_and_a_run_whose_recording_is_lost_fails() {
    // On a busy computer a node takes longer to come back than an experiment usually waits for it, and the end of the experiment would come
    // before the loss of its recording.
    let patient = tempfile::tempdir().unwrap();
    let file = patient.path().join("patient.yaml");
    let short =
        std::fs::read_to_string(root().join("params/experiments/leader_follower_short.yaml")).unwrap();
    let section = "/coordinator:\n  ros__parameters:\n";
    assert!(short.contains(section));
    let waits = format!("{section}    faults: {{timeout_s: 600.0}}\n    link: {{timeout_s: 600.0}}\n");
    std::fs::write(&file, short.replace(section, &waits)).unwrap();
    let mut script = Laboratory::experiment(&[file.to_str().unwrap()]);
    let told = |script: &Laboratory, words: &str| {
        wait_for(words, STARTUP, || script.scripts[0].log().contains(words).then_some(()));
    };
    wait_for("the bag to grow", STARTUP, || {
        let bag = script.run()?.join("bag/bag_0.mcap");
        (std::fs::metadata(bag).ok()?.len() > 1_000_000).then_some(())
    });
    let is_it = |p: &&String| p.contains("/local_control --ros-args") && p.contains("__ns:=/whorl_1");
    let victim = script.processes().iter().find(is_it).unwrap().clone();
    let id: i32 = victim.split(' ').next().unwrap().parse().unwrap();
    // Of a child of the script that this test has started.
    rustix::process::kill_process(rustix::process::Pid::from_raw(id).unwrap(), Signal::KILL).unwrap();
    told(&script, "whorl_1_local_control ended with status 137 and was started again");
    wait_for("the node that was started again", STARTUP, || {
        script.processes().iter().any(|p| is_it(&p) && *p != victim).then_some(())
    });

    // Nodes write logs and the recorder files meanwhile: a folder in which something has just been made is not empty.
    let run = script.run().unwrap();
    wait_for("the run directory to be gone", STARTUP, || {
        let removed = std::fs::remove_dir_all(&run);
        (removed.is_ok() || !run.exists()).then_some(())
    });
    let code = script.finish(RUN);
    let log = script.scripts[0].log();
    assert_eq!(code, Some(1), "{log}");
    // While it runs; or at its end, where the loss of the node has ended it before.
    let told = ["goes on without a recording", "recorder ended with status 1"];
    assert!(told.iter().any(|words| log.contains(words)), "{log}");
    assert!(log.trim_end().ends_with("verdict: FAILED: there is no complete recording"), "{log}");
}

#[test]
fn the_pieces_started_by_hand_make_a_formation_and_stop_all_stops_them() {
    let mut laboratory = Laboratory::new();
    let runs = laboratory.folder.path().join("runs");
    let watch = Watch::new(laboratory.domain.id, &["whorl_1", "whorl_2"]);
    let short = ["--experiment", "leader_follower_short", "--no-build"];
    laboratory.start("start_recorder.sh", &[&short[..], &["--out", runs.to_str().unwrap()]].concat());
    for platform in ["whorl_1", "whorl_2"] {
        laboratory.start("start_platform.sh", &[&[platform], &short[..]].concat());
    }
    laboratory.start("start_coordinator.sh", &[&short[..], &["--no-auto-start"]].concat());
    let state = route(0, Topic::FormationState);
    watch.wait_next::<FormationState>("the formation to be ready", state, STARTUP, |m| {
        m.phase == FormationState::PHASE_READY
    });
    // Through the command, as a user would.
    let whorl = |arguments: &[&str]| {
        let mut command = Command::new(binaries::path("whorl"));
        command.args(arguments).env("ROS_DOMAIN_ID", laboratory.domain.id.to_string());
        let output = command.output().unwrap();
        assert!(output.status.success(), "whorl {arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    };
    whorl(&["start", "leader_follower_short"]);
    watch.wait_next::<FormationState>("the start", state, STARTUP, |m| {
        m.phase == FormationState::PHASE_SETTLE
    });
    whorl(&["abort", "enough"]);
    watch.wait_next::<FormationState>("the abort", state, STARTUP, |m| {
        m.phase == FormationState::PHASE_ABORTED
    });

    let output = laboratory.command("stop_all.sh", &[]).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success() && text.contains(&format!("stopped {NODES} nodes")), "{text}");
    for script in &mut laboratory.scripts {
        script.wait(STARTUP);
    }
    let left = laboratory.processes();
    assert!(left.is_empty(), "processes are left: {left:?}\n{}", laboratory.log());
    assert!(readable(&laboratory.run().unwrap()) > 1000);
}

#[test]
fn the_scripts_say_what_is_wrong() {
    let _share = Load::Formation.take();
    let domain = Domain::take();
    let run = |arguments: &[&str]| {
        let mut command = Command::new(root().join("launch_scripts/run_experiment.sh"));
        let folder = tempfile::tempdir().unwrap();
        command.args(arguments).arg("--out").arg(folder.path()).env("WHORL_BIN", binaries::folder());
        command.env("ROS_DOMAIN_ID", domain.id.to_string()).env("XDG_RUNTIME_DIR", folder.path());
        let output = command.output().unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, text) = run(&["no_such_experiment"]);
    assert!(
        code == Some(2) && text.contains("no_such_experiment") && text.contains("leader_follower"),
        "{text}"
    );
    let (code, text) = run(&["leader_follower", "--backend", "toaster"]);
    assert!(code == Some(2) && text.contains("toaster"), "{text}");
    let (code, text) = run(&["leader_follower", "--backend", "whorl_7=sim"]);
    assert!(code == Some(2) && text.contains("whorl_7"), "{text}");
    let (code, text) = run(&["leader_follower", "--backend", "whorl_2=hardware"]);
    assert!(code == Some(1) && text.contains("/dev/whorl/"), "{text}");
    let (code, text) = run(&["leader_follower", "--platforms", "whorl_9"]);
    assert!(code == Some(2) && text.contains("whorl_9"), "{text}");
}
