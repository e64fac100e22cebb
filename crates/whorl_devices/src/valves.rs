//! What all boards with solenoid valves share: which output is which jet's, and how a board is served.

use std::time::{Duration, Instant};

use whorl_dynamics::PlatformModel;
use whorl_params::{Reader, range};

use crate::DeviceError;
use crate::mailbox::Mailbox;
use crate::reading::{Measured, Reporter, State};
use crate::schedule::Schedule;

/// Between writes without an edge, for the board's own watchdog; between looks at the emergency stop.
pub(crate) const REFRESH: Duration = Duration::from_millis(50);

/// An output with the valve of a jet behind it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Outlet {
    /// Number of the output on its board.
    pub(crate) output: u32,
    /// Index of the jet.
    pub(crate) jet: usize,
    /// Shortest pulse that its valve can make \[s\].
    pub(crate) shortest_s: f64,
}

/// Reads a group such as `coils: {jet_1: 0, jet_2: 1}`, in the order of the outputs' numbers.
pub(crate) fn read(
    r: &mut Reader<'_>,
    model: &PlatformModel,
    group: &str,
    largest: u32,
    doc: &str,
) -> Vec<Outlet> {
    let names: Vec<&str> = model.jets().iter().map(|jet| jet.name.as_str()).collect();
    let name_of = |jet: usize| names.get(jet).copied().unwrap_or_default();
    let mut outlets: Vec<Outlet> = Vec::new();
    for name in r.children(group) {
        let errors = r.error_count();
        let number = r.group(group, |r| r.i64(&name, range(0..=i64::from(largest)), doc));
        // One that was refused is there, and no other's.
        let refused = r.error_count() > errors;
        let output = if refused { u32::MAX } else { u32::try_from(number).unwrap_or(0) };
        let key = format!("{group}.{name}");
        let Some((jet, found)) = model.jets().iter().enumerate().find(|(_, jet)| jet.name == name) else {
            r.reject(&key, format!("{name} is no jet of this platform; allowed: {}", names.join(", ")));
            continue;
        };
        if let Some(other) = outlets.iter().find(|other| !refused && other.output == output) {
            let other = name_of(other.jet);
            r.reject(&key, format!("{other} has number {output} already; allowed: a number of its own"));
        } else {
            outlets.push(Outlet { output, jet, shortest_s: found.min_on_time_s });
        }
    }
    outlets.sort_unstable_by_key(|outlet| outlet.output);
    outlets
}

/// Jets of these outlets, as a schedule wants them.
pub(crate) fn schedule(outlets: &[Outlet]) -> Schedule {
    Schedule::new(outlets.iter().map(|outlet| (outlet.jet, outlet.shortest_s)).collect())
}

/// A board that was reached.
pub(crate) trait Board {
    /// Makes all valves so, in the order of the outlets, and returns when it is done.
    fn write(&mut self, open: &[bool]) -> Result<(), DeviceError>;

    /// Whether the contact of the emergency stop says that it is released; `None`: it is not wired to this board.
    fn stop_is_released(&mut self) -> Result<Option<bool>, DeviceError>;
}

/// Works the valves until the mailbox is closed. They are closed at the beginning, at the end, and when the board does not do
/// what it should but still hears.
pub(crate) fn serve(
    board: &mut impl Board,
    outlets: &[Outlet],
    mailbox: &Mailbox,
    reporter: &Reporter,
) -> Result<(), DeviceError> {
    let mut schedule = schedule(outlets);
    let result = work(board, &mut schedule, mailbox, reporter);
    if result.is_err() {
        schedule.close();
        schedule.advance(Instant::now());
        let _ = write(board, &mut schedule, reporter);
    }
    result
}

fn work(
    board: &mut impl Board,
    schedule: &mut Schedule,
    mailbox: &Mailbox,
    reporter: &Reporter,
) -> Result<(), DeviceError> {
    // Closed before anything else: the board may have been left as it was.
    write(board, schedule, reporter)?;
    let has_stop = look_at_stop(board, reporter)?;
    reporter.state(State::Ready);
    let mut refresh = Instant::now() + REFRESH;
    let mut look = refresh;
    loop {
        let until = if has_stop { refresh.min(look) } else { refresh };
        mailbox.wait(None, schedule.next_edge().map_or(until, |edge| edge.min(until)));
        schedule.obey(mailbox);
        if mailbox.is_closed() {
            schedule.close();
            schedule.advance(Instant::now());
            return write(board, schedule, reporter);
        }
        let is_due = Instant::now() >= refresh;
        if schedule.advance(Instant::now()) || is_due {
            refresh = Instant::now() + REFRESH;
            write(board, schedule, reporter)?;
        }
        if has_stop && (is_due || Instant::now() >= look) {
            look = Instant::now() + REFRESH;
            look_at_stop(board, reporter)?;
        }
    }
}

/// Tells whether the emergency stop is pressed, and returns whether there is one. A wire that is broken counts as pressed.
fn look_at_stop(board: &mut impl Board, reporter: &Reporter) -> Result<bool, DeviceError> {
    let released = board.stop_is_released()?;
    if let Some(is_released) = released {
        reporter.measured(Instant::now(), Measured::EmergencyStop(!is_released));
    }
    Ok(released.is_some())
}

/// Makes the valves what they should be, and tells which of them were switched.
fn write(board: &mut impl Board, schedule: &mut Schedule, reporter: &Reporter) -> Result<(), DeviceError> {
    board.write(schedule.wanted())?;
    let switched = schedule.written();
    if !switched.is_empty() {
        reporter.measured(Instant::now(), Measured::Valves(switched));
    }
    Ok(())
}
