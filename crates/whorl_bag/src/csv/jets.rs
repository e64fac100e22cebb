//! Commands of jets in a CSV file, as pulses.

/// The columns of the jets.
#[derive(Debug, Clone, PartialEq)]
pub struct JetMap {
    /// Names of the columns, in the order of the platform's jets.
    pub columns: Vec<String>,
    /// What they hold.
    pub quantity: JetQuantity,
    /// Seconds, or share, per unit of the columns.
    pub factor: f64,
    /// When pulses open.
    pub slot: Slot,
}

/// What a jet's column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JetQuantity {
    /// Time open in a slot \[s\].
    OnTime,
    /// Share of the slot.
    Duty,
    /// 1 while the valve is switched on, 0 while it is not.
    Open,
}

/// When pulses open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Slot {
    /// Slot follows slot; a pulse opens at its slot's start, and a command holds from its row on.
    Length {
        /// Length of a slot \[ns\], > 0.
        ns: i64,
    },
    /// Every row with numbers is a slot of its own.
    Row,
}

/// A command of one row: of each jet, in SI units; `None` where the cell is blank.
#[derive(Debug, Clone, PartialEq)]
pub struct JetCommand {
    /// Time of the row \[ns\].
    pub at_ns: i64,
    /// Line in the file, for messages.
    pub line: u64,
    /// On-time \[s\], share or state.
    pub value: Vec<Option<f64>>,
}

/// A valve switched on and off \[ns\].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CsvPulse {
    /// On.
    pub on_ns: i64,
    /// Off, later.
    pub off_ns: i64,
}

impl JetMap {
    /// What is wrong with a value, and what is allowed.
    pub(crate) fn refuse(&self, value: f64) -> Option<String> {
        let wrong = |allowed: String| Some(allowed);
        match (self.quantity, self.slot) {
            (JetQuantity::Open, _) if value != 0.0 && value != 1.0 => {
                wrong("allowed: 1 while the valve is switched on, else 0".into())
            }
            (JetQuantity::Duty, _) if !(0.0..=1.0 + 1e-9).contains(&value) => {
                wrong("allowed: a share of the slot, from 0 to 1 (0 to 100 with unit: \"%\")".into())
            }
            (JetQuantity::OnTime, Slot::Row) if value < 0.0 => {
                wrong("allowed: an on-time of at least 0".into())
            }
            (JetQuantity::OnTime, Slot::Length { ns })
                if !(0.0..=ns as f64 * 1e-9 * (1.0 + 1e-9)).contains(&value) =>
            {
                wrong(format!(
                    "allowed: an on-time from 0 to the slot's length, {} s; is the unit right?",
                    ns as f64 * 1e-9
                ))
            }
            _ => None,
        }
    }

    /// Whether a command tells nothing that the one before it did not tell: [`Self::pulses`] are the same without it. Of a
    /// file of millions of lines few are left.
    #[must_use]
    pub fn repeats(&self, before: &JetCommand, command: &JetCommand) -> bool {
        // Where every row is a slot of its own, the same on-time is another pulse.
        let fires_again = self.slot == Slot::Row && self.quantity != JetQuantity::Open;
        let off = |value: &Option<f64>| value.is_none_or(|x| x == 0.0);
        before.value == command.value && (!fires_again || command.value.iter().all(off))
    }

    /// The pulses of each jet, in order of time, of commands in order of time. `row_ns` is the usual time between
    /// rows, `end_ns` the time of the file's last row.
    #[must_use]
    pub fn pulses(&self, commands: &[JetCommand], row_ns: i64, end_ns: i64) -> Vec<Vec<CsvPulse>> {
        (0..self.columns.len())
            .map(|jet| {
                let values = commands
                    .iter()
                    .filter_map(|command| Some((command.at_ns, command.value.get(jet).copied().flatten()?)));
                match (self.quantity, self.slot) {
                    (JetQuantity::Open, _) => while_open(values, end_ns),
                    (_, Slot::Row) => at_rows(values),
                    (quantity, Slot::Length { ns }) => {
                        let values: Vec<(i64, f64)> = values.collect();
                        let grid =
                            Grid { origin_ns: self.origin_ns(commands, ns, row_ns), slot_ns: ns.max(1) };
                        grid.pulses(&values, quantity, row_ns, end_ns)
                    }
                }
            })
            .collect()
    }

    /// Where the slots begin: the phase at which commands change, if they all change at one; else at the
    /// first row with a command.
    fn origin_ns(&self, commands: &[JetCommand], slot_ns: i64, row_ns: i64) -> i64 {
        let Some(first) = commands.first() else { return 0 };
        let changes = commands.windows(2).filter_map(|pair| match pair {
            [before, after] if before.value != after.value => Some(after.at_ns),
            _ => None,
        });
        let changes: Vec<i64> = changes.collect();
        let near = |a: i64, b: i64| {
            let offset = (a - b).rem_euclid(slot_ns.max(1));
            offset.min(slot_ns - offset) <= row_ns / 2
        };
        let at_first = changes.iter().filter(|at| near(**at, first.at_ns)).count();
        let Some(&change) = changes.first() else { return first.at_ns };
        let at_change = changes.iter().filter(|at| near(**at, change)).count();
        // Nine in ten, and better than the grid of the first row.
        if at_change > at_first && at_change * 10 >= changes.len() * 9 {
            change - (change - first.at_ns).div_euclid(slot_ns.max(1)) * slot_ns
        } else {
            first.at_ns
        }
    }
}

fn add(pulses: &mut Vec<CsvPulse>, on_ns: i64, off_ns: i64) {
    if off_ns <= on_ns {
        return;
    }
    match pulses.last_mut() {
        Some(last) if on_ns <= last.off_ns => last.off_ns = last.off_ns.max(off_ns),
        _ => pulses.push(CsvPulse { on_ns, off_ns }),
    }
}

fn while_open(values: impl Iterator<Item = (i64, f64)>, end_ns: i64) -> Vec<CsvPulse> {
    let mut pulses = Vec::new();
    let mut since: Option<i64> = None;
    for (at, value) in values {
        if value != 0.0 {
            since.get_or_insert(at);
        } else if let Some(on) = since.take() {
            add(&mut pulses, on, at);
        }
    }
    if let Some(on) = since {
        add(&mut pulses, on, end_ns);
    }
    pulses
}

fn at_rows(values: impl Iterator<Item = (i64, f64)>) -> Vec<CsvPulse> {
    let mut pulses = Vec::new();
    for (at, on_time_s) in values {
        add(&mut pulses, at, at.saturating_add(ns(on_time_s)));
    }
    pulses
}

fn ns(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}

struct Grid {
    origin_ns: i64,
    slot_ns: i64,
}

impl Grid {
    fn pulses(
        &self,
        values: &[(i64, f64)],
        quantity: JetQuantity,
        row_ns: i64,
        end_ns: i64,
    ) -> Vec<CsvPulse> {
        let mut pulses = Vec::new();
        // A row that comes a little after its slot's start, as stamps do, still commands that slot.
        let grace_ns = (row_ns / 2).min(self.slot_ns / 4);
        let mut next = 0;
        let mut held: Option<f64> = None;
        let mut start = self.origin_ns;
        while start <= end_ns {
            while let Some((at, value)) = values.get(next)
                && *at <= start.saturating_add(grace_ns)
            {
                held = Some(*value);
                next += 1;
            }
            match held {
                Some(value) if value > 0.0 => {
                    let on_ns = match quantity {
                        JetQuantity::Duty => (value * self.slot_ns as f64).round() as i64,
                        _ => ns(value),
                    };
                    add(&mut pulses, start, start + on_ns.min(self.slot_ns));
                    start = start.saturating_add(self.slot_ns);
                }
                // Nothing fires before the next row: no need to visit every slot until then.
                _ => {
                    let Some((at, _)) = values.get(next) else { break };
                    let skipped = (at - grace_ns - start).div_euclid(self.slot_ns).max(0);
                    start = start.saturating_add(skipped.max(1).saturating_mul(self.slot_ns));
                }
            }
        }
        pulses
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    fn map(quantity: JetQuantity, slot: Slot) -> JetMap {
        JetMap { columns: vec!["a".into()], quantity, factor: 1.0, slot }
    }

    fn commands(rows: &[(i64, f64)]) -> Vec<JetCommand> {
        let command = |(i, &(ms, value)): (usize, &(i64, f64))| JetCommand {
            at_ns: ms * MS,
            line: i as u64,
            value: vec![(!value.is_nan()).then_some(value)],
        };
        rows.iter().enumerate().map(command).collect()
    }

    fn pulses(map: &JetMap, rows: &[(i64, f64)], row_ms: i64, end_ms: i64) -> Vec<(i64, i64)> {
        let found = map.pulses(&commands(rows), row_ms * MS, end_ms * MS);
        found[0].iter().map(|p| (p.on_ns / MS, p.off_ns / MS)).collect()
    }

    const SLOT: Slot = Slot::Length { ns: 100 * MS };

    #[test]
    fn a_command_holds_from_its_row_on_and_opens_at_each_slots_start() {
        let on_time = map(JetQuantity::OnTime, SLOT);
        // Rows every 10 ms, one command for each slot.
        let rows: Vec<(i64, f64)> =
            (0..40).map(|i| (i * 10, if (10..30).contains(&i) { 0.03 } else { 0.0 })).collect();
        assert_eq!(pulses(&on_time, &rows, 10, 390), [(100, 130), (200, 230)]);
        // One row a second: the command fires ten slots.
        let duty = map(JetQuantity::Duty, SLOT);
        let sparse = pulses(&duty, &[(0, 0.5), (1000, 0.0)], 1000, 2000);
        assert_eq!(sparse.len(), 10);
        assert_eq!((sparse[0], sparse[9]), ((0, 50), (900, 950)));
        // Full slots join.
        assert_eq!(pulses(&duty, &[(0, 1.0), (300, 0.0)], 10, 500), [(0, 300)]);
        // A row that comes late still commands its slot; one in the middle of a slot waits for the next.
        assert_eq!(pulses(&on_time, &[(0, 0.0), (104, 0.02), (203, 0.0)], 10, 500), [(100, 120)]);
        // A missing cell is no new command.
        assert_eq!(
            pulses(&on_time, &[(0, 0.02), (100, f64::NAN), (200, 0.0)], 10, 500),
            [(0, 20), (100, 120)]
        );
    }

    #[test]
    fn slots_begin_where_the_commands_change() {
        let on_time = map(JetQuantity::OnTime, SLOT);
        // The log began 30 ms before a slot did.
        let rows: Vec<(i64, f64)> = (0..40)
            .map(|i| (i * 10, if (13..23).contains(&i) { 0.04 } else { 0.0 }))
            .map(|(t, u)| (t, if (230..330).contains(&t) { 0.01 } else { u }))
            .collect();
        assert_eq!(pulses(&on_time, &rows, 10, 390), [(130, 170), (230, 240)]);
    }

    #[test]
    fn rows_and_states_are_pulses_of_their_own() {
        let rows = map(JetQuantity::OnTime, Slot::Row);
        assert_eq!(
            pulses(&rows, &[(7, 0.02), (20, 0.0), (25, 0.01), (90, 0.005)], 10, 100),
            [(7, 35), (90, 95)]
        );
        let open = map(JetQuantity::Open, Slot::Row);
        assert_eq!(
            pulses(&open, &[(0, 0.0), (10, 1.0), (20, 1.0), (30, 0.0), (90, 1.0)], 10, 100),
            [(10, 30), (90, 100)]
        );
    }

    #[test]
    fn commands_that_repeat_the_one_before_change_no_pulse() {
        // At 100 Hz: nothing, an on-time, another, a blank cell, nothing again; then a single row.
        let value = |i: i64| match i {
            33..52 => 0.03,
            52..71 => 0.05,
            71..80 => f64::NAN,
            90 => 0.02,
            _ => 0.0,
        };
        let rows: Vec<(i64, f64)> = (0..200).map(|i| (i * 10, value(i))).collect();
        let states: Vec<(i64, f64)> =
            rows.iter().map(|(ms, x)| (*ms, if x.is_nan() { *x } else { f64::from(*x > 0.0) })).collect();
        for (quantity, slot, rows, count) in [
            (JetQuantity::OnTime, SLOT, &rows, 7),
            (JetQuantity::OnTime, Slot::Row, &rows, 43),
            (JetQuantity::Open, Slot::Row, &states, 6),
        ] {
            let map = map(quantity, slot);
            let all = commands(rows);
            let mut told: Vec<JetCommand> = Vec::new();
            for command in &all {
                if told.last().is_none_or(|before| !map.repeats(before, command)) {
                    told.push(command.clone());
                }
            }
            let pulses = |commands: &[JetCommand]| map.pulses(commands, 10 * MS, 1990 * MS);
            assert_eq!(told.len(), count, "{quantity:?} {slot:?}");
            assert!(!pulses(&all)[0].is_empty());
            assert_eq!(pulses(&told), pulses(&all), "{quantity:?} {slot:?}");
        }
    }

    #[test]
    fn a_slot_far_away_is_reached_at_once() {
        let duty = map(JetQuantity::Duty, Slot::Length { ns: MS });
        let far = i64::MAX / MS / 2;
        assert_eq!(duty.pulses(&commands(&[(0, 0.0), (far, 0.5)]), 10 * MS, far * MS)[0].len(), 1);
    }
}
