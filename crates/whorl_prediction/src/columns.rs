//! How the estimates and innovations of a filter change with its state at an earlier instant and with the parameters of its model, through
//! the same gains (METHOD.md, "Sensitivities").

use whorl_dynamics::plant::{Acts, LinearisedPlant, Plant, ROTATION};
use whorl_math::lanes::{MOST_STATES, dot};
use whorl_recording::Channel;

use crate::blocks::Blocks;
use crate::gains::Gains;
use crate::innovations::Mean;
use crate::other::{Does, Other};
use crate::perturbed::Differs;
use crate::rows::Readings;
use crate::{Laws, Layout, PredictionError, Prepared, Push, Varied};

/// Steps up to this share of the time of the fastest motion may be taken with what a parameter does at their start: the motion turns
/// what it does by as many radians meanwhile.
const SHORT_STEP: f64 = 0.05;
/// The same with what it does in their middle: by the midpoint rule a twenty-fourth of its square is lost, a hundredth.
const LONG_STEP: f64 = 0.5;

/// Columns of sensitivities: those of the state at the beginning, one for each parameter, then one for the size of each law.
pub(crate) struct Columns<'a> {
    others: Vec<Other<'a>>,
    laws: Option<&'a Laws<'a>>,
    /// What laws do over the present step; room for what they do at its end.
    pushes: Vec<Push>,
    now: Vec<Push>,
    /// The filter's own model, which takes the steps that the others take, and how it acts over the present step, if nothing comes within it; with how it
    /// acts at its end, or room for that.
    own: Option<(Other<'a>, Acts)>,
    is_steady: bool,
    step_s: f64,
    pub blocks: Blocks,
    /// Columns that took a step of their own, one after the other.
    stepped: Vec<f64>,
    varied: Readings,
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
        let others = varied.iter().map(|Varied { model, step }| Other::new(case, model, *step));
        let others = others.collect::<Result<Vec<_>, _>>()?;
        let mut columns = Self::of_state(layout, of_start, varied.len(), laws);
        if !others.is_empty() || laws.is_some() {
            let mut own = Other::new(case, &case.given, 1.0)?;
            own.plant = own.plant.for_differences(others.iter().any(|other| other.behind.is_some()));
            let at_end = own.acts.clone();
            columns.own = Some((own, at_end));
        }
        columns.others = others;
        Ok(columns)
    }

    /// From now on; of so many parameters, which do nothing yet.
    pub fn of_state(layout: Layout, of_start: bool, varied: usize, laws: Option<&'a Laws<'a>>) -> Self {
        let (count, apart) = laws.map_or((0, 0), |laws| (laws.count, laws.apart));
        Self {
            others: Vec::new(),
            laws,
            pushes: Vec::new(),
            now: Vec::new(),
            own: None,
            is_steady: false,
            step_s: 0.0,
            blocks: Blocks::new(layout, of_start, varied, count, apart),
            stepped: Vec::new(),
            varied: Readings::default(),
        }
    }

    /// Before a step that ends at an instant, on the way to that of the next readings: how every varied model acts in the filter's state, or where more happens within the step
    /// than that shows, the model in the state that the filter would have with it.
    pub fn set_out(&mut self, mean: &Mean<'_>, end_ns: i64, instant_ns: i64) {
        let (case, plant) = (mean.case, &mean.plant);
        let (n, first) = (mean.layout.plant.size(), self.blocks.states);
        let Self { others, laws, pushes, own, blocks, stepped, .. } = self;
        let Some((own, at_middle)) = own else { return };
        own.plant.take_motion_of(plant, &[]);
        let step_s = (end_ns - plant.now_ns()) as f64 * 1e-9;
        let radians = step_s * case.fastest_1_s;
        let is_steady = own.is_steady_until(case, end_ns);
        // Gimbals turn within steps, and everything with them: all models make the step.
        let has_gimbals = !plant.gyrostat().model().gyros().is_empty();
        let is_simple = radians <= LONG_STEP && is_steady;
        (self.step_s, self.is_steady) = (step_s, is_simple);
        // Where inputs change within a short step a torque is what it is under their means.
        let over = (radians <= SHORT_STEP && !is_steady && !has_gimbals)
            .then(|| case.commands.mean_between(plant.now_ns() as f64 * 1e-9, end_ns as f64 * 1e-9));
        let is_long = is_simple && radians > SHORT_STEP && !has_gimbals;
        if is_long {
            own.plant.act_into(at_middle);
            let mut half = rates_of(at_middle, plant);
            half.iter_mut().for_each(|x| *x *= 0.5 * step_s);
            own.plant.change_state(&half[..n]);
        }
        if is_simple {
            own.plant.act_into(&mut own.acts);
        }
        if let Some(laws) = laws {
            laws.at(&own.plant, pushes);
        }
        let jets_rest = is_simple && own.plant.jets_rest();
        // The bearing's own stop is as stiff as the body is heavy: while it touches, inertia is no torque alone.
        let is_free = (is_simple || over.is_some()) && !plant.touching()[0];
        let any_torque = is_free && others.iter().any(|other| other.differs == Differs::InTorque);
        let environment = any_torque.then(|| match &over {
            Some(over) => own.plant.environment_over(over),
            None => own.plant.environment(),
        });
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
                other.take_motion_of(&own.plant, &[], instant_ns);
                if other.is_steady_until(case, end_ns) && other.plant.holds_wheels_of(&own.plant) {
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
            own.plant.take_motion_of(plant, &[]);
        }
    }

    /// Behind a step of the plant, over which errors moved as the gains have found. False where a motion is lost.
    pub fn follow(&mut self, case: &Prepared<'_>, plant: &Plant, gains: &Gains) -> bool {
        let (transition, linearised) = (&gains.step.transition, &gains.linearised);
        let (first, n) = (self.blocks.states, plant.tangent().size());
        let Self { others, own, blocks, stepped, step_s, .. } = self;
        stepped.clear();
        if let Some((own, _)) = own {
            if !own.run_to(case, plant.now_ns()) {
                return false;
            }
            blocks.rest();
            for (column, push) in (first + others.len()..).zip(&self.pushes) {
                push.add_rates(plant, linearised, 0.5 * *step_s, &mut |i, rate| blocks.push(column, i, rate));
            }
            for (column, other) in (first..).zip(others.iter_mut()) {
                let share = 0.5 * *step_s / other.step;
                match other.does {
                    Does::Act if self.is_steady => {
                        for (i, (of, less)) in other.acts.rates.iter().zip(&own.acts.rates).enumerate() {
                            blocks.push(column, i, share * (of - less));
                        }
                        other.plant.wait_until(plant.now_ns(), &other.acts);
                    }
                    Does::Push => {
                        let mut add = |i, rate| blocks.push(column, i, rate);
                        other
                            .pushes
                            .iter()
                            .for_each(|push| push.add_rates(plant, linearised, share, &mut add));
                    }
                    Does::TheSame if self.is_steady && other.differs == Differs::InJets => {
                        other.plant.wait_until(plant.now_ns(), &own.acts);
                    }
                    Does::Step => {
                        if !other.run_to(case, plant.now_ns()) {
                            return false;
                        }
                        if let Some(behind) = &mut other.behind {
                            *behind = other.plant.behind_filter_less(&own.plant);
                        }
                        // Where one sticks and the other slips the difference says nothing of a small one.
                        let is_alike = other.plant.is_on_branch_of(&own.plant);
                        // The plants know better than derivatives that are held how a state moves on; disturbances they have in
                        // common.
                        let mut moved = [0.0; MOST_STATES];
                        other.plant.motion_less(own.plant.state(), &mut moved[..n]);
                        let before = |i: usize| blocks.at(i, column);
                        for (i, row) in transition.rows().enumerate() {
                            let of_rest = row.iter().filter(|(k, _)| *k >= n || !is_alike || i >= n);
                            let through: f64 = of_rest.map(|(k, by)| by * before(*k)).sum();
                            let by_itself = if is_alike && i < n { moved[i] / other.step } else { before(i) };
                            stepped.push(by_itself + through);
                        }
                    }
                    _ => {}
                }
            }
        }
        blocks.carry(transition);
        let others = (first..).zip(&*others).filter(|(_, other)| other.does == Does::Step);
        for ((column, _), moved) in others.zip(stepped.chunks_exact(transition.count().max(1))) {
            moved.iter().enumerate().for_each(|(i, x)| *blocks.at_mut(i, column) = *x);
        }
        if let Some(axis) = &gains.unseen_axis {
            blocks.level(axis);
        }
        true
    }

    /// How each reading in the filter's state changes with the parameters where the state does not.
    pub fn read(&mut self, mean: &Mean<'_>, linearised: &LinearisedPlant, readings: &Readings) {
        let (plant, first) = (&mean.plant, self.blocks.states);
        let Self { others, own, blocks, pushes, now, varied, .. } = self;
        blocks.clear_readings(readings.rows.len());
        let read_pushes = |column: usize, pushes: &[Push], step: f64, blocks: &mut Blocks| {
            for (r, row) in readings.rows.iter().enumerate() {
                let of = |push: &Push| push.of_reading(plant, linearised, row, readings.by_state.row(r));
                *blocks.reading(r, column) = pushes.iter().map(of).sum::<f64>() / step;
            }
        };
        // What a sensor adds it adds to what it reads now; of a torque, what it was over the step.
        if let Some(laws) = self.laws {
            if pushes.is_empty() || !pushes.iter().all(Push::is_torque) {
                laws.at(plant, now);
                let over_step = now.iter_mut().zip(&*pushes).filter(|(_, of_step)| of_step.is_torque());
                over_step.for_each(|(push, of_step)| *push = *of_step);
                std::mem::swap(now, pushes);
            }
            for (column, push) in (first + others.len()..).zip(&*pushes) {
                read_pushes(column, std::slice::from_ref(push), 1.0, blocks);
            }
        }
        let Some((own, at_end)) = own else { return };
        // What differs in readings alone shows in the state as it is now, and so does what is read later.
        let is_late = |other: &Other<'_>| other.late_s != [0.0; 2];
        let mut rates = [0.0; MOST_STATES];
        if others.iter().any(|other| other.differs == Differs::InReadings || is_late(other)) {
            own.plant.take_motion_of(plant, &[]);
            own.plant.act_into(at_end);
            rates = rates_of(at_end, plant);
        }
        for (column, other) in (first..).zip(others) {
            let reads_later = match other.does {
                _ if other.turns_vectors => None,
                Does::Act if self.is_steady => Some(own.acts.imu - other.acts.imu),
                Does::Push => {
                    read_pushes(column, &other.pushes, other.step, blocks);
                    continue;
                }
                Does::TheSame if other.differs == Differs::InReadings => {
                    Some(at_end.imu - other.plant.imu_of(&own.plant, at_end))
                }
                Does::TheSame => continue,
                Does::Act | Does::Step => None,
            };
            if reads_later.is_none() {
                other.take_motion_of(plant, &[], plant.now_ns());
                if !other.plant.is_on_branch_of(plant) {
                    continue;
                }
                mean.read_of(&other.plant, &mean.beside, None, varied);
            }
            let late_s = other.late_s;
            for (r, row) in readings.rows.iter().enumerate() {
                let (at, late_s) = match row.component.channel {
                    Channel::Gyro => (Some(row.component.index()), late_s[0]),
                    Channel::Accelerometer => (Some(3 + row.component.index()), late_s[1]),
                    _ => (None, 0.0),
                };
                let less = match (&reads_later, at) {
                    (Some(less), Some(at)) => less[at],
                    (Some(_), None) => continue,
                    (None, _) => varied.rows[r].value - row.last,
                };
                let moves = if late_s == 0.0 { 0.0 } else { dot(readings.by_state.row(r), &rates) * late_s };
                *blocks.reading(r, column) = (less + moves) / other.step;
            }
        }
    }
}

/// How fast the coordinates of a plant move that acts so \[unit/s\].
fn rates_of(acts: &Acts, plant: &Plant) -> [f64; MOST_STATES] {
    let mut rates = [0.0; MOST_STATES];
    rates.iter_mut().zip(&acts.rates).for_each(|(to, rate)| *to = *rate);
    rates[ROTATION].copy_from_slice(plant.state().omega_wb_b_rad_s.as_slice());
    rates
}
