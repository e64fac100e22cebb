//! The same line in a log, again and again.

use crate::Timestamp;

/// Lets one line of a kind pass each second and counts the others. A message that is refused a hundred times a second
/// must not fill the log, nor the network with it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Repeats {
    last: Option<Timestamp>,
    withheld: u64,
}

impl Repeats {
    /// Shortest time between two lines \[s\].
    const PERIOD_S: f64 = 1.0;

    /// The text to log now, with how many like it were withheld since the last one; `None`: withhold this one. `text` is
    /// called only if it is logged.
    pub fn admit(&mut self, now: Timestamp, text: impl FnOnce() -> String) -> Option<String> {
        if self.last.is_some_and(|last| now.seconds_since(last) < Self::PERIOD_S) {
            self.withheld += 1;
            return None;
        }
        self.last = Some(now);
        let text = text();
        Some(match std::mem::take(&mut self.withheld) {
            0 => text,
            withheld => format!("{text} (and {withheld} more like it since)"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_line_a_second_and_the_others_are_counted() {
        let mut repeats = Repeats::default();
        let lines: Vec<String> = (0..250)
            .filter_map(|k| {
                repeats.admit(Timestamp::from_seconds(f64::from(k) * 0.01), || format!("refused {k}"))
            })
            .collect();
        assert_eq!(
            lines,
            [
                "refused 0",
                "refused 100 (and 99 more like it since)",
                "refused 200 (and 99 more like it since)"
            ]
        );
    }
}
