//! Progress of computations: the current step, the share done and the time left. On a terminal in one line that is
//! written over, from a second on; elsewhere a line every ten seconds, on the standard error.

use std::io::{IsTerminal as _, Write as _};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use crate::output::{printable, tell};

/// Shorter computations show no progress.
const WORTH_SAYING: Duration = Duration::from_secs(1);

/// Time between two drawings.
const TICK: Duration = Duration::from_millis(200);

/// Time between two lines where there is no terminal.
const LINE: Duration = Duration::from_secs(10);

/// Characters of the bar.
const WIDTH: usize = 24;

/// Runs `work`, which cannot report its progress.
pub fn during<T>(what: &str, work: impl FnOnce() -> T) -> T {
    watched(what, |_| work())
}

/// Runs `work`, which reports its progress (0 to 1) and its current step from time to time; the first step is `what`.
pub fn watched<T>(what: &str, work: impl FnOnce(&mut dyn FnMut(f64, &str)) -> T) -> T {
    let is_terminal = std::io::stderr().is_terminal();
    let (said, heard): (Sender<(f64, String)>, _) = channel();
    let what = what.to_owned();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            let begun = Instant::now();
            let (mut state, mut is_drawn, mut next_line) = ((0.0, what), false, LINE);
            let mut reported = Duration::ZERO;
            loop {
                match heard.recv_timeout(TICK) {
                    // Work that begins anew is not undone.
                    Ok((share, doing)) if share <= state.0 => state.1 = doing,
                    Ok(news) => (state, reported) = (news, begun.elapsed()),
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => break,
                }
                if !is_terminal {
                    if begun.elapsed() >= next_line {
                        next_line += LINE;
                        tell(line(state.0, &state.1, reported, begun.elapsed()).trim_end());
                    }
                } else if begun.elapsed() > WORTH_SAYING {
                    draw(&line(state.0, &state.1, reported, begun.elapsed()));
                    is_drawn = true;
                }
            }
            if is_drawn {
                draw("");
            }
        });
        let mut say = |share: f64, doing: &str| {
            // Sending fails only if the other thread has failed; the work goes on.
            let _ = said.send((share, doing.to_owned()));
        };
        let result = work(&mut say);
        drop(said);
        result
    })
}

/// Replaces the line on the terminal.
fn draw(line: &str) {
    let mut terminal = std::io::stderr().lock();
    // The work goes on if the terminal is closed.
    let _ = write!(terminal, "\r\x1b[K{}", printable(line)).and_then(|()| terminal.flush());
}

/// Bar, share done, current step, time since the beginning, and time left: as long as what was done when the share was `reported`
/// lets one expect more. A step that takes longer says nothing of the time left.
fn line(share: f64, doing: &str, reported: Duration, elapsed: Duration) -> String {
    let elapsed_s = elapsed.as_secs_f64();
    if share <= 0.0 {
        return format!("{doing} ... {elapsed_s:.0} s");
    }
    let share = share.min(1.0);
    let full = (share * WIDTH as f64).round() as usize;
    let left_s = reported.as_secs_f64() / share - elapsed_s;
    let left = if left_s > 0.0 { format!(", about {:.0} s left", left_s.ceil()) } else { String::new() };
    format!(
        "[{}{}] {:3.0} %  {doing}, {elapsed_s:.0} s{left}",
        "#".repeat(full),
        ".".repeat(WIDTH - full),
        100.0 * share,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_how_far_and_how_long() {
        let s = Duration::from_secs;
        let half = |elapsed_s| line(0.5, "comparing explanations", s(4), s(elapsed_s));
        let bar = "[############............]  50 %  comparing explanations";
        assert_eq!(half(4), format!("{bar}, 4 s, about 4 s left"));
        assert_eq!(half(7), format!("{bar}, 7 s, about 1 s left"));
        assert_eq!(half(20), format!("{bar}, 20 s"), "nobody knows");
        assert_eq!(line(0.0, "reading", s(0), s(2)), "reading ... 2 s");
        // Rounding never overfills the bar.
        assert!(line(1.2, "x", s(2), s(2)).starts_with("[########################] 100 %"));
    }
}
