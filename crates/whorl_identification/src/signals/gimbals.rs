//! Friction of gimbals, which the torque of their motors shows and the motion of the body does not.
//!
//! A gimbal's own equation (`whorl_dynamics::actuators::control_moment_gyros`), with everything that is measured on the
//! left,
//!
//! ```text
//! u + h0 t . w - (b_model dgamma/dt + T_model sign(dgamma/dt)) = J d2gamma/dt2 + b dgamma/dt + T sign(dgamma/dt) + c
//! ```
//!
//! is linear in what is not known: b and T beyond the model's, and as nuisances the inertia, because the acceleration at
//! the instant of a sample is not that between samples, and a constant c, the zero of the torque's measurement. Least
//! squares over the samples in which the gimbal turns. Its residual is correlated from sample to sample; with the
//! correlation r of neighbours, n samples are worth n (1 - r)/(1 + r) independent ones (Bartlett 1935).

use nalgebra::{DMatrix, DVector};
use whorl_dynamics::effects::{Part, Signature, catalogue};
use whorl_dynamics::{Effect, PlatformModel};
use whorl_recording::{Recording, Series};

use crate::signals::observed::Observed;
use crate::verdict::diagnosis::{Candidate, ParameterEstimate};

/// Share of its largest rate below which the sense of a gimbal's rate is noise.
const TURNS_SHARE: f64 = 0.02;
/// Samples in which a gimbal turns that a fit needs.
const FEWEST: usize = 200;

/// Samples of one gimbal in which it turns: what is measured, and the columns J, c, b, T.
#[derive(Default)]
struct Rows {
    left_n_m: Vec<f64>,
    columns: Vec<[f64; 4]>,
}

/// Gimbals as they were read at one instant.
struct Sample {
    time_s: f64,
    angle_rad: f64,
    rate_rad_s: f64,
    torque_n_m: f64,
}

/// Readings of one gimbal whose stamps agree.
fn samples(recording: &Recording, gyro: usize) -> Vec<Sample> {
    let (angle, rate, torque) =
        (&recording.gimbal_angle_rad, &recording.gimbal_rate_rad_s, &recording.gimbal_torque_n_m);
    let find = |series: &Series<Vec<f64>>, time_s: f64| {
        let k = series.time_s.partition_point(|t| *t < time_s);
        let value = (series.time_s.get(k) == Some(&time_s)).then(|| series.value.get(k)).flatten()?;
        value.get(gyro).copied()
    };
    let sample = |(time_s, angles): (&f64, &Vec<f64>)| {
        Some(Sample {
            time_s: *time_s,
            angle_rad: *angles.get(gyro)?,
            rate_rad_s: find(rate, *time_s)?,
            torque_n_m: find(torque, *time_s)?,
        })
    };
    angle.time_s.iter().zip(&angle.value).filter_map(sample).collect()
}

/// Friction of gimbals beyond the model's, if their motors' torques show any.
pub(crate) fn row(
    observed: &[Observed<'_>],
    model: &PlatformModel,
    certain_stddevs: f64,
    is_excluded: impl Fn(&str) -> bool,
) -> Option<Candidate> {
    let effect = catalogue().iter().find(|effect| effect.signature() == Some(Signature::GimbalDrag))?;
    if is_excluded(effect.info().id) {
        return None;
    }
    let gyros = model.gyros().len();
    let mut found: Option<Candidate> = None;
    for gyro in 0..gyros {
        let mut rows = Rows::default();
        for run in observed {
            rows.add(run, model, gyro);
        }
        let Some(row) = rows.candidate(*effect, model, gyro, gyros, certain_stddevs) else { continue };
        found = Some(match found {
            None => row,
            Some(mut all) => {
                all.delta_log_evidence += row.delta_log_evidence;
                let held_out = all.held_out_gain.zip(row.held_out_gain);
                all.held_out_gain = held_out.map(|(all, row)| all + row);
                all.detectability += row.detectability;
                all.share_of_excess = all.share_of_excess.max(row.share_of_excess);
                all.parameters.extend(row.parameters);
                all
            }
        });
    }
    found
}

impl Rows {
    fn add(&mut self, run: &Observed<'_>, model: &PlatformModel, gyro: usize) {
        let Some(of) = model.gyros().get(gyro) else { return };
        let samples = samples(run.recording, gyro);
        let fastest = samples.iter().map(|s| s.rate_rad_s.abs()).fold(0.0, f64::max);
        for pair in samples.windows(2) {
            let [last, now] = pair else { continue };
            let (rate, before) = (now.rate_rad_s, last.rate_rad_s);
            if rate.abs() <= TURNS_SHARE * fastest || rate * before <= 0.0 || now.time_s <= last.time_s {
                continue;
            }
            let load = of.torque_per_rate_b_n_m_s(now.angle_rad).dot(&run.motion.rate(now.time_s));
            let friction = of.viscous_friction_n_m_s * rate + of.coulomb_friction_n_m * rate.signum();
            self.left_n_m.push(now.torque_n_m + load - friction);
            self.columns.push([(rate - before) / (now.time_s - last.time_s), 1.0, rate, rate.signum()]);
        }
    }

    /// Coefficients of these columns over a range of rows.
    fn fit(&self, columns: usize, from: usize, to: usize) -> Option<DVector<f64>> {
        let (a, y) = self.part(columns, from, to);
        (a.transpose() * &a).cholesky().map(|c| c.solve(&(a.transpose() * y)))
    }

    fn part(&self, columns: usize, from: usize, to: usize) -> (DMatrix<f64>, DVector<f64>) {
        let a = DMatrix::from_fn(to - from, columns, |i, j| self.columns[from + i][j]);
        let y = DVector::from_fn(to - from, |i, _| self.left_n_m[from + i]);
        (a, y)
    }

    /// Sum of squared residuals.
    fn misfit(&self, x: &DVector<f64>, from: usize, to: usize) -> f64 {
        let (a, y) = self.part(x.len(), from, to);
        (y - a * x).norm_squared()
    }

    fn candidate(
        &self,
        effect: &dyn Effect,
        model: &PlatformModel,
        gyro: usize,
        gyros: usize,
        certain_stddevs: f64,
    ) -> Option<Candidate> {
        let n = self.left_n_m.len();
        if n < FEWEST {
            return None;
        }
        let (without, with) = (self.fit(2, 0, n)?, self.fit(4, 0, n)?);
        let (misfit_0, misfit_1) = (self.misfit(&without, 0, n), self.misfit(&with, 0, n));
        let (a, y) = self.part(4, 0, n);
        let residual = y - &a * &with;
        let neighbours: f64 = residual.as_slice().windows(2).map(|w| w[0] * w[1]).sum();
        let correlation = (neighbours / misfit_1.max(f64::MIN_POSITIVE)).clamp(0.0, 0.99);
        let worth = n as f64 * (1.0 - correlation) / (1.0 + correlation);
        let covariance = (a.transpose() * &a).try_inverse()? * (misfit_1 / worth);
        // A drag is never negative: less than the model's is another finding than this effect.
        let significance = |i: usize| with[i] / covariance[(i, i)].sqrt();
        let strongest = significance(2).max(significance(3));
        let gain = 0.5 * worth * (misfit_0 / misfit_1.max(f64::MIN_POSITIVE)).ln();
        let evidence = gain - worth.ln() - (gyros as f64).ln();
        if !(strongest > certain_stddevs && evidence > 0.0) {
            return None;
        }
        // What the first half teaches, on the second.
        let half = n / 2;
        let (before, after) = (self.fit(2, 0, half)?, self.fit(4, 0, half)?);
        let (left_0, left_1) = (self.misfit(&before, half, n), self.misfit(&after, half, n));
        let held_out_gain = 0.25 * worth * (left_0 / left_1.max(f64::MIN_POSITIVE)).ln();
        let specs = effect.parameters(model);
        let own = specs.iter().filter(|spec| spec.part == Part::Gyro(gyro));
        let parameters = own.zip([2, 3]).map(|(spec, i)| {
            let stddev = covariance[(i, i)].sqrt();
            let estimate = with[i].max(spec.min).min(spec.max);
            ParameterEstimate {
                name: spec.name.clone(),
                unit: spec.unit.to_owned(),
                estimate,
                stddev,
                at_bound: estimate != with[i],
                smallest_detectable: certain_stddevs * stddev,
            }
        });
        Some(Candidate {
            effect: effect.info().id.to_owned(),
            delta_log_evidence: evidence,
            held_out_gain: Some(held_out_gain),
            share_of_excess: (1.0 - misfit_1 / misfit_0).clamp(0.0, 1.0),
            swallowed_by_base: 0.0,
            detectability: 2.0 * gain,
            indistinguishable_from: Vec::new(),
            parameters: parameters.collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;
    use whorl_dynamics::PlatformModel;
    use whorl_dynamics::actuators::ActuatorKind;
    use whorl_dynamics::effects::find;

    use super::*;

    /// A gimbal that swings, its drag written out by hand, its torque measured with noise.
    fn rows(viscous_n_m_s: f64, coulomb_n_m: f64, seed: u128) -> Rows {
        let mut random = Pcg64::new(seed, 3);
        let mut rows = Rows::default();
        for k in 0..4000_u32 {
            let t = f64::from(k) * 0.01;
            let (rate, acceleration) = (0.4 * t.cos(), -0.4 * t.sin());
            if rate.abs() < 0.01 {
                continue;
            }
            let noise: f64 = StandardNormal.sample(&mut random);
            rows.left_n_m.push(
                6e-3 * acceleration
                    + viscous_n_m_s * rate
                    + coulomb_n_m * rate.signum()
                    + 1e-3
                    + 2e-3 * noise,
            );
            rows.columns.push([acceleration, 1.0, rate, rate.signum()]);
        }
        rows
    }

    fn model() -> PlatformModel {
        let mut model = PlatformModel::whorl_1_reference();
        model.actuators.control_moment_gyros.add("cmg".to_owned());
        let gyro = &mut model.gyros_mut()[0];
        (gyro.gimbal_inertia_kg_m2, gyro.max_rate_rad_s, gyro.time_constant_s) = (6e-3, 1.0, 4e-3);
        model
    }

    #[test]
    fn drag_is_found_with_its_size_and_none_where_there_is_none() {
        let effect = find("gimbal_friction").unwrap();
        let found = rows(0.01, 0.02, 1).candidate(effect, &model(), 0, 1, 5.5).unwrap();
        for (parameter, truth) in found.parameters.iter().zip([0.01, 0.02]) {
            let off = (parameter.estimate - truth) / parameter.stddev;
            assert!(off.abs() < 4.0 && parameter.stddev < 0.1 * truth, "{parameter:?}");
        }
        assert!(found.held_out_gain.unwrap() > 10.0 && found.delta_log_evidence > 100.0);
        for seed in 0..20 {
            assert!(rows(0.0, 0.0, seed).candidate(effect, &model(), 0, 1, 5.5).is_none(), "{seed}");
        }
    }
}
