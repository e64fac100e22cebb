//! Recordings as arrays.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::Vector3;
use numpy::ndarray::{ArrayView1, ArrayView2};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use whorl_bag::Channel;
use whorl_commands::runs::{RunSources, is_csv, refuse_contradictions};
use whorl_commands::tables::write_recording;
use whorl_objects::local;
use whorl_recording::{
    Circumstances, Mounting, OnInterval, ReadOptions, RecordingError, Samples, Series, platform_parts,
    read_run_with, recording_of,
};

use crate::errors::{error, refused};
use crate::platform::Platform;

/// What was measured of one platform in one run.
#[pyclass(frozen, module = "whorl._native")]
pub struct Recording {
    pub inner: Arc<whorl_recording::Recording>,
    /// The file or folder that it was read from.
    pub source: Option<PathBuf>,
}

/// Samples of one channel: key, sensor from 0, time \[s\], numbers (a row to a sample), unit, direction in the world.
type Given<'py> =
    (String, usize, PyReadonlyArray1<'py, f64>, PyReadonlyArray2<'py, f64>, Option<String>, Option<[f64; 3]>);

#[pymethods]
impl Recording {
    /// Of a run directory, a bag or a CSV file. With a platform, contradictions are refused.
    #[staticmethod]
    #[pyo3(signature = (path, platform=None, name=None, channels=None))]
    fn read(
        py: Python<'_>,
        path: PathBuf,
        platform: Option<&Bound<'_, Platform>>,
        name: Option<String>,
        channels: Option<PathBuf>,
    ) -> PyResult<Self> {
        let known = platform.map(|platform| Arc::clone(&platform.get().0));
        let source = path.clone();
        let read_here = |path: &Path| match known {
            Some(known) => {
                let sources = RunSources { runs: vec![path.to_owned()], channels, ..RunSources::default() };
                sources.recording(path, &known)
            }
            None if is_csv(path) => anyhow::bail!(
                "{}: a CSV file holds no parameters: name the platform's file, e.g. model=\"params/whorl_1.yaml\"",
                path.display()
            ),
            None => {
                let options =
                    ReadOptions { platform: name.as_deref(), channels: channels.as_deref(), model: None };
                let mut all = read_run_with(path, &options)?;
                match all.len() {
                    1 => Ok(all.remove(0)),
                    _ => {
                        let names: Vec<&str> = all.iter().map(|r| r.platform.as_str()).collect();
                        anyhow::bail!(
                            "{} holds several platforms ({}): choose one with platform=\"{}\"",
                            path.display(),
                            names.join(", "),
                            names.first().copied().unwrap_or_default()
                        )
                    }
                }
            }
        };
        let read = py.detach(move || {
            let here = local(&path)?;
            read_here(here.path())
                .map_err(|error| anyhow::Error::msg(here.told(&whorl_commands::in_words(&error))))
        });
        Ok(Self { inner: Arc::new(read.map_err(error)?), source: Some(source) })
    }

    /// Of arrays in memory.
    #[staticmethod]
    #[pyo3(signature = (samples, name, platform=None, clamped=false, closed_loop=false, jets=None))]
    fn of(
        samples: Vec<Given<'_>>,
        name: String,
        platform: Option<&Bound<'_, Platform>>,
        clamped: bool,
        closed_loop: bool,
        jets: Option<Vec<Vec<(f64, f64)>>>,
    ) -> PyResult<Self> {
        let known = platform.map(|platform| &*platform.get().0);
        let mut all = Vec::with_capacity(samples.len());
        for (key, sensor, time_s, numbers, unit, reference_world) in samples {
            let channel = channel(&key)?;
            let numbers = numbers.as_array();
            all.push(Samples {
                channel,
                sensor,
                time_s: time_s.as_array().iter().copied().collect(),
                width: numbers.ncols(),
                numbers: numbers.iter().copied().collect(),
                unit,
                reference_world: reference_world.map(Vector3::from),
            });
        }
        let interval = |(on_s, off_s): (f64, f64)| OnInterval { on_s, off_s };
        let held = clamped || known.is_some_and(|known| !known.model.freedom.turns());
        let circumstances = Circumstances {
            name,
            platform: known.map_or_else(|| "platform".to_owned(), |known| known.platform.clone()),
            mounting: if held { Mounting::Clamped } else { Mounting::OnBearing },
            closed_loop,
            jets: jets.map(|all| all.into_iter().map(|of| of.into_iter().map(interval).collect()).collect()),
        };
        let recording = recording_of(all, circumstances, known.map(|known| &known.model)).map_err(error)?;
        if let Some(known) = known {
            check(&recording, known)?;
        }
        Ok(Self { inner: Arc::new(recording), source: None })
    }

    /// Refuses the model of another platform, and channels that contradict themselves or each other.
    fn check(&self, platform: &Bound<'_, Platform>) -> PyResult<()> {
        check(&self.inner, &platform.get().0)
    }

    #[getter]
    fn name(&self) -> &str {
        &self.inner.name
    }

    #[getter]
    fn platform(&self) -> &str {
        &self.inner.platform
    }

    #[getter]
    fn source(&self) -> Option<PathBuf> {
        self.source.clone()
    }

    #[getter]
    fn duration_s(&self) -> f64 {
        self.inner.duration_s()
    }

    #[getter]
    fn clamped(&self) -> bool {
        self.inner.mounting == Mounting::Clamped
    }

    #[getter]
    fn closed_loop(&self) -> bool {
        self.inner.closed_loop
    }

    #[getter]
    fn remarks(&self) -> Vec<String> {
        self.inner.remarks.clone()
    }

    /// Channels with samples: key, sensor from 0, number of samples.
    fn sampled(&self) -> Vec<(&'static str, usize, usize)> {
        let all = self.inner.sampled();
        all.map(|(channel, sensor, series)| (channel.info().key, sensor, series.time_s().len())).collect()
    }

    /// Pulses of each jet: switched on, switched off \[s\].
    fn jet_pulses(&self) -> Vec<Vec<(f64, f64)>> {
        let pulses = self.inner.jet_pulses.iter();
        pulses.map(|of| of.iter().map(|pulse| (pulse.on_s, pulse.off_s)).collect()).collect()
    }

    fn reference_world(&self, sensor: usize) -> Option<[f64; 3]> {
        self.inner.vectors.get(sensor).map(|vector| vector.reference_world.into_inner().into())
    }

    /// Writes a Parquet file to each channel; their paths.
    fn write_parquet(
        &self,
        folder: PathBuf,
        platform: Option<&Bound<'_, Platform>>,
    ) -> PyResult<Vec<PathBuf>> {
        let names = platform.map(|platform| platform_parts(&platform.get().0)).unwrap_or_default();
        let written = write_recording(&self.inner, &names.wheels, &names.jets, &folder).map_err(error)?;
        Ok(written.into_iter().map(|table| table.path).collect())
    }

    /// Times of a channel \[s\]: the recording's own memory, not to be written to.
    fn time_s<'py>(slf: &Bound<'py, Self>, key: &str, sensor: usize) -> PyResult<Bound<'py, PyAny>> {
        let series = slf.get().inner.series(channel(key)?, sensor).ok_or_else(|| absent(key, sensor))?;
        Ok(shared_1(slf, series.time_s()))
    }

    /// Numbers of a channel: the recording's own memory where they lie side by side in it, else a copy; NaN on axes that the sensor
    /// does not have.
    fn values<'py>(slf: &Bound<'py, Self>, key: &str, sensor: usize) -> PyResult<Bound<'py, PyAny>> {
        let series = slf.get().inner.series(channel(key)?, sensor).ok_or_else(|| absent(key, sensor))?;
        if let Some(scalars) = series.as_any().downcast_ref::<Series<f64>>() {
            return Ok(shared_1(slf, &scalars.value));
        }
        let lacks = slf.get().inner.lacks(channel(key)?);
        if let Some(vectors) = series.as_any().downcast_ref::<Series<Vector3<f64>>>()
            && lacks == [false; 3]
        {
            return Ok(shared_3(slf, &vectors.value));
        }
        let rows: Vec<Vec<f64>> = (0..series.time_s().len())
            .map(|k| {
                let mut row = series.numbers(k);
                // Not measured is not zero.
                row.iter_mut().zip(lacks).filter(|(_, lacks)| *lacks).for_each(|(x, _)| *x = f64::NAN);
                row
            })
            .collect();
        Ok(PyArray2::from_vec2(slf.py(), &rows).map_err(error)?.into_any())
    }
}

fn check(recording: &whorl_recording::Recording, known: &whorl_recording::KnownPlatform) -> PyResult<()> {
    recording.check_fits(&known.model, &known.platform).map_err(error)?;
    refuse_contradictions(recording, known, &recording.name).map_err(error)
}

fn absent(key: &str, sensor: usize) -> PyErr {
    error(RecordingError::Samples {
        channel: key.to_owned(),
        reason: format!("there is no sensor {}", sensor + 1),
    })
}

/// The channel with this key.
pub fn channel(key: &str) -> PyResult<Channel> {
    Channel::find(key).ok_or_else(|| {
        let keys: Vec<&str> = Channel::ALL.iter().map(|channel| channel.info().key).collect();
        refused(format!("there is no channel {key}; allowed: {}", keys.join(", ")))
    })
}

/// An array over memory of a recording, which lives as long as the array and never changes; it cannot be written to.
fn shared_1<'py>(owner: &Bound<'py, Recording>, numbers: &[f64]) -> Bound<'py, PyAny> {
    let view = ArrayView1::from(numbers);
    // SAFETY: the numbers are in `owner`, a frozen object which the array keeps alive, and the array is read-only.
    #[expect(unsafe_code, reason = "arrays without copies")]
    let array = unsafe { PyArray1::borrow_from_array(&view, owner.clone().into_any()) };
    drop(array.readwrite().make_nonwriteable());
    array.into_any()
}

/// The same of vectors, a row each.
fn shared_3<'py>(owner: &Bound<'py, Recording>, vectors: &[Vector3<f64>]) -> Bound<'py, PyAny> {
    const { assert!(size_of::<Vector3<f64>>() == 3 * size_of::<f64>()) };
    // SAFETY: nalgebra's matrices are `repr(C)` over their array of numbers, so n vectors are 3 n numbers in a row. They are in
    // `owner`, as above.
    #[expect(unsafe_code, reason = "arrays without copies")]
    let array = unsafe {
        let view = ArrayView2::from_shape_ptr((vectors.len(), 3), vectors.as_ptr().cast::<f64>());
        PyArray2::borrow_from_array(&view, owner.clone().into_any())
    };
    drop(array.readwrite().make_nonwriteable());
    array.into_any()
}
