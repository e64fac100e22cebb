//! Where the time of a line stands.

use whorl_params::Reader;

use crate::units;

/// The time of each line.
#[derive(Debug, Clone, PartialEq)]
pub struct TimeMap {
    /// Where it stands.
    pub source: TimeSource,
    /// The time that is the start of the run \[ns\]; `None`: that of the first line.
    pub start_ns: Option<i64>,
    /// What several lines of one time are.
    pub duplicates: Duplicates,
}

/// Where the time of a line stands.
#[derive(Debug, Clone, PartialEq)]
pub enum TimeSource {
    /// Numbers in a column, whose unit is ten to this power seconds.
    Numbers {
        /// Name of the column.
        column: String,
        /// See above.
        unit_power: i32,
    },
    /// Dates and times of ISO 8601 in a column of this name.
    Dates {
        /// Name of the column.
        column: String,
    },
    /// Nowhere: lines follow each other at this rate \[Hz\].
    Rate {
        /// See above.
        hz: f64,
    },
}

impl TimeSource {
    /// Name of the column.
    #[must_use]
    pub fn column(&self) -> Option<&str> {
        match self {
            Self::Numbers { column, .. } | Self::Dates { column } => Some(column),
            Self::Rate { .. } => None,
        }
    }
}

/// What several lines of one time are. Lines of different channels are one line in any case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Duplicates {
    /// An error.
    #[default]
    Refuse,
    /// The first counts.
    First,
    /// Their mean counts.
    Mean,
    /// They were measured one after the other since the time before: a sensor with a buffer, read now and then.
    Burst,
}

/// Reads the group `time` of a map.
pub(super) fn read(r: &mut Reader<'_>) -> TimeMap {
    let source = if r.has("rate_hz") {
        if r.has("column") {
            r.reject("rate_hz", "a time column is given as well; allowed: one of the two");
        }
        let hz = r.f64(
            "rate_hz",
            whorl_params::range(1e-3..=1e6),
            "lines in each second, in place of a time column [Hz]",
        );
        TimeSource::Rate { hz }
    } else {
        let column =
            r.string("column", "name of the time column; without one: rate_hz, lines in each second");
        let mut names: Vec<&str> = units::TIME.iter().map(|(name, _)| *name).collect();
        names.push(ISO);
        let chosen = r.choice_or("unit", "s", &names, "unit of the time column; iso: dates and times");
        match units::TIME.iter().find(|(name, _)| *name == chosen) {
            Some((_, unit_power)) => TimeSource::Numbers { column, unit_power: *unit_power },
            None => TimeSource::Dates { column },
        }
    };
    let holds = "time in this column that is the start of the run; left out: the first line";
    let start_ns = match &source {
        TimeSource::Dates { .. } => {
            let start = r.optional_string("start", holds);
            let start_ns = start.as_deref().map(super::iso::nanoseconds);
            if start_ns == Some(None) {
                r.reject("start", "is no date and time; allowed: as 2026-11-26T23:02:51.5Z");
            }
            start_ns.flatten()
        }
        TimeSource::Numbers { .. } | TimeSource::Rate { .. } => {
            let power = if let TimeSource::Numbers { unit_power, .. } = &source { *unit_power } else { 0 };
            let start = r.optional_f64("start", whorl_params::any(), holds);
            start.and_then(|start| units::nanoseconds(&format!("{start}"), power))
        }
    };
    let duplicates = r.choice_or(
        "duplicates",
        "refuse",
        &["refuse", "first", "mean", "burst"],
        "what several lines of one time are: an error, the first, their mean, or a burst: measured one after the other, evenly, since \
         the time before",
    );
    let duplicates = match duplicates {
        "first" => Duplicates::First,
        "mean" => Duplicates::Mean,
        "burst" => Duplicates::Burst,
        _ => Duplicates::Refuse,
    };
    TimeMap { source, start_ns, duplicates }
}

/// Unit of a time column of dates and times.
const ISO: &str = "iso";
