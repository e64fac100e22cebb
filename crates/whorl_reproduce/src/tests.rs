//! The sentences of each item must agree with its numbers.

use std::collections::BTreeMap;
use std::sync::{LazyLock, OnceLock};

use super::*;

/// An item, made once.
fn item(name: &str) -> &'static Reproduction {
    static MADE: LazyLock<BTreeMap<&str, OnceLock<Reproduction>>> =
        LazyLock::new(|| ITEMS.iter().map(|(name, _)| (*name, OnceLock::new())).collect());
    MADE[name].get_or_init(|| reproduce(name).unwrap())
}

/// Points of a curve of the n-th plot; of the first of that name.
fn curve(name: &str, plot: usize, curve: &str) -> &'static [(f64, f64)] {
    let plot = &item(name).plots[plot];
    let found = plot.curves.iter().chain(&plot.dashed).find(|(n, _)| n == curve);
    &found.unwrap_or_else(|| panic!("{name} has no {curve}")).1
}

/// Upper edge of the band in which all curves of a plot should stay.
fn upper_edge(name: &str, plot: usize) -> &'static [(f64, f64)] {
    let band = &item(name).plots[plot].band_of_all;
    &band.as_ref().unwrap_or_else(|| panic!("{name} has no band"))[1]
}

fn largest(points: &[(f64, f64)]) -> f64 {
    points.iter().map(|(_, y)| y.abs()).fold(0.0, f64::max)
}

/// Mean of |y| from `from` on.
fn mean_after(points: &[(f64, f64)], from: f64) -> f64 {
    let after: Vec<f64> = points.iter().filter(|(x, _)| *x >= from).map(|(_, y)| y.abs()).collect();
    after.iter().sum::<f64>() / after.len() as f64
}

/// Numbers of a table by the row's name.
fn rows(name: &str) -> BTreeMap<&'static str, Vec<f64>> {
    let (_, rows) = item(name).table.as_ref().unwrap();
    rows.iter()
        .map(|row| (row[0].as_str(), row[1..].iter().map(|c| c.parse().unwrap_or(f64::NAN)).collect()))
        .collect()
}

#[test]
fn every_item_shows_something() {
    for (name, _) in ITEMS {
        let item = item(name);
        let has_rows = item.table.as_ref().is_some_and(|(headings, rows)| {
            !rows.is_empty() && rows.iter().all(|row| row.len() == headings.len())
        });
        assert!(has_rows || !item.plots.is_empty(), "{name} shows nothing");
        for plot in &item.plots {
            assert!(plot.curves.len() > 1 || name == "fig_4_8", "{name}: {}", plot.title);
            for (curve, points) in plot.curves.iter().chain(&plot.dashed) {
                assert!(points.len() > 8, "{name}: {curve} has {} points", points.len());
                assert!(points.iter().all(|(x, y)| x.is_finite() && y.is_finite()), "{name}: {curve}");
            }
        }
        assert!(!item.sentences.is_empty(), "{name} says nothing on differences");
        assert!(item.sentences.iter().all(|s| !s.contains("NaN") && !s.contains("refuse")), "{name}");
    }
    assert_eq!(reproduce("fig_9_9"), None);
}

#[test]
fn torques_of_the_earth_and_of_the_air() {
    let [drag, earth, printed] = [
        "air drag",
        "rotation of the Earth (plumb line as vertical)",
        "rotation of the Earth, eq. 4.25 as printed",
    ]
    .map(|c| curve("fig_4_4", 0, c));
    let end = drag.len() - 1;
    assert!(drag[end].1 > 10.0 * earth[end].1 && drag[0].1 < 0.1 * earth[0].1);
    // Centrifugal acceleration by hand: (7.292e-5 rad/s)^2 * 6.371e6 m * cos 37.21 deg = 0.02698 m/s^2, over g and
    // times the gravity offset of 2.001 N m: 5.5 mN m, and 0.3 %.
    assert!((printed[0].1 - 5.50e-3).abs() < 0.02e-3, "{}", printed[0].1);
    assert!(item("fig_4_4").sentences[2].contains("torque of 0.3 %"), "{}", item("fig_4_4").sentences[2]);
}

#[test]
fn calibrations_find_what_was_put_in() {
    // "bias 0.1201 +- 0.0073 m/s^2 (truth 0.1200), scale error 1.794 +- 0.090 % (truth 1.800)": faces that lie 0.5 deg off level, and
    // angles between the axes of which six faces say nothing, up to 0.1 rad, leave 9.81 m/s^2 * 0.5 deg * 0.1 = 0.0086 m/s^2
    // for each of two angles.
    let numbers = |sentence: &str| -> Vec<f64> {
        sentence.split([' ', '(', ')', ',']).filter_map(|word| word.parse().ok()).collect()
    };
    for sentence in &item("fig_4_7").sentences[..3] {
        let found = numbers(sentence);
        assert_eq!(found.len(), 6, "{sentence}");
        for n in [0, 3] {
            assert!((found[n] - found[n + 2]).abs() < 4.0 * found[n + 1], "{sentence}");
        }
        assert!(found[1] < 0.0172 && found[4] < 0.1, "{sentence}");
    }
    // The level error: 1 - cos 0.5 deg = 3.8e-5, and 9.81 m/s^2 * sin 0.5 deg = 0.0856 m/s^2.
    assert!(
        item("fig_4_7").sentences[3].contains("0.004 %")
            && item("fig_4_7").sentences[3].contains("0.09 m/s^2")
    );
    let found = numbers(&item("fig_4_8").sentences[0]);
    assert!((found[0] - found[2]).abs() < 4.0 * found[1] && found[1] < 0.5, "{found:?}");
    let turned = curve("fig_4_8", 1, "calibrated").last().unwrap().1;
    assert!((turned - 90.0).abs() < 0.5, "{turned}");
    assert!((curve("fig_4_8", 1, "bias taken off").last().unwrap().1 - 90.0).abs() > 3.0);
}

#[test]
fn normal_samples_pass_the_test_of_their_distribution() {
    assert!(item("fig_4_9").sentences[0].contains(": normal."), "{}", item("fig_4_9").sentences[0]);
    // The sentences' numbers on chi-squared with 16 degrees of freedom, whose tail is e^-h sum_{k < 8} h^k / k!, h = x/2.
    let tail = |x: f64| {
        let h = 0.5 * x;
        let terms = (1..8).scan(1.0, |term, k| {
            *term *= h / f64::from(k);
            Some(*term)
        });
        (-h).exp() * (1.0 + terms.sum::<f64>())
    };
    assert!((tail(32.0) - 0.01).abs() < 1e-4, "{}", tail(32.0));
    assert!((1.0 / tail(31.0) - 75.0).abs() < 1.0, "{}", 1.0 / tail(31.0));
    // The density is minus the tail's slope.
    let density = (tail(31.99) - tail(32.01)) / 0.02;
    assert!((density - 0.003).abs() < 5e-4, "{density}");
}

#[test]
fn a_spin_is_tracked_within_its_envelope() {
    for (axis, within_deg_s) in [("x", 1.0), ("y", 1.0), ("z", 1.0)] {
        let (found, truth) = (curve("fig_4_10", 1, axis), curve("fig_4_10", 1, &format!("{axis} true")));
        let worst = found.iter().zip(truth).map(|(a, b)| (a.1 - b.1).abs()).fold(0.0, f64::max);
        assert!(worst < within_deg_s, "{axis}: {worst} deg/s");
    }
    let sigma = upper_edge("fig_4_11", 0);
    for axis in ["x", "y", "z"] {
        let outside = curve("fig_4_11", 0, axis).iter().zip(sigma).filter(|(e, s)| e.1.abs() > s.1).count();
        // 0.3 % are expected, of correlated samples.
        assert!(outside * 50 < sigma.len(), "{axis}: {outside} outside");
    }
    assert!(mean_after(sigma, 30.0) < 0.1, "an envelope that holds nothing back");
    assert!(largest(curve("fig_4_14", 0, "out of plane")) < 0.1);
    assert!(mean_after(curve("fig_4_14", 0, "clocking"), 0.0) < 0.5);
}

#[test]
fn clocking_drifts_without_a_second_vector_and_with_the_spin() {
    let clocking = |name, plot| mean_after(curve(name, plot, "clocking"), 50.0);
    let tilt = |name, plot| largest(curve(name, plot, "out of plane"));
    let (poor, none) = (clocking("fig_4_15", 0), clocking("fig_4_15", 1));
    assert!(poor < 0.5 && none > 1.0, "{poor} {none}");
    let (slow, fast) = (clocking("fig_4_16", 0), clocking("fig_4_16", 1));
    assert!((1.5..2.5).contains(&(fast / slow)), "twice the spin, twice the drift: {slow} {fast}");
    // 0.1 % of pi rad/s over 60 s: 10.8 deg, less what the filter takes for a bias.
    assert!((3.0..10.8).contains(&slow), "{slow}");
    assert!(clocking("fig_4_17", 1) < 0.2 * slow, "large deflections show part of it");
    for (name, plot) in [("fig_4_16", 0), ("fig_4_16", 1), ("fig_4_17", 1), ("fig_4_18", 0), ("fig_4_18", 1)]
    {
        assert!(tilt(name, plot) < 0.1, "{name}: {} deg out of plane", tilt(name, plot));
    }
    // The sentence on what holds is made of the curves: changed curves change it.
    let agrees = |name: &str| item(name).sentences[0].starts_with("As printed");
    for name in ["fig_4_10", "fig_4_11", "fig_4_13", "fig_4_14", "fig_4_15", "fig_4_16", "fig_4_17"] {
        assert!(agrees(name), "{name}: {}", item(name).sentences[0]);
    }
    assert!(!agrees("fig_4_18"), "{}", item("fig_4_18").sentences[0]);
    // Printed: 90 deg for Whorl-I.
    assert!(clocking("fig_4_18", 0) < 3.0 && clocking("fig_4_18", 1) < 3.0);
    assert!(tilt("fig_4_19", 1) < 0.1 && tilt("fig_4_20", 1) < 0.1);
    let still = curve("fig_4_19", 1, "clocking");
    assert!(mean_after(still, 90.0) > 3.0 * mean_after(&still[..100], 0.0), "clocking drifts at rest");
}

#[test]
fn filters_agree_where_the_problem_is_linear() {
    let table = rows("filters");
    let bias = ["attitude_bias", "iterated", "unscented", "invariant"];
    for column in [0, 1, 3, 4] {
        let first = table["attitude_bias"][column];
        for name in bias {
            assert!((table[name][column] / first - 1.0).abs() < 0.01, "{name}, column {column}");
        }
    }
    for (spin_or_not, column) in [("spin", 1), ("manoeuvre", 4)] {
        let gain = table["attitude_bias"][column] / table["gyrostat"][column];
        assert!((2.5..4.0).contains(&gain), "{spin_or_not}: the rate is {gain} times better");
    }
    for name in ["quaternion_rate", "attitude_rate"] {
        assert!(table[name][2] > 30.0 && table[name][5] > 9.0, "{name}");
        // 0.2 deg/s of bias that it does not know.
        assert!(table[name][0] > 5.0 * table["attitude_bias"][0], "{name}");
    }
    for name in bias {
        assert!((3.0..8.0).contains(&table[name][5]) && table[name][5] > table["gyrostat"][5], "{name}");
    }
    assert!(table.values().all(|row| row[6] < 2.0), "{table:?}");
}

#[test]
fn perfect_data_give_the_parameters_but_for_the_rule_of_integration() {
    let table = rows("table_4_2");
    let worst = |column: usize| table.values().map(|row| row[column].abs()).fold(0.0, f64::max);
    let (torque, momentum, trapezoid, energy) = (worst(6), worst(8), worst(10), worst(12));
    assert!((1.0..6.0).contains(&torque) && (10.0..40.0).contains(&momentum), "{torque} {momentum}");
    assert!(trapezoid < 0.1 && energy < 0.2, "{trapezoid} {energy}");
    let [tilt, first, second, ..] = item("table_4_2").sentences.as_slice() else { panic!("no sentences") };
    assert!(tilt.contains("tilts to 7.6 deg"), "{tilt}");
    assert!(second.contains("(median 14 % against"), "{second}");
    let times: f64 =
        first.split(" times better").next().unwrap().rsplit(' ').next().unwrap().parse().unwrap();
    assert!((60.0..1000.0).contains(&times), "{first}");
}

#[test]
fn filtered_data_bias_the_regressions_and_not_the_likelihood() {
    for (name, regression) in [("table_4_3", 20.0..40.0), ("table_4_4", 35.0..60.0)] {
        let table = rows(name);
        let mut errors: Vec<f64> = table.values().map(|row| row[6].abs()).collect();
        errors.sort_by(f64::total_cmp);
        assert!(regression.contains(&errors[4]), "{name}: median error of the torque method {} %", errors[4]);
        // What the thrust about x excites.
        for parameter in ["I_xx", "I_xy", "I_yy", "mgr_x", "mgr_y", "mgr_z"] {
            let error = table[parameter][12].abs();
            assert!(error < 1.0, "{name}: {parameter} by the likelihood is {error} % off");
        }
        assert!(table["I_zz"][6].abs() > 20.0 && table["I_zz"][12].abs() < 5.0, "{name}: I_zz");
    }
    // The start, phase, noise and sensors that the text does not print are swept; the likelihood method stands each.
    for name in ["table_4_3", "table_4_4"] {
        let sentences = &item(name).sentences;
        assert!(
            sentences
                .iter()
                .any(|s| s.contains("reproduce the printed errors")
                    || s.contains("reproduces the printed errors")),
            "{sentences:?}"
        );
        let kept = sentences.iter().find(|s| s.contains("likelihood method finds")).unwrap();
        let within: f64 = kept.split("within ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
        assert!(within < 5.0, "{kept}");
    }
    assert!(rows("table_4_4")["I_zz"][6].abs() > 90.0, "I_zz is lost with the accelerometer alone");
}

#[test]
fn a_designed_manoeuvre_determines_all() {
    for (name, row) in rows("manoeuvre") {
        for (worst_percent, worst, percent) in [(row[3], row[4], 2.0), (row[7], row[8], 5.0)] {
            let product = ["I_xy", "I_xz", "I_yz"].contains(&name);
            assert!(if product { worst < 0.02 } else { worst_percent < percent }, "{name}: {row:?}");
        }
    }
}

#[test]
fn the_integrated_form_stands_more_noise() {
    let sentence = &item("fig_4_21").sentences[1];
    let times: f64 =
        sentence.split(" times more noise").next().unwrap().rsplit(' ').next().unwrap().parse().unwrap();
    assert!((8.0..30.0).contains(&times), "{sentence}");
    // At the noise of real sensors the natural form is lost, whatever the motion.
    for (name, natural) in &item("fig_4_21").plots[0].curves {
        let integrated = curve("fig_4_21", 1, name);
        for ((noise, a), (_, b)) in natural.iter().zip(integrated).filter(|((noise, _), _)| *noise <= 0.3) {
            assert!(a > b, "{name}, {noise} %: {a} {b}");
        }
    }
}

#[test]
fn joint_filters_wait_for_the_excitation() {
    for name in ["extended", "iterated", "unscented"] {
        let izz = curve("sequential", 1, name);
        let at = |t: f64| izz.iter().find(|(x, _)| *x >= t).unwrap().1;
        // Started a tenth off.
        assert!(
            (at(0.0) + 10.0).abs() < 3.0 && (at(29.5) + 10.0).abs() < 4.0,
            "{name}: {} {}",
            at(0.0),
            at(29.5)
        );
        assert!(mean_after(izz, 40.0) < 1.0, "{name}: {}", mean_after(izz, 40.0));
        for plot in 0..3 {
            let (own, first) = (curve("sequential", plot, name), curve("sequential", plot, "extended"));
            assert!((own.last().unwrap().1 - first.last().unwrap().1).abs() < 0.1, "{name}, plot {plot}");
        }
    }
    let sigma = upper_edge("sequential", 1);
    let at = |t: f64| sigma.iter().find(|(x, _)| *x >= t).unwrap().1;
    assert!(at(29.5) > 0.8 * at(0.0) && at(40.0) < 0.2 * at(0.0), "{} {} {}", at(0.0), at(29.5), at(40.0));
}

/// Numbers of a sentence, in order; units and brackets aside.
fn numbers(sentence: &str) -> Vec<f64> {
    let words = sentence.split([' ', '(', ')', ',', ':', ';']);
    words.filter_map(|word| word.trim_end_matches('.').parse().ok()).collect()
}

/// What sentences say is what tables and curves hold.
#[test]
fn sentences_are_computed() {
    // Principal moments: their sum is the trace of Table 4.1, 6.2 + 7.5 + 12.1 kg m^2.
    let found = numbers(&item("table_4_1").sentences[0]);
    assert_eq!(found[..2], [9.0, 9.0], "{found:?}");
    assert!((found[2..5].iter().sum::<f64>() - 25.8).abs() < 0.02, "{found:?}");

    let table = rows("table_4_2");
    let median = |column: usize| {
        let mut all: Vec<f64> = table.values().map(|row| row[column].abs()).collect();
        all.sort_by(f64::total_cmp);
        all[4]
    };
    let energy = &item("table_4_2").sentences[3];
    // 4.6.3 is the first number.
    let found = numbers(energy.split(": ").nth(1).unwrap());
    assert!((found[0] - median(12)).abs() < 0.01 && (found[1] - median(10)).abs() < 0.01, "{energy}");
    // Printed medians of the columns of errors, counted by hand: 0.80 and 0.97 %.
    let sentences = &item("table_4_2").sentences;
    assert!(
        sentences[1].contains("printed: 0.8 %") && sentences[2].contains("the printed 1.0 %"),
        "{sentences:?}"
    );

    let table = rows("table_4_4");
    let loss = &item("table_4_4").sentences[0];
    let (sensors, errors) = loss.split_once("begun level").unwrap();
    // A tenth of the MotionPak's 0.1 deg/s and 0.02 m/s^2.
    assert_eq!(numbers(sensors)[..3], [0.01, 0.002, 10.0], "{loss}");
    assert!((numbers(errors)[1] - table["I_zz"][6].abs()).abs() < 1.0, "{loss}");

    let asked = item("manoeuvre").sentences.last().unwrap();
    assert!(asked.ends_with(": found."), "{asked}");

    let turned = |name: &str| (curve("fig_4_8", 1, name).last().unwrap().1 / 90.0 - 1.0).abs() * 100.0;
    let found = numbers(&item("fig_4_8").sentences[1]);
    assert!((found[0] - turned("bias taken off")).abs() < 0.06, "{found:?}");
    assert!((found.last().unwrap() - turned("calibrated")).abs() < 0.006, "{found:?}");

    for (k, name) in ["extended", "iterated", "unscented"].into_iter().enumerate() {
        let sentence = &item("sequential").sentences[k + 1];
        let izz = curve("sequential", 1, name);
        let before = izz.iter().rfind(|(t, _)| *t < 30.0).unwrap().1;
        assert!(
            sentence.starts_with(name) && sentence.contains(&format!("{before:+.1} % off")),
            "{sentence}"
        );
    }
}

/// Both verdicts on the Earth's torque, by numbers on either side.
#[test]
fn a_torque_that_sensors_see_is_said_to_be_seen() {
    let said = |there, told| perturbations::slow_sentence(0.2, there, told);
    assert!(said(1e-5, 1e-2).contains("do not see it") && said(1e-2, 1e-5).contains("would see"));
    assert!(perturbations::slow_sentence(f64::NAN, 0.0, 1.0).contains("is not reached"));
}
