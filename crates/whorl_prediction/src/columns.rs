//! How the estimates and innovations of a filter change with the parameters of its model, through the same gains.
//!
//! For each parameter another plant begins every step in the filter's own state, with the model a little further along the
//! parameter: what it does otherwise is what drives the column, whatever the effect is. See METHOD.md, "Sensitivities".

use nalgebra::{DMatrix, DVector};
use whorl_dynamics::Plant;
use whorl_dynamics::plant::{Acts, LinearisedPlant};
use whorl_recording::Channel;

use crate::design::Design;
use crate::error::PredictionError;
use crate::heading::UnseenHeading;
use crate::information::Information;
use crate::laws::{Laws, Push};
use crate::layout::Layout;
use crate::other::{Differs, Does, Other, Varied};
use crate::prepared::{OtherModel, Prepared};
use crate::rows::{Row, Taken};
use crate::sums::Sums;
use crate::transition::add_product_transposed;

/// Steps up to this share of the time of the fastest motion may be taken with what a parameter does at their start: the motion turns
/// what it does by as many radians meanwhile.
const SHORT_STEP: f64 = 0.05;

/// Columns of sensitivities, one for each parameter, then one for the size of each law.
#[derive(Clone)]
pub(crate) struct Columns<'a> {
    others: Vec<Other<'a>>,
    /// What has no parameter, behind the others,
    laws: Option<&'a Laws<'a>>,
    /// and what it does over the present step.
    pushes: Vec<Push>,
    /// The filter's own model, which takes the steps that the others take.
    reference: OtherModel<'a>,
    /// Where the filter's plant was before the step, where readings are taken to be late.
    before: Option<Plant>,
    /// How the reference acts over the present step, if that is short.
    acts: Option<Acts>,
    /// Of the filter's estimate, parameters by coordinates of the layout, per unit: numbers of a coordinate lie side by side.
    of_state: DMatrix<f64>,
    /// Of the estimate of the start, the same way.
    of_start: DMatrix<f64>,
    /// What is added over half of a step, and the moving part of `of_state` behind it: made at every step in the same place.
    half: DMatrix<f64>,
    behind: DMatrix<f64>,
    /// Sum of d d^T / S over all innovations e with d = de/dtheta: the information on the parameters.
    information: Information,
    /// Sum of d e / S.
    slope: DVector<f64>,
    /// How fast the filter's state moved over the last step, coordinates of the plant per second.
    rates: DVector<f64>,
    /// d of the innovations of the present instant, a column each in their order.
    latest: DMatrix<f64>,
    /// d of all innovations, if they are kept.
    design: Option<Design>,
}

impl<'a> Columns<'a> {
    /// For a filter that has not begun.
    pub fn new(
        case: &Prepared<'a>,
        layout: Layout,
        varied: &[Varied],
        laws: Option<&'a Laws<'a>>,
    ) -> Result<Self, PredictionError> {
        let (size, moving) = (layout.size(), layout.moving());
        let n = varied.len() + laws.map_or(0, Laws::count);
        let others: Vec<Other<'a>> =
            varied.iter().map(|varied| Other::new(case, varied)).collect::<Result<_, _>>()?;
        let mut reference = case.varied(case.given_model())?;
        reference.plant = reference.plant.for_differences(others.iter().any(|other| other.behind.is_some()));
        Ok(Self {
            others,
            laws,
            pushes: Vec::new(),
            reference,
            before: None,
            acts: None,
            of_state: DMatrix::zeros(n, size),
            of_start: DMatrix::zeros(n, size),
            half: DMatrix::zeros(n, case.plant().tangent().size()),
            behind: DMatrix::zeros(n, moving),
            information: Information::new(varied.len(), n - varied.len(), laws.map_or(0, Laws::apart)),
            slope: DVector::zeros(n),
            rates: DVector::zeros(case.plant().tangent().size()),
            latest: DMatrix::zeros(n, 0),
            design: None,
        })
    }

    /// The same, which keeps how all innovations change.
    pub fn keeping(mut self, design: Option<Design>) -> Self {
        self.design = design;
        self
    }

    /// The sums over all innovations so far, and how each changes if that was kept.
    pub fn sums(self) -> (Sums, Option<Design>) {
        let sums = Sums {
            information: self.information.sum(),
            slope: -self.slope,
            of_start: self.of_start.transpose(),
        };
        (sums, self.design)
    }

    /// Before a step that ends at an instant, on the way to that of the next readings: how every varied model acts in the filter's state, or where more happens within the step
    /// than that shows, the model in the state that the filter would have with it.
    pub fn set_out(&mut self, case: &Prepared<'_>, plant: &Plant, end_ns: i64, instant_ns: i64) {
        let n = self.rates.len();
        if let Some(laws) = self.laws {
            laws.at(plant, &mut self.pushes);
        }
        self.reference.plant.take_motion_of(plant, &[]);
        let step_s = (end_ns - plant.now_ns()) as f64 * 1e-9;
        let is_simple =
            step_s * case.fastest_1_s() <= SHORT_STEP && self.reference.is_steady_until(case, end_ns);
        self.acts = is_simple.then(|| self.reference.plant.acts());
        self.before = self.others.iter().any(Other::is_late).then(|| plant.clone());
        let jets_rest = is_simple && self.reference.plant.jets_rest();
        for (other, row) in self.others.iter_mut().zip(self.of_state.row_iter()) {
            other.does = Does::TheSame;
            if other.differs == Differs::InReadings {
                continue;
            }
            if is_simple && other.differs != Differs::WithinSteps {
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
            let moved = row.columns(0, n).transpose() * other.step;
            other.take_motion_of(plant, moved.as_slice(), instant_ns);
            other.does = Does::Step;
        }
    }

    /// Behind a step of the plant, over which errors moved by this transition. False where a motion is lost.
    pub fn follow(
        &mut self,
        case: &Prepared<'_>,
        plant: &Plant,
        linearised: &LinearisedPlant,
        transition: &DMatrix<f64>,
        heading: UnseenHeading,
    ) -> bool {
        let (m, n) = (transition.nrows(), self.rates.len());
        let step_s = (plant.now_ns() - self.reference.plant.now_ns()) as f64 * 1e-9;
        if !self.reference.run_to(case, plant.now_ns()) {
            return false;
        }
        let reference = &self.reference.plant;
        // Half of what a model does goes through the whole step: s <- F (s + h/2 r) + h/2 r.
        self.half.fill(0.0);
        for (k, push) in self.pushes.iter().enumerate() {
            let rates = push.rates(plant, linearised);
            self.half.row_mut(self.others.len() + k).tr_copy_from(&(rates * (0.5 * step_s)));
        }
        for (other, mut row) in self.others.iter_mut().zip(self.half.row_iter_mut()) {
            let Some(of_reference) = &self.acts else { break };
            match other.does {
                Does::Act => {
                    let share = 0.5 * step_s / other.step;
                    let pairs = other.acts.rates.iter().zip(&of_reference.rates);
                    row.iter_mut().zip(pairs).for_each(|(slot, (own, of))| *slot = share * (own - of));
                    other.with.plant.wait_until(plant.now_ns(), &other.acts);
                }
                Does::TheSame if other.differs == Differs::InJets => {
                    other.with.plant.wait_until(plant.now_ns(), of_reference);
                }
                Does::TheSame | Does::Step => {}
            }
        }
        let mut stepped = Vec::new();
        for (k, other) in self.others.iter_mut().enumerate().filter(|(_, other)| other.does == Does::Step) {
            if !other.with.run_to(case, plant.now_ns()) {
                return false;
            }
            if let Some(behind) = &mut other.behind {
                *behind = other.with.plant.behind_filter_less(reference);
            }
            let before = self.of_state.row(k).columns(0, m).transpose();
            let mut moved: DVector<f64> = transition.columns(n, m - n) * before.rows(n, m - n);
            // Where one sticks and the other slips the difference says nothing of a small one.
            let of_plant = if other.with.plant.is_on_branch_of(reference) {
                // The plants know better than derivatives that are held how a state moves on; disturbances they have in
                // common.
                other.with.plant.motion_less(reference) / other.step
            } else {
                transition.view((0, 0), (n, n)) * before.rows(0, n)
            };
            moved.rows_mut(0, n).axpy(1.0, &of_plant, 1.0);
            heading.out_of_change(&mut moved, plant);
            stepped.push((k, moved));
        }
        let mut from_now = self.of_state.columns_mut(0, n);
        from_now += &self.half;
        self.behind.columns_mut(0, n).copy_from(&self.half);
        self.behind.columns_mut(n, m - n).fill(0.0);
        add_product_transposed(&mut self.behind, &self.of_state, transition);
        for (k, moved) in stepped {
            self.behind.row_mut(k).tr_copy_from(&moved);
        }
        self.of_state.columns_mut(0, m).copy_from(&self.behind);
        if let Some(before) = &self.before {
            let step_s = (plant.now_ns() - before.now_ns()) as f64 * 1e-9;
            self.rates = plant.motion_less(before) / step_s;
        }
        true
    }

    /// A wheel that its friction holds stands whatever the parameters are.
    pub fn hold(&mut self, coordinate: usize) {
        self.of_state.column_mut(coordinate).fill(0.0);
    }

    /// How each of these readings in a state changes with the parameters where the state does not: parameters by readings. `read` is
    /// what other models read there.
    pub fn of_readings(
        &mut self,
        plant: &Plant,
        linearised: &LinearisedPlant,
        rows: &[Row],
        read: &dyn Fn(&Plant) -> Vec<Row>,
    ) -> DMatrix<f64> {
        let n = self.rates.len();
        let here = vec![0.0; n];
        // What differs in readings alone shows in the state as it is now.
        let now = self.others.iter().any(|other| other.differs == Differs::InReadings).then(|| {
            self.reference.plant.take_motion_of(plant, &[]);
            self.reference.plant.acts()
        });
        let mut found = DMatrix::zeros(self.count(), rows.len());
        // What a sensor adds it adds to what it reads now; of a torque, what it was over the step.
        let mut pushes = self.pushes.clone();
        if let Some(laws) = self.laws.filter(|_| pushes.is_empty() || !pushes.iter().all(Push::is_torque)) {
            laws.at(plant, &mut pushes);
            let over_step = pushes.iter_mut().zip(&self.pushes).filter(|(_, of_step)| of_step.is_torque());
            over_step.for_each(|(push, of_step)| *push = *of_step);
        }
        for (k, push) in pushes.iter().enumerate() {
            for (row, slot) in rows.iter().zip(found.row_mut(self.others.len() + k).iter_mut()) {
                *slot = push.of_reading(plant, linearised, row);
            }
        }
        for (other, mut slots) in self.others.iter_mut().zip(found.row_iter_mut()) {
            let moves = |row: &Row, late_s: f64| {
                if late_s == 0.0 { 0.0 } else { row.by_state.rows(0, n).dot(&self.rates) * late_s }
            };
            let reads_later = match (other.does, &self.acts, &now) {
                _ if other.turns_vectors => None,
                (Does::Act, Some(of_reference), _) => Some(of_reference.imu - other.acts.imu),
                (Does::TheSame, _, Some(now)) if other.differs == Differs::InReadings => {
                    Some(now.imu - other.with.plant.imu_of(&self.reference.plant, now))
                }
                (Does::TheSame, ..) => continue,
                _ => None,
            };
            if let Some(less) = reads_later {
                for (slot, row) in slots.iter_mut().zip(rows) {
                    let (at, late_s) = match row.component.channel {
                        Channel::Gyro => (row.component.index(), other.late_s[0]),
                        Channel::Accelerometer => (3 + row.component.index(), other.late_s[1]),
                        _ => continue,
                    };
                    *slot = (less[at] + moves(row, late_s)) / other.step;
                }
                continue;
            }
            other.take_motion_of(plant, &here, plant.now_ns());
            if !other.with.plant.is_on_branch_of(plant) {
                continue;
            }
            let varied = read(&other.with.plant);
            for ((slot, row), varied) in slots.iter_mut().zip(rows).zip(&varied) {
                let late_s = match row.component.channel {
                    Channel::Gyro => other.late_s[0],
                    Channel::Accelerometer => other.late_s[1],
                    _ => 0.0,
                };
                *slot = (varied.value - row.value + moves(row, late_s)) / other.step;
            }
        }
        found
    }

    /// Takes in the readings of an instant; `direct` is how they change with the parameters where the state does not, parameters by
    /// readings.
    pub fn take_in(&mut self, rows: &[Row], direct: DMatrix<f64>, taken: &Taken) {
        let by_state = DMatrix::from_fn(self.of_state.ncols(), rows.len(), |i, k| rows[k].by_state[i]);
        let mut d = direct;
        d.gemm(-1.0, &self.of_state, &by_state, 1.0);
        // What the readings before it of the same instant have changed already.
        for k in 1..rows.len() {
            let (before, mut own) = d.columns_range_pair_mut(..k, k);
            for (q, before) in before.column_iter().enumerate() {
                let share = by_state.column(k).dot(&taken.gains.column(q));
                if share != 0.0 {
                    own.axpy(-share, &before, 1.0);
                }
            }
        }
        for (k, (value, variance)) in taken.values.iter().zip(&taken.variances).enumerate() {
            let d = d.column(k);
            self.information.add(d.as_view(), *variance);
            self.slope.axpy(value / variance, &d, 1.0);
            if let Some(design) = &mut self.design {
                design.push(d.as_view(), variance.sqrt());
            }
        }
        self.of_state.gemm(1.0, &d, &taken.gains.transpose(), 1.0);
        if let Some(of_start) = &taken.of_start {
            self.of_start.gemm(1.0, &d, &of_start.transpose(), 1.0);
        }
        self.latest = d;
    }

    /// The changes of the innovations of the present instant.
    pub fn latest(&self) -> &DMatrix<f64> {
        &self.latest
    }

    /// How many parameters and laws there are.
    pub fn count(&self) -> usize {
        self.others.len() + self.laws.map_or(0, Laws::count)
    }

    /// Whether derivatives by a torque are needed.
    pub fn has_laws(&self) -> bool {
        self.laws.is_some()
    }
}
