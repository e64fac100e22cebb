//! RMS of the torques applied to platform and wheels.

use crate::bins::motion::Motion;
use crate::bins::run::Run;

/// Root mean square of the applied torques.
#[derive(Debug, Clone, Default)]
pub(crate) struct Torques {
    /// On the body [N m].
    pub body_n_m: f64,
    /// On each wheel [N m].
    pub wheel_n_m: Vec<f64>,
}

impl Torques {
    /// Rates are compared over `interval_s`, one interval at least.
    pub fn of(
        runs: &[Run],
        motions: &[Motion],
        model: &whorl_dynamics::PlatformModel,
        interval_s: f64,
    ) -> Self {
        let inertia = model.mass_properties.inertia_b_kg_m2();
        let (mut body, mut count) = (0.0, 0.0);
        let mut wheel = vec![0.0; model.wheels().len()];
        for (run, motion) in runs.iter().zip(motions) {
            let apart = ((interval_s / run.node_s().max(1e-9)).round() as usize).max(1);
            for k in (apart..run.nodes()).step_by(apart) {
                let time_s = (run.time(k) - run.time(k - apart)).max(1e-9);
                if let (Some(before), Some(after)) = (motion.omega.get(k - apart), motion.omega.get(k)) {
                    body += (inertia * (after - before) / time_s).norm_squared();
                }
                if let (Some(before), Some(after)) = (motion.wheel.get(k - apart), motion.wheel.get(k)) {
                    for ((slot, w), (a, b)) in
                        wheel.iter_mut().zip(model.wheels()).zip(after.iter().zip(before))
                    {
                        *slot += (w.spin_inertia_kg_m2 * (a - b) / time_s).powi(2);
                    }
                }
                count += 1.0;
            }
        }
        let rms = |square: f64| (square / f64::max(count, 1.0)).sqrt().max(f64::MIN_POSITIVE);
        Self { body_n_m: rms(body), wheel_n_m: wheel.into_iter().map(rms).collect() }
    }
}
