//! What every kind of motor controller on a CAN bus must do, tried over the bytes of its emulator.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use whorl_dynamics::actuators::Kind;
use whorl_dynamics::{InitialState, PlatformModel};
use whorl_params::{ParameterTree, Span};

use super::{CanMotors, Traits};
use crate::emulation::{Emulation, Fault, FaultKind, Setup};
use crate::list::DeviceList;
use crate::mailbox::Command;
use crate::place::Place;
use crate::reading::{Measured, Reading, State};
use crate::running::Devices;

const PATIENCE: Duration = Duration::from_secs(60);

/// The list that this entry makes for Whorl-I.
pub(crate) fn list(entry: &str) -> DeviceList {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.yaml");
    std::fs::write(&file, format!("/whorl_1/driver:\n  ros__parameters:\n    devices:\n      {entry}\n"))
        .unwrap();
    let tree = ParameterTree::load(&[file], &[]).unwrap();
    let model = PlatformModel::whorl_1_reference();
    whorl_params::read(&tree.for_node("/whorl_1/driver"), |r| crate::read(r, &model)).unwrap().0
}

/// The motors of this group of parameters, on Whorl-I.
pub(crate) fn motors(group: &str, traits: &Traits) -> CanMotors {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.yaml");
    std::fs::write(&file, format!("/d:\n  ros__parameters:\n    a: {group}\n")).unwrap();
    let tree = ParameterTree::load(&[file], &[]).unwrap();
    let model = PlatformModel::whorl_1_reference();
    whorl_params::read(&tree.for_node("/d"), |r| r.group("a", |r| CanMotors::read(r, &model, traits)))
        .unwrap()
        .0
        .unwrap()
}

/// The controllers of Whorl-I at work over their emulator, while `act` commands them.
pub(crate) fn at_work(entry: &str, faults: Vec<Fault>, act: impl FnOnce(&mut Bench)) {
    emulated(entry, faults, |root| act(&mut Bench::start(&list(entry), root)));
}

/// Emulates this entry's device of Whorl-I below the folder that is given to `act`.
pub(crate) fn emulated(entry: &str, faults: Vec<Fault>, act: impl FnOnce(&Path)) {
    let folder = tempfile::tempdir().unwrap();
    let setup = Setup {
        devices: list(entry),
        truth: PlatformModel::whorl_1_reference(),
        start: InitialState::default(),
        seed: 4,
        faults,
        root: folder.path().to_owned(),
        network: None,
    };
    let mut emulation = Emulation::new(setup).unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    let emulator = std::thread::spawn(move || emulation.run(&flag, |_, _| ()).unwrap());
    act(folder.path());
    stop.store(true, Ordering::Relaxed);
    emulator.join().unwrap();
}

/// The driver's side.
pub(crate) struct Bench {
    pub(crate) devices: Devices,
    /// Of each wheel [rad/s], [N m].
    pub(crate) speeds: [f64; 3],
    pub(crate) torques: [f64; 3],
    pub(crate) states: Vec<State>,
    pub(crate) refused: u64,
    pub(crate) measurements: u64,
}

impl Bench {
    pub(crate) fn start(list: &DeviceList, root: &Path) -> Self {
        let devices = Devices::start(list, &Place::below(root)).unwrap();
        let (speeds, torques) = ([0.0; 3], [0.0; 3]);
        Self { devices, speeds, torques, states: Vec::new(), refused: 0, measurements: 0 }
    }

    /// Says this again and again until something is so.
    pub(crate) fn until(&mut self, what: &str, command: &Command, is_so: impl Fn(&Self) -> bool) {
        let begin = Instant::now();
        while !is_so(self) {
            assert!(
                begin.elapsed() < PATIENCE,
                "waited in vain for {what}: {:?} {:?}",
                self.speeds,
                self.states
            );
            self.devices.command(command);
            std::thread::sleep(Duration::from_millis(10));
            while let Some(reading) = self.devices.next_reading() {
                self.note(reading);
            }
        }
    }

    fn note(&mut self, reading: Reading) {
        match reading {
            Reading::Measured { measured: Measured::Motors { motors, .. }, .. } => {
                self.measurements += 1;
                for joint in motors {
                    self.speeds[joint.index] = joint.speed_rad_s;
                    self.torques[joint.index] = joint.torque_n_m;
                }
            }
            Reading::State { state, .. } => self.states.push(state),
            Reading::Refused { count, .. } => self.refused += count,
            _ => {}
        }
    }

    pub(crate) fn is_ready(&self) -> bool {
        self.states.last() == Some(&State::Ready)
    }
}

pub(crate) fn torques(values: [f64; 3]) -> Command {
    Command::Motors(Kind::Wheels, Arc::from(values))
}

/// The file while whose existence a device is unplugged.
const OUT: &str = "out";

/// Wheels turn as they are told, each about its own axis, coast when they are not, and turn again when the wire was lost.
pub(crate) fn wheels_turn_as_told(entry: &str) {
    let unplugged = Fault { while_file: Some(OUT.to_owned()), ..always(Some(0), FaultKind::Unplugged) };
    emulated(entry, vec![unplugged], |root| {
        let bench = &mut Bench::start(&list(entry), root);
        bench.until("answers", &Command::Alive, Bench::is_ready);
        bench.until("wheels", &torques([0.2, -0.1, 0.0]), |b| b.speeds[0] > 4.0 && b.speeds[1] < -2.0);
        assert!(bench.speeds[2].abs() < 1.0, "{:?}", bench.speeds);
        assert!((bench.torques[0] - 0.2).abs() < 0.03, "{:?}", bench.torques);
        // One speed is twice the other, as the torques and as the wheels are the same.
        let ratio = bench.speeds[0] / bench.speeds[1];
        assert!((ratio + 2.0).abs() < 0.3, "{ratio}");
        bench.until("no torque", &Command::AllOff, |b| b.torques[0].abs() < 1e-9);
        // What is on its way when torque ends is seen with the next measurements.
        let seen = bench.measurements;
        bench.until("measurements", &Command::Alive, |b| b.measurements > seen + 2);
        let off = bench.speeds;
        bench.until("measurements", &Command::Alive, |b| b.measurements > seen + 20);
        assert!(
            (bench.speeds[0] - off[0]).abs() < 0.5 && bench.torques[0].abs() < 1e-9,
            "{:?}",
            bench.speeds
        );
        std::fs::write(root.join(OUT), "").unwrap();
        let lost = |b: &Bench| matches!(b.states.last(), Some(State::Lost(_)));
        bench.until("the loss", &Command::Alive, lost);
        std::fs::remove_file(root.join(OUT)).unwrap();
        bench.until("its return", &Command::Alive, Bench::is_ready);
        let before = bench.speeds[2];
        bench.until("wheels again", &torques([0.0, 0.0, 0.3]), |b| b.speeds[2] > before + 3.0);
    });
}

/// Spoilt frames are lost, and no more.
pub(crate) fn spoilt_frames_do_no_harm(entry: &str) {
    at_work(entry, vec![always(Some(0), FaultKind::Corrupt)], |bench| {
        bench.until("wheels", &torques([0.2, 0.0, 0.0]), |b| b.speeds[0] > 3.0 && b.is_ready());
        assert!(bench.speeds[1].abs() < 1.0 && bench.measurements > 20, "{:?}", bench.speeds);
    });
}

/// A motor without torque does not turn, and the others do.
pub(crate) fn a_stuck_motor_shows(entry: &str) {
    at_work(entry, vec![always(None, FaultKind::Stuck { wheel: 1 })], |bench| {
        bench.until("wheels", &torques([0.2, 0.2, 0.0]), |b| b.speeds[0] > 3.0);
        assert!(bench.speeds[1].abs() < 1.0, "{:?}", bench.speeds);
    });
}

/// A fault that is there from the start to the end.
pub(crate) fn always(device: Option<usize>, kind: FaultKind) -> Fault {
    Fault { device, kind, span: Span { start_s: 0.0, length_s: f64::INFINITY }, while_file: None }
}
