//! Voltages through Linux's Industrial I/O: tank pressure and bus voltage behind an analog-to-digital converter.
//!
//! A channel is `(raw + offset) * scale` millivolt (Linux, Documentation/ABI/testing/sysfs-bus-iio, in_voltageY_raw). What that
//! is of the sensor behind it, `gain` and `zero` say: quantity = zero + gain * volt.

mod channel;
mod emulator;
pub mod inertial;

use std::path::Path;
use std::time::{Duration, Instant};

use whorl_dynamics::PlatformModel;
use whorl_params::{Limits, Reader, any};

use crate::DeviceError;
use crate::device::{Address, Device, DeviceKind, Role};
use crate::emulation::Emulator;
use crate::mailbox::Mailbox;
use crate::place::Place;
use crate::reading::{Measured, Reporter, State};

/// Its row in the table.
pub const KIND: DeviceKind = DeviceKind {
    name: "iio_adc",
    what: "analog-to-digital converter, Linux Industrial I/O: tank pressure, bus voltage",
    read,
};

/// Between readings; the rate of the topics.
const PERIOD: Duration = Duration::from_millis(100);

/// One converter.
#[derive(Debug, Clone)]
struct Converter {
    folder: String,
    inputs: Vec<Input>,
}

/// One channel in use.
#[derive(Debug, Clone, PartialEq)]
struct Input {
    role: Role,
    channel: String,
    /// In the quantity's unit.
    zero: f64,
    /// In the quantity's unit per volt.
    gain: f64,
}

fn read(r: &mut Reader<'_>, _: &PlatformModel) -> Option<Box<dyn Device>> {
    let before = r.error_count();
    let folder = channel::folder(r);
    let quantities = [("tank_pressure", Role::TankPressure, "Pa"), ("bus_voltage", Role::BusVoltage, "V")];
    let inputs = r.children("inputs").into_iter().filter_map(|name| {
        let Some((_, role, unit)) = quantities.iter().find(|(known, ..)| *known == name) else {
            let names = quantities.map(|(known, ..)| known).join(", ");
            r.reject_group(&format!("inputs.{name}"), format!("no such quantity; allowed: {names}"));
            return None;
        };
        let all: fn() -> Limits<f64> = any;
        Some(r.group("inputs", |r| {
            r.group(&name, |r| Input {
                role: *role,
                channel: r.string("channel", "name of the channel, such as in_voltage0"),
                zero: r.f64_or("zero", 0.0, all(), &format!("the quantity at 0 V [{unit}]")),
                gain: r.f64("gain", all(), &format!("the quantity per volt [{unit}/V]")),
            })
        }))
    });
    let inputs: Vec<Input> = inputs.collect();
    if inputs.is_empty() && r.error_count() == before {
        r.reject("kind", "the converter measures nothing; allowed: inputs.tank_pressure, inputs.bus_voltage");
    }
    if let Some(input) = inputs.iter().find(|input| input.gain == 0.0).filter(|_| r.error_count() == before) {
        let quantity = if input.role == Role::BusVoltage { "bus_voltage" } else { "tank_pressure" };
        r.reject(&format!("inputs.{quantity}.gain"), "allowed: any number but 0");
    }
    (r.error_count() == before).then(|| Box::new(Converter { folder, inputs }) as Box<dyn Device>)
}

impl Input {
    /// The quantity from what the files say.
    fn quantity(&self, raw: f64, offset: f64, scale_mv: f64) -> f64 {
        self.zero + self.gain * (raw + offset) * scale_mv * 1e-3
    }

    fn measured(&self, quantity: f64) -> Measured {
        if self.role == Role::BusVoltage {
            Measured::BusVoltage(quantity)
        } else {
            Measured::TankPressure(quantity)
        }
    }

    fn measure(&self, folder: &Path) -> Result<f64, DeviceError> {
        let [raw, offset, scale] = channel::read(folder, &self.channel)?;
        Ok(self.quantity(raw, offset, scale))
    }
}

impl Device for Converter {
    fn addresses(&self) -> Vec<Address> {
        self.inputs.iter().map(|input| channel::address(&self.folder, &input.channel)).collect()
    }

    fn path(&self) -> Option<&str> {
        Some(&self.folder)
    }

    fn roles(&self) -> Vec<Role> {
        self.inputs.iter().map(|input| input.role).collect()
    }

    fn serve(&self, place: &Place, mailbox: &Mailbox, reporter: &Reporter) -> Result<(), DeviceError> {
        let folder = place.path(&self.folder);
        let mut ready = false;
        while !mailbox.is_closed() {
            for input in &self.inputs {
                let quantity = input.measure(&folder)?;
                reporter.measured(Instant::now(), input.measured(quantity));
            }
            if !std::mem::replace(&mut ready, true) {
                reporter.state(State::Ready);
            }
            mailbox.idle(PERIOD);
        }
        Ok(())
    }

    fn emulator(&self, _: &PlatformModel) -> Emulator {
        emulator::new(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_channel_is_raw_plus_offset_times_scale_in_millivolt() {
        let folder = tempfile::tempdir().unwrap();
        let write = |file: &str, text: &str| std::fs::write(folder.path().join(file), text).unwrap();
        // 0.5 to 4.5 V for 0 to 30 MPa: 2.5 V in the middle.
        let input =
            Input { role: Role::TankPressure, channel: "in_voltage3".into(), zero: -3.75e6, gain: 7.5e6 };
        assert!(input.measure(folder.path()).unwrap_err().to_string().contains("in_voltage3_raw"));
        write("in_voltage3_raw", "20010\n");
        write("in_voltage_scale", "0.125\n");
        write("in_voltage3_offset", "-10\n");
        assert!((input.measure(folder.path()).unwrap() - 15e6).abs() < 1e-6);
        write("in_voltage3_raw", "");
        assert!(input.measure(folder.path()).unwrap_err().to_string().contains("holds no number"));
    }
}
