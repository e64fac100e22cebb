//! Means of commands over a window.

use whorl_dynamics::PlatformModel;
use whorl_recording::OnInterval;

use super::*;

#[test]
fn means_are_those_of_what_jumps_within() {
    let mut model = PlatformModel::whorl_1_reference();
    for jet in model.jets_mut() {
        (jet.opening_delay_s, jet.closing_delay_s) = (0.006, 0.004);
    }
    let mut recording = Recording { jet_pulses: vec![Vec::new(); 12], ..Recording::default() };
    // Gas flows from 0.106 to 0.124 s; of the other jet's pulse none does.
    recording.jet_pulses[0].push(OnInterval { on_s: 0.1, off_s: 0.12 });
    recording.jet_pulses[1].push(OnInterval { on_s: 0.1, off_s: 0.101 });
    for (time_s, torque_n_m) in [(0.0, 0.1), (0.11, 0.2), (0.13, 0.4)] {
        recording.wheel_torque_command_n_m.time_s.push(time_s);
        recording.wheel_torque_command_n_m.value.push(vec![torque_n_m, 0.0, -torque_n_m]);
    }
    let gyrostat = Gyrostat::new(&model).unwrap();
    let commands = Commands::along(&recording, &gyrostat, None);
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
    let mean = commands.mean_between(0.1, 0.12);
    near(mean.valve_fraction[0], 0.7);
    assert_eq!(mean.valve_fraction[1], 0.0);
    near(mean.wheel_torque_n_m[0], 0.15);
    near(mean.wheel_torque_n_m[2], -0.15);
    let mean = commands.mean_between(0.12, 0.14);
    near(mean.valve_fraction[0], 0.2);
    near(mean.wheel_torque_n_m[0], 0.3);
}
