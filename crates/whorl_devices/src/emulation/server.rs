//! Runs the emulated devices of one platform in real time.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use thiserror::Error;
use whorl_dynamics::{InitialState, Plant, PlantError, PlatformModel, Truth};
use whorl_node::{ForeignNetwork, ForeignTopic};

use super::faults::{Fault, FaultKind};
use super::ports::{Socket, Terminal, remove, write_at_once};
use super::topics::Topics;
use super::wire::Wire;
use super::world::World;
use super::{Emulator, FileEmulator, SerialEmulator, TcpEmulator};
use crate::bus::Line;
use crate::list::DeviceList;
use crate::place::Place;

/// Rate of sockets, which are much quicker than serial ports [bit/s].
const NETWORK_BAUD: u32 = 100_000_000;
/// Longest sleep, and period of the truth \[ns\].
const TRUTH_PERIOD_NS: i64 = 10_000_000;
/// One platform falls behind by more than this only when its computer is overloaded \[ns\].
const BEHIND_NS: i64 = 20_000_000;

/// What an emulation needs.
#[derive(Debug, Clone)]
pub struct Setup {
    /// The platform's devices.
    pub devices: DeviceList,
    /// What the platform is like in truth.
    pub truth: PlatformModel,
    /// Where it starts.
    pub start: InitialState,
    /// Seed of its sensors' noise.
    pub seed: u64,
    /// What goes wrong.
    pub faults: Vec<Fault>,
    /// Below which its ports, hosts and files are.
    pub root: PathBuf,
    /// Where its topics are; `None`: nowhere.
    pub network: Option<Arc<dyn ForeignNetwork>>,
}

/// Why devices cannot be emulated.
#[derive(Debug, Error)]
pub enum EmulationError {
    /// The platform cannot be simulated.
    #[error("the platform cannot be simulated: {0}")]
    Plant(#[from] PlantError),
    /// A port, host or file cannot be made.
    #[error("device {device} cannot be emulated: {source}")]
    Io {
        /// Name of the device.
        device: String,
        /// Why not.
        source: std::io::Error,
    },
    /// The simulation stopped.
    #[error("the simulation stopped: {0}")]
    Diverged(String),
}

enum Port {
    Serial {
        path: PathBuf,
        terminal: Option<Terminal>,
        toward: Line,
        wire: Wire,
        device: Box<dyn SerialEmulator>,
    },
    Tcp {
        host: String,
        socket: Option<Socket>,
        wire: Wire,
        device: Box<dyn TcpEmulator>,
    },
    Files {
        folder: PathBuf,
        there: bool,
        device: Box<dyn FileEmulator>,
        files: Vec<PathBuf>,
    },
    Topics(Box<Topics>),
}

/// Emulated devices of one platform.
pub struct Emulation {
    setup: Setup,
    ports: Vec<Port>,
    world: World,
    begin: Instant,
    begin_ns: i64,
    /// How often it was late by more than 20 ms.
    late: u64,
}

impl Emulation {
    /// Makes ports, hosts and files. `setup.start.time_ns` is the time now.
    ///
    /// # Errors
    /// See [`EmulationError`].
    pub fn new(setup: Setup) -> Result<Self, EmulationError> {
        let plant = Plant::new(&setup.truth, &setup.start, setup.seed)?;
        let world = World::new(plant, &setup.truth);
        let place = Place { root: Some(setup.root.clone()), network: setup.network.clone() };
        let port = |emulator| match emulator {
            Emulator::Serial { port, baud, device } => Port::Serial {
                path: place.path(&port),
                terminal: None,
                toward: Line::new(baud),
                wire: Wire::new(baud),
                device,
            },
            Emulator::Tcp { host, device } => {
                Port::Tcp { host, socket: None, wire: Wire::new(NETWORK_BAUD), device }
            }
            Emulator::Files { folder, device } => {
                let folder = place.path(&folder);
                Port::Files { folder, there: false, device, files: Vec::new() }
            }
            Emulator::Topics { read, write, device } => {
                let topic = |(name, message_type): (String, _)| ForeignTopic {
                    name: place.topic(&name),
                    message_type,
                };
                Port::Topics(Box::new(Topics::new(place.clone(), read.map(topic), write.map(topic), device)))
            }
        };
        let ports =
            setup.devices.devices.iter().map(|named| port(named.device.emulator(&setup.truth))).collect();
        let (begin, begin_ns) = (Instant::now(), setup.start.time_ns);
        let mut emulation = Self { setup, ports, world, begin, begin_ns, late: 0 };
        emulation.plug(begin_ns)?;
        Ok(emulation)
    }

    /// Runs until `stop`; `each` gets the true state 100 times a second.
    ///
    /// # Errors
    /// The simulation stopped, or a port could not be made again.
    pub fn run(
        &mut self,
        stop: &AtomicBool,
        mut each: impl FnMut(i64, &Truth),
    ) -> Result<(), EmulationError> {
        let (mut virtual_ns, mut truth_due) = (self.begin_ns, self.begin_ns);
        while !stop.load(Ordering::Relaxed) {
            let now_ns = self.now_ns();
            self.late += u64::from(now_ns - virtual_ns > BEHIND_NS + TRUTH_PERIOD_NS);
            self.receive(now_ns);
            // Everything that was due, in the order of time.
            while virtual_ns < now_ns {
                virtual_ns = self.next_ns().min(truth_due).clamp(virtual_ns + 1, now_ns);
                self.step(virtual_ns);
                if truth_due <= virtual_ns {
                    truth_due += TRUTH_PERIOD_NS;
                    self.world.advance_to(virtual_ns);
                    self.plug(virtual_ns)?;
                    each(virtual_ns, &self.world.plant.truth());
                }
            }
            if let Some(reason) = &self.world.diverged {
                return Err(EmulationError::Diverged(reason.clone()));
            }
            self.sleep_until(self.next_ns().min(truth_due));
        }
        Ok(())
    }

    /// From the instant of a sample of the inertial sensor to the first torque of the wheels behind it, on the devices' own
    /// wires: median and 99th percentile \[s\], and how many.
    #[must_use]
    pub fn latency_s(&self) -> Option<(f64, f64, usize)> {
        let mut all = self.world.latencies_ns.clone();
        all.sort_unstable();
        let at =
            |share: f64| all.get(((all.len() as f64 - 1.0) * share) as usize).map(|ns| *ns as f64 * 1e-9);
        Some((at(0.5)?, at(0.99)?, all.len()))
    }

    /// How often the emulation itself was late by more than 20 ms, because this computer had no time for it.
    #[must_use]
    pub fn late(&self) -> u64 {
        self.late
    }

    fn now_ns(&self) -> i64 {
        self.begin_ns + i64::try_from(self.begin.elapsed().as_nanos()).unwrap_or(i64::MAX)
    }

    /// Pulls plugs and puts them back, and has every fault where it belongs.
    fn plug(&mut self, now_ns: i64) -> Result<(), EmulationError> {
        let elapsed_s = (now_ns - self.begin_ns) as f64 * 1e-9;
        let is_active = |fault: &&Fault| fault.active(elapsed_s, &self.setup.root);
        let active: Vec<&Fault> = self.setup.faults.iter().filter(is_active).collect();
        let of = |device: Option<usize>| -> Vec<FaultKind> {
            active.iter().filter(|fault| fault.device == device).map(|fault| fault.kind).collect()
        };
        self.world.faults = of(None);
        for (index, port) in self.ports.iter_mut().enumerate() {
            let faults = of(Some(index));
            let there = !faults.contains(&FaultKind::Unplugged);
            let plugged = port.plug(there, faults, &self.setup.root, now_ns);
            plugged.map_err(|source| {
                let device =
                    self.setup.devices.devices.get(index).map_or_else(String::new, |d| d.name.clone());
                EmulationError::Io { device, source }
            })?;
        }
        Ok(())
    }

    fn receive(&mut self, now_ns: i64) {
        for port in &mut self.ports {
            port.receive(now_ns, &mut self.world);
        }
    }

    fn next_ns(&self) -> i64 {
        self.ports.iter().filter_map(Port::due_ns).min().unwrap_or(i64::MAX)
    }

    fn step(&mut self, now_ns: i64) {
        for port in &mut self.ports {
            port.step(now_ns, &mut self.world);
        }
    }

    fn sleep_until(&self, at_ns: i64) {
        let left = (at_ns - self.now_ns()).clamp(0, TRUTH_PERIOD_NS);
        let mut fds: Vec<PollFd<'_>> = Vec::new();
        for port in &self.ports {
            match port {
                Port::Serial { terminal: Some(terminal), .. } => {
                    fds.push(PollFd::from_borrowed_fd(terminal.fd(), PollFlags::IN));
                }
                Port::Tcp { socket: Some(socket), .. } => {
                    fds.extend(socket.fds().map(|fd| PollFd::from_borrowed_fd(fd, PollFlags::IN)));
                }
                Port::Topics(topics) => {
                    fds.extend(topics.fd().map(|fd| PollFd::from_borrowed_fd(fd, PollFlags::IN)));
                }
                _ => {}
            }
        }
        let _ = poll(&mut fds, Some(&Timespec { tv_sec: 0, tv_nsec: left }));
    }
}

impl Port {
    fn plug(
        &mut self,
        in_place: bool,
        faults: Vec<FaultKind>,
        root: &std::path::Path,
        now_ns: i64,
    ) -> std::io::Result<()> {
        match self {
            Self::Serial { path, terminal, toward, wire, device } => {
                wire.faults = faults;
                if in_place && terminal.is_none() {
                    *terminal = Some(Terminal::open(path)?);
                    device.switched_on(now_ns);
                } else if !in_place && terminal.is_some() {
                    *terminal = None;
                    toward.clear();
                    wire.clear();
                    device.switched_on(now_ns);
                }
            }
            Self::Tcp { host, socket, wire, .. } => {
                wire.faults = faults;
                if in_place && socket.is_none() {
                    *socket = Some(Socket::open(root, host)?);
                } else if !in_place {
                    *socket = None;
                    wire.clear();
                }
            }
            Self::Files { folder, there, files, .. } => {
                if in_place {
                    std::fs::create_dir_all(folder)?;
                } else {
                    files.drain(..).for_each(|file| remove(&file));
                }
                *there = in_place;
            }
            Self::Topics(topics) => {
                topics.wire.faults = faults;
                topics.plug(in_place)?;
            }
        }
        Ok(())
    }

    fn receive(&mut self, now_ns: i64, world: &mut World) {
        match self {
            Self::Serial { terminal: Some(terminal), toward, .. } => toward.send(now_ns, &terminal.read()),
            Self::Tcp { socket: Some(socket), wire, device, .. } => {
                if socket.accept() {
                    wire.clear();
                    device.connected();
                }
                let bytes = socket.read();
                if !bytes.is_empty() && device.bytes(now_ns, &bytes, world, wire).is_err() {
                    socket.client = None;
                }
            }
            Self::Topics(topics) => topics.receive(now_ns, world),
            _ => {}
        }
    }

    fn due_ns(&self) -> Option<i64> {
        match self {
            Self::Serial { terminal: Some(_), toward, wire, device, .. } => {
                [toward.next_ns(), wire.due_ns(), device.due_ns()].into_iter().flatten().min()
            }
            Self::Tcp { wire, device, .. } => [wire.due_ns(), device.due_ns()].into_iter().flatten().min(),
            Self::Files { there: true, device, .. } => Some(device.due_ns()),
            Self::Topics(topics) => topics.due_ns(),
            _ => None,
        }
    }

    fn step(&mut self, now_ns: i64, world: &mut World) {
        match self {
            Self::Serial { terminal, toward, wire, device, .. } => {
                // A device without a plug has its own supply, and no wire.
                for (at_ns, byte) in toward.each(now_ns) {
                    device.byte(at_ns, byte, world, wire);
                }
                if device.due_ns().is_some_and(|due| due <= now_ns) {
                    device.act(now_ns, world, wire);
                }
                let bytes = wire.arrived(now_ns);
                if let Some(terminal) = terminal.as_mut().filter(|_| !bytes.is_empty()) {
                    terminal.write(&bytes);
                }
            }
            Self::Tcp { socket, wire, device, .. } => {
                if device.due_ns().is_some_and(|due| due <= now_ns) {
                    device.act(now_ns, world, wire);
                }
                let bytes = wire.arrived(now_ns);
                if let Some(socket) = socket {
                    socket.write(&bytes);
                }
            }
            Self::Files { folder, there: true, device, files } if device.due_ns() <= now_ns => {
                for (name, text) in device.act(now_ns, world) {
                    let file = folder.join(name);
                    if write_at_once(&file, &text).is_ok() && !files.contains(&file) {
                        files.push(file);
                    }
                }
            }
            Self::Files { .. } => {}
            Self::Topics(topics) => topics.step(now_ns, world),
        }
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        if let Self::Files { files, .. } = self {
            files.iter().for_each(|file| remove(file));
        }
    }
}
