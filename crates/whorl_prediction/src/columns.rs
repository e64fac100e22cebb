//! How the estimates and innovations of a filter change with its state at an earlier instant and with the parameters of its model, through
//! the same gains.
//!
//! For each parameter another plant begins every step in the filter's own state, with the model a little further along the
//! parameter: what it does otherwise is what drives the column, whatever the effect is. See METHOD.md, "Sensitivities".

use nalgebra::{DMatrix, DVector, Vector3};
use whorl_dynamics::State;
use whorl_dynamics::plant::{Acts, LinearisedPlant, Plant};
use whorl_recording::Channel;

use crate::design::Design;
use crate::error::PredictionError;
use crate::gains::Gains;
use crate::information::Information;
use crate::innovations::Mean;
use crate::lanes::{BLOCK, Gain, Lanes, MOST_STATES, dot};
use crate::laws::{Laws, Push, add_rates_by_torque};
use crate::layout::Layout;
use crate::other::{Differs, Does, Other, Varied};
use crate::prepared::{OtherModel, Prepared};
use crate::rows::{Readings, Row};
use crate::since::Since;

/// Steps up to this share of the time of the fastest motion may be taken with what a parameter does at their start: the motion turns
/// what it does by as many radians meanwhile.
const SHORT_STEP: f64 = 0.05;

/// Columns of sensitivities: those of the state at the beginning, one for each parameter, then one for the size of each law.
pub(crate) struct Columns<'a> {
    /// Coordinates of the state at the beginning, if their columns are wanted.
    states: usize,
    others: Vec<Other<'a>>,
    /// What has no parameter, behind the others,
    laws: Option<&'a Laws<'a>>,
    /// and what it does over the present step; room for what it does at its end.
    pushes: Vec<Push>,
    now: Vec<Push>,
    /// The filter's own model, which takes the steps that the others take.
    reference: Option<Reference<'a>>,
    /// Where the filter's plant was before the step, and when \[ns\], where readings are taken to be late.
    before: Option<(State, i64)>,
    blocks: Vec<Block>,
    /// Columns that took a step of their own, one after the other, and room for one of them.
    stepped: Vec<f64>,
    moved: [f64; MOST_STATES],
    /// Readings of another model.
    varied: Readings,
    /// Sum of d d^T / S over all innovations e with d = de/dtheta: the information on the parameters.
    information: Information,
    /// Sum of d e / S.
    slope: DVector<f64>,
    /// How fast the filter's state moved over the last step, coordinates of the plant per second.
    rates: DVector<f64>,
    /// d of all innovations, if they are kept.
    design: Option<Design>,
}

/// The filter's own model beside the filter.
struct Reference<'a> {
    with: OtherModel<'a>,
    /// How it acts over the present step, if that is short, and at its end.
    acts: Acts,
    is_steady: bool,
    acts_now: Acts,
}

/// Columns that lie side by side.
struct Block {
    /// Of the filter's estimate, a row for each coordinate of the layout, per unit.
    of_state: Lanes,
    /// What is added over half of a step, to coordinates of the plant; all zeros: nothing.
    half: Lanes,
    is_pushed: bool,
    /// Of the innovations of the present instant, a row each.
    d: Lanes,
}

/// What columns say at the end: of the state at the beginning first, then of parameters and laws.
pub(crate) struct Said {
    /// Sum of d d^T / S.
    pub information: DMatrix<f64>,
    /// Minus the sum of d e / S: d log p by each.
    pub slope: DVector<f64>,
    pub design: Option<Design>,
}

impl<'a> Columns<'a> {
    /// For a filter that has not begun; `of_start`: with columns of the state at its start.
    pub fn new(
        case: &Prepared<'a>,
        layout: Layout,
        of_start: bool,
        varied: &[Varied],
        laws: Option<&'a Laws<'a>>,
    ) -> Result<Self, PredictionError> {
        let states = if of_start { layout.size() } else { 0 };
        let others: Vec<Other<'a>> =
            varied.iter().map(|varied| Other::new(case, varied)).collect::<Result<_, _>>()?;
        let mut reference = None;
        if !others.is_empty() || laws.is_some() {
            let mut own = case.varied(case.given_model())?;
            own.plant = own.plant.for_differences(others.iter().any(|other| other.behind.is_some()));
            let [acts, acts_now] = [(); 2].map(|()| Acts::none(&own.plant));
            reference = Some(Reference { with: own, acts, is_steady: false, acts_now });
        }
        let plant = case.plant().tangent().size();
        let mut columns = Self::of_state(layout.size(), states, plant, varied.len(), laws);
        (columns.others, columns.laws, columns.reference) = (others, laws, reference);
        Ok(columns)
    }

    /// Of the state now alone, which has so many coordinates.
    pub fn since_now(layout: Layout) -> Self {
        Self::of_state(layout.size(), layout.size(), layout.plant.size(), 0, None)
    }

    fn of_state(size: usize, states: usize, plant: usize, varied: usize, laws: Option<&Laws<'_>>) -> Self {
        let (parameters, of_laws) = (states + varied, laws.map_or(0, Laws::count));
        let count = parameters + of_laws;
        // One row of few columns, or blocks of many.
        let (blocks, least) = if count < BLOCK { (1, count.max(1)) } else { (count.div_ceil(BLOCK), BLOCK) };
        let block = || Block {
            of_state: Lanes::zeros(size, least),
            half: Lanes::zeros(plant, least),
            is_pushed: false,
            d: Lanes::zeros(0, least),
        };
        let mut blocks: Vec<Block> = (0..blocks).map(|_| block()).collect();
        let width = blocks[0].of_state.width();
        for i in 0..states {
            blocks[i / width].of_state.row_mut(i)[i % width] = 1.0;
        }
        Self {
            states,
            others: Vec::new(),
            laws: None,
            pushes: Vec::new(),
            now: Vec::new(),
            reference: None,
            before: None,
            blocks,
            stepped: Vec::new(),
            moved: HERE,
            varied: Readings::default(),
            information: Information::new(parameters, of_laws, laws.map_or(0, Laws::apart)),
            slope: DVector::zeros(count),
            rates: DVector::zeros(plant),
            design: None,
        }
    }

    /// The same, which keeps how all innovations change.
    pub fn keeping(mut self, design: Option<Design>) -> Self {
        self.design = design;
        self
    }

    /// What was found of all innovations so far.
    pub fn said(self) -> Said {
        Said { information: self.information.sum(), slope: -self.slope, design: self.design }
    }

    /// What was read since the state of which these columns are.
    pub fn since(self) -> Since {
        let transition = self.by_state();
        let said = self.said();
        Since { transition, slope: said.slope, information: said.information }
    }

    /// How the present state changes with that at the beginning.
    fn by_state(&self) -> DMatrix<f64> {
        let (n, width) = (self.states, self.width());
        DMatrix::from_fn(n, n, |i, k| self.blocks[k / width].of_state.row(i)[k % width])
    }

    fn width(&self) -> usize {
        self.blocks[0].of_state.width()
    }

    /// Before a step that ends at an instant, on the way to that of the next readings: how every varied model acts in the filter's state, or where more happens within the step
    /// than that shows, the model in the state that the filter would have with it.
    pub fn set_out(&mut self, mean: &Mean<'_>, end_ns: i64, instant_ns: i64) {
        let (case, plant) = (mean.case, &mean.plant);
        if let Some(laws) = self.laws {
            laws.at(plant, &mut self.pushes);
        }
        let (n, width, first) = (self.rates.len(), self.width(), self.states);
        let Self { others, reference, blocks, before, stepped, .. } = self;
        let Some(Reference { with: reference, acts, is_steady, .. }) = reference else { return };
        reference.plant.take_motion_of(plant, &[]);
        let step_s = (end_ns - plant.now_ns()) as f64 * 1e-9;
        let is_simple = step_s * case.fastest_1_s() <= SHORT_STEP && reference.is_steady_until(case, end_ns);
        *is_steady = is_simple;
        if is_simple {
            reference.plant.act_into(acts);
        }
        *before = others.iter().any(Other::is_late).then(|| (*plant.state(), plant.now_ns()));
        let jets_rest = is_simple && reference.plant.jets_rest();
        // The bearing's own stop is as stiff as the body is heavy: while it touches, inertia is no torque alone.
        let is_free = is_simple && !plant.touching()[0];
        let any_torque = is_free && others.iter().any(|other| other.differs == Differs::InTorque);
        let environment = any_torque.then(|| plant.environment());
        let wheels = plant.tangent().wheels().len();
        for (k, other) in others.iter_mut().enumerate() {
            other.does = Does::TheSame;
            if other.differs == Differs::InReadings {
                continue;
            }
            if let Some(environment) = environment.as_ref().filter(|_| other.differs == Differs::InTorque) {
                other.push(environment, wheels);
                continue;
            }
            if is_simple && !matches!(other.differs, Differs::WithinSteps | Differs::InTorque) {
                if jets_rest && other.differs == Differs::InJets && other.with.is_steady_until(case, end_ns) {
                    continue;
                }
                other.with.take_motion_of(plant, &[], instant_ns);
                if other.with.is_steady_until(case, end_ns) && other.with.plant.holds_wheels_of(plant) {
                    other.with.plant.act_into(&mut other.acts);
                    other.does = Does::Act;
                    continue;
                }
            }
            let (block, lane) = ((first + k) / width, (first + k) % width);
            stepped.clear();
            stepped.extend((0..n).map(|i| blocks[block].of_state.row(i)[lane] * other.step));
            if other.differs == Differs::InTorque {
                other.stand_in_for(plant, stepped, mean.event);
            } else {
                other.take_motion_of(plant, stepped, instant_ns);
            }
            other.does = Does::Step;
        }
    }

    /// Behind a step of the plant, over which errors moved as the gains have found. False where a motion is lost.
    pub fn follow(&mut self, case: &Prepared<'_>, plant: &Plant, gains: &Gains<'_>) -> bool {
        let (transition, axis) = (&gains.step.transition, gains.unseen_axis.as_ref());
        let (width, first, n) = (self.width(), self.states, self.rates.len());
        self.stepped.clear();
        if let Some(Reference { with: reference, acts: of_reference, is_steady, .. }) = &mut self.reference {
            let step_s = (plant.now_ns() - reference.plant.now_ns()) as f64 * 1e-9;
            if !reference.run_to(case, plant.now_ns()) {
                return false;
            }
            let reference = &reference.plant;
            // Half of what a model does goes through the whole step: s <- F (s + h/2 r) + h/2 r.
            for block in self.blocks.iter_mut().filter(|block| block.is_pushed) {
                block.half.clear(n);
                block.is_pushed = false;
            }
            for (k, push) in self.pushes.iter().enumerate() {
                let column = first + self.others.len() + k;
                let block = &mut self.blocks[column / width];
                block.is_pushed = true;
                push.add_rates(plant, &gains.linearised, 0.5 * step_s, &mut |i, rate| {
                    block.half.row_mut(i)[column % width] += rate;
                });
            }
            for (k, other) in self.others.iter_mut().enumerate() {
                if !*is_steady {
                    break;
                }
                let column = first + k;
                match other.does {
                    Does::Act => {
                        let share = 0.5 * step_s / other.step;
                        let block = &mut self.blocks[column / width];
                        block.is_pushed = true;
                        for (i, (own, of)) in other.acts.rates.iter().zip(&of_reference.rates).enumerate() {
                            block.half.row_mut(i)[column % width] = share * (own - of);
                        }
                        other.with.plant.wait_until(plant.now_ns(), &other.acts);
                    }
                    Does::Push => {
                        let share = 0.5 * step_s / other.step;
                        let block = &mut self.blocks[column / width];
                        block.is_pushed = true;
                        let (body, wheels) = (other.body_n_m * share, other.wheels_n_m.map(|x| x * share));
                        add_rates_by_torque(plant, &gains.linearised, body, &wheels, &mut |i, rate| {
                            block.half.row_mut(i)[column % width] += rate;
                        });
                    }
                    Does::TheSame if other.differs == Differs::InJets => {
                        other.with.plant.wait_until(plant.now_ns(), of_reference);
                    }
                    Does::TheSame | Does::Step => {}
                }
            }
            for (k, other) in self.others.iter_mut().enumerate().filter(|(_, other)| other.does == Does::Step)
            {
                if !other.with.run_to(case, plant.now_ns()) {
                    return false;
                }
                if let Some(behind) = &mut other.behind {
                    *behind = other.with.plant.behind_filter_less(reference);
                }
                let (block, lane) = (&self.blocks[(first + k) / width], (first + k) % width);
                let before = |i: usize| block.of_state.row(i)[lane];
                // Where one sticks and the other slips the difference says nothing of a small one.
                let is_alike = other.with.plant.is_on_branch_of(reference);
                // The plants know better than derivatives that are held how a state moves on; disturbances they have in
                // common.
                let moved = &mut self.moved[..n];
                other.with.plant.motion_less(reference.state(), moved);
                for (i, row) in transition.rows().enumerate() {
                    let of_rest = row.iter().filter(|(k, _)| *k >= n || !is_alike || i >= n);
                    let through: f64 = of_rest.map(|(k, by)| by * before(*k)).sum();
                    let own = if is_alike && i < n { moved[i] / other.step } else { before(i) };
                    self.stepped.push(own + through);
                }
            }
        }
        for block in &mut self.blocks {
            if block.is_pushed {
                block.of_state.add(&block.half);
            }
            block.of_state.carry(transition);
            if block.is_pushed {
                block.of_state.add(&block.half);
            }
        }
        let moving = transition.count();
        let stepped = self.others.iter().enumerate().filter(|(_, other)| other.does == Does::Step);
        for ((k, _), moved) in stepped.zip(self.stepped.chunks_exact(moving.max(1))) {
            let (block, lane) = (&mut self.blocks[(first + k) / width], (first + k) % width);
            moved.iter().enumerate().for_each(|(i, x)| block.of_state.row_mut(i)[lane] = *x);
        }
        if let Some(axis) = axis {
            self.blocks.iter_mut().for_each(|block| block.of_state.level(axis));
        }
        if let Some((before, before_ns)) = &self.before {
            let step_s = (plant.now_ns() - before_ns) as f64 * 1e-9;
            plant.motion_less(before, self.rates.as_mut_slice());
            self.rates /= step_s;
        }
        true
    }

    /// A wheel that its friction holds stands whatever the parameters are.
    pub fn hold(&mut self, coordinate: usize) {
        self.blocks.iter_mut().for_each(|block| block.of_state.hold_row(coordinate));
    }

    /// How each reading in the filter's state changes with the parameters where the state does not.
    pub fn read(&mut self, mean: &Mean<'_>, linearised: &LinearisedPlant, readings: &Readings) {
        let plant = &mean.plant;
        let (width, n, first) = (self.width(), self.rates.len(), self.states);
        self.blocks.iter_mut().for_each(|block| block.d.clear(readings.rows.len()));
        // What a sensor adds it adds to what it reads now; of a torque, what it was over the step.
        let mut set = |column: usize, row: usize, x: f64| {
            self.blocks[column / width].d.row_mut(row)[column % width] = x;
        };
        if let Some(laws) = self.laws {
            if self.pushes.is_empty() || !self.pushes.iter().all(Push::is_torque) {
                laws.at(plant, &mut self.now);
                let over_step =
                    self.now.iter_mut().zip(&self.pushes).filter(|(_, of_step)| of_step.is_torque());
                over_step.for_each(|(push, of_step)| *push = *of_step);
                std::mem::swap(&mut self.now, &mut self.pushes);
            }
            for (k, push) in self.pushes.iter().enumerate() {
                for (r, row) in readings.rows.iter().enumerate() {
                    let by_state = readings.by_state.row(r);
                    set(first + self.others.len() + k, r, push.of_reading(plant, linearised, row, by_state));
                }
            }
        }
        let Some(Reference { with: reference, acts, is_steady, acts_now }) = &mut self.reference else {
            return;
        };
        // What differs in readings alone shows in the state as it is now.
        let now = self.others.iter().any(|other| other.differs == Differs::InReadings).then(|| {
            reference.plant.take_motion_of(plant, &[]);
            reference.plant.act_into(acts_now);
            &*acts_now
        });
        let of_step = is_steady.then_some(&*acts);
        for (k, other) in self.others.iter_mut().enumerate() {
            let moves = |r: usize, late_s: f64| {
                let by_state = || dot_within(readings.by_state.row(r), self.rates.as_slice());
                if late_s == 0.0 { 0.0 } else { by_state() * late_s }
            };
            let reads_later = match (other.does, of_step, now) {
                _ if other.turns_vectors => None,
                (Does::Act, Some(of_reference), _) => Some(of_reference.imu - other.acts.imu),
                (Does::Push, ..) => {
                    let wheels = plant.gyrostat().model().wheels().iter().zip(&other.wheels_n_m);
                    let reaction: Vector3<f64> =
                        wheels.map(|(wheel, torque)| wheel.spin_axis_b.into_inner() * *torque).sum();
                    let force = linearised.force_by_torque * (other.body_n_m - reaction);
                    let mut less = -other.imu;
                    let mut of_force = less.fixed_rows_mut::<3>(3);
                    of_force -= force;
                    Some(less)
                }
                (Does::TheSame, _, Some(now)) if other.differs == Differs::InReadings => {
                    Some(now.imu - other.with.plant.imu_of(&reference.plant, now))
                }
                (Does::TheSame, ..) => continue,
                _ => None,
            };
            let of_imu = other.late_s;
            let late_s = |row: &Row| match row.component.channel {
                Channel::Gyro => of_imu[0],
                Channel::Accelerometer => of_imu[1],
                _ => 0.0,
            };
            if let Some(less) = reads_later {
                for (r, row) in readings.rows.iter().enumerate() {
                    let at = match row.component.channel {
                        Channel::Gyro => row.component.index(),
                        Channel::Accelerometer => 3 + row.component.index(),
                        _ => continue,
                    };
                    set(first + k, r, (less[at] + moves(r, late_s(row))) / other.step);
                }
                continue;
            }
            other.take_motion_of(plant, &HERE[..n.min(HERE.len())], plant.now_ns());
            if !other.with.plant.is_on_branch_of(plant) {
                continue;
            }
            mean.read_of(&other.with.plant, mean.beside.as_slice(), None, &mut self.varied);
            for (r, (row, varied)) in readings.rows.iter().zip(&self.varied.rows).enumerate() {
                set(first + k, r, (varied.value - row.value + moves(r, late_s(row))) / other.step);
            }
        }
    }

    /// Takes in the readings of an instant, of which these are the innovations.
    pub fn take_in(&mut self, readings: &Readings, gain: &Gain, values: &[f64]) {
        // Nobody has read how they change by themselves.
        for block in &mut self.blocks {
            if block.d.rows() != readings.rows.len() {
                block.d.clear(readings.rows.len());
            }
            block.of_state.take_in(&readings.by_state, gain, &mut block.d);
        }
        for (r, (value, variance)) in values.iter().zip(&gain.variances).enumerate() {
            let scale = 1.0 / variance.sqrt();
            let normalised = self.information.next();
            for (block, to) in self.blocks.iter().zip(normalised.chunks_mut(block_width(&self.blocks))) {
                to.iter_mut().zip(block.d.row(r)).for_each(|(to, d)| *to = d * scale);
            }
            let e = value * scale;
            self.slope.iter_mut().zip(normalised.iter()).for_each(|(slope, d)| *slope += e * d);
            if let Some(design) = &mut self.design {
                design.push(normalised);
            }
            self.information.added();
        }
    }

    /// How the innovation of a reading of the present instant changes with parameter by parameter.
    pub fn latest(&self, reading: usize, to: &mut DVector<f64>) {
        let width = self.width();
        for (slot, c) in to.iter_mut().zip(self.states..self.slope.len()) {
            *slot = self.blocks[c / width].d.row(reading)[c % width];
        }
    }

    /// How many columns there are besides those of the state.
    pub fn count(&self) -> usize {
        self.slope.len() - self.states
    }

    /// Whether derivatives by a torque are needed.
    pub fn has_torques(&self) -> bool {
        self.laws.is_some() || self.others.iter().any(|other| other.differs == Differs::InTorque)
    }
}

/// No change of a plant's coordinates.
const HERE: [f64; MOST_STATES] = [0.0; MOST_STATES];

fn block_width(blocks: &[Block]) -> usize {
    blocks.first().map_or(1, |block| block.of_state.width())
}

/// The product of a row with the first coordinates of a state.
fn dot_within(row: &[(usize, f64)], state: &[f64]) -> f64 {
    let end = row.partition_point(|(i, _)| *i < state.len());
    dot(&row[..end], state)
}
