//! Log lines: to stderr through `tracing`, and to `/rosout`.

use std::fmt::Display;
use std::io::Write as _;

use serde::Serialize;
use tracing::level_filters::LevelFilter;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;
use whorl_msgs::builtin_interfaces::Time;
use whorl_msgs::cdr;
use whorl_node::{LogLevel, LogLine, Timestamp};

use crate::error::RosError;
use crate::raw::RawWriter;

/// `rcl_interfaces/msg/Log`.
#[derive(Serialize)]
struct Log<'a> {
    stamp: Time,
    level: u8,
    name: &'a str,
    msg: &'a str,
    file: &'a str,
    function: &'a str,
    line: u32,
}

/// Sends log lines to stderr. `RUST_LOG` sets the filter, as levels of targets (`info,rustdds=debug`); otherwise `level`, otherwise info.
/// The DDS library logs nothing, unless `RUST_LOG` names it.
pub fn to_stderr(level: Option<LevelFilter>) {
    let wanted = std::env::var("RUST_LOG").ok().and_then(|filter| filter.parse::<Targets>().ok());
    let filter = wanted.unwrap_or_else(|| {
        let silent = [("rustdds", LevelFilter::OFF), ("ros2_client", LevelFilter::OFF)];
        Targets::new().with_default(level.unwrap_or(LevelFilter::INFO)).with_targets(silent)
    });
    let is_terminal = std::io::IsTerminal::is_terminal(&std::io::stderr());
    // A reader that has gone is no reason to panic, which saying so on the same stream would do.
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(is_terminal)
        .log_internal_errors(false);
    // A second call, in tests, keeps the first subscriber.
    let _ = tracing_subscriber::registry().with(filter).with(lines).try_init();
}

/// Prints on stderr why a program ends, also before there is a log. That nobody listens is no error.
pub fn complain(name: &str, error: &impl Display) {
    let _ = writeln!(std::io::stderr(), "{name}: {error}");
}

/// Prints a line on stderr.
pub(crate) fn print(node: &str, line: &LogLine) {
    let text = &line.text;
    match line.level {
        LogLevel::Debug => tracing::debug!(target: "whorl", "{node}: {text}"),
        LogLevel::Info => tracing::info!(target: "whorl", "{node}: {text}"),
        LogLevel::Warn => tracing::warn!(target: "whorl", "{node}: {text}"),
        LogLevel::Error => tracing::error!(target: "whorl", "{node}: {text}"),
    }
}

/// Publishes a line as `rcl_interfaces/msg/Log`.
pub(crate) fn publish(
    writer: &RawWriter,
    logger: &str,
    stamp: Timestamp,
    line: &LogLine,
) -> Result<(), RosError> {
    let message = Log {
        stamp: stamp.into(),
        level: match line.level {
            LogLevel::Debug => 10,
            LogLevel::Info => 20,
            LogLevel::Warn => 30,
            LogLevel::Error => 40,
        },
        name: logger,
        msg: &line.text,
        file: "",
        function: "",
        line: 0,
    };
    writer.publish(&cdr::encode("rcl_interfaces/msg/Log", &message)?)
}
