//! What a calibration found, as entries of the platform's parameter file.

use whorl_calibration::ImuCalibration;
use whorl_params::changes::{Change, measured};

/// Entries for every quantity that a calibration has determined on all axes, with its standard deviations.
#[must_use]
pub fn of_calibration(found: &ImuCalibration) -> Vec<Change> {
    let mut all = Vec::new();
    for (name, unit, sensor) in found.sensors() {
        for of in sensor.quantities(unit).iter().filter(|of| of.of.determined() == [true; 3]) {
            let Some(ending) = &of.ending else { continue };
            let (key, found) = (format!("sensors.{name}.{}{ending}", of.key), &of.of);
            let [value, stddev] = [&found.value, &found.stddev].map(|of| of.as_slice());
            all.extend(measured(key, &of.unit, value, stddev, "calibrated"));
        }
    }
    all
}
