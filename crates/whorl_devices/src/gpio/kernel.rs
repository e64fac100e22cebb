//! Lines of a chip, through the kernel.

use std::path::Path;

use gpiocdev::line::{Bias, Value, Values};
use gpiocdev::{Chip, Request};
use rustix::fs::Access;

use super::Valves;
use super::lines::Lines;
use crate::DeviceError;
use crate::device::Wrong;

/// Who uses the lines, as `gpioinfo` shows it.
const CONSUMER: &str = "whorl";

/// Requests the lines; outputs are inactive from the beginning.
pub(super) fn request(setup: &Valves) -> Result<Box<dyn Lines>, DeviceError> {
    let chip = open(setup, Path::new(&setup.chip))?;
    free(setup, &chip)?;
    let mut builder = Request::builder();
    builder.on_chip(chip.path()).with_consumer(CONSUMER);
    let outputs = setup.outputs();
    builder.with_lines(&outputs).as_output(Value::Inactive);
    if setup.active_low {
        builder.as_active_low();
    }
    // Settings are those of the lines that were named last.
    if let Some(stop) = setup.stop {
        builder.with_line(stop.line).as_input();
        if stop.active_low {
            builder.as_active_low().with_bias(Bias::PullUp);
        } else {
            builder.as_active_high().with_bias(Bias::PullDown);
        }
    }
    let request = builder.request().map_err(refused("lines of", setup))?;
    Ok(Box::new(Kernels { request, outputs, setup: setup.clone() }))
}

/// What `whorl doctor` sees without requesting anything.
pub(super) fn inspect(setup: &Valves) -> Result<String, Wrong> {
    let wrong = |found: String, remedy: &str| Wrong { found, remedy: remedy.to_owned() };
    let chip = &setup.chip;
    let path = Path::new(chip);
    if !path.exists() {
        let remedy =
            "gpiodetect lists chips; without any, the kernel lacks the chip's driver or CONFIG_GPIO_CDEV";
        return Err(wrong(format!("{chip} is not there"), remedy));
    }
    if rustix::fs::access(path, Access::READ_OK | Access::WRITE_OK).is_err() {
        let remedy =
            "sudo usermod -aG dialout $USER, and log in again (packaging/udev gives that group the chip)";
        return Err(wrong(format!("{chip}: no permission"), remedy));
    }
    let opened = open(setup, path).map_err(|error| {
        wrong(error.to_string(), "gpiodetect lists chips with their labels: correct chip, label or lines")
    })?;
    free(setup, &opened).map_err(|error| {
        wrong(error.to_string(), "gpioinfo shows who uses which line; is the driver running already?")
    })?;
    let label = opened.info().map(|info| info.label).unwrap_or_default();
    Ok(format!("{chip} [{label}]: its {} lines are free", setup.all().count()))
}

fn refused(what: &str, setup: &Valves) -> impl Fn(gpiocdev::Error) -> DeviceError {
    let what = format!("{what} {}", setup.chip);
    move |error| DeviceError::Refused(format!("{what}: {error}"))
}

/// The chip, if it is the right one and has these lines.
fn open(setup: &Valves, path: &Path) -> Result<Chip, DeviceError> {
    std::fs::metadata(path).map_err(DeviceError::io("cannot open", &setup.chip))?;
    let chip = Chip::from_path(path).map_err(refused("cannot open", setup))?;
    let info = chip.info().map_err(refused("cannot ask", setup))?;
    if let Some(label) = setup.label.as_ref().filter(|label| **label != info.label) {
        let text = format!("{} is the chip {}, and not {label}", setup.chip, info.label);
        return Err(DeviceError::Refused(text));
    }
    if let Some(line) = setup.all().find(|line| *line >= info.num_lines) {
        let last = info.num_lines.saturating_sub(1);
        let text = format!("{} [{}] has lines 0 to {last}, not {line}", setup.chip, info.label);
        return Err(DeviceError::Refused(text));
    }
    Ok(chip)
}

/// Whether nobody else uses the lines.
fn free(setup: &Valves, chip: &Chip) -> Result<(), DeviceError> {
    for line in setup.all() {
        let info = chip.line_info(line).map_err(refused("cannot ask", setup))?;
        if info.used {
            let text = format!("line {line} of {} is used by {:?}", setup.chip, info.consumer);
            return Err(DeviceError::Refused(text));
        }
    }
    Ok(())
}

/// The kernel's.
struct Kernels {
    request: Request,
    outputs: Vec<u32>,
    setup: Valves,
}

impl Lines for Kernels {
    fn set(&mut self, active: u64) -> Result<(), DeviceError> {
        let value = |place: usize| Value::from(active >> place & 1 == 1);
        let values: Values =
            self.outputs.iter().enumerate().map(|(place, line)| (*line, value(place))).collect();
        self.request.set_values(&values).map_err(refused("cannot write", &self.setup))
    }

    fn input(&mut self) -> Result<bool, DeviceError> {
        let Some(stop) = self.setup.stop else { return Ok(false) };
        let value = self.request.value(stop.line).map_err(refused("cannot read", &self.setup))?;
        Ok(value == Value::Active)
    }
}
