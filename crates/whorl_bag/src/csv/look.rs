//! What a CSV file holds, before anybody said which column is what.

use std::path::Path;

use super::error::CsvError;
use super::source::Source;
use super::table::MOST_COLUMNS;

/// What separates cells, most usual first.
const DELIMITERS: &[u8] = b",;\t| ";
/// Lines by which separators are compared.
const COMPARED: usize = 50;
/// Cells that are kept: 64 MB of numbers.
const MOST_CELLS: usize = 8_000_000;

/// The beginning of a CSV file: separator, names and numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct CsvLook {
    /// What separates cells.
    pub delimiter: u8,
    /// Whether numbers have a comma where others have a point.
    pub decimal_comma: bool,
    /// Columns in their order.
    pub columns: Vec<LookedColumn>,
    /// Lines that were looked at.
    pub lines: usize,
    /// Whether the first line has numbers where names should be.
    pub lacks_names: bool,
}

/// A column of a [`CsvLook`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LookedColumn {
    /// Its name.
    pub name: String,
    /// Its numbers; NaN where there is none.
    pub numbers: Vec<f64>,
    /// Dates and times in it.
    pub dates: usize,
    /// Cells with other text.
    pub words: usize,
}

impl LookedColumn {
    /// The numbers that are there.
    pub fn present(&self) -> impl Iterator<Item = f64> + '_ {
        self.numbers.iter().copied().filter(|x| x.is_finite())
    }
}

/// Looks at the first `most_lines` lines of a CSV file, plain or compressed with gzip: the separator is the one with which most lines
/// have the most cells with numbers.
///
/// # Errors
/// When it cannot be read, or holds no table.
pub fn look(path: &Path, most_lines: usize) -> Result<CsvLook, CsvError> {
    let mut best: Option<(f64, CsvLook)> = None;
    for delimiter in DELIMITERS {
        for decimal_comma in [false, true] {
            if decimal_comma && *delimiter == b',' {
                continue;
            }
            let look = with(path, *delimiter, decimal_comma, COMPARED)?;
            let score = look.score();
            if best.as_ref().is_none_or(|(least, _)| score > *least) {
                best = Some((score, look));
            }
        }
    }
    let (score, found) = best.ok_or_else(|| CsvError::Empty { path: path.to_owned() })?;
    if score <= 0.0 {
        return Err(CsvError::Empty { path: path.to_owned() });
    }
    with(path, found.delimiter, found.decimal_comma, most_lines)
}

fn with(path: &Path, delimiter: u8, decimal_comma: bool, most_lines: usize) -> Result<CsvLook, CsvError> {
    let source = Source::open(path, delimiter)?;
    let mut reader = ::csv::ReaderBuilder::new()
        .delimiter(delimiter)
        .flexible(true)
        .trim(::csv::Trim::All)
        .from_reader(source);
    let header = reader.headers().map_err(|e| CsvError::format(path, 1, &e))?.clone();
    let mut look = CsvLook {
        delimiter,
        decimal_comma,
        columns: header
            .iter()
            .take(MOST_COLUMNS)
            .map(|name| LookedColumn { name: name.to_owned(), ..LookedColumn::default() })
            .collect(),
        lines: 0,
        lacks_names: !header.is_empty()
            && header.iter().all(|cell| number(cell, decimal_comma).is_some() || cell.is_empty()),
    };
    let most_lines = most_lines.min(MOST_CELLS / look.columns.len().max(1));
    let mut record = ::csv::StringRecord::new();
    while look.lines < most_lines {
        reader.get_mut().begin_record();
        match reader.read_record(&mut record) {
            Ok(false) => break,
            Ok(true) if record == header => {}
            Ok(true) => look.add(&record),
            // What is wrong with a line is said when it is read for good.
            Err(_) if look.lines > 0 => break,
            Err(error) => return Err(CsvError::format(path, look.lines as u64 + 2, &error)),
        }
    }
    Ok(look)
}

impl CsvLook {
    fn add(&mut self, record: &::csv::StringRecord) {
        self.lines += 1;
        for (index, column) in self.columns.iter_mut().enumerate() {
            let cell = record.get(index).unwrap_or_default();
            let found = number(cell, self.decimal_comma);
            column.numbers.push(found.unwrap_or(f64::NAN));
            if found.is_none() && !is_missing(cell) {
                let is_date = super::iso::nanoseconds(cell).is_some();
                column.dates += usize::from(is_date);
                column.words += usize::from(!is_date);
            }
        }
    }

    /// Cells with numbers, less those with other text; a table has two columns or more. Points are more usual than commas.
    fn score(&self) -> f64 {
        if self.columns.len() < 2 {
            return 0.0;
        }
        let words: usize = self.columns.iter().map(|column| column.words).sum();
        let numbers: usize = self.columns.iter().map(|column| column.present().count() + column.dates).sum();
        let usual = if self.decimal_comma { 0.0 } else { 0.5 };
        if numbers == 0 { 0.0 } else { numbers as f64 - 0.5 * words as f64 + usual }
    }
}

fn is_missing(cell: &str) -> bool {
    cell.is_empty() || cell.eq_ignore_ascii_case("nan") || cell.eq_ignore_ascii_case("null")
}

fn number(cell: &str, decimal_comma: bool) -> Option<f64> {
    if is_missing(cell) {
        return None;
    }
    let parsed: Result<f64, _> =
        if decimal_comma { cell.replacen(',', ".", 1).parse() } else { cell.parse() };
    parsed.ok().filter(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn looked(text: &str) -> CsvLook {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("table.csv");
        std::fs::write(&file, text).unwrap();
        look(&file, 1000).unwrap()
    }

    #[test]
    fn long_tables_are_looked_at_to_their_end() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("table.csv");
        // 5 MB: more than one record may have.
        std::fs::write(&file, "t,a\n".to_owned() + &"0.123456789,1.23456789012345\n".repeat(180_000))
            .unwrap();
        assert_eq!(look(&file, 200_000).unwrap().lines, 180_000);
    }

    #[test]
    fn separators_and_decimals_are_found() {
        for (text, delimiter, comma) in [
            ("t,a,b\n0.5,1.5,2\n1.5,2.5,3\n", b',', false),
            ("t;a;b\n0,5;1,5;2\n1,5;2,5;3\n", b';', true),
            ("t;a;b\n0.5;1.5;2\n1.5;2.5;3\n", b';', false),
            ("t\ta\tb\n0,5\t1,5\t2\n1,5\t2,5\t3\n", b'\t', true),
            ("# made\n# t a b\n0.5 1.5 2\n1.5 2.5 3\n", b' ', false),
        ] {
            let found = looked(text);
            assert_eq!((found.delimiter, found.decimal_comma), (delimiter, comma), "{text}");
            let names: Vec<&str> = found.columns.iter().map(|column| column.name.as_str()).collect();
            assert_eq!(names, ["t", "a", "b"], "{text}");
            assert_eq!(found.columns[1].numbers, [1.5, 2.5], "{text}");
        }
    }

    #[test]
    fn dates_words_and_tables_without_names_are_told() {
        let found = looked("when,a,state\n2026-11-26T23:02:51Z,1,idle\n2026-11-26T23:02:52Z,,run\n");
        let [when, a, state] = &found.columns[..] else { panic!("{found:?}") };
        assert_eq!((when.dates, a.present().count(), state.words), (2, 1, 2));
        assert!(looked("0.1,2.0\n0.2,3.0\n").lacks_names && !found.lacks_names);
    }
}
