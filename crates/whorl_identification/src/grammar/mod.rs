//! Candidate laws: a torque (or an error of a sensor) that is a coefficient times a function of recorded quantities, about an axis.
//!
//! Quantities and shapes are those of [`whorl_validation`]. Of them are made the terms that compete as laws without a name in a diagnosis
//! ([`unlisted`]), and those that have an equation, among which `whorl discover` searches ([`written`]).

mod at;
mod unlisted;
mod written;

pub(crate) use at::At;
pub(crate) use unlisted::of_diagnosis;
pub(crate) use written::{Written, two_digits, written};

use std::sync::Arc;

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_prediction::Push;
use whorl_validation::{Parity, Quantity};

use crate::signals::observed::{Applied, Observed};

/// Root mean square of a column of a law, as a share of that of the applied torques.
pub(crate) const SHARE: f64 = 0.02;
/// Prior sizes of a law that are tried, in units of its columns.
pub(crate) const SIZES: [f64; 4] = [0.3, 3.0, 30.0, 300.0];
/// One column's error of the gyro [rad/s]: the bias of a usual one.
const GYRO_RAD_S: f64 = 1e-3;
/// Rate below which directions along the rate fade out [rad/s].
const FADE_RAD_S: f64 = 5e-4;

pub(crate) type Value = Arc<dyn Fn(&At<'_>) -> f64 + Sync + Send>;

/// A function of what a run is at an instant.
#[derive(Clone)]
pub(crate) struct Term {
    /// The quantity on which it depends.
    pub variable: String,
    pub parity: Parity,
    pub frequency_hz: Option<f64>,
    /// Its frequency was read off the spectrum of what is to be explained.
    pub is_picked: bool,
    pub way: Way,
    value: Value,
    /// As an equation, if it has one.
    pub written: Option<Written>,
}

/// What a term acts on, and about which axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Way {
    /// About those of the body.
    Body,
    /// Those of the body or of the room.
    BodyOrRoom,
    /// Along the rate, as friction of any law does.
    AlongRate,
    /// About the axes of these jets.
    Jets(Jets),
    /// On a wheel, about its axis.
    Wheel(usize),
    /// In the gyro's readings, as a dead band of their own rate.
    Gyro,
    /// In the gyro's readings, by something else.
    GyroBy,
    /// In what the vector sensors see, about the vertical.
    Heading,
    /// About the vertical of the room.
    Vertical,
}

/// Which jets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Jets {
    /// Those that are open.
    Open,
    /// Those that have opened just now.
    Opened,
    /// Those that have closed just now.
    Closed,
}

impl Way {
    /// Axes about which it may act, of the body or of the room.
    fn axes(self, world: bool) -> usize {
        match (self, world) {
            (Self::AlongRate | Self::Wheel(_) | Self::Jets(_), false)
            | (Self::Heading | Self::Vertical, true) => 1,
            (Self::Body | Self::Gyro | Self::GyroBy, false) | (Self::BodyOrRoom, _) => 3,
            _ => 0,
        }
    }

    /// Unit of what it adds.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Gyro | Self::GyroBy => "rad/s",
            Self::Heading => "rad",
            _ => "N m",
        }
    }
}

impl Term {
    pub fn new(
        variable: &str,
        parity: Parity,
        way: Way,
        value: impl Fn(&At<'_>) -> f64 + Sync + Send + 'static,
    ) -> Self {
        Self {
            variable: variable.to_owned(),
            parity,
            frequency_hz: None,
            is_picked: false,
            way,
            value: Arc::new(value),
            written: None,
        }
    }
}

/// One column: a term about an axis.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Column {
    group: usize,
    term: usize,
    world: bool,
    pub axis: usize,
}

/// Columns that explain together.
#[derive(Debug, Clone)]
pub(crate) struct Law {
    pub columns: Vec<usize>,
    /// The first of its groups.
    pub group: usize,
    pub world: bool,
    /// `None`: about any.
    pub axis: Option<usize>,
}

/// Terms, in groups that explain together; each about every axis of both frames; and the laws that are made of these.
pub(crate) struct Grammar {
    pub quantities: Vec<Quantity>,
    pub groups: Vec<Vec<Term>>,
    pub columns: Vec<Column>,
    pub laws: Vec<Law>,
    /// From how far apart two columns are in no law together.
    pub apart: usize,
}

impl Grammar {
    /// A law of each group, about one axis and about all of them at once; `with_sums`: and any function of each variable that all its groups
    /// make together.
    pub fn new(quantities: Vec<Quantity>, groups: Vec<Vec<Term>>, with_sums: bool) -> Self {
        let way = |group: usize| groups[group].first().map_or(Way::Body, |term| term.way);
        let mut columns = Vec::new();
        for (group, terms) in groups.iter().enumerate() {
            for world in [false, true] {
                for axis in 0..way(group).axes(world) {
                    columns.extend((0..terms.len()).map(|term| Column { group, term, world, axis }));
                }
            }
        }
        let mut sets: Vec<Vec<usize>> = (0..groups.len()).map(|group| vec![group]).collect();
        let plain = |group: usize| {
            let first = groups[group].first().filter(|term| term.frequency_hz.is_none());
            first.map(|term| (term.way, term.variable.as_str()))
        };
        for group in (0..groups.len()).filter(|group| with_sums && plain(*group).is_some()) {
            let all: Vec<usize> = (0..groups.len()).filter(|other| plain(*other) == plain(group)).collect();
            if all.first() == Some(&group) && all.len() > 1 {
                sets.push(all);
            }
        }
        let mut laws = Vec::new();
        for set in &sets {
            for (world, axis) in [false, true].into_iter().flat_map(|world| {
                [Some(0), Some(1), Some(2), None].into_iter().map(move |axis| (world, axis))
            }) {
                if axis.is_some() && way(set[0]).axes(world) < 3 {
                    continue;
                }
                let is_own = |c: &Column| {
                    set.contains(&c.group) && c.world == world && axis.is_none_or(|axis| c.axis == axis)
                };
                let own: Vec<usize> = (0..columns.len()).filter(|i| is_own(&columns[*i])).collect();
                if !own.is_empty() {
                    laws.push(Law { columns: own, group: set[0], world, axis });
                }
            }
        }
        let span = |law: &Law| Some(law.columns.iter().max()? - law.columns.iter().min()? + 1);
        let apart = laws.iter().filter_map(span).max().unwrap_or(0);
        Self { quantities, groups, columns, laws, apart }
    }

    /// The first term of a law.
    pub fn term(&self, law: &Law) -> &Term {
        &self.groups[law.group][0]
    }

    /// What a column adds at an instant where its size is 1: a share of the applied torque RMS, a turn of 1e-3 rad; for the gyro, the
    /// reading at which a dead band of the term's width would leave nothing.
    pub fn push(&self, column: &Column, at: &At<'_>, torques: &Applied) -> Push {
        let term = &self.groups[column.group][column.term];
        let size = (term.value)(at);
        let torque_n_m = SHARE * torques.body_n_m() * size;
        let axis = Vector3::ith(column.axis, 1.0);
        let (omega, vertical_b) = (at.environment.omega_wb_b_rad_s, at.environment.vertical_b);
        match term.way {
            // Smooth where the sense of turning is uncertain.
            Way::AlongRate => Push::Body(omega * (torque_n_m / omega.norm().hypot(FADE_RAD_S))),
            Way::Jets(of) => Push::Body(at.jets_b_n_m[of as usize] * (SHARE * size)),
            Way::Wheel(wheel) => Push::Wheel(wheel, SHARE * torques.wheel_n_m(wheel) * size),
            Way::Gyro => {
                let rate = omega[column.axis];
                Push::Gyro(axis * (rate * (-(rate / size).powi(2)).exp()))
            }
            Way::GyroBy => Push::Gyro(axis * (GYRO_RAD_S * size)),
            Way::Vertical => Push::Body(vertical_b * torque_n_m),
            Way::Heading => Push::Turn(vertical_b * (1e-3 * size)),
            Way::Body | Way::BodyOrRoom if column.world => {
                Push::Body(at.environment.to_body(&axis) * torque_n_m)
            }
            Way::Body | Way::BodyOrRoom => Push::Body(axis * torque_n_m),
        }
    }
}

/// Values of each quantity at all instants of the runs.
pub(crate) fn seen(
    quantities: &[Quantity],
    observed: &[Observed<'_>],
    model: &PlatformModel,
) -> Vec<Vec<f64>> {
    let mut all = vec![Vec::new(); quantities.len()];
    for run in observed {
        for k in 0..run.motion.time_s.len() {
            let here = At::motion(quantities, run, model, k);
            all.iter_mut().zip(here.values).for_each(|(values, x)| values.push(x));
        }
    }
    all
}

/// Least and largest number.
pub(crate) fn range(values: &[f64]) -> (f64, f64) {
    values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(*x), high.max(*x)))
}
