//! Jets: pulses, planned once a slot.

use nalgebra::Vector3;
use whorl_allocation::{JetMask, Mode};
use whorl_dynamics::actuators::{Joints, KINDS, Kind};
use whorl_dynamics::effects::ThrustLag;
use whorl_dynamics::platform::Jet;
use whorl_node::Timestamp;

use super::{Actuation, Found, found};

/// Shortfall of alpha that is treated as zero.
const ATTAINED: f64 = 1.0 - 1e-6;

impl Actuation {
    pub(super) fn slot_begins(&mut self, stamp: Timestamp) -> bool {
        let begins = match self.slot_start {
            None => Some(stamp),
            Some(start) => {
                let elapsed_s = stamp.seconds_since(start);
                if elapsed_s < self.slot_length_s - self.half_step_s {
                    None
                } else if elapsed_s < 1.5 * self.slot_length_s {
                    // On the grid, so that late samples do not stretch the slots.
                    Some(Timestamp(start.0 + (self.slot_length_s * 1e9).round() as i64))
                } else {
                    Some(stamp)
                }
            }
        };
        if begins.is_some() {
            self.slot_start = begins;
            self.slot += 1;
        }
        begins.is_some()
    }

    pub(super) fn plan_jets(&mut self, torque_b_n_m: &Vector3<f64>, joints: &[Joints; KINDS]) {
        if self.mode == Mode::Both {
            let Some(motors_alone) = self.allocate(Mode::Motors, *torque_b_n_m) else { return };
            let wheels = Kind::Wheels as usize;
            let unload = self.unloading.update(
                &self.actuators.wheels.0,
                &joints[wheels].velocity_rad_s,
                &self.wheel_target_rad_s,
                self.unload.get_mut(self.ranges[wheels].clone()).unwrap_or(&mut []),
            );
            if !unload && motors_alone.alpha >= ATTAINED {
                self.modulator.reset();
                self.close_jets();
                return;
            }
            for ((wish, need), unload) in
                self.demand.motor_desired.iter_mut().zip(&motors_alone.motor_command).zip(&self.unload)
            {
                *wish = need + unload;
            }
        }
        let torque = self.modulator.compensated_torque_b_n_m(*torque_b_n_m);
        let planned = self.allocate(self.mode, torque).and_then(|allocation| {
            Some((self.modulator.modulate(&allocation.jet_on_fraction).ok()?, allocation))
        });
        let Some((pulses, allocation)) = planned else {
            self.close_jets();
            return;
        };
        self.jet_torque_b_n_m = pulses.impulse_b_n_m_s / self.slot_length_s;
        self.jet_alpha = allocation.alpha;
        self.jet_found = found(&allocation);
        self.saturated_jets = allocation.saturated_jets;
        for (((on, planned), jet), rate) in
            self.on_time_s.iter_mut().zip(&pulses.on_time_s).zip(&self.jets).zip(&self.gas_rate_kg_s)
        {
            *on = commanded_on_s(jet, self.lag, *planned, self.slot_length_s);
            self.gas_used_kg += planned * rate;
        }
    }

    pub(super) fn close_jets(&mut self) {
        self.on_time_s.fill(0.0);
        self.jet_torque_b_n_m = Vector3::zeros();
        self.saturated_jets = JetMask::NONE;
        self.jet_alpha = 1.0;
        self.jet_found = Found::Off;
    }

    /// After an excitation: discards its remaining pulses.
    pub fn end_excitation(&mut self) {
        if self.on_time_s.iter().any(|on| *on > 0.0) {
            self.slot += 1;
        }
        self.close_jets();
        self.slot_start = None;
    }

    pub(super) fn set_available(&mut self, failed_by_driver: &[bool]) {
        let mut available = JetMask::ALL;
        for (j, by_parameter) in self.failed_by_parameter.iter().enumerate() {
            if *by_parameter || failed_by_driver.get(j).copied().unwrap_or(false) {
                available = available.without(j);
            }
        }
        self.demand.jet_available = available;
    }

    /// Commanded on-time of each jet in this slot \[s\].
    pub fn on_time_s(&self) -> &[f64] {
        &self.on_time_s
    }

    /// This slot's number.
    pub fn slot(&self) -> u64 {
        self.slot
    }

    /// Length of a slot \[s\].
    pub fn slot_length_s(&self) -> f64 {
        self.slot_length_s
    }

    /// Whether each jet is at its upper limit.
    pub fn saturated_jets(&self) -> Vec<bool> {
        (0..self.jets.len()).map(|j| self.saturated_jets.contains(j)).collect()
    }

    /// Whether each jet is held at zero.
    pub fn failed_jets(&self) -> Vec<bool> {
        (0..self.jets.len()).map(|j| !self.demand.jet_available.contains(j)).collect()
    }

    /// Gas used by the model \[kg\].
    pub fn gas_used_kg(&self) -> f64 {
        self.gas_used_kg
    }
}

/// Duration of full thrust with the same impulse as a jet commanded on for this time [s].
pub(super) fn effective_on_s(jet: &Jet, lag: ThrustLag, commanded_s: f64) -> f64 {
    lag.pulse_impulse_s(commanded_s - jet.opening_delay_s + jet.closing_delay_s)
}

/// The inverse: the on-time whose impulse equals full thrust for this time [s]: zero, or from its minimum
/// to the slot.
fn commanded_on_s(jet: &Jet, lag: ThrustLag, effective_s: f64, slot_length_s: f64) -> f64 {
    if effective_s <= 0.0 {
        return 0.0;
    }
    let commanded = lag.open_for_impulse_s(effective_s) + jet.opening_delay_s - jet.closing_delay_s;
    commanded.max(jet.min_on_time_s).min(slot_length_s)
}
