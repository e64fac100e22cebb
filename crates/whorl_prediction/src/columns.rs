//! How the estimates and innovations of a filter change with the parameters of its model, through the same gains.
//!
//! For each parameter another plant begins every step in the filter's own state, with the model a little further along the
//! parameter: what it does otherwise is what drives the column, whatever the effect is. See METHOD.md, "Sensitivities".

use nalgebra::{DMatrix, DVector, DVectorView, Vector3};
use whorl_dynamics::plant::Acts;
use whorl_dynamics::{Plant, PlatformModel};
use whorl_recording::Channel;

use crate::error::PredictionError;
use crate::known::KnownBefore;
use crate::prepared::{OtherModel, Prepared};
use crate::rows::Row;

/// Innovations that are added to the information together.
const TOGETHER: usize = 64;

/// A model a little further along a parameter.
#[derive(Debug, Clone)]
pub struct Varied {
    /// The model there.
    pub model: PlatformModel,
    /// How far along the parameter, in its unit.
    pub step: f64,
}

/// A varied model on the way of a filter.
#[derive(Clone)]
struct Other<'a> {
    with: OtherModel<'a>,
    step: f64,
    /// How much later than the filter's model it takes the readings of gyro and accelerometer to be \[s\].
    late_s: [f64; 2],
    /// What is behind the sensors' low-pass less what is there with the filter's model, of a model with another low-pass.
    behind: Option<[Vector3<f64>; 2]>,
    /// Its motion goes its own way within a step: valves at other times, hidden states, another low-pass.
    is_stepped: bool,
    /// Its vector sensors are others.
    turns_vectors: bool,
    /// How it acts over the present step; `None` where it is stepped.
    acts: Option<Acts>,
}

/// Steps up to this share of the time of the fastest motion may be taken with what a parameter does at their start: the motion turns
/// what it does by as many radians meanwhile.
const SHORT_STEP: f64 = 0.05;

/// Columns of sensitivities, one for each parameter.
#[derive(Clone)]
pub(crate) struct Columns<'a> {
    others: Vec<Other<'a>>,
    /// The filter's own model, which takes the steps that the others take.
    reference: OtherModel<'a>,
    /// Where the filter's plant was before the step, where readings are taken to be late.
    before: Option<Plant>,
    /// How the reference acts over the present step, if that is short.
    acts: Option<Acts>,
    /// Of the filter's estimate, by parameter: coordinates of the layout per unit.
    of_state: DMatrix<f64>,
    /// Of the estimate of the start.
    of_start: DMatrix<f64>,
    /// Sum of d d^T / S over all innovations e with d = de/dtheta: the information on the parameters,
    information: DMatrix<f64>,
    /// but for those whose d / sqrt(S) are here, as columns: products of large matrices take less time,
    waiting: DMatrix<f64>,
    /// and how many these are.
    count_waiting: usize,
    /// Sum of d e / S.
    slope: DVector<f64>,
    /// How fast the filter's state moved over the last step, coordinates of the plant per second.
    rates: DVector<f64>,
    /// d of the innovations of the present instant, in their order.
    latest: Vec<DVector<f64>>,
}

/// What a pass says of parameters.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sums {
    /// -d^2 log p / dtheta^2, Gauss and Newton's.
    pub information: DMatrix<f64>,
    /// d log p / dtheta.
    pub slope: DVector<f64>,
    /// How the start that the run shows moves with the parameters.
    pub of_start: DMatrix<f64>,
}

impl Sums {
    /// As if the filter had begun with what was known before the run, `wide`, and not with what the run made of it, `narrow`, which
    /// holds the start where parameters would move it. `shift` is how the start moves that the run shows, `own` its covariance
    /// behind the run. With M the information that has been put in twice, a quadratic form of the start is taken out again:
    ///
    /// ```text
    /// start'       = (1 - own M)^-1 (shift + D theta)
    /// information' = information - D^T M (1 - own M)^-1 D
    /// slope'       = slope + D^T M (1 - own M)^-1 shift
    /// ```
    #[must_use]
    pub fn widened(
        mut self,
        shift: &mut DVector<f64>,
        own: &DMatrix<f64>,
        narrow: &DMatrix<f64>,
        wide: &DMatrix<f64>,
    ) -> Self {
        let known = KnownBefore::new(wide);
        let n = known.back.nrows();
        let Some(inverse) = known.units(narrow).try_inverse() else { return self };
        let twice = inverse - DMatrix::identity(n, n);
        let solve = (DMatrix::identity(n, n) - known.units(own) * &twice).lu();
        let of_start = &known.back * &self.of_start;
        let moved = &known.back * &*shift;
        let (Some(freed), Some(freely)) = (solve.solve(&of_start), solve.solve(&moved)) else { return self };
        self.information -= of_start.transpose() * &twice * &freed;
        self.slope += of_start.transpose() * &twice * &freely;
        self.of_start = &known.basis * freed;
        *shift = &known.basis * freely;
        self
    }

    /// Nothing is known.
    pub fn none(size: usize, parameters: usize) -> Self {
        Self {
            information: DMatrix::zeros(parameters, parameters),
            slope: DVector::zeros(parameters),
            of_start: DMatrix::zeros(size, parameters),
        }
    }
}

impl<'a> Columns<'a> {
    /// For a filter that has not begun.
    pub fn new(case: &Prepared<'a>, size: usize, varied: &[Varied]) -> Result<Self, PredictionError> {
        let n = varied.len();
        let others: Vec<Other<'a>> =
            varied.iter().map(|varied| Other::new(case, varied)).collect::<Result<_, _>>()?;
        let mut reference = case.varied(case.given_model())?;
        reference.plant = reference.plant.for_differences(others.iter().any(|other| other.behind.is_some()));
        Ok(Self {
            others,
            reference,
            before: None,
            acts: None,
            of_state: DMatrix::zeros(size, n),
            of_start: DMatrix::zeros(size, n),
            information: DMatrix::zeros(n, n),
            waiting: DMatrix::zeros(n, TOGETHER),
            count_waiting: 0,
            slope: DVector::zeros(n),
            rates: DVector::zeros(case.plant().tangent().size()),
            latest: Vec::new(),
        })
    }

    /// The sums over all innovations so far.
    pub fn sums(mut self) -> Sums {
        self.gather();
        Sums { information: self.information, slope: -self.slope, of_start: self.of_start }
    }

    /// Before a step that ends at an instant: how every varied model acts in the filter's state, or where more happens within the step
    /// than that shows, the model in the state that the filter would have with it.
    pub fn set_out(&mut self, case: &Prepared<'_>, plant: &Plant, end_ns: i64) {
        let n = self.rates.len();
        self.reference.plant.take_motion_of(plant, &[]);
        let step_s = (end_ns - plant.now_ns()) as f64 * 1e-9;
        let is_simple =
            step_s * case.fastest_1_s() <= SHORT_STEP && self.reference.is_steady_until(case, end_ns);
        self.acts = is_simple.then(|| self.reference.plant.acts());
        self.before = self.others.iter().any(Other::is_late).then(|| plant.clone());
        for (other, column) in self.others.iter_mut().zip(self.of_state.column_iter()) {
            other.acts = None;
            if is_simple && !other.is_stepped {
                other.with.plant.take_motion_of(plant, &[]);
                if other.with.is_steady_until(case, end_ns) && other.with.plant.holds_wheels_of(plant) {
                    other.acts = Some(other.with.plant.acts());
                    continue;
                }
            }
            let moved = column.rows(0, n) * other.step;
            other.take_motion_of(plant, moved.as_slice());
        }
    }

    /// Behind a step of the plant, over which errors moved by this transition. False where a motion is lost.
    pub fn follow(&mut self, case: &Prepared<'_>, plant: &Plant, transition: &DMatrix<f64>) -> bool {
        let (m, n) = (transition.nrows(), self.rates.len());
        let step_s = (plant.now_ns() - self.reference.plant.now_ns()) as f64 * 1e-9;
        if !self.reference.run_to(case, plant.now_ns()) {
            return false;
        }
        let reference = &self.reference.plant;
        let entries = entries(transition);
        let mut moving = DVector::zeros(m);
        for (other, mut column) in self.others.iter_mut().zip(self.of_state.column_iter_mut()) {
            if let Some((acts, of_reference)) = other.acts.as_ref().zip(self.acts.as_ref()) {
                // Half of what it does goes through the whole step: s <- F (s + h/2 r) + h/2 r.
                let half = 0.5 * step_s / other.step;
                moving.copy_from(&column.rows(0, m));
                column.rows_mut(0, m).fill(0.0);
                for (i, (own, of_reference)) in acts.rates.iter().zip(&of_reference.rates).enumerate() {
                    column[i] = half * (own - of_reference);
                    moving[i] += column[i];
                }
                entries.iter().for_each(|(i, k, x)| column[*i] += x * moving[*k]);
                other.with.plant.wait_until(plant.now_ns(), acts);
                continue;
            }
            if !other.with.run_to(case, plant.now_ns()) {
                return false;
            }
            if let Some(behind) = &mut other.behind {
                *behind = other.with.plant.behind_filter_less(reference);
            }
            let by_disturbance = transition.columns(n, m - n) * column.rows(n, m - n);
            // Where one sticks and the other slips the difference says nothing of a small one.
            let of_plant = if other.with.plant.is_on_branch_of(reference) {
                // The plants know better than derivatives that are held how a state moves on; disturbances they have in
                // common.
                other.with.plant.motion_less(reference) / other.step
            } else {
                transition.view((0, 0), (n, n)) * column.rows(0, n)
            };
            column.rows_mut(0, m).copy_from(&by_disturbance);
            column.rows_mut(0, n).axpy(1.0, &of_plant, 1.0);
        }
        if let Some(before) = &self.before {
            let step_s = (plant.now_ns() - before.now_ns()) as f64 * 1e-9;
            self.rates = plant.motion_less(before) / step_s;
        }
        true
    }

    /// A wheel that its friction holds stands whatever the parameters are.
    pub fn hold(&mut self, coordinate: usize) {
        self.of_state.row_mut(coordinate).fill(0.0);
    }

    /// How each of these readings in a state changes with the parameters where the state does not: readings by parameters. `read` is
    /// what other models read there.
    pub fn of_readings(
        &mut self,
        plant: &Plant,
        rows: &[Row],
        read: &dyn Fn(&Plant) -> Vec<Row>,
    ) -> DMatrix<f64> {
        self.latest.clear();
        let n = self.rates.len();
        let here = vec![0.0; n];
        let mut found = DMatrix::zeros(rows.len(), self.others.len());
        for (other, mut column) in self.others.iter_mut().zip(found.column_iter_mut()) {
            if let Some((acts, of_reference)) = other.acts.as_ref().zip(self.acts.as_ref())
                && !other.turns_vectors
            {
                for (slot, row) in column.iter_mut().zip(rows) {
                    let (at, late_s) = match row.component.channel {
                        Channel::Gyro => (row.component.index(), other.late_s[0]),
                        Channel::Accelerometer => (3 + row.component.index(), other.late_s[1]),
                        _ => continue,
                    };
                    let read = of_reference.imu[at] - acts.imu[at];
                    let moves = if late_s == 0.0 { 0.0 } else { row.by_state.rows(0, n).dot(&self.rates) };
                    *slot = (read + moves * late_s) / other.step;
                }
                continue;
            }
            other.take_motion_of(plant, &here);
            if !other.with.plant.is_on_branch_of(plant) {
                continue;
            }
            let varied = read(&other.with.plant);
            for ((slot, row), varied) in column.iter_mut().zip(rows).zip(&varied) {
                let late_s = match row.component.channel {
                    Channel::Gyro => other.late_s[0],
                    Channel::Accelerometer => other.late_s[1],
                    _ => 0.0,
                };
                let moves = row.by_state.rows(0, self.rates.len()).dot(&self.rates);
                *slot = (varied.value - row.value + moves * late_s) / other.step;
            }
        }
        found
    }

    /// The change of an innovation `value` with the parameters; `direct` is the part that is not by the state, `changed` what the
    /// readings of the same instant have changed already.
    pub fn of_innovation(
        &self,
        row: &Row,
        direct: &DMatrix<f64>,
        position: usize,
        changed: &DMatrix<f64>,
    ) -> DVector<f64> {
        let mut d = DVector::from(direct.row(position).transpose());
        for (i, h) in row.by_state.iter().enumerate().filter(|(_, h)| **h != 0.0) {
            for k in 0..d.len() {
                d[k] -= h * (self.of_state[(i, k)] + changed[(i, k)]);
            }
        }
        d
    }

    /// Takes in an innovation and its change.
    pub fn add(&mut self, d: &DVector<f64>, value: f64, variance: f64) {
        self.waiting.column_mut(self.count_waiting).axpy(1.0 / variance.sqrt(), d, 0.0);
        self.count_waiting += 1;
        if self.count_waiting == TOGETHER {
            self.gather();
        }
        self.slope.axpy(value / variance, d, 1.0);
        self.latest.push(d.clone());
    }

    fn gather(&mut self) {
        let waiting = self.waiting.columns(0, self.count_waiting);
        self.information.gemm(1.0, &waiting, &waiting.transpose(), 1.0);
        self.count_waiting = 0;
    }

    /// The start learns of an innovation.
    pub fn learn(&mut self, gain: DVectorView<'_, f64>, d: &DVector<f64>) {
        self.of_start.ger(1.0, &gain, d, 1.0);
    }

    /// The state changes by what was read.
    pub fn change(&mut self, changed: &DMatrix<f64>) {
        self.of_state += changed;
    }

    /// The changes of the innovations of the present instant.
    pub fn latest(&self) -> &[DVector<f64>] {
        &self.latest
    }

    /// How many parameters there are.
    pub fn count(&self) -> usize {
        self.others.len()
    }
}

/// Numbers of a matrix that are not zero, with row and column.
fn entries(matrix: &DMatrix<f64>) -> Vec<(usize, usize, f64)> {
    let all = matrix.column_iter().enumerate();
    let of_column = |(k, column): (usize, nalgebra::DVectorView<'_, f64>)| {
        column.iter().enumerate().filter(|(_, x)| **x != 0.0).map(|(i, x)| (i, k, *x)).collect::<Vec<_>>()
    };
    all.flat_map(of_column).collect()
}

impl<'a> Other<'a> {
    fn new(case: &Prepared<'a>, varied: &Varied) -> Result<Self, PredictionError> {
        let with = case.varied(&varied.model)?;
        let (sensors, of) = (&with.sensors, &case.model().sensors);
        let late_s = [
            sensors.gyro.errors.latency_s - of.gyro.errors.latency_s,
            sensors.accelerometer.errors.latency_s - of.accelerometer.errors.latency_s,
        ];
        let behind = with.has_own_low_pass.then(Default::default);
        let (own, of_case) = (with.plant.gyrostat(), case.plant().gyrostat());
        let is_stepped =
            with.has_own_low_pass || !own.model().gyros().is_empty() || !own.has_valves_of(of_case);
        let turns_vectors = own.model().sensors.vector != of_case.model().sensors.vector;
        Ok(Self { with, step: varied.step, late_s, behind, is_stepped, turns_vectors, acts: None })
    }

    fn take_motion_of(&mut self, plant: &Plant, change: &[f64]) {
        self.with.plant.take_motion_of(plant, change);
        self.behind.iter().for_each(|behind| self.with.plant.move_behind_filter(behind));
    }

    fn is_late(&self) -> bool {
        self.late_s != [0.0; 2]
    }
}
