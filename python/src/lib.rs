//! The native part of the Python package `whorl` (`whorl._native`): thin functions over the libraries of the command line.
//!
//! Answers are the JSON of `whorl ... --json`; the Python part (`whorl/*.py`) turns them into objects. Long calls release
//! the interpreter's lock, report progress and end on Ctrl-C (`watch.rs`).

mod campaign;
mod catalogue;
mod errors;
mod estimate;
mod explain;
mod pieces;
mod platform;
mod recording;
mod simulate;
mod trends;
mod watch;

use pyo3::prelude::*;

#[pymodule]
fn _native(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    m.add("WhorlError", m.py().get_type::<errors::WhorlError>())?;
    m.add_class::<platform::Platform>()?;
    m.add_class::<recording::Recording>()?;
    m.add_class::<pieces::Allocator>()?;
    m.add_class::<campaign::Campaign>()?;
    m.add_class::<campaign::Held>()?;
    m.add_function(wrap_pyfunction!(catalogue::channels, m)?)?;
    m.add_function(wrap_pyfunction!(catalogue::effects, m)?)?;
    m.add_function(wrap_pyfunction!(catalogue::describe_effect, m)?)?;
    m.add_function(wrap_pyfunction!(catalogue::load_effect, m)?)?;
    m.add_function(wrap_pyfunction!(explain::compare, m)?)?;
    m.add_function(wrap_pyfunction!(explain::locate, m)?)?;
    m.add_function(wrap_pyfunction!(explain::diagnose, m)?)?;
    m.add_function(wrap_pyfunction!(explain::discover, m)?)?;
    m.add_function(wrap_pyfunction!(explain::adopt, m)?)?;
    m.add_function(wrap_pyfunction!(explain::identify, m)?)?;
    m.add_function(wrap_pyfunction!(trends::trends, m)?)?;
    m.add_function(wrap_pyfunction!(trends::history, m)?)?;
    m.add_function(wrap_pyfunction!(trends::calibrate_sensors, m)?)?;
    m.add_function(wrap_pyfunction!(simulate::simulate, m)?)?;
    m.add_function(wrap_pyfunction!(estimate::estimate, m)?)?;
    m.add_function(wrap_pyfunction!(pieces::orbit, m)?)?;
    m.add_function(wrap_pyfunction!(pieces::relative_motion, m)?)?;
    Ok(())
}
