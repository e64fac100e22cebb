//! Outputs of a step of a core.

use std::sync::Arc;

use whorl_msgs::topics::{Message, Route};

/// One message to publish.
#[derive(Debug, Clone, PartialEq)]
pub struct Publication {
    /// Where it goes.
    pub route: Route,
    /// The message; shared by those that get it.
    pub message: Arc<Message>,
}

/// Severity of a log line, as in `rcl_interfaces/Log`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum LogLevel {
    /// For developers of the node.
    Debug,
    /// Normal progress.
    Info,
    /// Something is wrong and was handled.
    Warn,
    /// Something is wrong and the node cannot do its work.
    Error,
}

/// A line for the log and for `/rosout`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogLine {
    /// Severity.
    pub level: LogLevel,
    /// One sentence.
    pub text: String,
}

/// The answer to [`crate::Event::Request`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Response {
    /// Whether the request was carried out.
    pub success: bool,
    /// One sentence on what happened, or why not.
    pub message: String,
}

/// Collects the outputs of a step. The shell clears and reuses it between steps.
#[derive(Debug, Default)]
pub struct Outputs {
    /// Messages, in the order they are to be sent.
    pub messages: Vec<Publication>,
    /// Log lines.
    pub log: Vec<LogLine>,
    /// The answer to a request.
    pub response: Option<Response>,
}

impl Outputs {
    /// Appends a message.
    pub fn publish(&mut self, route: Route, message: impl Into<Message>) {
        self.messages.push(Publication { route, message: Arc::new(message.into()) });
    }

    /// Appends a log line.
    pub fn log(&mut self, level: LogLevel, text: impl Into<String>) {
        self.log.push(LogLine { level, text: text.into() });
    }

    /// Answers the request that is being served.
    pub fn respond(&mut self, success: bool, message: impl Into<String>) {
        self.response = Some(Response { success, message: message.into() });
    }

    /// Empties all lists, keeping their memory.
    pub fn clear(&mut self) {
        self.messages.clear();
        self.log.clear();
        self.response = None;
    }
}
