//! Units and signs by turns: what gyro and direction sensors see of the same motion.

use nalgebra::Vector3;
use whorl_bag::Channel;
use whorl_dynamics::PlatformModel;
use whorl_free_motion::{AxisCheck, Contradiction};
use whorl_math::statistics::median;
use whorl_recording::{Recording, Series};

use super::channels::MapDraft;
use super::lines::{Origin, Sourced, number};

/// Turns this alike are of one motion \[1\].
const ALIKE: f64 = 0.8;
/// Wheels of such rigs: of a gram in a watch, and of ten kilograms [kg m^2].
const WHEELS_KG_M2: std::ops::RangeInclusive<f64> = 1e-8..=0.5;
/// A unit fits if the turns are then equal within this factor \[1\].
const WITHIN: f64 = 1.5;

/// Corrects the unit of the gyro, and signs of accelerometer and vector sensors, where their turns show them; whether anything
/// was changed.
pub fn correct(draft: &mut MapDraft, recording: &Recording, model: &PlatformModel) -> bool {
    if draft.is_bag {
        return false;
    }
    let scale = unit(draft, recording).unwrap_or(1.0);
    let signs = signs(draft, recording, scale) || scale != 1.0;
    torques(draft, recording, model) || signs
}

/// Compares the torques that were commanded to wheels with what they do to the speeds: reverses columns of wheels that slow down when
/// they are told to speed up, and takes another unit of torque where the wheels would be heavier or lighter than wheels are, unless the
/// name says the unit; whether anything was changed.
fn torques(draft: &mut MapDraft, recording: &Recording, model: &PlatformModel) -> bool {
    let responses = recording.wheel_responses(model);
    let seen = responses.iter().zip(model.wheels()).filter_map(|(response, wheel)| {
        let (ratio, correlation) = (*response)?;
        (correlation.abs() > ALIKE && ratio != 0.0).then(|| wheel.spin_inertia_kg_m2 / ratio.abs())
    });
    let inertia_kg_m2 = median(seen);
    if !(inertia_kg_m2 > 0.0 && inertia_kg_m2.is_finite()) {
        return false;
    }
    let Some(entry) = draft.entry_mut(Channel::WheelTorqueCommand) else { return false };
    let mut reversed = Vec::new();
    for (column, response) in entry.columns.iter_mut().zip(&responses) {
        if response.is_some_and(|(_, correlation)| correlation < -ALIKE) {
            reversed.push(column.clone());
            *column = match column.strip_prefix('-') {
                Some(bare) => bare.to_owned(),
                None => format!("-{column}"),
            };
        }
    }
    if !reversed.is_empty() {
        let words =
            format!("the speed falls where {} rises, so its sign is reversed", reversed.join(" and "));
        entry.of = Sourced::new((), Origin::Measured, words);
    }
    let Some(unit) = entry.unit.as_mut() else { return !reversed.is_empty() };
    let known = Channel::WheelTorqueCommand.info().units;
    let Some(now) = known.iter().find(|known| known.name == unit.value) else { return !reversed.is_empty() };
    if WHEELS_KG_M2.contains(&inertia_kg_m2) {
        return !reversed.is_empty();
    }
    let inertia_in = |factor: f64| inertia_kg_m2 * factor / now.factor;
    let says =
        |name: &str, inertia: f64| format!("in {name} the wheel would have {} kg m^2", number(inertia));
    let wrong = says(now.name, inertia_kg_m2);
    let better = known.iter().find(|known| WHEELS_KG_M2.contains(&inertia_in(known.factor)));
    match better.filter(|_| unit.origin == Origin::Assumed) {
        Some(better) => {
            *unit = Sourced::new(better.name.to_owned(), Origin::Assumed, format!("{wrong}; check it"));
            true
        }
        None => {
            let note = format!(
                "By what {} does to the speed, {wrong}: is the unit right?",
                entry.columns.join(", ")
            );
            if !draft.notes.contains(&note) {
                draft.notes.push(note);
            }
            !reversed.is_empty()
        }
    }
}

fn ratio(recording: &Recording) -> Option<f64> {
    let seen = recording.turns_seen();
    let alike = seen.iter().filter(|turns| turns.correlation.abs() > ALIKE && turns.ratio.is_finite());
    alike.max_by(|a, b| a.correlation.abs().total_cmp(&b.correlation.abs())).map(|turns| turns.ratio)
}

/// The factor from the unit with which the gyro was read to the one that turns show; `None` where they show none.
fn unit(draft: &mut MapDraft, recording: &Recording) -> Option<f64> {
    let ratio = ratio(recording)?;
    let unit = draft.entry_mut(Channel::Gyro)?.unit.as_mut()?;
    let known = Channel::Gyro.info().units;
    let now = known.iter().find(|known| known.name == unit.value)?;
    let wanted = now.factor * ratio;
    let off = |factor: f64| (factor / wanted).ln().abs();
    let found = known.iter().min_by(|a, b| off(a.factor).total_cmp(&off(b.factor)))?;
    if off(found.factor) > WITHIN.ln() {
        return None;
    }
    let was = unit.clone();
    let percent = ((found.factor / wanted - 1.0).abs() * 100.0).ceil();
    let turns = format!("it turns as far as the directions that other sensors see, within {percent} %");
    let words = if was.origin == Origin::Stated && found.name != now.name {
        format!("{turns}, although {} {}", was.words, was.value)
    } else {
        turns
    };
    *unit = Sourced::new(found.name.to_owned(), Origin::Measured, words);
    Some(found.factor / now.factor)
}

/// Reverses columns of accelerometer or vector sensors that turn against the gyro; whether any was.
fn signs(draft: &mut MapDraft, recording: &Recording, scale: f64) -> bool {
    if recording.gyro_axes() != [true; 3] {
        return false;
    }
    let mut check = AxisCheck::default();
    let field = recording.vectors.first().map(|sensor| &sensor.direction_b);
    let none = Series::default();
    let whole = recording.has_whole_accelerometer();
    let force = if whole { &recording.specific_force_b_m_s2 } else { &none };
    let (mut of_force, mut of_field) = (Samples::of(force), field.map(Samples::of));
    for (time_s, rate) in recording.gyro_b_rad_s.time_s.iter().zip(&recording.gyro_b_rad_s.value) {
        let force = of_force.since(*time_s);
        check.on_imu((time_s * 1e9) as i64, &(rate * scale), force.as_ref());
        if let Some(field) = of_field.as_mut().and_then(|samples| samples.since(*time_s)) {
            check.on_field(&field);
        }
    }
    let [force, field] = check.contradictions();
    if let (Some(force), Some(other)) = (&force, &field)
        && force == other
    {
        draft.notes.push(format!(
            "The gyro turns against accelerometer and vector sensor, which agree: by them, {force}, of the gyro. Correct the map."
        ));
        return false;
    }
    let mut changed = false;
    for (channel, found) in [(Channel::Accelerometer, force), (Channel::Vector, field)] {
        if let (Some(found), Some(entry)) = (found, draft.entry_mut(channel)) {
            changed |= reverse(entry, &found);
        }
    }
    changed
}

fn reverse(entry: &mut super::channels::Entry, found: &Contradiction) -> bool {
    let axis = |letter: &char| ['x', 'y', 'z'].iter().position(|name| name == letter);
    let [.., last] = found.reversed.as_slice() else {
        entry.of =
            Sourced::new((), Origin::Assumed, format!("turns against the gyro: {found}; correct the map"));
        return false;
    };
    // Of several that would do, the one across the floor rather than up.
    let chosen = found.reversed.iter().find(|letter| **letter != 'z').unwrap_or(last);
    let Some(column) = axis(chosen).and_then(|index| entry.columns.get_mut(index)) else { return false };
    *column = match column.strip_prefix('-') {
        Some(bare) => bare.to_owned(),
        None => format!("-{column}"),
    };
    let words = format!("turned against the gyro, as {found}; {chosen} was chosen");
    entry.of = Sourced::new((), Origin::Measured, words);
    true
}

/// Samples, one after the other.
struct Samples<'a> {
    series: &'a Series<Vector3<f64>>,
    next: usize,
}

impl<'a> Samples<'a> {
    fn of(series: &'a Series<Vector3<f64>>) -> Self {
        Self { series, next: 0 }
    }

    /// The latest sample up to a time, if it was not given yet.
    fn since(&mut self, time_s: f64) -> Option<Vector3<f64>> {
        let before = self.next;
        while self.series.time_s.get(self.next).is_some_and(|t| *t <= time_s) {
            self.next += 1;
        }
        (self.next > before).then(|| self.series.value.get(self.next - 1).copied()).flatten()
    }
}
