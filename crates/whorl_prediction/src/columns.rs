//! How the estimates and innovations of a filter change with its state at an earlier instant and with the parameters of its model, through
//! the same gains (METHOD.md, "Sensitivities").

use nalgebra::DVector;
use whorl_dynamics::State;
use whorl_dynamics::plant::{Acts, LinearisedPlant, Plant, ROTATION};
use whorl_recording::Channel;

use crate::blocks::Blocks;
use crate::gains::Gains;
use crate::innovations::Mean;
use crate::laws::{Laws, Push, add_rates_by_torque};
use crate::noise::Layout;
use crate::other::{Does, Other, Varied};
use crate::perturbed::Differs;
use crate::prepared::Prepared;
use crate::refusal::PredictionError;
use crate::rows::{Readings, Row};
use whorl_math::lanes::{MOST_STATES, dot};

/// Steps up to this share of the time of the fastest motion may be taken with what a parameter does at their start: the motion turns
/// what it does by as many radians meanwhile.
const SHORT_STEP: f64 = 0.05;
/// The same with what it does in their middle: by the midpoint rule a twenty-fourth of its square is lost, a hundredth.
const LONG_STEP: f64 = 0.5;

/// Columns of sensitivities: those of the state at the beginning, one for each parameter, then one for the size of each law.
pub(crate) struct Columns<'a> {
    /// Behind those of the state, if these are wanted: the first of a parameter.
    first: usize,
    others: Vec<Other<'a>>,
    /// What has no parameter, behind the others,
    laws: Option<&'a Laws<'a>>,
    /// and what it does over the present step; room for what it does at its end.
    pushes: Vec<Push>,
    now: Vec<Push>,
    /// The filter's own model, which takes the steps that the others take, and how it acts over the present step, if nothing comes within it; room for how
    /// it acts at its end.
    reference: Option<Other<'a>>,
    is_steady: bool,
    acts_now: Option<Acts>,
    step_s: f64,
    /// Where the filter's plant was before the step, and when \[ns\], where readings are taken to be late.
    before: Option<(State, i64)>,
    pub blocks: Blocks,
    /// Columns that took a step of their own, one after the other, and room for one of them.
    stepped: Vec<f64>,
    moved: [f64; MOST_STATES],
    varied: Readings,
    /// How fast the filter's state moved over the last step, coordinates of the plant per second.
    rates: DVector<f64>,
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
        let mut columns = Self::of_state(layout, of_start, varied.len(), laws);
        let others = varied.iter().map(|Varied { model, step }| Other::new(case, model, *step));
        columns.others = others.collect::<Result<_, _>>()?;
        if !columns.others.is_empty() || laws.is_some() {
            let mut own = Other::new(case, &case.given, 1.0)?;
            own.plant = own.plant.for_differences(columns.others.iter().any(|other| other.behind.is_some()));
            columns.acts_now = Some(Acts::none(&own.plant));
            columns.reference = Some(own);
        }
        columns.laws = laws;
        Ok(columns)
    }

    pub fn since_now(layout: Layout) -> Self {
        Self::of_state(layout, true, 0, None)
    }

    fn of_state(layout: Layout, of_start: bool, varied: usize, laws: Option<&Laws<'_>>) -> Self {
        let (count, apart) = laws.map_or((0, 0), |laws| (laws.count(), laws.apart()));
        let blocks = Blocks::new(layout, of_start, varied, count, apart);
        Self {
            first: blocks.count().1,
            others: Vec::new(),
            laws: None,
            pushes: Vec::new(),
            now: Vec::new(),
            reference: None,
            is_steady: false,
            acts_now: None,
            step_s: 0.0,
            before: None,
            blocks,
            stepped: Vec::new(),
            moved: HERE,
            varied: Readings::default(),
            rates: DVector::zeros(layout.plant.size()),
        }
    }

    /// Before a step that ends at an instant, on the way to that of the next readings: how every varied model acts in the filter's state, or where more happens within the step
    /// than that shows, the model in the state that the filter would have with it.
    pub fn set_out(&mut self, mean: &Mean<'_>, end_ns: i64, instant_ns: i64) {
        let (case, plant) = (mean.case, &mean.plant);
        let (n, first) = (self.rates.len(), self.first);
        let Self { others, laws, pushes, reference, acts_now, blocks, before, stepped, .. } = self;
        let (Some(reference), Some(acts_now)) = (reference, acts_now) else { return };
        reference.plant.take_motion_of(plant, &[]);
        let step_s = (end_ns - plant.now_ns()) as f64 * 1e-9;
        let radians = step_s * case.fastest_1_s;
        let is_simple = radians <= LONG_STEP && reference.is_steady_until(case, end_ns);
        (self.step_s, self.is_steady) = (step_s, is_simple);
        // Gimbals turn within steps, and everything with them: all models make the step.
        let is_long = is_simple && radians > SHORT_STEP && plant.gyrostat().model().gyros().is_empty();
        if is_long {
            reference.plant.act_into(acts_now);
            let mut half = acts_now.rates.clone_owned() * (0.5 * step_s);
            half.fixed_rows_mut::<3>(ROTATION.start)
                .copy_from(&(plant.state().omega_wb_b_rad_s * (0.5 * step_s)));
            reference.plant.change_state(&half.as_slice()[..n]);
        }
        if is_simple {
            reference.plant.act_into(&mut reference.acts);
        }
        if let Some(laws) = laws {
            laws.at(&reference.plant, pushes);
        }
        *before =
            others.iter().any(|other| other.late_s != [0.0; 2]).then(|| (*plant.state(), plant.now_ns()));
        let jets_rest = is_simple && reference.plant.jets_rest();
        // The bearing's own stop is as stiff as the body is heavy: while it touches, inertia is no torque alone.
        let is_free = is_simple && !plant.touching()[0];
        let any_torque = is_free && others.iter().any(|other| other.differs == Differs::InTorque);
        let environment = any_torque.then(|| reference.plant.environment());
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
                if jets_rest && other.differs == Differs::InJets && other.is_steady_until(case, end_ns) {
                    continue;
                }
                other.take_motion_of(&reference.plant, &[], instant_ns);
                let is_steady = other.is_steady_until(case, end_ns);
                if is_steady && other.plant.holds_wheels_of(&reference.plant) {
                    other.plant.act_into(&mut other.acts);
                    other.does = Does::Act;
                    continue;
                }
            }
            stepped.clear();
            stepped.extend((0..n).map(|i| blocks.at(i, first + k) * other.step));
            if other.differs == Differs::InTorque {
                other.stand_in_for(plant, stepped, mean.event);
            } else {
                other.take_motion_of(plant, stepped, instant_ns);
            }
            other.does = Does::Step;
        }
        if is_long {
            reference.plant.take_motion_of(plant, &[]);
        }
    }

    /// Behind a step of the plant, over which errors moved as the gains have found. False where a motion is lost.
    pub fn follow(&mut self, case: &Prepared<'_>, plant: &Plant, gains: &Gains<'_>) -> bool {
        let (transition, axis) = (&gains.step.transition, gains.unseen_axis.as_ref());
        let (first, n) = (self.first, self.rates.len());
        self.stepped.clear();
        let (step_s, is_steady) = (self.step_s, self.is_steady);
        if let Some(reference) = &mut self.reference {
            if !reference.run_to(case, plant.now_ns()) {
                return false;
            }
            let (reference, of_reference) = (&reference.plant, &reference.acts);
            self.blocks.rest();
            for (k, push) in self.pushes.iter().enumerate() {
                let column = first + self.others.len() + k;
                let blocks = &mut self.blocks;
                push.add_rates(plant, &gains.linearised, 0.5 * step_s, &mut |i, rate| {
                    blocks.push(column, i, rate);
                });
            }
            for (k, other) in self.others.iter_mut().enumerate().filter(|_| is_steady) {
                let (column, share) = (first + k, 0.5 * step_s / other.step);
                match other.does {
                    Does::Act => {
                        for (i, (own, of)) in other.acts.rates.iter().zip(&of_reference.rates).enumerate() {
                            self.blocks.push(column, i, share * (own - of));
                        }
                        other.plant.wait_until(plant.now_ns(), &other.acts);
                    }
                    Does::Push => {
                        let blocks = &mut self.blocks;
                        let (body, wheels) = (other.body_n_m * share, other.wheels_n_m.map(|x| x * share));
                        add_rates_by_torque(plant, &gains.linearised, body, &wheels, &mut |i, rate| {
                            blocks.push(column, i, rate);
                        });
                    }
                    Does::TheSame if other.differs == Differs::InJets => {
                        other.plant.wait_until(plant.now_ns(), of_reference);
                    }
                    Does::TheSame | Does::Step => {}
                }
            }
            for (k, other) in self.others.iter_mut().enumerate().filter(|(_, other)| other.does == Does::Step)
            {
                if !other.run_to(case, plant.now_ns()) {
                    return false;
                }
                if let Some(behind) = &mut other.behind {
                    *behind = other.plant.behind_filter_less(reference);
                }
                let before = |i: usize| self.blocks.at(i, first + k);
                // Where one sticks and the other slips the difference says nothing of a small one.
                let is_alike = other.plant.is_on_branch_of(reference);
                // The plants know better than derivatives that are held how a state moves on; disturbances they have in
                // common.
                let moved = &mut self.moved[..n];
                other.plant.motion_less(reference.state(), moved);
                for (i, row) in transition.rows().enumerate() {
                    let of_rest = row.iter().filter(|(k, _)| *k >= n || !is_alike || i >= n);
                    let through: f64 = of_rest.map(|(k, by)| by * before(*k)).sum();
                    let own = if is_alike && i < n { moved[i] / other.step } else { before(i) };
                    self.stepped.push(own + through);
                }
            }
        }
        self.blocks.carry(transition);
        let moving = transition.count();
        let stepped = self.others.iter().enumerate().filter(|(_, other)| other.does == Does::Step);
        for ((k, _), moved) in stepped.zip(self.stepped.chunks_exact(moving.max(1))) {
            moved.iter().enumerate().for_each(|(i, x)| self.blocks.set(i, first + k, *x));
        }
        if let Some(axis) = axis {
            self.blocks.level(axis);
        }
        if let Some((before, before_ns)) = &self.before {
            let step_s = (plant.now_ns() - before_ns) as f64 * 1e-9;
            plant.motion_less(before, self.rates.as_mut_slice());
            self.rates /= step_s;
        }
        true
    }

    /// How each reading in the filter's state changes with the parameters where the state does not.
    pub fn read(&mut self, mean: &Mean<'_>, linearised: &LinearisedPlant, readings: &Readings) {
        let plant = &mean.plant;
        let (n, first) = (self.rates.len(), self.first);
        self.blocks.clear_readings(readings.rows.len());
        // What a sensor adds it adds to what it reads now; of a torque, what it was over the step.
        let mut set = |column: usize, row: usize, x: f64| self.blocks.set_reading(column, row, x);
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
        let (Some(reference), Some(acts_now)) = (&mut self.reference, &mut self.acts_now) else { return };
        // What differs in readings alone shows in the state as it is now.
        if self.others.iter().any(|other| other.differs == Differs::InReadings) {
            reference.plant.take_motion_of(plant, &[]);
            reference.plant.act_into(acts_now);
        }
        for (k, other) in self.others.iter_mut().enumerate() {
            let moves = |r: usize, late_s: f64| {
                let by_state = || dot_within(readings.by_state.row(r), self.rates.as_slice());
                if late_s == 0.0 { 0.0 } else { by_state() * late_s }
            };
            let reads_later = match other.does {
                _ if other.turns_vectors => None,
                Does::Act if self.is_steady => Some(reference.acts.imu - other.acts.imu),
                Does::Push => Some(other.less_by_push(plant, linearised)),
                Does::TheSame if other.differs == Differs::InReadings => {
                    Some(acts_now.imu - other.plant.imu_of(&reference.plant, acts_now))
                }
                Does::TheSame => continue,
                Does::Act | Does::Step => None,
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
            if !other.plant.is_on_branch_of(plant) {
                continue;
            }
            mean.read_of(&other.plant, mean.beside.as_slice(), None, &mut self.varied);
            for (r, (row, varied)) in readings.rows.iter().zip(&self.varied.rows).enumerate() {
                set(first + k, r, (varied.value - row.last + moves(r, late_s(row))) / other.step);
            }
        }
    }

    /// How the innovation of a reading of the present instant changes with parameter by parameter.
    pub fn latest(&self, reading: usize, to: &mut DVector<f64>) {
        for (slot, c) in to.iter_mut().zip(self.first..self.blocks.count().0) {
            *slot = self.blocks.of_innovation(reading, c);
        }
    }

    pub fn count(&self) -> usize {
        self.blocks.count().0 - self.first
    }
}

const HERE: [f64; MOST_STATES] = [0.0; MOST_STATES];

/// The product of a row with the first coordinates of a state.
fn dot_within(row: &[(usize, f64)], state: &[f64]) -> f64 {
    let end = row.partition_point(|(i, _)| *i < state.len());
    dot(&row[..end], state)
}
