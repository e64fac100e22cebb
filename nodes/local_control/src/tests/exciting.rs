//! Excitations: what the platform does while the coordinator calls for one.

use nalgebra::Vector3;
use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{ControlStatus, Excitation};
use whorl_node::Timestamp;

use super::rig::*;

const EXCITE: (u8, u8) = (ControlStatus::MODE_EXCITE, ControlStatus::REASON_NONE);
const TRACK: (u8, u8) = (ControlStatus::MODE_TRACK, ControlStatus::REASON_NONE);

fn rig(arguments: &[&str]) -> Rig {
    let mut rig = Rig::holding("whorl_1", arguments, balanced());
    rig.run(1.0);
    assert_eq!(rig.mode(), TRACK);
    rig
}

/// Plays an excitation for a while, renewed 50 times a second.
fn play(rig: &mut Rig, name: &str, duration_s: f64) {
    let began = rig.now;
    while rig.now.seconds_since(began) < duration_s {
        let message = Excitation {
            header: whorl_msgs::std_msgs::Header { stamp: rig.now.into(), frame_id: String::new() },
            name: name.to_owned(),
            elapsed_s: rig.now.seconds_since(began),
            valid_until: Timestamp(rig.now.0 + 300_000_000).into(),
            ..Excitation::default()
        };
        let route = whorl_msgs::topics::Route::platform(rig.core.parameters().platform, Topic::Excitation);
        rig.send(route, message);
        rig.tick();
        rig.tick();
    }
}

/// One jet after the other fires, each once a second and alone, while every wheel coasts.
#[test]
fn jets_fire_one_by_one_while_nothing_else_acts() {
    let mut rig = rig(&[
        "excitations.pulses.jets:=[jet_3, jet_6]",
        "excitations.pulses.on_time_s:=[0.05, 0.1]",
        "excitations.pulses.every_s:=1.0",
    ]);
    let before = rig.commands.len();
    play(&mut rig, "pulses", 4.0);
    assert_eq!(rig.mode(), EXCITE);
    let mut fired = Vec::new();
    let mut slot = None;
    for command in &rig.commands[before + 5..] {
        assert!(command.wheel_torque_n_m.iter().all(|x| *x == 0.0));
        let on: Vec<(usize, f64)> =
            command.jet_on_time_s.iter().copied().enumerate().filter(|(_, on)| *on > 0.0).collect();
        if slot.replace(command.jet_slot) != Some(command.jet_slot) {
            fired.extend(on);
        }
    }
    assert_eq!(fired, [(2, 0.05), (5, 0.05), (2, 0.1), (5, 0.1)]);
    // Silence ends it, and the reference is taken up again.
    rig.run(0.5);
    assert_eq!(rig.mode(), TRACK);
    assert!(rig.command().jet_on_time_s.iter().all(|on| *on == 0.0));
}

/// With the tilt held, a torque on the yaw wheel turns the platform by what physics says, and control adds nothing.
#[test]
fn yaw_is_left_alone_while_the_tilt_is_held() {
    let mut rig = rig(&[
        "excitations.yaw.hold:=tilt",
        "excitations.yaw.wheels:=[wheel_z]",
        "excitations.yaw.signal:=sweep",
        "excitations.yaw.torque_n_m:=0.2",
        "excitations.yaw.period_s:=20.0",
        "excitations.yaw.highest_hz:=0.1",
    ]);
    play(&mut rig, "yaw", 8.0);
    assert_eq!(rig.mode(), EXCITE);
    let truth = rig.plant.truth();
    // The wheel's motor gives the body what it takes from the wheel; friction of both bearings is small.
    let wheel = rig.plant.truth().wheel_speed_rad_s[2] * 0.02;
    let yaw = truth.omega_wb_b_rad_s.z * 12.1;
    assert!(yaw.abs() > 0.3 && (yaw + wheel).abs() < 0.05 * yaw.abs() + 0.03, "{yaw} {wheel}");
    let up = |q: nalgebra::UnitQuaternion<f64>| q.inverse() * Vector3::z();
    assert!(up(truth.q_world_body).angle(&up(balanced())) < 2e-3);
}

/// On top of control: the attitude stays, and the wheel shows the signal.
#[test]
fn a_signal_comes_on_top_of_control() {
    let mut rig = rig(&[
        "excitations.noise.hold:=attitude",
        "excitations.noise.wheels:=[wheel_x, wheel_y, wheel_z]",
        "excitations.noise.signal:=prbs",
        "excitations.noise.torque_n_m:=0.05",
        "excitations.noise.highest_hz:=1.0",
    ]);
    play(&mut rig, "noise", 6.0);
    assert_eq!(rig.mode(), TRACK);
    assert!(rig.plant.truth().q_world_body.angle_to(&balanced()) < 0.01);
    let moved = rig.commands.iter().rev().take(500).map(|c| c.wheel_torque_n_m[2].abs()).fold(0.0, f64::max);
    assert!(moved > 0.05, "{moved}");
}

#[test]
fn a_limit_ends_it_until_the_next() {
    let mut rig = rig(&[
        "excitations.hard.wheels:=[wheel_x]",
        "excitations.hard.signal:=sweep",
        "excitations.hard.torque_n_m:=0.5",
        "excitations.hard.period_s:=60.0",
        "excitations.hard.highest_hz:=0.1",
    ]);
    play(&mut rig, "hard", 20.0);
    assert_eq!(rig.mode(), (ControlStatus::MODE_HOLD, ControlStatus::REASON_EXCITATION_LIMIT));
    assert!(rig.statuses.iter().all(|s| s.mode != ControlStatus::MODE_SAFE_DAMPING));
    assert!(rig.rate_rad_s() < 0.01, "it was brought to rest");
    rig.run(1.0);
    assert_eq!(rig.mode(), TRACK);
    play(&mut rig, "hard", 0.5);
    assert_eq!(rig.mode(), EXCITE);
}

#[test]
fn an_excitation_that_is_not_there_is_refused() {
    let mut rig = rig(&[]);
    play(&mut rig, "pulses", 0.5);
    assert_eq!(rig.mode(), (ControlStatus::MODE_HOLD, ControlStatus::REASON_EXCITATION_UNKNOWN));
}

#[test]
fn parameters_of_excitations_that_cannot_be_are_refused() {
    let refusal = |arguments: &[&str]| {
        let node = tree(arguments).for_node("/whorl_1/local_control");
        whorl_params::try_read(&node, crate::parameters::read).unwrap_err().to_string()
    };
    let text = refusal(&[
        "excitations.a.wheels:=[wheel_q]",
        "excitations.a.signal:=prbs",
        "excitations.a.torque_n_m:=0.1",
    ]);
    assert!(text.contains("there is no `wheel_q`; allowed: wheel_x, wheel_y, wheel_z"), "{text}");
    let text = refusal(&[
        "excitations.a.wheels:=[wheel_x]",
        "excitations.a.signal:=prbs",
        "excitations.a.torque_n_m:=0.6",
    ]);
    assert!(text.contains("up to the wheels' 0.5 N m"), "{text}");
    let text = refusal(&[
        "excitations.a.jets:=[jet_1]",
        "excitations.a.on_time_s:=[0.2]",
        "excitations.a.every_s:=1.0",
    ]);
    assert!(text.contains("from 0.01 to 0.1 s"), "{text}");
    let text = refusal(&["excitations.a.hold:=tilt", "actuators:=jets"]);
    assert!(text.contains("it is the wheels that hold"), "{text}");
    let text = refusal(&["excitations.a.torque_n_m:=0.1"]);
    assert!(text.contains("torque_n_m"), "{text}");
}
