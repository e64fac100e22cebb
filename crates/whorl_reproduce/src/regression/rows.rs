//! The linear equations of each method.

use nalgebra::{DMatrix, DVector, SMatrix, Vector3};
use whorl_dynamics::gyrostat::equation::{inertia_regressor, momentum_rate_b_n_m};
use whorl_dynamics::mass_parameters::MASS_PARAMETERS;
use whorl_math::{skew, vertical_b};

use super::series::{StateSample, StateSeries};

/// Which equations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Eqs. 4.77-4.83.
    Torque,
    /// Eqs. 4.84-4.85 over this many steps, at least 1 (single, double, triple shift).
    Momentum {
        /// Steps between the two rows of a difference.
        shift: usize,
    },
    /// Eqs. 4.86-4.91.
    Energy,
}

/// Derivatives or integrals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// With numerical derivatives of the rate (eq. 4.77).
    Natural,
    /// Integrated from the start by the first-order rule, as printed (section 4.6.4).
    Integrated,
    /// Integrated by the trapezoidal rule.
    IntegratedTrapezoid,
}

/// Linear equations a p = b.
#[derive(Debug, Clone, PartialEq)]
pub struct System {
    /// One row for each equation, nine columns.
    pub matrix: DMatrix<f64>,
    /// Right-hand side.
    pub right: DVector<f64>,
    /// Expected product of the matrix' noise with itself, per unit variance of the rate: what total
    /// least squares subtracts (eq. 4.77's matrix is linear in the rate except for small terms).
    pub noise_product: SMatrix<f64, MASS_PARAMETERS, MASS_PARAMETERS>,
    /// Whether all rows hold the same error of the rate at the start, which subtracting the means removes.
    pub common_start: bool,
}

type Row = SMatrix<f64, 3, MASS_PARAMETERS>;

fn joined(inertia: &SMatrix<f64, 3, 6>, offset: &SMatrix<f64, 3, 3>) -> Row {
    let mut row = Row::zeros();
    row.fixed_view_mut::<3, 6>(0, 0).copy_from(inertia);
    row.fixed_view_mut::<3, 3>(0, 6).copy_from(offset);
    row
}

/// The equations of a method. Fewer than three samples give none.
#[must_use]
pub fn rows(series: &StateSeries, method: Method, form: Form) -> System {
    let vector_rows = match form {
        Form::Natural => natural(series),
        Form::Integrated => integrated(series, false),
        Form::IntegratedTrapezoid => integrated(series, true),
    };
    match method {
        Method::Torque => stack(&vector_rows, noise_per_row(series, form), form != Form::Natural),
        Method::Momentum { shift } => {
            // Two rows in each; the start's error nearly cancels between them.
            let rows = shifted(series, &vector_rows, shift.max(1));
            stack(&rows, 2.0 * noise_per_row(series, form), false)
        }
        Method::Energy => energy(series, form, &vector_rows),
    }
}

/// Index of the sample, matrix, right-hand side.
type VectorRow = (usize, Row, Vector3<f64>);

/// Variance of the rate in a row, over the rate's own.
fn noise_per_row(series: &StateSeries, form: Form) -> f64 {
    let step_s = match series.samples.as_slice() {
        [first, second, ..] => second.time_s - first.time_s,
        _ => return 1.0,
    };
    // A central difference over two steps holds two samples.
    if form == Form::Natural { 2.0 / (2.0 * step_s).powi(2) } else { 1.0 }
}

fn natural(series: &StateSeries) -> Vec<VectorRow> {
    let s = &series.samples;
    let mut rows = Vec::with_capacity(s.len());
    for (k, (before, (at, after))) in s.iter().zip(s.iter().skip(1).zip(s.iter().skip(2))).enumerate() {
        let span_s = after.time_s - before.time_s;
        let acceleration = (after.omega_wb_b_rad_s - before.omega_wb_b_rad_s) / span_s;
        let wheels = series.wheel_momentum_b_n_m_s(at);
        let wheel_torque =
            (series.wheel_momentum_b_n_m_s(after) - series.wheel_momentum_b_n_m_s(before)) / span_s;
        let matrix =
            at.mass_regressor() + joined(&inertia_regressor(&acceleration), &SMatrix::<f64, 3, 3>::zeros());
        // The torque of the step around the middle sample.
        let torque = 0.5 * (before.external_torque_b_n_m + at.external_torque_b_n_m);
        let right = momentum_rate_b_n_m(&at.omega_wb_b_rad_s, &wheels, &(torque - wheel_torque));
        rows.push((k + 1, matrix, right));
    }
    rows
}

fn integrated(series: &StateSeries, trapezoid: bool) -> Vec<VectorRow> {
    let Some(first) = series.samples.first() else { return Vec::new() };
    let start = inertia_regressor(&first.omega_wb_b_rad_s);
    let wheels_start = series.wheel_momentum_b_n_m_s(first);
    let mut matrix = Row::zeros();
    let mut right = Vector3::zeros();
    let mut rows = Vec::with_capacity(series.samples.len());
    let gyroscopic = |s: &StateSample| series.gyroscopic_torque_b_n_m(s);
    for (k, (at, next)) in series.samples.iter().zip(series.samples.iter().skip(1)).enumerate() {
        let step_s = next.time_s - at.time_s;
        let (a, g) = if trapezoid {
            (0.5 * (at.mass_regressor() + next.mass_regressor()), 0.5 * (gyroscopic(at) + gyroscopic(next)))
        } else {
            (at.mass_regressor(), gyroscopic(at))
        };
        matrix += a * step_s;
        right += (at.external_torque_b_n_m + g) * step_s;
        let now = inertia_regressor(&next.omega_wb_b_rad_s) - start;
        let wheels = series.wheel_momentum_b_n_m_s(next) - wheels_start;
        rows.push((k + 1, matrix + joined(&now, &SMatrix::<f64, 3, 3>::zeros()), right - wheels));
    }
    rows
}

/// Rows at t_2 less the rows at t_1 turned into the axes at t_2; disjoint pairs, as printed ("halves the
/// size of the data set").
fn shifted(series: &StateSeries, rows: &[VectorRow], shift: usize) -> Vec<VectorRow> {
    rows.chunks(2 * shift)
        .flat_map(|block| {
            block.iter().zip(block.iter().skip(shift)).filter_map(|((k1, a1, b1), (k2, a2, b2))| {
                let (s1, s2) = (series.samples.get(*k1)?, series.samples.get(*k2)?);
                let turn = (s2.q_world_body.inverse() * s1.q_world_body).to_rotation_matrix();
                Some((*k2, a2 - turn.matrix() * a1, b2 - turn * b1))
            })
        })
        .collect()
}

fn energy(series: &StateSeries, form: Form, natural: &[VectorRow]) -> System {
    let mut matrix = Vec::new();
    let mut right = Vec::new();
    if form == Form::Natural {
        for (k, a, b) in natural {
            let Some(sample) = series.samples.get(*k) else { continue };
            let omega = sample.omega_wb_b_rad_s;
            matrix.push(omega.transpose() * a);
            right.push(omega.dot(b));
        }
        return system(&matrix, right);
    }
    let Some(first) = series.samples.first() else { return system(&[], Vec::new()) };
    let kinetic = |omega: &Vector3<f64>| 0.5 * omega.transpose() * inertia_regressor(omega);
    let start = kinetic(&first.omega_wb_b_rad_s);
    let mut offset = SMatrix::<f64, 1, 3>::zeros();
    let mut work = 0.0;
    for (at, next) in series.samples.iter().zip(series.samples.iter().skip(1)) {
        let step_s = next.time_s - at.time_s;
        let power = |s: &StateSample| -(s.omega_wb_b_rad_s.transpose() * skew(&vertical_b(&s.q_world_body)));
        let mean = 0.5 * (at.omega_wb_b_rad_s + next.omega_wb_b_rad_s);
        let trapezoid = form == Form::IntegratedTrapezoid;
        offset += if trapezoid { 0.5 * (power(at) + power(next)) } else { power(at) } * step_s;
        let rate = if trapezoid { mean } else { at.omega_wb_b_rad_s };
        work += rate.dot(&at.external_torque_b_n_m) * step_s;
        // The wheels' share, from increments of their speed: no derivative.
        work -= mean.dot(&(series.wheel_momentum_b_n_m_s(next) - series.wheel_momentum_b_n_m_s(at)));
        let mut row = SMatrix::<f64, 1, MASS_PARAMETERS>::zeros();
        row.fixed_view_mut::<1, 6>(0, 0).copy_from(&(kinetic(&next.omega_wb_b_rad_s) - start));
        row.fixed_view_mut::<1, 3>(0, 6).copy_from(&offset);
        matrix.push(row);
        right.push(work);
    }
    system(&matrix, right)
}

fn system(rows: &[SMatrix<f64, 1, MASS_PARAMETERS>], right: Vec<f64>) -> System {
    System {
        matrix: DMatrix::from_fn(rows.len(), MASS_PARAMETERS, |i, j| rows.get(i).map_or(0.0, |r| r[j])),
        right: DVector::from_vec(right),
        noise_product: SMatrix::zeros(),
        common_start: false,
    }
}

fn stack(rows: &[VectorRow], noise_per_row: f64, common_start: bool) -> System {
    let count = 3 * rows.len();
    let matrix = DMatrix::from_fn(count, MASS_PARAMETERS, |i, j| {
        rows.get(i / 3).map_or(0.0, |(_, a, _)| a[(i % 3, j)])
    });
    let right = DVector::from_fn(count, |i, _| rows.get(i / 3).map_or(0.0, |(_, _, b)| b[i % 3]));
    // Each row holds the rate of its time once: sum over axes of R(e)^T R(e).
    let mut noise_product = SMatrix::<f64, MASS_PARAMETERS, MASS_PARAMETERS>::zeros();
    for axis in 0..3 {
        let unit = inertia_regressor(&Vector3::ith(axis, 1.0));
        let mut block = noise_product.fixed_view_mut::<6, 6>(0, 0);
        block += unit.transpose() * unit;
    }
    System { matrix, right, noise_product: noise_product * (noise_per_row * rows.len() as f64), common_start }
}
