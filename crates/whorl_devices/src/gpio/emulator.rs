//! A GPIO chip as the kernel's calls show it, with the valves of the simulated platform, a watchdog circuit and the contact of
//! the emergency stop on its lines. The calls' arguments come over a socket: no process can make a character device.

use super::Valves;
use super::protocol::{Call, ChipState};
use crate::emulation::{Emulator, TcpEmulator, Wire, World};

/// Of one call \[ns\]; assumed.
const WORKS_NS: i64 = 20_000;
/// Lines that a chip has besides those in use.
const SPARE: u32 = 4;

struct Emulated {
    setup: Valves,
    chip: ChipState,
    received: Vec<u8>,
    /// Of the heartbeat's line, and when the circuit behind it cuts the valves' supply.
    beat: bool,
    cuts_ns: Option<i64>,
    is_supplied: bool,
}

pub(super) fn new(setup: &Valves) -> Emulator {
    let count = usize::try_from(setup.all().max().unwrap_or(0) + 1 + SPARE).unwrap_or(0);
    let mut chip = ChipState::new(count);
    // Pulled so that every valve is shut before anybody has requested its line.
    if setup.active_low {
        chip.is_high.fill(true);
    }
    Emulator::Tcp {
        host: setup.chip.clone(),
        device: Box::new(Emulated {
            setup: setup.clone(),
            chip,
            received: Vec::new(),
            beat: false,
            cuts_ns: None,
            is_supplied: setup.heartbeat.is_none(),
        }),
    }
}

impl Emulated {
    fn is_high(&self, line: u32) -> bool {
        usize::try_from(line).ok().and_then(|line| self.chip.is_high.get(line)).copied().unwrap_or(false)
    }

    /// What the lines do to the platform.
    fn switch(&mut self, at_ns: i64, world: &mut World) {
        world.advance_to(at_ns);
        if let Some(line) = self.setup.heartbeat {
            let beat = self.is_high(line);
            if std::mem::replace(&mut self.beat, beat) != beat {
                self.cuts_ns = Some(at_ns + (self.setup.watchdog_s * 1e9) as i64);
                self.is_supplied = true;
            }
        }
        for outlet in &self.setup.lines {
            let open = self.is_high(outlet.output) != self.setup.active_low;
            world.set_valve(world.jet_on_wire(outlet.jet), open && self.is_supplied, at_ns);
        }
    }
}

impl TcpEmulator for Emulated {
    fn connected(&mut self) {
        self.received.clear();
        self.chip.closed();
    }

    fn bytes(
        &mut self,
        at_ns: i64,
        bytes: &[u8],
        world: &mut World,
        wire: &mut Wire,
    ) -> Result<(), &'static str> {
        self.received.extend_from_slice(bytes);
        while let Some(call) = Call::take(&mut self.received)? {
            if let Some(stop) = self.setup.stop {
                let line = usize::try_from(stop.line).ok().and_then(|line| self.chip.is_high.get_mut(line));
                // Released pulls the line to its active level; pressed or broken, the chip's bias has it.
                line.into_iter()
                    .for_each(|high| *high = world.emergency_stop_is_pressed() == stop.active_low);
            }
            let answer = self.chip.carry_out(&call);
            self.switch(at_ns, world);
            wire.send_message(at_ns + WORKS_NS, answer.bytes());
        }
        Ok(())
    }

    fn due_ns(&self) -> Option<i64> {
        self.cuts_ns
    }

    fn act(&mut self, now_ns: i64, world: &mut World, _: &mut Wire) {
        if self.cuts_ns.is_some_and(|at| at <= now_ns) {
            self.cuts_ns = None;
            self.is_supplied = false;
            self.switch(now_ns, world);
        }
    }
}
