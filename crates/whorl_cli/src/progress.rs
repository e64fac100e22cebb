//! Progress of computations: the current step, the share done and the time left. On a terminal in one line that is
//! written over, from a second on; elsewhere a line every ten seconds, on the standard error.

use std::io::{IsTerminal as _, Write as _};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

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
            loop {
                match heard.recv_timeout(TICK) {
                    Ok(news) => state = news,
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => break,
                }
                if !is_terminal {
                    if begun.elapsed() >= next_line {
                        next_line += LINE;
                        eprintln!("{}", line(state.0, &state.1, begun.elapsed()).trim_end());
                    }
                } else if begun.elapsed() > WORTH_SAYING {
                    draw(&line(state.0, &state.1, begun.elapsed()));
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
    let _ = write!(terminal, "\r\x1b[K{line}").and_then(|()| terminal.flush());
}

/// Bar, share done, current step and time left.
fn line(share: f64, doing: &str, elapsed: Duration) -> String {
    let elapsed_s = elapsed.as_secs_f64();
    if share <= 0.0 {
        return format!("{doing} ... {elapsed_s:.0} s");
    }
    let share = share.min(1.0);
    let full = (share * WIDTH as f64).round() as usize;
    let left_s = elapsed_s * (1.0 - share) / share;
    format!(
        "[{}{}] {:3.0} %  {doing}, about {:.0} s left",
        "#".repeat(full),
        ".".repeat(WIDTH - full),
        100.0 * share,
        left_s.ceil()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_how_far_and_how_long() {
        let half = line(0.5, "comparing explanations", Duration::from_secs(4));
        assert_eq!(half, "[############............]  50 %  comparing explanations, about 4 s left");
        assert_eq!(line(0.0, "reading", Duration::from_secs(2)), "reading ... 2 s");
        // Rounding never overfills the bar.
        assert!(line(1.2, "x", Duration::from_secs(2)).starts_with("[########################] 100 %"));
    }
}
