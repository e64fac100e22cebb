//! Files whose right answers are known from how they are made.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::{UnitQuaternion, Vector3};
use whorl_recording::read_model;

use super::lines::{Origin, number};
use super::questions::{Ask, Nobody};
use super::{NewRig, new_rig};
use crate::runs::RunSources;

/// Noise of standard deviation one, nearly normal.
pub(super) struct Noise(pub u64);

impl Noise {
    pub fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }

    fn vector(&mut self, stddev: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| stddev * self.next())
    }
}

/// How a file of a sensor that rests for ten seconds and then turns about all axes is written.
pub(super) struct Written<'a> {
    pub header: &'a str,
    pub separator: &'a str,
    pub decimal: char,
    pub time: fn(f64) -> String,
    pub gyro_per_rad_s: f64,
    pub force_per_m_s2: f64,
    /// Signs of the magnetometer's columns.
    pub field: Vector3<f64>,
}

const RATE_HZ: f64 = 50.0;
const GYRO_RAD_S: f64 = 0.003;
const FORCE_M_S2: f64 = 0.03;

pub(super) fn table(of: &Written<'_>) -> String {
    let mut noise = Noise(3);
    let mut attitude = UnitQuaternion::identity();
    let world = Vector3::new(0.0, 20.0, -40.0);
    let mut text = format!("{}\n", of.header);
    for k in 0..2000 {
        let t = f64::from(k) / RATE_HZ;
        let on = if t < 10.0 { 0.0 } else { 1.0 };
        let rate = on * Vector3::new(0.5 * (1.3 * t).sin(), 0.4 * (1.7 * t).cos(), 0.8);
        attitude *= UnitQuaternion::from_scaled_axis(rate / RATE_HZ);
        let gyro = (rate + noise.vector(GYRO_RAD_S)) * of.gyro_per_rad_s;
        let force = (attitude.inverse() * Vector3::new(0.0, 0.0, 9.806_65) + noise.vector(FORCE_M_S2))
            * of.force_per_m_s2;
        let field = (attitude.inverse() * world + noise.vector(0.2)).component_mul(&of.field);
        let numbers = gyro.iter().chain(force.iter()).chain(field.iter()).map(|x| format!("{x:.6}"));
        let cells: Vec<String> = std::iter::once((of.time)(t)).chain(numbers).collect();
        let line = cells.join(of.separator);
        let _ = writeln!(text, "{}", if of.decimal == ',' { line.replace('.', ",") } else { line });
    }
    text
}

pub(super) fn of_text(text: &str, ask: &mut dyn Ask) -> (NewRig, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("hand.csv");
    std::fs::write(&file, text).unwrap();
    let made = new_rig(&file, folder.path(), None, ask).unwrap();
    (made, folder)
}

/// The commands read both files as they are.
pub(super) fn is_taken(made: &NewRig, file: &Path) -> whorl_recording::Recording {
    let sources = RunSources {
        runs: vec![file.to_owned()],
        model: Some(made.rig.clone()),
        channels: Some(made.map.clone()),
        ..RunSources::default()
    };
    sources.read().unwrap().training.remove(0)
}

pub(super) fn line<'a>(made: &'a NewRig, begins: &str) -> (&'a str, Origin) {
    let found = made.lines.iter().find(|line| line.text.starts_with(begins));
    let found = found.unwrap_or_else(|| panic!("{begins}: {:#?}", made.lines));
    (&found.text, found.source.as_ref().unwrap().0)
}

pub(super) const PLAIN: Written<'_> = Written {
    header: "t,gx,gy,gz,ax,ay,az,mx,my,mz",
    separator: ",",
    decimal: '.',
    time: |t| format!("{t:.4}"),
    gyro_per_rad_s: 1.0,
    force_per_m_s2: 1.0,
    field: Vector3::new(1.0, 1.0, 1.0),
};

#[test]
fn units_times_and_noise_are_measured_however_a_file_is_written() {
    let degrees = 1f64.to_degrees();
    for (written, gyro, force, time) in [
        (PLAIN, "rad/s", "m/s^2", "unit: s}"),
        (
            Written { gyro_per_rad_s: degrees, force_per_m_s2: 1.0 / 9.806_65, ..PLAIN },
            "deg/s",
            "g",
            "unit: s}",
        ),
        (
            Written {
                header: "Zeit;gyr_x;gyr_y;gyr_z;acc_x;acc_y;acc_z;mag_x;mag_y;mag_z",
                separator: ";",
                decimal: ',',
                time: |t| format!("{}", (1e3 * t).round()),
                force_per_m_s2: 1e3 / 9.806_65,
                ..PLAIN
            },
            "rad/s",
            "mg",
            "unit: ms}",
        ),
        (
            Written {
                header: "stamp,angular_velocity.x,angular_velocity.y,angular_velocity.z,linear_acceleration.x,\
                         linear_acceleration.y,linear_acceleration.z,magnetic_field.x,magnetic_field.y,magnetic_field.z",
                time: |t| format!("{}", 1_700_000_000_000_000_000_i64 + (1e9 * t).round() as i64),
                gyro_per_rad_s: 1e3 * degrees,
                ..PLAIN
            },
            "mdeg/s",
            "m/s^2",
            "unit: ns}",
        ),
    ] {
        let (made, folder) = of_text(&table(&written), &mut Nobody);
        assert!(made.refused.is_empty(), "{:?}", made.refused);
        let (text, origin) = line(&made, "gyro: {");
        assert!(
            text.ends_with(&format!("unit: {gyro}}}")) && origin == Origin::Measured,
            "{text} {origin:?}"
        );
        let (text, origin) = line(&made, "accelerometer: {");
        assert!(
            text.ends_with(&format!("unit: {force}}}")) && origin == Origin::Measured,
            "{text} {origin:?}"
        );
        assert!(line(&made, "time: {").0.ends_with(time));
        assert_eq!(line(&made, "rate_hz: 50.0").1, Origin::Measured);
        let known = read_model(&made.rig, None).unwrap();
        let sensors = &known.model.sensors;
        for axis in 0..3 {
            assert!((sensors.gyro.errors.noise_stddev[axis] / GYRO_RAD_S - 1.0).abs() < 0.1);
            assert!((sensors.accelerometer.errors.noise_stddev[axis] / FORCE_M_S2 - 1.0).abs() < 0.1);
        }
        let vector = sensors.vector.as_ref().unwrap();
        // The field is 63.4 deg below the horizon: asin(40 / hypot(20, 40)).
        assert!((vector.reference_direction_world.z + 40.0 / 2000f64.sqrt()).abs() < 0.005);
        let recording = is_taken(&made, &folder.path().join("hand.csv"));
        assert!((recording.specific_force_b_m_s2.value[0].norm() - 9.81).abs() < 0.2);
    }
}

#[test]
fn a_sensor_that_turns_against_the_gyro_is_reversed_and_said() {
    for (axis, name) in [(0, "-mx"), (1, "-my"), (2, "-mz")] {
        let mut field = Vector3::repeat(1.0);
        field[axis] = -1.0;
        let (made, _folder) = of_text(&table(&Written { field, ..PLAIN }), &mut Nobody);
        let (text, origin) = line(&made, "vector: {");
        assert!(text.contains(name) && text.matches('-').count() == 1, "{text}");
        assert_eq!(origin, Origin::Measured);
    }
    let (made, _folder) = of_text(&table(&PLAIN), &mut Nobody);
    assert!(!line(&made, "vector: {").0.contains('-'));
}

/// Gives answers in their order.
pub(super) struct Answers(pub Vec<&'static str>, pub usize);

impl Ask for Answers {
    fn ask(&mut self, _question: &str, _suggested: &str) -> Option<String> {
        (!self.0.is_empty()).then(|| self.0.remove(0).to_owned())
    }

    fn object(&mut self, _why: &str) {
        self.1 += 1;
    }
}

#[test]
fn answers_are_taken_and_what_cannot_be_used_is_asked_again() {
    let mut answers =
        Answers(vec!["bench", "hovering", "on_bearing", "0", "12,5", "0.2 0.3 5", "0,2 0.3 0.4"], 0);
    let (made, _folder) = of_text(&table(&PLAIN), &mut answers);
    assert_eq!((answers.0.len(), answers.1, made.platform.as_str()), (0, 3, "bench"));
    assert_eq!(line(&made, "mass_kg: 12.5").1, Origin::Answered);
    assert_eq!(
        line(&made, "inertia_kg_m2: {xx: 0.2, xy: 0.0, xz: 0.0, yy: 0.3, yz: 0.0, zz: 0.4}").1,
        Origin::Answered
    );
    let text = std::fs::read_to_string(&made.rig).unwrap();
    assert!(text.contains("# as you said") && text.starts_with("# Rig of hand.csv"), "{text}");
}

/// A pendulum of 1.25 Hz about z, which hangs along -x of the body, in a file with the names that its logger gives.
#[test]
fn a_pendulum_hangs_where_it_rests_and_its_weight_follows_from_its_swing() {
    let mut noise = Noise(5);
    let mut text = "time,rate_z,acc_x,acc_y,acc_z\n".to_owned();
    let omega = std::f64::consts::TAU * 1.25;
    for k in 0..2000 {
        let t = f64::from(k) / 100.0;
        let angle = 0.1 * (omega * t).cos();
        let rate = -0.1 * omega * (omega * t).sin();
        let force = [9.81 * angle.cos(), -9.81 * angle.sin(), 0.0];
        let [x, y, z] = force.map(|f| f + 0.02 * noise.next());
        let _ = writeln!(text, "{t:.2},{:.5},{x:.4},{y:.4},{z:.4}", rate + 0.01 * noise.next());
    }
    let (made, folder) = of_text(&text, &mut Nobody);
    assert!(line(&made, "freedom: {kind: hinge, axis: [0.0, 0.0, 1.0]}").0.len() > 10);
    let known = read_model(&made.rig, None).unwrap();
    let mass = &known.model.mass_properties;
    let offset = mass.gravity_offset_b_n_m();
    // m g r = J (2 pi f)^2, below the hinge.
    let expected = mass.inertia_b_kg_m2()[(2, 2)] * omega.powi(2);
    assert!((offset.x / -expected - 1.0).abs() < 0.03 && offset.y.abs() < 0.05 * expected, "{offset}");
    is_taken(&made, &folder.path().join("hand.csv"));
}

/// A wheel of 4.2e-4 kg m^2 whose torque steps up and down, in rpm and mN m.
#[test]
fn a_wheels_inertia_is_torque_over_acceleration() {
    let mut noise = Noise(9);
    let mut text = "t,rpm,torque_mNm\n".to_owned();
    let mut speed = 0.0;
    for k in 0..4000 {
        let t = f64::from(k) / 100.0;
        let torque = 0.01 * (0.7 * t).sin();
        let _ = writeln!(
            text,
            "{t:.2},{:.3},{:.4}",
            (speed + 0.05 * noise.next()) * 30.0 / std::f64::consts::PI,
            1e3 * torque
        );
        speed += torque / 4.2e-4 / 100.0;
    }
    let (made, folder) = of_text(&text, &mut Nobody);
    let (text, origin) = line(&made, "spin_inertia_kg_m2: ");
    let found: f64 = text.split_once(": ").unwrap().1.parse().unwrap();
    assert!((found / 4.2e-4 - 1.0).abs() < 0.05 && origin == Origin::Measured, "{text}");
    assert!(line(&made, "freedom: {kind: clamped}").0.len() > 3);
    is_taken(&made, &folder.path().join("hand.csv"));
}

/// Three wheels of 0.02 kg m^2, columns as `whorl export csv` names them: a body that turns against them is heavier.
#[test]
fn wheels_of_a_platform_are_no_heavier_than_its_body() {
    let mut noise = Noise(11);
    let mut text = "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,wheel_x_rad_s,wheel_y_rad_s,wheel_z_rad_s,\
                    wheel_x_n_m,wheel_y_n_m,wheel_z_n_m\n"
        .to_owned();
    let mut speed = Vector3::zeros();
    for k in 0..4000 {
        let t = f64::from(k) / 100.0;
        let torque = Vector3::new(0.02, 0.03, 0.025).map(|size| size * (15.0 * size * t).sin());
        let rate = -0.004 * speed + noise.vector(1e-3);
        let read = speed + noise.vector(0.05);
        let numbers = rate.iter().chain(&read).chain(&torque).map(|x| format!("{x:.5}"));
        let _ = writeln!(text, "{t:.2},{}", numbers.collect::<Vec<_>>().join(","));
        speed += torque / 0.02 / 100.0;
    }
    let (made, folder) = of_text(&text, &mut Nobody);
    let (map, _) = line(&made, "wheel_torque_command: {");
    assert!(map.contains("columns: [wheel_x_n_m, wheel_y_n_m, wheel_z_n_m], unit: N m"), "{map}");
    let (spin, origin) = line(&made, "spin_inertia_kg_m2: ");
    let found: f64 = spin.split_once(": ").unwrap().1.parse().unwrap();
    assert!((found / 0.02 - 1.0).abs() < 0.05 && origin == Origin::Measured, "{spin}");
    let recording = is_taken(&made, &folder.path().join("hand.csv"));
    assert_eq!(recording.wheel_speed_rad_s.value[0].len(), 3);
}

/// A hinge with an encoder of 4096 counts and nothing else.
#[test]
fn an_encoder_alone_is_a_hinge() {
    let mut text = "t,encoder\n".to_owned();
    for k in 0..3000 {
        let t = f64::from(k) / 100.0;
        let turns = 0.4 * t + 0.2 * (0.8 * t).sin();
        let _ = writeln!(text, "{t:.2},{}", (turns * 4096.0).floor().rem_euclid(4096.0));
    }
    let (made, folder) = of_text(&text, &mut Nobody);
    let (text, origin) = line(&made, "hinge_angle: {");
    assert_eq!(text, "hinge_angle: {column: encoder, unit: counts, counts_per_turn: 4096.0}");
    assert_eq!(origin, Origin::Assumed);
    // A rate from one angle to the next is the mean over 0.01 s, stamped at its end.
    assert_eq!(line(&made, "averaging_window_s: 0.01").1, Origin::Measured);
    assert_eq!(line(&made, "latency_s: 0.005").1, Origin::Measured);
    assert!(!std::fs::read_to_string(&made.rig).unwrap().contains("time_constant_s"));
    let recording = is_taken(&made, &folder.path().join("hand.csv"));
    let mean =
        recording.gyro_b_rad_s.value.iter().map(|v| v.z).sum::<f64>() / recording.gyro_b_rad_s.len() as f64;
    // 0.4 turns a second, and what the sine adds from 0 to 30 s.
    let expected = std::f64::consts::TAU * (0.4 + 0.2 * (0.8 * 29.99_f64).sin() / 29.99);
    assert!((mean - expected).abs() < 1e-3, "{mean} {expected}");
}

#[test]
fn what_cannot_be_a_rig_is_refused_and_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    for (text, said) in [
        ("0.1,2.0,3.0\n0.2,3.0,4.0\n", "numbers where names of columns should be"),
        ("t,price\n0.1,2.0\n0.2,3.0\n", "no column is known"),
        ("", "no measurements"),
    ] {
        let file = folder.path().join("prices.csv");
        std::fs::write(&file, text).unwrap();
        let error = format!("{:#}", new_rig(&file, folder.path(), None, &mut Nobody).unwrap_err());
        assert!(error.contains(said) && error.contains("prices.csv"), "{error}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "{said}");
    }
    assert!(new_rig(Path::new("/no/such.csv"), folder.path(), None, &mut Nobody).is_err());
    // What is there already is somebody's.
    let (made, of_made) = of_text(&table(&PLAIN), &mut Nobody);
    let again = new_rig(&of_made.path().join("hand.csv"), of_made.path(), None, &mut Nobody).unwrap_err();
    assert!(format!("{again:#}").contains("is there already") && made.rig.exists());
}

#[test]
fn numbers_are_floating_point_numbers_of_yaml() {
    for (x, text) in [
        (0.0, "0.0"),
        (-0.0, "0.0"),
        (100.0, "100.0"),
        (1.0 / 3.0, "0.333"),
        (1e-6, "1.0e-6"),
        (-2.5e9, "-2.5e9"),
    ] {
        assert_eq!(number(x), text);
    }
}

/// A pendulum about z whose accelerometer has only the axes of a header: taken by `compare`, what is missing is absent.
#[test]
fn an_accelerometer_of_one_or_two_axes_keeps_those_that_it_has() {
    let omega = std::f64::consts::TAU * 1.25;
    for (axes, per_m_s2, unit) in
        [("xy", 1.0, "m/s^2"), ("xz", 1.0 / 9.806_65, "g"), ("y", 1.0, "m/s^2"), ("x", 1e3 / 9.806_65, "mg")]
    {
        let mut noise = Noise(8);
        let names: Vec<String> = axes.chars().map(|axis| format!("acc_{axis}")).collect();
        let mut text = format!("time,rate_z,{}\n", names.join(","));
        for k in 0..2000 {
            let t = f64::from(k) / 100.0;
            let angle = 0.1 * (omega * t).cos();
            let rate = -0.1 * omega * (omega * t).sin() + 0.01 * noise.next();
            let force = [9.81 * angle.cos(), -9.81 * angle.sin(), 0.0].map(|f| f + 0.02 * noise.next());
            let _ = write!(text, "{t:.2},{rate:.5}");
            for axis in axes.chars() {
                let _ = write!(text, ",{:.5}", per_m_s2 * force["xyz".find(axis).unwrap()]);
            }
            text.push('\n');
        }
        let (made, folder) = of_text(&text, &mut Nobody);
        let there = ["x", "y", "z"].map(|axis| axes.contains(axis));
        let named: Vec<String> = axes.chars().map(String::from).collect();
        let known = read_model(&made.rig, None).unwrap();
        assert_eq!(known.model.sensors.accelerometer.axes, there, "{axes}");
        assert_eq!(line(&made, &format!("axes: [{}]", named.join(", "))).1, Origin::Stated);
        assert!(line(&made, "accelerometer: {").0.ends_with(&format!("unit: {unit}}}")), "{axes}");
        let recording = is_taken(&made, &folder.path().join("hand.csv"));
        assert_eq!(recording.force_axes(), there, "{axes}");
        assert_eq!(recording.specific_force_b_m_s2.len(), 2000);
        // Only where all of gravity is seen does it show where the pendulum hangs.
        let offset = known.model.mass_properties.gravity_offset_b_n_m();
        assert_eq!(offset.x < 0.0, axes.contains('x'), "{axes}: {offset}");
        assert!(made.notes.iter().all(|note| !note.contains("mean length")), "{:?}", made.notes);
    }
}
