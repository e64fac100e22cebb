//! The effects that compete, and the columns by which each can enter.

use std::collections::{BTreeMap, BTreeSet};

use whorl_dynamics::Effect;
use whorl_dynamics::effects::{
    Clues, Direction, Grouping, Part, Regressed, Resonance, Role, Start, catalogue, find,
};

use crate::Settings;
use crate::evidence::regression::{Estimate, Normal};
use crate::explanations::lines::{Lines, Mode};
use crate::parameters::available::Available;
use crate::parameters::{Column, Point, Reference, Target};

/// One effect that may be missing.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    pub effect: &'static dyn Effect,
    pub id: &'static str,
    /// Ways in which it can enter: sets of columns of the regression.
    pub options: Vec<Vec<usize>>,
}

/// Prior variance of a column of which nothing is known, in its unit.
const ANY_SIZE: f64 = 1e6;

/// The columns of the design matrix of a regression, and the effects that own them.
#[derive(Debug, Clone, Default)]
pub(crate) struct Design {
    pub columns: Vec<Column>,
    /// Columns of the base model.
    pub base: Vec<usize>,
    pub candidates: Vec<Candidate>,
    pub settings: Settings,
}

/// What effects are told of the data, to find where they may start.
struct Hints<'a> {
    available: &'a Available,
    lines: &'a Lines,
    resonances: Vec<Resonance>,
}

impl<'a> Hints<'a> {
    fn new(available: &'a Available, lines: &'a Lines) -> Self {
        let resonance = |m: &Mode| Resonance { hz: m.hz, damping_ratio: m.damping_ratio, axis_b: m.axis_b };
        Self { available, lines, resonances: lines.modes.iter().map(resonance).collect() }
    }

    fn clues(&self) -> Clues<'_> {
        Clues {
            bin_s: self.available.bin_s,
            largest_rate_rad_s: self.available.largest_rate_rad_s,
            largest_tilt_rad: self.available.largest_tilt_rad,
            torque_lines_hz: &self.lines.torque_hz,
            sensor_lines_hz: &self.lines.sensor_hz,
            resonances: &self.resonances,
        }
    }
}

impl Design {
    /// Columns for a point: effects that the point holds enter by their parameters, others by what they
    /// would add.
    pub fn new(
        reference: &Reference,
        point: &Point,
        available: &Available,
        exclude: &[String],
        lines: &Lines,
        with_hidden: bool,
    ) -> Self {
        let mut design = Self {
            columns: reference.base_columns(available),
            settings: reference.settings,
            ..Self::default()
        };
        design.base = (0..design.columns.len()).filter(|i| design.columns[*i].base_stddev > 0.0).collect();
        for effect in catalogue().iter().copied() {
            let id = effect.info().id;
            if exclude.iter().any(|e| e == id) || !available.can_test(effect) {
                continue;
            }
            if reference.model.effects.contains_key(id) && !effect.is_base() {
                continue;
            }
            if effect.hidden_states(&reference.model) > 0 && !with_hidden && !point.effects.contains_key(id) {
                continue;
            }
            design.add(reference, point, available, effect, lines);
        }
        design
    }

    /// Columns of the base model and of these effects alone.
    pub fn of_effects(
        reference: &Reference,
        point: &Point,
        available: &Available,
        ids: &[&str],
        lines: &Lines,
    ) -> Self {
        let mut design = Self {
            columns: reference.base_columns(available),
            settings: reference.settings,
            ..Self::default()
        };
        design.columns.retain(|c| c.base_stddev > 0.0 || ids.contains(&c.group));
        design.base = (0..design.columns.len()).filter(|i| design.columns[*i].base_stddev > 0.0).collect();
        for effect in ids.iter().filter_map(|id| find(id)) {
            design.add(reference, point, available, effect, lines);
        }
        design
    }

    fn push(&mut self, column: Column) -> usize {
        self.columns.push(column);
        self.columns.len() - 1
    }

    fn add(
        &mut self,
        reference: &Reference,
        point: &Point,
        available: &Available,
        effect: &'static dyn Effect,
        lines: &Lines,
    ) {
        let id = effect.info().id;
        let own: Vec<usize> = (0..self.columns.len()).filter(|i| self.columns[*i].group == id).collect();
        if !own.is_empty() {
            let options = options_of(effect, &own, &self.columns);
            self.candidates.push(Candidate { effect, id, options });
            return;
        }
        let included = point.effects.contains_key(id);
        let hints = Hints::new(available, lines);
        let special = if included { None } else { effect.starts(&reference.model, &hints.clues()) };
        let options = match special {
            Some(starts) => {
                let mut columns = |start: Start| {
                    start.into_iter().map(|d| self.push(directed(effect, reference, d))).collect()
                };
                starts.into_iter().map(&mut columns).collect()
            }
            None => {
                let mut columns = if included {
                    reference.columns_at(point, effect)
                } else {
                    reference.parameter_columns(effect)
                };
                if included {
                    drop_ineffective(&mut columns, reference, point, effect);
                }
                let indices: Vec<usize> = columns.into_iter().map(|c| self.push(c)).collect();
                options_of(effect, &indices, &self.columns)
            }
        };
        self.candidates.push(Candidate { effect, id, options });
    }

    /// Variance of a column as part of the base model.
    pub fn base_variance(&self, column: usize) -> f64 {
        self.columns.get(column).map_or(1.0, |c| c.base_stddev * c.base_stddev)
    }

    /// Detectability of a column at its unit, the base refitted.
    pub fn detectability(&self, normal: &Normal, column: usize) -> Option<f64> {
        let mut active: Vec<usize> = self.base.iter().copied().filter(|i| *i != column).collect();
        active.push(column);
        let variance = |c: usize| if c == column { ANY_SIZE } else { self.base_variance(c) };
        let fit = Estimate::new(normal, &active, variance)?;
        let variance = fit.covariance()[(active.len() - 1, active.len() - 1)];
        (variance > 0.0).then(|| 1.0 / variance)
    }
}

/// Parameters of an effect that is in the point but at an amplitude of zero have no column of their own
/// shape: phases and frequencies of nothing.
fn drop_ineffective(columns: &mut Vec<Column>, reference: &Reference, point: &Point, effect: &dyn Effect) {
    let values = reference.values_at(point, effect);
    let specs = effect.parameters(&reference.model);
    let is_zero = |i: usize| values.get(i).is_none_or(|v| *v == 0.0);
    let has_amplitude = |part: Part| {
        specs.iter().enumerate().any(|(i, s)| s.role == Role::Amplitude && s.part == part && !is_zero(i))
    };
    columns.retain(|c| match specs.get(c.index).map(|spec| spec.regressed) {
        Some(Regressed::UnlessZero) => !is_zero(c.index),
        Some(Regressed::WithAmplitude) => has_amplitude(c.part),
        Some(Regressed::Never) => false,
        Some(Regressed::Always) | None => true,
    });
}

/// The sets of columns in which an effect may enter, as it says.
fn options_of(effect: &dyn Effect, indices: &[usize], columns: &[Column]) -> Vec<Vec<usize>> {
    let each = || indices.iter().map(|i| vec![*i]);
    let mut options = vec![indices.to_vec()];
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
            for i in indices {
                of_part.entry(part_of(columns, *i)).or_default().push(*i);
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
                indices.iter().partition(|i| part_of(columns, **i) == Part::Platform);
            options = std::iter::once(common).chain(each()).chain([of_parts]).collect();
        }
    }
    options.retain(|o| !o.is_empty());
    options
}

fn part_of(columns: &[Column], column: usize) -> Part {
    columns.get(column).map_or(Part::Platform, |c| c.part)
}

/// The options that hold every parameter of each wheel and jet that they touch, or of the whole platform.
pub(crate) fn whole_parts(options: &[Vec<usize>], columns: &[Column]) -> Vec<Vec<usize>> {
    let all: BTreeSet<usize> = options.iter().flatten().copied().collect();
    let is_whole = |option: &Vec<usize>| {
        let touched: BTreeSet<Part> = option.iter().map(|i| part_of(columns, *i)).collect();
        all.iter().all(|i| option.contains(i) || !touched.contains(&part_of(columns, *i)))
    };
    options.iter().filter(|o| is_whole(o)).cloned().collect()
}

/// The column of a direction in which an absent effect may start.
fn directed(effect: &'static dyn Effect, reference: &Reference, direction: Direction) -> Column {
    let specs = effect.parameters(&reference.model);
    let Direction { name, origin, moves, squared } = direction;
    let mut step = vec![0.0; specs.len()];
    let mut range = (f64::NEG_INFINITY, f64::INFINITY);
    for (index, size) in &moves {
        if let (Some(slot), Some(spec), Some(from)) =
            (step.get_mut(*index), specs.get(*index), origin.get(*index))
        {
            *slot = *size;
            let (a, b) = ((spec.min - from) / size, (spec.max - from) / size);
            range = (range.0.max(a.min(b)), range.1.min(a.max(b)));
        }
    }
    if squared {
        range = (0.0, range.1.max(0.0).powi(2));
    }
    let (index, scale) = moves.first().copied().unwrap_or((0, 1.0));
    let spec = specs.get(index);
    Column {
        group: effect.info().id,
        name,
        unit: spec.map_or("1", |s| s.unit),
        part: spec.map_or(Part::Platform, |s| s.part),
        target: Target::Effect(effect),
        origin: Some(origin),
        step,
        index,
        scale,
        base_stddev: 0.0,
        catalogue_stddev: 1.0,
        range,
        quadratic: squared,
        is_shape: false,
        floats: false,
        essential: spec.is_some_and(|s| s.essential),
    }
}

/// The effect with this id, for callers that hold one.
pub(crate) fn effect(id: &str) -> Option<&'static dyn Effect> {
    find(id)
}

#[cfg(test)]
mod tests {
    use whorl_dynamics::{ModelPrior, PlatformModel};

    use super::*;

    fn whole_names(id: &str) -> Vec<Vec<String>> {
        let model = PlatformModel::whorl_1_reference();
        let reference = Reference::new(&model, &ModelPrior::typical(&model));
        let effect = find(id).unwrap();
        let columns = reference.parameter_columns(effect);
        let indices: Vec<usize> = (0..columns.len()).collect();
        whole_parts(&options_of(effect, &indices, &columns), &columns)
            .iter()
            .map(|option| option.iter().map(|i| columns[*i].name.clone()).collect())
            .collect()
    }

    #[test]
    fn an_effect_enters_by_whole_wheels_and_jets() {
        let model = PlatformModel::whorl_1_reference();
        let (wheels, jets) = (model.wheels().len(), model.jets().len());
        // All together, then wheel by wheel, never one of the two drags alone.
        let friction = whole_names("wheel_friction");
        assert_eq!(friction.len(), 1 + wheels);
        for (option, wheel) in friction[1..].iter().zip(model.wheels()) {
            assert_eq!(
                *option,
                [format!("{}_viscous_n_m_s", wheel.name), format!("{}_coulomb_n_m", wheel.name)]
            );
        }
        // One parameter a wheel: each is whole.
        assert_eq!(whole_names("wheel_windage").len(), 1 + wheels);
        // All jets alike, each alone, each for itself.
        let strength = whole_names("thruster_strength");
        assert_eq!(strength[0], ["all"]);
        assert_eq!(strength.iter().filter(|o| o.len() == 1).count(), 2 + jets);
        assert_eq!(strength.last().unwrap().len(), jets);
        // Two angles across a jet go together.
        assert!(whole_names("thruster_misalignment").iter().all(|o| o.len() % 2 == 0));
        // Of the platform: only as a whole.
        for id in ["air_current", "thruster_delay", "gyro_misalignment", "bearing_viscous_friction"] {
            let parameters = find(id).unwrap().parameters(&model).len();
            assert_eq!(whole_names(id).iter().map(Vec::len).collect::<Vec<_>>(), [parameters], "{id}");
        }
    }
}
