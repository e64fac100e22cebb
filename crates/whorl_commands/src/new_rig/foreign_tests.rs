//! Files with names and parts as other people have them.

use std::fmt::Write as _;

use super::lines::Origin;
use super::questions::Nobody;
use super::tests::{Answers, Noise, PLAIN, is_taken, line, of_text, table};
use super::{Preset, new_rig};

/// A wheel of 4.2e-4 kg m^2 whose torque steps up and down: a line is `t, speed [rad/s], torque [N m]`, as `write` writes it.
pub(super) fn wheel(header: &str, write: impl Fn(f64, f64, f64) -> String) -> String {
    let (mut noise, mut speed, mut text) = (Noise(9), 0.0, format!("{header}\n"));
    for k in 0..3000 {
        let t = f64::from(k) / 100.0;
        let torque = 0.01 * (0.7 * t).sin();
        let _ = writeln!(text, "{}", write(t, speed + 0.05 * noise.next(), torque));
        speed += torque / 4.2e-4 / 100.0;
    }
    text
}

#[test]
fn the_torque_that_was_commanded_is_taken_and_not_that_which_was_measured() {
    let text = wheel("t_s,torque_n_m,torque_command_n_m,wheel_rad_s", |t, speed, torque| {
        format!("{t:.2},{:.5},{torque:.5},{speed:.3}", torque - 1e-3)
    });
    let (made, folder) = of_text(&text, &mut Nobody);
    let (map, origin) = line(&made, "wheel_torque_command: {");
    assert_eq!(
        (map, origin),
        ("wheel_torque_command: {columns: [torque_command_n_m], unit: N m}", Origin::Stated)
    );
    assert!(made.notes.iter().any(|note| note.contains("torque_n_m are not in the map")), "{:?}", made.notes);
    assert_eq!(made.ignored, ["torque_n_m"]);
    is_taken(&made, &folder.path().join("hand.csv"));
}

#[test]
fn names_of_a_laboratory_are_read_and_a_reversed_torque_is_found() {
    for sign in [1.0, -1.0] {
        let text = wheel("t [s],RW1 n (1/min),RW1 cmd (mNm)", |t, speed, torque| {
            format!("{t:.2},{:.2},{:.4}", speed * 30.0 / std::f64::consts::PI, sign * 1e3 * torque)
        });
        let (made, folder) = of_text(&text, &mut Nobody);
        assert!(line(&made, "wheel_speed: {").0.ends_with("[\"RW1 n (1/min)\"], unit: rpm}"));
        let (map, _) = line(&made, "wheel_torque_command: {");
        let reversed = if sign < 0.0 { "-" } else { "" };
        assert!(map.ends_with(&format!("[\"{reversed}RW1 cmd (mNm)\"], unit: mN m}}")), "{map}");
        let (spin, _) = line(&made, "spin_inertia_kg_m2: ");
        let found: f64 = spin.split_once(": ").unwrap().1.parse().unwrap();
        assert!((found / 4.2e-4 - 1.0).abs() < 0.05, "{spin}");
        is_taken(&made, &folder.path().join("hand.csv"));
    }
}

#[test]
fn a_pendulums_torque_acts_on_its_body_and_its_velocity_is_that_of_the_hinge() {
    let text =
        wheel("t,torque,velocity", |t, speed, torque| format!("{t:.2},{torque:.5},{:.4}", 0.1 * speed));
    let (made, folder) = of_text(&text, &mut Nobody);
    assert!(line(&made, "gyro: {").0.starts_with("gyro: {columns: [~, ~, velocity], unit: "));
    assert!(line(&made, "body_torque: {").0.starts_with("body_torque: {columns: [~, ~, torque], unit: "));
    assert!(line(&made, "freedom: {").0.contains("kind: hinge"));
    let recording = is_taken(&made, &folder.path().join("hand.csv"));
    assert!(recording.wheel_speed_rad_s.is_empty() && !recording.body_torque_b_n_m.is_empty());
    assert!(recording.body_torque_b_n_m.value.iter().all(|torque| torque.x == 0.0 && torque.y == 0.0));
}

#[test]
fn an_accelerometer_alone_has_a_rig() {
    let mut noise = Noise(2);
    let mut text = "t_s,ax,ay,az\n".to_owned();
    for k in 0..2000 {
        let [x, y, z] = [0.0, 0.0, -9.81].map(|f| f + 0.02 * noise.next());
        let _ = writeln!(text, "{:.2},{x:.4},{y:.4},{z:.4}", f64::from(k) / 100.0);
    }
    let (made, folder) = of_text(&text, &mut Nobody);
    assert_eq!(line(&made, "noise_stddev_rad_s: 0.002").1, Origin::Assumed);
    assert!(made.notes.iter().any(|note| note.contains("reads -1 g on z at rest")), "{:?}", made.notes);
    let recording = is_taken(&made, &folder.path().join("hand.csv"));
    assert!(recording.gyro_b_rad_s.is_empty() && recording.specific_force_b_m_s2.len() == 2000);
}

#[test]
fn columns_that_nobody_knows_are_asked_about() {
    let text = table(&super::tests::Written { header: "t,p,q1,r,ax,ay,az,hx,hy,hz", ..PLAIN });
    let (made, _folder) = of_text(&text, &mut Nobody);
    assert_eq!(made.ignored, ["p", "q1", "r"]);
    let mut answers = Answers(vec!["roll", "gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s", "bench"], 0);
    let (made, _folder) = of_text(&text, &mut answers);
    assert_eq!((answers.0.len(), answers.1, made.ignored.len()), (0, 1, 0), "{:?}", made.ignored);
    assert!(line(&made, "gyro: {").0.starts_with("gyro: {columns: [p, q1, r], unit: rad/s}"));
}

#[test]
fn somebody_who_says_which_kind_of_rig_it_is_is_believed() {
    for (word, preset) in Preset::ALL {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("hand.csv");
        std::fs::write(&file, table(&PLAIN)).unwrap();
        let made = new_rig(&file, folder.path(), Some(preset), &mut Nobody).unwrap();
        let (text, origin) = line(&made, "freedom: {");
        let kind = match word {
            "table" => "on_bearing",
            "wheel_bench" => "clamped",
            other => other,
        };
        assert!(text.contains(&format!("kind: {kind}")) && origin == Origin::Answered, "{text}");
        assert!(whorl_recording::read_model(&made.rig, None).is_ok(), "{word}");
    }
}

/// A gyro and an accelerometer with a buffer of `of` samples, read 25 times a second: all of them have the time of reading.
fn buffered(of: usize, value: impl Fn(f64, usize) -> String) -> String {
    let mut text = "t_s,gx,gy,gz,ax,ay,az\n".to_owned();
    for k in 0..2000 {
        let (read, at) = (k / of, k as f64 / (25.0 * of as f64));
        let _ = writeln!(text, "{:.2},{}", (read + 1) as f64 / 25.0, value(at, k % of));
    }
    text
}

#[test]
fn bursts_of_one_time_are_told_from_lines_that_were_written_twice() {
    let moving = |t: f64| format!("{:.5},0.01,{:.5},0.02,0.03,9.81", (2.0 * t).sin(), 0.5 * (3.0 * t).cos());
    let (made, folder) = of_text(&buffered(8, |t, _| moving(t)), &mut Nobody);
    assert_eq!(line(&made, "time: {").0, "time: {column: t_s, unit: s, duplicates: burst}");
    let recording = is_taken(&made, &folder.path().join("hand.csv"));
    let times = &recording.gyro_b_rad_s.time_s;
    assert_eq!(times.len(), 2000);
    assert!(times.windows(2).all(|two| (two[1] - two[0] - 0.005).abs() < 1e-6), "{:?}", &times[..20]);
    // Each sample has the time at which it was measured: a sine, but for a start of the clock.
    let start = recording.gyro_b_rad_s.value[0].x.asin() / 2.0;
    let off =
        |(t, rate): (&f64, &nalgebra::Vector3<f64>)| (rate.x - (2.0 * (t - times[0] + start)).sin()).abs();
    assert!(times.iter().zip(&recording.gyro_b_rad_s.value).all(|sample| off(sample) < 1e-4));
    assert_eq!(line(&made, "rate_hz: 200.0").1, Origin::Measured);
    // The same line twice.
    let twice = buffered(2, |t, place| moving(t - place as f64 / 50.0));
    let (made, folder) = of_text(&twice, &mut Nobody);
    assert_eq!(line(&made, "time: {").0, "time: {column: t_s, unit: s, duplicates: first}");
    assert_eq!(is_taken(&made, &folder.path().join("hand.csv")).gyro_b_rad_s.len(), 1000);
    // Of a hinge's angle as well.
    let angles: String =
        (0..800).map(|k| format!("{:.2},{}\n", f64::from(k / 4) / 10.0, 0.3 * f64::from(k))).collect();
    let (made, _folder) = of_text(&format!("t_s,yaw_deg\n{angles}"), &mut Nobody);
    assert_eq!(line(&made, "time: {").0, "time: {column: t_s, unit: s, duplicates: burst}");
    // Sensors in lines of their own share a time and are none.
    let apart = buffered(2, |t, place| {
        if place == 0 { format!("{:.5},0.01,{:.5},,,", t.sin(), t.cos()) } else { ",,,0.02,0.03,9.81".into() }
    });
    assert_eq!(line(&of_text(&apart, &mut Nobody).0, "time: {").0, "time: {column: t_s, unit: s}");
}

#[test]
fn columns_without_a_sensor_are_those_of_the_file_by_its_name() {
    for (name, key) in [
        ("Gyroscope.csv", "gyro: {columns: [x, \"y\", z], unit: rad/s}"),
        ("GyroscopeUncalibrated.csv", "gyro: {columns: [x, \"y\", z], unit: rad/s}"),
        ("TotalAcceleration.csv", "accelerometer: {columns: [x, \"y\", z], unit: m/s^2}"),
        ("Accelerometer.2026-11-26.csv", "accelerometer: {columns: [x, \"y\", z], unit: m/s^2}"),
    ] {
        let mut noise = Noise(4);
        let up = if key.starts_with("gyro") { 0.0 } else { 9.81 };
        let mut text = "time,seconds_elapsed,z,y,x\n".to_owned();
        for k in 0..1000 {
            let (ns, [x, y, z]) = (
                1_700_000_000_000_000_000_i64 + k * 10_000_000,
                [0.0, 0.0, up].map(|f| f + 0.002 * noise.next()),
            );
            let _ = writeln!(text, "{ns},{:.7},{z:.6},{y:.6},{x:.6}", k as f64 / 100.0);
        }
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join(name);
        std::fs::write(&file, &text).unwrap();
        let made = new_rig(&file, folder.path(), None, &mut Nobody).unwrap();
        assert_eq!(line(&made, key).0, key, "{name}");
        // Of the other time nobody asks.
        assert!(made.ignored.is_empty(), "{:?}", made.ignored);
        let nameless = folder.path().join("recording.csv");
        std::fs::write(&nameless, &text).unwrap();
        let error = format!("{:#}", new_rig(&nameless, folder.path(), None, &mut Nobody).unwrap_err());
        assert!(error.contains("no column is known"), "{error}");
    }
}

#[test]
fn a_px4_log_in_csv_is_read() {
    let mut noise = Noise(12);
    let mut text = "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2],gyro_integral_dt,accelerometer_timestamp_relative,accelerometer_m_s2[0],\
                    accelerometer_m_s2[1],accelerometer_m_s2[2],accelerometer_integral_dt,accelerometer_clipping,gyro_clipping\n"
        .to_owned();
    for k in 0..2000 {
        let [gx, gy, gz] = [0.0; 3].map(|f: f64| f + 0.003 * noise.next());
        let [x, y, z] = [0.0, 0.0, -9.81].map(|f| f + 0.03 * noise.next());
        let _ = writeln!(
            text,
            "{},{gx:.6},{gy:.6},{gz:.6},4000,0,{x:.5},{y:.5},{z:.5},4000,0,0",
            54_321_000 + k * 4000
        );
    }
    let (made, folder) = of_text(&text, &mut Nobody);
    assert_eq!(line(&made, "time: {").0, "time: {column: timestamp, unit: us}");
    assert!(
        line(&made, "gyro: {")
            .0
            .contains("[\"gyro_rad[0]\", \"gyro_rad[1]\", \"gyro_rad[2]\"], unit: rad/s}")
    );
    assert!(line(&made, "accelerometer: {").0.ends_with("unit: m/s^2}"));
    // px4 has x forward, y right, z down.
    assert!(made.notes.iter().any(|note| note.contains("z points down")), "{:?}", made.notes);
    let recording = is_taken(&made, &folder.path().join("hand.csv"));
    assert!((recording.gyro_b_rad_s.time_s[1999] - 7.996).abs() < 1e-9);
}
