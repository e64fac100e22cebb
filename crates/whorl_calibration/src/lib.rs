//! Calibration of gyro and accelerometer (section 4.4).
//! The sensor (or the platform) lies still in several orientations and is turned between them; no angles need be known. Still stretches are
//! found in the data. Of the accelerometer they show bias, scale and the angles between its axes by the length of gravity, and
//! misalignment by the faces it lay on, as exactly as the table was level. Of the gyro they show the bias; scale, misalignment and what its axes
//! see of each other are those by which turns carry the direction of gravity before to that after, and known angles about the vertical,
//! which gravity does not show. Noise is by the Allan deviation of the longest still stretch.
//!
//! Errors are those of [`whorl_dynamics::platform::TriaxialErrors`], with axes that need not be at right angles:
//! y = (1 + s) T R(m)^T x + b. Deviations grow with the misfit, which is tested ([`Misfit`]). What the data do not determine is said in a sentence.

mod fit;
mod sensors;
#[cfg(test)]
mod tests;

use nalgebra::Vector3;
use whorl_dynamics::platform::SensorSuite;
use whorl_math::{allan_deviation, noise_densities};
use whorl_recording::{Finding, Recording, Still, still_stretches, usual_rate_hz};

pub use fit::Misfit;

/// Points of the Allan deviation in a decade of averaging times.
const PER_DECADE: usize = 8;
/// Shorter still stretches do not show bias instability and random walk \[s\].
const SHORT_S: f64 = 60.0;

/// What is known from outside.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationSettings {
    /// How level each face lay, standard deviation \[rad\]; the dissertation reports 0.5 deg.
    pub level_stddev_rad: f64,
    /// Turns about the vertical were by multiples of this angle \[rad\]; `None`: not known.
    pub known_turn_rad: Option<f64>,
    /// How exactly they were \[rad\].
    pub turn_stddev_rad: f64,
    /// Gravity where it was recorded [m/s^2]; `None`: estimated, with its range over the Earth.
    pub gravity_m_s2: Option<f64>,
}

impl Default for CalibrationSettings {
    fn default() -> Self {
        let [level_stddev_rad, turn_stddev_rad] = [0.5, 0.3].map(f64::to_radians);
        Self { level_stddev_rad, known_turn_rad: None, turn_stddev_rad, gravity_m_s2: None }
    }
}

/// A number per axis with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PerAxis {
    /// Value.
    pub value: Vector3<f64>,
    /// Standard deviation; infinite: not determined, the value is then zero.
    pub stddev: Vector3<f64>,
}

impl Default for PerAxis {
    /// Nothing is known.
    fn default() -> Self {
        Self { value: Vector3::zeros(), stddev: Vector3::repeat(f64::INFINITY) }
    }
}

impl PerAxis {
    /// Axes that were determined.
    pub fn determined(&self) -> [bool; 3] {
        self.stddev.map(f64::is_finite).into()
    }

    /// The finding that a quantity was not determined about some axes; `advice`: what would.
    fn missing(&self, what: &str, advice: &str) -> Option<Finding> {
        let axes = ["x", "y", "z"].into_iter().zip(self.determined()).filter(|(_, known)| !known);
        let axes = axes.map(|(axis, _)| axis).collect::<Vec<_>>().join(", ");
        let text = format!("{what} not determined about {axes}: {advice}.");
        (!axes.is_empty()).then(|| Finding::warning(text))
    }

    fn set(&mut self, axis: usize, value: f64, stddev: f64) {
        (self.value[axis], self.stddev[axis]) = (value, stddev);
    }
}

/// Calibration of one three-axis sensor; by default nothing is known.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SensorCalibration {
    /// Bias, in the sensor's unit.
    pub bias: PerAxis,
    /// Scale error \[1\].
    pub scale: PerAxis,
    /// Rotation from body to sensor axes \[rad\].
    pub misalignment_rad: PerAxis,
    /// What y sees of x, z of x and z of y: axes that are not at right angles \[rad\].
    pub skew_rad: PerAxis,
    /// Residuals of the fit; `None`: nothing was fitted.
    pub misfit: Option<Misfit>,
    /// White noise of one sample.
    pub noise_stddev: PerAxis,
    /// White noise, per sqrt(Hz), by the Allan deviation.
    pub noise_density: PerAxis,
    /// Random walk of the bias, per sqrt(s), where it rises out of the white noise.
    pub bias_walk: PerAxis,
    /// The lowest Allan deviation, where averaging longer does not help any more.
    pub bias_instability: PerAxis,
}

/// A quantity that is calibrated, for tables and files.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantity {
    /// Name in data.
    pub key: &'static str,
    /// Name for people.
    pub name: &'static str,
    /// Unit, "1" for none.
    pub unit: String,
    /// What ends its key in parameter files; `None`: they do not have it.
    pub ending: Option<String>,
    /// What was found.
    pub of: PerAxis,
}

impl SensorCalibration {
    /// Everything that has a number per axis; `unit`: the sensor's.
    pub fn quantities(&self, unit: &str) -> [Quantity; 8] {
        // rad/s is _rad_s in files.
        let own = format!("_{}", unit.replace('/', "_").replace('^', ""));
        let row = |key, name, of: &PerAxis, unit: &str, ending: Option<&str>| Quantity {
            key,
            name,
            unit: unit.to_owned(),
            ending: ending.map(|ending| ending.replace("_unit", &own)),
            of: *of,
        };
        let skew = "skew: y of x, z of x, z of y";
        let [density, walk] = ["sqrt(Hz)", "sqrt(s)"].map(|per| format!("{unit}/{per}"));
        [
            row("bias", "bias", &self.bias, unit, Some("_unit")),
            row("scale", "scale", &self.scale, "1", Some("")),
            row("misalignment", "misalignment", &self.misalignment_rad, "rad", Some("_rad")),
            row("skew", skew, &self.skew_rad, "rad", Some("_rad")),
            row("noise_stddev", "noise of a sample", &self.noise_stddev, unit, Some("_unit")),
            row("noise_density", "noise density", &self.noise_density, &density, None),
            row("bias_instability", "bias instability", &self.bias_instability, unit, None),
            row("bias_walk", "bias random walk", &self.bias_walk, &walk, Some("_unit_sqrt_s")),
        ]
    }

    fn take_noise_of(&mut self, samples: &[Vector3<f64>], sample_time_s: f64) {
        for axis in 0..3 {
            let values: Vec<f64> = samples.iter().map(|v| v[axis]).collect();
            let curve = allan_deviation(&values, sample_time_s, PER_DECADE);
            // From neighbours, so that a drifting bias does not count as noise.
            if let Some(sample) = curve.first().filter(|sample| sample.deviation > 0.0) {
                self.noise_stddev.set(axis, sample.deviation, sample.deviation * sample.relative_error);
            }
            let Some(found) = noise_densities(&curve) else { continue };
            self.noise_density.set(axis, found.white, found.white_stddev);
            if found.walk_seen {
                self.bias_walk.set(axis, found.walk, found.walk_stddev);
            }
            if found.floor_seen {
                self.bias_instability.set(axis, found.floor, found.floor_stddev);
            }
        }
    }
}

/// Calibration of gyro and accelerometer.
#[derive(Debug, Clone, PartialEq)]
pub struct ImuCalibration {
    /// Gyro [rad/s].
    pub gyro: SensorCalibration,
    /// Accelerometer [m/s^2].
    pub accelerometer: SensorCalibration,
    /// How many still stretches were found.
    pub still_stretches: usize,
    /// Sample rate \[Hz\].
    pub rate_hz: f64,
    /// Parameters that the data could not determine, and other remarks.
    pub findings: Vec<Finding>,
}

impl ImuCalibration {
    /// Name, unit and calibration of both sensors.
    pub fn sensors(&self) -> [(&'static str, &'static str, &SensorCalibration); 2] {
        [("gyro", "rad/s", &self.gyro), ("accelerometer", "m/s^2", &self.accelerometer)]
    }
}

/// Calibrates from recordings; the noise of `imu` is assumed where still stretches are looked for.
pub fn calibrate_imu(runs: &[&Recording], imu: &SensorSuite, known: &CalibrationSettings) -> ImuCalibration {
    let (mut findings, mut still) = (Vec::new(), Vec::<Still<'_>>::new());
    for run in runs {
        if run.has_whole_gyro() && run.has_whole_accelerometer() {
            still.extend(still_stretches(run, imu));
        } else {
            findings.push(Finding::fatal(format!(
                "{}: gyro and accelerometer need all three axes: which way is up at each rest, and the turn from one to the next, \
                 follow from all of them. Nothing was calibrated.",
                run.name
            )));
        }
    }
    if still.is_empty() && findings.is_empty() {
        findings.push(Finding::fatal(
            "No still stretch of two seconds was found: the sensor must lie still between turns. Nothing was calibrated.".to_owned(),
        ));
    }
    let (mut gyro, mut accelerometer) = (SensorCalibration::default(), SensorCalibration::default());
    let rate_hz = runs.iter().filter_map(|run| usual_rate_hz(&run.gyro_b_rad_s.time_s)).fold(0.0, f64::max);
    if let Some(longest) = still.iter().max_by(|a, b| a.duration_s().total_cmp(&b.duration_s())) {
        accelerometer = sensors::accelerometer(&still, known, &mut findings);
        gyro = sensors::gyro(&still, &accelerometer, known, &mut findings);
        gyro.take_noise_of(longest.gyro.samples, 1.0 / rate_hz);
        accelerometer.take_noise_of(longest.force.samples, 1.0 / rate_hz);
        if longest.duration_s() < SHORT_S {
            findings.push(Finding::warning(format!(
                "The longest still stretch is {:.0} s: noise was measured, bias instability and random walk need ten minutes or more.",
                longest.duration_s()
            )));
        }
    }
    ImuCalibration { gyro, accelerometer, still_stretches: still.len(), rate_hz, findings }
}
