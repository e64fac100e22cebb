//! From on-time fractions to valve pulses: a vector sigma-delta modulator.
//!
//! A valve cannot open for less than its minimum on-time, so an on-time below it becomes zero or
//! the minimum. The difference is carried as one vector, the impulse error
//! e [N m s], into the next slot's demand *before* allocation:
//!
//! tau' = tau + e / T,   u = allocate(tau'),   on = round(u T),   e <- T B u - B on.
//!
//! The sum of all impulses delivered then differs from the sum of all allocated by e alone, which is
//! bounded by the rounding of one slot: first-order noise shaping (Candy and Temes, *Oversampling
//! Delta-Sigma Data Converters*, 1992), here in three dimensions, so that any combination of jets may make up
//! the shortfall of another. Remainders kept per jet cannot do that.
//!
//! **Anti-windup.** Only what was allocated counts: the part of a demand that is out of reach is
//! never carried. The error is also clipped to [`ERROR_LIMIT_BITS`] minimum impulse bits, which
//! matters when jets turn out not to have fired ([`PulseModulator::record_driven`]).
//!
//! **Rounding rule.** On-times from the minimum to the slot length are fired as they are. Of the jets
//! below their minimum, the one whose shortest pulse lies best along the error fires at its minimum
//! when that pulse would undo at least [`FIRING_SHARE`] of itself (b'e >= 0.7 |b|^2 `min_on`); then the
//! next, until none qualifies. The rest stay shut and their share is carried. Firing at one half would
//! keep the error smallest but overshoots, and undoing an overshoot costs gas: with twelve canted
//! jets and demands of 0.5 % to 20 % of full torque 0.7 keeps the cumulative error under one minimum
//! impulse bit at 1.00 to 1.03 times the least gas, 0.5 doubles the gas of the smallest demands, and
//! 1.0 lets the error reach 1.4 bits. Jets that were allocated nothing never fire.

use nalgebra::{Matrix3xX, Vector3};

use crate::effectors::Effectors;
use crate::list::{ListError, check_list};

/// Longest impulse error carried, in minimum impulse bits.
pub const ERROR_LIMIT_BITS: f64 = 4.0;

/// Share of a shortest pulse that the error must hold before the pulse is fired.
pub const FIRING_SHARE: f64 = 0.7;

/// The state of the modulator.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PulseState {
    /// Impulse owed to the body, body axes [N m s].
    pub impulse_error_b_n_m_s: [f64; 3],
}

/// Turns on-time fractions into pulses, slot by slot.
#[derive(Debug, Clone, PartialEq)]
pub struct PulseModulator {
    jet_torque_b_n_m: Matrix3xX<f64>,
    min_on_time_s: Vec<f64>,
    slot_s: f64,
    min_impulse_bit_n_m_s: f64,
    impulse_error_b_n_m_s: Vector3<f64>,
}

/// The pulses of one slot.
#[derive(Debug, Clone, PartialEq)]
pub struct Pulses {
    /// On-time of each jet \[s\]: 0, or from its minimum to the slot length.
    pub on_time_s: Vec<f64>,
    /// Angular impulse of these pulses on the body, body axes [N m s].
    pub impulse_b_n_m_s: Vector3<f64>,
}

/// Why a modulator or its input is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PulseError {
    /// The slot length is not finite and positive.
    #[error("slot of {0} s: must be finite and > 0")]
    Slot(f64),
    /// A list does not fit.
    #[error(transparent)]
    List(#[from] ListError),
}

impl PulseModulator {
    /// A modulator with no error carried. `min_on_time_s` \[s\] per jet, 0..=`slot_s`.
    ///
    /// # Errors
    /// [`PulseError`] naming what is wrong.
    pub fn new(effectors: &Effectors, min_on_time_s: Vec<f64>, slot_s: f64) -> Result<Self, PulseError> {
        if !(slot_s.is_finite() && slot_s > 0.0) {
            return Err(PulseError::Slot(slot_s));
        }
        let jet_torque_b_n_m = effectors.layout().jet_torque_b_n_m.clone();
        let range = |value: f64| (0.0..=slot_s).contains(&value);
        check_list("min_on_time_s", &min_on_time_s, effectors.jets(), range, "0..=slot")?;
        let min_impulse_bit_n_m_s = jet_torque_b_n_m
            .column_iter()
            .zip(&min_on_time_s)
            .map(|(torque, on)| torque.norm() * on)
            .fold(0.0, f64::max);
        Ok(Self {
            jet_torque_b_n_m,
            min_on_time_s,
            slot_s,
            min_impulse_bit_n_m_s,
            impulse_error_b_n_m_s: Vector3::zeros(),
        })
    }

    /// Slot length \[s\].
    #[must_use]
    pub fn slot_s(&self) -> f64 {
        self.slot_s
    }

    /// Angular impulse of the strongest jet's shortest pulse [N m s].
    #[must_use]
    pub fn min_impulse_bit_n_m_s(&self) -> f64 {
        self.min_impulse_bit_n_m_s
    }

    /// The torque to allocate in this slot so that the carried error is made good [N m].
    #[must_use]
    pub fn compensated_torque_b_n_m(&self, torque_b_n_m: Vector3<f64>) -> Vector3<f64> {
        torque_b_n_m + self.impulse_error_b_n_m_s / self.slot_s
    }

    /// Pulses for the fractions that were allocated, and the error to carry on.
    ///
    /// # Errors
    /// [`PulseError`] when a fraction is missing or outside 0..=1; nothing is then carried or
    /// fired, and the state is as before.
    pub fn modulate(&mut self, jet_on_fraction: &[f64]) -> Result<Pulses, PulseError> {
        let unit = |value: f64| (0.0..=1.0).contains(&value);
        check_list("jet_on_fraction", jet_on_fraction, self.min_on_time_s.len(), unit, "0..=1")?;
        let wanted: Vec<f64> = jet_on_fraction.iter().map(|u| u * self.slot_s).collect();
        let mut on_time_s = wanted.clone();
        let mut waiting = Vec::new();
        for (j, on) in on_time_s.iter_mut().enumerate() {
            let min = self.min_on_time_s[j];
            if *on > 0.0 && *on < min {
                *on = 0.0;
                // A fraction within the rounding of the solver counts as zero.
                if wanted[j] > 1e-6 * min {
                    waiting.push(j);
                }
            }
        }
        let mut error = self.impulse(&wanted) - self.impulse(&on_time_s);
        loop {
            // How much of the error the shortest pulse of each jet would undo.
            let share = |&jet: &usize| {
                let bit = self.jet_torque_b_n_m.column(jet) * self.min_on_time_s[jet];
                (jet, bit.dot(&error) / bit.norm_squared().max(f64::MIN_POSITIVE))
            };
            let best = waiting.iter().map(share).max_by(|a, b| a.1.total_cmp(&b.1));
            let Some((jet, _)) = best.filter(|(_, share)| *share >= FIRING_SHARE) else {
                break;
            };
            on_time_s[jet] = self.min_on_time_s[jet];
            error -= self.jet_torque_b_n_m.column(jet) * self.min_on_time_s[jet];
            waiting.retain(|&other| other != jet);
        }
        self.carry(error);
        let impulse_b_n_m_s = self.impulse(&on_time_s);
        Ok(Pulses { on_time_s, impulse_b_n_m_s })
    }

    /// Corrects the carried error with what the valves report: commanded and driven on-times of
    /// the same slot \[s\]. Leave out jets that are known to have failed by passing the commanded
    /// value, when the allocation already does without them.
    ///
    /// # Errors
    /// [`PulseError`] when a list has the wrong length or a number is not finite.
    pub fn record_driven(&mut self, commanded_on_s: &[f64], driven_on_s: &[f64]) -> Result<(), PulseError> {
        let jets = self.min_on_time_s.len();
        check_list("commanded_on_s", commanded_on_s, jets, f64::is_finite, "finite")?;
        check_list("driven_on_s", driven_on_s, jets, f64::is_finite, "finite")?;
        let missing = self.impulse(commanded_on_s) - self.impulse(driven_on_s);
        self.carry(self.impulse_error_b_n_m_s + missing);
        Ok(())
    }

    /// Forgets the carried error: after a pause, a mode change or a new experiment.
    pub fn reset(&mut self) {
        self.impulse_error_b_n_m_s = Vector3::zeros();
    }

    /// The state, to be stored.
    #[must_use]
    pub fn state(&self) -> PulseState {
        PulseState { impulse_error_b_n_m_s: self.impulse_error_b_n_m_s.into() }
    }

    /// Continues from a stored state.
    ///
    /// # Errors
    /// [`ListError::Value`] when a component is not finite; the state is then as before.
    pub fn restore(&mut self, state: PulseState) -> Result<(), PulseError> {
        let error = state.impulse_error_b_n_m_s;
        check_list("impulse_error_b_n_m_s", &error, 3, f64::is_finite, "finite")?;
        self.carry(error.into());
        Ok(())
    }

    fn carry(&mut self, error: Vector3<f64>) {
        let limit = ERROR_LIMIT_BITS * self.min_impulse_bit_n_m_s;
        let norm = error.norm();
        self.impulse_error_b_n_m_s = if norm > limit { error * (limit / norm) } else { error };
    }

    fn impulse(&self, on_time_s: &[f64]) -> Vector3<f64> {
        self.jet_torque_b_n_m
            .column_iter()
            .zip(on_time_s)
            .fold(Vector3::zeros(), |sum, (torque, &on)| sum + torque * on)
    }
}
