//! Every way in which a person can hold an experiment that `whorl run --live` runs, open and secured: whoever can stop the
//! experiment in one way can do so in all.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::PathBuf;
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process, test_kill_process};
use whorl_msgs::topics::{ExperimentResponse, Service, Topic};
use whorl_msgs::whorl::FormationState;
use whorl_msgs::whorl::srv::{AbortExperimentRequest, HoldExperimentRequest, StartExperimentRequest};
use whorl_ros::{Participant, ServiceClient};
use whorl_security::policy::OPERATOR;

use crate::support::formation::{Formation, LONG_HOLD_ALONE, SECURITY_VARIABLES, STARTUP};
use crate::support::machine::Load;
use crate::support::watch::{Watch, route};
use crate::support::{binaries, root, wait_for};

const REASON: &str = "a cable hangs";

/// A busy machine is no reason to end the experiment before anybody has held it.
const PATIENCE: &str =
    "    faults: {timeout_s: 600.0}\n    link: {timeout_s: 600.0}\n    waiting: {timeout_s: 600.0}\n";
const SECTION: &str = "/coordinator:\n  ros__parameters:\n";

/// What is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Verb {
    Hold,
    Start,
    Abort,
}

impl Verb {
    fn word(self) -> &'static str {
        match self {
            Self::Hold => "hold",
            Self::Start => "start",
            Self::Abort => "abort",
        }
    }
}

/// A way to ask; the error is what a person reads.
type Way = fn(&Run, Verb) -> Result<(), String>;

const WAYS: [(&str, Way); 3] =
    [("the command line", by_command), ("the live page", by_page), ("a script with a ROS client", by_script)];

/// `whorl run --live`, started as a user does.
struct Run {
    formation: Formation,
    watch: Watch,
}

impl Run {
    fn start(secured: bool) -> Self {
        let formation = Formation::with_load(Load::Formation, &["whorl_1"], &[]);
        let mut formation = if secured { formation.secured() } else { formation };
        let watch = formation.watch();
        let experiment = formation.folder().join("long_hold.yaml");
        let patient = LONG_HOLD_ALONE.replacen(SECTION, &format!("{SECTION}{PATIENCE}"), 1);
        assert!(patient.contains(PATIENCE));
        std::fs::write(&experiment, patient).unwrap();
        let mut command = formation.command(None, &binaries::path("whorl"));
        command.arg("run").arg(&experiment).arg("--root").arg(root()).arg("--out");
        command.arg(formation.folder().join("runs")).args(["--live", "--live-port", "0"]);
        command.args(["--platforms", "whorl_1"]);
        command.env("XDG_RUNTIME_DIR", formation.folder());
        if secured {
            // The keys are chosen; that they are used is the option's doing.
            SECURITY_VARIABLES.iter().for_each(|name| _ = command.env_remove(name));
            command.arg("--secure");
        }
        formation.adopt("run", command);
        let mut run = Self { formation, watch };
        run.formation.wait_for_step(&run.watch, "hold");
        run
    }

    /// Address of the page and its token.
    fn page(&self) -> (String, String) {
        wait_for("the address", STARTUP, || {
            let log = std::fs::read_to_string(self.formation.folder().join("run.log")).ok()?;
            let (_, rest) = log.split_once("live at http://")?;
            let (address, token) = rest.lines().next()?.trim().split_once("/#token=")?;
            Some((address.to_owned(), token.to_owned()))
        })
    }

    /// Process of the live page.
    fn process_of_page(&self) -> Pid {
        wait_for("the page's process", STARTUP, || {
            let user = rustix::process::getuid().as_raw();
            let folder =
                self.formation.folder().join(format!("whorl-{user}-domain-{}", self.formation.domain()));
            let id = std::fs::read_to_string(folder.join("live.screen")).ok()?;
            Pid::from_raw(id.trim().parse().ok()?)
        })
    }

    fn wait_until(&self, what: &str, is_so: impl Fn(&FormationState) -> bool) {
        self.watch.wait_next::<FormationState>(what, route(0, Topic::FormationState), STARTUP, is_so);
    }

    /// It is held in each way and goes on in the same way.
    fn is_held_in_all_ways(&self) {
        for (name, way) in WAYS {
            let asked = |verb: Verb| {
                way(self, verb).unwrap_or_else(|error| panic!("{name}: {verb:?} is refused: {error}"));
            };
            asked(Verb::Hold);
            self.wait_until(&format!("a hold by {name}"), |m| m.step.ends_with("(waiting)"));
            asked(Verb::Start);
            self.wait_until(&format!("going on by {name}"), |m| !m.step.ends_with("(waiting)"));
        }
    }

    /// What runs of it, by the environment.
    fn processes(&self) -> Vec<PathBuf> {
        let domain = format!("ROS_DOMAIN_ID={}", self.formation.domain());
        let folder = format!("XDG_RUNTIME_DIR={}", self.formation.folder().display());
        let entries = std::fs::read_dir("/proc").unwrap().flatten().map(|entry| entry.path());
        entries
            .filter(|path| {
                let environment = std::fs::read(path.join("environ")).unwrap_or_default();
                let has = |text: &str| environment.split(|byte| *byte == 0).any(|v| v == text.as_bytes());
                has(&domain) && has(&folder)
            })
            .collect()
    }
}

fn by_command(run: &Run, verb: Verb) -> Result<(), String> {
    let mut command = run.formation.command(None, &binaries::path("whorl"));
    command.arg(verb.word());
    if verb != Verb::Start {
        command.arg(REASON);
    }
    let output = command.output().unwrap();
    if output.status.success() { Ok(()) } else { Err(String::from_utf8_lossy(&output.stderr).into_owned()) }
}

fn by_page(run: &Run, verb: Verb) -> Result<(), String> {
    let (address, token) = run.page();
    let body = if verb == Verb::Start { "" } else { REASON };
    let mut stream = TcpStream::connect(&address).map_err(|error| error.to_string())?;
    stream.set_read_timeout(Some(STARTUP)).unwrap();
    let request = format!(
        "POST /{} HTTP/1.1\r\nHost: {address}\r\nAuthorization: Bearer {token}\r\nContent-Length: {}\r\n\
         Connection: close\r\n\r\n{body}",
        verb.word(),
        body.len()
    );
    stream.write_all(request.as_bytes()).map_err(|error| error.to_string())?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).map_err(|error| error.to_string())?;
    if answer.starts_with("HTTP/1.1 200") { Ok(()) } else { Err(answer) }
}

fn by_script(run: &Run, verb: Verb) -> Result<(), String> {
    let participant =
        Participant::new(&run.formation.network(OPERATOR)).map_err(|error| error.to_string())?;
    let answer = match verb {
        Verb::Hold => {
            ask(&participant, Service::HoldExperiment, &HoldExperimentRequest { reason: REASON.to_owned() })
        }
        Verb::Start => {
            ask(&participant, Service::StartExperiment, &StartExperimentRequest { experiment: String::new() })
        }
        Verb::Abort => {
            ask(&participant, Service::AbortExperiment, &AbortExperimentRequest { reason: REASON.to_owned() })
        }
    }?;
    if answer.success { Ok(()) } else { Err(answer.message) }
}

fn ask(
    participant: &Participant,
    service: Service,
    request: &impl serde::Serialize,
) -> Result<ExperimentResponse, String> {
    let client = ServiceClient::new(participant, service.name(), service.type_name())
        .map_err(|error| error.to_string())?;
    client.call(participant, request, Duration::from_secs(30)).map_err(|error| error.to_string())
}

#[test]
fn a_run_is_held_in_every_way_and_its_page_comes_back_and_ends_with_it() {
    let mut run = Run::start(false);
    run.is_held_in_all_ways();

    // Whatever ends the page's process: the page is there again, at the same address and with the same token.
    let before = run.process_of_page();
    kill_process(before, Signal::KILL).unwrap();
    wait_for("the page that was started again", STARTUP, || (run.process_of_page() != before).then_some(()));
    wait_for("the page to hold", STARTUP, || by_page(&run, Verb::Hold).ok());
    run.wait_until("a hold by the page that was started again", |m| m.step.ends_with("(waiting)"));

    // Whatever ends the launcher takes everything along.
    let page = run.process_of_page();
    run.formation.kill("run");
    wait_for("everything to end", STARTUP, || run.processes().is_empty().then_some(()));
    wait_for("the live page to end", STARTUP, || test_kill_process(page).is_err().then_some(()));
}

#[test]
fn a_secured_run_is_held_in_every_way_and_aborted_by_its_page() {
    if !super::secure::is_built("the ways to hold a secured run") {
        return;
    }
    let mut run = Run::start(true);
    run.is_held_in_all_ways();
    // The page ends with the run, maybe before it has answered.
    let _answer = by_page(&run, Verb::Abort);
    run.wait_until("an abort by the live page", |m| m.phase == FormationState::PHASE_ABORTED);
    let status = run.formation.node("run").wait(STARTUP);
    assert_eq!(status.code(), Some(1), "{}", run.formation.node("run").log());
}
