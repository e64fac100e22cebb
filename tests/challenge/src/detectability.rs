//! The detectability of effects in data, independent of the analysis: the drop of the misfit that an effect causes after
//! everything that is uncertain anyway has been refitted.
//!
//! Each run is cut into segments of 30 s. In a segment the platform is simulated from the same motion
//! with and without the effect, commands the same; the difference of all that is measured, divided by
//! the noise (coloured parts included), is projected off the segment's own start (attitude, rates, wheel
//! speeds), slow bias, and, over all segments together, off the platform's uncertain constants and the
//! runs' biases within their priors. The square that is left is the detectability lambda: twice the log
//! likelihood ratio that a perfect analyst gains who knows the formula. A start of its own for each
//! segment removes coherence over minutes, which no analysis can use.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, UnitQuaternion, Vector3};
use whorl_dynamics::platform::ModelPrior;

use crate::scenario::NoiseLevels;
use crate::truth::run::Span;
use crate::truth::{Body, Constant, Hidden, Mechanics, Motion, Plan, Trace, simulate};

/// Slots in a segment: 30 s.
const SEGMENT_SLOTS: usize = 1500;
/// A parameter of another effect is plausible up to this many of its usual steps, one standard deviation.
const PLAUSIBLE_STEPS: f64 = 10.0;
/// Number of refits of the values of an effect that replaces another.
const REFITS: usize = 2;
/// Integration step \[s\].
const STEP_S: f64 = 0.01;

struct Segment {
    run: usize,
    span: Span,
    start: Motion,
    base: DVector<f64>,
    /// Orthonormal: what the start and the slow bias can do.
    local: DMatrix<f64>,
    /// Sensitivities to the uncertain constants, `local` projected off.
    columns: DMatrix<f32>,
}

/// Set of runs through which effects are seen.
pub struct Lens {
    body: Body,
    plans: Vec<Plan>,
    levels: NoiseLevels,
    constants: Vec<(Constant, f64)>,
    segments: Vec<Segment>,
    normal: Cholesky<f64, Dyn>,
    count: usize,
}

/// An effect as the data show it.
#[derive(Clone)]
pub struct Seen {
    square: f64,
    against: DVector<f64>,
    parts: Vec<DVector<f32>>,
}

impl Seen {
    /// This plus a multiple of another.
    fn plus(&self, other: &Self, factor: f64) -> Self {
        let parts: Vec<DVector<f32>> =
            self.parts.iter().zip(&other.parts).map(|(a, b)| a + b * (factor as f32)).collect();
        Self {
            square: parts.iter().map(|p| dot(p, p)).sum(),
            against: &self.against + &other.against * factor,
            parts,
        }
    }

    /// A multiple of this.
    #[must_use]
    pub fn times(mut self, factor: f64) -> Self {
        self.square *= factor * factor;
        self.against *= factor;
        self.parts.iter_mut().for_each(|p| *p *= factor as f32);
        self
    }
}

/// All that is measured, in units of its noise.
fn whitened(trace: &Trace, levels: &NoiseLevels) -> DVector<f64> {
    let mut values = Vec::new();
    let two = 2.0_f64.sqrt();
    let gyro = 1.0 / NoiseLevels::effective(levels.gyro_rad_s);
    let accel = two / NoiseLevels::effective(levels.accel_m_s2);
    for y in &trace.gyro_b_rad_s {
        values.extend((y * gyro).iter());
    }
    for y in trace.force_b_m_s2.iter().step_by(2) {
        values.extend((y * accel).iter());
    }
    for y in trace.wheel_rad_s.iter().step_by(2) {
        values.extend(y.iter().map(|x| x * two / levels.wheel_rad_s));
    }
    for y in &trace.direction_b {
        values.extend((y / levels.vector_rad).iter());
    }
    // The prior of the segment's slow bias, as three measurements.
    values.extend([0.0; 3]);
    DVector::from_vec(values)
}

/// Stored in single precision, summed in double: large parts cancel.
fn dot(a: &DVector<f32>, b: &DVector<f32>) -> f64 {
    a.iter().zip(b.iter()).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
}

/// Gram-Schmidt, twice; linearly dependent columns are dropped.
fn orthonormal(columns: Vec<DVector<f64>>) -> DMatrix<f64> {
    let rows = columns.first().map_or(0, DVector::len);
    let mut kept: Vec<DVector<f64>> = Vec::new();
    for mut column in columns {
        let before = column.norm();
        for _ in 0..2 {
            for q in &kept {
                column -= q * q.dot(&column);
            }
        }
        let after = column.norm();
        if after > 1e-9 * before && after > 0.0 {
            kept.push(column / after);
        }
    }
    if kept.is_empty() { DMatrix::zeros(rows, 0) } else { DMatrix::from_columns(&kept) }
}

impl Lens {
    /// Looks through these runs of this platform.
    #[must_use]
    pub fn new(body: &Body, plans: &[Plan], levels: &NoiseLevels, prior: &ModelPrior) -> Self {
        let base = Mechanics::new(body.clone(), Hidden::none(body.wheels.len(), body.jets.len()));
        let constants = body.uncertain(prior);
        let count = constants.len() + 6 * plans.len();
        let mut normal = DMatrix::<f64>::identity(count, count);
        let mut segments = Vec::new();
        for (run, plan) in plans.iter().enumerate() {
            let slots = plan.wheel_command_n_m.len();
            let whole = Span { from_slot: 0, to_slot: slots, step_s: STEP_S, mark_every: SEGMENT_SLOTS };
            let mut plan = plan.clone();
            let start = plan.start.clone();
            let marks = simulate(&base, &mut plan, &start, whole, None).marks;
            for (i, from_slot) in (0..slots).step_by(SEGMENT_SLOTS).enumerate() {
                let to_slot = (from_slot + SEGMENT_SLOTS).min(slots);
                let span = Span { from_slot, to_slot, ..whole };
                let start = Motion { slosh: None, flex: [0.0; 2], ..marks[i].clone() };
                let segment = segment(&base, &mut plan, run, span, start, levels, &constants, plans.len());
                let wide = segment.columns.map(f64::from);
                normal += wide.tr_mul(&wide);
                segments.push(segment);
            }
        }
        // Identity plus squares: positive definite.
        let normal =
            Cholesky::new(normal).unwrap_or_else(|| Cholesky::pack_dirty(DMatrix::identity(count, count)));
        Self {
            body: body.clone(),
            plans: plans.to_vec(),
            levels: levels.clone(),
            constants,
            segments,
            normal,
            count,
        }
    }

    /// The platform's constants.
    #[must_use]
    pub fn body(&self) -> &Body {
        &self.body
    }

    /// What these hidden effects change.
    #[must_use]
    pub fn see(&self, hidden: &Hidden) -> Seen {
        let mechanics = Mechanics::new(self.body.clone(), hidden.clone());
        let mut plans = self.plans.clone();
        let mut seen = Seen { square: 0.0, against: DVector::zeros(self.count), parts: Vec::new() };
        for segment in &self.segments {
            let trace = simulate(&mechanics, &mut plans[segment.run], &segment.start, segment.span, None);
            let mut difference = whitened(&trace, &self.levels) - &segment.base;
            difference -= &segment.local * segment.local.tr_mul(&difference);
            let narrow = difference.map(|x| x as f32);
            seen.square += dot(&narrow, &narrow);
            for (sum, column) in seen.against.iter_mut().zip(segment.columns.column_iter()) {
                *sum += column.iter().zip(&narrow).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
            }
            seen.parts.push(narrow);
        }
        seen
    }

    /// Detectability of hidden effects, the constants refitted once more from where the first fit ended:
    /// what they can imitate is imitated exactly, not only to first order.
    #[must_use]
    pub fn detectability(&self, hidden: &Hidden) -> f64 {
        let seen = self.see(hidden);
        let shift = self.normal.solve(&seen.against);
        let mut body = self.body.clone();
        for ((constant, stddev), by) in self.constants.iter().zip(shift.iter()) {
            body.shift(*constant, stddev * by);
        }
        let refitted = Mechanics::new(body, Hidden::none(self.body.wheels.len(), self.body.jets.len()));
        let truth = Mechanics::new(self.body.clone(), hidden.clone());
        let mut plans = self.plans.clone();
        let mut square = shift.norm_squared();
        let mut against = -shift.clone();
        for segment in &self.segments {
            let plan = &mut plans[segment.run];
            let seen = whitened(&simulate(&truth, plan, &segment.start, segment.span, None), &self.levels);
            let model =
                whitened(&simulate(&refitted, plan, &segment.start, segment.span, None), &self.levels);
            let mut difference = seen - model;
            // Biases are exactly linear.
            let first = self.constants.len();
            for (i, column) in segment.columns.column_iter().enumerate().skip(first) {
                difference.iter_mut().zip(column.iter()).for_each(|(d, c)| *d -= f64::from(*c) * shift[i]);
            }
            difference -= &segment.local * segment.local.tr_mul(&difference);
            square += difference.norm_squared();
            for (sum, column) in against.iter_mut().zip(segment.columns.column_iter()) {
                *sum += column.iter().zip(&difference).map(|(a, b)| f64::from(*a) * b).sum::<f64>();
            }
        }
        (square - against.dot(&self.normal.solve(&against))).max(0.0)
    }

    fn product(&self, a: &Seen, b: &Seen) -> f64 {
        let direct: f64 = a.parts.iter().zip(&b.parts).map(|(x, y)| dot(x, y)).sum();
        direct - a.against.dot(&self.normal.solve(&b.against))
    }

    /// Detectability of an effect.
    #[must_use]
    pub fn lambda(&self, seen: &Seen) -> f64 {
        (seen.square - seen.against.dot(&self.normal.solve(&seen.against))).max(0.0)
    }

    /// Its remaining signal when these others may take its place.
    #[must_use]
    pub fn beyond(&self, seen: &Seen, others: &[Seen]) -> f64 {
        self.without(seen, others, &vec![0.0; others.len()]).0
    }

    /// What is left of it when another effect takes its place with the values that fit best, as multiples of the steps
    /// to which its `columns` belong. `at` makes the effect. Two effects that are one torque move the platform alike
    /// however far it goes; to first order they would not.
    #[must_use]
    pub fn beyond_fitted(&self, seen: &Seen, columns: &[Seen], at: impl Fn(&[f64]) -> Hidden) -> f64 {
        let mut multiples = vec![0.0; columns.len()];
        let (mut left, mut steps) = self.without(seen, columns, &multiples);
        for _ in 0..REFITS {
            multiples.iter_mut().zip(&steps).for_each(|(m, s)| *m += s);
            let rest = seen.plus(&self.see(&at(&multiples)), -1.0);
            let (now, next) = self.without(&rest, columns, &multiples);
            left = left.min(now);
            steps = next;
        }
        left
    }

    /// What is left of a signal, and the multiples of the columns that take the rest, beside those already taken.
    fn without(&self, seen: &Seen, columns: &[Seen], taken: &[f64]) -> (f64, Vec<f64>) {
        let scale: Vec<f64> = columns.iter().map(|o| self.lambda(o).sqrt()).collect();
        let used: Vec<usize> = (0..columns.len()).filter(|i| scale[*i] > 3e-5).collect();
        let mut steps = vec![0.0; columns.len()];
        let n = used.len();
        let prior = |i: usize| (PLAUSIBLE_STEPS * scale[i]).powi(-2);
        let gram = DMatrix::from_fn(n, n, |a, b| {
            let (i, j) = (used[a], used[b]);
            let prior = if i == j { prior(i) + 1e-9 } else { 0.0 };
            self.product(&columns[i], &columns[j]) / (scale[i] * scale[j]) + prior
        });
        let side = DVector::from_fn(n, |a, _| {
            let i = used[a];
            self.product(&columns[i], seen) / scale[i] - prior(i) * taken[i] * scale[i]
        });
        let penalty: f64 = taken.iter().map(|m| (m / PLAUSIBLE_STEPS).powi(2)).sum();
        let mut left = self.lambda(seen) + penalty;
        if let Some(factor) = Cholesky::new(gram).filter(|_| n > 0) {
            let solution = factor.solve(&side);
            left -= side.dot(&solution);
            used.iter().zip(solution.iter()).for_each(|(i, x)| steps[*i] = x / scale[*i]);
        }
        (left.max(0.0), steps)
    }
}

#[expect(clippy::too_many_arguments, reason = "one call")]
fn segment(
    base: &Mechanics,
    plan: &mut Plan,
    run: usize,
    span: Span,
    start: Motion,
    levels: &NoiseLevels,
    constants: &[(Constant, f64)],
    runs: usize,
) -> Segment {
    let mut outputs = |mechanics: &Mechanics, start: &Motion| {
        whitened(&simulate(mechanics, plan, start, span, None), levels)
    };
    let reference = outputs(base, &start);
    let rows = reference.len();
    let mut free = Vec::new();
    for i in 0..9 {
        let mut other = start.clone();
        let size = match i {
            0..3 => {
                let mut turn = Vector3::zeros();
                turn[i] = 1e-4;
                other.q_world_body *= UnitQuaternion::from_scaled_axis(turn);
                1e-4
            }
            3..6 => {
                other.omega_b_rad_s[i - 3] += 1e-4;
                1e-4
            }
            _ => {
                other.wheel_speed_rad_s[i - 6] += 1e-2;
                1e-2
            }
        };
        free.push((outputs(base, &other) - &reference) / size);
    }
    let samples = (span.to_slot - span.from_slot) * 2;
    let has_imu = !plan_is_clamped(&reference, samples);
    let bias = |axis: usize, of_gyro: bool| {
        let mut column = DVector::zeros(rows);
        let two = 2.0_f64.sqrt();
        let (first, number, weight) = if of_gyro {
            (0, samples, 1.0 / NoiseLevels::effective(levels.gyro_rad_s))
        } else {
            (3 * samples, samples / 2, two / NoiseLevels::effective(levels.accel_m_s2))
        };
        if has_imu {
            for i in 0..number {
                column[first + 3 * i + axis] = weight;
            }
        }
        column
    };
    for axis in 0..3 {
        let mut column = bias(axis, true);
        column[rows - 3 + axis] = 1.0 / NoiseLevels::slow(levels.gyro_rad_s);
        free.push(column);
    }
    let local = orthonormal(free);
    let count = constants.len() + 6 * runs;
    let mut columns = DMatrix::<f64>::zeros(rows, count);
    for (i, (constant, stddev)) in constants.iter().enumerate() {
        let mut body = base.body.clone();
        let by = 0.2 * stddev;
        body.shift(*constant, by);
        let other = Mechanics::new(body, base.hidden.clone());
        columns.set_column(i, &((outputs(&other, &start) - &reference) / 0.2));
    }
    for axis in 0..3 {
        let first = constants.len() + 6 * run;
        columns.set_column(first + axis, &(bias(axis, true) * levels.gyro_turn_on_rad_s));
        columns.set_column(first + 3 + axis, &(bias(axis, false) * levels.accel_turn_on_m_s2));
    }
    let along = local.tr_mul(&columns);
    columns -= &local * along;
    Segment { run, span, start, base: reference, local, columns: columns.map(|x| x as f32) }
}

/// A clamped run has wheel speeds only.
fn plan_is_clamped(reference: &DVector<f64>, samples: usize) -> bool {
    reference.len() < 3 * samples + 3
}
