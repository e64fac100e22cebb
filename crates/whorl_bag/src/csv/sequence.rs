//! Lines of a CSV file in the order of their times, each time once, each measurement once.

use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};

use super::error::CsvError;
use super::held::{Runs, Thinning, said};
use super::map::CsvMap;
use super::rows::{CsvRow, RowReader};
use super::same_time::{MOST_LINES, mean, spread};
use super::time::Duplicates;
use crate::channels::{Channel, Form};

/// Lines in which held values are looked for.
const LOOKED_AT: usize = 4_000;
/// A direction that has not changed for so long is measured again \[s\] ...
const CONSTANT_S: f64 = 1.0;
/// ... and for so many times as long as it usually stays the same.
const CONSTANT_TIMES: f64 = 4.0;

/// Reads lines one after the other and checks them.
///
/// - Lines of one time are joined where different sensors have numbers in them; else the map says what they are.
/// - A log that is faster than a gyro, an accelerometer or a wheel's tachometer repeats its values: found in the first
///   lines, and the repetitions are left out. A direction that is the same as in the line before is left out unless the map says
///   that it is a measurement, or it has been the same for much longer than usual: an exact constant.
/// - A last line without an end, with cells missing or cut, is left out.
///
/// [`Self::notes`] says what was left out.
pub struct CsvRows {
    path: PathBuf,
    rows: RowReader,
    time_column: Option<String>,
    duplicates: Duplicates,
    /// Behind the line that was given last: the next one, or why there is none.
    ahead: Option<Result<CsvRow, CsvError>>,
    ended: bool,
    /// Lines that were read to look for held values.
    looked_at: VecDeque<Result<CsvRow, CsvError>>,
    begun: bool,
    held: BTreeMap<Channel, (u32, Thinning)>,
    vectors: Vec<Directions>,
    averaged: u64,
    /// Lines of one time that are still to be given.
    burst: VecDeque<CsvRow>,
    before_ns: Option<i64>,
    torn_line: Option<u64>,
}

/// Which values of a vector sensor are measurements.
#[derive(Debug, Clone, Default)]
struct Directions {
    repeats: Option<bool>,
    /// For how long a value may stay the same and count as held \[ns\].
    longest_ns: i64,
    last: Option<([f64; 3], i64)>,
    left_out: u64,
}

impl CsvRows {
    /// Opens a file, compressed with gzip or not, and finds the map's columns in its header.
    ///
    /// # Errors
    /// [`CsvError::Io`], [`CsvError::Format`], [`CsvError::MissingColumn`].
    pub fn open(path: &Path, map: &CsvMap) -> Result<Self, CsvError> {
        let vector = |repeats| Directions { repeats, ..Directions::default() };
        Ok(Self {
            path: path.to_owned(),
            rows: RowReader::open(path, map)?,
            time_column: map.time.source.column().map(str::to_owned),
            duplicates: map.time.duplicates,
            ahead: None,
            ended: false,
            looked_at: VecDeque::new(),
            begun: false,
            held: BTreeMap::new(),
            vectors: map.vectors.iter().map(|map| vector(map.repeats)).collect(),
            averaged: 0,
            burst: VecDeque::new(),
            before_ns: None,
            torn_line: None,
        })
    }

    /// Names of the columns that the map does not name.
    #[must_use]
    pub fn unread_columns(&mut self) -> Vec<String> {
        self.rows.table().unread()
    }

    /// The next line; `None` at the end.
    ///
    /// # Errors
    /// What is wrong with it; the time must increase from line to line.
    pub fn next_row(&mut self) -> Result<Option<CsvRow>, CsvError> {
        if !self.begun {
            self.begun = true;
            self.look();
        }
        let next = match self.looked_at.pop_front() {
            Some(row) => Some(row?),
            None => self.next_in_time()?,
        };
        Ok(next.map(|mut row| {
            self.leave_out_repetitions(&mut row);
            row
        }))
    }

    /// What was left out so far, in words.
    #[must_use]
    pub fn notes(&mut self) -> Vec<String> {
        let mut notes = self.rows.notes();
        let left_out = self.held.iter().filter(|(_, (_, thinning))| thinning.left_out > 0);
        for (channel, (held, thinning)) in left_out {
            notes.push(said(&format!("the {}", channel.info().key), *held, thinning.left_out));
        }
        if self.averaged > 0 {
            let what = match self.duplicates {
                Duplicates::Mean => "their mean counts",
                Duplicates::Burst => "they were spread over the time since the one before",
                Duplicates::First | Duplicates::Refuse => "the first counts",
            };
            notes.push(format!("{} lines have the time of the line before: {what}.", self.averaged));
        }
        let headers = self.rows.table().headers_again();
        if headers > 0 {
            notes.push(format!("The header stands in the file again {headers} times: left out."));
        }
        if let Some(line) = self.torn_line {
            notes
                .push(format!("Line {line}, the last, has no end and was left out: the writer was stopped."));
        }
        notes
    }

    /// Reads the first lines to see which values are held.
    fn look(&mut self) {
        let mut runs: BTreeMap<Channel, Runs> = BTreeMap::new();
        let mut directions = vec![(Runs::default(), 0_u32, [0_i64; 2]); self.vectors.len()];
        while self.looked_at.len() < LOOKED_AT {
            match self.next_in_time() {
                Ok(None) => break,
                Err(error) => {
                    self.looked_at.push_back(Err(error));
                    break;
                }
                Ok(Some(row)) => {
                    for (channel, numbers) in row.numbers.iter().filter(|(channel, _)| may_be_held(**channel))
                    {
                        runs.entry(*channel).or_default().add(numbers);
                    }
                    let seen = row.vectors_b.iter().zip(&mut directions);
                    for (vector, (runs, count, [first_ns, last_ns])) in seen {
                        let Some(vector) = vector else { continue };
                        runs.add(vector.as_slice());
                        if *count == 0 {
                            *first_ns = row.time_ns;
                        }
                        *last_ns = row.time_ns;
                        *count += 1;
                    }
                    self.looked_at.push_back(Ok(row));
                }
            }
        }
        for (channel, runs) in runs {
            self.held.extend(runs.held().map(|held| (channel, (held, Thinning::new(held)))));
        }
        for (vector, (runs, count, [first_ns, last_ns])) in self.vectors.iter_mut().zip(directions) {
            let line_s = (last_ns - first_ns) as f64 * 1e-9 / f64::from(count.max(2) - 1);
            let usual_s = runs.usual().map_or(0.0, |lines| f64::from(lines) * line_s);
            vector.longest_ns = ((CONSTANT_TIMES * usual_s).max(CONSTANT_S) * 1e9) as i64;
        }
    }

    fn leave_out_repetitions(&mut self, row: &mut CsvRow) {
        for (channel, (_, thinning)) in &mut self.held {
            if row.numbers.get(channel).is_some_and(|numbers| !thinning.is_new(numbers)) {
                row.numbers.remove(channel);
            }
        }
        let seen = row.vectors_b.iter_mut().zip(&mut row.vector_lengths).zip(&mut self.vectors);
        for ((body, length), vector) in seen {
            if let (Some(direction), Some(size)) = (*body, *length)
                && !vector.is_new(row.time_ns, (direction.into_inner() * size).into())
            {
                (*body, *length) = (None, None);
            }
        }
    }

    /// The next time, all of its lines together.
    fn next_in_time(&mut self) -> Result<Option<CsvRow>, CsvError> {
        if let Some(row) = self.burst.pop_front() {
            return Ok(Some(row));
        }
        let Some(row) = self.ahead.take().or_else(|| self.read().transpose()) else { return Ok(None) };
        let mut row = row?;
        let mut same = Vec::new();
        while let Some(next) = self.read().transpose() {
            match next {
                Ok(next) if next.time_ns == row.time_ns => {
                    if same.is_empty() && row.is_apart_from(&next) {
                        row.take(next);
                    } else if self.duplicates == Duplicates::Refuse || same.len() >= MOST_LINES {
                        self.ahead = Some(Err(self.out_of_order(&row, &next)));
                        break;
                    } else {
                        self.averaged += 1;
                        if matches!(self.duplicates, Duplicates::Mean | Duplicates::Burst) {
                            same.push(next);
                        }
                    }
                }
                Ok(next) if next.time_ns < row.time_ns => {
                    self.ahead = Some(Err(self.out_of_order(&row, &next)));
                    break;
                }
                other => {
                    self.ahead = Some(other);
                    break;
                }
            }
        }
        let before_ns = self.before_ns.replace(row.time_ns);
        if same.is_empty() {
            return Ok(Some(row));
        }
        same.insert(0, row);
        if self.duplicates == Duplicates::Burst {
            let next_ns = self.ahead.as_ref().and_then(|next| Some(next.as_ref().ok()?.time_ns));
            spread(&mut same, before_ns, next_ns);
            self.burst.extend(same);
            return Ok(self.burst.pop_front());
        }
        Ok(mean(same))
    }

    fn out_of_order(&self, row: &CsvRow, next: &CsvRow) -> CsvError {
        let seconds = |ns: i64| ns as f64 / 1e9;
        CsvError::TimeOrder {
            path: self.path.clone(),
            line: next.line,
            column: self.time_column.clone().unwrap_or_default(),
            time_s: seconds(next.time_ns),
            previous_s: seconds(row.time_ns),
        }
    }

    /// The next line as it stands in the file.
    fn read(&mut self) -> Result<Option<CsvRow>, CsvError> {
        if self.ended {
            return Ok(None);
        }
        let row = self.rows.next_row();
        self.ended = !matches!(row, Ok(Some(_)));
        if let Err(
            CsvError::NotANumber { line, .. }
            | CsvError::Format { line, .. }
            | CsvError::Refused { line, .. },
        ) = &row
            && self.rows.table().is_torn()
        {
            self.torn_line = Some(*line);
            return Ok(None);
        }
        row
    }
}

/// Commands hold until the next, and slow channels say how long by themselves.
fn may_be_held(channel: Channel) -> bool {
    let info = channel.info();
    info.is_motion && !info.is_held && matches!(info.form, Form::Axes | Form::Wheels { .. })
}

impl Directions {
    fn is_new(&mut self, at_ns: i64, vector: [f64; 3]) -> bool {
        let again = self.last.is_some_and(|(last, since_ns)| {
            let held = self.repeats == Some(false) || at_ns.saturating_sub(since_ns) <= self.longest_ns;
            last == vector && held
        });
        if self.repeats == Some(true) || !again {
            self.last = Some((vector, at_ns));
            return true;
        }
        self.left_out += 1;
        false
    }
}

#[cfg(test)]
#[path = "forms_tests.rs"]
mod tests;
