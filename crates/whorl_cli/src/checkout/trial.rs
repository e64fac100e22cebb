//! What comes of working a part.

use anyhow::Context;
use nalgebra::Vector3;
use serde::Serialize;
use whorl_devices::checkout::{Finding, Trial, judge};
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_node::Timestamp;

/// A part that seems wrong, or whose size is not known, is tried so often; and so many attempts may be spoiled.
const ATTEMPTS: usize = 6;
/// A size that is known to this standard deviation is known: half of what priors usually leave open, so that these decide.
const SURE: f64 = 0.03;

/// In which the wheels bring the platform to rest \[s\].
const DAMPING_S: f64 = 0.5;

/// Mean of a window's rates.
pub(super) struct Mean {
    /// Body axes [rad/s].
    pub(super) rate: Vector3<f64>,
    /// Standard deviation of each axis of that [rad/s].
    pub(super) noise: f64,
    /// The window's end, and the mean time of its samples from there \[s\].
    pub(super) end: Timestamp,
    pub(super) age_s: f64,
}

impl Mean {
    /// Time from an earlier one \[s\].
    pub(super) fn since(&self, earlier: &Self) -> f64 {
        self.end.seconds_since(earlier.end) + self.age_s - earlier.age_s
    }
}

/// What came of one attempt.
pub(super) struct Tried {
    pub(super) trial: Trial,
    /// The part worked, and samples came steadily. A busy computer may lose a command or a device's answer, and then nothing was
    /// tried; and where it read samples late their times are wrong.
    pub(super) is_good: bool,
}

/// What attempts of one part found: a busy computer, or somebody who touches the platform, spoils some.
#[derive(Default)]
pub(super) struct Attempts {
    /// In the right direction: their mean tells the size.
    alike: Vec<Trial>,
    /// What each of the others found.
    wrong: Vec<Finding>,
    /// What attempts seem to say in which nothing was tried, or times are wrong: heard where there is nothing else.
    spoiled: Vec<Finding>,
}

impl Attempts {
    /// Counts an attempt. What is found of the part, and whether that is sure; `None`: another attempt is needed.
    ///
    /// It ends when the size is known from the mean, when two find the same wrong and fewer find it right, or when there were
    /// [`ATTEMPTS`], or as many that are spoiled.
    ///
    /// # Errors
    ///
    /// The model has no such part.
    pub(super) fn add(
        &mut self,
        Tried { trial, is_good }: Tried,
        model: &PlatformModel,
        prior: &ModelPrior,
    ) -> anyhow::Result<Option<(Finding, bool)>> {
        let judged = |trial: &Trial| judge(model, prior, trial).context("the model has no such part");
        let alone = judged(&trial)?;
        if !is_good {
            self.spoiled.push(alone);
        } else if alone.size().is_some() {
            self.alike.push(trial);
        } else {
            self.wrong.push(alone);
        }
        let Self { alike, wrong, spoiled } = self;
        let is_last = alike.len() + wrong.len() >= ATTEMPTS || spoiled.len() >= ATTEMPTS;
        if let Some(mean) = Trial::mean(alike)
            && alike.len() >= wrong.len()
        {
            let finding = judged(&mean)?;
            let known = finding.size().is_some_and(|size| size.stddev <= SURE);
            let enough = known && (finding.is_right() || alike.len() > 1);
            return Ok((enough || is_last).then_some((finding, known || alike.len() > 1)));
        }
        let count = |of: &Finding| {
            wrong.iter().filter(|other| std::mem::discriminant(*other) == std::mem::discriminant(of)).count()
        };
        let likeliest = wrong.iter().max_by_key(|finding| count(finding));
        let settled = likeliest.is_some_and(|finding| count(finding) > 1);
        let found = likeliest.or_else(|| spoiled.last());
        Ok(found.filter(|_| settled || is_last).map(|finding| (finding.clone(), settled)))
    }
}

/// How it was before a part worked.
pub(super) struct Since {
    pub(super) at: Timestamp,
    pub(super) on_time_s: Vec<f64>,
    pub(super) gimbal_angle_rad: Vec<f64>,
}

/// What was found of one part.
#[derive(Debug, Serialize)]
pub(super) struct Checked {
    pub(super) part: String,
    pub(super) is_right: bool,
    pub(super) said: String,
    /// Size over the model's, its standard deviation, and what the priors allow it to be off by; `None` where it did nothing or moved
    /// elsewhere.
    pub(super) size: Option<f64>,
    pub(super) stddev: Option<f64>,
    pub(super) tolerance: Option<f64>,
}

/// Torques of the wheels that bring the platform to rest, as they were found to answer.
pub(super) fn damping(model: &PlatformModel, answers: &[f64], rate_b_rad_s: &Vector3<f64>) -> Vec<f64> {
    let momentum = model.mass_properties.inertia_b_kg_m2() * rate_b_rad_s;
    let torque = |axis: &Vector3<f64>| axis.dot(&momentum) / DAMPING_S;
    let wheels = model.wheels().iter().zip(answers);
    let limited = wheels.map(|(wheel, answer)| {
        (answer * torque(&wheel.spin_axis_b)).clamp(-wheel.max_torque_n_m, wheel.max_torque_n_m)
    });
    limited.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_devices::checkout::Part;

    /// A trial of the first wheel that turned the body by so much of what is expected, about x.
    fn tried(size: f64, relative_noise: f64, is_good: bool) -> Tried {
        let model = PlatformModel::whorl_1_reference();
        let (part, command, length_s) = (Part::Wheel(0), 0.1, 0.5);
        let expected = part.expected_b_rad_s(&model, command, length_s, &[]).unwrap();
        let trial = Trial {
            part,
            command,
            length_s,
            gimbal_angle_rad: Vec::new(),
            rate_change_b_rad_s: expected * size,
            noise_rad_s: relative_noise * expected.norm(),
        };
        Tried { trial, is_good }
    }

    /// What is found of these attempts, in order; `None` where more are needed.
    fn found(all: &[(f64, f64, bool)]) -> Option<(Finding, bool)> {
        let model = PlatformModel::whorl_1_reference();
        let prior = ModelPrior::typical(&model);
        let mut attempts = Attempts::default();
        all.iter().find_map(|(size, noise, is_good)| {
            attempts.add(tried(*size, *noise, *is_good), &model, &prior).unwrap()
        })
    }

    #[test]
    fn a_size_that_is_known_needs_one_attempt_and_a_wrong_part_two() {
        assert!(matches!(found(&[(1.0, 0.01, true)]), Some((Finding::Right(_), true))));
        assert!(found(&[(-1.0, 0.01, true)]).is_none());
        assert!(matches!(found(&[(-1.0, 0.01, true); 2]), Some((Finding::Reversed, true))));
    }

    /// A jet whose size the gyro's noise hides has all attempts; when the last is spoiled, the others have been measured still.
    #[test]
    fn a_spoiled_attempt_takes_nothing_from_good_ones() {
        let noisy = (1.0, 0.15, true);
        let late = (0.0, 0.15, false);
        let some = [noisy, noisy, noisy, noisy, noisy, late];
        assert!(found(&some).is_none(), "one more is tried in its place");
        let all = [some.as_slice(), &[noisy]].concat();
        assert!(matches!(found(&all), Some((Finding::Right(_), true))));
        let mostly = [[late; 5].as_slice(), &[noisy, late]].concat();
        assert!(matches!(found(&mostly), Some((Finding::Right(_), false))));
    }

    #[test]
    fn what_was_never_tried_is_told_and_is_not_sure() {
        assert!(found(&[(0.0, 0.01, false); ATTEMPTS - 1]).is_none());
        assert!(matches!(found(&[(0.0, 0.01, false); ATTEMPTS]), Some((Finding::Nothing, false))));
    }

    #[test]
    fn one_attempt_that_somebody_spoiled_does_not_decide() {
        let (right, pushed) = ((1.0, 0.04, true), (-1.0, 0.04, true));
        assert!(matches!(found(&[pushed, right, right, right, right]), Some((Finding::Right(_), true))));
        assert!(matches!(found(&[right, pushed, pushed]), Some((Finding::Reversed, true))));
    }
}
