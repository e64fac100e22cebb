//! Calls against the kernel's header, the chip's rules against its documentation, and the valves' safety on an emulated chip and,
//! where there is one, on a simulated chip of the kernel.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::sync::{Arc, Mutex};

use gpiosim::Level;

use super::protocol::{Answer, Call, ChipState, EBUSY, EINVAL, EPERM, LineRequest, LineValues};
use super::*;
use crate::mailbox::Command;
use crate::reading::{Measured, Reading};
use crate::valves_bench::{Bench, valves_are_shut};

const CHIP: &str = "/dev/gpiochip9";

/// Jets 0 and 1 on lines 5 and 9.
fn setup(chip: &str, active_low: bool) -> Valves {
    let outlet = |jet, output| Outlet { output, jet, shortest_s: 0.01 };
    Valves {
        chip: chip.to_owned(),
        label: None,
        lines: vec![outlet(0, 5), outlet(1, 9)],
        active_low,
        heartbeat: Some(2),
        watchdog_s: 0.2,
        stop: Some(Contact { line: 7, active_low: true }),
    }
}

/// A chip behind a socket, as the emulators' place has it.
struct Chip {
    folder: tempfile::TempDir,
    state: Arc<Mutex<ChipState>>,
}

impl Chip {
    fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let file = Place::host_file(folder.path(), CHIP);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, listener.local_addr().unwrap().to_string()).unwrap();
        let state = Arc::new(Mutex::new(ChipState::new(12)));
        let chip = Arc::clone(&state);
        std::thread::spawn(move || listener.incoming().flatten().for_each(|socket| answer(socket, &chip)));
        Self { folder, state }
    }

    fn place(&self) -> Place {
        Place::below(self.folder.path())
    }

    fn is_high(&self, line: usize) -> bool {
        self.state.lock().unwrap().is_high[line]
    }
}

fn answer(mut socket: TcpStream, chip: &Mutex<ChipState>) {
    let (mut received, mut buffer) = (Vec::new(), [0; 1024]);
    while let Ok(count @ 1..) = socket.read(&mut buffer) {
        received.extend_from_slice(&buffer[..count]);
        while let Some(call) = Call::take(&mut received).unwrap() {
            let answer = chip.lock().unwrap().carry_out(&call);
            socket.write_all(&answer.bytes()).unwrap();
        }
    }
    chip.lock().unwrap().closed();
}

/// Sizes and places as a C compiler gives them for linux/gpio.h; the sizes are also part of the calls' numbers (0xC250B407,
/// 0xC010B40E, 0xC010B40F).
#[test]
fn arguments_are_laid_out_as_in_the_kernels_header() {
    let bytes = Call::GetLine(LineRequest::of(&setup(CHIP, false))).bytes();
    assert_eq!((bytes[0], bytes.len()), (0x07, 1 + 0x250));
    let u32_at = |at: usize| u32::from_ne_bytes(bytes[1 + at..5 + at].try_into().unwrap());
    let u64_at = |at: usize| u64::from_ne_bytes(bytes[1 + at..9 + at].try_into().unwrap());
    assert_eq!([u32_at(0), u32_at(4), u32_at(8), u32_at(12)], [5, 9, 2, 7]);
    assert_eq!(&bytes[1 + 256..1 + 262], b"whorl\0");
    // Outputs; and the fourth line an input that is active low and pulled up.
    assert_eq!((u64_at(288), u32_at(296), u32_at(560)), (8, 1, 4));
    assert_eq!((u32_at(320), u64_at(328), u64_at(336)), (1, 4 + 2 + 0x100, 0b1000));
    let set = Call::SetValues(LineValues { bits: 5, mask: 7 });
    assert_eq!((set.bytes()[0], set.bytes().len()), (0x0F, 1 + 0x10));
    let get = Call::GetValues(LineValues { bits: 0, mask: 8 });
    assert_eq!((get.bytes()[0], get.bytes().len()), (0x0E, 1 + 0x10));
    // In any pieces.
    let all = [bytes.clone(), set.bytes(), get.bytes()].concat();
    let (mut received, mut found) = (Vec::new(), Vec::new());
    for byte in all {
        received.push(byte);
        found.extend(Call::take(&mut received).unwrap());
    }
    assert_eq!(found, [Call::GetLine(LineRequest::of(&setup(CHIP, false))), set, get]);
    assert!(Call::take(&mut vec![0x99]).is_err());
}

/// gpio-v2-get-line-ioctl.rst, gpio-v2-line-set-values-ioctl.rst, error-codes.rst.
#[test]
fn a_chip_refuses_what_the_kernel_refuses() {
    let mut chip = ChipState::new(12);
    let request = Call::GetLine(LineRequest::of(&setup(CHIP, true)));
    let set = |bits, mask| Call::SetValues(LineValues { bits, mask });
    assert_eq!(chip.carry_out(&set(1, 1)).error, EINVAL);
    assert_eq!(chip.carry_out(&request), Answer::default());
    assert_eq!(chip.carry_out(&request).error, EBUSY);
    // Active low: inactive is high.
    assert!(chip.is_high[5] && chip.is_high[9] && chip.is_high[2] && !chip.is_high[7]);
    assert_eq!(chip.carry_out(&set(0b001, 0b111)).error, 0);
    assert!(!chip.is_high[5] && chip.is_high[9]);
    // An input cannot be set, and nothing is set besides.
    assert_eq!(chip.carry_out(&set(0b1010, 0b1010)).error, EPERM);
    assert!(chip.is_high[9]);
    let get = Call::GetValues(LineValues { bits: 0, mask: 0b1000 });
    assert_eq!(chip.carry_out(&get).values.bits, 0b1000, "low is active");
    chip.closed();
    assert!(!chip.is_high[5], "the worst that the kernel allows");
    let far = Call::GetLine(LineRequest { lines: vec![(12, 8)] });
    assert_eq!(chip.carry_out(&far).error, EINVAL);
    let both = Call::GetLine(LineRequest { lines: vec![(1, 12)] });
    assert_eq!(chip.carry_out(&both).error, EINVAL);
}

#[test]
fn valves_on_an_emulated_chip_are_shut_whatever_ends_the_session() {
    for active_low in [false, true] {
        let chip = Chip::start();
        chip.state.lock().unwrap().is_high.fill(active_low);
        let is_open = |jet: usize| chip.is_high([5, 9][jet]) != active_low;
        valves_are_shut(setup(CHIP, active_low), &chip.place(), &is_open);
    }
}

/// The heartbeat stands still when nobody writes; a broken wire of the stop is a press.
#[test]
fn the_heartbeat_beats_and_the_emergency_stop_is_read() {
    let chip = Chip::start();
    let is_open = |jet: usize| chip.is_high([5, 9][jet]);
    let bench = Bench::start(setup(CHIP, false), &chip.place(), &is_open);
    for beat in [true, false, true] {
        bench.until("the heartbeat", &Command::Alive, || chip.is_high(2) == beat);
    }
    for is_pressed in [true, false] {
        chip.state.lock().unwrap().is_high[7] = is_pressed;
        let told = Measured::EmergencyStop(is_pressed);
        bench.until("the contact", &Command::Alive, || {
            bench
                .readings()
                .iter()
                .any(|r| matches!(r, Reading::Measured { measured, .. } if *measured == told))
        });
    }
    drop(bench);
    assert!(!chip.is_high(2));
}

/// A chip that answers no more, with a valve open: it is shut when it can be reached again.
#[test]
fn a_chip_that_is_lost_has_its_valves_shut_when_it_is_back() {
    let chip = Chip::start();
    let is_open = |jet: usize| chip.is_high([5, 9][jet]);
    let bench = Bench::start(setup(CHIP, false), &chip.place(), &is_open);
    bench.open(600.0);
    // As if its driver had been removed: every call fails until the lines are requested anew.
    chip.state.lock().unwrap().closed();
    assert!(is_open(0));
    bench.until("the valve to be shut", &Command::Alive, || !is_open(0));
}

#[test]
fn a_missing_chip_is_named_with_its_remedy() {
    let wrong = setup("/dev/gpiochip_none", false).inspect(&Place::default()).unwrap().unwrap_err();
    assert!(wrong.found.contains("/dev/gpiochip_none is not there") && wrong.remedy.contains("gpiodetect"));
    let error = request(&setup("/dev/null", false), &Place::default()).err().unwrap().to_string();
    assert!(error.contains("/dev/null"), "{error}");
}

/// A character device of the kernel: lines of `gpio-sim` (Documentation/admin-guide/gpio/gpio-sim.rst).
#[test]
fn valves_on_a_chip_of_the_kernel_are_shut_whatever_ends_the_session() {
    const WHAT: &str = "valves on a chip of the kernel";
    if !Path::new("/sys/bus/gpio").exists() {
        return whorl_tests::skipped(WHAT, "the kernel has no GPIO character devices (CONFIG_GPIO_CDEV)");
    }
    let bank = gpiosim::Bank::new(12, "whorl-test");
    let sim = match gpiosim::builder().with_bank(&bank).live() {
        Ok(sim) => sim,
        Err(error) => return whorl_tests::skipped(WHAT, &format!("no gpio-sim: {error}")),
    };
    let chip = &sim.chips()[0];
    for active_low in [false, true] {
        let mut setup = setup(&chip.dev_path().display().to_string(), active_low);
        setup.label = Some("whorl-test".to_owned());
        let seen = setup.inspect(&Place::default()).unwrap();
        assert!(seen.as_ref().is_ok_and(|seen| seen.contains("4 lines are free")), "{seen:?}");
        // What nobody drives is at rest, as the board's resistors have it.
        for line in [5, 9] {
            chip.set_pull(line, if active_low { Level::High } else { Level::Low }).unwrap();
        }
        let is_open = |jet: usize| (chip.get_level([5, 9][jet]).unwrap() == Level::High) != active_low;
        valves_are_shut(setup.clone(), &Place::default(), &is_open);
        setup.label = Some("other".to_owned());
        assert!(request(&setup, &Place::default()).err().unwrap().to_string().contains("not other"));
    }
}
