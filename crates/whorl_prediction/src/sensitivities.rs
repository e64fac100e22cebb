//! How innovations change with the parameters of a model.

use nalgebra::DVector;

use crate::columns::Columns;
use crate::error::PredictionError;
use crate::filter::Filter;
use crate::innovations::Innovation;
use crate::noise::Noise;
use crate::other::Varied;
use crate::prepared::Prepared;
use crate::start::Start;

/// Each innovation of a recording, and how it changes with the parameters along which models were varied, per their units.
///
/// # Errors
/// A varied model that cannot be simulated.
pub fn sensitivities(
    case: &Prepared<'_>,
    noise: &Noise,
    start: &Start,
    varied: &[Varied],
    told: &mut dyn FnMut(&Innovation, &DVector<f64>),
) -> Result<(), PredictionError> {
    let columns = Columns::new(case, start.layout, false, varied, None)?;
    let mut filter = Filter::new(case, noise, start).varying(columns);
    let mut innovations = Vec::new();
    let mut latest = DVector::zeros(varied.len());
    while filter.step(&mut |innovation| innovations.push(*innovation)) {
        let Some(columns) = &filter.columns else { break };
        for (reading, innovation) in innovations.drain(..).enumerate() {
            columns.latest(reading, &mut latest);
            told(&innovation, &latest);
        }
    }
    Ok(())
}
