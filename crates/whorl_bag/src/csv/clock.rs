//! A clock of lines that passes its end, or was set.
//!
//! - A counter of 32 bits, such as `micros()` of a microcontroller, begins anew after 2^32 units, printed with a sign or without.
//! - A computer without a battery for its clock begins in another year, until it hears of the time.
//!
//! Both are bridged, and said: the lines behind are moved so that time goes on as it did.

/// Values of a counter of 32 bits.
const TURN: i64 = 1 << 32;
/// It passes its end when, unwrapped, no more than this part of its values is missing.
const TURN_PARTS: i64 = 64;
/// No file has a gap of a year, ahead or back: the clock was set \[ns\].
const SET_NS: i64 = 365 * 86_400_000_000_000;
/// Interval of lines before two of them are known \[ns\].
const UNKNOWN_NS: i64 = 10_000_000;
/// More than this are counted, and not listed.
const MOST_LISTED: usize = 5;

/// Follows the time of lines.
#[derive(Debug, Clone, Default)]
pub(super) struct LineClock {
    /// All values of a counter of 32 bits \[ns\]; `None`: the time is no counter, or these are too many.
    turn_ns: Option<i64>,
    last_ns: Option<i64>,
    interval_ns: Option<i64>,
    /// What is added to the time of a line \[ns\].
    moved_ns: i64,
    /// The first line behind an end, and how many there are.
    turns: Option<(u64, u64)>,
    /// The first lines before which the clock was set, by how much \[ns\], and how many there are.
    sets: Vec<(u64, i64)>,
    set_count: u64,
}

impl LineClock {
    /// Of a counter whose unit is ten to this power seconds.
    pub fn counting(unit_power: i32) -> Self {
        let unit_ns = u32::try_from(unit_power + 9).ok().and_then(|power| 10_i64.checked_pow(power));
        Self { turn_ns: unit_ns.and_then(|unit_ns| unit_ns.checked_mul(TURN)), ..Self::default() }
    }

    /// The time of a line as it would have been \[ns\].
    pub fn follow(&mut self, line: u64, read_ns: i64) -> i64 {
        let mut at_ns = read_ns.saturating_add(self.moved_ns);
        if let Some(last_ns) = self.last_ns {
            let step_ns = at_ns.saturating_sub(last_ns);
            let turn_ns = self.turn_ns.filter(|turn_ns| {
                let unwrapped_ns = step_ns.saturating_add(*turn_ns);
                step_ns < 0 && (0..=turn_ns / TURN_PARTS).contains(&unwrapped_ns)
            });
            if let Some(turn_ns) = turn_ns {
                self.moved_ns = self.moved_ns.saturating_add(turn_ns);
                self.turns.get_or_insert((line, 0)).1 += 1;
            } else if step_ns.unsigned_abs() > SET_NS.unsigned_abs() {
                let expected_ns = self.interval_ns.unwrap_or(UNKNOWN_NS);
                self.moved_ns = self.moved_ns.saturating_sub(step_ns.saturating_sub(expected_ns));
                self.set_count += 1;
                if self.sets.len() < MOST_LISTED {
                    self.sets.push((line, step_ns));
                }
            } else if step_ns > 0 {
                self.interval_ns = Some(step_ns);
            }
            at_ns = read_ns.saturating_add(self.moved_ns);
        }
        self.last_ns = Some(at_ns);
        at_ns
    }

    /// What was bridged, in words.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if let Some((first, times)) = self.turns {
            let times = if times > 1 { format!(", {times} times in all") } else { String::new() };
            notes.push(format!(
                "The clock has 32 bits and begins anew in line {first}{times}: time goes on from there."
            ));
        }
        for (line, step_ns) in &self.sets {
            let (days, way) =
                (step_ns.unsigned_abs() as f64 / 86.4e12, if *step_ns > 0 { "ahead" } else { "back" });
            notes.push(format!(
                "The clock was set {way} by {days:.0} days before line {line}: the lines behind were moved, as if an interval like the \
                 one before had passed."
            ));
        }
        if self.set_count > MOST_LISTED as u64 {
            notes.push(format!("The clock was set {} times in all.", self.set_count));
        }
        notes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn followed(clock: &mut LineClock, times: &[i64]) -> Vec<i64> {
        (2..).zip(times).map(|(line, at)| clock.follow(line, *at)).collect()
    }

    #[test]
    fn counters_of_32_bits_go_on_behind_their_end() {
        let us = 1000;
        for first in [i64::from(u32::MAX), i64::from(i32::MAX)] {
            let begin = first - 1 - i64::from(u32::MAX);
            let times = [first - 10_000, first, begin + 10_000, begin + 20_000].map(|at| at * us);
            let mut clock = LineClock::counting(-6);
            let steps: Vec<i64> = followed(&mut clock, &times).windows(2).map(|w| w[1] - w[0]).collect();
            assert_eq!(steps, [10_000 * us, 10_000 * us, 10_000 * us]);
            assert_eq!(
                clock.notes(),
                ["The clock has 32 bits and begins anew in line 4: time goes on from there."]
            );
        }
        // A line that goes back a little is an error, and stays one.
        let mut clock = LineClock::counting(-6);
        assert_eq!(followed(&mut clock, &[5_000, 4_000]), [5_000, 4_000]);
        // Seconds never get there.
        assert_eq!(LineClock::counting(0).turn_ns, Some(TURN * 1_000_000_000));
        assert_eq!(LineClock::counting(3).turn_ns, None);
    }

    #[test]
    fn years_that_pass_between_two_lines_are_none() {
        let (year, ms) = (SET_NS + 1, 1_000_000);
        for by in [6 * year, -6 * year, year] {
            let mut clock = LineClock::counting(0);
            let found = followed(&mut clock, &[0, 10 * ms, 20 * ms + by, 30 * ms + by]);
            assert_eq!(found, [0, 10 * ms, 20 * ms, 30 * ms]);
            assert!(clock.notes()[0].contains("days before line 4"), "{:?}", clock.notes());
        }
        // A gap of a week is one.
        let week = 7 * 86_400_000 * ms;
        assert_eq!(followed(&mut LineClock::default(), &[0, 10, week]), [0, 10, week]);
    }
}
