//! The time of a CSV file's lines.

use whorl_bag::LookedColumn;
use whorl_math::statistics::median;

use super::lines::{Origin, Sourced, number, quoted};
use super::names::{Meaning, Named};

/// Sensors sample between these \[Hz\].
const RATES: std::ops::RangeInclusive<f64> = 0.5..=10_000.0;
/// Units, the most usual first, in seconds.
const UNITS: [(&str, f64); 4] = [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)];
/// Since 1970: the year 2001 to 2100 \[s\].
const SINCE_1970_S: std::ops::RangeInclusive<f64> = 1e9..=4.1e9;
/// Lines in a second where nothing says how many.
const USUAL_HZ: f64 = 100.0;

/// The group `time` of the map, as YAML.
#[must_use]
pub fn time(columns: &[(&Named, &LookedColumn)], lines: usize) -> Sourced<String> {
    let rises = |column: &LookedColumn| {
        let values: Vec<f64> = column.present().collect();
        let up = values.windows(2).filter(|two| matches!(two, [a, b] if b >= a)).count();
        // A clock may be set back now and then.
        values.len() * 2 > lines
            && up * 100 >= values.len().saturating_sub(1) * 98
            && values.first() < values.last()
    };
    let dates = columns.iter().find(|(_, column)| column.dates * 2 > lines);
    if let Some((name, _)) = dates {
        let text = format!("time: {{column: {}, unit: iso}}", quoted(&name.column));
        return Sourced::new(text, Origin::Measured, "dates and times");
    }
    let called = |meaning: Meaning| {
        columns.iter().find(move |(name, column)| name.meaning == Some(meaning) && rises(column))
    };
    // Without a name that says so, the first column that rises evenly and is no counter.
    let first =
        columns.first().filter(|(name, column)| name.meaning.is_none() && rises(column) && !counts(column));
    let Some((name, column)) = called(Meaning::Time).or(first) else {
        let text = format!("time: {{rate_hz: {}}}", number(USUAL_HZ));
        return Sourced::new(
            text,
            Origin::Assumed,
            "no column rises as a time does; write the lines in each second",
        );
    };
    let values: Vec<f64> = column.present().collect();
    let step = median(
        values.windows(2).filter_map(|two| Some(two.get(1)? - two.first()?)).filter(|step| *step > 0.0),
    );
    let largest = values.iter().copied().fold(0.0, f64::max);
    let stated = name.unit.and_then(|unit| UNITS.iter().find(|(known, _)| *known == unit));
    let by_date = UNITS.iter().find(|(_, s)| SINCE_1970_S.contains(&(largest * s)));
    // The largest unit with which lines come as fast as sensors sample: a step of 10 is of milliseconds.
    let mut by_rate = UNITS.iter().filter(|(_, s)| RATES.contains(&(1.0 / (step * s))));
    let (by_rate, another) = (by_rate.next(), by_rate.next());
    let (chosen, origin, words) = match (stated, by_date, by_rate) {
        (Some(unit), ..) => (unit, Origin::Stated, "its name says the unit".to_owned()),
        (None, Some(unit), _) => (unit, Origin::Measured, "since 1970".to_owned()),
        (None, None, Some(unit)) if another.is_some() => {
            let other = another.map_or("", |(other, _)| other);
            (unit, Origin::Assumed, format!("{other} would give a rate that sensors have as well; check it"))
        }
        (None, None, Some(unit)) => {
            (unit, Origin::Assumed, "no other unit gives a rate that sensors have".to_owned())
        }
        (None, None, None) => (&UNITS[0], Origin::Assumed, "check it".to_owned()),
    };
    let rate_hz = 1.0 / (step * chosen.1);
    let (key, said) = match duplicates(column, columns) {
        Some((kind, why)) => (format!(", duplicates: {kind}"), format!("; {why}")),
        None => Default::default(),
    };
    let text = format!("time: {{column: {}, unit: {}{key}}}", quoted(&name.column), chosen.0);
    let with_rate = format!(
        "{words}; a new time usually after {} s, {} Hz{said}",
        number(step * chosen.1),
        number(rate_hz)
    );
    Sourced::new(text, origin, with_rate)
}

/// What several lines of one time are, by their numbers, as of messages in bags: bursts of a sensor with a buffer where most times have
/// samples that differ; else the first of each time counts. `None` where no sensor has two samples at one time.
fn duplicates(time: &LookedColumn, columns: &[(&Named, &LookedColumn)]) -> Option<(&'static str, String)> {
    let is_read = |meaning: Meaning| !matches!(meaning, Meaning::Time | Meaning::Count | Meaning::Derived);
    let sensors = || columns.iter().filter(|(name, _)| name.meaning.is_some_and(is_read));
    let (mut times, mut twice, mut differ) = (0_usize, 0_usize, 0_usize);
    let mut last = f64::NAN;
    for (line, at) in time.numbers.iter().enumerate().filter(|(_, at)| at.is_finite()) {
        if *at != std::mem::replace(&mut last, *at) {
            times += 1;
            continue;
        }
        let both = sensors().filter_map(|(_, column)| {
            let two = column.numbers.get(line.checked_sub(1)?..=line)?;
            two.iter().all(|x| x.is_finite()).then_some(two)
        });
        let (mut is_twice, mut is_other) = (false, false);
        both.for_each(|two| {
            is_twice = true;
            is_other |= two.first() != two.last();
        });
        twice += usize::from(is_twice);
        differ += usize::from(is_other);
    }
    if twice == 0 {
        return None;
    }
    let share = (times + twice) as f64 / times.max(1) as f64;
    Some(if 2 * differ >= times {
        ("burst", format!("usually {share:.0} samples have one time, and differ: read in bursts"))
    } else if differ == 0 {
        ("first", format!("{twice} lines stand there twice"))
    } else {
        ("first", format!("{twice} lines have the time of the line before: the first counts; check it"))
    })
}

/// Whether a column rises by one from line to line.
fn counts(column: &LookedColumn) -> bool {
    let values: Vec<f64> = column.present().collect();
    values.windows(2).all(|two| matches!(two, [a, b] if b - a == 1.0))
}
