//! Monitoring chips of Linux's hwmon class (INA219, INA226, LM75 and the like): bus voltage, bus current, temperature.
//!
//! Source: Linux, Documentation/hwmon/sysfs-interface.rst: "Voltages" (`in[0-*]_input`, millivolt at the chip's pin),
//! "Currents" (`curr[1-*]_input`, milliampere), "Temperatures" (`temp[1-*]_input`, millidegree Celsius), "Alarms"
//! (`temp[1-*]_fault`), "Global attributes" (`name`); Documentation/ABI/testing/sysfs-class-hwmon. What resistors make of a
//! voltage or a current before the pin, `gain` and `zero` say: quantity = zero + gain * (V, A or degC).

mod emulator;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use whorl_dynamics::PlatformModel;
use whorl_math::CELSIUS_ZERO_K;
use whorl_params::{Limits, Reader, any};

use crate::DeviceError;
use crate::device::{Address, Device, DeviceKind, Role, Wrong};
use crate::emulation::Emulator;
use crate::mailbox::Mailbox;
use crate::place::Place;
use crate::reading::{Measured, Reporter, State};

/// Its row in the table.
pub const KIND: DeviceKind = DeviceKind {
    name: "hwmon",
    what: "monitoring chip, Linux hwmon: bus voltage, bus current, temperature",
    read,
};

/// Between readings; the rate of the topics.
const PERIOD: Duration = Duration::from_millis(100);

/// What a chip may measure.
struct Quantity {
    name: &'static str,
    role: Role,
    /// How channels of this type are called.
    prefix: &'static str,
    unit: &'static str,
    measured: fn(f64) -> Measured,
}

const QUANTITIES: [Quantity; 3] = [
    Quantity {
        name: "bus_voltage",
        role: Role::BusVoltage,
        prefix: "in",
        unit: "V",
        measured: Measured::BusVoltage,
    },
    Quantity {
        name: "bus_current",
        role: Role::BusCurrent,
        prefix: "curr",
        unit: "A",
        measured: Measured::BusCurrent,
    },
    Quantity {
        name: "temperature",
        role: Role::Temperature,
        prefix: "temp",
        unit: "degC",
        measured: |celsius| Measured::Temperature(celsius + CELSIUS_ZERO_K),
    },
];

/// One chip.
#[derive(Debug, Clone)]
struct Chip {
    folder: String,
    /// As its file `name` says.
    name: Option<String>,
    inputs: Vec<Input>,
}

/// One channel in use.
#[derive(Debug, Clone, PartialEq)]
struct Input {
    /// Its row of [`QUANTITIES`].
    quantity: usize,
    channel: String,
    /// In the quantity's unit.
    zero: f64,
    gain: f64,
}

fn read(r: &mut Reader<'_>, _: &PlatformModel) -> Option<Box<dyn Device>> {
    let before = r.error_count();
    let folder = r.string(
        "folder",
        "folder of the chip, such as /sys/class/hwmon/hwmon2, or one above that keeps its name, such as \
         /sys/bus/i2c/devices/1-0040/hwmon",
    );
    let name = r.optional_string(
        "name",
        "what the chip's file name says, such as ina226: a chip of another name is refused; left out: any",
    );
    let names = QUANTITIES.map(|quantity| quantity.name).join(", ");
    let mut inputs = Vec::new();
    for child in r.children("inputs") {
        let Some(quantity) = QUANTITIES.iter().position(|quantity| quantity.name == child) else {
            r.reject_group(&format!("inputs.{child}"), format!("no such quantity; allowed: {names}"));
            continue;
        };
        inputs.push(r.group("inputs", |r| r.group(&child, |r| read_input(r, quantity))));
    }
    if r.error_count() == before {
        let has = |role: Role| inputs.iter().any(|input| input.row().is_some_and(|q| q.role == role));
        if inputs.is_empty() {
            r.reject("kind", format!("the chip measures nothing; allowed: inputs with {names}"));
        } else if has(Role::BusCurrent) && !has(Role::BusVoltage) {
            let problem =
                "it has no place without a voltage; allowed: inputs.bus_voltage of the same chip besides";
            r.reject("inputs.bus_current.channel", problem);
        }
    }
    (r.error_count() == before).then(|| Box::new(Chip { folder, name, inputs }) as Box<dyn Device>)
}

fn read_input(r: &mut Reader<'_>, quantity: usize) -> Input {
    let Quantity { prefix, unit, .. } = &QUANTITIES[quantity];
    let all: fn() -> Limits<f64> = any;
    let before = r.error_count();
    let channel = r.string("channel", &format!("name of the channel, such as {prefix}1"));
    let number = channel.strip_prefix(prefix).map(str::parse::<u16>);
    if !matches!(number, Some(Ok(_))) && r.error_count() == before {
        r.reject(
            "channel",
            format!("no channel of this type; allowed: {prefix} and a number, such as {prefix}1"),
        );
    }
    let zero = r.f64_or("zero", 0.0, all(), &format!("the quantity where the channel says 0 [{unit}]"));
    let gain = r.f64_or("gain", 1.0, all(), &format!("the quantity per {unit} of the channel [1]"));
    if gain == 0.0 && r.error_count() == before {
        r.reject("gain", "allowed: any number but 0");
    }
    Input { quantity, channel, zero, gain }
}

impl Input {
    fn row(&self) -> Option<&'static Quantity> {
        QUANTITIES.get(self.quantity)
    }

    /// In the quantity's unit. `Ok(None)`: the chip says that its sensor is at fault.
    fn measure(&self, folder: &Path) -> Result<Option<f64>, DeviceError> {
        if number(&folder.join(format!("{}_fault", self.channel))).is_ok_and(|fault| fault != 0.0) {
            return Ok(None);
        }
        let milli = number(&folder.join(format!("{}_input", self.channel)))?;
        Ok(Some(self.zero + self.gain * milli * 1e-3))
    }
}

fn number(path: &Path) -> Result<f64, DeviceError> {
    let shown = path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(DeviceError::io("cannot read", &shown))?;
    let number = text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
    number.ok_or_else(|| DeviceError::Refused(format!("{shown} holds no number: {:?}", text.trim())))
}

impl Chip {
    /// Where the chip's files are. Numbers of hwmon folders change from start to start; the folder above a single one does not.
    fn find(&self, place: &Place) -> Result<PathBuf, DeviceError> {
        let folder = place.path(&self.folder);
        let found = if folder.join("name").exists() { folder.clone() } else { only_child(&folder)? };
        let text = std::fs::read_to_string(found.join("name"));
        let said = text.map_err(DeviceError::io("cannot read", &found.join("name").display().to_string()))?;
        match self.name.as_ref().filter(|name| **name != said.trim()) {
            Some(name) => {
                let text = format!("{} is the chip {}, and not {name}", found.display(), said.trim());
                Err(DeviceError::Refused(text))
            }
            None => Ok(found),
        }
    }
}

/// The folder `hwmonN` of one that has no other.
fn only_child(folder: &Path) -> Result<PathBuf, DeviceError> {
    let shown = folder.display().to_string();
    let entries = std::fs::read_dir(folder).map_err(DeviceError::io("cannot read", &shown))?;
    let is_chip = |path: &PathBuf| path.join("name").exists();
    let mut chips: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(is_chip).collect();
    match (chips.pop(), chips.len()) {
        (Some(chip), 0) => Ok(chip),
        (None, _) => {
            Err(DeviceError::Refused(format!("{shown} is no chip and holds none: a file name is missing")))
        }
        (_, more) => {
            Err(DeviceError::Refused(format!("{shown} holds {} chips; allowed: the folder of one", more + 1)))
        }
    }
}

impl Device for Chip {
    fn addresses(&self) -> Vec<Address> {
        self.inputs.iter().map(|input| Address(format!("{}/{}", self.folder, input.channel))).collect()
    }

    fn inspect(&self, place: &Place) -> Option<Result<String, Wrong>> {
        let see = || {
            let folder = self.find(place)?;
            let mut seen = Vec::new();
            for (input, row) in self.inputs.iter().filter_map(|input| Some((input, input.row()?))) {
                let value = input.measure(&folder)?;
                let value =
                    value.map_or("sensor fault".to_owned(), |value| format!("{value:.2} {}", row.unit));
                seen.push(format!("{} {value}", row.name));
            }
            Ok::<_, DeviceError>(format!("{}: {}", folder.display(), seen.join(", ")))
        };
        let remedy = "grep . /sys/class/hwmon/hwmon*/name lists chips; without its own, load the chip's driver (modprobe, device tree)";
        Some(see().map_err(|error| Wrong { found: error.to_string(), remedy: remedy.to_owned() }))
    }

    fn roles(&self) -> Vec<Role> {
        self.inputs.iter().filter_map(|input| Some(input.row()?.role)).collect()
    }

    fn serve(&self, place: &Place, mailbox: &Mailbox, reporter: &Reporter) -> Result<(), DeviceError> {
        let folder = self.find(place)?;
        let mut told = None;
        while !mailbox.is_closed() {
            let mut state = State::Ready;
            for input in &self.inputs {
                match (input.measure(&folder)?, input.row()) {
                    (Some(value), Some(row)) => reporter.measured(Instant::now(), (row.measured)(value)),
                    _ => {
                        state = State::Fault(format!(
                            "{}_fault: its sensor is broken or not connected",
                            input.channel
                        ))
                    }
                }
            }
            if told.as_ref() != Some(&state) {
                reporter.state(state.clone());
                told = Some(state);
            }
            mailbox.idle(PERIOD);
        }
        Ok(())
    }

    fn emulator(&self, _: &PlatformModel) -> Emulator {
        emulator::new(self)
    }
}
