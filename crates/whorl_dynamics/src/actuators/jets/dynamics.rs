//! Jets in action: valves, thrust at the current pressure, gas.

use nalgebra::Vector3;

use super::valves::Valves;
use super::{Jets, MAX_JETS};
use crate::actuators::dynamics::{Instant, KindDynamics, OnBody};
use crate::effects::{EffectSet, ThrustLag};
use crate::Environment;

/// Continuous states of the gas supply.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct State {
    /// Gas in the tank \[kg\].
    pub gas_kg: f64,
}

/// What holds between two valve edges.
#[derive(Debug, Clone)]
pub(crate) struct Drive {
    pub valves: Valves,
    /// 1 for each open valve.
    pub valve_fraction: [f64; MAX_JETS],
    initial_gas_kg: f64,
}

/// Gas that leaves the tank [kg/s].
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Forces {
    gas_rate_kg_s: f64,
}

impl KindDynamics for Jets {
    type State = State;
    type Drive = Drive;
    type Forces = Forces;

    fn at_rest(&self) -> State {
        State { gas_kg: self.tank.initial_gas_kg() }
    }

    fn idle(&self, lag: ThrustLag, now_ns: i64) -> Drive {
        Drive {
            valves: Valves::new(&self.list, lag, now_ns),
            valve_fraction: [0.0; MAX_JETS],
            initial_gas_kg: self.tank.initial_gas_kg(),
        }
    }

    #[inline]
    fn moved(&self, state: &State, rate: &State, factor: f64, to: &mut State) {
        to.gas_kg = state.gas_kg + rate.gas_kg * factor;
    }

    #[inline]
    fn add_scaled(&self, state: &mut State, rate: &State, factor: f64) {
        state.gas_kg += rate.gas_kg * factor;
    }

    #[inline]
    fn bound(&self, state: &mut State) {
        state.gas_kg = state.gas_kg.max(0.0);
    }

    #[inline]
    fn show<'a>(&'a self, state: &'a State, drive: &'a Drive, environment: &mut Environment<'a>) -> f64 {
        environment.valve_fraction = drive.valve_fraction.get(..self.list.len()).unwrap_or(&[]);
        environment.tank_pressure_pa = self.tank.pressure_pa(state.gas_kg);
        environment.gas_used_kg = drive.initial_gas_kg - state.gas_kg;
        0.0
    }

    #[inline]
    fn act(
        &self,
        at: &Instant,
        state: &State,
        drive: &Drive,
        _omega_wb_b_rad_s: &Vector3<f64>,
        body: &mut OnBody,
        to: &mut Forces,
    ) {
        let jets = drive.valves.drive(at.now_ns, at.offset_s);
        // Most of the time no jet blows, and a power is expensive.
        let thrust_factor = if jets.thrust_n == 0.0 {
            0.0
        } else {
            let pressure_ratio = self.tank.pressure_pa(state.gas_kg) / self.tank.reference_pressure_pa;
            self.tank.thrust_factor(pressure_ratio) * body.thrust_factor
        };
        body.torque_b_n_m += jets.torque_b_n_m * thrust_factor;
        *to = Forces { gas_rate_kg_s: self.tank.gas_rate_kg_s(jets.thrust_n * thrust_factor) };
    }

    #[inline]
    fn add_effects(
        &self,
        effects: &EffectSet,
        environment: &Environment<'_>,
        state: &State,
        forces: &mut Forces,
    ) {
        if state.gas_kg > 0.0 {
            forces.gas_rate_kg_s += effects.gas_rate_kg_s(environment);
        }
    }

    #[inline]
    fn rate(
        &self,
        _state: &State,
        _drive: &Drive,
        forces: &Forces,
        _omega_dot_wb_b_rad_s2: &Vector3<f64>,
        to: &mut State,
    ) {
        to.gas_kg = -forces.gas_rate_kg_s;
    }

    #[inline]
    fn next_event_ns(&self, drive: &Drive) -> i64 {
        drive.valves.next_edge_ns()
    }

    fn take_over(&self, drive: &mut Drive, other: &Drive, now_ns: i64) {
        drive.valves.take_over(&other.valves, now_ns);
        (drive.valve_fraction, drive.initial_gas_kg) = (other.valve_fraction, other.initial_gas_kg);
    }

    fn settle(&self, drive: &mut Drive, now_ns: i64) {
        drive.valves.settle(now_ns);
        drive.valve_fraction = drive.valves.fractions();
    }
}
