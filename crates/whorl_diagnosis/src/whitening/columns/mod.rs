//! Sensitivities of every whitened sample to the parameters.

mod change;
pub(crate) mod moved;
#[cfg(test)]
mod tests;

pub(crate) use moved::Moved;

use nalgebra::Vector3;
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_recording::{Channel, Component};

use crate::DiagnosisError;
use crate::bins::inputs::Inputs;
use crate::bins::motion::Motion;
use crate::bins::run::Run;
use crate::parameters::{Point, Reference};
use crate::whitening::filter::{Gains, RATE, System, WHEEL, across};
use crate::whitening::mechanics::{Mechanics, Prediction};
use change::{Change, changes};

/// Columns that lie side by side.
pub(crate) const LANES: usize = 8;

/// Groups of columns that pass through the filter together: reading the filter's gains and transitions takes as
/// long as using them.
pub(crate) const GROUPS: usize = 2;

/// One row of a group of columns. There are hundreds of columns of 10^5 rows; what is computed with them is summed
/// in double precision.
pub(crate) type Lanes = [f32; LANES];

/// A run linearised at a point.
pub(crate) struct Linearised {
    pub mechanics: Mechanics,
    pub inputs: Inputs,
    pub prediction: Prediction,
    pub gains: Gains,
}

/// Reads columns of a run, a few groups at the most: of each group whitened sensitivities, one row of lanes per
/// measurement.
pub(crate) fn group_response(
    run: &Run,
    motion: &Motion,
    linearised: &Linearised,
    moved: &[Moved],
) -> Vec<Vec<Lanes>> {
    pass(run, linearised, &changes(run, motion, linearised, moved))
}

/// An input that no formula of a model gives: what it adds at every node.
pub(crate) enum UnmodelledInput {
    /// Torque on the body over every interval [N m].
    Torque(Vec<Vector3<f64>>),
    /// Torque on a wheel about its axis, its reaction on the body, over every interval [N m].
    Wheel(usize, Vec<f64>),
}

impl UnmodelledInput {
    fn change(&self, linearised: &Linearised) -> Change {
        let inverse = linearised.mechanics.inverse_inertia();
        let wheels = linearised.mechanics.model().wheels();
        // A wheel without torque about its axis keeps its momentum.
        let kept = |omega_dot: &Vector3<f64>| {
            let gyrostat = &linearised.mechanics.gyrostat;
            gyrostat.wheel_accelerations_rad_s2(&[0.0; MAX_WHEELS], &[false; MAX_WHEELS], omega_dot)
        };
        match self {
            Self::Torque(torque) => {
                let omega_dot: Vec<Vector3<f64>> = torque.iter().map(|g| inverse * g).collect();
                Change { wheel_dot: omega_dot.iter().map(kept).collect(), omega_dot, ..Change::default() }
            }
            Self::Wheel(j, torque) => {
                let Some(wheel) = wheels.get(*j) else { return Change::default() };
                let reaction = inverse * wheel.spin_axis_b.into_inner();
                let omega_dot: Vec<Vector3<f64>> = torque.iter().map(|u| -reaction * *u).collect();
                let of_wheel = |(omega_dot, u): (&Vector3<f64>, &f64)| {
                    let mut rate = kept(omega_dot);
                    rate[*j] += u / wheel.spin_inertia_kg_m2;
                    rate
                };
                let wheel_dot = omega_dot.iter().zip(torque).map(of_wheel).collect();
                Change { omega_dot, wheel_dot, ..Change::default() }
            }
        }
    }
}

/// Whitened sensitivities to unmodelled inputs.
pub(crate) fn unmodelled_input_response(
    run: &Run,
    linearised: &Linearised,
    inputs: &[UnmodelledInput],
) -> Vec<Vec<Lanes>> {
    let changes: Vec<Change> = inputs.iter().map(|input| input.change(linearised)).collect();
    pass(run, linearised, &changes)
}

/// `a + x b` lane by lane.
#[inline(always)]
fn add_scaled<const L: usize>(a: &mut [f64; L], x: f64, b: &[f64; L]) {
    for (a, b) in a.iter_mut().zip(b) {
        *a += x * b;
    }
}

/// Passes changes through the filter of a run.
fn pass(run: &Run, linearised: &Linearised, changes: &[Change]) -> Vec<Vec<Lanes>> {
    // Compiled for each kind of processor that pulp knows.
    let processor = pulp::Arch::new();
    if changes.len() > LANES {
        processor.dispatch(Pass::<{ GROUPS * LANES }> { run, linearised, changes })
    } else {
        processor.dispatch(Pass::<LANES> { run, linearised, changes })
    }
}

/// Up to `L` changes, a whole number of groups, on their way through the filter of a run.
struct Pass<'a, const L: usize> {
    run: &'a Run,
    linearised: &'a Linearised,
    changes: &'a [Change],
}

impl<const L: usize> pulp::NullaryFnOnce for Pass<'_, L> {
    type Output = Vec<Vec<Lanes>>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        wide_pass::<L>(self.run, self.linearised, self.changes)
    }
}

#[inline(always)]
fn wide_pass<const L: usize>(run: &Run, linearised: &Linearised, changes: &[Change]) -> Vec<Vec<Lanes>> {
    let gains = &linearised.gains;
    let n = gains.linear.n;
    let wheels = linearised.mechanics.model().wheels().len();
    let mut out: Vec<Vec<Lanes>> = (0..L / LANES).map(|_| Vec::with_capacity(gains.whitened.len())).collect();
    let mut s = vec![[0.0; L]; n];
    let mut next = vec![[0.0; L]; n];
    let mut tile = Tile::<L>::new(wheels);
    for k in 0..run.nodes() {
        if k % TILE == 0 {
            tile.load(k, changes);
        }
        let now = tile.node(k);
        for row in gains.linear.rows_of(k) {
            let measurement = &gains.linear.rows()[row];
            let reading = measurement.reading;
            let of_tile = |part: usize| now.get(part + reading.index()).copied().unwrap_or([0.0; L]);
            let mut v = match reading.channel {
                Channel::Gyro => of_tile(GYRO),
                Channel::Accelerometer => of_tile(ACCELEROMETER),
                Channel::Vector => direct(changes, reading, k, &linearised.prediction),
                // A wheel's speed is told by the motion alone.
                _ => [0.0; L],
            };
            for (state, h) in measurement.parts() {
                add_scaled(&mut v, h, &s[state]);
            }
            let gain = &gains.gain[row * n..(row + 1) * n];
            for (state, gain) in s.iter_mut().zip(gain) {
                add_scaled(state, -gain, &v);
            }
            let inverse = gains.inverse_stddev[row];
            v.iter_mut().for_each(|lane| *lane *= inverse);
            for (group, lanes) in out.iter_mut().zip(v.as_chunks().0) {
                group.push(lanes.map(|x| x as f32));
            }
        }
        if k + 1 >= run.nodes() {
            break;
        }
        for (slot, (columns, row)) in next.iter_mut().zip(gains.linear.transition_over(k)) {
            let mut sum = [0.0; L];
            for (m, x) in columns.iter().zip(row) {
                add_scaled(&mut sum, *x, &s[*m]);
            }
            *slot = sum;
        }
        std::mem::swap(&mut s, &mut next);
        let h = run.length(k);
        for (i, rate) in now.iter().take(GYRO).enumerate() {
            for (slot, x) in s[RATE + i].iter_mut().zip(rate) {
                *slot += x * h;
            }
            // Half of the interval's turn.
            for (slot, x) in s[i].iter_mut().zip(rate) {
                *slot += 0.5 * x * h * h;
            }
        }
        for (state, rate) in s[WHEEL..].iter_mut().zip(now.iter().skip(WHEELS)) {
            for (slot, x) in state.iter_mut().zip(rate) {
                *slot += x * h;
            }
        }
    }
    out
}

/// Nodes whose changes are laid out at once.
const TILE: usize = 32;

/// What of a node's changes comes where: accelerations of the body first, then readings of gyro and accelerometer, then
/// accelerations of the wheels.
const GYRO: usize = 3;
const ACCELEROMETER: usize = 6;
const WHEELS: usize = 9;

/// Changes of some nodes, those of all columns side by side: one by one they could not be read as fast as they are used.
struct Tile<const L: usize> {
    first: usize,
    width: usize,
    values: Vec<[f64; L]>,
}

impl<const L: usize> Tile<L> {
    fn new(wheels: usize) -> Self {
        let width = WHEELS + wheels;
        Self { first: 0, width, values: vec![[0.0; L]; TILE * width] }
    }

    #[inline(always)]
    fn load(&mut self, first: usize, changes: &[Change]) {
        self.first = first;
        self.values.fill([0.0; L]);
        for (lane, change) in changes.iter().enumerate().take(L) {
            let vectors = [(0, &change.omega_dot), (GYRO, &change.gyro), (ACCELEROMETER, &change.accel)];
            for (part, list) in vectors {
                let nodes = self.values.chunks_exact_mut(self.width);
                for (slots, x) in nodes.zip(list.iter().skip(first)) {
                    for (slot, x) in slots[part..].iter_mut().zip(x.iter()) {
                        slot[lane] = *x;
                    }
                }
            }
            let nodes = self.values.chunks_exact_mut(self.width);
            for (slots, rates) in nodes.zip(change.wheel_dot.iter().skip(first)) {
                for (slot, x) in slots[WHEELS..].iter_mut().zip(rates) {
                    slot[lane] = *x;
                }
            }
        }
    }

    #[inline(always)]
    fn node(&self, k: usize) -> &[[f64; L]] {
        let from = (k - self.first) * self.width;
        self.values.get(from..from + self.width).unwrap_or(&[])
    }
}

/// Changes of what a vector sensor sees that do not pass through the motion.
#[inline(always)]
fn direct<const L: usize>(
    changes: &[Change],
    reading: Component,
    k: usize,
    prediction: &Prediction,
) -> [f64; L] {
    let mut lanes = [0.0; L];
    if changes.iter().all(|change| change.vectors.is_empty()) {
        return lanes;
    }
    let sensor = reading.sensor();
    if let Some(seen) = prediction.vectors.get(sensor).and_then(|l| l.get(k)) {
        let (e1, e2) = across(seen);
        let e = if reading.index() == 0 { e1 } else { e2 };
        for (lane, change) in lanes.iter_mut().zip(changes) {
            *lane = change.vectors.get(sensor).and_then(|l| l.get(k)).map_or(0.0, |v| v.dot(&e));
        }
    }
    lanes
}

impl Linearised {
    /// Filters a run with the model at a point.
    pub fn new(
        run: &Run,
        motion: &Motion,
        reference: &Reference,
        point: &Point,
        settings: crate::whitening::filter::Settings,
    ) -> Result<Self, DiagnosisError> {
        let mechanics = Mechanics::new(&reference.model_at(point)?)?;
        let (inputs, prediction) = predict(&mechanics, run, motion);
        let system = System { run, motion, mechanics: &mechanics, prediction: &prediction, settings };
        let gains = system.gains(system.linear());
        Ok(Self { inputs, prediction, gains, mechanics })
    }
}

/// Inputs and prediction of a run.
pub(crate) fn predict(mechanics: &Mechanics, run: &Run, motion: &Motion) -> (Inputs, Prediction) {
    let inputs = mechanics.inputs(run);
    let mut prediction = mechanics.accelerations(run, motion, &inputs);
    mechanics.readings(run, motion, &inputs, &mut prediction);
    prediction.torque_slope = mechanics.torque_slopes(run, motion, &inputs);
    (inputs, prediction)
}
