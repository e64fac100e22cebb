//! How a kind of actuator moves and what it does to the body, for the truth plant.

use std::fmt;

use nalgebra::{Matrix3, Vector3};

use crate::Environment;
use crate::effects::{EffectSet, ThrustLag};
use crate::platform::sensors::SensorSuite;
use crate::sensing::JointSample;

/// An instant within a segment between two events.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Instant {
    /// Start of the segment \[ns\].
    pub now_ns: i64,
    /// Time since then \[s\].
    pub offset_s: f64,
    /// Time since the start of the run, of the instant itself \[s\].
    pub time_s: f64,
}

/// What the actuators do to the body at one instant, besides what follows from their reaction.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OnBody {
    /// Torque on the body, body axes [N m].
    pub torque_b_n_m: Vector3<f64>,
    /// Thrust of every jet over that of its valve and the tank's pressure, as effects say: given.
    pub thrust_factor: f64,
    /// Moment m g r_cg of the centre of mass, body axes [N m].
    pub gravity_offset_b_n_m: Vector3<f64>,
}

/// A part that slides against Coulomb friction, on the way between two states.
pub(crate) struct Sliding {
    pub part: usize,
    /// Sense in which it slides: -1 or 1; 0 where it does not.
    pub sense: f64,
    /// Its speeds in both states.
    pub from: f64,
    pub to: f64,
}

impl Sliding {
    /// The part that stops first between the states, `h_s` apart, and roughly when \[s\].
    #[inline]
    pub fn first_to_stop(parts: impl Iterator<Item = Self>, h_s: f64) -> Option<(usize, f64)> {
        let mut found: Option<(usize, f64)> = None;
        for Self { part, sense, from, to } in parts {
            if sense * to < 0.0 {
                // What has just broken loose starts from zero and cannot stop at once.
                let stop_s = if from == 0.0 { 0.0 } else { h_s * from / (from - to) };
                if found.is_none_or(|(_, earliest_s)| stop_s < earliest_s) {
                    found = Some((part, stop_s));
                }
            }
        }
        found
    }
}

/// The plant's side of a kind. Angular momentum is conserved when, with the kind's momentum h and the torques u that
/// it reports as reaction, dh/dt = u - (inertia taken out) dw/dt in body axes.
///
/// No function here may allocate: it runs four times in every integration step. Where a function writes into `to`, that
/// holds zeros, or what the same function of the same platform wrote before, so that only entries of the platform's own
/// parts need be written.
pub(crate) trait KindDynamics {
    /// Continuous states; also their rates.
    type State: Copy + Default + PartialEq + fmt::Debug;
    /// Constant between two events: commands, and which parts stick or are open.
    type Drive: Clone + fmt::Debug;
    /// Torques and flows within the kind at one instant.
    type Forces: Clone + Default + fmt::Debug;

    /// States of a platform at rest.
    fn at_rest(&self) -> Self::State {
        Self::State::default()
    }

    /// Nothing commanded; `lag` is that of the jets' thrust.
    fn idle(&self, lag: ThrustLag, now_ns: i64) -> Self::Drive;

    /// to = state + factor * rate.
    fn moved(&self, _state: &Self::State, _rate: &Self::State, _factor: f64, _to: &mut Self::State) {}

    /// state += factor * rate.
    fn add_scaled(&self, _state: &mut Self::State, _rate: &Self::State, _factor: f64) {}

    /// Puts states that left their range back, after a step.
    fn bound(&self, _state: &mut Self::State) {}

    /// Whether the states are numbers still.
    fn is_finite(&self, _state: &Self::State) -> bool {
        true
    }

    /// Writes what effects see of the kind; returns its load on the electrical bus [N m of motor torque].
    fn show<'a>(
        &'a self,
        _state: &'a Self::State,
        _drive: &'a Self::Drive,
        _environment: &mut Environment<'a>,
    ) -> f64 {
        0.0
    }

    /// Adds the momentum of its parts relative to the body, body axes [N m s].
    fn add_momentum(&self, _state: &Self::State, _sum_b_n_m_s: &mut Vector3<f64>) {}

    /// Takes out of `left` the inertia that does not resist angular acceleration, body axes [kg m^2]; without a
    /// drive, of every part whose torque a model knows, rather than its motion.
    fn take_out(&self, _drive: Option<&Self::Drive>, _left: &mut Matrix3<f64>) {}

    /// Forces at one instant; what acts on the body directly is added to `body`.
    fn act(
        &self,
        at: &Instant,
        state: &Self::State,
        drive: &Self::Drive,
        omega_wb_b_rad_s: &Vector3<f64>,
        body: &mut OnBody,
        to: &mut Self::Forces,
    );

    /// Adds what effects do.
    fn add_effects(
        &self,
        _effects: &EffectSet,
        _environment: &Environment<'_>,
        _state: &Self::State,
        _forces: &mut Self::Forces,
    ) {
    }

    /// Adds the torque u with which the body moves the parts, body axes [N m].
    fn add_reaction(&self, _drive: &Self::Drive, _forces: &Self::Forces, _sum_b_n_m: &mut Vector3<f64>) {}

    /// Rates of the states.
    fn rate(
        &self,
        state: &Self::State,
        drive: &Self::Drive,
        forces: &Self::Forces,
        omega_dot_wb_b_rad_s2: &Vector3<f64>,
        to: &mut Self::State,
    );

    /// When the drive changes by itself next \[ns\]: the integrator stops there and calls [`Self::settle`].
    fn next_event_ns(&self, _drive: &Self::Drive) -> i64 {
        i64::MAX
    }

    /// Takes over what another platform's actuators of this kind do from now on, whose constants may be others.
    fn take_over(&self, drive: &mut Self::Drive, other: &Self::Drive, _now_ns: i64) {
        drive.clone_from(other);
    }

    /// Does what is due now.
    fn settle(&self, _drive: &mut Self::Drive, _now_ns: i64) {}

    /// Decides from the states which parts stick, after they were set from outside.
    fn set_out(&self, _state: &Self::State, _drive: &mut Self::Drive) {}

    /// A part that stuck and is held no longer, and the sense in which it slips. `environment` makes what effects
    /// depend on.
    fn first_slip<'a>(
        &self,
        _effects: &EffectSet,
        _environment: &dyn Fn() -> Environment<'a>,
        _drive: &Self::Drive,
        _omega_dot_wb_b_rad_s2: &Vector3<f64>,
    ) -> Option<(usize, f64)> {
        None
    }

    /// The part that comes to a stop first on the way between two states `h_s` apart, and roughly when \[s\].
    fn first_stop(
        &self,
        _from: &Self::State,
        _to: &Self::State,
        _drive: &Self::Drive,
        _h_s: f64,
    ) -> Option<(usize, f64)> {
        None
    }

    /// The speed that is zero when that part stops.
    fn speed(&self, _state: &Self::State, _part: usize) -> f64 {
        0.0
    }

    /// Lets a part slide in this sense (-1, 1), or puts its speed to zero and lets it stick (0).
    fn slide(&self, _state: &mut Self::State, _drive: &mut Self::Drive, _part: usize, _sense: f64) {}

    /// Readings of the kind's joints; `noise` draws a standard normal number.
    fn sample(
        &self,
        _state: &Self::State,
        _drive: &Self::Drive,
        _sensors: &SensorSuite,
        _noise: &mut dyn FnMut() -> f64,
    ) -> JointSample {
        JointSample::default()
    }

    /// Commands of the kind's motors, within their limits from now on; as many as it has actuators, all finite.
    fn command(&self, _drive: &mut Self::Drive, _command: &[f64]) {}
}
