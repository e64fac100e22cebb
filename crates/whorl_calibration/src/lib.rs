//! Calibration of gyro and accelerometer (section 4.4).
//!
//! The sensor (or the platform) lies still in several orientations and is turned between them; no angles
//! need be known. Still stretches are found in the data. Then
//!
//! - accelerometer: bias, scale and the angles between its axes from the length of gravity in each position, misalignment from the
//!   faces it lay on, as exactly as the table was level;
//! - gyro: bias from still stretches; scale, misalignment and what its axes see of each other from turns, which must carry the direction of
//!   gravity before to that after, and by known angles about the vertical, which gravity does not show;
//! - noise from the Allan deviation of the longest still stretch; its distribution by the chi-squared
//!   test (eqs. 4.41-4.43);
//! - dependence on temperature, if the temperature changed enough.
//!
//! Errors are those of [`whorl_dynamics::platform::TriaxialErrors`], with axes that need not be at right angles:
//! y = (1 + s) T R(m)^T x + b. Deviations grow with the misfit, which is tested ([`Misfit`]). Every number has a standard deviation, and what the data do not determine is
//! said in a sentence.

mod accelerometer;
mod fit;
mod gaussianity;
mod gyro;
mod still;
mod temperature;
#[cfg(test)]
mod tests;

use nalgebra::Vector3;
use whorl_dynamics::platform::SensorSuite;
use whorl_math::{NoiseDensities, allan_deviation, noise_densities};
use whorl_recording::{Finding, Recording};

pub use fit::Misfit;
pub use gaussianity::{Bin, Gaussianity, chi_squared_test};
pub use still::{Still, still_stretches};

/// Points of the Allan deviation in a decade of averaging times.
const PER_DECADE: usize = 8;

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
        Self {
            level_stddev_rad: 0.5_f64.to_radians(),
            known_turn_rad: None,
            turn_stddev_rad: 0.3_f64.to_radians(),
            gravity_m_s2: None,
        }
    }
}

/// A number per axis with its standard deviation; infinite where it is not determined.
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
    #[must_use]
    pub fn determined(&self) -> [bool; 3] {
        self.stddev.map(f64::is_finite).into()
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
    /// White noise of one sample per axis.
    pub noise_stddev: Vector3<f64>,
    /// Its standard deviation.
    pub noise_stddev_stddev: Vector3<f64>,
    /// Noise densities per axis from the Allan deviation; `None`: no still stretch was long enough.
    pub noise: [Option<NoiseDensities>; 3],
    /// Is the noise Gaussian? Per axis.
    pub gaussianity: [Option<Gaussianity>; 3],
    /// Change of the bias with temperature, per kelvin.
    pub temperature_slope: PerAxis,
}

/// Calibration of gyro and accelerometer.
#[derive(Debug, Clone, PartialEq)]
pub struct ImuCalibration {
    /// Gyro [rad/s].
    pub gyro: SensorCalibration,
    /// Accelerometer [m/s^2].
    pub accelerometer: SensorCalibration,
    /// Still stretches found.
    pub still: Vec<Still>,
    /// Sample rate \[Hz\].
    pub rate_hz: f64,
    /// Parameters that the data could not determine, and other remarks.
    pub findings: Vec<Finding>,
}

/// Calibrates from recordings; `sensors` gives the prior assumptions (noise for the search of still
/// stretches).
#[must_use]
pub fn calibrate_imu(
    runs: &[&Recording],
    sensors: &SensorSuite,
    settings: &CalibrationSettings,
) -> ImuCalibration {
    let mut findings = Vec::new();
    let is_whole = |run: &Recording| run.has_whole_gyro() && run.has_whole_accelerometer();
    for run in runs.iter().filter(|run| !is_whole(run)) {
        findings.push(Finding::fatal(format!(
            "{}: gyro and accelerometer need all three axes: which way is up at each rest, and the turn from one to the next, \
             follow from all of them. {} Nothing was calibrated.",
            run.name,
            axes_there(run)
        )));
    }
    let still: Vec<Still> = runs
        .iter()
        .enumerate()
        .filter(|(_, run)| is_whole(run))
        .flat_map(|(index, run)| still_stretches(index, run, sensors))
        .collect();
    if still.is_empty() && findings.is_empty() {
        findings.push(Finding::fatal(
            "No still stretch of two seconds was found: the sensor must lie still between turns. Nothing was calibrated.".to_owned(),
        ));
    }
    let mut accelerometer = accelerometer::calibrate(&still, settings, &mut findings);
    let mut gyro = gyro::calibrate(runs, &still, &accelerometer, settings, &mut findings);
    let rate_hz = runs.iter().map(|r| rate_hz(r)).fold(0.0, f64::max);
    let longest = still.iter().max_by(|a, b| a.duration_s().total_cmp(&b.duration_s()));
    if let Some(longest) = longest {
        if let Some(run) = runs.get(longest.run) {
            let g = longest.of(&run.gyro_b_rad_s);
            let a = longest.of(&run.specific_force_b_m_s2);
            noise_of(&mut gyro, &g, 1.0 / rate_hz, "gyro", &mut findings);
            noise_of(&mut accelerometer, &a, 1.0 / rate_hz, "accelerometer", &mut findings);
        }
        if longest.duration_s() < 60.0 {
            findings.push(Finding::warning(format!(
                "The longest still stretch is {:.0} s: noise was measured, bias instability and random walk need ten minutes or more.",
                longest.duration_s()
            )));
        }
    }
    temperature::slopes(runs, &still, &mut gyro, &mut accelerometer, &mut findings);
    ImuCalibration { gyro, accelerometer, still, rate_hz, findings }
}

/// Which axes a run has, in a sentence.
fn axes_there(run: &Recording) -> String {
    let of = |what: &str, axes: [bool; 3], is_empty: bool| {
        let there = ["x", "y", "z"].into_iter().zip(axes).filter(|(_, has)| *has && !is_empty);
        let there: Vec<&str> = there.map(|(axis, _)| axis).collect();
        if there.is_empty() { format!("no {what}") } else { format!("{what} {}", there.join(", ")) }
    };
    format!(
        "The recording has: {}; {}.",
        of("gyro", run.gyro_axes(), run.gyro_b_rad_s.is_empty()),
        of("accelerometer", run.force_axes(), run.specific_force_b_m_s2.is_empty())
    )
}

fn rate_hz(run: &Recording) -> f64 {
    let t = &run.gyro_b_rad_s.time_s;
    match (t.first(), t.last()) {
        (Some(first), Some(last)) if last > first => (t.len() - 1) as f64 / (last - first),
        _ => 0.0,
    }
}

fn noise_of(
    sensor: &mut SensorCalibration,
    samples: &[Vector3<f64>],
    sample_time_s: f64,
    what: &str,
    findings: &mut Vec<Finding>,
) {
    let mut not_gaussian = Vec::new();
    for axis in 0..3 {
        let values: Vec<f64> = samples.iter().map(|v| v[axis]).collect();
        let curve = allan_deviation(&values, sample_time_s, PER_DECADE);
        sensor.noise[axis] = noise_densities(&curve);
        // From neighbours, so that a drifting bias does not count as noise.
        if let Some(sample) = curve.first() {
            sensor.noise_stddev[axis] = sample.deviation;
            sensor.noise_stddev_stddev[axis] = sample.deviation * sample.relative_error;
        }
        sensor.gaussianity[axis] = chi_squared_test(&values, 0.01);
        if sensor.gaussianity[axis].as_ref().is_some_and(|g| !g.passes()) {
            not_gaussian.push(["x", "y", "z"][axis]);
        }
    }
    if !not_gaussian.is_empty() {
        findings.push(Finding::warning(format!(
            "Noise of the {what} about {} does not pass the chi-squared test for a normal distribution at 1 %: coarse digits, drift or vibration.",
            not_gaussian.join(", ")
        )));
    }
}
