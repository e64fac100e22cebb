//! The ways in which an effect may enter a fit: sets of its parameters, or directions from where it is still absent.

use std::collections::BTreeMap;

use whorl_dynamics::Effect;
use whorl_dynamics::effects::{Clues, Contribution, Direction, Grouping, Part, Regressed, Role};

use crate::parameter_space::{Column, Point, Reference, Target};
use crate::verdict::diagnosis::ParameterEstimate;

/// One number with which an effect enters.
#[derive(Debug, Clone)]
pub(crate) struct Entry {
    /// A parameter; of a direction the first that it moves, one unit of it in its own.
    pub column: Column,
    /// The direction, of an effect that is absent.
    pub direction: Option<Direction>,
}

impl From<Column> for Entry {
    fn from(column: Column) -> Self {
        Self { column, direction: None }
    }
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
        let spec = specs.get(index)?;
        let column = Column {
            group: effect.info().id,
            name: spec.name.clone(),
            unit: spec.unit,
            part: spec.part,
            target: Target::Effect(effect),
            index,
            role: Role::Amplitude,
            scale: by,
            base_stddev: 0.0,
            catalogue_stddev: 1.0,
            range: if direction.squared { (0.0, range.1.max(0.0).powi(2)) } else { range },
            essential: true,
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

    /// A point moved along it.
    pub fn moved(&self, reference: &Reference, point: &Point, units: f64) -> Point {
        let (Some(_), Target::Effect(effect)) = (&self.direction, self.column.target) else {
            return reference.moved(point, &self.column, units);
        };
        let mut moved = point.clone();
        let values = self.values(reference, effect, units);
        moved.effects.insert(effect.info().id, limited(reference, effect, values));
        moved
    }

    /// Its parameter with so many units, which have this deviation.
    pub fn estimate(&self, reference: &Reference, units: f64, stddev: f64) -> ParameterEstimate {
        let column = &self.column;
        let new = |value, stddev: f64| {
            ParameterEstimate::new(column.name.clone(), column.unit, value, stddev * column.scale.abs())
        };
        let Some(direction) = &self.direction else {
            let value = reference.given(column) + units * column.scale;
            return ParameterEstimate { at_bound: column.is_at_bound(units), ..new(value, stddev) };
        };
        let from = direction.origin.get(column.index).copied().unwrap_or(0.0);
        let along = along(direction, units);
        let spread = if direction.squared { 0.5 * stddev / along.max(stddev.sqrt()) } else { stddev };
        new(from + along * column.scale, spread)
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
    let contribution = |(direction, units): &(&'_ Direction, f64)| {
        direction.moves.first().map_or(0.0, |(_, by)| along(direction, *units) * by)
    };
    let contributions: Vec<Contribution<'_>> = directions
        .iter()
        .map(|part| Contribution { name: &part.0.name, origin: &part.0.origin, amount: contribution(part) })
        .collect();
    let values = effect.joined(&contributions).unwrap_or_else(|| sum_of(directions));
    let values = limited(reference, effect, values);
    let moved = |i: usize| directions.iter().flat_map(|(direction, _)| &direction.moves).any(|m| m.0 == i);
    let specs = effect.parameters(&reference.model);
    let is_fitted = |i: &usize| {
        specs.get(*i).is_some_and(|spec| {
            let may_move = match spec.regressed {
                Regressed::Never => false,
                Regressed::UnlessZero => values.get(*i).is_some_and(|value| *value != 0.0),
                Regressed::Always | Regressed::WithAmplitude => true,
            };
            !spec.known && (moved(*i) || (spec.role != Role::Amplitude && may_move))
        })
    };
    let fitted = (0..specs.len()).filter(is_fitted).collect();
    (values, fitted)
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
                let entries: Option<Vec<Entry>> =
                    start.into_iter().map(|direction| Entry::of(reference, effect, direction)).collect();
                let possible = entries.filter(|all| !all.is_empty() && all.iter().all(&is_possible));
                let first = ways.entries.len();
                ways.entries.extend(possible.into_iter().flatten());
                ways.options
                    .extend((ways.entries.len() > first).then(|| (first..ways.entries.len()).collect()));
            }
            return ways;
        }
        let columns = reference.parameter_columns(effect);
        let mut places = vec![None; columns.len()];
        for (column, place) in columns.iter().zip(&mut places).filter(|(c, _)| c.role == Role::Amplitude) {
            let entry = Entry::from(column.clone());
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

/// The sets of columns in which an effect may enter, as it says; some may be empty.
fn options_of(effect: &dyn Effect, columns: &[Column]) -> Vec<Vec<usize>> {
    let all: Vec<usize> = (0..columns.len()).collect();
    let each = || all.iter().map(|i| vec![*i]);
    let of_part: BTreeMap<Part, Vec<usize>> = all.iter().fold(BTreeMap::new(), |mut parts, i| {
        parts.entry(columns[*i].part).or_insert_with(Vec::new).push(*i);
        parts
    });
    match effect.grouping() {
        Grouping::EachAndPairs => {
            let pairs = all.iter().flat_map(|a| all.iter().filter(move |b| a < b).map(|b| vec![*a, *b]));
            each().chain(pairs).collect()
        }
        Grouping::AllPartsEach(also) if all.len() > 1 => {
            let is_named = |i: &usize, names: &[&str]| names.contains(&columns[*i].name.as_str());
            let named = also.iter().map(|names| all.iter().copied().filter(|i| is_named(i, names)).collect());
            let several = of_part.len() > 1;
            let parts = of_part.values().filter(|own| several && own.len() > 1).cloned();
            std::iter::once(all.clone()).chain(parts).chain(each()).chain(named).collect()
        }
        Grouping::CommonEachParts if all.len() > 1 => {
            let (common, of_parts): (Vec<usize>, Vec<usize>) =
                all.iter().partition(|i| columns[**i].part == Part::Platform);
            std::iter::once(common).chain(each()).chain([of_parts]).collect()
        }
        _ => vec![all],
    }
}
