//! Reading numbers from named columns.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use whorl_math::words::{one_line, shortened};

use super::error::{CsvError, LONGEST};
use super::source::Source;

/// Stands for the column of an axis that a sensor does not have.
pub const NO_COLUMN: &str = "~";

/// More columns than this are no table of measurements.
pub(super) const MOST_COLUMNS: usize = 4_000;

/// A CSV file, compressed with gzip or not, of which some columns are read.
pub(crate) struct Table {
    path: PathBuf,
    reader: ::csv::Reader<Source>,
    record: ::csv::StringRecord,
    header: ::csv::StringRecord,
    /// Indices of the columns that somebody asked for.
    asked: RefCell<BTreeSet<usize>>,
    /// Line of `record`; the header is line 1.
    line: u64,
    /// Whether numbers have a comma where others have a point.
    decimal_comma: bool,
    /// Lines that are the header again.
    headers_again: u64,
}

/// A column, and whether its sign is reversed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Column {
    index: usize,
    negative: bool,
}

impl Table {
    pub fn open(path: &Path, delimiter: u8, decimal_comma: bool) -> Result<Self, CsvError> {
        let source = Source::open(path, delimiter)?;
        let mut reader =
            ::csv::ReaderBuilder::new().delimiter(delimiter).trim(::csv::Trim::All).from_reader(source);
        let header = reader.headers().map_err(|e| CsvError::format(path, 1, &e))?.clone();
        if header.len() > MOST_COLUMNS {
            let reason = format!("{} columns; allowed: up to {MOST_COLUMNS}", header.len());
            return Err(CsvError::Format { path: path.to_owned(), line: 1, reason });
        }
        Ok(Self {
            path: path.to_owned(),
            reader,
            record: ::csv::StringRecord::new(),
            header,
            asked: RefCell::default(),
            line: 1,
            decimal_comma,
            headers_again: 0,
        })
    }

    /// How often the header stood in the file again.
    pub fn headers_again(&self) -> u64 {
        self.headers_again
    }

    /// Whether the present line is the last and has no end. It looks for a further line: only after an error.
    pub fn is_torn(&mut self) -> bool {
        let mut further = ::csv::StringRecord::new();
        matches!(self.reader.read_record(&mut further), Ok(false)) && self.reader.get_ref().is_torn()
    }

    /// Finds a column by name; `-name` is the column with its sign reversed, unless there is one that is
    /// really called that.
    pub fn column(&self, name: &str) -> Result<Column, CsvError> {
        let find = |name: &str| self.header.iter().position(|n| n == name);
        if let Some(index) = find(name) {
            self.asked.borrow_mut().insert(index);
            return Ok(Column { index, negative: false });
        }
        let index = name.strip_prefix('-').and_then(find).ok_or_else(|| CsvError::MissingColumn {
            path: self.path.clone(),
            column: name.to_owned(),
            present: self.header.iter().collect::<Vec<_>>().join(", "),
        })?;
        self.asked.borrow_mut().insert(index);
        Ok(Column { index, negative: true })
    }

    /// Names of the columns that nobody asked for.
    pub fn unread(&self) -> Vec<String> {
        let asked = self.asked.borrow();
        let unread =
            self.header.iter().enumerate().filter(|(index, name)| !name.is_empty() && !asked.contains(index));
        unread.map(|(_, name)| shortened(name, LONGEST).into_owned()).collect()
    }

    pub fn columns<const N: usize>(&self, names: &[String; N]) -> Result<[Column; N], CsvError> {
        let mut columns = [Column { index: 0, negative: false }; N];
        for (column, name) in columns.iter_mut().zip(names) {
            *column = self.column(name)?;
        }
        Ok(columns)
    }

    /// Goes to the next line that is not the header again; `false` at the end.
    pub fn advance(&mut self) -> Result<bool, CsvError> {
        while self.advance_once()? {
            if self.record != self.header {
                return Ok(true);
            }
            self.headers_again += 1;
        }
        Ok(false)
    }

    fn advance_once(&mut self) -> Result<bool, CsvError> {
        let next = self.line + 1;
        self.reader.get_mut().begin_record();
        let more =
            self.reader.read_record(&mut self.record).map_err(|e| CsvError::format(&self.path, next, &e))?;
        // Where the record begins is before the empty lines that were skipped; where the reader stands now is
        // one line behind it.
        let begin = self.record.position().map_or(next, ::csv::Position::line);
        self.line = begin.max(self.reader.position().line().saturating_sub(1));
        Ok(more)
    }

    pub fn line(&self) -> u64 {
        self.line
    }

    /// The text in a cell of the present line.
    pub fn text(&self, column: Column) -> &str {
        self.record.get(column.index).unwrap_or_default()
    }

    /// The number in a cell of the present line; `None` when it is empty or says that there is none.
    pub fn number(&self, column: Column) -> Result<Option<f64>, CsvError> {
        let text = self.text(column);
        if text.is_empty() || text.eq_ignore_ascii_case("nan") || text.eq_ignore_ascii_case("null") {
            return Ok(None);
        }
        match self.parsed(text) {
            Some(number) if number.is_finite() => Ok(Some(if column.negative { -number } else { number })),
            _ => Err(self.not_a_number(column)),
        }
    }

    fn parsed(&self, text: &str) -> Option<f64> {
        if self.decimal_comma && text.contains(',') {
            return text.replacen(',', ".", 1).parse().ok();
        }
        text.parse().ok()
    }

    /// What is wrong with a cell of the present line, and what may help.
    pub fn not_a_number(&self, column: Column) -> CsvError {
        let text = self.text(column);
        let with_point = text.replacen(',', ".", 1);
        let hint = if text.contains(',') && with_point.parse::<f64>().is_ok() {
            "; is it a decimal comma? `decimal: \",\"` in the map reads it"
        } else if super::iso::nanoseconds(text).is_some() {
            "; it is a date and time: `unit: iso` of the time column reads it"
        } else {
            ""
        };
        CsvError::NotANumber {
            path: self.path.clone(),
            line: self.line,
            column: one_line(self.header.get(column.index).unwrap_or_default()).into_owned(),
            text: text.to_owned(),
            hint,
        }
    }

    /// All numbers, or `None` when one of them is missing.
    pub fn numbers<const N: usize>(&self, columns: &[Column; N]) -> Result<Option<[f64; N]>, CsvError> {
        let mut numbers = [0.0; N];
        let mut complete = true;
        for (number, &column) in numbers.iter_mut().zip(columns) {
            match self.number(column)? {
                Some(value) => *number = value,
                None => complete = false,
            }
        }
        Ok(complete.then_some(numbers))
    }
}
