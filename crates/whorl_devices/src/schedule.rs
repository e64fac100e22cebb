//! Which valves are open until when.

use std::time::{Duration, Instant};

use crate::mailbox::{Command, Mailbox};

/// The valves of one device.
#[derive(Debug, Clone)]
pub(crate) struct Schedule {
    /// Jet, and its shortest pulse \[s\].
    jets: Vec<(usize, f64)>,
    closes: Vec<Option<Instant>>,
    wanted: Vec<bool>,
    /// As the board has confirmed; `None`: unknown.
    known: Vec<Option<bool>>,
}

impl Schedule {
    /// All closed, and nothing known of the board.
    pub(crate) fn new(jets: Vec<(usize, f64)>) -> Self {
        let count = jets.len();
        Self { jets, closes: vec![None; count], wanted: vec![false; count], known: vec![None; count] }
    }

    /// Takes what has been commanded of the valves since the last time.
    pub(crate) fn obey(&mut self, mailbox: &Mailbox) {
        while let Some(command) = mailbox.take() {
            match command {
                Command::Pulses(from, on_time_s) => self.pulses(from, &on_time_s),
                Command::AllOff => self.close(),
                Command::Alive | Command::Motors(..) => {}
            }
        }
    }

    /// A new slot, which replaces what is left of the one before. A pulse shorter than its valve can make is none.
    pub(crate) fn pulses(&mut self, from: Instant, on_time_s: &[f64]) {
        for ((jet, shortest_s), closes) in self.jets.iter().zip(&mut self.closes) {
            let on_time_s = on_time_s.get(*jet).copied().unwrap_or(0.0);
            let length = Duration::try_from_secs_f64(on_time_s).ok();
            *closes =
                length.filter(|_| on_time_s > 0.0 && on_time_s >= *shortest_s).map(|length| from + length);
        }
    }

    /// Everything closed.
    pub(crate) fn close(&mut self) {
        self.closes.fill(None);
    }

    /// When the next valve closes.
    pub(crate) fn next_edge(&self) -> Option<Instant> {
        self.closes.iter().flatten().min().copied()
    }

    /// Whether the board must be written.
    pub(crate) fn advance(&mut self, now: Instant) -> bool {
        for (closes, wanted) in self.closes.iter_mut().zip(&mut self.wanted) {
            *closes = closes.filter(|at| *at > now);
            *wanted = closes.is_some();
        }
        self.wanted.iter().zip(&self.known).any(|(wanted, known)| Some(*wanted) != *known)
    }

    /// What the board is to be written.
    pub(crate) fn wanted(&self) -> &[bool] {
        &self.wanted
    }

    /// The board has confirmed. Returns the jets whose valves have changed.
    pub(crate) fn written(&mut self) -> Vec<(usize, bool)> {
        let mut switched = Vec::new();
        for (((jet, _), wanted), known) in self.jets.iter().zip(&self.wanted).zip(&mut self.known) {
            if *known != Some(*wanted) {
                switched.push((*jet, *wanted));
                *known = Some(*wanted);
            }
        }
        switched
    }
}
