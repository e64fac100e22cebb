//! Fast effects that the samples show by themselves.

use whorl_dynamics::effects::{Signature, catalogue};
use whorl_dynamics::{Effect, PlatformModel};

use crate::Settings;
use crate::signals::fast::Fast;
use crate::signals::observed::Observed;
use crate::signals::{imbalance, line, pulse_answers};
use crate::verdict::diagnosis::Candidate;

/// What the samples show.
#[derive(Debug, Default)]
pub(crate) struct Seen {
    pub rows: Vec<Candidate>,
    /// Wheels whose turning shows.
    pub turning: Vec<usize>,
}

impl Seen {
    /// Fast effects that the samples show about a model: an unbalanced wheel, a vibration.
    pub fn of(
        observed: &[Observed<'_>],
        model: &PlatformModel,
        settings: &Settings,
        is_tested: impl Fn(&dyn Effect) -> bool,
    ) -> Self {
        let of_run = |run| {
            let mut fast = Fast::new(run, *settings)?;
            pulse_answers::take_off(&mut fast, model);
            Some(fast)
        };
        let mut runs: Vec<Fast<'_>> = observed.iter().filter_map(of_run).collect();
        let mut seen = Self::default();
        // What turns with a wheel is taken off the samples before a line of its own is looked for.
        for effect in catalogue().iter().copied().filter(|effect| is_tested(*effect)) {
            if effect.signature() == Some(Signature::WheelTurn)
                && let Some((wheel, row)) = imbalance::imbalance(&mut runs, model, effect)
            {
                seen.turning.push(wheel);
                seen.rows.push(row);
            }
        }
        for effect in catalogue().iter().copied().filter(|effect| is_tested(*effect)) {
            if let Some(Signature::SensorLine { gyro, accelerometer, frequency, background }) =
                effect.signature()
            {
                let ([a, b, c], [d, e, f]) = (gyro, accelerometer);
                let names = line::Names { amplitude: [a, b, c, d, e, f], frequency, background };
                seen.rows.extend(line::vibration(&runs, effect, &names));
            }
        }
        seen
    }
}
