//! Columns of one sensor.

use std::collections::BTreeMap;

use whorl_bag::LookedColumn;
use whorl_math::statistics::median;

use super::names::{Axis, Meaning, Named};

/// A length that scatters by less than this share of itself is that of a direction \[1\].
const STEADY: f64 = 0.1;

/// Columns of one sensor.
pub type Group<'a> = Vec<(&'a Named, &'a LookedColumn)>;
/// All of them, by the name that their columns share and what it means.
pub type Groups<'a> = BTreeMap<(String, Option<Meaning>), Group<'a>>;

/// The usual length of three columns x, y, z, if it hardly varies.
pub fn steady_length(group: &Group<'_>) -> Option<f64> {
    let axis = |k: usize| cell(group, Axis::Body(k)).map(|(_, column)| column);
    let (x, y, z) = (axis(0)?, axis(1)?, axis(2)?);
    let lengths = x.numbers.iter().zip(&y.numbers).zip(&z.numbers);
    let lengths: Vec<f64> = lengths
        .map(|((x, y), z)| (x * x + y * y + z * z).sqrt())
        .filter(|length| length.is_finite())
        .collect();
    let usual = median(lengths.iter().copied());
    let spread = median(lengths.iter().map(|length| (length - usual).abs()));
    (usual > 0.0 && spread < STEADY * usual).then_some(usual)
}

/// The usual length of the columns that there are, where they are fewer than three axes.
pub fn usual_length(members: &Group<'_>) -> Option<f64> {
    if members.len() >= 3 {
        return None;
    }
    let lines = members.iter().map(|(_, column)| column.numbers.len()).max()?;
    let square = |k: usize| {
        members.iter().map(|(_, column)| column.numbers.get(k).map_or(f64::NAN, |x| x * x)).sum::<f64>()
    };
    let usual = median((0..lines).map(|k| square(k).sqrt()).filter(|length| length.is_finite()));
    (usual > 0.0).then_some(usual)
}

/// The column of an axis; of three that are numbered, those are x, y and z.
pub fn cell<'a>(group: &Group<'a>, axis: Axis) -> Option<(&'a Named, &'a LookedColumn)> {
    let find = |axis: Axis| group.iter().find(|(name, _)| name.axis == Some(axis)).copied();
    find(axis).or_else(|| {
        let mut numbers: Vec<usize> = group
            .iter()
            .filter_map(|(name, _)| if let Some(Axis::Number(n)) = name.axis { Some(n) } else { None })
            .collect();
        numbers.sort_unstable();
        let Axis::Body(k) = axis else { return None };
        let first = *numbers.first().filter(|first| **first < 2)?;
        let in_a_row = numbers.len() == 3 && group.len() == 3 && numbers.iter().copied().eq(first..first + 3);
        in_a_row.then(|| find(Axis::Number(first + k))).flatten()
    })
}
