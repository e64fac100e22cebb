//! What turns, and what comes next for it.

use std::fmt::Write as _;

use super::questions::Nobody;
use super::tests::{Noise, of_text};

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
    let hinge = lines("t,gyro_z_deg_s", Box::new(|t| format!("{:.4}", 57.0 * t.sin())));
    let (made, folder) = of_text(&hinge, &mut Nobody);
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
