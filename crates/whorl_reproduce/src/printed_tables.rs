//! Which run could have given Tables 4.3 and 4.4: a sweep over what the dissertation does not print.
//!
//! Section 4.6.4 gives the body, the thrust (0.01 N m about x, reversed every 5 s), its length and step; not the attitude
//! at the start, the phase of the thrust, nor the sensors' noise. All three are swept, for both sets of sensors, and each
//! run is compared with the printed errors by
//!
//! ```text
//! distance = sqrt( mean over the nine parameters of ln(|error| / |printed error|)^2 )
//! ```
//!
//! of the torque method, errors below 0.1 % counting as that. exp(distance) is the factor by which errors differ.

use nalgebra::{Unit, UnitQuaternion, Vector3};
use whorl_dynamics::mass_parameters::{MASS_PARAMETERS, MassVector, NAMES, mass_vector};
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_identification::{Options, identify};
use whorl_math::attitude_from_vertical;
use whorl_math::statistics::median;
use whorl_recording::Recording;
use whorl_report::ReproducedPlot;

use crate::data::{level, measured, rigid_whorl_1};
use crate::regression::{Form, Method, StateSeries, Weighting, estimated_series, rows, solve};
use crate::rigid_body::simulate_rigid_body;
use crate::study::{Printed, bang_bang, quieten};

/// Noise over that of the MotionPak II.
const NOISE: [f64; 9] = [0.001, 0.003, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0];
/// Seconds by which the thrust is ahead.
const PHASES_S: [f64; 3] = [0.0, 2.5, 5.0];
/// Errors below this count as this \[%\].
const LEAST_PERCENT: f64 = 0.1;

/// How a run begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Begin {
    /// Level, which is not where it would rest.
    Level,
    /// At its balance.
    Balance,
}

/// One run of the sweep.
#[derive(Debug, Clone)]
pub struct SweptRun {
    pub begin: Begin,
    pub phase_s: f64,
    pub vector: bool,
    pub noise: f64,
    /// Of the torque method \[%\].
    pub errors_percent: MassVector,
    recording: Recording,
    sensors: PlatformModel,
}

/// All runs.
pub fn sweep() -> Vec<SweptRun> {
    let body = rigid_whorl_1(true);
    let truth = mass_vector(&body.mass_properties);
    let up = Unit::new_normalize(-body.mass_properties.gravity_offset_b_n_m());
    let balance = attitude_from_vertical(up, 0.0);
    let mut runs = Vec::new();
    for (begin, start) in [(Begin::Level, level()), (Begin::Balance, balance)] {
        for phase_s in PHASES_S {
            let thrust = move |t: f64| bang_bang(t + phase_s);
            let motion =
                simulate_rigid_body(&body.mass_properties, (start, Vector3::zeros()), &thrust, 0.1, 1001, 20);
            for vector in [true, false] {
                for noise in NOISE {
                    let mut sensors = rigid_whorl_1(vector);
                    quieten(&mut sensors, noise);
                    let recording = measured(&motion, &sensors, 7, 1);
                    let Ok(series) = estimated_series(&recording, &sensors, 0.1) else { continue };
                    let system = rows(&series, Method::Torque, Form::Integrated);
                    let Ok(found) = solve(&system, Weighting::PseudoInverse) else { continue };
                    let errors_percent =
                        MassVector::from_fn(|i, _| 100.0 * (found.estimate[i] - truth[i]) / truth[i].abs());
                    runs.push(SweptRun { begin, phase_s, vector, noise, errors_percent, recording, sensors });
                }
            }
        }
    }
    runs
}

/// Largest angle of body z from where it points in `from` \[deg\].
pub fn tilt_deg(motion: &StateSeries, from: &UnitQuaternion<f64>) -> f64 {
    let up = from.inverse() * Vector3::z();
    let angle = |q: &UnitQuaternion<f64>| (q.inverse() * Vector3::z()).angle(&up).to_degrees();
    motion.samples.iter().map(|s| angle(&s.q_world_body)).fold(0.0, f64::max)
}

impl SweptRun {
    /// See the module.
    pub fn distance(&self, printed: &Printed) -> f64 {
        let squares = (0..MASS_PARAMETERS).map(|i| {
            let wanted: f64 = printed[i][1].parse().unwrap_or(f64::NAN);
            (self.errors_percent[i].abs().max(LEAST_PERCENT) / wanted.abs().max(LEAST_PERCENT)).ln().powi(2)
        });
        (squares.sum::<f64>() / MASS_PARAMETERS as f64).sqrt()
    }

    /// Worst error of the likelihood method on the same recording, for what it was excited to find: I_xx, I_xy, I_yy and the
    /// gravity offset \[%\].
    fn worst_by_likelihood(&self) -> Option<f64> {
        let truth = mass_vector(&self.sensors.mass_properties);
        let mut loose = ModelPrior::typical(&self.sensors);
        loose.inertia_b_kg_m2 *= 10.0;
        loose.gravity_offset_b_n_m *= 10.0;
        let found =
            identify(std::slice::from_ref(&self.recording), &self.sensors, &loose, &Options::default())
                .ok()?;
        let excited = [0, 1, 3, 6, 7, 8];
        Some(
            excited
                .iter()
                .map(|i| 100.0 * ((found.estimate[*i] - truth[*i]) / truth[*i]).abs())
                .fold(0.0, f64::max),
        )
    }

    fn describe(&self) -> String {
        let begin = if self.begin == Begin::Level { "level" } else { "at rest at its balance" };
        let sensors = if self.vector { "two vectors" } else { "the accelerometer alone" };
        format!(
            "begins {begin} with the thrust {} s ahead, has {sensors} and {} times the MotionPak's noise",
            self.phase_s, self.noise
        )
    }
}

/// Sentences on the run nearest to a printed table, all computed.
pub fn sentences(runs: &[SweptRun], printed: &Printed, name: &str, stated_vector: bool) -> Vec<String> {
    let nearest = |vector: Option<bool>| {
        let of = runs.iter().filter(|r| vector.is_none_or(|v| r.vector == v));
        of.min_by(|a, b| a.distance(printed).total_cmp(&b.distance(printed)))
    };
    let (Some(any), Some(stated)) = (nearest(None), nearest(Some(stated_vector))) else { return Vec::new() };
    let errors = |run: &SweptRun| {
        (0..MASS_PARAMETERS)
            .map(|i| format!("{} {:.3}", NAMES[i], run.errors_percent[i].abs()))
            .collect::<Vec<_>>()
            .join(", ")
    };
    let factor = |run: &SweptRun| run.distance(printed).exp();
    let reproduces = |run: &SweptRun| if factor(run) < 2.0 { "reproduces" } else { "does not reproduce" };
    let mut sentences = vec![format!(
        "Of {} runs over what is not printed (start, phase of the thrust, noise, sensors), the nearest with the sensors that {name} states {}: it {} the printed errors, a factor of {:.1} apart; |error| [%]: {}.",
        runs.len(),
        stated.describe(),
        reproduces(stated),
        factor(stated),
        errors(stated)
    )];
    if any.vector != stated.vector {
        sentences.push(format!(
            "The nearest with any sensors {}: it {} them, a factor of {:.1} apart; |error| [%]: {}. {}",
            any.describe(),
            reproduces(any),
            factor(any),
            errors(any),
            if factor(any) < 2.0 && factor(any) < 0.7 * factor(stated) {
                "The printed errors are those of data in which the rate about the vertical was not excited and not measured well."
            } else {
                "Neither explains the printed numbers."
            }
        ));
    }
    if let Some(worst) = stated.worst_by_likelihood() {
        sentences.push(format!(
            "On that very recording the likelihood method finds I_xx, I_xy, I_yy and the gravity offset within {worst:.2} %: what is lost is lost by the regression, not in the data."
        ));
    }
    sentences
}

/// Errors over the noise, for each start and set of sensors: of the excited parameters and of I_zz.
pub fn plots(runs: &[SweptRun]) -> Vec<ReproducedPlot> {
    let curves = |of: &dyn Fn(&SweptRun) -> f64| {
        let mut curves = Vec::new();
        for (begin, what) in [(Begin::Level, "level"), (Begin::Balance, "at balance")] {
            for (vector, sensors) in [(true, "two vectors"), (false, "accelerometer alone")] {
                let points = NOISE.map(|noise| {
                    let same =
                        runs.iter().filter(|r| r.begin == begin && r.vector == vector && r.noise == noise);
                    (noise, median(same.map(of)))
                });
                curves.push((
                    format!("{what}, {sensors}"),
                    points.into_iter().filter(|p| p.1.is_finite()).collect(),
                ));
            }
        }
        curves
    };
    let plot = |title: &str, curves| ReproducedPlot {
        title: title.to_owned(),
        caption: "Torque method on filtered data; median over three phases of the thrust.".to_owned(),
        labels: ["noise [of the MotionPak II]".to_owned(), "|error| [%]".to_owned()],
        logarithmic: [true, true],
        curves,
        ..ReproducedPlot::default()
    };
    let excited = |r: &SweptRun| median([0, 1, 3, 6, 7, 8].map(|i: usize| r.errors_percent[i].abs()));
    vec![
        plot("median error of I_xx, I_xy, I_yy and the gravity offset", curves(&excited)),
        plot("error of I_zz", curves(&|r| r.errors_percent[5].abs())),
    ]
}
