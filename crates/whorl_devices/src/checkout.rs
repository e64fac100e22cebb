//! Whether each actuator does what the model says, from what the platform did: wires and signs that are exchanged.
//!
//! A jet that was open for t seconds changes the body rate by `J^-1 tau t`, a wheel that was driven with torque u for as long by
//! `-J^-1 a u t`, a gimbal that was turned by an angle d by
//! `-J^-1 h0 t d`, its rotor's momentum times the direction in which it moves (momentum of the whole is conserved). Direction tells signs and exchanged wires; size tells scales, as
//! far as the priors of inertia and actuator leave anything to tell. Gravity, the wheels' part of the inertia and what
//! friction varies by are left out: they are part of the deviation.

use nalgebra::Vector3;
use whorl_dynamics::{ModelPrior, PlatformModel};

/// Directions agree within this cosine (37 deg).
const ALIKE: f64 = 0.8;
/// Sizes agree within so many standard deviations of what priors and measurement leave open.
const SIGMAS: f64 = 3.0;
/// Of a size, relative, beside the noise of the gyro: when a part began and ended to work is known to a sample (10 ms of 0.5 s),
/// and the time between two means of rates likewise.
const METHOD: f64 = 0.02;
/// Beyond this factor it is the scale, not the part.
const FACTOR: f64 = 2.0;
/// Less than this share of what was expected is nothing.
const NOTHING: f64 = 0.2;

/// One actuator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// A wheel, by its index.
    Wheel(usize),
    /// A jet, by its index.
    Jet(usize),
    /// The gimbal of a control moment gyro, by its index.
    Gyro(usize),
}

impl Part {
    /// Every wheel, then every jet, then every gyro.
    #[must_use]
    pub fn all(model: &PlatformModel) -> Vec<Self> {
        let wheels = (0..model.wheels().len()).map(Self::Wheel);
        let jets = (0..model.jets().len()).map(Self::Jet);
        wheels.chain(jets).chain((0..model.gyros().len()).map(Self::Gyro)).collect()
    }

    /// Its name in the model.
    #[must_use]
    pub fn name(self, model: &PlatformModel) -> &str {
        let name = match self {
            Self::Wheel(index) => model.wheels().get(index).map(|wheel| wheel.name.as_str()),
            Self::Jet(index) => model.jets().get(index).map(|jet| jet.name.as_str()),
            Self::Gyro(index) => model.gyros().get(index).map(|gyro| gyro.name.as_str()),
        };
        name.unwrap_or("?")
    }

    /// Change of the body rate that the model expects, body axes [rad/s], of a wheel driven with the torque `command` \[N m\], a
    /// gimbal with the rate `command` [rad/s] from the angle `gimbal_angle_rad` of each, or a jet open, for `length_s`. `None`:
    /// there is no such part, or the inertia has no inverse.
    #[must_use]
    pub fn expected_b_rad_s(
        self,
        model: &PlatformModel,
        command: f64,
        length_s: f64,
        gimbal_angle_rad: &[f64],
    ) -> Option<Vector3<f64>> {
        let mobility = model.freedom.mobility(model.mass_properties.inertia_b_kg_m2())?;
        let torque_b_n_m = match self {
            Self::Wheel(index) => -model.wheels().get(index)?.spin_axis_b.into_inner() * command,
            Self::Jet(index) => model.jets().get(index)?.torque_b_n_m(),
            Self::Gyro(index) => {
                let before = gimbal_angle_rad.get(index).copied().unwrap_or(0.0);
                // In the middle of the way.
                let angle_rad = before + 0.5 * command * length_s;
                -model.gyros().get(index)?.torque_per_rate_b_n_m_s(angle_rad) * command
            }
        };
        Some(mobility * torque_b_n_m * length_s)
    }
}

/// What was tried, and what the platform did.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// Which part was told to work.
    pub part: Part,
    /// Torque that a wheel was told to make \[N m\], or rate of a gimbal [rad/s]; of no concern for a jet.
    pub command: f64,
    /// For how long \[s\].
    pub length_s: f64,
    /// Where the gimbals were before \[rad\].
    pub gimbal_angle_rad: Vec<f64>,
    /// Change of the body rate, body axes [rad/s].
    pub rate_change_b_rad_s: Vector3<f64>,
    /// Standard deviation of each axis of that [rad/s].
    pub noise_rad_s: f64,
}

/// How large an actuator's effect is, over the model's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Size {
    /// Measured over expected.
    pub size: f64,
    /// Standard deviation of that, of the measurement alone.
    pub stddev: f64,
    /// What it may differ from one by: the model's priors and the measurement.
    pub tolerance: f64,
}

impl Size {
    fn in_words(&self) -> String {
        let off = self.size - 1.0;
        let how = if off > 0.0 { "stronger" } else { "weaker" };
        let scale = if (1.0 / FACTOR..=FACTOR).contains(&self.size) { "" } else { "; is the scale right?" };
        format!(
            "{how} than the model by {:.0} % +- {:.0} %; priors and measurement allow {:.0} %{scale}",
            100.0 * off.abs(),
            100.0 * self.stddev,
            100.0 * self.tolerance
        )
    }
}

impl Trial {
    /// The mean of attempts of one part, as if each had lasted as long as the first and had its sign. `None` without any.
    #[must_use]
    pub fn mean(attempts: &[Self]) -> Option<Self> {
        let first = attempts.first()?;
        let count = attempts.len() as f64;
        // Jets have no command, and one sign.
        let sign = |trial: &Self| if first.command * trial.command < 0.0 { -1.0 } else { 1.0 };
        let per_attempt =
            |trial: &Self| trial.rate_change_b_rad_s * (sign(trial) * first.length_s / trial.length_s);
        let noise = |trial: &Self| (trial.noise_rad_s * first.length_s / trial.length_s).powi(2);
        Some(Self {
            rate_change_b_rad_s: attempts.iter().map(per_attempt).sum::<Vector3<f64>>() / count,
            noise_rad_s: attempts.iter().map(noise).sum::<f64>().sqrt() / count,
            ..first.clone()
        })
    }
}

/// What is wrong, if anything.
#[derive(Debug, Clone, PartialEq)]
pub enum Finding {
    /// As the model says.
    Right(Size),
    /// The platform did not move.
    Nothing,
    /// The opposite.
    Reversed,
    /// As if another part had worked: all that would explain it.
    Like(Vec<Part>),
    /// In the right direction, of another size.
    Size(Size),
    /// In a direction that no single part gives.
    Elsewhere,
}

impl Finding {
    /// The size, where the direction is right.
    #[must_use]
    pub fn size(&self) -> Option<Size> {
        match self {
            Self::Right(size) | Self::Size(size) => Some(*size),
            _ => None,
        }
    }

    /// Whether nothing is wrong.
    #[must_use]
    pub fn is_right(&self) -> bool {
        matches!(self, Self::Right(_))
    }

    /// How a wheel answers to its torque: 1 as it should, -1 the other way, 0 not so that one could use it.
    #[must_use]
    pub fn answer(&self) -> f64 {
        match self {
            Self::Right(_) => 1.0,
            Self::Size(size) if (1.0 / FACTOR..=FACTOR).contains(&size.size) => 1.0,
            Self::Reversed => -1.0,
            _ => 0.0,
        }
    }

    /// In words, with what to do.
    #[must_use]
    pub fn words(&self, part: Part, model: &PlatformModel) -> String {
        let name = part.name(model);
        match (self, part) {
            (Self::Right(Size { size, stddev, tolerance }), _) => format!(
                "right, {:.0} % +- {:.0} % of the model's size; priors and measurement allow {:.0} % off",
                100.0 * size,
                100.0 * stddev,
                100.0 * tolerance
            ),
            (Self::Nothing, Part::Gyro(_)) => {
                "the platform did not move: does its rotor run, and its gimbal turn?".into()
            }
            (Self::Nothing, Part::Wheel(_)) => "the platform did not move: is the motor powered, and its address right?".into(),
            (Self::Nothing, Part::Jet(_)) => "the platform did not move: is the gas on, and the valve on its coil?".into(),
            (Self::Reversed, Part::Wheel(_)) => {
                format!("turns the other way: change the sign of motors.{name} in the list of devices, or its spin_axis")
            }
            (Self::Reversed, Part::Gyro(_)) => {
                format!("pushes the other way: change the sign of motors.{name} in the list of devices, or its rotor turns the other way")
            }
            (Self::Reversed, Part::Jet(_)) => "pushes the other way: its force_direction in the model is reversed".into(),
            (Self::Like(parts), _) => {
                let names: Vec<&str> = parts.iter().map(|part| part.name(model)).collect();
                format!("the platform moved as by {}: are their wires exchanged with those of {name}?", names.join(" or "))
            }
            (Self::Size(size), _) => size.in_words(),
            (Self::Elsewhere, _) => "the platform moved in a direction that no single part gives: is it free, and the mounting of \
                                     the inertial sensor right?"
                .into(),
        }
    }
}

/// What a part's size may be off by, relative, as the model's priors say: standard deviation.
fn prior_share(
    model: &PlatformModel,
    prior: &ModelPrior,
    part: Part,
    expected: &Vector3<f64>,
    command: f64,
) -> f64 {
    // What has no torque is no part of a checkout; about any axis it is as uncertain.
    let axis = whorl_math::unit_or(*expected, Vector3::z_axis()).into_inner();
    let along = |matrix: &nalgebra::Matrix3<f64>| (axis.transpose() * matrix * axis).x;
    // Of an inertia whose elements are uncertain by themselves; each product of inertia stands in it twice.
    let variances = prior.inertia_b_kg_m2.component_mul(&prior.inertia_b_kg_m2);
    let squares = axis.component_mul(&axis);
    let of_all = (squares.transpose() * variances * squares).x;
    let of_moments = squares.component_mul(&squares).dot(&variances.diagonal());
    let inertia = (2.0 * of_all - of_moments).sqrt() / along(model.mass_properties.inertia_b_kg_m2());
    let of = |list: &[f64], index: usize| list.get(index).copied().unwrap_or(0.0);
    let own = match part {
        Part::Jet(index) => of(&prior.actuators.jets.thrust, index),
        Part::Gyro(index) => of(&prior.actuators.control_moment_gyros.rotor_momentum, index),
        // The motor's torque is commanded; its bearing takes of it what it takes.
        Part::Wheel(index) => {
            let friction = model.wheels().get(index).map_or(0.0, |wheel| wheel.coulomb_friction_n_m);
            let known = of(&prior.actuators.wheels.coulomb_friction_n_m, index);
            of(&prior.actuators.wheels.spin_inertia, index).hypot((friction + known) / command)
        }
    };
    inertia.hypot(own)
}

/// Compares a trial with the model. `None`: the model has no such part.
#[must_use]
pub fn judge(model: &PlatformModel, prior: &ModelPrior, trial: &Trial) -> Option<Finding> {
    let Trial { part, command, length_s, gimbal_angle_rad, rate_change_b_rad_s: moved, noise_rad_s } = trial;
    let expected = part.expected_b_rad_s(model, *command, *length_s, gimbal_angle_rad)?;
    let size = moved.norm() / expected.norm();
    if !size.is_finite() || moved.norm() < 3.0 * noise_rad_s || size < NOTHING {
        return Some(Finding::Nothing);
    }
    let cosine = |other: &Vector3<f64>| moved.dot(other) / (moved.norm() * other.norm());
    let own = cosine(&expected);
    if own > ALIKE {
        // Along what was expected: noise across it makes nothing larger.
        let size = moved.dot(&expected) / expected.norm_squared();
        let stddev = METHOD.hypot(noise_rad_s / expected.norm());
        let tolerance = SIGMAS * prior_share(model, prior, *part, &expected, *command).hypot(stddev);
        let found = Size { size, stddev, tolerance };
        return Some(if (size - 1.0).abs() <= tolerance {
            Finding::Right(found)
        } else {
            Finding::Size(found)
        });
    }
    let like = |other: &Part| {
        let same_sort = std::mem::discriminant(part) == std::mem::discriminant(other);
        let theirs = other.expected_b_rad_s(model, *command, *length_s, gimbal_angle_rad);
        other != part && same_sort && theirs.is_some_and(|theirs| cosine(&theirs) > ALIKE)
    };
    let others: Vec<Part> = Part::all(model).into_iter().filter(like).collect();
    Some(match part {
        // One motor of a chain that turns the wrong way is likelier than two that are exchanged.
        Part::Wheel(_) | Part::Gyro(_) if own < -ALIKE => Finding::Reversed,
        _ if !others.is_empty() => Finding::Like(others),
        _ if own < -ALIKE => Finding::Reversed,
        _ => Finding::Elsewhere,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_dynamics::MassProperties;
    use whorl_dynamics::actuators::control_moment_gyros::Gyro;

    fn trial(part: Part, x: f64, y: f64, z: f64) -> Trial {
        let rate_change_b_rad_s = Vector3::new(x, y, z);
        Trial {
            part,
            command: 0.1,
            length_s: 0.5,
            gimbal_angle_rad: vec![0.0; 4],
            rate_change_b_rad_s,
            noise_rad_s: 1e-4,
        }
    }

    /// Axes without products of inertia, so that numbers can be had by hand.
    fn model() -> PlatformModel {
        let mut model = PlatformModel::whorl_1_reference();
        let inertia = nalgebra::Matrix3::from_diagonal(&Vector3::new(5.0, 5.0, 10.0));
        model.mass_properties = MassProperties::new(inertia, Vector3::new(0.0, 0.0, -2.0), 80.0).unwrap();
        model
    }

    #[test]
    fn a_wheel_pushes_the_body_the_other_way() {
        // 0.1 N m for 0.5 s about x: 0.05 N m s, over 5 kg m^2: -0.01 rad/s.
        let model = model();
        let size = |x| match judge(&model, &ModelPrior::typical(&model), &trial(Part::Wheel(0), x, 0.0, 0.0))
        {
            Some(Finding::Right(size) | Finding::Size(size)) => size.size,
            other => panic!("{other:?}"),
        };
        assert!((size(-0.01) - 1.0).abs() < 1e-9 && (size(-0.03) - 3.0).abs() < 1e-9);
        assert!(
            !judge(&model, &ModelPrior::typical(&model), &trial(Part::Wheel(0), -0.03, 0.0, 0.0))
                .unwrap()
                .is_right()
        );
        assert_eq!(
            judge(&model, &ModelPrior::typical(&model), &trial(Part::Wheel(0), 0.01, 0.0, 0.0)),
            Some(Finding::Reversed)
        );
        assert_eq!(
            judge(&model, &ModelPrior::typical(&model), &trial(Part::Wheel(0), 0.0, -0.01, 0.0)),
            Some(Finding::Like(vec![Part::Wheel(1)]))
        );
        assert_eq!(
            judge(&model, &ModelPrior::typical(&model), &trial(Part::Wheel(0), 1e-4, 0.0, 0.0)),
            Some(Finding::Nothing)
        );
        assert_eq!(judge(&model, &ModelPrior::typical(&model), &trial(Part::Wheel(9), 1e-4, 0.0, 0.0)), None);
    }

    #[test]
    fn a_gimbal_pushes_across_its_axis_and_its_rotors() {
        // Gimbal about z, rotor along x with 2 N m s: turned by 0.05 rad, its momentum is 2 (cos 0.05, sin 0.05, 0).
        let mut model = model();
        let gyro = Gyro {
            name: "gyro_a".to_owned(),
            gimbal_axis_b: Vector3::z_axis(),
            spin_axis_b: Vector3::x_axis(),
            rotor_momentum_n_m_s: 2.0,
            gimbal_inertia_kg_m2: 1e-3,
            max_rate_rad_s: 1.0,
            max_angle_rad: 3.0,
            time_constant_s: 0.01,
            viscous_friction_n_m_s: 0.0,
            coulomb_friction_n_m: 0.0,
        };
        model.gyros_mut().push(gyro);
        let moved = 2.0 * Vector3::new(0.05_f64.cos() - 1.0, 0.05_f64.sin(), 0.0) / -5.0;
        let expected = Part::Gyro(0).expected_b_rad_s(&model, 0.1, 0.5, &[0.0]).unwrap();
        assert!((expected - moved).norm() < 1e-5, "{expected} {moved}");
        let found = judge(&model, &ModelPrior::typical(&model), &trial(Part::Gyro(0), moved.x, moved.y, 0.0))
            .unwrap();
        assert!(found.is_right(), "{found:?}");
        let found =
            judge(&model, &ModelPrior::typical(&model), &trial(Part::Gyro(0), -moved.x, -moved.y, 0.0))
                .unwrap();
        assert_eq!(found, Finding::Reversed);
        assert!(found.words(Part::Gyro(0), &model).contains("motors.gyro_a"));
    }

    #[test]
    fn exchanged_valves_are_named() {
        // 0.4 N up at x = 0.45 m is -0.18 N m about y, at y = 0.45 m +0.18 N m about x; the third is sideways.
        let mut model = model();
        model.jets_mut().truncate(3);
        let places = [
            (Vector3::x(), Vector3::z_axis()),
            (Vector3::y(), Vector3::z_axis()),
            (Vector3::x(), Vector3::y_axis()),
        ];
        for (jet, (place, force)) in model.jets_mut().iter_mut().zip(places) {
            (jet.position_b_m, jet.force_direction_b, jet.thrust_n) = (place * 0.45, force, 0.4);
        }
        let right = Part::Jet(0).expected_b_rad_s(&model, 0.0, 0.5, &[]).unwrap();
        assert!((right - Vector3::new(0.0, -0.018, 0.0)).norm() < 1e-12, "{right}");
        assert!(
            judge(&model, &ModelPrior::typical(&model), &trial(Part::Jet(0), 0.0, -0.018, 0.0))
                .unwrap()
                .is_right()
        );
        let finding =
            judge(&model, &ModelPrior::typical(&model), &trial(Part::Jet(0), 0.018, 0.0, 0.0)).unwrap();
        assert_eq!(finding, Finding::Like(vec![Part::Jet(1)]));
        let other = Part::Jet(1).name(&model);
        assert!(finding.words(Part::Jet(0), &model).contains(other));
        assert_eq!(
            judge(&model, &ModelPrior::typical(&model), &trial(Part::Jet(0), 0.0, 0.018, 0.0)),
            Some(Finding::Reversed)
        );
        let finding =
            judge(&model, &ModelPrior::typical(&model), &trial(Part::Jet(0), 0.01, 0.01, 0.01)).unwrap();
        assert_eq!(finding, Finding::Elsewhere);
    }

    /// Priors of 5 % of the inertia, 5 % of a thrust: three deviations of both, and of what is measured.
    #[test]
    fn a_size_is_right_within_what_the_priors_leave_open() {
        let model = model();
        let prior = ModelPrior::typical(&model);
        let found =
            |size: f64| judge(&model, &prior, &trial(Part::Wheel(0), -0.01 * size, 0.0, 0.0)).unwrap();
        for (size, is_right) in
            [(0.5, false), (0.75, false), (0.93, true), (1.0, true), (1.08, true), (1.33, false)]
        {
            assert_eq!(found(size).is_right(), is_right, "{size}: {:?}", found(size));
        }
        let words = found(1.33).words(Part::Wheel(0), &model);
        assert!(words.starts_with("stronger than the model by 33 % +- 2 %"), "{words}");
        let words = found(0.6).words(Part::Wheel(0), &model);
        assert!(
            words.starts_with("weaker than the model by 40 % +- 2 %") && !words.contains("scale"),
            "{words}"
        );
        assert!(found(3.0).words(Part::Wheel(0), &model).contains("is the scale right?"));
        // It is used all the same to bring the platform to rest.
        assert_eq!((found(1.33).answer(), found(3.0).answer()), (1.0, 0.0));
        // Who knows the platform better is told more.
        let known = ModelPrior { inertia_b_kg_m2: prior.inertia_b_kg_m2 * 0.01, ..prior.clone() };
        let trial = trial(Part::Wheel(0), -0.0108, 0.0, 0.0);
        let (loose, tight) = (judge(&model, &prior, &trial).unwrap(), judge(&model, &known, &trial).unwrap());
        assert!(loose.size().unwrap().tolerance > tight.size().unwrap().tolerance);
        // Two attempts, of which one lasted twice as long, have the mean of their sizes, and less noise.
        let twice =
            Trial { rate_change_b_rad_s: Vector3::new(-0.024, 0.0, 0.0), length_s: 1.0, ..trial.clone() };
        let mean = Trial::mean(&[trial.clone(), twice]).unwrap();
        assert!((mean.rate_change_b_rad_s.x + 0.0114).abs() < 1e-12, "{mean:?}");
        assert!((mean.noise_rad_s - 1e-4 * 1.25_f64.sqrt() / 2.0).abs() < 1e-12, "{mean:?}");
        assert!(Trial::mean(&[]).is_none());
        // Driven the other way it does the opposite.
        let back =
            Trial { command: -0.1, rate_change_b_rad_s: Vector3::new(0.0124, 0.0, 0.0), ..trial.clone() };
        let mean = Trial::mean(&[trial.clone(), back]).unwrap();
        assert!((mean.rate_change_b_rad_s.x + 0.0116).abs() < 1e-12, "{mean:?}");
        let size = judge(&model, &prior, &mean).unwrap().size().unwrap();
        assert!((size.size - 1.16).abs() < 1e-9, "{size:?}");
        // A noisy gyro widens what is right.
        let noisy = Trial { noise_rad_s: 1e-3, ..trial.clone() };
        assert!(judge(&model, &known, &noisy).unwrap().size().unwrap().stddev > 0.1);
    }
}
