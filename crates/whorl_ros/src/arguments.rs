//! The command line of a node: `--ros-args` as `rcl` defines it.
//!
//! <https://docs.ros.org/en/jazzy/How-To-Guides/Node-arguments.html>

use std::path::PathBuf;

use thiserror::Error;
use tracing::level_filters::LevelFilter;

/// What is wrong with the command line.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum ArgumentError {
    /// A flag at the end of the line, without its value.
    #[error("`{flag}` needs a value: {expected}")]
    ValueMissing {
        /// The flag.
        flag: String,
        /// What should follow.
        expected: &'static str,
    },
    /// A flag that ROS does not define.
    #[error("`{flag}` is not a ROS argument; known are -r, -p, --params-file, --log-level, -e and --")]
    Unknown {
        /// The flag.
        flag: String,
    },
    /// An argument in front of `--ros-args`.
    #[error("`{argument}` is not an argument of this node; ROS arguments follow `--ros-args`")]
    Unexpected {
        /// The argument.
        argument: String,
    },
    /// Not `a:=b`, or with an empty side.
    #[error("`{flag} {text}` must be written {expected}")]
    Assignment {
        /// The flag.
        flag: String,
        /// What was given.
        text: String,
        /// What should have been.
        expected: &'static str,
    },
    /// Not a log level.
    #[error("log level `{text}` is none of debug, info, warn, error, fatal, off")]
    LogLevel {
        /// What was given.
        text: String,
    },
    /// Not a name in the sense of ROS.
    #[error(transparent)]
    Name(#[from] crate::names::NameError),
}

/// A remapping of a topic or service, `from:=to`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NameRemap {
    /// The name in the program; relative names are completed with the node's namespace.
    pub from: String,
    /// The name to use.
    pub to: String,
}

/// A parsed command line.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Arguments {
    /// `-r __ns:=`.
    pub namespace: Option<String>,
    /// `-r __node:=`.
    pub name: Option<String>,
    /// Other remappings.
    pub remaps: Vec<NameRemap>,
    /// The texts after `-p`, in the order given.
    pub parameters: Vec<String>,
    /// `--params-file`, in the order given.
    pub parameter_files: Vec<PathBuf>,
    /// `--enclave`: whose keys are used.
    pub enclave: Option<String>,
    /// `--log-level`.
    pub log_level: Option<LevelFilter>,
    /// Whether log lines go to `/rosout`.
    pub rosout: bool,
    /// Arguments that do not belong to ROS.
    pub other: Vec<String>,
    /// `--help` was given.
    pub help: bool,
    /// `--version` was given.
    pub version: bool,
}

impl Arguments {
    /// Parses a command line; `arguments` without the program's name. Arguments outside
    /// `--ros-args ... [--]` go to [`Arguments::other`].
    ///
    /// # Errors
    /// [`ArgumentError`].
    pub fn parse<S: AsRef<str>>(arguments: &[S]) -> Result<Self, ArgumentError> {
        let mut parsed = Self { rosout: true, ..Self::default() };
        let mut rest = arguments.iter().map(AsRef::as_ref);
        let mut in_ros = false;
        while let Some(argument) = rest.next() {
            match (in_ros, argument) {
                (_, "--ros-args") => in_ros = true,
                (false, "--help" | "-h") => parsed.help = true,
                (false, "--version") => parsed.version = true,
                (false, _) => parsed.other.push(argument.to_owned()),
                (true, "--") => in_ros = false,
                (true, _) => parsed.ros_argument(argument, &mut rest)?,
            }
        }
        Ok(parsed)
    }

    fn ros_argument<'a>(
        &mut self,
        flag: &str,
        rest: &mut impl Iterator<Item = &'a str>,
    ) -> Result<(), ArgumentError> {
        let mut value = |expected| {
            rest.next().ok_or_else(|| ArgumentError::ValueMissing { flag: flag.to_owned(), expected })
        };
        match flag {
            "-r" | "--remap" => self.remap(flag, value("from:=to")?),
            "-p" | "--param" => {
                self.parameters.push(value("key:=value")?.to_owned());
                Ok(())
            }
            "--params-file" => {
                self.parameter_files.push(PathBuf::from(value("a parameter file")?));
                Ok(())
            }
            "--log-level" => self.level(value("debug, info, warn, error, fatal or off")?),
            "--disable-rosout-logs" => {
                self.rosout = false;
                Ok(())
            }
            "--enable-rosout-logs" => {
                self.rosout = true;
                Ok(())
            }
            "-e" | "--enclave" => {
                self.enclave = Some(value("an enclave, e.g. /whorl_1/driver")?.to_owned());
                Ok(())
            }
            // Launch files pass these to every node; they change nothing here: the log always goes to stderr.
            "--log-config-file" => value("a file").map(|_| ()),
            "--enable-stdout-logs"
            | "--disable-stdout-logs"
            | "--enable-external-lib-logs"
            | "--disable-external-lib-logs" => Ok(()),
            "--help" | "-h" => {
                self.help = true;
                Ok(())
            }
            // `--params-file=x` and the like, which rcl does not know either.
            _ => Err(ArgumentError::Unknown { flag: flag.to_owned() }),
        }
    }

    fn remap(&mut self, flag: &str, text: &str) -> Result<(), ArgumentError> {
        let wrong = || ArgumentError::Assignment {
            flag: flag.to_owned(),
            text: text.to_owned(),
            expected: "from:=to, __ns:=/namespace or __node:=name",
        };
        let (from, to) =
            text.split_once(":=").filter(|(f, t)| !f.is_empty() && !t.is_empty()).ok_or_else(wrong)?;
        // `-r node:from:=to` addresses one node of a process; a process is one node here.
        let from = from.rsplit_once(':').map_or(from, |(_, from)| from);
        match from {
            "__ns" => self.namespace = Some(crate::names::namespace(to)?),
            "__node" | "__name" => self.name = Some(crate::names::base_name(to)?),
            _ => {
                crate::names::topic_name(from)?;
                crate::names::topic_name(to)?;
                self.remaps.push(NameRemap { from: from.to_owned(), to: to.to_owned() });
            }
        }
        Ok(())
    }

    fn level(&mut self, text: &str) -> Result<(), ArgumentError> {
        // `--log-level logger:=level` sets the level of one logger; a process has one here.
        let level = text.rsplit_once(":=").map_or(text, |(_, level)| level);
        self.log_level = Some(match level.to_ascii_lowercase().as_str() {
            "debug" => LevelFilter::DEBUG,
            "info" => LevelFilter::INFO,
            "warn" | "warning" => LevelFilter::WARN,
            "error" | "fatal" => LevelFilter::ERROR,
            "off" | "none" | "unset" => LevelFilter::OFF,
            _ => return Err(ArgumentError::LogLevel { text: level.to_owned() }),
        });
        Ok(())
    }
}

/// What `--help` prints after the node's own description.
pub const HELP: &str = "\
ROS arguments, after --ros-args and up to -- or the end:
  -r __ns:=/whorl_1        namespace
  -r __node:=name          name of the node
  -r from:=to              another name for a topic or service
  -p key:=value            a parameter; wins over every file
  --params-file FILE       a parameter file; may be repeated, later files win
  --log-level LEVEL        debug, info, warn, error, off (RUST_LOG sets it too)
  -e, --enclave /NAME      whose keys are used where security is on [default: the node's full name]
  --disable-rosout-logs    log to stderr only

Environment:
  ROS_DOMAIN_ID                  0 to 232, default 0
  ROS_AUTOMATIC_DISCOVERY_RANGE  LOCALHOST (default), SUBNET; OFF is refused
  ROS_LOCALHOST_ONLY             1 = LOCALHOST, 0 = SUBNET; wins over the range, as in ROS 2
  ROS_STATIC_PEERS               addresses of further machines, separated by ;
  ROS_SECURITY_ENABLE            true: DDS Security (SROS2), with the keys in ROS_SECURITY_KEYSTORE
  ROS_SECURITY_STRATEGY          Enforce: without its keys a node does not start; Permissive (default): it warns
  ROS_SECURITY_ENCLAVE_OVERRIDE  wins over --enclave
  WHORL_INTERFACE                name or address of the interface(s) for SUBNET, separated by ,
  RUST_LOG                       log filter, e.g. info,whorl_estimator=debug";

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(line: &str) -> Result<Arguments, ArgumentError> {
        Arguments::parse(&line.split_whitespace().collect::<Vec<_>>())
    }

    #[test]
    fn the_usual_line_of_a_launch_script() {
        let a = parse(
            "--ros-args -r __ns:=/whorl_1 -r __node:=est -p a.b:=1.5 -p est:c:=[1,2] \
             --params-file x.yaml --params-file y.yaml --log-level debug -r imu/data_raw:=/imu",
        )
        .unwrap();
        assert_eq!(a.namespace.as_deref(), Some("/whorl_1"));
        assert_eq!(a.name.as_deref(), Some("est"));
        assert_eq!(a.parameters, ["a.b:=1.5", "est:c:=[1,2]"]);
        assert_eq!(a.parameter_files, [PathBuf::from("x.yaml"), PathBuf::from("y.yaml")]);
        assert_eq!(a.log_level, Some(LevelFilter::DEBUG));
        assert_eq!(parse("--ros-args -e /a/b").unwrap().enclave.as_deref(), Some("/a/b"));
        assert_eq!(a.remaps, [NameRemap { from: "imu/data_raw".into(), to: "/imu".into() }]);
        assert!(a.rosout && a.other.is_empty());
    }

    #[test]
    fn two_dashes_end_the_ros_arguments_and_they_may_begin_again() {
        let a = parse("first --ros-args -p a:=1 -- second --out dir --ros-args -p b:=2").unwrap();
        assert_eq!(a.other, ["first", "second", "--out", "dir"]);
        assert_eq!(a.parameters.len(), 2);
    }

    #[test]
    fn the_help_flag_is_seen_on_both_sides() {
        assert!(parse("--help").unwrap().help);
        assert!(parse("--ros-args --help").unwrap().help);
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (line, expected) in [
            ("--ros-args -p", "needs a value"),
            ("--ros-args -r __ns:=", "from:=to"),
            ("--ros-args -r __ns:=/2whorl", "2whorl"),
            ("--ros-args -r __node:=a/b", "a/b"),
            ("--ros-args --params_file x", "--params_file"),
            ("--ros-args --log-level loud", "loud"),
            ("--ros-args -r a:=b//c", "b//c"),
        ] {
            let message = parse(line).unwrap_err().to_string();
            assert!(message.contains(expected), "{line}: {message}");
        }
    }
}
