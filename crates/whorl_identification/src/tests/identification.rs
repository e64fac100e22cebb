//! Identification on simulated runs whose truth is known.

use std::ops::Range;

use whorl_dynamics::{Gyrostat, ModelPrior, PlatformModel};
use whorl_recording::{Recording, Refusal, Why};

use super::simulation::{at_balance, record, swinging, wrong_model};

use whorl_dynamics::mass_parameters::{MASS_PARAMETERS, NAMES, mass_vector};

use crate::{Determined, DiagnosisError, Identification, Options, identify};

fn run_of(truth: &PlatformModel, seed: u64) -> Recording {
    record(truth, at_balance(truth), 100.0, seed, &swinging)
}

fn identified(
    run: &Recording,
    model: &PlatformModel,
    prior: &ModelPrior,
) -> Result<Identification, DiagnosisError> {
    identify(std::slice::from_ref(run), model, prior, &Options::default())
}

/// Ten times the usual uncertainty, so that the result comes from the data.
fn loose(model: &PlatformModel) -> ModelPrior {
    let mut prior = ModelPrior::typical(model);
    prior.inertia_b_kg_m2 *= 10.0;
    prior.gravity_offset_b_n_m *= 10.0;
    prior
}

/// The same, with wheels known exactly as the dissertation assumes (section 4.6.4).
fn known_actuators(model: &PlatformModel) -> ModelPrior {
    let mut prior = loose(model);
    prior.actuators.wheels.spin_inertia.fill(0.0);
    prior.actuators.wheels.axis_rad.fill(0.0);
    prior
}

fn print(truth: &PlatformModel, found: &Identification) {
    let t = mass_vector(&truth.mass_properties);
    for (i, name) in NAMES.iter().enumerate() {
        println!("{name} true {:.4} found {:.4} +- {:.4}", t[i], found.estimate[i], found.stddev()[i],);
    }
    println!(
        "error {:?} -> {:?}, {:?} {:?}",
        found.error_before, found.error_after, found.others, found.findings
    );
}

/// Normalised squared error of the nine parameters: chi-squared with nine degrees of freedom.
fn normalised(truth: &PlatformModel, found: &Identification) -> f64 {
    let error = found.estimate - mass_vector(&truth.mass_properties);
    error.dot(&(found.covariance.try_inverse().unwrap() * error))
}

/// Required: 2 % with two vectors and 5 % with the accelerometer alone, products within
/// 0.02 kg m^2, from 100 s; the prior is ten times wider than usual and starts a tenth off.
fn all_nine_parameters(seeds: u64, band: Range<f64>) {
    let mut truth = PlatformModel::whorl_1_reference();
    let mut sum = 0.0;
    for (vector, share, product) in [(true, 0.02, 0.02), (false, 0.05, 0.05)] {
        if !vector {
            truth.sensors.vector = None;
        }
        for seed in 1..=seeds {
            let model = wrong_model(&truth);
            let found = identified(&run_of(&truth, seed), &model, &known_actuators(&truth)).unwrap();
            print(&truth, &found);
            assert!(found.usable(), "{:?}", found.findings);
            let t = mass_vector(&truth.mass_properties);
            for i in 0..MASS_PARAMETERS {
                let allowed = if [1, 2, 4].contains(&i) { product } else { share * t[i].abs() };
                assert!((found.estimate[i] - t[i]).abs() < allowed, "{} seed {seed}", NAMES[i]);
                assert_eq!(found.determined[i], Determined::Yes, "{}", NAMES[i]);
            }
            sum += normalised(&truth, &found);
        }
    }
    assert!(band.contains(&sum), "{sum}");
}

/// Of the sum 0.1 % to 99.9 % of chi-squared with 2 x 9 degrees of freedom.
#[test]
fn all_nine_parameters_from_a_hundred_seconds() {
    all_nine_parameters(1, 4.9..42.3);
}

/// 6 x 9 degrees of freedom.
#[test]
#[ignore = "slow: six runs of a hundred seconds"]
fn all_nine_parameters_from_a_hundred_seconds_of_more_runs() {
    all_nine_parameters(3, 27.5..91.9);
}

/// Where torques of wheels were not recorded, their speeds drive them; they turn round again and again. What was the readings' noise is
/// not taken for inertia, of wheels that hardly move either: the swings of two of them are no larger than ten times that noise.
fn speeds_of_wheels_do(seeds: u64, band: Range<f64>) {
    let truth = PlatformModel::whorl_1_reference();
    let mut sum = 0.0;
    for seed in 1..=seeds {
        let mut run = run_of(&truth, seed);
        run.wheel_torque_command_n_m = Default::default();
        let comparison = whorl_validation::compare(&run, &truth, None).unwrap();
        assert!(comparison.is_noise(), "{}", comparison.answer());
        // Friction and motors' limits are not in what speeds show: a model that is wrong there does as well.
        let mut model = wrong_model(&truth);
        for wheel in model.wheels_mut() {
            wheel.viscous_friction_n_m_s *= 3.0;
            wheel.max_torque_n_m *= 0.1;
        }
        let found = identified(&run, &model, &known_actuators(&truth)).unwrap();
        print(&truth, &found);
        assert!(found.usable(), "{:?}", found.findings);
        let (t, stddev) = (mass_vector(&truth.mass_properties), found.stddev());
        for i in 0..MASS_PARAMETERS {
            assert!((found.estimate[i] - t[i]).abs() < 4.0 * stddev[i], "{} seed {seed}", NAMES[i]);
            assert_eq!(found.determined[i], Determined::Yes, "{}", NAMES[i]);
        }
        sum += normalised(&truth, &found);
        for word in ["motor", "a torque remains"] {
            assert!(!found.findings.iter().any(|f| f.text.contains(word)), "{:?}", found.findings);
        }
    }
    assert!(band.contains(&sum), "{sum}");
}

/// Of the sum 0.1 % to 99.9 % of chi-squared with nine degrees of freedom.
#[test]
fn speeds_of_wheels_do_where_their_commands_are_missing() {
    speeds_of_wheels_do(1, 1.15..27.9);
}

/// 6 x 9 degrees of freedom.
#[test]
#[ignore = "slow: six runs of a hundred seconds"]
fn speeds_of_wheels_do_in_more_runs_where_their_commands_are_missing() {
    speeds_of_wheels_do(6, 27.5..91.9);
}

/// A still platform determines nothing, which must be reported.
#[test]
fn a_still_platform_determines_next_to_nothing() {
    let truth = PlatformModel::whorl_1_reference();
    let run = record(&truth, at_balance(&truth), 40.0, 2, &|_| vec![0.0; 3]);
    let found = identified(&run, &truth, &ModelPrior::typical(&truth)).unwrap();
    print(&truth, &found);
    for (name, determined) in NAMES.iter().zip(found.determined).take(6) {
        assert_ne!(determined, Determined::Yes, "{name}");
    }
    assert!(found.findings.iter().any(|f| f.text.contains("I_zz")), "{:?}", found.findings);
}

/// Only roll is moved: I_zz and I_yy must not be claimed.
#[test]
fn what_is_not_excited_is_not_claimed() {
    let truth = PlatformModel::whorl_1_reference();
    let run = record(&truth, at_balance(&truth), 60.0, 3, &|t| vec![0.03 * (1.1 * t).sin(), 0.0, 0.0]);
    let found = identified(&run, &wrong_model(&truth), &ModelPrior::typical(&truth)).unwrap();
    print(&truth, &found);
    assert_eq!(found.determined[0], Determined::Yes);
    assert_ne!(found.determined[5], Determined::Yes);
    // The truth is within the reported uncertainty in any case.
    let error = found.estimate - mass_vector(&truth.mass_properties);
    for i in 0..MASS_PARAMETERS {
        assert!(error[i].abs() < 4.0 * found.stddev()[i], "{}", NAMES[i]);
    }
}

/// The wheel whose recorded speeds are turned round, if so, is accused, and no other.
fn is_accused(wheel: usize, factor: f64, model: &PlatformModel) {
    let mut run = run_of(&PlatformModel::whorl_1_reference(), 4);
    for speeds in &mut run.wheel_speed_rad_s.value {
        speeds[wheel] *= factor;
    }
    let name = ["wheel_x", "wheel_y", "wheel_z"][wheel];
    let found = identified(&run, model, &ModelPrior::typical(model)).unwrap();
    let reasons: Vec<&str> = found.findings.iter().filter(|f| f.fatal).map(|f| f.text.as_str()).collect();
    println!("{name} {factor}: {reasons:?}");
    let accused: Vec<&&str> = reasons.iter().filter(|r| r.starts_with("wheel_")).collect();
    assert!(
        matches!(accused[..], [only] if only.starts_with(name) && only.contains("wrong way")),
        "{name}: {:?}",
        found.findings
    );
}

#[test]
fn a_wheel_whose_speeds_have_the_wrong_sign_is_named() {
    is_accused(2, -1.0, &PlatformModel::whorl_1_reference());
}

#[test]
#[ignore = "slow: two more wheels"]
fn a_wheel_with_the_wrong_axis_is_named() {
    let truth = PlatformModel::whorl_1_reference();
    is_accused(0, -1.0, &truth);
    let mut turned = truth;
    turned.wheels_mut()[1].spin_axis_b = -turned.wheels()[1].spin_axis_b;
    is_accused(1, 1.0, &turned);
}

/// Gaps, outliers and clipped samples reduce the data and do not bias the result.
#[test]
fn gaps_and_spikes_do_not_spoil_the_estimate() {
    let truth = PlatformModel::whorl_1_reference();
    let mut run = run_of(&truth, 5);
    let gap = |t: f64| (20.0..22.0).contains(&t) || (61.0..61.4).contains(&t);
    let keep: Vec<bool> = run.gyro_b_rad_s.time_s.iter().map(|t| !gap(*t)).collect();
    let mut at = keep.iter();
    run.gyro_b_rad_s.time_s.retain(|_| *at.next().unwrap());
    let mut at = keep.iter();
    run.gyro_b_rad_s.value.retain(|_| *at.next().unwrap());
    for k in (100..9000).step_by(977) {
        run.gyro_b_rad_s.value[k].x += 0.3;
        run.specific_force_b_m_s2.value[k].y -= 4.0;
    }
    for k in 3000..3020 {
        run.gyro_b_rad_s.value[k].z = 75.0_f64.to_radians();
    }
    let found = identified(&run, &wrong_model(&truth), &loose(&truth)).unwrap();
    print(&truth, &found);
    assert!(normalised(&truth, &found) < 27.9, "99.9 % of chi-squared(9)");
    for word in ["single gyro samples", "single accelerometer samples", "end of the sensor's range"] {
        assert!(found.findings.iter().any(|f| f.text.contains(word)), "{word}: {:?}", found.findings);
    }
}

#[test]
fn useless_recordings_are_refused_with_a_reason() {
    let truth = PlatformModel::whorl_1_reference();
    let prior = ModelPrior::typical(&truth);
    let refuse = |run: &Recording| identified(run, &truth, &prior).unwrap_err();
    let short = record(&truth, at_balance(&truth), 5.0, 1, &swinging);
    assert!(matches!(refuse(&short), DiagnosisError::Refused(Refusal { why: Why::TooShort(..), .. })));
    let mut no_gyro = run_of(&truth, 1);
    no_gyro.gyro_b_rad_s = Default::default();
    assert!(matches!(
        refuse(&no_gyro),
        DiagnosisError::Refused(Refusal { why: Why::Missing("gyro", _), .. })
    ));
    let mut wheels = run_of(&truth, 1);
    wheels.wheel_speed_rad_s.value.iter_mut().for_each(|w| w.truncate(2));
    assert!(matches!(refuse(&wheels), DiagnosisError::Refused(Refusal { why: Why::Count(_, 2, 3), .. })));
}

/// A gyro that ends well within the range that the model gives it: said, and the rest is used.
#[test]
fn clipped_peaks_are_left_out_whatever_the_model_says_of_the_range() {
    let truth = PlatformModel::whorl_1_reference();
    let mut run = run_of(&truth, 4);
    for rate in &mut run.gyro_b_rad_s.value {
        rate.z = rate.z.clamp(-0.15, 0.15);
    }
    let found = identified(&run, &truth, &loose(&truth)).unwrap();
    let text: String = found.findings.iter().map(|f| f.text.as_str()).collect();
    assert!(text.contains("gyro samples at the end of the sensor's range"), "{text}");
    let (t, sigma) = (mass_vector(&truth.mass_properties), found.stddev());
    for i in 0..MASS_PARAMETERS {
        let miss = (found.estimate[i] - t[i]) / sigma[i];
        assert!(miss.abs() < 4.0, "{}: {} true {} +- {}", NAMES[i], found.estimate[i], t[i], sigma[i]);
    }
}

/// A cable that twists and parts that stand in the wind, both adopted: the inertia is the platform's own, not what makes
/// up for their torque.
#[test]
fn adopted_effects_are_no_inertia() {
    let mut truth = PlatformModel::whorl_1_reference();
    let mut prior = known_actuators(&truth);
    let effects = [("harness_spring", "k_n_m_rad", 0.3, 0.05), ("air_drag_quadratic", "dz_n_m_s2", 1.0, 0.3)];
    for (id, name, value, stddev) in effects {
        truth.effects.insert(id.to_owned(), [(name.to_owned(), value)].into());
        prior.effects.insert(id.to_owned(), [(name.to_owned(), stddev)].into());
    }
    let run = run_of(&truth, 1);
    // Mass properties and the cable are a tenth off.
    let mut model = wrong_model(&truth);
    model.effects.insert("harness_spring".to_owned(), [("k_n_m_rad".to_owned(), 0.33)].into());
    let found = identified(&run, &model, &prior).unwrap();
    print(&truth, &found);
    assert!(found.usable(), "{:?}", found.findings);
    let t = mass_vector(&truth.mass_properties);
    for i in [0, 3, 5] {
        assert!((found.estimate[i] - t[i]).abs() < 0.01 * t[i], "{}", NAMES[i]);
    }
    // 99.9 % of chi-squared with nine degrees of freedom.
    let error = normalised(&truth, &found);
    assert!(error < 27.9, "{error}");
    for (_, name, value, stddev) in effects {
        let own = found.others.iter().find(|p| p.name == name).unwrap();
        assert!((own.estimate - value).abs() < 4.0 * own.stddev && own.stddev < 0.1 * stddev, "{own:?}");
    }
    // The same data without one of the two: what does not explain them is not used.
    for (id, ..) in effects {
        let mut poorer = model.clone();
        poorer.effects.remove(id);
        let wrong = identified(&run, &poorer, &prior).unwrap();
        print(&truth, &wrong);
        let fatal = wrong.findings.iter().find(|f| f.fatal).map(|f| f.text.as_str());
        assert!(fatal.is_some_and(|text| text.contains("does not explain")), "{id}: {:?}", wrong.findings);
        assert!(
            wrong.stddev()[5] > 2.0 * found.stddev()[5],
            "{id}: {} +- {}",
            wrong.estimate,
            wrong.stddev()
        );
    }
}

/// A correction of the platform's constants that was adopted is the parameter, and the constant stays: together they are found.
#[test]
fn corrections_of_constants_are_not_counted_twice() {
    let mut truth = PlatformModel::whorl_1_reference();
    for (id, name, value) in [("inertia_products", "ixy_kg_m2", 0.3), ("gravity_offset", "mgr_x_n_m", 0.05)] {
        truth.effects.insert(id.to_owned(), [(name.to_owned(), value)].into());
    }
    let prior = known_actuators(&truth);
    let found = identified(&run_of(&truth, 1), &wrong_model(&truth), &prior).unwrap();
    print(&truth, &found);
    assert!(found.usable(), "{:?}", found.findings);
    let (updated, known) = found.updated().unwrap();
    let total = |model: &PlatformModel| mass_vector(&Gyrostat::new(model).unwrap().model().mass_properties);
    let off = total(&updated) - total(&truth);
    let of_effect = |name: &str| found.others.iter().find(|p| p.name == name).unwrap().stddev;
    let own = found.stddev();
    let stddevs: [f64; MASS_PARAMETERS] = std::array::from_fn(|i| match i {
        1 => of_effect("ixy_kg_m2"),
        6 => of_effect("mgr_x_n_m"),
        _ => own[i],
    });
    for i in [0, 1, 3, 5, 6] {
        assert!(off[i].abs() < 4.0 * stddevs[i], "{}: {} +- {}", NAMES[i], off[i], stddevs[i]);
    }
    assert!(off[1].abs() < 0.05 && known.effects["inertia_products"]["ixy_kg_m2"] < 0.05);
}
