//! What goes wrong with emulated devices, and how they are wired wrongly.

use std::path::Path;

use whorl_dynamics::PlatformModel;
use whorl_params::{Reader, Span, non_negative};

use crate::list::DeviceList;

/// What is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultKind {
    /// The plug is pulled: port, host or files are gone, and come back.
    Unplugged,
    /// It sends nothing.
    Silent,
    /// Every fifth message ends in the middle.
    Torn,
    /// Every fifth message has a wrong bit.
    Corrupt,
    /// Every message is 30 ms late.
    Late,
    /// The wheel's motor turns the other way than its sign says.
    Reversed {
        /// Index of the wheel.
        wheel: usize,
    },
    /// The wheel's motor makes no torque.
    Stuck {
        /// Index of the wheel.
        wheel: usize,
    },
    /// The emergency stop is pressed.
    Pressed,
    /// The wires of two valves are exchanged.
    Swapped {
        /// Index of one jet.
        jet: usize,
        /// Index of the other.
        with: usize,
    },
}

/// A fault of one device and the time in which it is there.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// Index in the list of devices; `None`: of the platform's wiring.
    pub device: Option<usize>,
    /// What is wrong.
    pub kind: FaultKind,
    /// When, from the emulators' start.
    pub span: Span,
    /// File below the emulators' folder while whose existence it is there; `None`: all the time. Whoever makes and removes
    /// the file switches the fault on and off.
    pub while_file: Option<String>,
}

impl Fault {
    /// Whether it is there at this time after the start of the emulators of this folder.
    #[must_use]
    pub fn active(&self, elapsed_s: f64, root: &Path) -> bool {
        self.span.contains(elapsed_s) && self.while_file.as_ref().is_none_or(|file| root.join(file).exists())
    }
}

const KINDS: [&str; 9] =
    ["unplugged", "silent", "torn", "corrupt", "late", "reversed", "stuck", "swapped", "pressed"];

/// Reads the group `emulation.faults`: any number of faults under names of the user's choice.
pub fn read(r: &mut Reader<'_>, model: &PlatformModel, list: &DeviceList) -> Vec<Fault> {
    let names = r.children("emulation.faults");
    let read = |name: &String| r.group("emulation.faults", |r| r.group(name, |r| read_one(r, model, list)));
    names.iter().map(read).collect()
}

fn read_one(r: &mut Reader<'_>, model: &PlatformModel, list: &DeviceList) -> Fault {
    let wheels: Vec<&str> = model.wheels().iter().map(|wheel| wheel.name.as_str()).collect();
    let jets: Vec<&str> = model.jets().iter().map(|jet| jet.name.as_str()).collect();
    let kind = r.choice("kind", &KINDS, "what goes wrong");
    let mut device = None;
    let kind = match kind {
        "reversed" => FaultKind::Reversed { wheel: named(r, "wheel", &wheels) },
        "stuck" => FaultKind::Stuck { wheel: named(r, "wheel", &wheels) },
        "pressed" => FaultKind::Pressed,
        "swapped" => FaultKind::Swapped { jet: named(r, "jet", &jets), with: named(r, "with", &jets) },
        of_the_wire => {
            let devices: Vec<&str> = list.devices.iter().map(|d| d.name.as_str()).collect();
            device = Some(named(r, "device", &devices));
            match of_the_wire {
                "silent" => FaultKind::Silent,
                "torn" => FaultKind::Torn,
                "corrupt" => FaultKind::Corrupt,
                "late" => FaultKind::Late,
                _ => FaultKind::Unplugged,
            }
        }
    };
    let start_s = r.f64_or("start_s", 0.0, non_negative(), "when it begins, from the emulators' start [s]");
    let span = Span::from_start(r, start_s);
    let doc = "it is there only while a file of this name is in the emulators' folder, which their first line names";
    let while_file = r.optional_string("while_file", doc);
    if while_file.as_ref().is_some_and(|name| name.is_empty() || name.contains('/') || name.starts_with('.'))
    {
        r.reject("while_file", "allowed: the name of a file, without folders, such as imu_out".to_owned());
    }
    Fault { device, kind, span, while_file }
}

/// Index of a name; 0 after an error.
fn named(r: &mut Reader<'_>, key: &str, names: &[&str]) -> usize {
    let before = r.error_count();
    let name = r.string(key, "which one");
    let index = names.iter().position(|known| *known == name);
    if index.is_none() && r.error_count() == before {
        r.reject(key, format!("there is no such one; allowed: {}", names.join(", ")));
    }
    index.unwrap_or(0)
}
