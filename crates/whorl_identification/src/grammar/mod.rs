//! Candidate laws: a torque (or an error of a sensor) that is a coefficient times a function of recorded quantities, about an axis.
//! [`unlisted`]: those of a diagnosis; [`written`]: those that have an equation, among which `whorl discover` searches.

mod unlisted;
mod written;

pub(crate) use unlisted::of_diagnosis;
pub(crate) use written::{Written, two_digits, written};

use std::sync::Arc;

use nalgebra::Vector3;
use whorl_dynamics::actuators::wheels::MAX_WHEELS;
use whorl_dynamics::{Environment, PlatformModel};
use whorl_prediction::{Push, SmoothedState};
use whorl_validation::{Parity, Quantity, environment};

use crate::signals::observed::{Applied, Observed};

/// Root mean square of a column of a law, as a share of that of the applied torques.
pub(crate) const SHARE: f64 = 0.02;
/// Prior sizes of a law that are tried, in units of its columns.
pub(crate) const SIZES: [f64; 4] = [0.3, 3.0, 30.0, 300.0];
/// One column's error of the gyro [rad/s]: the bias of a usual one.
const GYRO_RAD_S: f64 = 1e-3;
/// Rate below which directions along the rate fade out [rad/s].
const FADE_RAD_S: f64 = 5e-4;
/// Most quantities of the table.
const MOST_QUANTITIES: usize = 12 + 2 * MAX_WHEELS;
/// Time for which a valve has opened or closed just now \[s\]: what solenoid valves of a few newtons take, and a pulse has at least.
const EDGE_S: f64 = 0.02;

/// A function of what a run is at an instant.
#[derive(Clone)]
pub(crate) struct Term {
    pub variable: String,
    pub parity: Parity,
    /// That of a line that was read off the spectrum of what is to be explained.
    pub frequency_hz: Option<f64>,
    pub way: Way,
    value: Arc<dyn Fn(&At<'_>) -> f64 + Sync + Send>,
    pub written: Option<Written>,
}

impl Term {
    pub fn new(
        variable: &str,
        parity: Parity,
        way: Way,
        value: impl Fn(&At<'_>) -> f64 + Sync + Send + 'static,
    ) -> Self {
        let (variable, value) = (variable.to_owned(), Arc::new(value));
        Self { variable, parity, frequency_hz: None, way, value, written: None }
    }
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
    /// About the axes of those jets that are open (0), or have opened (1) or closed (2) just now.
    Jets(usize),
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

    pub fn unit(self) -> &'static str {
        match self {
            Self::Gyro | Self::GyroBy => "rad/s",
            Self::Heading => "rad",
            _ => "N m",
        }
    }
}

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
    /// A law of each group, none empty, about one axis and all at once; `with_sums`: and any function of each variable that its groups make together.
    pub fn new(quantities: Vec<Quantity>, groups: Vec<Vec<Term>>, with_sums: bool) -> Self {
        let mut columns = Vec::new();
        for (group, terms) in groups.iter().enumerate() {
            for world in [false, true] {
                for axis in 0..terms[0].way.axes(world) {
                    columns.extend((0..terms.len()).map(|term| Column { group, term, world, axis }));
                }
            }
        }
        let mut sets: Vec<Vec<usize>> = (0..groups.len()).map(|group| vec![group]).collect();
        let of_variable = |group: usize| {
            let first = &groups[group][0];
            (first.frequency_hz.is_none()).then_some((first.way, first.variable.as_str()))
        };
        for group in (0..groups.len()).filter(|group| with_sums && of_variable(*group).is_some()) {
            let is_same = |other: &usize| of_variable(*other) == of_variable(group);
            let all: Vec<usize> = (0..groups.len()).filter(is_same).collect();
            if all[0] == group && all.len() > 1 {
                sets.push(all);
            }
        }
        let mut laws = Vec::new();
        for set in &sets {
            for world in [false, true] {
                let axes = groups[set[0]][0].way.axes(world);
                let each = (0..axes).filter(|_| axes == 3).map(Some);
                for axis in each.chain((axes > 0).then_some(None)) {
                    let is_own = |c: &Column| {
                        set.contains(&c.group) && c.world == world && axis.is_none_or(|axis| c.axis == axis)
                    };
                    let own = (0..columns.len()).filter(|i| is_own(&columns[*i])).collect();
                    laws.push(Law { columns: own, group: set[0], world, axis });
                }
            }
        }
        let span = |law: &Law| Some(law.columns.last()? - law.columns.first()? + 1);
        let apart = laws.iter().filter_map(span).max().unwrap_or(0);
        Self { quantities, groups, columns, laws, apart }
    }

    pub fn term(&self, law: &Law) -> &Term {
        &self.groups[law.group][0]
    }

    /// What a column adds at an instant where its size is 1: a share of the applied torque RMS, a turn of 1e-3 rad; for the gyro, the
    /// reading at which a dead band of the term's width would leave nothing.
    pub fn push(&self, column: &Column, at: &At<'_>, torques: &Applied) -> Push {
        let term = &self.groups[column.group][column.term];
        let size = (term.value)(at);
        let torque_n_m = SHARE * torques.body_n_m() * size;
        let (here, axis) = (&at.environment, Vector3::ith(column.axis, 1.0));
        let (omega, vertical_b) = (here.omega_wb_b_rad_s, here.vertical_b);
        let rate = omega[column.axis];
        match term.way {
            // Smooth where the sense of turning is uncertain.
            Way::AlongRate => Push::Body(omega * (torque_n_m / omega.norm().hypot(FADE_RAD_S))),
            Way::Jets(of) => Push::Body(at.jets_b_n_m[of] * (SHARE * size)),
            Way::Wheel(wheel) => Push::Wheel(wheel, SHARE * torques.wheel_n_m(wheel) * size),
            Way::Gyro => Push::Gyro(axis * (rate * (-(rate / size).powi(2)).exp())),
            Way::GyroBy => Push::Gyro(axis * (GYRO_RAD_S * size)),
            Way::Vertical => Push::Body(vertical_b * torque_n_m),
            Way::Heading => Push::Turn(vertical_b * (1e-3 * size)),
            Way::Body | Way::BodyOrRoom if column.world => Push::Body(here.to_body(&axis) * torque_n_m),
            Way::Body | Way::BodyOrRoom => Push::Body(axis * torque_n_m),
        }
    }
}

/// What a law may depend on.
pub(crate) struct At<'a> {
    pub environment: Environment<'a>,
    pub values: [f64; MOST_QUANTITIES],
    /// From -1 at the beginning of the run to 1 at its end.
    pub time_in_run: f64,
    /// Torque of the jets that are open, that have opened and that have closed just now, body axes [N m]: as commanded, behind the valves' delays.
    pub jets_b_n_m: [Vector3<f64>; 3],
    pub jets_open: f64,
}

impl<'a> At<'a> {
    pub fn motion(
        quantities: &[Quantity],
        run: &Observed<'a>,
        model: &'a PlatformModel,
        state: &'a SmoothedState,
    ) -> Self {
        let (motion, wheels) = ((state.q_world_body, state.omega_wb_b_rad_s), &state.wheel_speed_rad_s);
        Self::new(quantities, run, environment(model, run.recording, state.time_s, motion, wheels))
    }

    /// Of an instant of the same run, as a plant comes through it.
    pub fn new(all: &[Quantity], run: &Observed<'_>, environment: Environment<'a>) -> Self {
        let (states, time_s) = (&run.motion.states, environment.time_s);
        let [first_s, last_s] = [states.first(), states.last()].map(|at| at.map_or(0.0, |at| at.time_s));
        let (mut jets_b_n_m, mut jets_open) = ([Vector3::zeros(); 3], 0.0);
        for (jet, pulses) in environment.model.jets().iter().zip(&run.recording.jet_pulses) {
            let begun = pulses.partition_point(|pulse| pulse.on_s + jet.opening_delay_s <= time_s);
            let Some(pulse) = begun.checked_sub(1).and_then(|last| pulses.get(last)) else { continue };
            let opened_s = time_s - pulse.on_s - jet.opening_delay_s;
            let closed_s = time_s - pulse.off_s - jet.closing_delay_s;
            let is_open = closed_s < 0.0;
            let phases = [is_open, is_open && opened_s < EDGE_S, (0.0..EDGE_S).contains(&closed_s)];
            for (torque_b_n_m, _) in jets_b_n_m.iter_mut().zip(phases).filter(|(_, is)| *is) {
                *torque_b_n_m += jet.torque_b_n_m();
            }
            jets_open += f64::from(u8::from(is_open));
        }
        Self {
            values: std::array::from_fn(|i| all.get(i).map_or(0.0, |of| of.formula.number(&environment))),
            time_in_run: 2.0 * (time_s - first_s) / (last_s - first_s).max(1e-9) - 1.0,
            jets_b_n_m,
            jets_open,
            environment,
        }
    }
}

/// Least and largest value of each quantity at all instants of the runs.
pub(crate) fn ranges(of: &[Quantity], observed: &[Observed<'_>], model: &PlatformModel) -> Vec<(f64, f64)> {
    let mut ranges = vec![(f64::INFINITY, f64::NEG_INFINITY); of.len()];
    for (run, state) in observed.iter().flat_map(|run| run.motion.states.iter().map(move |at| (run, at))) {
        for ((low, high), x) in ranges.iter_mut().zip(At::motion(of, run, model, state).values) {
            (*low, *high) = (low.min(x), high.max(x));
        }
    }
    ranges
}
