//! Lines of a CSV file in SI units.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::{Quaternion, Unit, UnitQuaternion, Vector3};

use super::angle::Rates;
use super::clock::LineClock;
use super::error::CsvError;
use super::jets::{JetCommand, JetMap};
use super::map::{ColumnMap, CsvMap};
use super::table::{Column, NO_COLUMN, Table};
use super::time::TimeSource;
use crate::channels::Channel;

/// One line, in SI units; `None` where a cell that belongs to the quantity is blank.
#[derive(Debug, Clone, PartialEq)]
pub struct CsvRow {
    /// Its number; the header is line 1.
    pub line: u64,
    /// Time as the column has it \[ns\].
    pub time_ns: i64,
    /// Numbers of the channels that are axes, wheels or one number, where all of a channel's cells have one; NaN of an
    /// axis without a column.
    pub numbers: BTreeMap<Channel, Vec<f64>>,
    /// Of each vector sensor.
    pub vectors_b: Vec<Option<Unit<Vector3<f64>>>>,
    /// Length of each vector, in the unit of its columns.
    pub vector_lengths: Vec<Option<f64>>,
    /// Direction of each in the world, of sensors with columns for it.
    pub references_w: Vec<Option<Unit<Vector3<f64>>>>,
    /// Of each jet, if any of them has a number.
    pub jets: Option<JetCommand>,
    /// True attitude.
    pub q_world_body: Option<UnitQuaternion<f64>>,
    /// Whether the file's author wants errors of this line to be counted.
    pub scored: bool,
}

impl CsvRow {
    /// Numbers of a channel of axes; `None` where an axis is not measured.
    #[must_use]
    pub fn axes(&self, channel: Channel) -> Option<Vector3<f64>> {
        match self.numbers.get(&channel)?.as_slice() {
            &[x, y, z] if (x + y + z).is_finite() => Some(Vector3::new(x, y, z)),
            _ => None,
        }
    }
}

/// Reads lines one after the other, as they stand in the file.
pub(super) struct RowReader {
    path: PathBuf,
    table: Table,
    map: CsvMap,
    time: Clock,
    clock: LineClock,
    channels: Vec<(Channel, Columns)>,
    angles: Vec<Rates>,
    vectors: Vec<[Column; 3]>,
    references: Vec<Option<[Column; 3]>>,
    jets: Option<(JetMap, Vec<Column>)>,
    truth: Option<[Column; 4]>,
    scored: Option<Column>,
}

/// What tells the time of a line.
enum Clock {
    Numbers(Column, i32),
    Dates(Column),
    /// Lines so far, and in each second.
    Rate(u64, f64),
}

/// The columns of one channel.
struct Columns {
    /// `None`: an axis without a column.
    columns: Vec<Option<Column>>,
    factor: f64,
    offset: f64,
    /// Number of an axis without a column.
    absent: f64,
}

impl RowReader {
    pub fn open(path: &Path, map: &CsvMap) -> Result<Self, CsvError> {
        let table = Table::open(path, map.delimiter, map.decimal_comma)?;
        let scored = map.true_attitude.as_ref().and_then(|truth| truth.scored_column.as_ref());
        let find = |(channel, columns): (&Channel, &ColumnMap)| {
            let absent = channel.info().absent_axis().unwrap_or(f64::NAN);
            Ok::<_, CsvError>((*channel, Columns::find(&table, columns, absent)?))
        };
        Ok(Self {
            path: path.to_owned(),
            time: match &map.time.source {
                TimeSource::Numbers { column, unit_power } => {
                    Clock::Numbers(table.column(column)?, *unit_power)
                }
                TimeSource::Dates { column } => Clock::Dates(table.column(column)?),
                TimeSource::Rate { hz } => Clock::Rate(0, *hz),
            },
            clock: match &map.time.source {
                TimeSource::Numbers { unit_power, .. } => LineClock::counting(*unit_power),
                _ => LineClock::default(),
            },
            channels: map.channels.iter().map(find).collect::<Result<_, _>>()?,
            angles: map.angles.iter().map(|angles| Rates::find(&table, angles)).collect::<Result<_, _>>()?,
            vectors: map.vectors.iter().map(|v| table.columns(&v.columns)).collect::<Result<_, _>>()?,
            references: map
                .vectors
                .iter()
                .map(|v| v.reference_columns.as_ref().map(|names| table.columns(names)).transpose())
                .collect::<Result<_, _>>()?,
            jets: map
                .jets
                .as_ref()
                .map(|jets| Ok::<_, CsvError>((jets.clone(), find_all(&table, &jets.columns)?)))
                .transpose()?,
            truth: map.true_attitude.as_ref().map(|truth| table.columns(&truth.columns)).transpose()?,
            scored: scored.map(|name| table.column(name)).transpose()?,
            table,
            map: map.clone(),
        })
    }

    pub fn table(&mut self) -> &mut Table {
        &mut self.table
    }

    /// What was bridged in the time of the lines, in words.
    pub fn notes(&self) -> Vec<String> {
        self.clock.notes()
    }

    /// The next line; `None` at the end.
    pub fn next_row(&mut self) -> Result<Option<CsvRow>, CsvError> {
        if !self.table.advance()? {
            return Ok(None);
        }
        let read_ns = self.time()?;
        let time_ns = self.clock.follow(self.table.line(), read_ns);
        let table = &self.table;
        let mut numbers = BTreeMap::new();
        for (channel, columns) in &self.channels {
            numbers.extend(columns.numbers(table)?.map(|values| (*channel, values)));
        }
        for angles in &mut self.angles {
            let channel = angles.channel();
            numbers.extend(angles.numbers(table, time_ns)?.map(|values| (channel, values)));
        }
        let mut vectors_b = Vec::with_capacity(self.vectors.len());
        let mut vector_lengths = Vec::with_capacity(self.vectors.len());
        for columns in &self.vectors {
            // A vector of no length has no direction: no measurement.
            let numbers = table.numbers(columns)?;
            vector_lengths.push(numbers.map(|v| Vector3::from(v).norm()));
            vectors_b.push(numbers.and_then(|v| direction(Vector3::from(v))));
        }
        let mut references_w = Vec::with_capacity(self.references.len());
        for columns in &self.references {
            let numbers = columns.map(|columns| table.numbers(&columns)).transpose()?.flatten();
            references_w.push(numbers.and_then(|v| direction(Vector3::from(v))));
        }
        let truth = self.truth.map(|columns| table.numbers(&columns)).transpose()?.flatten();
        let scored = self.scored.map(|column| table.number(column)).transpose()?.flatten();
        let world_to_body = self.map.true_attitude.as_ref().is_some_and(|truth| truth.world_to_body);
        Ok(Some(CsvRow {
            line: table.line(),
            time_ns,
            numbers,
            vectors_b,
            vector_lengths,
            references_w,
            jets: self.jets(time_ns)?,
            q_world_body: truth.and_then(|[w, x, y, z]| {
                let q = Quaternion::new(w, x, y, z);
                let q = (q.norm() > 1e-6).then(|| UnitQuaternion::from_quaternion(q))?;
                Some(if world_to_body { q.inverse() } else { q })
            }),
            scored: self.scored.is_none() || scored.is_some_and(|scored| scored != 0.0),
        }))
    }

    fn time(&mut self) -> Result<i64, CsvError> {
        match &mut self.time {
            Clock::Numbers(column, unit_power) => {
                let text = self.table.text(*column);
                let point = text.replacen(',', ".", 1);
                let text = if self.map.decimal_comma { &point } else { text };
                let time_ns = crate::units::nanoseconds(text, *unit_power);
                time_ns.ok_or_else(|| self.table.not_a_number(*column))
            }
            Clock::Dates(column) => {
                let text = self.table.text(*column);
                super::iso::nanoseconds(text).ok_or_else(|| CsvError::Refused {
                    path: self.path.clone(),
                    line: self.table.line(),
                    column: self.map.time.source.column().unwrap_or_default().to_owned(),
                    text: format!("`{text}`"),
                    allowed: "allowed: a date and time as 2026-11-26T23:02:51.123Z".to_owned(),
                })
            }
            Clock::Rate(lines, hz) => {
                let time_ns = (*lines as f64 * (1e9 / *hz)).round() as i64;
                *lines += 1;
                Ok(time_ns)
            }
        }
    }

    fn jets(&self, at_ns: i64) -> Result<Option<JetCommand>, CsvError> {
        let Some((map, columns)) = &self.jets else { return Ok(None) };
        let line = self.table.line();
        let mut value = Vec::with_capacity(columns.len());
        for (column, name) in columns.iter().zip(&map.columns) {
            let number = self.table.number(*column)?.map(|x| x * map.factor);
            if let Some(allowed) = number.and_then(|x| map.refuse(x)) {
                return Err(CsvError::Refused {
                    path: self.path.clone(),
                    line,
                    column: name.clone(),
                    text: self.table.text(*column).to_owned(),
                    allowed,
                });
            }
            value.push(number);
        }
        Ok(value.iter().any(Option::is_some).then_some(JetCommand { at_ns, line, value }))
    }
}

impl Columns {
    fn find(table: &Table, map: &ColumnMap, absent: f64) -> Result<Self, CsvError> {
        let find = |name: &String| (name != NO_COLUMN).then(|| table.column(name)).transpose();
        let columns = map.columns.iter().map(find).collect::<Result<_, _>>()?;
        Ok(Self { columns, factor: map.factor, offset: map.offset, absent })
    }

    /// All numbers of the channel, or `None` when one of them is missing.
    fn numbers(&self, table: &Table) -> Result<Option<Vec<f64>>, CsvError> {
        let mut values = Vec::with_capacity(self.columns.len());
        for column in &self.columns {
            let Some(column) = column else {
                values.push(self.absent);
                continue;
            };
            // Every cell is looked at, so that a wrong one is found also beside a blank one.
            if let Some(x) = table.number(*column)? {
                values.push(self.factor * x + self.offset);
            }
        }
        Ok((values.len() == self.columns.len()).then_some(values))
    }
}

fn find_all(table: &Table, names: &[String]) -> Result<Vec<Column>, CsvError> {
    names.iter().map(|name| table.column(name)).collect()
}

/// One of length one stays as it is, to the bit: what was exported comes back.
pub(super) fn direction(v: Vector3<f64>) -> Option<Unit<Vector3<f64>>> {
    if (v.norm() - 1.0).abs() < 1e-12 { Some(Unit::new_unchecked(v)) } else { Unit::try_new(v, 1e-12) }
}
