//! What every board with valves must do, tried on a board whose outputs can be seen.

use std::cell::RefCell;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::device::{Device, NamedDevice};
use crate::list::DeviceList;
use crate::mailbox::Command;
use crate::place::Place;
use crate::reading::{Measured, Reading, State};
use crate::running::Devices;

/// Longer than any test waits.
const LONG_S: f64 = 600.0;
const PATIENCE: Duration = Duration::from_secs(120);

/// A board at work.
pub(crate) struct Bench<'a> {
    pub(crate) devices: Devices,
    /// Whether the valve of jet 0, or of jet 1, is open.
    pub(crate) is_open: &'a dyn Fn(usize) -> bool,
}

impl<'a> Bench<'a> {
    /// Starts the board, which has jets 0 and 1, and waits until it answers.
    pub(crate) fn start(
        device: impl Device + 'static,
        place: &Place,
        is_open: &'a dyn Fn(usize) -> bool,
    ) -> Self {
        let named = NamedDevice { name: "valves".to_owned(), kind: "tested", device: Arc::new(device) };
        let list = DeviceList { devices: vec![named], ..DeviceList::default() };
        let bench = Self { devices: Devices::start(&list, place).unwrap(), is_open };
        bench.until("the board", &Command::Alive, || bench.readings().iter().any(is_ready));
        bench
    }

    pub(crate) fn readings(&self) -> Vec<Reading> {
        std::iter::from_fn(|| self.devices.next_reading()).collect()
    }

    /// Says this again and again until something is so.
    pub(crate) fn until(&self, what: &str, command: &Command, is_so: impl Fn() -> bool) {
        let begin = Instant::now();
        while !is_so() {
            assert!(begin.elapsed() < PATIENCE, "waited in vain for {what}");
            assert!(!(self.is_open)(1), "a pulse shorter than its valve can make was made");
            self.devices.command(command);
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Jet 0 for so long, jet 1 for less than its valve can.
    pub(crate) fn open(&self, on_time_s: f64) {
        let pulses = Command::Pulses(Instant::now(), Arc::from([on_time_s, 0.005]));
        self.until("the valve to open", &pulses, || (self.is_open)(0));
    }
}

fn is_ready(reading: &Reading) -> bool {
    matches!(reading, Reading::State { state: State::Ready, .. })
}

/// Valves shut by themselves at the end of a pulse, when they are told to, when the node falls silent, and when it ends.
/// `outlets`: jets 0 and 1, with a shortest pulse of 10 ms.
pub(crate) fn valves_are_shut(device: impl Device + 'static, place: &Place, is_open: &dyn Fn(usize) -> bool) {
    let bench = Bench::start(device, place, is_open);
    assert!(!is_open(0) && !is_open(1));
    bench.open(0.2);
    bench.until("the end of the pulse", &Command::Alive, || !is_open(0));
    bench.open(LONG_S);
    bench.until("a valve that is told to shut", &Command::AllOff, || !is_open(0));
    // Both edges of the first jet are told, some time after the valve has moved.
    let switched = RefCell::new(Vec::new());
    bench.until("both edges", &Command::AllOff, || {
        switched.borrow_mut().extend(
            bench
                .readings()
                .into_iter()
                .filter_map(|reading| match reading {
                    Reading::Measured { measured: Measured::Valves(switched), .. } => Some(switched),
                    _ => None,
                })
                .flatten(),
        );
        let of_first = |(jet, open): &(usize, bool)| (*jet == 0).then_some(*open);
        let edges: Vec<bool> = switched.borrow().iter().filter_map(of_first).collect();
        edges.ends_with(&[true, false])
    });
    bench.open(LONG_S);
    let begin = Instant::now();
    while is_open(0) {
        assert!(begin.elapsed() < PATIENCE, "a silent node leaves a valve open");
        std::thread::sleep(Duration::from_millis(2));
    }
    bench.open(LONG_S);
    drop(bench);
    assert!(!is_open(0), "a node that ends leaves a valve open");
}
