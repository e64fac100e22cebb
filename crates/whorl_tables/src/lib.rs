//! Tables as Parquet files, in folders that DuckDB, Polars, pandas, Spark and MATLAB read as one table.
//!
//! A folder is hive-partitioned: `channel=gyro/run=swing/whorl_1.parquet` has the columns `channel` and `run` beside those of
//! the file. Files are written whole or not at all, so a folder can be read while others write into it, and writing the
//! same part again replaces it.

mod partition;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::Type;
use thiserror::Error;
use whorl_files::NewFile;

pub use partition::partition;

/// Rows of a row group: a few MB, which readers skip or read as a whole.
const ROWS: usize = 100_000;

/// Values of a column.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Numbers; NaN becomes null.
    Numbers(Vec<f64>),
    /// Whole numbers.
    Whole(Vec<i64>),
    /// Texts.
    Texts(Vec<String>),
    /// Truth values.
    Truths(Vec<bool>),
}

impl Values {
    fn len(&self) -> usize {
        match self {
            Self::Numbers(values) => values.len(),
            Self::Whole(values) => values.len(),
            Self::Texts(values) => values.len(),
            Self::Truths(values) => values.len(),
        }
    }
}

/// A table: columns of the same length, by name.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    columns: Vec<(String, Values)>,
    notes: Vec<(String, String)>,
}

/// Why a table was not written.
#[derive(Debug, Error)]
pub enum TableError {
    /// A column differs in length.
    #[error("column {column} has {rows} rows, and the table {expected}")]
    Rows {
        /// Its name.
        column: String,
        /// Its rows.
        rows: usize,
        /// Those of the first column.
        expected: usize,
    },
    /// Two columns of one name.
    #[error("there are two columns {0}")]
    Twice(String),
    /// The file system refused.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// What was tried.
        action: &'static str,
        /// On which file.
        path: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
    /// The file cannot be written.
    #[error("cannot write {}: {source}", path.display())]
    Parquet {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: ParquetError,
    },
}

impl Table {
    /// Adds a column.
    #[must_use]
    pub fn with(mut self, name: impl Into<String>, values: Values) -> Self {
        self.columns.push((name.into(), values));
        self
    }

    /// Adds a fact to the file's metadata.
    #[must_use]
    pub fn noting(mut self, key: impl Into<String>, text: impl Into<String>) -> Self {
        self.notes.push((key.into(), text.into()));
        self
    }

    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |(_, values)| values.len())
    }

    fn check(&self) -> Result<(), TableError> {
        let expected = self.rows();
        for (k, (name, values)) in self.columns.iter().enumerate() {
            if values.len() != expected {
                return Err(TableError::Rows { column: name.clone(), rows: values.len(), expected });
            }
            if self.columns.iter().take(k).any(|(other, _)| other == name) {
                return Err(TableError::Twice(name.clone()));
            }
        }
        Ok(())
    }

    /// The table as CSV with a line of names; numbers with as many digits as give them back, nothing for NaN.
    ///
    /// # Errors
    /// Columns that do not fit.
    pub fn csv_text(&self) -> Result<String, TableError> {
        self.check()?;
        let cell = |values: &Values, row: usize| match values {
            Values::Numbers(v) => v.get(row).filter(|x| !x.is_nan()).map(|x| format!("{x:?}")),
            Values::Whole(v) => v.get(row).map(i64::to_string),
            Values::Texts(v) => v.get(row).cloned(),
            Values::Truths(v) => v.get(row).map(bool::to_string),
        };
        let mut writer = csv::Writer::from_writer(Vec::new());
        // Writing to memory cannot fail.
        let _ = writer.write_record(self.columns.iter().map(|(name, _)| name));
        for row in 0..self.rows() {
            let _ = writer.write_record(self.columns.iter().map(|(_, v)| cell(v, row).unwrap_or_default()));
        }
        Ok(String::from_utf8(writer.into_inner().unwrap_or_default()).unwrap_or_default())
    }

    /// Writes the table as a Parquet file, Snappy-compressed, whole or not at all; folders are made.
    ///
    /// # Errors
    /// Columns that do not fit, a file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), TableError> {
        self.check()?;
        let io = |action, path: &Path| {
            let path = path.to_owned();
            move |source| TableError::Io { action, path, source }
        };
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(io("create", folder))?;
        }
        let mut file = NewFile::create(path).map_err(io("create", path))?;
        self.write_to(&mut file).map_err(|source| TableError::Parquet { path: path.to_owned(), source })?;
        file.finish().map_err(io("write", path))
    }

    fn write_to(&self, file: &mut NewFile) -> Result<(), ParquetError> {
        let fields = self.columns.iter().map(|(name, values)| Ok(Arc::new(field(name, values)?)));
        let fields = fields.collect::<Result<Vec<_>, ParquetError>>()?;
        let schema = Arc::new(Type::group_type_builder("table").with_fields(fields).build()?);
        let notes = self.notes.iter().map(|(key, text)| KeyValue::new(key.clone(), text.clone()));
        let properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_created_by(format!("whorl {}", env!("CARGO_PKG_VERSION")))
            .set_key_value_metadata(Some(notes.collect()))
            .build();
        let mut writer = SerializedFileWriter::new(file, schema, Arc::new(properties))?;
        let rows = self.rows();
        for from in (0..rows).step_by(ROWS) {
            let to = rows.min(from + ROWS);
            let mut group = writer.next_row_group()?;
            for (_, values) in &self.columns {
                column(&mut group, values, from, to)?;
            }
            group.close()?;
        }
        writer.close()?;
        Ok(())
    }
}

fn field(name: &str, values: &Values) -> Result<Type, ParquetError> {
    let (physical, repetition, logical) = match values {
        Values::Numbers(_) => (Physical::DOUBLE, Repetition::OPTIONAL, None),
        Values::Whole(_) => (Physical::INT64, Repetition::REQUIRED, None),
        Values::Texts(_) => (Physical::BYTE_ARRAY, Repetition::REQUIRED, Some(LogicalType::String)),
        Values::Truths(_) => (Physical::BOOLEAN, Repetition::REQUIRED, None),
    };
    let builder = Type::primitive_type_builder(name, physical);
    builder.with_repetition(repetition).with_logical_type(logical).build()
}

fn column(
    group: &mut SerializedRowGroupWriter<'_, &mut NewFile>,
    values: &Values,
    from: usize,
    to: usize,
) -> Result<(), ParquetError> {
    let Some(mut writer) = group.next_column()? else {
        return Err(ParquetError::General("more columns than the schema has".to_owned()));
    };
    match values {
        Values::Numbers(values) => {
            let values = values.get(from..to).unwrap_or_default();
            let there: Vec<f64> = values.iter().copied().filter(|x| !x.is_nan()).collect();
            let levels: Vec<i16> = values.iter().map(|x| i16::from(!x.is_nan())).collect();
            writer.typed::<DoubleType>().write_batch(&there, Some(&levels), None)?;
        }
        Values::Whole(values) => {
            writer.typed::<Int64Type>().write_batch(values.get(from..to).unwrap_or_default(), None, None)?;
        }
        Values::Texts(values) => {
            let texts = values.get(from..to).unwrap_or_default().iter();
            let texts: Vec<ByteArray> = texts.map(|text| ByteArray::from(text.as_str())).collect();
            writer.typed::<ByteArrayType>().write_batch(&texts, None, None)?;
        }
        Values::Truths(values) => {
            writer.typed::<BoolType>().write_batch(values.get(from..to).unwrap_or_default(), None, None)?;
        }
    }
    writer.close()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_that_do_not_fit_are_refused_and_nothing_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b.parquet");
        let table = Table::default().with("x", Values::Numbers(vec![1.0, 2.0]));
        let short = table.clone().with("y", Values::Whole(vec![1]));
        assert_eq!(short.write(&path).unwrap_err().to_string(), "column y has 1 rows, and the table 2");
        let twice = table.clone().with("x", Values::Whole(vec![1, 2]));
        assert_eq!(twice.write(&path).unwrap_err().to_string(), "there are two columns x");
        assert!(!path.parent().unwrap().exists());
        table.write(&path).unwrap();
        let held: Vec<_> = fs::read_dir(path.parent().unwrap()).unwrap().collect();
        assert_eq!(held.len(), 1);
        // A file in place of a folder: an error that names it.
        let error = table.write(&path.join("c.parquet")).unwrap_err().to_string();
        assert!(error.starts_with("cannot create") && error.contains("b.parquet"), "{error}");
    }
}
