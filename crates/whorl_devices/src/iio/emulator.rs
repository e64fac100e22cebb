//! A converter as its files look.

use super::{Converter, Role};
use crate::emulation::{Emulator, FileEmulator, World};

/// 16 bit over 5.12 V.
const SCALE_MV: f64 = 0.15625;
const LARGEST: f64 = 32767.0;
const PERIOD_NS: i64 = 20_000_000;

struct Emulated {
    converter: Converter,
    due_ns: i64,
}

pub(super) fn new(converter: &Converter) -> Emulator {
    Emulator::Files {
        folder: converter.folder.clone(),
        device: Box::new(Emulated { converter: converter.clone(), due_ns: i64::MIN }),
    }
}

impl FileEmulator for Emulated {
    fn due_ns(&self) -> i64 {
        self.due_ns
    }

    fn act(&mut self, now_ns: i64, world: &mut World) -> Vec<(String, String)> {
        self.due_ns = now_ns + PERIOD_NS;
        world.advance_to(now_ns);
        let mut files = Vec::new();
        for input in &self.converter.inputs {
            let quantity = match input.role {
                Role::BusVoltage => world.plant.sample_bus_voltage_v(),
                _ => world.plant.sample_tank_pressure_pa(),
            };
            let raw =
                ((quantity - input.zero) / input.gain * 1e3 / SCALE_MV).round().clamp(-LARGEST, LARGEST);
            files.push((format!("{}_raw", input.channel), format!("{raw}\n")));
            files.push((format!("{}_scale", input.channel), format!("{SCALE_MV}\n")));
        }
        files
    }
}
