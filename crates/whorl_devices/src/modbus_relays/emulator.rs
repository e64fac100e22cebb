//! A relay board as it looks from the network, with the valves of the simulated platform behind it.

use whorl_dynamics::PlatformModel;

use super::Relays;
use super::protocol::{Frame, carry_out, take_frame};
use crate::emulation::{Emulator, TcpEmulator, Wire, World};

/// From a request to its answer \[ns\]; assumed.
const WORKS_NS: i64 = 300_000;
/// Coils that a board has besides those in use.
const SPARE: usize = 4;

struct Emulated {
    board: Relays,
    received: Vec<u8>,
    coils: Vec<bool>,
    /// Of its watchdog.
    closes_ns: Option<i64>,
}

pub(super) fn new(board: &Relays, _: &PlatformModel) -> Emulator {
    let count = usize::from(board.first_coil) + board.coils.len() + SPARE;
    Emulator::Tcp {
        host: board.host.clone(),
        device: Box::new(Emulated {
            board: board.clone(),
            received: Vec::new(),
            coils: vec![false; count],
            closes_ns: None,
        }),
    }
}

impl Emulated {
    /// Its discrete inputs now.
    fn inputs(&self, world: &World) -> Vec<bool> {
        let count = self.board.stop_input.map_or(0, |input| usize::from(input) + 1);
        vec![!world.emergency_stop_is_pressed(); count]
    }

    fn switch(&self, at_ns: i64, world: &mut World) {
        world.advance_to(at_ns);
        let first = usize::from(self.board.first_coil);
        for (coil, outlet) in self.coils.iter().skip(first).zip(&self.board.coils) {
            world.set_valve(world.jet_on_wire(outlet.jet), *coil, at_ns);
        }
    }
}

impl TcpEmulator for Emulated {
    fn connected(&mut self) {
        self.received.clear();
    }

    fn bytes(
        &mut self,
        at_ns: i64,
        bytes: &[u8],
        world: &mut World,
        wire: &mut Wire,
    ) -> Result<(), &'static str> {
        self.received.extend_from_slice(bytes);
        while let Some(frame) = take_frame(&mut self.received)? {
            let Frame { transaction, unit, pdu } = frame;
            let mut inputs = self.inputs(world);
            let answer = Frame { transaction, unit, pdu: carry_out(&pdu, &mut self.coils, &mut inputs) };
            self.switch(at_ns, world);
            if self.board.watchdog_s > 0.0 {
                self.closes_ns = Some(at_ns + (self.board.watchdog_s * 1e9) as i64);
            }
            wire.send_message(at_ns + WORKS_NS, answer.bytes());
        }
        Ok(())
    }

    fn due_ns(&self) -> Option<i64> {
        self.closes_ns
    }

    fn act(&mut self, now_ns: i64, world: &mut World, _: &mut Wire) {
        if self.closes_ns.is_some_and(|at| at <= now_ns) {
            self.closes_ns = None;
            self.coils.fill(false);
            self.switch(now_ns, world);
        }
    }
}
