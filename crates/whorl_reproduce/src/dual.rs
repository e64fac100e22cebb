//! Parameters alone, from another filter's estimates (eqs. 4.95-4.105).
//!
//! The innovation of eq. 4.104 divides a difference of rates by the time between them; here the same equation is
//! integrated over a window, which needs no derivative. Its noise is in the matrix, so it is biased like the batch
//! regressions; [`whorl_estimation::sequential::JointFilter`] is not.

use nalgebra::{Matrix3, SMatrix, Vector3};
use whorl_dynamics::gyrostat::equation::inertia_regressor;
use whorl_dynamics::mass_parameters::{
    MASS_PARAMETERS, MassCovariance, MassVector, mass_vector, prior_stddev,
};
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_estimation::sequential::{SequentialEstimate, forget};
use whorl_math::covariance::update;

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::regression::estimated_series;
    use whorl_dynamics::mass_parameters::{NAMES, mass_properties};

    use crate::simulated_runs::{at_balance, record, swinging};

    /// Wheels known exactly, mass properties to 15 %.
    fn prior(model: &PlatformModel) -> ModelPrior {
        let mut prior = ModelPrior::typical(model);
        prior.inertia_b_kg_m2 *= 3.0;
        prior.actuators.wheels.spin_inertia.fill(0.0);
        prior.actuators.wheels.axis_rad.fill(0.0);
        prior
    }

    #[test]
    fn the_dual_filter_learns_from_estimates() {
        let mut truth = PlatformModel::whorl_1_reference();
        truth.sensors.accelerometer.errors.bias_turn_on_stddev.fill(1.5e-3);
        let run = record(&truth, at_balance(&truth), 100.0, 3, &swinging);
        // A tenth off in everything.
        let t = mass_vector(&truth.mass_properties);
        let signs = [1.0, -1.0, 1.0, -1.0, 1.0, 1.0, 1.0, -1.0, 1.0];
        let start = MassVector::from_fn(|i, _| t[i] * (1.0 + 0.1 * signs[i]));
        let mut model = truth.clone();
        model.mass_properties = mass_properties(&start, truth.mass_properties.mass_kg()).unwrap();
        let series = estimated_series(&run, &model, 0.05).unwrap();
        let mut filter = DualFilter::new(&model, &prior(&model), 2.0, 1.7e-3, 0.999);
        let all: Vec<_> = series.samples.iter().filter_map(|s| filter.step(s)).collect();
        assert!(all.len() > 40, "{}", all.len());
        let last = all.last().unwrap();
        for i in [0, 3, 5, 8] {
            println!("{} {:.4} true {:.4} +- {:.4}", NAMES[i], last.estimate[i], t[i], last.stddev()[i]);
            assert!((last.estimate[i] - t[i]).abs() < 0.5 * (start[i] - t[i]).abs(), "{}", NAMES[i]);
        }
    }
}
