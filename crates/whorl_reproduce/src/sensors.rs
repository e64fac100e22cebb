//! Figures 4.7-4.9.

use nalgebra::Vector3;
use whorl_calibration::{CalibrationSettings, calibrate_imu};
use whorl_dynamics::PlatformModel;
use whorl_dynamics::platform::SensorSuite;
use whorl_math::GRAVITY_M_S2;
use whorl_math::statistics::{chi_squared_probability, chi_squared_quantile, normal_probability};
use whorl_recording::Recording;
use whorl_report::{ReproducedPlot, Reproduction};

use crate::data::Noise;
use crate::gaussianity::{Bin, chi_squared_test};

/// Length of a position \[s\] and samples a second.
const POSITION_S: f64 = 10.0;
const RATE_HZ: f64 = 100.0;
/// A bubble level: half a degree.
const LEVEL_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;

/// A unit with errors of the size that section 4.4 reports: 2 % accelerometer scale, 5 % gyro scale.
fn unit() -> SensorSuite {
    let mut sensors = PlatformModel::whorl_1_reference().sensors;
    let force = &mut sensors.accelerometer.errors;
    force.scale = Vector3::new(0.018, -0.012, 0.009);
    force.bias = Vector3::new(0.12, -0.07, 0.2);
    let gyro = &mut sensors.gyro.errors;
    gyro.scale = Vector3::new(0.03, -0.02, 0.045);
    gyro.bias = Vector3::new(0.01, -0.006, 0.004);
    sensors
}

/// Six positions one after the other.
fn positions(sensors: &SensorSuite) -> Recording {
    let mut noise = Noise::new(21);
    let mut run = Recording { name: "six positions".into(), ..Recording::default() };
    let (gyro, force) = (&sensors.gyro.errors, &sensors.accelerometer.errors);
    let faces = [Vector3::z(), Vector3::y(), Vector3::x(), -Vector3::z(), -Vector3::y(), -Vector3::x()];
    for (n, up) in faces.into_iter().enumerate() {
        let tilt = noise.vector() * LEVEL_RAD;
        let up = whorl_math::unit_or(up + tilt.cross(&up), Vector3::z_axis()).into_inner();
        for k in 0..(POSITION_S * RATE_HZ) as usize {
            let time_s = n as f64 * POSITION_S + k as f64 / RATE_HZ;
            run.gyro_b_rad_s.time_s.push(time_s);
            run.gyro_b_rad_s.value.push(gyro.reading(&Vector3::zeros(), &gyro.bias, &noise.vector()));
            run.specific_force_b_m_s2.time_s.push(time_s);
            let truth = up * GRAVITY_M_S2;
            run.specific_force_b_m_s2.value.push(force.reading(&truth, &force.bias, &noise.vector()));
        }
    }
    run
}

/// Figure 4.7.
pub fn accelerometer() -> Reproduction {
    let sensors = unit();
    let run = positions(&sensors);
    let settings = CalibrationSettings { gravity_m_s2: Some(GRAVITY_M_S2), ..CalibrationSettings::default() };
    let found = calibrate_imu(&[&run], &sensors, &settings).accelerometer;
    let axis = |n: usize| {
        let series = &run.specific_force_b_m_s2;
        let points = series.time_s.iter().zip(&series.value).step_by(10).map(|(t, v)| (*t, v[n]));
        points.collect::<Vec<_>>()
    };
    let truth = sensors.accelerometer.errors;
    let row = |n: usize| {
        format!(
            "Accelerometer {}: bias {:.4} +- {:.4} m/s^2 (truth {:.4}), scale error {:.3} +- {:.3} % (truth {:.3}).",
            ["x", "y", "z"][n],
            found.bias.value[n],
            found.bias.stddev[n],
            truth.bias[n],
            100.0 * found.scale.value[n],
            100.0 * found.scale.stddev[n],
            100.0 * truth.scale[n]
        )
    };
    let mut sentences: Vec<String> = (0..3).map(row).collect();
    let worst_m_s2 = (found.bias.value - truth.bias).amax();
    let across_m_s2 = GRAVITY_M_S2 * LEVEL_RAD.sin();
    sentences.push(format!(
        "The dissertation's data are not published; these are simulated, with scale errors of up to {:.1} % (it reports 2 %). It takes the slope from readings in which a level error of {:.1} deg costs {:.3} %, but bias from readings across gravity, where it costs {across_m_s2:.2} m/s^2. Ours uses the length of gravity, in which a level error does not count: its biases are within {worst_m_s2:.4} m/s^2, {:.0} times nearer.",
        100.0 * truth.scale.amax(),
        LEVEL_RAD.to_degrees(),
        100.0 * (1.0 - LEVEL_RAD.cos()),
        across_m_s2 / worst_m_s2
    ));
    Reproduction {
        plots: vec![ReproducedPlot {
            title: "six positions of 10 s".to_owned(),
            caption: "Readings with each axis up and down once.".to_owned(),
            labels: ["time [s]".to_owned(), "specific force [m/s^2]".to_owned()],
            curves: ["x", "y", "z"].iter().enumerate().map(|(n, a)| ((*a).to_owned(), axis(n))).collect(),
            ..ReproducedPlot::default()
        }],
        sentences,
        ..Reproduction::default()
    }
}

/// Figure 4.8: turned by 90 deg about z, with rests.
pub fn gyro() -> Reproduction {
    let sensors = unit();
    let (gyro, force) = (&sensors.gyro.errors, &sensors.accelerometer.errors);
    let mut noise = Noise::new(22);
    let mut run = Recording { name: "known turn".into(), ..Recording::default() };
    let mut rate = Vec::new();
    let angle = std::f64::consts::FRAC_PI_2;
    for k in 0..(14.0 * RATE_HZ) as usize {
        let time_s = k as f64 / RATE_HZ;
        let phase = ((time_s - 5.0) / 4.0).clamp(0.0, 1.0);
        let omega = Vector3::new(0.0, 0.0, angle / 4.0 * (1.0 - (std::f64::consts::TAU * phase).cos()));
        let y = gyro.reading(&omega, &gyro.bias, &noise.vector());
        run.gyro_b_rad_s.time_s.push(time_s);
        run.gyro_b_rad_s.value.push(y);
        rate.push((time_s, y.z.to_degrees()));
        let up = Vector3::z() * GRAVITY_M_S2;
        run.specific_force_b_m_s2.time_s.push(time_s);
        run.specific_force_b_m_s2.value.push(force.reading(&up, &force.bias, &noise.vector()));
    }
    let settings = CalibrationSettings {
        known_turn_rad: Some(angle),
        turn_stddev_rad: 0.3_f64.to_radians(),
        ..CalibrationSettings::default()
    };
    let calibration = calibrate_imu(&[&run], &sensors, &settings);
    let found = &calibration.gyro;
    let integrated = |bias: f64, scale: f64| {
        let mut sum = 0.0;
        rate.iter()
            .map(|(t, y)| {
                sum += (y - bias.to_degrees()) / (1.0 + scale) / RATE_HZ;
                (*t, sum)
            })
            .collect::<Vec<_>>()
    };
    let (bias, scale) = (found.bias.value.z, found.scale.value.z);
    let off_percent = |bias: f64, scale: f64| {
        let turned_deg = integrated(bias, scale).last().map_or(f64::NAN, |(_, angle)| *angle);
        100.0 * (turned_deg / angle.to_degrees() - 1.0).abs()
    };
    let (uncalibrated, calibrated) = (off_percent(bias, 0.0), off_percent(bias, scale));
    let verdict = if uncalibrated <= 5.0 { "as printed" } else { "unlike what is printed" };
    let sentences = vec![
        format!(
            "Scale error about z {:.2} +- {:.2} % (truth {:.2}). Simulated: the dissertation's data are not published.",
            100.0 * scale,
            100.0 * found.scale.stddev.z,
            100.0 * gyro.scale.z
        ),
        format!(
            "With the bias taken off alone the turn is {uncalibrated:.1} % off, {verdict} (agreement within 5 %); calibrated it is {calibrated:.2} % off."
        ),
        "A turn about the vertical says nothing of the other two gyros; `whorl calibrate` says so."
            .to_owned(),
    ];
    Reproduction {
        plots: vec![
            ReproducedPlot {
                title: "rate about z".to_owned(),
                labels: ["time [s]".to_owned(), "rate [deg/s]".to_owned()],
                curves: vec![("reading".to_owned(), rate.clone())],
                ..ReproducedPlot::default()
            },
            ReproducedPlot {
                title: "integrated".to_owned(),
                caption: "As read, with the bias taken off, and calibrated: the turn was by 90 deg."
                    .to_owned(),
                labels: ["time [s]".to_owned(), "angle [deg]".to_owned()],
                curves: vec![
                    ("as read".to_owned(), integrated(0.0, 0.0)),
                    ("bias taken off".to_owned(), integrated(bias, 0.0)),
                    ("calibrated".to_owned(), integrated(bias, scale)),
                ],
                ..ReproducedPlot::default()
            },
        ],
        sentences,
        ..Reproduction::default()
    }
}

/// The dissertation's test of its own histogram: 31.0 against 32.0 with 16 degrees of freedom, at 1 %.
fn printed_test_sentence() -> String {
    let (found, limit, dof) = (31.0, 32.0, 16);
    let step = 1e-3;
    let density = (chi_squared_probability(limit + step, dof) - chi_squared_probability(limit - step, dof))
        / (2.0 * step);
    let quantile = chi_squared_quantile(0.99, dof);
    let right =
        if (quantile - limit).abs() < 0.05 { "is the right quantile, from a table" } else { "is not" };
    let beyond = 1.0 - chi_squared_probability(found, dof);
    let verdict = if beyond < 0.01 {
        "the printed data do not pass"
    } else if beyond < 0.05 {
        "the printed data pass, but barely"
    } else {
        "the printed data pass"
    };
    format!(
        "Eq. 4.42 is printed as the quantile; it is the density of the chi-squared distribution (at x = {limit:.1} with {dof} degrees of freedom it is {density:.3}). The quantile is {quantile:.1}: the printed limit of {limit:.1} {right}. {found:.1} means that normal data would look worse once in {:.0} times: {verdict}.",
        1.0 / beyond
    )
}

/// What the density at the middle of a bin overstates in the middle of the histogram, bins 0.4 standard deviations wide.
fn expected_counts_sentence() -> String {
    let width = 0.4;
    let overstated_percent = (-2..=2)
        .map(|k| {
            let middle = f64::from(k) * 0.5 * width;
            let from = middle - 0.5 * width;
            let density = (-0.5 * middle * middle).exp() / std::f64::consts::TAU.sqrt();
            let exact = normal_probability(from + width) - normal_probability(from);
            100.0 * (density * width / exact - 1.0)
        })
        .fold(0.0, f64::max);
    format!(
        "Expected counts here are differences of the distribution function; the dissertation takes the density at the middle of a bin, which overstates the middle bins by up to {overstated_percent:.1} %, and merges by observed counts, which makes the test depend on the data."
    )
}

/// Figure 4.9.
pub fn histogram() -> Reproduction {
    let sensors = unit();
    let gyro = &sensors.gyro.errors;
    let mut noise = Noise::new(23);
    let samples: Vec<f64> = (0..4000)
        .map(|_| gyro.reading(&Vector3::zeros(), &gyro.bias, &noise.vector()).x.to_degrees())
        .collect();
    let Some(test) = chi_squared_test(&samples, 0.01) else { return Reproduction::default() };
    let bars = |of: &dyn Fn(&Bin) -> f64| {
        let inner = test.bins.iter().filter(|b| b.from.is_finite() && b.to.is_finite());
        inner.flat_map(|b| [(b.from, of(b)), (b.to, of(b))]).collect::<Vec<_>>()
    };
    Reproduction {
        plots: vec![ReproducedPlot {
            title: "histogram of the still x gyro".to_owned(),
            caption: "Bins 0.4 standard deviations wide; the tails, merged until five samples are expected, are not drawn.".to_owned(),
            labels: ["rate [deg/s]".to_owned(), "samples in the bin".to_owned()],
            curves: vec![
                ("observed".to_owned(), bars(&|b| b.observed)),
                ("expected".to_owned(), bars(&|b| b.expected)),
            ],
            ..ReproducedPlot::default()
        }],
        sentences: vec![
            format!("Chi-squared {:.1} with {} degrees of freedom against a limit of {:.1} at 1 %: {}. Printed: 31.0 against 32.0 with 16.", test.chi_squared, test.dof, test.limit, if test.passes() { "normal" } else { "not normal" }),
            printed_test_sentence(),
            expected_counts_sentence(),
        ],
        ..Reproduction::default()
    }
}
