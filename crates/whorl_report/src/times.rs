//! When something was recorded, and spans of time.

/// Longest gap over which attitudes are interpolated \[s\].
pub(crate) const GAP_S: f64 = 0.2;

/// A stretch of time \[s\].
pub type Interval = (f64, f64);

/// A message and when it was recorded, seconds since the first message of the run.
#[derive(Debug, Clone, PartialEq)]
pub struct Recorded<T> {
    /// Recorder's clock \[s\].
    pub log_time_s: f64,
    /// The message's own stamp on the same time line \[s\], corrected for the measured offset of the platform's clock.
    pub stamp_s: f64,
    /// The message.
    pub message: T,
}

/// From the start of an experiment to its end \[s\].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Span {
    pub from_s: f64,
    pub to_s: f64,
}

impl Default for Span {
    fn default() -> Self {
        Self { from_s: f64::INFINITY, to_s: f64::INFINITY }
    }
}

impl Span {
    pub fn contains(self, time_s: f64) -> bool {
        (self.from_s..self.to_s).contains(&time_s)
    }
}

/// Time spans of the hold phases.
#[derive(Debug, Clone, Default)]
pub(crate) struct Holds {
    past: Vec<Interval>,
    /// Since when, and to the last state.
    open: Option<Interval>,
}

impl Holds {
    pub fn add(&mut self, time_s: f64, hold: bool) {
        match (&mut self.open, hold) {
            (None, true) => self.open = Some((time_s, time_s)),
            (Some(open), true) => open.1 = time_s,
            (Some(open), false) => {
                self.past.push((open.0, time_s));
                self.open = None;
            }
            (None, false) => {}
        }
    }

    /// In order of time.
    pub fn intervals(&self) -> impl Iterator<Item = Interval> + '_ {
        self.past.iter().copied().chain(self.open)
    }

    /// Whether the formation holds at this time.
    pub fn contain(&self, time_s: f64) -> bool {
        // Asked about the end of a run while it is read.
        self.open
            .iter()
            .chain(self.past.iter().rev())
            .take_while(|(_, end)| *end + 60.0 >= time_s)
            .any(|(start, end)| (*start..=*end).contains(&time_s))
    }
}
