//! Platforms: model and prior.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use pyo3::prelude::*;
use whorl_commands::runs::RunSources;
use whorl_recording::{KnownPlatform, read_model};

use crate::errors::error;

/// A platform's model and how well it is known, from a parameter file or a run directory.
#[pyclass(frozen, module = "whorl._native")]
#[derive(Clone)]
pub struct Platform(pub Arc<KnownPlatform>);

#[pymethods]
impl Platform {
    #[staticmethod]
    #[pyo3(signature = (source, platform=None))]
    fn read(source: PathBuf, platform: Option<&str>) -> PyResult<Self> {
        read_model(&source, platform).map(|known| Self(Arc::new(known))).map_err(error)
    }

    /// Of `model`, else that saved in the first run.
    #[staticmethod]
    #[pyo3(signature = (runs, model=None, platform=None))]
    fn of_runs(runs: Vec<PathBuf>, model: Option<PathBuf>, platform: Option<String>) -> PyResult<Self> {
        let sources = RunSources { runs, model, platform, ..RunSources::default() };
        sources.read_model().map(|known| Self(Arc::new(known))).map_err(error)
    }

    #[getter]
    fn name(&self) -> &str {
        &self.0.platform
    }

    #[getter]
    fn files(&self) -> Vec<PathBuf> {
        self.0.files.clone()
    }

    #[getter]
    fn wheels(&self) -> Vec<String> {
        self.0.model.wheels().iter().map(|wheel| wheel.name.clone()).collect()
    }

    #[getter]
    fn jets(&self) -> Vec<String> {
        self.0.model.jets().iter().map(|jet| jet.name.clone()).collect()
    }

    /// The axis of the hinge on which it turns, a unit vector in body axes.
    #[getter]
    fn hinge_axis_b(&self) -> Option<[f64; 3]> {
        self.0.model.freedom.hinge_axis_b().map(|axis| axis.into_inner().into())
    }

    #[getter]
    fn mass_kg(&self) -> f64 {
        self.0.model.mass_properties.mass_kg()
    }

    #[getter]
    fn inertia_b_kg_m2(&self) -> [[f64; 3]; 3] {
        let inertia = self.0.model.mass_properties.inertia_b_kg_m2();
        [0, 1, 2].map(|i| [0, 1, 2].map(|j| inertia[(i, j)]))
    }

    #[getter]
    fn gravity_offset_b_n_m(&self) -> [f64; 3] {
        (*self.0.model.mass_properties.gravity_offset_b_n_m()).into()
    }

    #[getter]
    fn effects(&self) -> BTreeMap<String, BTreeMap<String, f64>> {
        let effects = self.0.model.effects.iter();
        effects
            .map(|(id, of)| (id.clone(), of.iter().map(|(name, x)| (name.clone(), *x)).collect()))
            .collect()
    }
}
