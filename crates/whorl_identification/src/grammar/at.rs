//! What a law may depend on, at one instant of a run.

use nalgebra::Vector3;
use whorl_dynamics::actuators::wheels::MAX_WHEELS;
use whorl_dynamics::{Environment, PlatformModel};
use whorl_validation::{Quantity, environment};

use crate::signals::observed::Observed;

/// Most quantities of the table.
const MOST_QUANTITIES: usize = 12 + 2 * MAX_WHEELS;
/// Time for which a valve has opened or closed just now \[s\]: what solenoid valves of a few newtons take, and a pulse has at least.
const EDGE_S: f64 = 0.02;

/// What a law may depend on.
pub(crate) struct At<'a> {
    pub environment: Environment<'a>,
    /// The quantities of the table.
    pub values: [f64; MOST_QUANTITIES],
    /// From -1 at the beginning of the run to 1 at its end.
    pub time_in_run: f64,
    /// Torque of the jets that are open, that have opened and that have closed just now, body axes [N m].
    pub jets_b_n_m: [Vector3<f64>; 3],
    /// How many are open.
    pub jets_open: f64,
}

impl<'a> At<'a> {
    /// Of an instant of a smoothed motion.
    pub fn motion(
        quantities: &[Quantity],
        run: &'a Observed<'_>,
        model: &'a PlatformModel,
        k: usize,
    ) -> Self {
        let motion = &run.motion;
        let state =
            (motion.q.get(k).copied().unwrap_or_default(), motion.omega.get(k).copied().unwrap_or_default());
        let wheels = motion.wheel.get(k).map_or(&[][..], Vec::as_slice);
        let time_s = motion.time_s.get(k).copied().unwrap_or(0.0);
        Self::new(quantities, run, environment(model, run.recording, time_s, state, wheels))
    }

    /// Of an instant of the same run, as a plant comes through it.
    pub fn new(quantities: &[Quantity], run: &Observed<'_>, environment: Environment<'a>) -> Self {
        let (motion, time_s) = (&run.motion, environment.time_s);
        let [first_s, last_s] =
            [motion.time_s.first(), motion.time_s.last()].map(|t| t.copied().unwrap_or(0.0));
        let value = |i: usize| quantities.get(i).map_or(0.0, |quantity| quantity.number(&environment));
        Self {
            values: std::array::from_fn(value),
            time_in_run: 2.0 * (time_s - first_s) / (last_s - first_s).max(1e-9) - 1.0,
            jets_b_n_m: [Vector3::zeros(); 3],
            jets_open: 0.0,
            environment,
        }
        .with_jets(run)
    }

    /// With what the commanded pulses do at this instant, behind the delays of the valves.
    fn with_jets(mut self, run: &Observed<'_>) -> Self {
        let (jets, time_s) = (self.environment.model.jets(), self.environment.time_s);
        for (jet, pulses) in jets.iter().zip(&run.recording.jet_pulses) {
            let begun = pulses.partition_point(|pulse| pulse.on_s + jet.opening_delay_s <= time_s);
            let Some(pulse) = begun.checked_sub(1).and_then(|last| pulses.get(last)) else { continue };
            let opened_s = time_s - pulse.on_s - jet.opening_delay_s;
            let closed_s = time_s - pulse.off_s - jet.closing_delay_s;
            let is_open = closed_s < 0.0;
            let phases = [is_open, is_open && opened_s < EDGE_S, (0.0..EDGE_S).contains(&closed_s)];
            for (torque_b_n_m, _) in self.jets_b_n_m.iter_mut().zip(phases).filter(|(_, is)| *is) {
                *torque_b_n_m += jet.torque_b_n_m();
            }
            self.jets_open += f64::from(u8::from(is_open));
        }
        self
    }
}
