//! Allocation of torques, and orbits.

use nalgebra::{Matrix3xX, Vector3};
use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use whorl_allocation::{EffectorLayout, Effectors, JetMask, Mode, TorqueDemand};
use whorl_orbits::hill::HillState;
use whorl_orbits::{Elements, relative_motion as relative};

use crate::errors::{error, refused};

/// Shares a torque among jets and motors: the quadratic program of the local control node.
#[pyclass(module = "whorl._native", unsendable)]
pub struct Allocator {
    inner: whorl_allocation::Allocator,
}

fn columns(name: &str, given: &PyReadonlyArray2<'_, f64>) -> PyResult<Matrix3xX<f64>> {
    let array = given.as_array();
    if array.nrows() != 3 {
        let (rows, columns) = (array.nrows(), array.ncols());
        return Err(refused(format!(
            "{name} has shape ({rows}, {columns}); allowed: (3, n), a column to each jet or motor"
        )));
    }
    Ok(Matrix3xX::from_fn(array.ncols(), |i, j| array[(i, j)]))
}

#[pymethods]
impl Allocator {
    #[new]
    fn new(
        jet_torque_b_n_m: PyReadonlyArray2<'_, f64>,
        jet_gas_rate_kg_s: Vec<f64>,
        motor_torque_b: PyReadonlyArray2<'_, f64>,
        motor_limit: Vec<f64>,
    ) -> PyResult<Self> {
        let layout = EffectorLayout {
            jet_torque_b_n_m: columns("jet_torque_b_n_m", &jet_torque_b_n_m)?,
            jet_force_b_n: None,
            jet_gas_rate_kg_s,
            motor_torque_b: columns("motor_torque_b", &motor_torque_b)?,
            motor_limit,
        };
        let effectors = Effectors::new(layout).map_err(error)?;
        Ok(Self { inner: whorl_allocation::Allocator::new(effectors).map_err(error)? })
    }

    #[pyo3(signature = (torque_b_n_m, mode="both", failed_jets=vec![]))]
    fn allocate<'py>(
        &mut self,
        py: Python<'py>,
        torque_b_n_m: [f64; 3],
        mode: &str,
        failed_jets: Vec<usize>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let mode = match mode {
            "motors" => Mode::Motors,
            "jets" => Mode::Jets,
            "both" => Mode::Both,
            other => return Err(refused(format!("mode is {other}; allowed: motors, jets, both"))),
        };
        let mut demand = TorqueDemand::nominal(self.inner.effectors(), mode, Vector3::from(torque_b_n_m));
        demand.jet_available = failed_jets.into_iter().fold(JetMask::ALL, JetMask::without);
        let found = self.inner.allocate(&demand).map_err(error)?;
        let answer = PyDict::new(py);
        answer.set_item("jet_on_fraction", found.jet_on_fraction)?;
        answer.set_item("motor_command", found.motor_command)?;
        answer.set_item("alpha", found.alpha)?;
        answer.set_item("achieved_torque_b_n_m", <[f64; 3]>::from(found.achieved_torque_b_n_m))?;
        answer.set_item("unallocated_torque_b_n_m", <[f64; 3]>::from(found.unallocated_torque_b_n_m))?;
        answer.set_item("gas_rate_kg_s", found.gas_rate_kg_s)?;
        answer.set_item("status", format!("{:?}", found.status))?;
        Ok(answer)
    }
}

/// Semi-major axis \[m\], eccentricity, inclination, node, perigee, mean anomaly \[rad\].
fn elements(of: [f64; 6]) -> PyResult<Elements> {
    let [semi_major_axis_m, eccentricity, inclination_rad, node_rad, perigee_rad, mean_anomaly_rad] = of;
    let elements = Elements {
        semi_major_axis_m,
        eccentricity,
        inclination_rad,
        node_rad,
        perigee_rad,
        mean_anomaly_rad,
    };
    elements.check().map_err(error)?;
    Ok(elements)
}

fn rows(py: Python<'_>, rows: Vec<Vec<f64>>) -> PyResult<Bound<'_, PyArray2<f64>>> {
    PyArray2::from_vec2(py, &rows).map_err(error)
}

/// Two-body orbit: position \[m\] and velocity [m/s], inertial, a row of six to each time; and the period \[s\].
#[pyfunction]
pub fn orbit<'py>(
    py: Python<'py>,
    of: [f64; 6],
    time_s: Vec<f64>,
) -> PyResult<(Bound<'py, PyArray2<f64>>, f64)> {
    let elements = elements(of)?;
    let state = |t: &f64| {
        let state = elements.after(*t).state();
        state.position_m.iter().chain(state.velocity_m_s.iter()).copied().collect()
    };
    Ok((rows(py, time_s.iter().map(state).collect())?, elements.period_s()))
}

/// Motion of a deputy seen from its chief, in the chief's Hill frame: a row of six to each time.
#[pyfunction]
pub fn relative_motion<'py>(
    py: Python<'py>,
    chief: [f64; 6],
    deputy: [f64; 6],
    time_s: Vec<f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let chief = elements(chief)?.state();
    let [x, y, z, vx, vy, vz] = deputy;
    let deputy = HillState { position_m: Vector3::new(x, y, z), velocity_m_s: Vector3::new(vx, vy, vz) };
    let at = |t: &f64| {
        let state = relative::after(&chief, &deputy, *t);
        state.position_m.iter().chain(state.velocity_m_s.iter()).copied().collect()
    };
    rows(py, time_s.iter().map(at).collect())
}
