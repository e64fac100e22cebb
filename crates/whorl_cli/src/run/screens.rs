//! What a user looks at while an experiment runs: the monitor in the terminal, the page in the browser.

use std::ffi::OsString;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Instant;

use whorl_launch::{Domain, Restarts, by_accident, ends_with_this_process};

use super::exit_status::shell_status;
use crate::live;
use crate::output::tell;

/// Where the words of a screen go.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Words {
    /// To the standard output.
    Output,
    /// To the standard error: the standard output is for programs.
    Error,
    /// Nowhere.
    Nowhere,
}

/// A program that shows the experiment, in a process of its own: what reaches it over the network, and ends it, must not end
/// the supervisor. It is started again when it ends by accident, and ends when the supervisor does, however that ends.
pub struct Screen {
    label: &'static str,
    arguments: Vec<OsString>,
    /// The same for every screen: where traffic is secured it hears nothing without the keys.
    environment: Vec<(String, String)>,
    words: Words,
    domain: Domain,
    child: Option<Child>,
    restarts: Restarts,
    again_at: Option<Instant>,
}

/// What all screens of an experiment have in common.
pub(super) struct Surroundings<'a> {
    pub platforms: &'a [String],
    pub environment: &'a [(String, String)],
    pub domain: &'a Domain,
}

impl Screen {
    /// The status line in the terminal.
    pub(super) fn monitor(surroundings: &Surroundings<'_>, words: Words) -> Self {
        let mut screen = Self::new("monitor", surroundings, words);
        screen.arguments.push("--to-the-end".into());
        screen.spawn();
        screen
    }

    /// The page in the browser. Its address stays the same when it is started again: the port and the token are chosen here.
    pub(super) fn live_page(surroundings: &Surroundings<'_>, run: &Path, port: u16, words: Words) -> Self {
        let mut screen = Self::new("live", surroundings, words);
        let port = live::free_port(port);
        screen.arguments.extend(["--run".into(), run.into(), "--port".into(), port.to_string().into()]);
        match whorl_serving::token::secret() {
            Ok(token) => screen.environment.push((live::TOKEN.to_owned(), token)),
            Err(error) => tell(format_args!("warning: {error}")),
        }
        screen.spawn();
        screen
    }

    fn new(label: &'static str, surroundings: &Surroundings<'_>, words: Words) -> Self {
        let Surroundings { platforms, environment, domain } = surroundings;
        let command = std::iter::once(label.into());
        Self {
            label,
            arguments: command.chain(platforms.iter().map(OsString::from)).collect(),
            environment: environment.to_vec(),
            words,
            domain: (*domain).clone(),
            child: None,
            restarts: Restarts::default(),
            again_at: None,
        }
    }

    /// Without it an experiment runs all the same: its end is that of its coordinator.
    fn spawn(&mut self) {
        let child = std::env::current_exe().and_then(|program| {
            let mut command = Command::new(program);
            command.args(&self.arguments).envs(self.environment.iter().cloned());
            match self.words {
                Words::Output => {}
                Words::Error => _ = command.stdout(std::io::stderr()),
                Words::Nowhere => _ = command.stdout(Stdio::null()),
            }
            ends_with_this_process(&mut command).spawn()
        });
        match child {
            Ok(child) => {
                self.domain.remember_screen(self.label, child.id());
                self.child = Some(child);
            }
            Err(error) => tell(format_args!("warning: `whorl {}` cannot be started: {error}", self.label)),
        }
    }

    /// Starts it again where it has ended by accident; its exit status, once it has ended by its own decision.
    pub(super) fn look_after(&mut self) -> Option<i32> {
        if self.again_at.is_some_and(|at| at <= Instant::now()) {
            self.again_at = None;
            self.spawn();
        }
        let status = self.child.as_mut()?.try_wait().ok().flatten()?;
        self.child = None;
        if !by_accident(status) {
            self.domain.forget_screen(self.label);
            return status.code();
        }
        let wait = self.restarts.next_wait(Instant::now());
        self.again_at = Some(Instant::now() + wait);
        let again = match wait.as_secs() {
            0 => "is started again".to_owned(),
            wait_s => format!("is started again in {wait_s} s, as it ended often"),
        };
        tell(format_args!(
            "warning: `whorl {}` ended with status {} and {again}",
            self.label,
            shell_status(status)
        ));
        None
    }

    pub(super) fn stop(&mut self) {
        if let Some(mut child) = self.child.take() {
            let _ = child.kill();
            let _ = child.wait();
            self.domain.forget_screen(self.label);
        }
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        self.stop();
    }
}
