//! The plant's jets: commands, failures and readings.

use super::valves::{JetFailure, Pulse};
use crate::State;
use crate::plant::{CommandError, Plant, ns_from_s};

impl State {
    /// Gas in the tank \[kg\].
    #[must_use]
    pub fn gas_kg(&self) -> f64 {
        self.actuators.jets.gas_kg
    }
}

impl Plant {
    /// Switches a valve on for `on_time_s`, beginning at `start_ns`. Gas flows from the opening delay
    /// after the start to the closing delay after the end. A pulse that begins when, or before, the
    /// jet's last one ends prolongs it: the valve stays open. Returns the pulse as carried out.
    ///
    /// # Errors
    /// Unknown jet, start in the past, on-time not finite or below the valve's minimum.
    pub fn command_jet_pulse(
        &mut self,
        jet: usize,
        start_ns: i64,
        on_time_s: f64,
    ) -> Result<Pulse, CommandError> {
        let jets = self.gyrostat.model().jets();
        let Some(data) = jets.get(jet) else {
            return Err(CommandError::UnknownJet { jet, jets: jets.len() });
        };
        if !on_time_s.is_finite() {
            return Err(CommandError::NotFinite);
        }
        if start_ns < self.now_ns {
            return Err(CommandError::InThePast { start_ns, now_ns: self.now_ns });
        }
        let (later_opening_s, later_closing_s) = self
            .gyrostat
            .effects()
            .valve_delay_s(&self.gyrostat.environment(self.time_s(), &self.state, &self.drive));
        let min_on_time_s = data.min_on_time_s;
        let off_ns = start_ns.saturating_add(ns_from_s(on_time_s));
        let pulse = Pulse {
            on_ns: start_ns,
            off_ns,
            opens_ns: start_ns.saturating_add(ns_from_s(data.opening_delay_s + later_opening_s)),
            closes_ns: off_ns.saturating_add(ns_from_s(data.closing_delay_s + later_closing_s)),
        };
        // One nanosecond of grace: the shortest pulse must survive its rounding.
        let min_on_time_ns = (ns_from_s(min_on_time_s) - 1).max(1);
        self.drive
            .actuators
            .jets
            .valves
            .add(jet, pulse, min_on_time_ns, self.now_ns)
            .ok_or(CommandError::BelowMinimumOnTime { on_time_s, min_on_time_s })
    }

    /// Switches every valve off at `at_ns` (now, if that is past) and forgets later pulses. Gas stops
    /// after each valve's closing delay.
    pub fn close_all_valves(&mut self, at_ns: i64) {
        let at_ns = at_ns.max(self.now_ns);
        let jets = self.gyrostat.model().jets();
        let closing_delay_ns = |j: usize| jets.get(j).map_or(0, |jet| ns_from_s(jet.closing_delay_s));
        self.drive.actuators.jets.valves.close_all(at_ns, closing_delay_ns, self.now_ns);
    }

    /// Switches one valve off at `at_ns` (now, if that is past) and forgets its later pulses. An unknown jet is none.
    pub fn close_valve(&mut self, jet: usize, at_ns: i64) {
        let at_ns = at_ns.max(self.now_ns);
        let Some(data) = self.gyrostat.model().jets().get(jet) else { return };
        let closing_delay_ns = ns_from_s(data.closing_delay_s);
        self.drive.actuators.jets.valves.close(jet, at_ns, closing_delay_ns, self.now_ns);
    }

    /// Breaks or repairs a valve from now on.
    ///
    /// # Errors
    /// Unknown jet.
    pub fn set_jet_failure(&mut self, jet: usize, failure: JetFailure) -> Result<(), CommandError> {
        let jets = &mut self.drive.actuators.jets;
        if jets.valves.fail(jet, failure, self.now_ns) {
            jets.valve_fraction = jets.valves.fractions();
            Ok(())
        } else {
            Err(CommandError::UnknownJet { jet, jets: self.gyrostat.model().jets().len() })
        }
    }

    /// Makes a jet give this much of its thrust from now on, at the same gas; an unknown jet and a factor that is not at
    /// least zero change nothing.
    pub fn set_jet_strength(&mut self, jet: usize, factor: f64) {
        if let Some(data) = self.gyrostat.model().jets().get(jet).filter(|_| factor >= 0.0 && factor.is_finite()) {
            let torque_b_n_m = data.torque_b_n_m() * factor;
            self.drive.actuators.jets.valves.set_torque(jet, torque_b_n_m, self.now_ns);
        }
    }

    /// Whether a valve is broken.
    #[must_use]
    pub fn jet_failure(&self, jet: usize) -> JetFailure {
        self.drive.actuators.jets.valves.failure(jet)
    }

    /// Time a valve's driver has been switched on since the start \[s\], as its electronics know it (a
    /// stuck valve counts all the same). Differences of two calls give the on-time between them.
    #[must_use]
    pub fn valve_driven_s(&self, jet: usize) -> f64 {
        self.valve_driven_ns(jet) as f64 * 1e-9
    }

    /// [`Self::valve_driven_s`] in nanoseconds, exact.
    #[must_use]
    pub fn valve_driven_ns(&self, jet: usize) -> i64 {
        self.drive.actuators.jets.valves.driven_ns(jet, self.now_ns)
    }

    /// Puts as much gas into the tank as this pressure means \[Pa\]: what was measured. Below nothing it is empty.
    pub fn set_tank_pressure(&mut self, pressure_pa: f64) {
        self.state.actuators.jets.gas_kg = self.gyrostat.model().tank().gas_kg(pressure_pa.max(0.0));
    }

    /// Reads the tank pressure now \[Pa\].
    pub fn sample_tank_pressure_pa(&mut self) -> f64 {
        let truth = self.gyrostat.pressure_pa(self.state.gas_kg());
        self.gyrostat.model().sensors.tank_pressure.reading(truth, self.pressure_noise.draw())
    }

    /// Time each valve has really been open since the start \[s\].
    pub(crate) fn valve_open_s(&self) -> Vec<f64> {
        let valves = &self.drive.actuators.jets.valves;
        let open_s = |jet| valves.open_ns(jet, self.now_ns) as f64 * 1e-9;
        (0..self.gyrostat.model().jets().len()).map(open_s).collect()
    }
}
