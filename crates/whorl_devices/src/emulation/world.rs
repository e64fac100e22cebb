//! The platform behind the emulated devices.

use whorl_dynamics::actuators::Kind;
use whorl_dynamics::{Plant, PlatformModel};

use super::faults::FaultKind;

/// A valve that is told to open stays open for so long, unless it is told to close \[s\].
const OPEN_S: f64 = 3600.0;

/// What computer, sensors and valves draw, all the time \[W\]; assumed.
const STANDING_W: f64 = 20.0;

/// The simulated platform, and what its devices make it do.
pub struct World {
    /// The platform.
    pub plant: Plant,
    motors: Vec<(Kind, Vec<f64>)>,
    valves: Vec<bool>,
    /// Wrong wiring and broken parts now.
    pub(super) faults: Vec<FaultKind>,
    /// When the inertial sensor has last measured, until the wheels have answered.
    pub(crate) sampled_ns: Option<i64>,
    /// From a measurement to the first torque behind it \[ns\].
    pub(super) latencies_ns: Vec<i64>,
    /// Why the simulation has stopped.
    pub(super) diverged: Option<String>,
}

impl World {
    pub(super) fn new(plant: Plant, model: &PlatformModel) -> Self {
        let motors = Kind::ALL.into_iter().zip(model.actuators.motor_ranges());
        Self {
            motors: motors.map(|(kind, range)| (kind, vec![0.0; range.len()])).collect(),
            valves: vec![false; model.jets().len()],
            plant,
            faults: Vec::new(),
            sampled_ns: None,
            latencies_ns: Vec::new(),
            diverged: None,
        }
    }

    /// Lets time pass, if it has not passed already.
    pub fn advance_to(&mut self, now_ns: i64) {
        if now_ns > self.plant.now_ns() && self.diverged.is_none() {
            self.diverged = self.plant.advance_to(now_ns).err().map(|error| error.to_string());
        }
    }

    /// A motor makes this torque from now on \[N m\].
    pub fn set_motor(&mut self, kind: Kind, index: usize, torque_n_m: f64) {
        let stuck = kind == Kind::Wheels && self.faults.contains(&FaultKind::Stuck { wheel: index });
        let Some((_, commands)) = self.motors.iter_mut().find(|(k, _)| *k == kind) else { return };
        let Some(command) = commands.get_mut(index) else { return };
        *command = if stuck { 0.0 } else { torque_n_m };
        // Sizes are right, and a torque that is not finite is refused.
        let _ = self.plant.command_motors(kind, commands);
    }

    /// A valve is driven, or not, from this time on.
    pub fn set_valve(&mut self, jet: usize, open: bool, at_ns: i64) {
        let Some(valve) = self.valves.get_mut(jet).filter(|valve| **valve != open) else { return };
        *valve = open;
        let at_ns = at_ns.max(self.plant.now_ns());
        if open {
            let _ = self.plant.command_jet_pulse(jet, at_ns, OPEN_S);
        } else {
            self.plant.close_valve(jet, at_ns);
        }
    }

    /// The speeds that encoders measure [rad/s].
    pub fn wheel_speeds(&mut self, _now_ns: i64) -> Vec<f64> {
        self.plant.sample_joints(Kind::Wheels).velocity_rad_s
    }

    /// The true speed of a wheel, which makes its back EMF [rad/s].
    #[must_use]
    pub fn true_wheel_speed(&self, wheel: usize) -> f64 {
        self.plant.state().wheel_speed_rad_s().get(wheel).copied().unwrap_or(0.0)
    }

    /// The true bus voltage \[V\].
    #[must_use]
    pub fn bus_voltage_v(&self) -> f64 {
        self.plant.environment().bus_voltage_v
    }

    /// Current from the power bus \[A\]: what is always drawn, and what the wheels' motors put into motion. Of losses, and of what
    /// motors that brake give back, the emulation knows nothing.
    #[must_use]
    pub fn bus_current_a(&self) -> f64 {
        let speeds = self.plant.state().wheel_speed_rad_s();
        let wheels = self.motors.iter().filter(|(kind, _)| *kind == Kind::Wheels);
        let torques = wheels.flat_map(|(_, torques)| torques);
        let moving_w: f64 = torques.zip(speeds).map(|(torque, speed)| (torque * speed).max(0.0)).sum();
        (STANDING_W + moving_w) / self.bus_voltage_v().max(1.0)
    }

    /// -1 for a wheel that is wired the wrong way round.
    #[must_use]
    pub fn sign_of_wheel(&self, wheel: usize) -> f64 {
        if self.faults.contains(&FaultKind::Reversed { wheel }) { -1.0 } else { 1.0 }
    }

    /// Whether somebody has pressed the emergency stop.
    #[must_use]
    pub fn emergency_stop_is_pressed(&self) -> bool {
        self.faults.contains(&FaultKind::Pressed)
    }

    /// The jet that is on the wires of this one.
    #[must_use]
    pub fn jet_on_wire(&self, jet: usize) -> usize {
        let swapped = self.faults.iter().find_map(|fault| match *fault {
            FaultKind::Swapped { jet: a, with } if a == jet => Some(with),
            FaultKind::Swapped { jet: a, with } if with == jet => Some(a),
            _ => None,
        });
        swapped.unwrap_or(jet)
    }

    /// The wheels have been given a new torque.
    pub(crate) fn torque_arrived(&mut self, at_ns: i64) {
        if let Some(sampled) = self.sampled_ns.take() {
            self.latencies_ns.push(at_ns - sampled);
        }
    }
}
