//! Mass properties from the motion itself: the equations of motion integrated between samples,
//! residuals weighted with the sensors' noise (a Markov estimate).
//!
//! The regressions of eqs. 4.77-4.91 put measured rates into the matrix, so noise there biases the
//! result towards zero. Here rate and attitude at one instant every two seconds are unknowns like the
//! nine parameters; the equations of motion carry them to the next ([`super::trajectory`] states them in
//! its private `dynamics` module), and gyro, accelerometer, vector sensors and wheel speeds are compared
//! with what they should read. Sensor biases, parameters of the model's effects and errors of wheels and jets are
//! estimated with their priors, so that the uncertainty of the result includes them. Torque that
//! nothing explains is white noise between the states; its strength is chosen by the data.
//!
//! Every effect that the model has is in the equations. Its parameters are unknowns too, as far as the prior leaves
//! them open, so their uncertainty enters that of the mass properties. Effects with states of their own
//! are left out and reported.
//!
//! Heading enters only through the vector sensors and in effects that depend on it: without them only the direction of
//! gravity and the rates count.
//!
//! Source of the method: H. G. Bock, "Recent advances in parameter identification techniques for ODE",
//! 1983 (multiple shooting); A. E. Bryson and M. Frazier, 1963 (smoothing with process noise).

mod dynamics;
mod fit;
mod segment;
mod smoother;
mod start;
mod unknowns;
mod updated;

use nalgebra::{DMatrix, Vector3};
use whorl_dynamics::{Gyrostat, ModelPrior, PlatformModel};
use whorl_recording::Recording;

use crate::data::{DataError, Finding, PreparedData, prepare};
use crate::mass_parameters::{
    MASS_PARAMETERS, MassCovariance, MassVector, NAMES, inertia_b_kg_m2, mass_vector,
};
use crate::realisability::{nearest_realisable, smallest_density_moment_kg_m2};
pub(crate) use dynamics::{Motion, Physics};
use fit::{Fitted, Problem, mean_biases};
pub(crate) use segment::Noise;
pub(crate) use unknowns::Unknowns;
pub use updated::UpdateError;

/// How a fit is made.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Samples are averaged over about this long \[s\]; shorter than a tenth of the fastest motion.
    pub step_s: f64,
    /// Unexplained torque, as white noise [N m sqrt(s)]; `None`: the data choose.
    pub torque_noise_n_m_sqrt_s: Option<f64>,
    /// Whether the signs of the wheels' speeds are checked by a fit of their own.
    pub check_wheels: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self { step_s: 0.05, torque_noise_n_m_sqrt_s: None, check_wheels: true }
    }
}

/// Whether and how well one of the nine parameters was determined.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Determined {
    /// Determined by the data: uncertainty below half the prior's.
    Yes,
    /// A little: below 0.9 of the prior's.
    Hardly,
    /// The value is the prior's.
    No,
}

/// A parameter of an effect that was fitted beside the mass properties.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectParameter {
    /// Id of the effect.
    pub effect: &'static str,
    /// Name of the parameter.
    pub name: String,
    /// Its unit.
    pub unit: &'static str,
    /// Value, within the parameter's range.
    pub value: f64,
    /// Standard deviation.
    pub stddev: f64,
}

/// Identified mass properties with their uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct Identification {
    /// The nine parameters, realisable.
    pub estimate: MassVector,
    /// Their covariance, including the uncertainty of the actuators.
    pub covariance: MassCovariance,
    /// Standard deviations if wheels and jets were exactly as the model says.
    pub stddev_known_actuators: MassVector,
    /// Standard deviations before the fit.
    pub prior_stddev: MassVector,
    /// Whether each was determined by these data.
    pub determined: [Determined; MASS_PARAMETERS],
    /// Singular values of the data's information in units of the prior's: below one, that combination of
    /// parameters is known from the prior rather than from the data. Descending.
    pub singular_values: MassVector,
    /// The combinations that belong to the singular values, as columns, in units of the prior's
    /// standard deviations.
    pub combinations: MassCovariance,
    /// Parameters of effects: those of the model, and those that every fit includes.
    pub effects: Vec<EffectParameter>,
    /// Strength of each wheel over the model's, less one, with standard deviation.
    pub wheel_strength: Vec<(f64, f64)>,
    /// Strength of each jet that fired over the model's, less one: index, value, standard deviation.
    pub jet_strength: Vec<(usize, f64, f64)>,
    /// Mean gyro bias over the runs [rad/s].
    pub gyro_bias_rad_s: Vector3<f64>,
    /// Mean accelerometer bias over the runs [m/s^2].
    pub accelerometer_bias_m_s2: Vector3<f64>,
    /// Unexplained torque [N m sqrt(s)].
    pub torque_noise_n_m_sqrt_s: f64,
    /// Mean squared residual over the noise's variance: 1 for a model that explains the data.
    pub reduced_chi_squared: f64,
    /// Time used \[s\].
    pub duration_s: f64,
    /// Whether the least-squares solution itself was impossible for a rigid body and was moved to the
    /// nearest possible one.
    pub moved_to_realisable: bool,
    /// Notes for the user, most important first.
    pub findings: Vec<Finding>,
}

impl Identification {
    /// Whether the result may be used, that is, no finding is fatal.
    #[must_use]
    pub fn usable(&self) -> bool {
        !self.findings.iter().any(|f| f.fatal)
    }

    /// Standard deviations of the nine parameters.
    #[must_use]
    pub fn stddev(&self) -> MassVector {
        self.covariance.diagonal().map(f64::sqrt)
    }
}

/// Identifies mass properties from runs of one platform, starting from its model and prior.
///
/// # Errors
/// When runs cannot be used at all, or the fit fails; a result that must not be used is returned with
/// its reasons ([`Identification::usable`]).
pub fn identify(
    runs: &[&Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    settings: &Settings,
) -> Result<Identification, DataError> {
    let data = prepare(runs, model, settings.step_s)?;
    let unknowns = Unknowns::new(model, prior, jets_that_fired(&data));
    let mut findings = data.findings.clone();
    findings.extend(unknowns.left_out.iter().map(|id| {
        Finding::warning(format!(
            "{id} has states of its own, which are not followed here: what it does counts as torque that nothing explains, or as inertia."
        ))
    }));
    // Sensors and actuators as the model's effects make them.
    let corrected = Gyrostat::new(model).map_err(|error| DataError::Model(error.to_string()))?;
    let corrected = corrected.model();
    let first = settings.torque_noise_n_m_sqrt_s.unwrap_or(1e-3);
    if settings.check_wheels {
        findings.extend(check_wheels(corrected, &data, &unknowns, first));
    }
    let mut fitted = {
        let problem = Problem::new(corrected, &data, unknowns.clone(), first);
        problem.solve(problem.start()).map_err(|error| match findings.iter().find(|f| f.fatal) {
            // A more specific reason than "it did not converge".
            Some(finding) => DataError::Refused(finding.text.clone()),
            None => error,
        })?
    };
    let mut torque_noise = first;
    if settings.torque_noise_n_m_sqrt_s.is_none() {
        for candidate in [1e-2, 3e-4, 1e-4, 3e-5] {
            let problem = Problem::new(corrected, &data, unknowns.clone(), candidate);
            match problem.solve(fitted.solution.clone()) {
                Ok(better) if better.surprise < fitted.surprise => {
                    fitted = better;
                    torque_noise = candidate;
                }
                // Below the best the curve only falls off: no need to go on.
                _ if candidate < 1e-3 => break,
                _ => {}
            }
        }
    }
    Ok(conclude(model, &data, &unknowns, &fitted, torque_noise, findings))
}

/// What recordings would determine if their motion were exactly the model's: the covariance that
/// [`identify`] reaches, without fitting. `data` is usually a simulation of a planned experiment with the
/// model itself as truth.
///
/// # Errors
/// When the recordings cannot be used at all.
pub fn predict(
    runs: &[&Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    settings: &Settings,
) -> Result<Identification, DataError> {
    let settings = Settings {
        check_wheels: false,
        torque_noise_n_m_sqrt_s: Some(settings.torque_noise_n_m_sqrt_s.unwrap_or(3e-4)),
        ..settings.clone()
    };
    identify(runs, model, prior, &settings)
}

fn jets_that_fired(data: &PreparedData) -> Vec<usize> {
    let points = || data.chains.iter().flat_map(|c| &c.points);
    let count = points().map(|p| p.jet_share.len()).max().unwrap_or(0);
    (0..count).filter(|j| points().any(|p| p.jet_share.get(*j).is_some_and(|s| *s > 0.0))).collect()
}

/// A wheel counts as used when its momentum changed by more than this [N m s].
const WHEEL_USED_N_M_S: f64 = 0.02;
/// Freedom of a wheel's strength while its sign is checked.
const LOOSE_STRENGTH: f64 = 2.0;

/// Frees the wheels' strengths, with the inertia held near the model, and looks at their signs.
fn check_wheels(
    model: &PlatformModel,
    data: &PreparedData,
    unknowns: &Unknowns,
    torque_noise: f64,
) -> Vec<Finding> {
    let mut loose = unknowns.clone();
    let used: Vec<usize> =
        (0..model.wheels().len()).filter(|j| momentum_range(model, data, *j) > WHEEL_USED_N_M_S).collect();
    for j in &used {
        loose.stddev[unknowns.wheel_strength(*j)] = LOOSE_STRENGTH;
    }
    let problem = Problem::new(model, data, loose, torque_noise);
    let Ok(fitted) = problem.solve(problem.start()) else {
        return Vec::new();
    };
    let Some(factor) = fitted.information.clone().cholesky() else { return Vec::new() };
    let covariance = factor.inverse();
    let mut findings = Vec::new();
    for j in used {
        let at = unknowns.wheel_strength(j);
        let (share, stddev) = (1.0 + fitted.solution.values[at], covariance[(at, at)].sqrt());
        let name = model.wheels().get(j).map_or("", |w| w.name.as_str());
        if share < -3.0 * stddev && stddev < 0.3 {
            findings.push(Finding::fatal(format!(
                "{name} turns the body the wrong way: its strength comes out as {share:.2} +- {stddev:.2} of the model's. The sign of its measured speed or of its spin axis in the model is wrong; nothing else can be trusted until that is mended."
            )));
        } else if (share - 1.0).abs() > (5.0 * stddev).max(0.3) && stddev < 0.3 {
            findings.push(Finding::fatal(format!(
                "{name} has {share:.2} +- {stddev:.2} of the strength that the model gives it: its spin inertia, the unit of its speed, or the platform's inertia is far off."
            )));
        }
    }
    findings
}

fn momentum_range(model: &PlatformModel, data: &PreparedData, wheel: usize) -> f64 {
    let inertia = model.wheels().get(wheel).map_or(0.0, |w| w.spin_inertia_kg_m2);
    let speeds = data.chains.iter().flat_map(|c| &c.points).filter_map(|p| p.wheel_speed_rad_s.get(wheel));
    let (low, high) =
        speeds.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), s| (low.min(*s), high.max(*s)));
    ((high - low) * inertia).max(0.0)
}

fn conclude(
    model: &PlatformModel,
    data: &PreparedData,
    unknowns: &Unknowns,
    fitted: &Fitted,
    torque_noise_n_m_sqrt_s: f64,
    mut findings: Vec<Finding>,
) -> Identification {
    let values = &fitted.solution.values;
    let freedom = (fitted.residuals - unknowns.len() as f64).max(1.0);
    let reduced = fitted.cost / freedom;
    // A model that explains the data badly is also less certain than its covariance.
    let inflation = reduced.max(1.0) * (1.0 + fitted.unsettled.powi(2));
    let covariance_all = inverse(&fitted.information) * inflation;
    let known = fitted.information.view((0, 0), (unknowns.actuators, unknowns.actuators)).into_owned();
    let covariance_known = inverse(&known) * inflation;
    let take = |m: &DMatrix<f64>| MassCovariance::from_fn(|i, j| m[(i, j)]);
    let covariance = take(&covariance_all);
    let prior_stddev = MassVector::from_fn(|i, _| unknowns.stddev[i]);
    let stddev = covariance.diagonal().map(f64::sqrt);
    let determined: [Determined; MASS_PARAMETERS] =
        std::array::from_fn(|i| match stddev[i] / prior_stddev[i] {
            share if share < 0.5 => Determined::Yes,
            share if share < 0.9 => Determined::Hardly,
            _ => Determined::No,
        });
    let (singular_values, combinations) = informed(&covariance, &prior_stddev);
    let found = MassVector::from_iterator(values.iter().copied());
    let moved = smallest_density_moment_kg_m2(&inertia_b_kg_m2(&found)) < 0.0;
    let estimate = if moved { nearest_realisable(&found, &covariance) } else { found };
    let of = |at: usize| (values[at], covariance_all[(at, at)].sqrt());
    let (gyro_bias_rad_s, accelerometer_bias_m_s2) = mean_biases(&fitted.solution.nodes);
    findings.extend(judge_fit(
        reduced,
        fitted.outliers as f64 / fitted.residuals.max(1.0),
        torque_noise_n_m_sqrt_s,
    ));
    if moved {
        let misses = (estimate - found).component_div(&stddev).amax();
        findings.push(Finding {
            fatal: misses > 4.0,
            text: format!("No rigid body has the inertia that fits best; the nearest possible one was taken, {misses:.1} standard deviations away."),
        });
    }
    findings.extend(judge_excitation(&determined, &prior_stddev, &stddev));
    findings.extend(judge_prior(&estimate, &mass_vector(&model.mass_properties), &prior_stddev, &determined));
    findings.sort_by_key(|f| !f.fatal);
    Identification {
        estimate,
        covariance,
        stddev_known_actuators: take(&covariance_known).diagonal().map(f64::sqrt),
        prior_stddev,
        determined,
        singular_values,
        combinations,
        effects: unknowns
            .of_effects()
            .into_iter()
            .map(|(effect, spec, at)| {
                let ((value, stddev), effect) = (of(at), effect.info().id);
                EffectParameter {
                    effect,
                    value: spec.limited(value),
                    stddev,
                    unit: spec.unit,
                    name: spec.name,
                }
            })
            .collect(),
        wheel_strength: (0..unknowns.wheels).map(|j| of(unknowns.wheel_strength(j))).collect(),
        jet_strength: unknowns
            .jets
            .iter()
            .enumerate()
            .map(|(n, j)| {
                let (value, stddev) = of(unknowns.jet_strength(n));
                (*j, value, stddev)
            })
            .collect(),
        gyro_bias_rad_s,
        accelerometer_bias_m_s2,
        torque_noise_n_m_sqrt_s,
        reduced_chi_squared: reduced,
        duration_s: data.chains.iter().map(crate::data::Chain::duration_s).sum(),
        moved_to_realisable: moved,
        findings,
    }
}

/// Inverse of an information matrix; infinite where it is singular, so that no parameter looks certain.
fn inverse(information: &DMatrix<f64>) -> DMatrix<f64> {
    information.clone().cholesky().map_or_else(
        || DMatrix::from_diagonal_element(information.nrows(), information.nrows(), f64::INFINITY),
        |factor| factor.inverse(),
    )
}

/// Singular values of the data's information over the prior's, and their directions: with the posterior
/// covariance P and the prior's S, those of S^1/2 (P^-1 - S^-1) S^1/2.
fn informed(covariance: &MassCovariance, prior: &MassVector) -> (MassVector, MassCovariance) {
    let scale = MassCovariance::from_diagonal(&prior.map(|s| 1.0 / s));
    let scaled = scale * covariance * scale;
    let eigen = nalgebra::SymmetricEigen::new(0.5 * (scaled + scaled.transpose()));
    let mut order: Vec<usize> = (0..MASS_PARAMETERS).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    let mut values = MassVector::zeros();
    let mut vectors = MassCovariance::zeros();
    for (to, from) in order.into_iter().enumerate() {
        values[to] = (1.0 / eigen.eigenvalues[from].max(1e-15) - 1.0).max(0.0);
        vectors.set_column(to, &eigen.eigenvectors.column(from));
    }
    (values, vectors)
}

fn judge_fit(reduced: f64, outlier_share: f64, torque_noise: f64) -> Vec<Finding> {
    let mut findings = Vec::new();
    if reduced > 9.0 {
        findings.push(Finding::fatal(format!(
            "The model does not explain the measurements: residuals are {:.1} times the sensors' noise. A sign, an axis, a unit or the noise in the model is wrong, or an effect is missing; look with `whorl diagnose` before using these numbers.",
            reduced.sqrt()
        )));
    } else if reduced > 1.5 {
        findings.push(Finding::warning(format!(
            "Residuals are {:.2} times the sensors' noise; the uncertainties were enlarged by that.",
            reduced.sqrt()
        )));
    }
    if outlier_share > 0.01 {
        findings.push(Finding {
            fatal: outlier_share > 0.1,
            text: format!(
                "{:.1} % of the samples do not fit the motion and were left out.",
                100.0 * outlier_share
            ),
        });
    }
    if torque_noise > 5e-3 {
        findings.push(Finding::warning(format!(
            "Torques that the model does not know are strong ({torque_noise:.0e} N m sqrt(s)): air currents, friction, or an actuator that does something else than commanded."
        )));
    }
    findings
}

fn judge_excitation(
    determined: &[Determined; MASS_PARAMETERS],
    prior: &MassVector,
    stddev: &MassVector,
) -> Vec<Finding> {
    let with = |which: Determined| -> Vec<String> {
        determined
            .iter()
            .enumerate()
            .filter(|(_, d)| **d == which)
            .map(|(i, _)| format!("{} (uncertainty {:.2} of before)", NAMES[i], stddev[i] / prior[i]))
            .collect()
    };
    let (no, hardly) = (with(Determined::No), with(Determined::Hardly));
    let mut findings = Vec::new();
    if no.len() == MASS_PARAMETERS {
        findings.push(Finding::fatal(
            "Nothing was excited: these data say nothing about the mass properties; all values are the prior's.".to_owned(),
        ));
        return findings;
    }
    if !no.is_empty() {
        findings.push(Finding::warning(format!(
            "Not excited, values are the prior's: {}. {}",
            no.join(", "),
            advice(determined)
        )));
    }
    if !hardly.is_empty() {
        findings.push(Finding::warning(format!("Hardly excited: {}.", hardly.join(", "))));
    }
    findings
}

/// What motion would excite what was not.
fn advice(determined: &[Determined; MASS_PARAMETERS]) -> &'static str {
    let weak = |i: usize| determined[i] == Determined::No;
    if weak(5) || weak(2) || weak(4) {
        "Add motion about z: yaw back and forth with the z wheel, quickly."
    } else if weak(0) || weak(1) || weak(3) {
        "Add motion about x and y: swing in roll and pitch, each with its wheel."
    } else {
        "Hold several tilts in different directions, or let the platform swing freely."
    }
}

/// A result far from the prior is possible, but worth a note.
fn judge_prior(
    estimate: &MassVector,
    before: &MassVector,
    prior: &MassVector,
    determined: &[Determined; MASS_PARAMETERS],
) -> Option<Finding> {
    let far: Vec<String> = (0..MASS_PARAMETERS)
        .filter(|i| determined[*i] == Determined::Yes)
        .map(|i| (i, (estimate[i] - before[i]) / prior[i]))
        .filter(|(_, misses)| misses.abs() > 4.0)
        .map(|(i, misses)| format!("{} by {:.1}", NAMES[i], misses.abs()))
        .collect();
    (!far.is_empty()).then(|| {
        Finding::warning(format!(
            "Far from what was known before, in its standard deviations: {}. Either the drawing is wrong, or an actuator's sign or strength is.",
            far.join(", ")
        ))
    })
}
