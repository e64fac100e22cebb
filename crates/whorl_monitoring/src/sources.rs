//! Up to when all is known that a cell needs, and what is late, lost or in disorder: a busy computer delivers late, not every topic equally late.

/// Messages further apart are a gap \[s\]; those of local control may be: it moves nothing itself, and a hand is not faster.
const GAP_S: f64 = 0.05;
const CONTROL_GAP_S: f64 = 0.25;
/// A gap is also so many times the usual distance, as learned over some so many messages.
const USUALLY: f64 = 3.0;
const LEARNED_IN: f64 = 32.0;
/// Nobody waits longer for a source, while others go on \[s\].
const WAITS_S: f64 = 2.0;

/// What comes regularly.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    Gyro,
    Attitude,
    Control,
    Wheels,
    Valves,
}

pub(crate) const ALL: [(Source, &str); 5] = [
    (Source::Gyro, "readings of the gyro"),
    (Source::Attitude, "attitude estimates"),
    (Source::Control, "states of local control"),
    (Source::Wheels, "states of the wheels"),
    (Source::Valves, "states of the valves"),
];

/// When a source was heard last, and how far apart its messages usually are \[s\].
struct Stream {
    source: Source,
    name: &'static str,
    newest_ns: Option<i64>,
    usual_s: Option<f64>,
}

pub(crate) struct Sources(Vec<Stream>);

impl Sources {
    pub fn new(wheels: bool, jets: bool) -> Self {
        let has = |source| (source != Source::Wheels || wheels) && (source != Source::Valves || jets);
        let stream = |(source, name)| Stream { source, name, newest_ns: None, usual_s: None };
        Self(ALL.into_iter().filter(|(source, _)| has(*source)).map(stream).collect())
    }

    pub fn forget(&mut self) {
        self.0.iter_mut().for_each(|stream| stream.newest_ns = None);
    }

    /// A message; the time since the one before \[s\], `None` for the first after a hole. Errors: a gap, or a message no newer than the one before.
    pub fn heard(&mut self, source: Source, stamp_ns: i64) -> Result<Option<f64>, String> {
        let Some(stream) = self.0.iter_mut().find(|stream| stream.source == source) else { return Ok(None) };
        let Some(before_ns) = stream.newest_ns else {
            stream.newest_ns = Some(stamp_ns);
            return Ok(None);
        };
        // Control acts on estimates, and may act on one twice.
        let is_control = source == Source::Control;
        if stamp_ns <= before_ns {
            return if is_control { Ok(None) } else { Err(format!("{} came in disorder", stream.name)) };
        }
        stream.newest_ns = Some(stamp_ns);
        let since_s = stamp_ns.saturating_sub(before_ns) as f64 * 1e-9;
        // Gaps are not usual, however many.
        let usual_s = stream.usual_s.get_or_insert(since_s.min(GAP_S));
        let gap_s = if is_control { CONTROL_GAP_S } else { GAP_S }.max(USUALLY * *usual_s);
        *usual_s += (since_s.min(2.0 * *usual_s) - *usual_s) / LEARNED_IN;
        if since_s > gap_s { Err(format!("{} were late or lost", stream.name)) } else { Ok(Some(since_s)) }
    }

    /// Whether everything is known until `until_ns`. Error: a source that is silent while others go on.
    pub fn complete(&self, until_ns: i64) -> Result<bool, String> {
        let is_late = |stream: &&Stream| stream.newest_ns.is_none_or(|newest_ns| newest_ns < until_ns);
        let Some(missing) = self.0.iter().find(is_late) else { return Ok(true) };
        let newest_ns = self.0.iter().filter_map(|stream| stream.newest_ns).max().unwrap_or(until_ns);
        let is_silent = newest_ns.saturating_sub(until_ns) as f64 * 1e-9 > WAITS_S;
        if is_silent { Err(format!("{} are missing", missing.name)) } else { Ok(false) }
    }
}
