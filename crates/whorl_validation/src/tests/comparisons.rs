//! Right and wrong models.

use std::collections::BTreeMap;

use super::compare;
use super::generator::{Manoeuvre, platform, record};
use crate::Comparison;
use whorl_prediction::PredictionError;
use whorl_recording::{Refusal, Why};

#[test]
fn the_right_model_leaves_noise() {
    let model = platform();
    let comparison = compare(&record(&model, &Manoeuvre::default()), &model).unwrap();
    assert!(comparison.is_noise() && !comparison.unexplained.is_some(), "{}", comparison.answer());
    assert!(comparison.absolute.chi_squared_per_degree > 0.95, "{:?}", comparison.absolute);
    let error = comparison.prediction_error().unwrap();
    assert!((error - 1.0).abs() < 0.03, "{error}");
    assert_eq!(comparison.channels.len(), 3 + 3 + 1 + 3);
    for channel in &comparison.channels {
        // Of forty, some are outside their 99 % band; none is far outside.
        for h in &channel.horizons {
            let (low, high) = h.band_99;
            assert!(h.ratio > 0.9 * low && h.ratio < 1.1 * high, "{} {h:?}", channel.name);
        }
        let gyro = channel.quantity == whorl_recording::Channel::Gyro;
        let fit = channel.horizons[2].fit_percent;
        assert!(!gyro || fit.is_none_or(|f| f > 60.0), "{} {fit:?}", channel.name);
    }
    for w in &comparison.whiteness {
        assert!(w.ljung_box.p_value > 1e-4, "{} {:?}", w.channel, w.ljung_box);
    }
    assert!(comparison.answer().contains("explains the data to the noise"), "{}", comparison.answer());
    let said = comparison.said_of_innovations();
    assert!(said.contains("are white") && comparison.whiteness.len() == 3 + 3 + 2 + 3, "{said}");
}

/// Whether something is left and how much of it are two statements: a long run shows the smallest error for certain.
#[test]
fn an_error_that_is_significant_and_small_is_said_to_be_small() {
    let model = platform();
    let right = compare(&record(&model, &Manoeuvre::default()), &model).unwrap();
    assert!(right.is_noise() && right.prediction_error().unwrap() < 1.03);
    let said = |change: &dyn Fn(&mut Comparison)| {
        let mut changed = right.clone();
        for channel in &mut changed.channels {
            channel.horizons.iter_mut().for_each(|h| h.ratio = h.ratio.min(1.05));
        }
        change(&mut changed);
        assert!(!changed.is_noise());
        changed.answer()
    };
    // The square root of 1.0609 is 1.03.
    let small = said(&|c| c.absolute.chi_squared_per_degree = 1.0608);
    assert!(
        small.contains("the model explains the data within 3 %, though what is left is significant: "),
        "{small}"
    );
    assert!(small.contains("chi-squared per degree of freedom 1.06") && !small.contains("Worst"), "{small}");
    let torque = said(&|c| c.unexplained.torque_b_n_m[2] = 1e-3);
    assert!(
        torque.contains(" %, though what is left is significant") && torque.contains("Unexplained"),
        "{torque}"
    );
    for large in [
        said(&|c| c.absolute.chi_squared_per_degree = 1.3),
        said(&|c| {
            c.absolute.chi_squared_per_degree = 1.06;
            c.channels[0].horizons[2].ratio = 3.0;
        }),
    ] {
        assert!(
            large.contains("the model does not explain the data") && !large.contains("within"),
            "{large}"
        );
    }
}

#[test]
fn a_missing_torque_shows_more_the_longer_the_horizon() {
    let model = platform();
    let mut truth = model.clone();
    let drag = BTreeMap::from([("torque_n_m".to_owned(), 0.02)]);
    truth.effects.insert("bearing_coulomb_friction".to_owned(), drag);
    let recording = record(&truth, &Manoeuvre::default());
    let comparison = compare(&recording, &model).unwrap();
    assert!(!comparison.is_noise() && comparison.absolute.chi_squared_per_degree > 1.5, "{comparison:?}");
    assert!(comparison.unexplained.torque_b_n_m[2] > 1e-3, "{:?}", comparison.unexplained);
    let gyro = &comparison.channels[2];
    let ratios: Vec<f64> = gyro.horizons.iter().map(|h| h.ratio).collect();
    assert!(
        ratios[0] < 1.2 && ratios[1] > ratios[0] && ratios[2] > 2.0 && ratios[3] > ratios[2],
        "{ratios:?}"
    );
    let answer = comparison.answer();
    assert!(answer.contains("does not explain") && answer.contains("Worst is"), "{answer}");
    let said = comparison.said_of_innovations();
    assert!(said.contains("are correlated") && said.contains(" over about "), "{said}");
    // With the effect in the model, only noise remains.
    assert!(compare(&recording, &truth).unwrap().is_noise());
}

#[test]
fn the_noise_is_that_of_the_run() {
    let mut model = platform();
    model.mass_properties = whorl_dynamics::MassProperties::new(
        *model.mass_properties.inertia_b_kg_m2(),
        nalgebra::Vector3::new(0.0, 0.0, -0.05),
        110.0,
    )
    .unwrap();
    let mut noisy = model.clone();
    noisy.sensors.gyro.errors.noise_stddev *= 1.5;
    let quiet = Manoeuvre { wheel_torque_n_m: 0.0, jet_period_s: 0.0, ..Manoeuvre::default() };
    let comparison = compare(&record(&noisy, &quiet), &model).unwrap();
    let gyro = &comparison.channels[0];
    assert!((gyro.noise_floor / 1.7e-3 - 1.5).abs() < 0.03, "{}", gyro.noise_floor);
    assert!(comparison.remarks.iter().any(|r| r.contains("gyro's noise")), "{:?}", comparison.remarks);
    assert!((gyro.stated_noise / 1.7e-3 - 1.0).abs() < 0.01, "{}", gyro.stated_noise);
    assert!((gyro.horizons[0].ratio - 1.0).abs() < 0.08, "{:?}", gyro.horizons);
}

/// Each vector sensor has its own noise, whatever the platform's file says of them.
#[test]
fn vector_sensors_have_noise_of_their_own() {
    let model = platform();
    let mut recording = record(&model, &Manoeuvre { jet_period_s: 0.0, ..Manoeuvre::default() });
    let truth = recording.truth.clone().unwrap();
    let mut random = rand_pcg::Pcg64::new(6, 4);
    recording.vectors.clear();
    let stated = model.sensors.vector.unwrap().noise_stddev_rad;
    let sensors = [(nalgebra::Vector3::x_axis(), 0.5 * stated), (nalgebra::Vector3::y_axis(), 6.0 * stated)];
    for (reference_world, stddev_rad) in sensors {
        let noise = rand_distr::Normal::new(0.0, stddev_rad).unwrap();
        let seen =
            truth.q_world_body.time_s.iter().zip(&truth.q_world_body.value).step_by(5).map(|(t, q)| {
                let turn =
                    nalgebra::Vector3::from_fn(|_, _| rand_distr::Distribution::sample(&noise, &mut random));
                let exact = q.inverse_transform_vector(&reference_world);
                (*t, whorl_math::quaternion_exp(&turn) * exact)
            });
        let direction_b = seen.collect();
        recording.vectors.push(whorl_recording::VectorChannel { reference_world, direction_b });
    }
    let comparison = compare(&recording, &model).unwrap();
    let of = |name: &str| comparison.channels.iter().find(|channel| channel.name == name).unwrap();
    for (name, (_, stddev_rad)) in ["vector_1", "vector_2"].iter().zip(sensors) {
        let ratio = of(name).noise_floor / (2f64.sqrt() * stddev_rad);
        assert!((ratio - 1.0).abs() < 0.06, "{name}: {ratio}");
        assert!((of(name).horizons[0].ratio - 1.0).abs() < 0.1, "{name}: {:?}", of(name).horizons);
    }
    for said in ["vector sensor 1's noise in this run is 0.", "vector sensor 2's noise in this run is "] {
        assert!(comparison.remarks.iter().any(|r| r.contains(said)), "{said} {:?}", comparison.remarks);
    }
    assert!(comparison.is_noise(), "{}", comparison.answer());
}

#[test]
fn a_run_without_motion_says_so() {
    let mut model = platform();
    model.freedom = whorl_dynamics::Freedom::Free;
    let still =
        Manoeuvre { wheel_torque_n_m: 0.0, jet_period_s: 0.0, duration_s: 20.0, ..Manoeuvre::default() };
    let mut recording = record(&model, &still);
    let mut random = rand_pcg::Pcg64::new(4, 4);
    let noise = rand_distr::Normal::new(0.0, 1.7e-3).unwrap();
    for rate in &mut recording.gyro_b_rad_s.value {
        *rate = nalgebra::Vector3::from_fn(|_, _| rand_distr::Distribution::sample(&noise, &mut random));
    }
    let still = |remarks: &[String]| remarks.iter().any(|r| r.contains("No rate and no speed moves"));
    recording.wheel_speed_rad_s = Default::default();
    recording.wheel_torque_command_n_m = Default::default();
    recording.vectors.clear();
    assert!(still(&compare(&recording, &model).unwrap().remarks));
    let moving = record(&model, &Manoeuvre { duration_s: 20.0, ..Manoeuvre::default() });
    assert!(!still(&compare(&moving, &model).unwrap().remarks));
}

#[test]
fn the_constant_channel_has_no_fit_and_a_lost_channel_is_said() {
    let model = platform();
    let mut recording = record(&model, &Manoeuvre { duration_s: 20.0, ..Manoeuvre::default() });
    recording.wheel_torque_command_n_m = Default::default();
    recording.jet_pulses.clear();
    recording.vectors.clear();
    recording.specific_force_b_m_s2 = Default::default();
    let comparison = compare(&recording, &model).unwrap();
    assert_eq!(comparison.channels.len(), 3, "gyro only");
    for word in ["torque commands", "accelerometer", "vector sensor", "jets' commands"] {
        assert!(comparison.remarks.iter().any(|r| r.contains(word)), "{word}: {:?}", comparison.remarks);
    }
}

#[test]
fn unusable_recordings_get_a_sentence() {
    let model = platform();
    let good = record(&model, &Manoeuvre { duration_s: 8.0, ..Manoeuvre::default() });
    let mut no_gyro = good.clone();
    no_gyro.gyro_b_rad_s = Default::default();
    assert!(matches!(
        compare(&no_gyro, &model),
        Err(PredictionError::Refused(Refusal { why: Why::Missing("gyro", _), .. }))
    ));
    let mut degrees = good.clone();
    for rate in &mut degrees.gyro_b_rad_s.value {
        *rate *= 57.3 * 20.0;
    }
    let error = compare(&degrees, &model).unwrap_err().to_string();
    assert!(error.contains("deg/s"), "{error}");
    let mut in_g = good.clone();
    for force in &mut in_g.specific_force_b_m_s2.value {
        *force /= 9.81;
    }
    assert!(compare(&in_g, &model).unwrap_err().to_string().contains("(g or m/s^2)"));
    let mut other = model.clone();
    other.wheels_mut().pop();
    assert!(matches!(
        compare(&good, &other),
        Err(PredictionError::Refused(Refusal { why: Why::Count("wheels", 3, 2), .. }))
    ));
    let short = record(&model, &Manoeuvre { duration_s: 0.3, ..Manoeuvre::default() });
    assert!(matches!(
        compare(&short, &model),
        Err(PredictionError::Refused(Refusal { why: Why::TooFew(..), .. }))
    ));
    let mut no_x = good.clone();
    no_x.no_gyro_axis[0] = true;
    assert!(
        compare(&no_x, &model).unwrap_err().to_string().contains("on all axes that the platform turns about")
    );
    let mut unknown = model.clone();
    unknown.sensors.accelerometer.fitted = false;
    assert!(compare(&good, &unknown).unwrap_err().to_string().contains("sensors.accelerometer"));
}
