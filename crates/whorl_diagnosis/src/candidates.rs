//! The effects that compete, and the columns by which each can enter.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::{PI, TAU};

use whorl_dynamics::Effect;
use whorl_dynamics::effects::{Part, catalogue, find};

use crate::modes::Mode;
use crate::parameters::{BASE_EFFECTS, Column, Point, Reference, Target};
use crate::run::Run;

/// One effect that may be missing.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    pub effect: &'static dyn Effect,
    pub id: &'static str,
    /// Ways in which it can enter: sets of columns of the regression.
    pub options: Vec<Vec<usize>>,
}

/// All columns of a regression and who owns them.
#[derive(Debug, Clone, Default)]
pub(crate) struct Layout {
    pub columns: Vec<Column>,
    /// Columns of the base model.
    pub base: Vec<usize>,
    pub candidates: Vec<Candidate>,
}

/// What the recordings hold, as far as it decides which effects can be tested.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Available {
    pub body: bool,
    pub jets: bool,
    pub wheels: bool,
    pub wheel_command: bool,
    pub accel: bool,
    pub vector: bool,
    pub temperature: bool,
    pub ballast: bool,
    pub bin_s: f64,
    /// Largest rate about any axis that lasted a few bins [rad/s].
    pub largest_rate_rad_s: f64,
    /// Largest tilt that lasted a few bins \[rad\].
    pub largest_tilt_rad: f64,
    /// The gyro's readings pile up at a limit.
    pub clips: bool,
}

impl Available {
    pub fn of(runs: &[Run]) -> Self {
        let any = |test: &dyn Fn(&Run) -> bool| runs.iter().any(test);
        Self {
            body: any(&|r| !r.clamped),
            jets: any(&|r| !r.clamped && r.jet_pulses.iter().any(|p| !p.is_empty())),
            wheels: any(&|r| !r.wheel_command.is_empty()),
            wheel_command: any(&|r| r.has_wheel_command),
            accel: any(&|r| !r.clamped && r.accel.iter().any(|a| a.count > 0.0)),
            vector: any(&|r| !r.clamped && !r.vectors.is_empty()),
            temperature: any(&|r| r.has_temperature),
            ballast: any(&|r| r.ballast_direction.iter().any(|d| d.norm() > 0.0)),
            bin_s: runs.iter().map(|r| r.length(0)).fold(0.0, f64::max),
            largest_rate_rad_s: largest(runs, |r| &r.gyro, |w| w.amax()),
            largest_tilt_rad: largest(runs, |r| &r.accel, |f| f.x.hypot(f.y).atan2(f.z)),
            clips: any(&|r| r.gyro_clips_at_rad_s.is_some()),
        }
    }

    /// Whether these data could show the effect at all.
    pub fn can_test(&self, effect: &dyn Effect) -> bool {
        let id = effect.info().id;
        match id {
            // In every base model, known, negligible or not an effect.
            "gyro_bias" | "gravity_gradient" | "earth_rotation" | "unmodelled_torque" => false,
            // Seen in the samples themselves, where the phase of each run is free.
            "wheel_imbalance" => false,
            // Readings that pile up at a limit show it by themselves and were left out.
            "gyro_saturation" => self.body && !self.clips,
            "wheel_friction" | "wheel_windage" => self.wheels && self.wheel_command,
            "supply_voltage" => (self.wheels && self.wheel_command) || self.jets,
            "wheel_inertia" => self.wheels,
            "wheel_misalignment" => self.wheels && self.body,
            "thruster_leak" => self.body,
            "moving_ballast_backlash" => self.body && self.ballast,
            "accel_bias" | "accel_scale" | "accel_lever_arm" => self.accel,
            "vector_sensor_misalignment" => self.vector,
            "gyro_temperature" => self.body && self.temperature,
            "mass_shift" => self.jets,
            _ if id.starts_with("thruster") => self.jets,
            _ => self.body,
        }
    }
}

/// Largest size of the mean of five bins in a row.
fn largest(
    runs: &[Run],
    means: impl Fn(&Run) -> &Vec<crate::bins::Mean3>,
    size: impl Fn(&nalgebra::Vector3<f64>) -> f64,
) -> f64 {
    runs.iter()
        .flat_map(|run| {
            let whole: Vec<_> = means(run).iter().filter(|m| m.count > 0.0).map(|m| m.value).collect();
            whole
                .windows(5)
                .map(|w| size(&(w.iter().sum::<nalgebra::Vector3<f64>>() / 5.0)))
                .collect::<Vec<_>>()
        })
        .fold(0.0, f64::max)
}

/// Lines found in the spectrum of the residual \[Hz\].
#[derive(Debug, Clone, Default)]
pub(crate) struct Lines {
    pub torque_hz: Vec<f64>,
    pub sensor_hz: Vec<f64>,
    /// All that were noticed, the faint ones as well.
    pub faint_hz: Vec<f64>,
    /// Lines over the angle of a wheel: wheel, cycles per turn.
    pub orders: Vec<(usize, f64)>,
    /// Resonances that the motion drives.
    pub modes: Vec<Mode>,
    /// Standard deviations by which the strongest line stands out.
    pub strongest: f64,
}

impl Layout {
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
        let mut layout = Self {
            columns: reference.base_columns(available.wheels, available.jets, available.body),
            ..Self::default()
        };
        if !available.body {
            // Clamped: only what turns the wheels can be fitted.
            layout.columns.retain(|c| c.group == "wheel_inertia");
        }
        layout.base = (0..layout.columns.len()).filter(|i| layout.columns[*i].base_stddev > 0.0).collect();
        for effect in catalogue().iter().copied() {
            let id = effect.info().id;
            if exclude.iter().any(|e| e == id) || !available.can_test(effect) {
                continue;
            }
            if reference.model.effects.contains_key(id) && !BASE_EFFECTS.contains(&id) {
                continue;
            }
            if effect.hidden_states(&reference.model) > 0 && !with_hidden && !point.effects.contains_key(id) {
                continue;
            }
            layout.add(reference, point, available, effect, lines);
        }
        layout
    }

    /// Columns of the base model and of these effects alone.
    pub fn of_effects(
        reference: &Reference,
        point: &Point,
        available: &Available,
        ids: &[&str],
        lines: &Lines,
    ) -> Self {
        let mut layout = Self {
            columns: reference.base_columns(available.wheels, available.jets, available.body),
            ..Self::default()
        };
        if !available.body {
            layout.columns.retain(|c| c.group == "wheel_inertia");
        }
        layout.columns.retain(|c| c.base_stddev > 0.0 || ids.contains(&c.group));
        layout.base = (0..layout.columns.len()).filter(|i| layout.columns[*i].base_stddev > 0.0).collect();
        for effect in ids.iter().filter_map(|id| find(id)) {
            layout.add(reference, point, available, effect, lines);
        }
        layout
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
            let options = options_of(id, &own, &self.columns);
            self.candidates.push(Candidate { effect, id, options });
            return;
        }
        let included = point.effects.contains_key(id);
        let special = if included { None } else { special_options(reference, available, effect, lines) };
        let options = match special {
            Some(groups) => groups
                .into_iter()
                .map(|columns| columns.into_iter().map(|c| self.push(c)).collect())
                .collect(),
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
                options_of(id, &indices, &self.columns)
            }
        };
        self.candidates.push(Candidate { effect, id, options });
    }

    /// Variance of a column as part of the base model.
    pub fn base_variance(&self, column: usize) -> f64 {
        self.columns.get(column).map_or(1.0, |c| c.base_stddev * c.base_stddev)
    }
}

/// Parameters of an effect that is in the point but at an amplitude of zero have no column of their own
/// shape: phases and frequencies of nothing.
fn drop_ineffective(columns: &mut Vec<Column>, reference: &Reference, point: &Point, effect: &dyn Effect) {
    let values = reference.values_at(point, effect);
    let id = effect.info().id;
    columns.retain(|c| match (id, c.index) {
        ("air_current_periodic", i) if i < 3 => values.get(i).is_some_and(|v| *v != 0.0),
        ("flexible_mode", i) if i < 3 => values.get(i).is_some_and(|v| *v != 0.0),
        ("gyro_saturation", i) => i == 0,
        ("thruster_rise", i) if i > 0 => values.first().is_some_and(|v| *v != 0.0),
        ("vibration_alias", i) if i < 6 => values.get(i).is_some_and(|v| *v != 0.0),
        _ => true,
    });
}

/// All columns together, then per wheel or jet, then each alone.
fn options_of(id: &str, indices: &[usize], columns: &[Column]) -> Vec<Vec<usize>> {
    if id == "thruster_leak" {
        // One jet or two: any torque at all could be put together from all of them.
        let mut options: Vec<Vec<usize>> = indices.iter().map(|i| vec![*i]).collect();
        for (n, a) in indices.iter().enumerate() {
            options.extend(indices.iter().skip(n + 1).map(|b| vec![*a, *b]));
        }
        return options;
    }
    if id == "thruster_rise" {
        // The shape of a tail is nothing by itself.
        return vec![indices.to_vec()];
    }
    let mut options = vec![indices.to_vec()];
    if indices.len() > 1 {
        let mut of_part: BTreeMap<Part, Vec<usize>> = BTreeMap::new();
        for i in indices {
            of_part.entry(part_of(columns, *i)).or_default().push(*i);
        }
        if of_part.len() > 1 {
            options.extend(of_part.into_values().filter(|own| own.len() > 1));
        }
        options.extend(indices.iter().map(|i| vec![*i]));
        if id == "thruster_strength" {
            // All jets alike, besides what each does within its own prior.
            let all = indices.iter().copied().filter(|i| columns.get(*i).is_some_and(|c| c.name == "all"));
            options.insert(0, all.collect());
            options.remove(1);
            options.push(
                indices
                    .iter()
                    .copied()
                    .filter(|i| columns.get(*i).is_some_and(|c| c.name != "all"))
                    .collect(),
            );
        }
        if id == "air_current" || id == "magnetic_torque" {
            options.push(indices.iter().copied().take(2).collect());
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

/// A column that starts from `origin` and moves by `step` per unit.
fn directed(
    effect: &'static dyn Effect,
    reference: &Reference,
    name: &str,
    origin: &[f64],
    moves: &[(usize, f64)],
    quadratic: bool,
) -> Column {
    let specs = effect.parameters(&reference.model);
    let mut step = vec![0.0; specs.len()];
    let mut range = (f64::NEG_INFINITY, f64::INFINITY);
    for (index, size) in moves {
        if let (Some(slot), Some(spec), Some(from)) =
            (step.get_mut(*index), specs.get(*index), origin.get(*index))
        {
            *slot = *size;
            let (a, b) = ((spec.min - from) / size, (spec.max - from) / size);
            range = (range.0.max(a.min(b)), range.1.min(a.max(b)));
        }
    }
    if quadratic {
        range = (0.0, range.1.max(0.0).powi(2));
    }
    let (index, scale) = moves.first().copied().unwrap_or((0, 1.0));
    let (unit, part) = specs.get(index).map_or(("1", Part::Platform), |s| (s.unit, s.part));
    Column {
        group: effect.info().id,
        name: name.to_owned(),
        unit,
        part,
        target: Target::Effect(effect),
        origin: Some(origin.to_vec()),
        step,
        index,
        scale,
        base_stddev: 0.0,
        catalogue_stddev: 1.0,
        range,
        quadratic,
        is_shape: false,
        floats: false,
    }
}

/// Options of effects whose parameters do not all enter linearly: a grid over those that do not.
fn special_options(
    reference: &Reference,
    available: &Available,
    effect: &'static dyn Effect,
    lines: &Lines,
) -> Option<Vec<Vec<Column>>> {
    let specs = effect.parameters(&reference.model);
    let neutral: Vec<f64> = specs.iter().map(|s| s.neutral).collect();
    let unit = |i: usize| specs.get(i).map_or(1.0, |s| s.prior_stddev);
    let name = |i: usize| specs.get(i).map_or("", |s| s.name.as_str());
    let column =
        |origin: &[f64], i: usize| directed(effect, reference, name(i), origin, &[(i, unit(i))], false);
    let with = |changes: &[(usize, f64)]| {
        let mut values = neutral.clone();
        for (i, x) in changes {
            if let Some(slot) = values.get_mut(*i) {
                *slot = *x;
            }
        }
        values
    };
    let mut options = Vec::new();
    match effect.info().id {
        "harness_spring" => {
            for i in 0..8 {
                let origin = with(&[(1, -PI + TAU * (f64::from(i) + 0.5) / 8.0)]);
                options.push(vec![column(&origin, 0)]);
                options.push(vec![column(&origin, 0), column(&origin, 2)]);
            }
        }
        "tilt_stop_contact" => {
            let limit = neutral.get(2).copied().unwrap_or(0.1);
            for share in [0.995, 0.985, 0.97, 0.95, 0.92, 0.88, 0.8, 0.65] {
                let angle_rad = share * available.largest_tilt_rad;
                // The platform's own stop is no missing effect.
                if angle_rad > limit - OWN_STOP_RAD {
                    continue;
                }
                let origin = with(&[(2, angle_rad)]);
                options.push(vec![column(&origin, 0)]);
                options.push(vec![column(&origin, 0), column(&origin, 1)]);
            }
        }
        "gyro_saturation" => {
            // Readings that are cut off never lasted at the range itself: noise pulls their mean below it.
            for share in [
                1.03, 1.02, 1.013, 1.008, 1.004, 1.0, 0.995, 0.99, 0.985, 0.98, 0.97, 0.96, 0.945, 0.92,
                0.88, 0.83,
            ] {
                let origin = with(&[(0, share * available.largest_rate_rad_s)]);
                // What is cut off at this range: all of it or nothing.
                options.push(vec![directed(effect, reference, name(0), &origin, &[(0, 0.0)], true)]);
            }
        }
        "air_current_periodic" => {
            for hz in &lines.torque_hz {
                let sine = with(&[(3, *hz), (4, 0.0)]);
                let cosine = with(&[(3, *hz), (4, 0.5 * PI)]);
                options.push((0..3).flat_map(|i| [column(&sine, i), column(&cosine, i)]).collect());
            }
        }
        "vibration_alias" => {
            for hz in &lines.sensor_hz {
                for background in [0.0, 1.0] {
                    let origin = with(&[(6, *hz), (7, background)]);
                    options.push((0..6).map(|i| column(&origin, i)).collect());
                }
            }
        }
        "slosh" => {
            let fastest = (0.3 / available.bin_s).min(5.0);
            let coarse = grid(0.1, fastest, 7).into_iter().flat_map(|hz| [(hz, 0.02), (hz, 0.15)]);
            let seen = lines.modes.iter().map(|m| (m.hz, m.damping_ratio));
            for (hz, damping) in coarse.chain(seen) {
                for height in [-0.3, 0.3] {
                    let origin = with(&[(1, hz), (2, damping), (3, height)]);
                    options.push(vec![column(&origin, 0)]);
                }
            }
        }
        "flexible_mode" => {
            let fastest = (0.3 / available.bin_s).min(15.0);
            let mut frequencies = grid(0.3, fastest, 6);
            frequencies.extend(lines.torque_hz.iter().copied().filter(|hz| *hz > 0.2));
            let coarse = frequencies.into_iter().flat_map(|hz| DIRECTIONS.map(|d| (hz, 0.02, d)));
            let seen = lines.modes.iter().flat_map(|m| {
                let own = std::iter::once(m.axis_b.into());
                own.chain(DIRECTIONS).map(move |d: [f64; 3]| (m.hz, m.damping_ratio, d))
            });
            for (hz, damping, direction) in coarse.chain(seen) {
                let origin = with(&[(3, hz), (4, damping)]);
                let moves: Vec<(usize, f64)> = direction
                    .iter()
                    .enumerate()
                    .filter(|(_, d)| **d != 0.0)
                    .map(|(i, d)| (i, d * unit(i)))
                    .collect();
                options.push(vec![directed(effect, reference, "participation", &origin, &moves, true)]);
            }
        }
        _ => return None,
    }
    Some(options)
}

/// A contact this near the platform's own stop is that stop \[rad\].
const OWN_STOP_RAD: f64 = 0.005;

/// Directions of participation that are tried.
const DIRECTIONS: [[f64; 3]; 5] =
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.707, 0.707, 0.0], [0.707, -0.707, 0.0]];

/// `count` values from `from` to `to`, in equal ratios.
fn grid(from: f64, to: f64, count: usize) -> Vec<f64> {
    let ratio = (to / from).max(1.0).powf(1.0 / (count.max(2) - 1) as f64);
    (0..count).map(|i| from * ratio.powi(i as i32)).collect()
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
        let columns = reference.parameter_columns(find(id).unwrap());
        let indices: Vec<usize> = (0..columns.len()).collect();
        whole_parts(&options_of(id, &indices, &columns), &columns)
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
