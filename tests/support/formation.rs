//! A formation of real processes, started as the launch scripts start it.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use tempfile::TempDir;
use whorl_node::Node;
use whorl_ros::Participant;
use whorl_ros::environment::Network;
use whorl_security::Keystore;
use whorl_security::policy::{MONITOR, grants};

use super::machine::{Load, Share};
use super::process::Process;
use super::watch::Watch;
use super::{binaries, root};
use whorl_tests::Domain;

/// What a test waits for comes, however busy the machine is; what has not come by then never does.
pub const STARTUP: Duration = Duration::from_secs(120);

/// Both platforms hold still for as long as a test may want.
pub const LONG_HOLD: &str = r#"
/coordinator:
  ros__parameters:
    experiment: {name: long_hold, description: "both platforms hold still, Whorl-II turned by 20 deg"}
    law:
      kind: leader_follower
      members:
        whorl_2: {leader: whorl_1, offset: {yaw_deg: 20.0}}
    steps:
      settle: {kind: settle, duration_s: 3.0, yaw_deg: 0.0, pitch_deg: -0.6, roll_deg: 2.0}
      hold: {kind: hold, duration_s: 900.0}
/whorl_1/driver:
  ros__parameters:
    initial: {yaw_deg: 0.0, pitch_deg: -0.6, roll_deg: 2.0}
/whorl_2/driver:
  ros__parameters:
    initial: {yaw_deg: 19.0, pitch_deg: -0.5, roll_deg: 1.0}
"#;

/// Whorl-I alone holds still.
pub const LONG_HOLD_ALONE: &str = r#"
/**:
  ros__parameters:
    formation: {platforms: [whorl_1]}
/coordinator:
  ros__parameters:
    experiment: {name: long_hold_alone, description: "Whorl-I holds still"}
    law: {kind: leader_follower}
    steps:
      settle: {kind: settle, duration_s: 3.0, yaw_deg: 0.0, pitch_deg: -0.6, roll_deg: 2.0}
      hold: {kind: hold, duration_s: 900.0}
/whorl_1/driver:
  ros__parameters:
    initial: {yaw_deg: 0.0, pitch_deg: -0.6, roll_deg: 2.0}
"#;

/// What SROS2 reads, apart from the keystore's folder.
pub const SECURITY_VARIABLES: [&str; 3] =
    ["ROS_SECURITY_ENABLE", "ROS_SECURITY_STRATEGY", "ROS_SECURITY_ENCLAVE_OVERRIDE"];

/// Variables that enforce security with a keystore.
pub fn keystore_variables(path: &Path) -> Vec<(String, String)> {
    let variables =
        [("ENABLE", "true".into()), ("STRATEGY", "Enforce".into()), ("KEYSTORE", path.display().to_string())];
    variables.map(|(name, value)| (format!("ROS_SECURITY_{name}"), value)).into()
}

/// A keystore for both platforms with an authority of its own.
pub fn new_keystore(path: &Path, domain: u16) -> Keystore {
    let now_s = whorl_ros::wall_clock().0 / 1_000_000_000;
    let keystore = Keystore::create(path, domain, now_s).unwrap();
    for grant in grants(&["whorl_1", "whorl_2"]) {
        keystore.add(&grant, domain, now_s).unwrap();
    }
    keystore
}

/// Processes of one domain, their parameter files and logs.
pub struct Formation {
    nodes: BTreeMap<String, Process>,
    /// Names of the platforms.
    pub platforms: Vec<&'static str>,
    /// Folder of the parameter files.
    pub params: PathBuf,
    files: Vec<PathBuf>,
    environment: Vec<(String, String)>,
    /// Network namespaces: of what belongs to no platform, then of each platform's nodes; or none.
    namespaces: Vec<String>,
    /// Variables of each platform's nodes alone.
    own_environment: BTreeMap<String, Vec<(String, String)>>,
    /// Where traffic is secured.
    pub keystore: Option<Keystore>,
    folder: TempDir,
    domain: Domain,
    _share: Share,
}

impl Formation {
    /// Nothing runs yet. `layers` are texts of parameter files above the platforms' own.
    pub fn new(platforms: &[&'static str], layers: &[&str]) -> Self {
        let load = if platforms.len() > 1 { Load::Formation } else { Load::Light };
        Self::with_load(load, platforms, layers)
    }

    /// The same for a test that needs another share of the machine.
    pub fn with_load(load: Load, platforms: &[&'static str], layers: &[&str]) -> Self {
        let share = load.take();
        binaries::folder();
        let folder = tempfile::Builder::new().prefix("whorl-test-").tempdir().unwrap();
        let files = layers.iter().enumerate().map(|(index, text)| {
            let path = folder.path().join(format!("layer_{index}.yaml"));
            std::fs::write(&path, text).unwrap();
            path
        });
        Self {
            nodes: BTreeMap::new(),
            platforms: platforms.to_vec(),
            params: root().join("params"),
            files: files.collect(),
            environment: Vec::new(),
            namespaces: Vec::new(),
            own_environment: BTreeMap::new(),
            keystore: None,
            folder,
            domain: Domain::take(),
            _share: share,
        }
    }

    /// Whorl-I and the coordinator in a long hold; waits until it is reached.
    pub fn holding_alone(layers: &[&str]) -> (Self, Watch) {
        Self::new(&["whorl_1"], &[&[LONG_HOLD_ALONE], layers].concat()).held()
    }

    /// Starts everything, and waits until the hold is reached.
    pub fn held(mut self) -> (Self, Watch) {
        let watch = self.watch();
        self.start_all();
        self.wait_for_step(&watch, "hold");
        (self, watch)
    }

    /// Puts the coordinator into a network namespace, and each platform into one.
    pub fn in_namespaces(mut self, ground: &str, platforms: &[&str]) -> Self {
        self.namespaces = [&[ground], platforms].concat().iter().map(|&n| n.to_owned()).collect();
        self.environment.push(("ROS_AUTOMATIC_DISCOVERY_RANGE".into(), "SUBNET".into()));
        self
    }

    /// Gives a platform's nodes variables of their own.
    pub fn set_environment(&mut self, platform: &str, variables: Vec<(String, String)>) {
        self.own_environment.insert(platform.to_owned(), variables);
    }

    /// Secures all traffic, with keys made for this formation.
    pub fn secured(mut self) -> Self {
        let path = self.folder().join("keystore");
        self.set_environment_of_all(keystore_variables(&path));
        self.keystore = Some(new_keystore(&path, self.domain()));
        self
    }

    /// This machine's network, with the keys of an enclave where traffic is secured.
    pub fn network(&self, enclave: &str) -> Network {
        let folder = self.keystore.as_ref().map(|keystore| keystore.enclave_folder(enclave).unwrap());
        Network { enclave: folder, ..Network::localhost(self.domain()) }
    }

    /// Gives all nodes these variables.
    pub fn set_environment_of_all(&mut self, variables: Vec<(String, String)>) {
        self.environment.extend(variables);
    }

    /// The domain's number.
    pub fn domain(&self) -> u16 {
        self.domain.id
    }

    /// A folder of its own.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// An observer in the formation's domain.
    pub fn watch(&self) -> Watch {
        Watch::on(self.network(MONITOR), &self.platforms)
    }

    /// A participant in the formation's domain.
    pub fn participant(&self) -> Participant {
        Participant::new(&Network::localhost(self.domain())).unwrap()
    }

    /// Nodes of every platform, and the coordinator.
    pub fn start_all(&mut self) {
        for platform in self.platforms.clone() {
            self.start_platform(platform);
        }
        self.start("/coordinator");
    }

    /// Driver, estimator and local control of one platform.
    pub fn start_platform(&mut self, platform: &str) {
        for node in Node::of_platform(false) {
            self.start(&format!("/{platform}/{}", node.name()));
        }
    }

    /// Starts a node by its full name, with the parameter files that the launch scripts give it.
    pub fn start(&mut self, node: &str) {
        self.start_with(node, &[]);
    }

    /// Starts a node with further `-p` arguments.
    pub fn start_with(&mut self, node: &str, overrides: &[String]) {
        let name = node.trim_start_matches('/');
        let (platform, program) = name.split_once('/').map_or((None, name), |(p, n)| (Some(p), n));
        let mut arguments: Vec<OsString> = vec!["--ros-args".into()];
        let mut file = |path: PathBuf| arguments.extend(["--params-file".into(), path.into_os_string()]);
        let parameters = self.params.clone();
        file(parameters.join("common.yaml"));
        for own in self.platforms.iter().filter(|p| platform.is_none_or(|wanted| wanted == **p)) {
            file(parameters.join(format!("{own}.yaml")));
            if Node::find(program).is_some_and(|node| node.info().reads_truth) {
                file(parameters.join("truth").join(format!("{own}.yaml")));
            }
        }
        self.files.iter().cloned().for_each(&mut file);
        if let Some(platform) = platform {
            arguments.extend(["-r".into(), format!("__ns:=/{platform}").into()]);
        }
        overrides.iter().for_each(|text| arguments.extend(["-p".into(), text.into()]));
        let mut command = self.command(platform, &binaries::path(program));
        command.args(arguments);
        self.adopt(node, command);
    }

    /// A program in the formation's domain, and in the namespace of that platform if there are any.
    pub fn command(&self, platform: Option<&str>, program: &Path) -> Command {
        let index = self.platforms.iter().position(|p| Some(*p) == platform);
        let mut command = match self.namespaces.get(index.map_or(0, |index| index + 1)) {
            None => Command::new(program),
            Some(namespace) => {
                let mut command = Command::new("ip");
                command.args(["netns", "exec", namespace]).arg(program);
                command
            }
        };
        for variable in
            ["ROS_LOCALHOST_ONLY", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_STATIC_PEERS", "RUST_LOG"]
                .into_iter()
                .chain(SECURITY_VARIABLES)
        {
            command.env_remove(variable);
        }
        command.env("ROS_DOMAIN_ID", self.domain().to_string());
        command.envs(self.environment.iter().cloned());
        command.envs(platform.and_then(|p| self.own_environment.get(p)).into_iter().flatten().cloned());
        command.current_dir(self.folder());
        command
    }

    /// Starts any process as part of the formation.
    pub fn adopt(&mut self, name: &str, command: Command) {
        let log = self.folder().join(format!("{}.log", name.trim_start_matches('/').replace('/', "_")));
        let process = Process::start(name, command, &log);
        self.nodes.insert(name.to_owned(), process);
    }

    /// A process that was started.
    pub fn node(&mut self, name: &str) -> &mut Process {
        self.nodes.get_mut(name).unwrap_or_else(|| panic!("{name} was not started"))
    }

    /// kill -9; returns when.
    pub fn kill(&mut self, node: &str) -> whorl_node::Timestamp {
        let at = whorl_ros::wall_clock();
        self.node(node).kill();
        at
    }

    /// Processor time of all processes together in units of one core over `time`, and the memory of the
    /// largest one [bytes].
    pub fn load(&self, time: Duration) -> (f64, u64) {
        let used = || -> Vec<(u64, f64)> { self.nodes.values().filter_map(Process::resources).collect() };
        let sum = |all: &[(u64, f64)]| all.iter().map(|(_, seconds)| seconds).sum::<f64>();
        let before = used();
        std::thread::sleep(time);
        let after = used();
        let largest = after.iter().map(|(bytes, _)| *bytes).max().unwrap_or(0);
        ((sum(&after) - sum(&before)) / time.as_secs_f64(), largest)
    }

    /// Fails when a process has ended by itself.
    pub fn check_alive(&mut self) {
        for (name, process) in &mut self.nodes {
            if let Some(status) = process.ended() {
                panic!("{name} ended: {status}; its log:\n{}", process.log());
            }
        }
    }

    /// Waits until the experiment is at a step.
    pub fn wait_for_step(&mut self, watch: &Watch, step: &str) {
        use whorl_msgs::topics::Topic;
        use whorl_msgs::whorl::FormationState;
        let begin = std::time::Instant::now();
        loop {
            let route = super::watch::route(0, Topic::FormationState);
            if watch.log().latest::<FormationState>(route).is_some_and(|(_, m)| m.step == step) {
                return;
            }
            self.check_alive();
            assert!(begin.elapsed() < STARTUP, "step {step} was not reached\n{}", watch.summary());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Interrupts everything, and fails unless each process ends well and in time.
    pub fn stop(&mut self) {
        for process in self.nodes.values_mut() {
            process.signal(rustix::process::Signal::INT);
        }
        for (name, process) in &mut self.nodes {
            let status = process.wait(STARTUP);
            assert!(status.success(), "{name}: {status}; its log:\n{}", process.log());
        }
    }
}

impl Drop for Formation {
    fn drop(&mut self) {
        if std::thread::panicking() {
            for (name, process) in &self.nodes {
                let log = process.log();
                let lines: Vec<&str> = log.lines().collect();
                eprintln!(
                    "--- last lines of {name}:\n{}",
                    lines[lines.len().saturating_sub(12)..].join("\n")
                );
            }
        }
        // At once, not one after the other.
        for process in self.nodes.values_mut() {
            process.signal(rustix::process::Signal::INT);
        }
    }
}
