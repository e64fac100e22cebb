//! Attitudes of arrays.

use nalgebra::{Unit, Vector3};
use numpy::{PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use whorl_commands::estimate::{EstimateOptions, Recorded, estimates};
use whorl_commands::own_times::OwnTimes;
use whorl_free_motion::Observed;

use crate::errors::{error, refused};
use crate::watch::watched;

type Rows<'py> = PyReadonlyArray2<'py, f64>;
type Floats<'py> = Bound<'py, PyArray2<f64>>;

/// Attitudes w, x, y, z, gyro biases [rad/s] and covariances (36), a row to each sample, NaN before the first; name of the
/// filter, whether it found a magnet, and what was not used or is odd about the sensors.
type Estimated<'py> = (Floats<'py>, Floats<'py>, Floats<'py>, &'static str, bool, Vec<String>);

/// Three numbers of a row, if all are there.
fn vector(rows: &Rows<'_>, k: usize) -> Option<Vector3<f64>> {
    let all = rows.as_array();
    let v = Vector3::new(all[(k, 0)], all[(k, 1)], all[(k, 2)]);
    v.iter().all(|x| x.is_finite()).then_some(v)
}

/// Estimates attitudes, as `whorl estimate`.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the arguments of a Python function")]
pub fn estimate<'py>(
    py: Python<'py>,
    time_s: PyReadonlyArray1<'py, f64>,
    gyro_rad_s: Rows<'py>,
    force_m_s2: Option<Rows<'py>>,
    vectors: Vec<Rows<'py>>,
    references: Vec<Option<[f64; 3]>>,
    filter: Option<String>,
    smooth: bool,
    gyro_noise: f64,
    gyro_bias_walk: f64,
    gyro_bias_sigma: f64,
    vector_noise_deg: Vec<f64>,
) -> PyResult<Estimated<'py>> {
    let time_s: Vec<f64> = time_s.as_array().iter().copied().collect();
    let n = time_s.len();
    let named = vectors.iter().enumerate().map(|(k, rows)| (format!("vectors[{k}]"), rows));
    let all = [("gyro_rad_s".to_owned(), &gyro_rad_s)]
        .into_iter()
        .chain(force_m_s2.iter().map(|rows| ("accelerometer_m_s2".to_owned(), rows)))
        .chain(named);
    for (name, rows) in all {
        let (rows, columns) = rows.as_array().dim();
        if (rows, columns) != (n, 3) {
            return Err(refused(format!("{name} has shape ({rows}, {columns}); allowed: ({n}, 3)")));
        }
    }
    for (k, pair) in time_s.windows(2).enumerate() {
        if !matches!(pair, [a, b] if b > a) {
            return Err(refused(format!("time {} is not after the one before it; allowed: in order", k + 1)));
        }
    }
    let references: Vec<Option<Unit<Vector3<f64>>>> =
        references.into_iter().map(|of| Unit::try_new(Vector3::from(of?), 1e-12)).collect();
    let first = time_s.first().copied().unwrap_or(0.0);
    // A column without a single number is an axis that is not measured.
    let axes = |rows: &Rows<'_>| {
        let has = |axis: usize| {
            (0..time_s.len()).any(|k| rows.as_array().get((k, axis)).is_some_and(|x| x.is_finite()))
        };
        [0, 1, 2].map(has)
    };
    let (gyro_axes, force_axes) = (axes(&gyro_rad_s), force_m_s2.as_ref().map_or([false; 3], axes));
    // As in files: each sensor has times of its own.
    let mut own = OwnTimes::new(vectors.len());
    let (mut samples, mut places) = (Vec::new(), Vec::new());
    for (k, t) in time_s.iter().enumerate() {
        let at_ns = ((t - first) * 1e9).round() as i64;
        if let Some(force) = force_m_s2.as_ref().and_then(|rows| vector(rows, k)) {
            own.force(at_ns, force);
        }
        for (sensor, (rows, reference_w)) in vectors.iter().zip(&references).enumerate() {
            if let Some(body) = vector(rows, k) {
                own.vector(sensor, at_ns, Observed { body, reference_w: *reference_w });
            }
        }
        let Some(gyro) = vector(&gyro_rad_s, k) else { continue };
        if let Some((sample, _)) = own.gyro(at_ns, gyro, force_axes == [true; 3]) {
            samples.push(sample);
            places.push(k);
        }
    }
    let recorded = Recorded {
        name: "the arrays".to_owned(),
        gyro_axes,
        force_axes,
        vectors: references
            .iter()
            .enumerate()
            .map(|(k, reference)| (format!("vectors[{k}]"), reference.is_some()))
            .collect(),
    };
    let mut notes = own.unused().notes();
    notes.extend(recorded.partial_force());
    let options =
        EstimateOptions { filter, smooth, gyro_noise, gyro_bias_walk, gyro_bias_sigma, vector_noise_deg };
    let (chosen, found) = watched(py, None, move |_| estimates(&options, &recorded, &samples))?;
    notes.extend(chosen.doubts());
    let blank = |width: usize| vec![vec![f64::NAN; width]; n];
    let (mut attitudes, mut biases, mut covariances) = (blank(4), blank(3), blank(36));
    for (k, orientation) in places.into_iter().zip(found) {
        let Some(o) = orientation else { continue };
        let q = o.q_world_body;
        let rows = (attitudes.get_mut(k), biases.get_mut(k), covariances.get_mut(k));
        if let (Some(attitude), Some(bias), Some(covariance)) = rows {
            *attitude = vec![q.w, q.i, q.j, q.k];
            *bias = o.gyro_bias_rad_s.as_slice().to_vec();
            *covariance = o.covariance.as_slice().to_vec();
        }
    }
    let array = |rows: &[Vec<f64>], width: usize| -> PyResult<Floats<'py>> {
        if rows.is_empty() {
            return Ok(PyArray2::zeros(py, [0, width], false));
        }
        PyArray2::from_vec2(py, rows).map_err(error)
    };
    Ok((
        array(&attitudes, 4)?,
        array(&biases, 3)?,
        array(&covariances, 36)?,
        chosen.name(),
        chosen.is_magnetised(),
        notes,
    ))
}
