//! The ways in which an effect may enter a fit: sets of its parameters, or directions from where it is still absent.

use std::collections::BTreeMap;

use whorl_dynamics::Effect;
use whorl_dynamics::effects::{
    Clues, Contribution, Direction, Grouping, ParameterSpec, Part, Regressed, Role,
};

use crate::parameter_space::{Column, Point, Reference};
use crate::verdict::diagnosis::ParameterEstimate;

/// One number with which an effect enters.
pub(crate) struct Entry {
    /// A parameter; of a direction the first that it moves, one unit of it in its own.
    pub column: Column,
    /// The direction, of an effect that is absent.
    pub direction: Option<Direction>,
}

/// How far values go along a direction with so many units.
fn along(direction: &Direction, units: f64) -> f64 {
    if direction.squared { units.max(0.0).sqrt() } else { units }
}

/// Values of the parameters with so many units of several directions from where the first begins.
fn sum_of(directions: &[(&Direction, f64)]) -> Vec<f64> {
    let mut values = directions.first().map_or_else(Vec::new, |(first, _)| first.origin.clone());
    for (direction, units) in directions {
        for (index, by) in &direction.moves {
            if let Some(value) = values.get_mut(*index) {
                *value += along(direction, *units) * by;
            }
        }
    }
    values
}

impl Entry {
    pub fn of_column(column: Column) -> Self {
        Self { column, direction: None }
    }

    /// `None` where a place is there or not, and nothing grows with the units of it.
    fn of(reference: &Reference, effect: &'static dyn Effect, direction: Direction) -> Option<Self> {
        let specs = effect.parameters(&reference.model);
        let (index, by) = *direction.moves.first()?;
        let mut range = (f64::NEG_INFINITY, f64::INFINITY);
        for (index, by) in &direction.moves {
            if let (Some(spec), Some(from)) = (specs.get(*index), direction.origin.get(*index)) {
                let (a, b) = ((spec.min - from) / by, (spec.max - from) / by);
                range = (range.0.max(a.min(b)), range.1.min(a.max(b)));
            }
        }
        let spec = ParameterSpec { role: Role::Amplitude, essential: true, ..specs.get(index)?.clone() };
        let given = direction.origin.get(index).copied().unwrap_or(0.0);
        let column = Column {
            scale: by,
            catalogue_stddev: 1.0,
            range: if direction.squared { (0.0, range.1.max(0.0).powi(2)) } else { range },
            ..Column::new(Some(effect), (index, spec), (given, 0.0), 1.0)
        };
        let grows = direction.moves.iter().any(|(_, by)| *by != 0.0);
        grows.then_some(Self { column, direction: Some(direction) })
    }

    /// Values of its effect with so many units of it alone.
    pub fn values(&self, reference: &Reference, effect: &dyn Effect, units: f64) -> Vec<f64> {
        if let Some(direction) = &self.direction {
            return sum_of(&[(direction, units)]);
        }
        let mut values = reference.values(effect);
        if let Some(value) = values.get_mut(self.column.index) {
            *value += units * self.column.scale;
        }
        values
    }

    pub fn moved(&self, reference: &Reference, point: &Point, units: f64) -> Point {
        let (Some(_), Some(effect)) = (&self.direction, self.column.effect) else {
            return reference.moved(point, &self.column, units);
        };
        let mut moved = point.clone();
        let values = self.values(reference, effect, units);
        moved.insert(effect.info().id, limited(reference, effect, values));
        moved
    }

    /// Its parameter with so many units, which have this deviation.
    pub fn estimate(&self, units: f64, stddev: f64) -> ParameterEstimate {
        let (column, direction) = (&self.column, self.direction.as_ref());
        let along = direction.map_or(units, |direction| along(direction, units));
        let is_squared = direction.is_some_and(|direction| direction.squared);
        let spread = if is_squared { 0.5 * stddev / along.max(stddev.sqrt()) } else { stddev };
        let (value, stddev) = (column.given + along * column.scale, spread * column.scale.abs());
        let is_at_bound = units <= column.range.0 + 1e-9 || units >= column.range.1 - 1e-9;
        ParameterEstimate {
            at_bound: is_at_bound && direction.is_none(),
            ..ParameterEstimate::new(column.name.clone(), column.unit, value, stddev)
        }
    }
}

fn limited(reference: &Reference, effect: &dyn Effect, values: Vec<f64>) -> Vec<f64> {
    let specs = effect.parameters(&reference.model);
    values.iter().zip(&specs).map(|(value, spec)| spec.limited(*value)).collect()
}

/// Values of an effect to which several directions lead together, and which of its parameters are fitted from there.
pub(crate) fn joined(
    reference: &Reference,
    effect: &dyn Effect,
    directions: &[(&Direction, f64)],
) -> (Vec<f64>, Vec<usize>) {
    let contributions = directions.iter().map(|(of, units)| {
        let amount = of.moves.first().map_or(0.0, |(_, by)| along(of, *units) * by);
        Contribution { name: &of.name, origin: &of.origin, amount }
    });
    let contributions: Vec<Contribution<'_>> = contributions.collect();
    let values = effect.joined(&contributions).unwrap_or_else(|| sum_of(directions));
    let values = limited(reference, effect, values);
    let moved = |i: usize| directions.iter().flat_map(|(direction, _)| &direction.moves).any(|m| m.0 == i);
    let may_move = |i: usize, spec: &ParameterSpec| match spec.regressed {
        Regressed::Never => false,
        Regressed::UnlessZero => values.get(i).is_some_and(|value| *value != 0.0),
        Regressed::Always | Regressed::WithAmplitude => true,
    };
    let is_fitted = |(i, spec): &(usize, ParameterSpec)| {
        !spec.known && (moved(*i) || spec.role != Role::Amplitude && may_move(*i, spec))
    };
    let specs = effect.parameters(&reference.model).into_iter().enumerate();
    let fitted = specs.filter(is_fitted).map(|(i, _)| i).collect();
    (values, fitted)
}

/// All ways of an effect to enter while it is absent, and the numbers that they enter with, each once.
#[derive(Default)]
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
                let entries: Option<Vec<Entry>> =
                    start.into_iter().map(|direction| Entry::of(reference, effect, direction)).collect();
                let possible = entries.filter(|all| !all.is_empty() && all.iter().all(&is_possible));
                let Some(entries) = possible else { continue };
                ways.options.push((ways.entries.len()..ways.entries.len() + entries.len()).collect());
                ways.entries.extend(entries);
            }
            return ways;
        }
        let columns = reference.parameter_columns(effect).into_iter();
        let amplitudes = columns.filter(|column| column.role == Role::Amplitude);
        ways.entries = amplitudes.map(Entry::of_column).filter(is_possible).collect();
        ways.options = options_of(effect, &ways.entries);
        ways.options.retain(|option| !option.is_empty());
        ways.options.sort();
        ways.options.dedup();
        ways
    }
}

/// The sets of entries in which an effect may enter, as it says; some may be empty.
fn options_of(effect: &dyn Effect, entries: &[Entry]) -> Vec<Vec<usize>> {
    let all: Vec<usize> = (0..entries.len()).collect();
    let (part, name) = (|i: usize| entries[i].column.part, |i: usize| entries[i].column.name.as_str());
    let each = || all.iter().map(|i| vec![*i]);
    match effect.grouping() {
        Grouping::EachAndPairs => {
            let pairs = all.iter().flat_map(|a| all.iter().filter(move |b| a < b).map(|b| vec![*a, *b]));
            each().chain(pairs).collect()
        }
        Grouping::AllPartsEach(also) if all.len() > 1 => {
            let mut of_parts: BTreeMap<Part, Vec<usize>> = BTreeMap::new();
            all.iter().for_each(|i| of_parts.entry(part(*i)).or_default().push(*i));
            let named =
                also.iter().map(|names| all.iter().copied().filter(|i| names.contains(&name(*i))).collect());
            std::iter::once(all.clone()).chain(of_parts.into_values()).chain(each()).chain(named).collect()
        }
        Grouping::CommonEachParts if all.len() > 1 => {
            let (common, of_parts): (Vec<usize>, Vec<usize>) =
                all.iter().partition(|i| part(**i) == Part::Platform);
            std::iter::once(common).chain(each()).chain([of_parts]).collect()
        }
        _ => vec![all],
    }
}
