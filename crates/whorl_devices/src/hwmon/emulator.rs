//! A monitoring chip as its files look.

use super::{Chip, Role};
use crate::emulation::{Emulator, FileEmulator, World};
use whorl_math::CELSIUS_ZERO_K;

const PERIOD_NS: i64 = 20_000_000;

struct Emulated {
    chip: Chip,
    due_ns: i64,
}

pub(super) fn new(chip: &Chip) -> Emulator {
    Emulator::Files {
        folder: chip.folder.clone(),
        device: Box::new(Emulated { chip: chip.clone(), due_ns: i64::MIN }),
    }
}

impl FileEmulator for Emulated {
    fn due_ns(&self) -> i64 {
        self.due_ns
    }

    fn act(&mut self, now_ns: i64, world: &mut World) -> Vec<(String, String)> {
        self.due_ns = now_ns + PERIOD_NS;
        world.advance_to(now_ns);
        let name = self.chip.name.as_deref().unwrap_or("emulated");
        let mut files = Vec::new();
        for (input, row) in self.chip.inputs.iter().filter_map(|input| Some((input, input.row()?))) {
            let quantity = match row.role {
                Role::BusVoltage => world.plant.sample_bus_voltage_v(),
                Role::BusCurrent => world.bus_current_a(),
                _ => world.plant.sample_temperature_k() - CELSIUS_ZERO_K,
            };
            // Fixed-point numbers: whole millivolt, milliampere, millidegree.
            let milli = ((quantity - input.zero) / input.gain * 1e3).round();
            files.push((format!("{}_input", input.channel), format!("{milli}\n")));
        }
        // Last: a chip with a name has its channels.
        files.push(("name".to_owned(), format!("{name}\n")));
        files
    }
}
