//! The angle of a hinge, where no gyro was recorded.

use std::collections::BTreeSet;

use whorl_bag::{Channel, LookedColumn};

use super::channels::{Entry, MapDraft};
use super::group::Group;
use super::lines::{Origin, Sourced, number};
use super::names::{Axis, Meaning, Named, turn};

/// Its key in maps.
pub const HINGE_ANGLE: &str = "hinge_angle";

/// The angle about which a body turns: of those that are called angles the first, else of an encoder, which beside wheels may be a
/// motor's. Angles about several axes are those of an attitude, of which no rate follows here: a note says so.
pub fn take_angle(draft: &mut MapDraft, columns: &Group<'_>) {
    let has_wheels = draft.entry(Channel::WheelSpeed).is_some();
    let called = |wanted: Meaning| {
        let is =
            move |(name, column): &&(&Named, &LookedColumn)| name.meaning == Some(wanted) && changes(column);
        columns.iter().filter(is)
    };
    let angles: Vec<_> = called(Meaning::Angle).collect();
    let about: BTreeSet<usize> = angles.iter().filter_map(|(name, _)| named_axis(name)).collect();
    if about.len() > 1 {
        let names: Vec<&str> = angles.iter().map(|(name, _)| name.column.as_str()).collect();
        draft.notes.push(format!(
            "{} are angles about several axes, and not used: a map takes an attitude as a quaternion (true_attitude), and the angle of a \
             hinge alone (hinge_angle).",
            names.join(", ")
        ));
        return;
    }
    let encoder = || {
        called(Meaning::Encoder).find(|(name, _)| !has_wheels && !matches!(name.axis, Some(Axis::Body(_))))
    };
    let found = angles.first().copied().or_else(encoder);
    draft.entries.extend(found.map(|(name, column)| angle(name, column)));
}

/// Which axes of the gyro the rates of this angle stand for.
pub fn axes(entry: &Entry) -> [bool; 3] {
    let is = |letter: &str| entry.more.iter().any(|key| *key == format!("axis: {letter}"));
    let across = ["x", "y"].map(is);
    [across[0], across[1], across == [false; 2]]
}

fn changes(column: &LookedColumn) -> bool {
    let first = column.present().next();
    column.present().any(|x| Some(x) != first)
}

/// The body's axis of an angle by its name: `yaw`, `angle_x`.
fn named_axis(name: &Named) -> Option<usize> {
    let of_words = || name.stem.split(' ').find_map(turn);
    if let Some(Axis::Body(axis)) = name.axis { Some(axis) } else { of_words() }
}

fn angle(name: &Named, column: &LookedColumn) -> Entry {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let mut is_whole = true;
    for x in column.present() {
        (low, high) = (low.min(x), high.max(x));
        is_whole &= x == x.round();
    }
    let range = high - low;
    let assumed = |unit: &str| {
        let words = format!("from {} to {}; check it", number(low), number(high));
        Sourced::new(unit.to_owned(), Origin::Assumed, words)
    };
    let unit = match name.unit.filter(|unit| ["rad", "deg", "rev", "counts"].contains(unit)) {
        Some(unit) => Sourced::new(unit.to_owned(), Origin::Stated, "its name says the unit"),
        None if is_whole && range > 400.0 => assumed("counts"),
        None if range > 7.0 => assumed("deg"),
        None => assumed("rad"),
    };
    let mut more = Vec::new();
    if unit.value == "counts" {
        // Encoders count powers of two in a turn more often than not.
        let per_turn = 2f64.powf((range + 1.0).max(2.0).log2().ceil());
        more.push(format!("counts_per_turn: {per_turn:.1}"));
    }
    let axis = named_axis(name);
    let letter = ["x", "y", "z"].get(axis.unwrap_or(2)).copied().unwrap_or("z");
    if letter != "z" {
        more.push(format!("axis: {letter}"));
    }
    let of = match axis {
        Some(_) => Sourced::new((), Origin::Stated, format!("of a hinge about {letter}, by its name")),
        None => Sourced::new((), Origin::Assumed, "of a hinge about z"),
    };
    Entry {
        key: HINGE_ANGLE.to_owned(),
        channel: Channel::Gyro,
        columns: vec![name.column.clone()],
        of,
        unit: Some(unit),
        more,
    }
}
