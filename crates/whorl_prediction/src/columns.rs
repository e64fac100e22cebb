//! How the estimates and innovations of a filter change with its state at an earlier instant and with the parameters of its model, through
//! the same gains (METHOD.md, "Sensitivities").

use whorl_dynamics::plant::{Acts, LinearisedPlant, MeanInputs, Plant, RATE, ROTATION};
use whorl_math::lanes::{MOST_STATES, dot};
use whorl_recording::Channel;

use crate::blocks::Blocks;
use crate::commands::Inputs;
use crate::gains::Gains;
use crate::innovations::Mean;
use crate::other::{Does, Other};
use crate::perturbed::Differs;
use crate::rows::Readings;
use crate::within::Responses;
use crate::{Laws, Layout, PredictionError, Prepared, Push, Varied};

/// Steps up to this share of the time of the fastest motion may be taken with what a parameter does in their middle, where inputs are their means: the
/// motion turns what it does by as many radians meanwhile, of which the midpoint rule loses a twenty-fourth of the square, a hundredth.
const LONGEST_STEP: f64 = 0.5;

/// Columns of sensitivities: those of the state at the beginning, one for each parameter, then one for the size of each law.
pub(crate) struct Columns<'a> {
    others: Vec<Other<'a>>,
    laws: Option<&'a Laws<'a>>,
    /// What laws do over the present step; room for what they do at its end.
    pushes: Vec<Push>,
    now: Vec<Push>,
    /// The filter's own model: as it acts over the present step, with how it acts at its end, or room for that; and as it makes the step beside others.
    own: Option<(Other<'a>, Acts)>,
    stepping: Option<Other<'a>>,
    /// The mean inputs under which those act that need not make the present step; none: all make it.
    inputs: Option<MeanInputs>,
    /// By how much more inputs come in the first half of the step than in the second, in mean inputs; what inputs do to each column.
    early: Option<Inputs>,
    pub responses: Responses,
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
            let mut stepping = Other::new(case, &case.given, 1.0)?;
            stepping.plant =
                stepping.plant.for_differences(others.iter().any(|other| other.behind.is_some()));
            let own = Other::new(case, &case.given, 1.0)?;
            let at_end = own.acts.clone();
            columns.blocks.of_cells = !case.cell_ends_ns.is_empty();
            (columns.own, columns.stepping) = (Some((own, at_end)), Some(stepping));
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
            stepping: None,
            inputs: None,
            early: None,
            responses: Responses::default(),
            step_s: 0.0,
            blocks: Blocks::new(layout, of_start, varied, count, apart),
            stepped: Vec::new(),
            varied: Readings::default(),
        }
    }

    /// Before a step that ends at an instant, on the way to that of the next readings: how every varied model acts in the filter's state under the step's mean
    /// inputs, or where more happens within the step than that shows, the model in the state that the filter would have with it.
    pub fn set_out(&mut self, mean: &Mean<'_>, end_ns: i64, instant_ns: i64) {
        let (case, plant) = (mean.case, &mean.plant);
        let (n, first) = (mean.layout.plant.size(), self.blocks.states);
        let Self { others, laws, pushes, own, stepping, blocks, stepped, responses, .. } = self;
        let Some(((own, at_middle), stepping)) = own.as_mut().zip(stepping.as_mut()) else { return };
        responses.ask(case, plant, (own, others), *laws, mean.event);
        let step_s = (end_ns - plant.now_ns()) as f64 * 1e-9;
        // Gimbals turn within steps, and thrust that lags, and everything with them: all models make the step.
        let of = plant.gyrostat();
        let is_simple = step_s * case.fastest_1_s <= LONGEST_STEP
            && of.model().gyros().is_empty()
            && of.thrust_lag().is_none();
        self.step_s = step_s;
        own.stand_in_for(plant, &[], mean.event, instant_ns);
        own.hear(case);
        let moments = is_simple.then(|| own.inputs_until(case, end_ns));
        self.inputs = moments.map(|[mean, _]| mean);
        self.early = moments.filter(|[mean, early]| mean != early).map(|[mean, early]| {
            let (mean, early) = (mean.numbers(), early.numbers());
            std::array::from_fn(|i| early[i] - mean[i])
        });
        let mut may_stick = false;
        if let Some(inputs) = &self.inputs {
            own.plant.drive_by(inputs);
            own.plant.act_into(at_middle);
            may_stick = comes_to_rest(plant, at_middle, step_s);
            let mut half = rates_of(at_middle, plant);
            half.iter_mut().for_each(|x| *x *= 0.5 * step_s);
            own.plant.change_state(&half[..n]);
            own.plant.act_into(&mut own.acts);
        }
        if let Some(laws) = laws {
            laws.at(&own.plant, pushes);
        }
        let jets_rest = is_simple && own.plant.jets_rest();
        // The bearing's own stop is as stiff as the body is heavy: while it touches, inertia is no torque alone.
        let is_free = is_simple && !plant.touching()[0];
        let any_torque = is_free && others.iter().any(|other| other.differs == Differs::InTorque);
        let environment = any_torque.then(|| own.plant.environment());
        let wheels = plant.tangent().wheels().len();
        let mut any_steps = false;
        for (k, other) in others.iter_mut().enumerate() {
            other.does = Does::TheSame;
            if other.differs == Differs::InReadings {
                continue;
            }
            if let Some(environment) = environment.as_ref().filter(|_| other.differs == Differs::InTorque) {
                other.push(environment, wheels);
                continue;
            }
            if let Some(inputs) = &self.inputs
                && !matches!(other.differs, Differs::WithinSteps | Differs::InTorque)
            {
                if jets_rest && other.differs == Differs::InJets {
                    continue;
                }
                if !may_stick {
                    // Everything else that drives it is as it drives the filter's model.
                    other.stand_in_for(&own.plant, &[], mean.event, instant_ns);
                    let told = other.is_told_otherwise().then(|| other.inputs_until(case, end_ns));
                    other.plant.drive_by(told.as_ref().map_or(inputs, |[mean, _]| mean));
                    other.plant.act_into(&mut other.acts);
                    other.does = Does::Act;
                    continue;
                }
            }
            stepped.clear();
            stepped.extend((0..n).map(|i| blocks.at(i, first + k) * other.step));
            other.stand_in_for(plant, stepped, mean.event, instant_ns);
            if other.differs != Differs::WithinSteps {
                other.plant.add_gas_kg(stepping.plant.gas_kg() - own.plant.gas_kg());
            }
            (other.does, any_steps) = (Does::Step, true);
        }
        if any_steps {
            stepping.stand_in_for(plant, &[], mean.event, instant_ns);
        }
    }

    /// Behind a step of the plant, over which errors moved as the gains have found. False where a motion is lost.
    pub fn follow(&mut self, case: &Prepared<'_>, plant: &Plant, gains: &Gains) -> bool {
        let (transition, linearised) = (&gains.step.transition, &gains.linearised);
        let (first, n) = (self.blocks.states, plant.tangent().size());
        let Self { others, own, stepping, blocks, stepped, step_s, early, responses, .. } = self;
        stepped.clear();
        if let Some(((own, _), stepping)) = own.as_mut().zip(stepping.as_mut()) {
            let any_steps = others.iter().any(|other| other.does == Does::Step);
            if any_steps && !stepping.run_to(case, plant.now_ns()) {
                return false;
            }
            // Where gimbals turn it stands in for nobody and goes its own way.
            if own.differs == Differs::WithinSteps && !own.run_to(case, plant.now_ns()) {
                return false;
            }
            // How much gas is left differs by what a parameter does, and not by how a step was made.
            if self.inputs.is_some() {
                own.plant.wait_until(plant.now_ns(), &own.acts);
            } else if own.differs != Differs::WithinSteps {
                own.plant.add_gas_kg(stepping.plant.gas_kg() - own.plant.gas_kg());
            }
            blocks.rest();
            for (column, push) in (first + others.len()..).zip(&self.pushes) {
                push.add_rates(plant, linearised, 0.5 * *step_s, &mut |i, rate| blocks.push(column, i, rate));
            }
            for (column, other) in (first..).zip(others.iter_mut()) {
                let share = 0.5 * *step_s / other.step;
                match other.does {
                    Does::Act => {
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
                    Does::TheSame if other.differs == Differs::InJets => {
                        other.plant.wait_until(plant.now_ns(), &own.acts);
                    }
                    Does::Step => {
                        if !other.run_to(case, plant.now_ns()) {
                            return false;
                        }
                        if other.differs != Differs::WithinSteps {
                            other.plant.add_gas_kg(own.plant.gas_kg() - stepping.plant.gas_kg());
                        }
                        if let Some(behind) = &mut other.behind {
                            *behind = other.plant.behind_filter_less(&stepping.plant);
                        }
                        // Where one sticks and the other slips the difference says nothing of a small one.
                        let is_alike = other.plant.is_on_branch_of(&stepping.plant);
                        // Plants know better than derivatives that are held how a state moves on; disturbances they share.
                        let mut moved = [0.0; MOST_STATES];
                        other.plant.motion_less(stepping.plant.state(), &mut moved[..n]);
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
        blocks.carry(transition, *step_s);
        let steps = |column: usize| others.get(column).is_some_and(|other| other.does == Does::Step);
        // What comes early turns the body further, and more of the readings of a cell see it.
        for (column, rates) in early.iter().flat_map(|early| responses.by(early)) {
            if !steps(column) {
                for (k, rate) in rates.iter().enumerate().filter(|(_, rate)| **rate != 0.0) {
                    if k < 3 {
                        *blocks.at_mut(ROTATION.start + k, first + column) += 0.5 * *step_s * *step_s * rate;
                    }
                    if blocks.of_cells && RATE.start + k < n {
                        blocks.add_pushed(first + column, RATE.start + k, -*step_s * rate);
                    }
                }
            }
        }
        let others = (first..).zip(&*others).filter(|(_, other)| other.does == Does::Step);
        for ((column, _), moved) in others.zip(stepped.chunks_exact(transition.count().max(1))) {
            for (i, x) in moved.iter().enumerate() {
                let carried = std::mem::replace(blocks.at_mut(i, column), *x);
                if blocks.of_cells && RATE.start <= i && i < n {
                    blocks.add_pushed(column, i, x - carried);
                }
            }
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
            own.stand_in_for(plant, &[], mean.event, plant.now_ns());
            own.plant.act_into(at_end);
            rates = rates_of(at_end, plant);
        }
        // At the instant of a reading inputs may be others than over the step.
        let inputs = plant.inputs();
        let is_mean = !mean.collected.sums.is_empty() || mean.case.averages_forces();
        let as_over_step = is_mean || self.inputs == Some(inputs);
        for (column, other) in (first..).zip(others) {
            let reads_later = match other.does {
                _ if other.turns_vectors => None,
                Does::Act if as_over_step => Some(own.acts.imu - other.acts.imu),
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
                if other.does == Does::Act {
                    other.plant.drive_by(&inputs);
                }
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

/// Whether a wheel may come to rest, or turn the other way, within a step: its friction jumps there.
fn comes_to_rest(plant: &Plant, acts: &Acts, step_s: f64) -> bool {
    let wheels = plant.gyrostat().model().wheels().iter().zip(plant.state().wheel_speed_rad_s());
    let rates = plant.tangent().wheels().map(|i| acts.rates[i]).zip(plant.held_wheels());
    wheels.zip(rates).any(|((wheel, speed), (rate, held))| {
        !held && wheel.coulomb_friction_n_m > 0.0 && *speed * (speed + 2.0 * rate * step_s) <= 0.0
    })
}

/// How fast the coordinates of a plant move that acts so \[unit/s\].
fn rates_of(acts: &Acts, plant: &Plant) -> [f64; MOST_STATES] {
    let mut rates = [0.0; MOST_STATES];
    rates.iter_mut().zip(&acts.rates).for_each(|(to, rate)| *to = *rate);
    rates[ROTATION].copy_from_slice(plant.state().omega_wb_b_rad_s.as_slice());
    rates
}
