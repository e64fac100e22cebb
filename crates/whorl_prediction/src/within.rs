//! What commands do within a cell of readings. A controller answers to readings, so that the noise of the first of a cell moves the others: the mean of them all is
//! no number that is predicted from everything before it. How they differ from their mean makes up for it (METHOD.md, "Means of readings").

use nalgebra::DVector;
use whorl_dynamics::Plant;
use whorl_dynamics::actuators::wheels::MAX_WHEELS;
use whorl_dynamics::plant::{Acts, LinearisedPlant, MeanInputs, RATE};
use whorl_recording::{Channel, Component};

use crate::commands::{Inputs, ns};
use crate::other::Other;
use crate::perturbed::Differs;
use crate::prepared::{Prepared, fastest};
use crate::rows::Collected;
use crate::{Laws, Push};

/// Of a body's rate and of its wheels' speeds.
type Rates = [f64; 3 + MAX_WHEELS];

/// The sensors' number that moves with one of [`Rates`].
fn place(component: Component) -> Option<usize> {
    match component.channel {
        Channel::Gyro => Some(component.index()),
        Channel::WheelSpeed => Some(3 + component.index()),
        _ => None,
    }
}

/// How far a controller may turn what it reads back within a cell \[rad\]: the mean of what its sensor errs by and the motion that this makes then differ by less
/// than a twentieth of it, and [`Within`] makes up for that to first order.
pub(crate) const SHARE_OF_LOOP_RAD: f64 = 0.1;
/// Samples after which a controller answers at most.
const ANSWERS_AFTER: usize = 3;

/// How fast controllers turn back what gyro and tachometers read [1/s]: by how the commands change with the changes of readings, and what commands do.
pub(crate) fn loop_rate_1_s(case: &Prepared<'_>) -> f64 {
    let mut plant = case.plant.clone();
    let (rate, speeds) = fastest(case.recording, case.model.wheels().len());
    // Near their largest speed motors give less.
    let speeds: Vec<f64> = speeds.iter().map(|speed| 0.5 * speed).collect();
    let _ = plant.set_motion(&plant.state().q_world_body.clone(), &rate, &speeds);
    let mut acts = Acts::none(&plant);
    let (inputs, by_input) = by_inputs(case, 1, &mut |inputs| {
        plant.drive_by(inputs);
        plant.act_into(&mut acts);
        vec![std::array::from_fn(|i| acts.rates.get(RATE.start + i).copied().unwrap_or_default())]
    });
    let mut fastest_1_s: f64 = 0.0;
    for track in case.tracks.iter().filter(|track| place(track.components[0]).is_some()) {
        let ends = track.time_s.windows(2);
        let told: Vec<Inputs> =
            ends.map(|ends| case.commands.mean_between(ends[0], ends[1]).numbers()).collect();
        for (component, place) in track.components.iter().filter_map(|of| Some((of, place(*of)?))) {
            let number = |k: usize| track.number(k, component.index());
            let change = |k: usize| Some(number(k)? - number(k.checked_sub(1)?)?);
            let squares: f64 = (1..told.len()).filter_map(change).map(|by| by * by).sum();
            for after in 0..ANSWERS_AFTER {
                let answer = |k: usize| {
                    let more = |input: usize| told[k][input] - told[k - 1][input];
                    let pairs = inputs.iter().zip(by_input.first()?);
                    let pushes = pairs.map(|(input, rates)| more(*input) * rates[place]).sum::<f64>();
                    Some(change(k.checked_sub(after)?)? * pushes)
                };
                let answers: f64 = (1..told.len()).filter_map(answer).sum();
                fastest_1_s = fastest_1_s.max((answers / squares.max(f64::MIN_POSITIVE)).abs());
            }
        }
    }
    fastest_1_s
}

/// How much faster so many columns move by each input of a platform, per unit of it: of how fast they move under inputs, of which motors have what they are
/// told. Of a line that is all, and of anything else statistical linearisation (Gelb, *Applied Optimal Estimation*, 1974, section 6.2) with two values.
fn by_inputs(
    case: &Prepared<'_>,
    columns: usize,
    rates: &mut dyn FnMut(&MeanInputs) -> Vec<Rates>,
) -> (Vec<usize>, Vec<Vec<Rates>>) {
    let (mut inputs, mut by_input) = (Vec::new(), vec![Vec::new(); columns]);
    let mut ranges: Vec<(usize, [f64; 2])> = MeanInputs::ranges(&case.model).collect();
    let told = ranges.iter_mut().zip(case.commands.motors_rms_n_m()).filter(|(_, rms)| *rms > 0.0);
    told.for_each(|((_, range), rms)| *range = [-rms, rms]);
    for (input, range) in ranges {
        let [from, to] = range.map(|x| {
            let mut numbers = [0.0; MeanInputs::COUNT];
            numbers[input] = x;
            rates(&MeanInputs::of_numbers(&numbers))
        });
        for (column, (to, from)) in by_input.iter_mut().zip(to.iter().zip(&from)) {
            column.push(std::array::from_fn(|i| (to[i] - from[i]) / (range[1] - range[0])));
        }
        inputs.push(input);
    }
    (inputs, by_input)
}

/// How readings of cells differ from their means, and what that has to do with the commands meanwhile: sums over a recording.
#[derive(Debug, Clone, Default)]
pub(crate) struct Within {
    of: Vec<OfReading>,
}

#[derive(Debug, Clone)]
struct OfReading {
    component: Component,
    variance: f64,
    numbers: f64,
    squares: f64,
    by_input: Inputs,
}

impl Within {
    pub fn add(&mut self, case: &Prepared<'_>, cell: &Collected) {
        for sum in cell.sums.iter().filter(|sum| sum.count > 1.0) {
            let component = sum.component();
            let Some(variance) = case.variance_within(component).filter(|_| place(component).is_some())
            else {
                continue;
            };
            let position = self.of.iter().position(|of| of.component == component).unwrap_or_else(|| {
                let (squares, by_input) = (0.0, [0.0; MeanInputs::COUNT]);
                self.of.push(OfReading { component, variance, numbers: 0.0, squares, by_input });
                self.of.len() - 1
            });
            let (of, mean) = (&mut self.of[position], sum.value() / sum.count);
            of.numbers += sum.count - 1.0;
            of.squares += sum.squares - mean * sum.value();
            for (to, (with, alone)) in of.by_input.iter_mut().zip(sum.by_input.iter().zip(&sum.inputs)) {
                *to += with - mean * alone;
            }
        }
    }

    /// log p of what readings are more than their means.
    pub fn log(&self) -> f64 {
        let of = |of: &OfReading| {
            of.squares / of.variance + of.numbers * (std::f64::consts::TAU * of.variance).ln()
        };
        -0.5 * self.of.iter().map(of).sum::<f64>()
    }

    /// Its slope by each column that inputs move so.
    pub fn slope(&self, responses: &Responses) -> DVector<f64> {
        let of_column = |of: &Vec<Rates>| {
            let of_reading = |reading: &OfReading| {
                let place = place(reading.component).unwrap_or_default();
                let pairs = of.iter().zip(&responses.inputs);
                pairs.map(|(rates, input)| rates[place] * reading.by_input[*input]).sum::<f64>()
                    / reading.variance
            };
            self.of.iter().map(of_reading).sum::<f64>()
        };
        DVector::from_iterator(responses.sums.len(), responses.sums.iter().map(of_column)) / responses.times
    }
}

/// So often over a run it is asked how columns answer to inputs, as they may do that by the motion.
const ASKED: i64 = 8;

/// How fast body and wheels move by a unit of each input, more than by the filter's model: of each parameter and law, per unit.
#[derive(Debug, Clone, Default)]
pub(crate) struct Responses {
    /// Positions of the inputs that drive the platform, and for each what it does by now; columns that none moves have nothing.
    inputs: Vec<usize>,
    columns: Vec<Vec<Rates>>,
    /// The same summed up over all times at which it was asked.
    sums: Vec<Vec<Rates>>,
    times: f64,
    next_ns: i64,
}

impl Responses {
    /// Asks in the motion of a plant, where it is time. What moves in its own way within a step, or shows in readings alone, has none.
    pub fn ask(
        &mut self,
        case: &Prepared<'_>,
        plant: &Plant,
        (own, others): (&mut Other<'_>, &mut [Other<'_>]),
        laws: Option<&Laws<'_>>,
        event: usize,
    ) {
        let now = plant.now_ns();
        if self.times > 0.0 && now < self.next_ns {
            return;
        }
        self.next_ns = now + ns(case.recording.duration_s()) / ASKED;
        let mut linearised = LinearisedPlant::none(plant);
        plant.linearise_into(&mut linearised, true);
        let (mut acts, mut of_own, mut pushes) = (Acts::none(plant), Acts::none(plant), Vec::new());
        let count = others.len() + laws.map_or(0, |laws| laws.count);
        // Laws with states of their own carry these on by the motion as it is.
        laws.iter().for_each(|laws| laws.at(plant, &mut pushes));
        let (inputs, mut columns) = by_inputs(case, count, &mut |inputs| {
            own.stand_in_for(plant, &[], event, now);
            own.plant.drive_by(inputs);
            own.plant.act_into(&mut of_own);
            let mut all = vec![[0.0; 3 + MAX_WHEELS]; others.len()];
            for (other, more) in others.iter_mut().zip(&mut all) {
                if !matches!(other.differs, Differs::InReadings | Differs::WithinSteps) {
                    other.stand_in_for(plant, &[], event, now);
                    other.plant.drive_by(inputs);
                    other.plant.act_into(&mut acts);
                    let pairs = acts.rates.iter().zip(&of_own.rates).skip(RATE.start);
                    more.iter_mut().zip(pairs).for_each(|(to, (a, b))| *to = (a - b) / other.step);
                }
            }
            if let Some(laws) = laws {
                laws.at(&own.plant, &mut pushes);
            }
            all.extend(pushes.iter().map(|push: &Push| {
                let mut more = [0.0; 3 + MAX_WHEELS];
                // A torque turns nothing at once.
                push.add_rates(plant, &linearised, 1.0, &mut |i, rate| {
                    let to = i.checked_sub(RATE.start).and_then(|i| more.get_mut(i));
                    to.into_iter().for_each(|to| *to += rate);
                });
                more
            }));
            all
        });
        self.sums.resize_with(count, || vec![[0.0; 3 + MAX_WHEELS]; inputs.len()]);
        let pairs = self.sums.iter_mut().flatten().flatten().zip(columns.iter().flatten().flatten());
        pairs.for_each(|(sum, x)| *sum += x);
        columns.iter_mut().filter(|of| of.iter().flatten().all(|x| *x == 0.0)).for_each(Vec::clear);
        (self.inputs, self.columns, self.times) = (inputs, columns, self.times + 1.0);
    }

    /// Whether there are no columns that inputs could move.
    pub fn is_empty(&self) -> bool {
        self.columns.is_empty()
    }

    /// What inputs do that are so much more: columns that they move.
    pub fn by<'a>(&'a self, inputs: &'a Inputs) -> impl Iterator<Item = (usize, Rates)> + 'a {
        let moved = self.columns.iter().enumerate().filter(|(_, of)| !of.is_empty());
        moved.map(|(column, of)| {
            let mut sum = [0.0; 3 + MAX_WHEELS];
            for (rates, input) in of.iter().zip(&self.inputs).filter(|(_, input)| inputs[**input] != 0.0) {
                sum.iter_mut().zip(rates).for_each(|(sum, rate)| *sum += rate * inputs[*input]);
            }
            (column, sum)
        })
    }
}
