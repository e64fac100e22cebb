//! What turns: a hinge by its angle, a wheel by its speed, a hand; and what comes next for each.

use std::fmt::Write as _;

use super::foreign_tests::wheel;
use super::new_rig;
use super::questions::Nobody;
use super::tests::{Noise, is_taken, line, of_text};

/// A body that swings by 40 deg at 0.5 Hz: a line is `t, angle [rad]`, as `write` writes it.
fn swing(header: &str, write: impl Fn(f64, f64) -> String) -> String {
    let mut text = format!("{header}\n");
    for k in 0..2000 {
        let t = f64::from(k) / 50.0;
        let _ = writeln!(text, "{}", write(t, 0.7 * (std::f64::consts::PI * t).sin()));
    }
    text
}

#[test]
fn an_angle_is_that_of_a_hinge_by_the_names_that_people_give_it() {
    for (header, map, axis) in [
        ("t_s,yaw_deg", "{column: yaw_deg, unit: deg}", 2),
        ("t_s,Pendulum angle [deg]", "{column: \"Pendulum angle [deg]\", unit: deg}", 2),
        ("t,theta (rad)", "{column: \"theta (rad)\", unit: rad}", 2),
        ("time,hinge.position_rad", "{column: \"hinge.position_rad\", unit: rad}", 2),
        ("time,angle", "{column: angle, unit: rad}", 2),
        ("time,pitch_rev", "{column: pitch_rev, unit: rev, axis: y}", 1),
        ("time,angle_x_deg", "{column: angle_x_deg, unit: deg, axis: x}", 0),
    ] {
        let per_rad = match header {
            _ if header.contains("deg") => 180.0 / std::f64::consts::PI,
            _ if header.contains("rev") => 1.0 / std::f64::consts::TAU,
            _ => 1.0,
        };
        let text = swing(header, |t, angle| format!("{t:.2},{:.6}", per_rad * angle));
        let (made, folder) = of_text(&text, &mut Nobody);
        assert_eq!(line(&made, "hinge_angle: {").0, format!("hinge_angle: {map}"), "{header}");
        let mut direction = [0.0; 3];
        direction[axis] = 1.0;
        assert!(
            line(&made, "freedom: {").0.contains(&format!("kind: hinge, axis: {direction:?}")),
            "{header}"
        );
        let recording = is_taken(&made, &folder.path().join("hand.csv"));
        // 0.7 pi cos(pi t) at its largest, from the mean over a step.
        let most = recording.gyro_b_rad_s.value.iter().map(|rate| rate[axis]).fold(0.0, f64::max);
        assert!((most - 0.7 * std::f64::consts::PI).abs() < 0.01, "{header}: {most}");
    }
}

#[test]
fn an_angle_beside_its_wheel_is_the_hinges_and_an_encoder_there_is_not() {
    let of = |header: &str| {
        of_text(&swing(header, |t, angle| format!("{t:.2},{angle:.6},{:.3}", 50.0 * t)), &mut Nobody).0
    };
    let made = of("t,theta_rad,wheel_rad_s");
    assert_eq!(line(&made, "hinge_angle: {").0, "hinge_angle: {column: theta_rad, unit: rad}");
    assert!(line(&made, "freedom: {").0.contains("kind: hinge"));
    let made = of("t,encoder,wheel_rad_s");
    assert!(line(&made, "freedom: {").0.contains("kind: clamped"));
    assert_eq!(made.ignored, ["encoder"]);
}

#[test]
fn angles_of_an_attitude_are_no_hinge() {
    let text = swing("t,roll_deg,pitch_deg,yaw_deg", |t, angle| {
        format!("{t:.2},{angle:.6},{:.6},{:.6}", 2.0 * angle, 3.0 * angle)
    });
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("hand.csv");
    std::fs::write(&file, text).unwrap();
    let error = format!("{:#}", new_rig(&file, folder.path(), None, &mut Nobody).unwrap_err());
    assert!(error.contains("roll_deg, pitch_deg, yaw_deg are angles about several axes"), "{error}");
}

#[test]
fn the_speed_of_a_wheel_is_no_gyro() {
    for (header, unit) in [
        ("t_s,motor_n_m,speed_rad_s", "rad/s"),
        ("t_s,torque_n_m,speed_rad_s", "rad/s"),
        ("t,torque,omega_rad_s", "rad/s"),
        ("t,motor_torque_nm,speed", "rad/s"),
    ] {
        let text = wheel(header, |t, speed, torque| format!("{t:.2},{torque:.5},{:.3}", speed + 150.0));
        let (made, folder) = of_text(&text, &mut Nobody);
        let column = header.rsplit(',').next().unwrap();
        assert_eq!(
            line(&made, "wheel_speed: {").0,
            format!("wheel_speed: {{columns: [{column}], unit: {unit}}}")
        );
        assert!(line(&made, "wheel_torque_command: {").0.contains("unit: N m"), "{header}");
        let recording = is_taken(&made, &folder.path().join("hand.csv"));
        assert!(recording.gyro_b_rad_s.is_empty(), "{header}");
    }
}

#[test]
fn what_comes_next_takes_the_file() {
    use super::next::Next;
    let mut noise = Noise(4);
    let mut force =
        |up: f64| -> String { [0.0, 0.0, up].map(|f| format!("{:.4}", f + 0.02 * noise.next())).join(",") };
    let of = |text: &str| of_text(text, &mut Nobody).0.next;
    let lines = |header: &str, mut line: Box<dyn FnMut(f64) -> String + '_>| {
        let lines =
            (0..2000).map(|k| format!("{:.2},{}\n", f64::from(k) / 100.0, line(f64::from(k) / 100.0)));
        format!("{header}\n{}", lines.collect::<String>())
    };
    // An accelerometer alone shows neither a motion that a model explains nor an attitude.
    let alone = lines("t_s,ax,ay,az", Box::new(|_| force(9.81)));
    assert!(matches!(of(&alone), Next::Missing(what) if what.contains("there are no gyro data")));
    // A bench test without torques.
    let bench = lines("t_s,wheel_rad_s", Box::new(|t| format!("{:.3}", 90.0 + 20.0 * t.sin())));
    assert!(
        matches!(of(&bench), Next::Missing(what) if what.contains("there are no wheel torque command data"))
    );
    // What a hand turns.
    assert!(matches!(of(&turned_in_a_hand()), Next::Estimate(_)));
    let yaw = swing("t,yaw_deg", |t, angle| format!("{t:.2},{:.5}", 57.0 * angle));
    let (made, folder) = of_text(&yaw, &mut Nobody);
    assert_eq!(made.next, Next::Compare);
    let file = folder.path().join("hand.csv");
    let arguments = made.next.arguments(&file, &made.map, &made.rig).unwrap().join(" ");
    assert!(
        arguments.starts_with("compare ") && arguments.contains("hand.channels.yaml --model "),
        "{arguments}"
    );
}

/// A gyro and an accelerometer that are turned onto all sides.
fn turned_in_a_hand() -> String {
    let (mut noise, mut attitude) = (Noise(6), nalgebra::UnitQuaternion::identity());
    let mut text = "t,gx,gy,gz,ax,ay,az\n".to_owned();
    for k in 0..2000 {
        let t = f64::from(k) / 100.0;
        let rate = nalgebra::Vector3::new(1.5 * (0.7 * t).sin(), 1.2 * (0.9 * t).cos(), 0.4);
        attitude *= nalgebra::UnitQuaternion::from_scaled_axis(rate / 100.0);
        let force = attitude.inverse() * nalgebra::Vector3::new(0.0, 0.0, 9.806_65);
        let numbers = rate.iter().chain(&force).map(|x| format!("{:.5}", x + 0.005 * noise.next()));
        let _ = writeln!(text, "{t:.2},{}", numbers.collect::<Vec<_>>().join(","));
    }
    text
}
