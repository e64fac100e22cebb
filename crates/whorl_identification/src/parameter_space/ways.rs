//! The ways in which an effect may enter a fit: sets of its parameters, or directions from where it is still absent.

use std::collections::BTreeMap;

use whorl_dynamics::Effect;
use whorl_dynamics::effects::{Clues, Direction, Grouping, Part, Role};

use crate::parameter_space::{Column, Point, Reference};

/// One number with which an effect enters.
#[derive(Debug, Clone)]
pub(crate) enum Entry {
    /// A parameter.
    Parameter(Column),
    /// A direction of an effect that is absent.
    Direction(&'static dyn Effect, Direction),
}

impl Entry {
    /// Range of its units.
    pub fn range(&self, reference: &Reference) -> (f64, f64) {
        match self {
            Self::Parameter(column) => column.range,
            Self::Direction(_, direction) if direction.moves.iter().all(|(_, by)| *by == 0.0) => (0.0, 1.0),
            Self::Direction(effect, direction) => {
                let specs = effect.parameters(&reference.model);
                let mut range = (f64::NEG_INFINITY, f64::INFINITY);
                for (index, by) in &direction.moves {
                    if let (Some(spec), Some(from)) = (specs.get(*index), direction.origin.get(*index)) {
                        let (a, b) = ((spec.min - from) / by, (spec.max - from) / by);
                        range = (range.0.max(a.min(b)), range.1.min(a.max(b)));
                    }
                }
                if direction.squared { (0.0, range.1.max(0.0).powi(2)) } else { range }
            }
        }
    }

    /// Prior standard deviation that the catalogue gives it, in units.
    pub fn catalogue_stddev(&self) -> f64 {
        match self {
            Self::Parameter(column) => column.catalogue_stddev,
            Self::Direction(..) => 1.0,
        }
    }

    /// Values of the effect with so many units of it; `None` for a parameter.
    pub fn values(&self, units: f64) -> Option<Vec<f64>> {
        let Self::Direction(_, direction) = self else { return None };
        let along = if direction.squared { units.max(0.0).sqrt() } else { units };
        let mut values = direction.origin.clone();
        for (index, by) in &direction.moves {
            if let Some(value) = values.get_mut(*index) {
                *value += along * by;
            }
        }
        Some(values)
    }

    /// A point moved along it.
    pub fn moved(&self, reference: &Reference, point: &Point, units: f64) -> Point {
        match self {
            Self::Parameter(column) => reference.moved(point, column, units),
            Self::Direction(effect, _) => {
                let specs = effect.parameters(&reference.model);
                let values = self.values(units).unwrap_or_default();
                let mut moved = point.clone();
                let limited = values.iter().zip(&specs).map(|(value, spec)| spec.limited(*value));
                moved.effects.insert(effect.info().id, limited.collect());
                moved
            }
        }
    }
}

/// All ways of an effect to enter while it is absent, and the numbers that they enter with, each once.
#[derive(Debug, Clone, Default)]
pub(crate) struct Ways {
    pub entries: Vec<Entry>,
    /// Sets of entries.
    pub options: Vec<Vec<usize>>,
}

impl Ways {
    /// Of an effect on this platform, as far as any platform may be so.
    pub fn of(
        reference: &Reference,
        effect: &'static dyn Effect,
        clues: &Clues<'_>,
        is_possible: impl Fn(&Entry) -> bool,
    ) -> Self {
        let mut ways = Self::default();
        if let Some(starts) = effect.starts(&reference.model, clues) {
            for start in starts {
                let entries: Vec<Entry> =
                    start.into_iter().map(|direction| Entry::Direction(effect, direction)).collect();
                // A place is there or not: nothing grows with the units of it.
                let moves = |entry: &Entry| matches!(entry, Entry::Direction(_, d) if d.moves.iter().any(|m| m.1 != 0.0));
                if !entries.is_empty() && entries.iter().all(|entry| moves(entry) && is_possible(entry)) {
                    let first = ways.entries.len();
                    ways.options.push((first..first + entries.len()).collect());
                    ways.entries.extend(entries);
                }
            }
            return ways;
        }
        let columns = reference.parameter_columns(effect);
        let mut places = vec![None; columns.len()];
        for (column, place) in columns.iter().zip(&mut places).filter(|(c, _)| c.role == Role::Amplitude) {
            let entry = Entry::Parameter(column.clone());
            if is_possible(&entry) {
                *place = Some(ways.entries.len());
                ways.entries.push(entry);
            }
        }
        let placed =
            |option: &Vec<usize>| option.iter().filter_map(|i| places.get(*i).copied().flatten()).collect();
        ways.options =
            options_of(effect, &columns).iter().map(placed).filter(|o: &Vec<usize>| !o.is_empty()).collect();
        ways.options.sort();
        ways.options.dedup();
        ways
    }
}

/// The sets of columns in which an effect may enter, as it says.
pub(crate) fn options_of(effect: &dyn Effect, columns: &[Column]) -> Vec<Vec<usize>> {
    let indices: Vec<usize> = (0..columns.len()).collect();
    let part_of = |i: usize| columns.get(i).map_or(Part::Platform, |column| column.part);
    let each = || indices.iter().map(|i| vec![*i]);
    let mut options = vec![indices.clone()];
    match effect.grouping() {
        Grouping::All => {}
        Grouping::EachAndPairs => {
            options = each().collect();
            for (n, a) in indices.iter().enumerate() {
                options.extend(indices.iter().skip(n + 1).map(|b| vec![*a, *b]));
            }
        }
        _ if indices.len() < 2 => {}
        Grouping::AllPartsEach(also) => {
            let mut of_part: BTreeMap<Part, Vec<usize>> = BTreeMap::new();
            for i in &indices {
                of_part.entry(part_of(*i)).or_default().push(*i);
            }
            if of_part.len() > 1 {
                options.extend(of_part.into_values().filter(|own| own.len() > 1));
            }
            options.extend(each());
            options.extend(also.iter().map(|names| {
                let is_named = |i: &usize| columns.get(*i).is_some_and(|c| names.contains(&c.name.as_str()));
                indices.iter().copied().filter(is_named).collect()
            }));
        }
        Grouping::CommonEachParts => {
            let (common, of_parts): (Vec<usize>, Vec<usize>) =
                indices.iter().partition(|i| part_of(**i) == Part::Platform);
            options = std::iter::once(common).chain(each()).chain([of_parts]).collect();
        }
    }
    options.retain(|option| !option.is_empty());
    options
}
