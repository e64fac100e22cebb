//! Solenoid valves of the jets on lines of a GPIO chip, through Linux's character device.
//!
//! Source: Linux, Documentation/userspace-api/gpio: chardev.rst (API v2, since Linux 5.10), gpio-v2-get-line-ioctl.rst
//! ("Description", "Configuration Rules"), gpio-v2-line-set-values-ioctl.rst; include/uapi/linux/gpio.h. All lines are requested
//! at once, as outputs that are inactive, and written in one call at every edge of a pulse and every 50 ms.
//!
//! The kernel keeps lines as they were asked for only until the request is closed; then each "may revert to its default state".
//! So valves are shut before that, whatever ended the session. What ends without a word (a process that is killed, a computer
//! that hangs) is a matter of the circuit: `heartbeat_line` changes at every write, for a watchdog that cuts the valves' supply.

mod emulator;
#[cfg(feature = "buses")]
mod kernel;
mod lines;
mod protocol;
#[cfg(test)]
mod tests;

use whorl_dynamics::PlatformModel;
use whorl_params::{Reader, range};

use crate::DeviceError;
use crate::device::{Address, Device, DeviceKind, Role, Wrong};
use crate::emulation::Emulator;
use crate::mailbox::Mailbox;
use crate::place::Place;
use crate::reading::Reporter;
use crate::valves::{self, Board, Outlet};
use lines::{Emulated, Lines};

/// Its row in the table.
pub const KIND: DeviceKind = DeviceKind {
    name: "valves_gpio",
    what: "lines of a GPIO chip, Linux's character device: solenoid valves of the jets",
    read,
};

/// Lines that a chip may have; real ones have less, and refuse.
const LARGEST: u32 = 65_535;
/// Lines of one request (gpio.h, `GPIO_V2_LINES_MAX`).
const MOST: usize = 64;
/// A watchdog circuit must outlive a write or two that are late \[s\]; they come every 50 ms.
const SHORTEST_WATCHDOG_S: f64 = 0.15;

/// Lines of one chip.
#[derive(Debug, Clone)]
struct Valves {
    chip: String,
    /// As the chip says that it is called.
    #[cfg_attr(not(feature = "buses"), expect(dead_code, reason = "only the kernel's chips have labels"))]
    label: Option<String>,
    lines: Vec<Outlet>,
    /// Valves are open while their lines are low.
    active_low: bool,
    heartbeat: Option<u32>,
    /// The circuit behind the heartbeat shuts so long after its last change \[s\].
    watchdog_s: f64,
    stop: Option<Contact>,
}

/// The contact of the emergency stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Contact {
    line: u32,
    /// Released while the line is low.
    active_low: bool,
}

fn read(r: &mut Reader<'_>, model: &PlatformModel) -> Option<Box<dyn Device>> {
    let before = r.error_count();
    let chip =
        r.string("chip", "character device of the chip, such as /dev/gpiochip0 or a name of packaging/udev");
    let label = r.optional_string(
        "label",
        "label of the chip, as gpiodetect shows it: a chip of another label is refused; left out: any",
    );
    let lines = valves::read(r, model, "lines", LARGEST, "line of the valve, its offset on the chip");
    let active_low = r.bool_or("active_low", false, "a valve is open while its line is low");
    let all = range(0..=i64::from(LARGEST));
    let offset = |number: Option<i64>| number.and_then(|number| u32::try_from(number).ok());
    let heartbeat = offset(r.optional_i64(
        "heartbeat_line",
        all,
        "line that changes at every write, for a watchdog circuit that cuts the valves' supply; left out: none",
    ));
    let watchdog_s = r.f64_or(
        "watchdog_s",
        0.2,
        range(SHORTEST_WATCHDOG_S..=60.0),
        "the circuit behind heartbeat_line cuts the supply so long after its last change [s], as built",
    );
    let stop_line = offset(r.optional_i64(
        "emergency_stop_line",
        all,
        "line with the contact of the emergency stop, active while it is released; left out: none",
    ));
    let stop_low = r.bool_or(
        "emergency_stop_active_low",
        true,
        "the contact pulls its line low while it is released: the chip pulls it up, so that a broken wire is a press",
    );
    let stop = stop_line.map(|line| Contact { line, active_low: stop_low });
    let setup = Valves { chip, label, lines, active_low, heartbeat, watchdog_s, stop };
    if r.error_count() == before {
        refuse(r, &setup);
    }
    (r.error_count() == before).then(|| Box::new(setup) as Box<dyn Device>)
}

fn refuse(r: &mut Reader<'_>, setup: &Valves) {
    if setup.lines.is_empty() {
        r.reject(
            "kind",
            "it works no valve; allowed: lines.<jet> with a line of the chip for one jet or more",
        );
    }
    if setup.lines.len() + 2 > MOST {
        r.reject("kind", format!("allowed: at most {} valves on one chip", MOST - 2));
    }
    let is_valve = |line: u32| setup.lines.iter().any(|outlet| outlet.output == line);
    if let Some(line) = setup.heartbeat.filter(|line| is_valve(*line)) {
        r.reject("heartbeat_line", format!("line {line} works a valve; allowed: a line of its own"));
    }
    if let Some(line) = setup.stop.map(|stop| stop.line)
        && (is_valve(line) || setup.heartbeat == Some(line))
    {
        r.reject("emergency_stop_line", format!("line {line} is an output; allowed: a line of its own"));
    }
}

impl Valves {
    /// Offsets of what is driven: the valves', then the heartbeat's.
    fn outputs(&self) -> Vec<u32> {
        self.lines.iter().map(|outlet| outlet.output).chain(self.heartbeat).collect()
    }

    /// The same, and the contact's.
    fn all(&self) -> impl Iterator<Item = u32> {
        self.outputs().into_iter().chain(self.stop.map(|stop| stop.line))
    }
}

impl Device for Valves {
    fn addresses(&self) -> Vec<Address> {
        self.all().map(|line| Address(format!("{} line {line}", self.chip))).collect()
    }

    fn inspect(&self, place: &Place) -> Option<Result<String, Wrong>> {
        Some(inspect(self, place))
    }

    fn roles(&self) -> Vec<Role> {
        let stop = self.stop.map(|_| Role::EmergencyStop);
        self.lines.iter().map(|outlet| Role::Jet(outlet.jet)).chain(stop).collect()
    }

    fn serve(&self, place: &Place, mailbox: &Mailbox, reporter: &Reporter) -> Result<(), DeviceError> {
        let mut requested = Requested { lines: request(self, place)?, setup: self, beat: false };
        valves::serve(&mut requested, &self.lines, mailbox, reporter)
    }

    fn emulator(&self, _: &PlatformModel) -> Emulator {
        emulator::new(self)
    }
}

/// Requests the lines of the chip, or of an emulated one; outputs are inactive from the beginning.
fn request(setup: &Valves, place: &Place) -> Result<Box<dyn Lines>, DeviceError> {
    if place.root.is_some() {
        return Ok(Box::new(Emulated::request(setup, place)?));
    }
    #[cfg(feature = "buses")]
    {
        kernel::request(setup)
    }
    #[cfg(not(feature = "buses"))]
    {
        Err(DeviceError::built_without_buses(&setup.chip))
    }
}

/// What `whorl doctor` sees without requesting anything.
fn inspect(setup: &Valves, place: &Place) -> Result<String, Wrong> {
    let chip = &setup.chip;
    if place.root.is_some() {
        // Nothing more: a connection would send the driver's away.
        let found = place.host(chip).map(|_| format!("{chip}: emulated, its lines are there"));
        return found.map_err(|error| Wrong {
            found: format!("{chip}: {error}"),
            remedy: "start the emulators again".to_owned(),
        });
    }
    #[cfg(feature = "buses")]
    {
        kernel::inspect(setup)
    }
    #[cfg(not(feature = "buses"))]
    {
        let found = DeviceError::built_without_buses(chip).to_string();
        Err(Wrong { found, remedy: "use the program `whorl`".to_owned() })
    }
}

/// Lines that are ours until this is dropped. Then they are inactive, even if a panic has ended the session.
struct Requested<'a> {
    lines: Box<dyn Lines>,
    setup: &'a Valves,
    beat: bool,
}

impl Drop for Requested<'_> {
    fn drop(&mut self) {
        // Nothing is left to be done about lines that do not hear.
        let _ = self.lines.set(0);
    }
}

impl Board for Requested<'_> {
    fn write(&mut self, open: &[bool]) -> Result<(), DeviceError> {
        self.beat = !self.beat;
        let beat = self.setup.heartbeat.map(|_| self.beat);
        let active = open.iter().copied().chain(beat);
        self.lines.set(active.enumerate().fold(0, |bits, (line, active)| bits | u64::from(active) << line))
    }

    fn stop_is_released(&mut self) -> Result<Option<bool>, DeviceError> {
        self.setup.stop.map(|_| self.lines.input()).transpose()
    }
}
