//! Context of a node, from its command line and environment.

use std::cell::RefCell;
use std::io::Write as _;
use std::os::unix::net::UnixStream;
use std::process::ExitCode;
use std::rc::Rc;

use whorl_msgs::PlatformId;
use whorl_node::Node;
use whorl_params::{NodeParameters, Override, ParameterTree, formation, read_shared};

use crate::arguments::{Arguments, HELP};
use crate::clock::Clock;
use crate::environment::Network;
use crate::error::RosError;
use crate::log;
use crate::names::NodeName;

/// Properties of a program's node.
#[derive(Debug, Clone, Copy)]
pub struct NodeOptions {
    /// Name of the node, unless `-r __node:=` gives another.
    pub name: &'static str,
    /// One or two sentences for `--help`.
    pub description: &'static str,
    /// Whether arguments in front of `--ros-args` are for the node; else they are an error.
    pub takes_arguments: bool,
}

impl NodeOptions {
    /// Options of a node of Whorl.
    #[must_use]
    pub fn of(node: Node) -> Self {
        let info = node.info();
        Self::new(info.name, info.purpose)
    }

    /// Options of a node that takes ROS arguments only.
    #[must_use]
    pub fn new(name: &'static str, description: &'static str) -> Self {
        Self { name, description, takes_arguments: false }
    }
}

/// Context of a node: its name, its platform, the parameters of all nodes.
#[derive(Debug, Clone)]
pub struct NodeContext {
    name: NodeName,
    platforms: Vec<String>,
    platform: Option<PlatformId>,
    tree: ParameterTree,
    network: Network,
    arguments: Arguments,
    clock: Clock,
    wakers: Rc<RefCell<Vec<UnixStream>>>,
}

impl NodeContext {
    /// The context of a command line (without the program's name) on a network.
    ///
    /// # Errors
    /// Wrong arguments or parameter files.
    pub fn new(options: NodeOptions, arguments: Arguments, network: Network) -> Result<Self, RosError> {
        if let (false, Some(argument)) = (options.takes_arguments, arguments.other.first()) {
            return Err(crate::arguments::ArgumentError::Unexpected { argument: argument.clone() }.into());
        }
        let name = NodeName::new(
            arguments.namespace.as_deref().unwrap_or("/"),
            arguments.name.as_deref().unwrap_or(options.name),
        )?;
        let enclave = arguments.enclave.clone().unwrap_or_else(|| name.full());
        let network = network.secured(&enclave)?;
        let overrides = arguments
            .parameters
            .iter()
            .map(|p| Override::parse(p).map_err(|e| RosError::Parameters(e.into())))
            .collect::<Result<Vec<_>, _>>()?;
        let tree = ParameterTree::load(&arguments.parameter_files, &overrides)?;
        let own = tree.for_node(&name.full());
        // Other errors of the node's parameters are reported when it reads them itself.
        let formation = read_shared(&own, formation)?;
        let platform = formation
            .platform_of_node(&name.full())
            .and_then(|index| u16::try_from(index).ok())
            .map(PlatformId);
        Ok(Self {
            name,
            platforms: formation.platforms,
            platform,
            tree,
            network,
            arguments,
            clock: Clock::default(),
            wakers: Rc::default(),
        })
    }

    /// The node's name.
    #[must_use]
    pub fn name(&self) -> &NodeName {
        &self.name
    }

    /// Names of the platforms (`formation.platforms`), in the order of [`PlatformId`].
    #[must_use]
    pub fn platforms(&self) -> &[String] {
        &self.platforms
    }

    /// The platform in whose namespace the node runs, if any.
    #[must_use]
    pub fn platform(&self) -> Option<PlatformId> {
        self.platform
    }

    /// The platform in whose namespace the node runs, for nodes that need one.
    ///
    /// # Errors
    /// [`RosError::Namespace`].
    pub fn own_platform(&self) -> Result<PlatformId, RosError> {
        self.platform.ok_or_else(|| RosError::Namespace {
            namespace: self.name.namespace().to_owned(),
            platforms: self.platforms.iter().map(|p| format!("/{p}")).collect::<Vec<_>>().join(", "),
        })
    }

    /// Parameters of this node, unread.
    #[must_use]
    pub fn parameters(&self) -> NodeParameters {
        self.tree.for_node(&self.name.full())
    }

    /// Everything in the parameter files, e.g. for the other nodes' sections.
    #[must_use]
    pub fn tree(&self) -> &ParameterTree {
        &self.tree
    }

    /// The command line.
    #[must_use]
    pub fn arguments(&self) -> &Arguments {
        &self.arguments
    }

    /// The network to join.
    #[must_use]
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// Steps the core with [`whorl_node::Event::Woken`] whenever bytes come on this stream, which the node then takes.
    pub fn wake_on(&self, stream: UnixStream) {
        self.wakers.borrow_mut().push(stream);
    }

    pub(crate) fn take_wakers(&self) -> Vec<UnixStream> {
        self.wakers.take()
    }

    /// The node's clock.
    #[must_use]
    pub fn clock(&self) -> Clock {
        self.clock.clone()
    }
}

/// Reads command line and environment of this process and sets up the log; or reports that the
/// program is done (`--help`, or an error, which has been printed).
///
/// # Errors
/// The code to exit with.
pub fn context_from_command_line(options: NodeOptions) -> Result<NodeContext, ExitCode> {
    let command_line: Vec<String> = std::env::args().skip(1).collect();
    let fail = |error: RosError| {
        log::complain(options.name, &error);
        WRONG_USAGE.into()
    };
    let arguments = Arguments::parse(&command_line).map_err(|e| fail(e.into()))?;
    if arguments.help {
        let program = std::env::args_os().next().unwrap_or_default();
        let program = std::path::Path::new(&program).file_name().unwrap_or_default().to_string_lossy();
        return Err(answer(&format!(
            "{}: {}\n\nusage: {program} [--ros-args ...]\n\n{HELP}",
            options.name, options.description
        )));
    }
    if arguments.version {
        return Err(answer(&format!("{} {}", options.name, env!("CARGO_PKG_VERSION"))));
    }
    log::to_stderr(arguments.log_level);
    let network = Network::from_environment().map_err(|e| fail(e.into()))?;
    NodeContext::new(options, arguments, network).map_err(fail)
}

/// Prints a text that was asked for. A reader who has seen enough (`driver --help | head -1`) is no error.
fn answer(text: &str) -> ExitCode {
    let _ = writeln!(std::io::stdout(), "{text}");
    ExitCode::SUCCESS
}

/// Exit code for a wrong command line, environment or parameter.
pub const WRONG_USAGE: u8 = 2;
