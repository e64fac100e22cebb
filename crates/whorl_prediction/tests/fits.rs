//! Parameters fitted to recordings of drawn rigs, closed loops among them: unbiased, with true deviations.

#![expect(clippy::unwrap_used, reason = "a test stops at a broken precondition")]

mod rigs;

use std::cell::RefCell;

use nalgebra::Vector3;
use rigs::Draw;
use whorl_dynamics::{MassProperties, PlatformModel};
use whorl_prediction::{
    CELL_S, Fitted, FrozenGains, Noise, Parameter, Prepared, Rival, Settings, Told, Varied, fit,
    fitted_start, frozen_gains, innovations, longest_cell_s, predict, sensitivities,
};

/// What of a rig is uncertain, each in standard deviations of what is known before.
const INERTIA: f64 = 0.05;
const OFFSET: f64 = 0.05;
const MOTOR: f64 = 0.05;
const FRICTION: f64 = 0.3;
const THRUST: f64 = 0.05;
/// From a model to the varied one, in standard deviations.
const STEP: f64 = 1e-3;
/// How far apart innovations are of which differences are taken, root mean square of their own deviations.
const APART: f64 = 0.3;

/// How many numbers of this model are uncertain.
fn count(model: &PlatformModel) -> usize {
    let body = if model.freedom.turns() { 1 } else { 0 };
    let weight = if model.freedom.has_weight() { 1 } else { 0 };
    let wheels = model.wheels().len();
    let rubs = model.wheels().iter().any(|w| w.viscous_friction_n_m_s > 0.0);
    body + weight + wheels * if rubs { 2 } else { 1 } + model.jets().len()
}

/// The model with these errors, in standard deviations; `None` where no body is so.
fn moved(model: &PlatformModel, at: &[f64]) -> Option<PlatformModel> {
    let mut at = at.iter().copied();
    let mut next = || at.next().unwrap_or(0.0);
    let (mut moved, properties) = (model.clone(), &model.mass_properties);
    let inertia = if model.freedom.turns() { 1.0 + INERTIA * next() } else { 1.0 };
    let offset = if model.freedom.has_weight() { 1.0 + OFFSET * next() } else { 1.0 };
    let offset_b_n_m: Vector3<f64> = properties.gravity_offset_b_n_m() * offset;
    let inertia_b_kg_m2 = properties.inertia_b_kg_m2() * inertia;
    moved.mass_properties = MassProperties::new(inertia_b_kg_m2, offset_b_n_m, properties.mass_kg()).ok()?;
    let mut constants = std::collections::BTreeMap::new();
    for wheel in moved.wheels_mut() {
        constants.insert(wheel.name.clone(), MOTOR * next());
        if wheel.viscous_friction_n_m_s > 0.0 {
            wheel.viscous_friction_n_m_s *= (FRICTION * next()).exp();
        }
    }
    if !constants.is_empty() {
        moved.effects.insert("wheel_motor_constant".to_owned(), constants);
    }
    for jet in moved.jets_mut() {
        jet.thrust_n *= 1.0 + THRUST * next();
    }
    Some(moved)
}

/// A drawn rig whose every uncertain number was estimated with each of these settings; what is true of them, and what the rig is.
fn estimates(seed: u64, settings: &[Settings]) -> (Vec<Fitted>, Vec<f64>, String) {
    let drawn = RefCell::new(Vec::new());
    let rig = rigs::drawn_as(seed, &|model: &PlatformModel, draw: &mut Draw| {
        let truth: Vec<f64> = (0..count(model)).map(|_| draw.normal()).collect();
        let really = moved(model, &truth).unwrap();
        drawn.replace(truth);
        really
    });
    let truth = drawn.into_inner();
    let parameters = vec![Parameter { stddev: 1.0, range: (-5.0, 5.0) }; truth.len()];
    let model_at = |at: &[f64]| moved(&rig.model, at);
    let from = vec![0.0; truth.len()];
    let recordings = [rig.recording];
    let all = settings.iter().map(|settings| {
        let settings =
            &Settings { cell_s: longest_cell_s(&recordings, &rig.model, settings).unwrap(), ..*settings };
        let found =
            fit(&recordings, &parameters, &model_at, std::slice::from_ref(&from), Rival::NONE, settings)
                .unwrap();
        assert!(found.log_posterior >= found.log_posterior_before, "{}", rig.what);
        found
    });
    (all.collect(), truth, rig.what)
}

/// What was estimated less what is true, over the stated deviation, of every uncertain number of a rig.
fn scores(seed: u64, settings: &Settings) -> Vec<f64> {
    let (found, truth, what) = estimates(seed, std::slice::from_ref(settings));
    let score = |i: usize| (found[0].at[i] - truth[i]) / found[0].covariance[(i, i)].sqrt();
    let scores: Vec<f64> = (0..truth.len()).map(score).collect();
    if scores.iter().any(|z| z.abs() > 3.5) {
        println!("{what}\n   {scores:?}");
    }
    scores
}

/// How the scores of these rigs scatter: their mean and standard deviation over what chance makes of so many normal ones.
fn judged(seeds: impl Iterator<Item = u64>, settings: &Settings) -> (f64, f64) {
    let all: Vec<f64> = seeds.flat_map(|seed| scores(seed, settings)).collect();
    let n = all.len() as f64;
    let mean = all.iter().sum::<f64>() / n;
    let stddev = (all.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    println!("measured: {n} scores of fits, mean {mean:.3}, standard deviation {stddev:.3}");
    (mean * n.sqrt(), (stddev - 1.0) * (2.0 * n).sqrt())
}

/// What a deviation to either side along each parameter costs, with gains that were kept and with those that the filter makes anew at
/// every place: by how much the two differ at most [natural logarithm].
fn costs_differ(seed: u64) -> Vec<f64> {
    let rig = rigs::drawn_as(seed, &|model: &PlatformModel, draw: &mut Draw| {
        let truth: Vec<f64> = (0..count(model)).map(|_| draw.normal()).collect();
        moved(model, &truth).unwrap()
    });
    let parameters = vec![Parameter { stddev: 1.0, range: (-5.0, 5.0) }; count(&rig.model)];
    let model_at = |at: &[f64]| moved(&rig.model, at);
    let recordings = [rig.recording];
    let from = vec![0.0; parameters.len()];
    let found = fit(&recordings, &parameters, &model_at, &[from], Rival::NONE, &Settings::default()).unwrap();
    let (noise, start) = (&found.followed[0].noise, &found.followed[0].fitted.start);
    // Where derivatives that are held are made anew depends on the model: a jump of what the whole filter says, and no difference.
    let settings = Settings { derivatives_held: 0.0, ..Settings::default() };
    let with = |at: &[f64], gains: Option<&FrozenGains>| {
        let model = moved(&rig.model, at).unwrap();
        let case = Prepared::new(&recordings[0], &model, settings).unwrap();
        let own = frozen_gains(&case, noise, start).unwrap();
        innovations(&case, noise, start, gains.unwrap_or(&own), &mut |_| {}).unwrap().log
    };
    let model = moved(&rig.model, &found.at).unwrap();
    let case = Prepared::new(&recordings[0], &model, settings).unwrap();
    let gains = frozen_gains(&case, noise, start).unwrap();
    let information = found.covariance.clone().try_inverse().unwrap();
    let differ = |i: usize| {
        // A deviation given the others.
        let step = information[(i, i)].sqrt().recip();
        let cost = |step: f64, gains: Option<&FrozenGains>| {
            let mut at = found.at.clone();
            at[i] += step;
            with(&found.at, gains) - with(&at, gains)
        };
        [step, -step]
            .map(|step| (cost(step, None) - cost(step, Some(&gains))).abs())
            .into_iter()
            .fold(0.0, f64::max)
    };
    (0..parameters.len()).map(differ).collect()
}

/// What is gained or lost by the change of gains is no evidence, even of recordings of a second whose gains have hardly settled.
#[test]
fn gains_that_are_kept_say_what_the_whole_filter_says() {
    let all: Vec<f64> = (100..130).filter(|seed| is_quick(*seed)).flat_map(costs_differ).collect();
    let most = all.iter().copied().fold(0.0, f64::max);
    let root_mean_square = (all.iter().map(|x| x * x).sum::<f64>() / all.len() as f64).sqrt();
    println!("measured: {} parameters, costs differ by {root_mean_square:.3}, at most {most:.3}", all.len());
    let evidence = Settings::default().fit_round_nats;
    assert!(
        all.len() > 40 && root_mean_square < 0.2 * evidence && most < evidence,
        "{root_mean_square} {most}"
    );
}

/// Slow rigs that are sampled once or a few times a second for half an hour take long.
fn is_quick(seed: u64) -> bool {
    rigs::drawn(seed).model.sensors.rate_hz > 30.0
}

#[test]
fn estimates_scatter_as_they_say() {
    let (mean, stddev) = judged((0..40).filter(|seed| is_quick(*seed)), &Settings::default());
    assert!(mean.abs() < 3.3 && stddev.abs() < 3.3, "{mean} {stddev} of what chance makes");
}

/// Settings with which readings are taken in together.
fn by_means() -> Settings {
    Settings { cell_s: CELL_S, ..Settings::default() }
}

/// Readings that are taken in together say of parameters what each of them says: the same values, as well known, but for what is lost of motions that are
/// as fast as the mean is long.
#[test]
fn means_of_readings_say_what_readings_say() {
    let mut worst: Vec<(f64, f64)> = Vec::new();
    for seed in (40..70).filter(|seed| is_quick(*seed)) {
        let (found, truth, what) = estimates(seed, &[Settings::default(), by_means()]);
        for i in 0..truth.len() {
            let [each, mean] = [0, 1].map(|k: usize| (found[k].at[i], found[k].covariance[(i, i)].sqrt()));
            // What a mean does not show is noise of the estimate by means alone.
            let lost = (mean.1.powi(2) - each.1.powi(2)).max(0.0).sqrt();
            let apart = (mean.0 - each.0).abs() / lost.hypot(0.15 * each.1);
            if apart > 1.5 || mean.1 / each.1 > 1.05 {
                println!("{what}: number {i}: {each:?} {mean:?}");
            }
            worst.push((apart, mean.1 / each.1));
        }
    }
    let most = |of: fn(&(f64, f64)) -> f64| worst.iter().map(of).fold(0.0, f64::max);
    let (apart, wider) = (most(|x| x.0), most(|x| x.1));
    println!(
        "measured: {} numbers, apart {apart:.2} at most, deviations {wider:.2} times at most",
        worst.len()
    );
    assert!(worst.len() > 40 && apart < 2.5 && wider < 1.1, "{apart} {wider}");
}

#[test]
#[ignore = "slow: fits to three hundred rigs"]
fn estimates_of_many_rigs_scatter_as_they_say() {
    for settings in [Settings::default(), by_means()] {
        let (mean, stddev) = judged((2000..2300).filter(|seed| is_quick(*seed)), &settings);
        assert!(mean.abs() < 3.3 && stddev.abs() < 3.3, "{mean} {stddev} of what chance makes");
    }
}

/// Whether a filter by derivatives is sure of the attitude that it has: about a single direction that is seen, the swing alone tells it
/// slowly, and with the attitude every gain changes.
fn sees_its_attitude(model: &PlatformModel) -> bool {
    let sensors = &model.sensors;
    !model.freedom.has_weight() || sensors.accelerometer.fitted || sensors.vector.is_none()
}

/// Innovations change as the columns say: against whole passes with each parameter to either side.
#[test]
fn sensitivities_are_differences_of_innovations() {
    // Where derivatives that are held are made anew depends on the model: a jump, and no derivative.
    let settings = Settings { derivatives_held: 0.0, ..Settings::default() };
    for seed in (0..45).filter(|seed| is_quick(*seed)) {
        let rig = rigs::drawn(seed);
        // A difference over a wheel that comes to rest earlier or later is no derivative.
        let rubs = rig.model.wheels().iter().any(|wheel| wheel.coulomb_friction_n_m > 0.0);
        if rubs || !sees_its_attitude(&rig.model) {
            continue;
        }
        let along = |k: usize, step: f64| {
            let mut at = vec![0.0; count(&rig.model)];
            at[k] = step;
            moved(&rig.model, &at).unwrap()
        };
        let case = Prepared::new(&rig.recording, &rig.model, settings).unwrap();
        let noise = Noise::stated(&case).unwrap();
        let start = fitted_start(&case, &noise).start;
        let varied = |k: usize| Varied { model: along(k, STEP), step: STEP };
        let varied: Vec<Varied> = (0..count(&rig.model)).map(varied).collect();
        let mut found = Vec::new();
        sensitivities(&case, &noise, &start, &varied, &mut |e, d| found.push((*e, d / e.stddev))).unwrap();
        let root_n = (found.len() as f64).sqrt();
        for k in 0..varied.len() {
            let size = found.iter().map(|(_, d)| d[k].powi(2)).sum::<f64>().sqrt();
            let step = (APART * root_n / size).min(0.1);
            let [plus, minus] = [step, -step].map(|step| {
                let model = along(k, step);
                let case = Prepared::new(&rig.recording, &model, settings).unwrap();
                let mut values = Vec::new();
                predict(&case, &noise, &start, &[], &mut |told| {
                    if let Told::Innovation(e) = told {
                        values.push(e.value);
                    }
                });
                values
            });
            assert_eq!(plus.len(), found.len());
            let differences = plus.iter().zip(&minus).map(|(plus, minus)| (plus - minus) / (2.0 * step));
            let off =
                differences.zip(&found).map(|(difference, (e, d))| (d[k] - difference / e.stddev).powi(2));
            let off = off.sum::<f64>().sqrt();
            // Gains move with the parameters too, in innovations of size one.
            assert!(
                off < 0.03 * size + 0.05 * root_n,
                "{}: parameter {k} is off by {off} of {size}",
                rig.what
            );
        }
    }
}
