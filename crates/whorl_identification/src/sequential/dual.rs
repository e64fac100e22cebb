//! Parameters from another filter's estimates (eqs. 4.95-4.105).

use nalgebra::{Matrix3, SMatrix, Vector3};
use whorl_dynamics::gyrostat::equation::inertia_regressor;
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_math::covariance::update;

use super::SequentialEstimate;
use crate::mass_parameters::{MASS_PARAMETERS, MassCovariance, MassVector, mass_vector, prior_stddev};
use crate::regression::{StateSample, StateSeries};

type Row = SMatrix<f64, 3, MASS_PARAMETERS>;

/// The parameter filter of a dual pair.
#[derive(Debug, Clone)]
pub struct DualFilter {
    estimate: MassVector,
    covariance: MassCovariance,
    prior: MassVector,
    /// lambda of eq. 4.97 per window, 0 < lambda <= 1.
    forgetting: f64,
    /// Length of a window \[s\].
    window_s: f64,
    /// Variance of the innovation about each axis, for one sample in each half of the window.
    noise: Matrix3<f64>,
    wheels: StateSeries,
    start: Option<StateSample>,
    last: Option<StateSample>,
    matrix: Row,
    right: Vector3<f64>,
    /// Sums of the integrated equation over the first and the second half of the window, and their counts.
    halves: [(Row, Vector3<f64>, f64); 2],
}

impl DualFilter {
    /// Starts from a model and its prior. `rate_stddev_rad_s` is the error of the estimated
    /// rate, `forgetting` the factor per window (1 = never forget).
    #[must_use]
    pub fn new(
        model: &PlatformModel,
        prior: &ModelPrior,
        window_s: f64,
        rate_stddev_rad_s: f64,
        forgetting: f64,
    ) -> Self {
        let stddev = prior_stddev(prior);
        let inertia = model.mass_properties.inertia_b_kg_m2().diagonal();
        // Two rates in each innovation.
        let noise = (inertia * rate_stddev_rad_s).map(|s| 2.0 * s.powi(2) + 1e-12);
        Self {
            estimate: mass_vector(&model.mass_properties),
            covariance: MassCovariance::from_diagonal(&stddev.map(|s| s.powi(2))),
            prior: stddev,
            forgetting: forgetting.clamp(0.5, 1.0),
            window_s,
            noise: Matrix3::from_diagonal(&noise),
            wheels: StateSeries {
                samples: Vec::new(),
                wheel_momentum_b_kg_m2: StateSeries::momentum_axes(model.wheels()),
            },
            start: None,
            last: None,
            matrix: Row::zeros(),
            right: Vector3::zeros(),
            halves: [(Row::zeros(), Vector3::zeros(), 0.0); 2],
        }
    }

    /// Takes in the state filter's estimate at one time; answers at the end of each window. A gap of more
    /// than half a window restarts it.
    pub fn step(&mut self, sample: &StateSample) -> Option<SequentialEstimate> {
        let last = self.last.replace(sample.clone());
        let gap_s = last.as_ref().map_or(f64::INFINITY, |l| sample.time_s - l.time_s);
        let (Some(start), Some(last)) =
            (&self.start, last.filter(|_| gap_s > 0.0 && gap_s < 0.5 * self.window_s))
        else {
            self.begin(sample);
            return None;
        };
        let gyroscopic = |s: &StateSample| self.wheels.gyroscopic_torque_b_n_m(s);
        self.matrix += (last.mass_regressor() + sample.mass_regressor()) * (0.5 * gap_s);
        self.right +=
            last.external_torque_b_n_m * gap_s + (gyroscopic(&last) + gyroscopic(sample)) * (0.5 * gap_s);
        let mut matrix = self.matrix;
        let change = inertia_regressor(&sample.omega_wb_b_rad_s) - inertia_regressor(&start.omega_wb_b_rad_s);
        let mut block = matrix.fixed_view_mut::<3, 6>(0, 0);
        block += change;
        let wheels = self.wheels.wheel_momentum_b_n_m_s(sample) - self.wheels.wheel_momentum_b_n_m_s(start);
        let elapsed_s = sample.time_s - start.time_s;
        let [first, second] = &mut self.halves;
        let half = if elapsed_s < 0.5 * self.window_s { first } else { second };
        half.0 += matrix;
        half.1 += self.right - wheels;
        half.2 += 1.0;
        if elapsed_s < self.window_s {
            return None;
        }
        // Means over half a window have little of the rate's noise, which would be in the matrix.
        let [(a1, b1, n1), (a2, b2, n2)] = self.halves;
        if n1 < 1.0 || n2 < 1.0 {
            self.begin(sample);
            return None;
        }
        let matrix = a2 / n2 - a1 / n1;
        let innovation = b2 / n2 - b1 / n1 - matrix * self.estimate;
        self.update(&matrix, &innovation, n1.min(n2));
        self.begin(sample);
        Some(SequentialEstimate {
            time_s: sample.time_s,
            estimate: self.estimate,
            covariance: self.covariance,
            prior_stddev: self.prior,
        })
    }

    fn begin(&mut self, sample: &StateSample) {
        self.start = Some(sample.clone());
        self.matrix = Row::zeros();
        self.right = Vector3::zeros();
        self.halves = [(Row::zeros(), Vector3::zeros(), 0.0); 2];
    }

    /// Eqs. 4.99-4.101.
    fn update(&mut self, matrix: &Row, innovation: &Vector3<f64>, samples: f64) {
        let noise = self.noise / samples;
        let mut covariance = forget(&self.covariance, &self.prior, self.forgetting);
        let Some(update) = update(&mut covariance, matrix, &noise, innovation, |_| true) else { return };
        let estimate = self.estimate + update.correction;
        if estimate.iter().all(|x| x.is_finite()) {
            (self.estimate, self.covariance) = (estimate, covariance);
        }
    }
}

/// P / lambda, with no variance beyond the prior's.
pub(super) fn forget(covariance: &MassCovariance, prior: &MassVector, lambda: f64) -> MassCovariance {
    let scale = MassVector::from_fn(|i, _| {
        let variance = covariance[(i, i)].max(1e-300);
        (prior[i].powi(2) / variance).clamp(1.0, 1.0 / lambda).sqrt()
    });
    let scale = MassCovariance::from_diagonal(&scale);
    scale * covariance * scale
}
