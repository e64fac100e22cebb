//! Excitations: torques and jet pulses that are played regardless of the motion, so that a recording shows what
//! tracking a reference hides (a controller answers every disturbance, and its answer looks like the disturbance).
//!
//! Signals of several wheels at once are orthogonal over a period, so that each wheel's effect can be separated from the
//! others': harmonics dealt out in turn (Morelli, AIAA 2003-5639), the same binary sequence shifted (Godfrey,
//! Perturbation Signals for System Identification, 1993), or one wheel after the other.

use std::f64::consts::{PI, TAU};

use thiserror::Error;

/// Length of the binary sequence: the longest of a register of seven bits.
const SEQUENCE: usize = 127;
/// Share of the highest frequency at which a sweep begins.
const SWEEP_FROM: f64 = 0.1;

/// How a wheel's torque moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Waveform {
    /// Constant; the only one that may be negative. Period and highest frequency are not used.
    Constant,
    /// Harmonics of the period up to the highest frequency, in Schroeder's phases (IEEE Trans. Information Theory 16,
    /// 1970), which keep the peak low.
    Multisine,
    /// A pseudo-random binary sequence of 127 bits, each half a period of the highest frequency; the `period_s` is
    /// not used.
    Prbs,
    /// From a tenth of the highest frequency to it, in proportion to time; one wheel after the other.
    Sweep,
}

/// An invalid signal.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum SignalError {
    /// A number is not positive and finite.
    #[error("{0} must be positive")]
    NotPositive(&'static str),
    /// Fewer harmonics than wheels.
    #[error("highest_hz is below {least_hz:.3} Hz: {wheels} wheels need {wheels} harmonics of the period")]
    TooFewHarmonics {
        /// Wheels.
        wheels: usize,
        /// Least highest frequency \[Hz\].
        least_hz: f64,
    },
}

/// Torque signals of some wheels.
#[derive(Debug, Clone, PartialEq)]
pub struct Signal {
    waveform: Waveform,
    wheels: usize,
    torque_n_m: f64,
    period_s: f64,
    highest_hz: f64,
    /// Per wheel, harmonic and phase \[rad\]; and what brings its peak to one.
    harmonics: Vec<(Vec<(f64, f64)>, f64)>,
    sequence: Vec<bool>,
}

impl Signal {
    /// For `wheels` wheels, with peak `torque_n_m` each. `period_s`: of a multisine, or of one wheel's sweep.
    ///
    /// # Errors
    /// [`SignalError`].
    pub fn new(
        waveform: Waveform,
        wheels: usize,
        torque_n_m: f64,
        period_s: f64,
        highest_hz: f64,
    ) -> Result<Self, SignalError> {
        let size_n_m = if waveform == Waveform::Constant { torque_n_m.abs() } else { torque_n_m };
        for (name, value) in [("torque_n_m", size_n_m), ("period_s", period_s), ("highest_hz", highest_hz)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(SignalError::NotPositive(name));
            }
        }
        let mut harmonics = Vec::new();
        if waveform == Waveform::Multisine {
            let count = (highest_hz * period_s + 1e-9).floor() as usize;
            if count < wheels {
                return Err(SignalError::TooFewHarmonics { wheels, least_hz: wheels as f64 / period_s });
            }
            harmonics = (0..wheels).map(|wheel| own_harmonics(wheel, wheels, count)).collect();
        }
        let sequence = if waveform == Waveform::Prbs { binary_sequence() } else { Vec::new() };
        Ok(Self { waveform, wheels, torque_n_m, period_s, highest_hz, harmonics, sequence })
    }

    /// Torque of a wheel, of the signal's own list, at a time since the start \[N m\].
    #[must_use]
    pub fn torque_n_m(&self, wheel: usize, time_s: f64) -> f64 {
        let unit = match self.waveform {
            Waveform::Constant => 1.0,
            Waveform::Multisine => self.harmonics.get(wheel).map_or(0.0, |(own, scale)| {
                let angle = TAU * time_s / self.period_s;
                scale * own.iter().map(|(m, phase)| (m * angle + phase).sin()).sum::<f64>()
            }),
            Waveform::Prbs => {
                let bit = (time_s * 2.0 * self.highest_hz).max(0.0) as usize
                    + wheel * SEQUENCE / self.wheels.max(1);
                if self.sequence.get(bit % SEQUENCE).copied().unwrap_or(false) { 1.0 } else { -1.0 }
            }
            Waveform::Sweep => {
                let turn = (time_s / self.period_s).max(0.0);
                if turn as usize % self.wheels.max(1) == wheel {
                    let s = turn.fract();
                    let (from, to) = (SWEEP_FROM * self.highest_hz, self.highest_hz);
                    (TAU * self.period_s * s * (from + 0.5 * (to - from) * s)).sin()
                } else {
                    0.0
                }
            }
        };
        self.torque_n_m * unit
    }
}

/// Harmonics `wheel + 1`, `wheel + 1 + wheels`, ... up to `count`, and one over their peak.
fn own_harmonics(wheel: usize, wheels: usize, count: usize) -> (Vec<(f64, f64)>, f64) {
    let numbers: Vec<usize> = (wheel + 1..=count).step_by(wheels.max(1)).collect();
    let total = numbers.len().max(1) as f64;
    let own: Vec<(f64, f64)> = (0..)
        .zip(&numbers)
        .map(|(k, m)| (*m as f64, -PI * f64::from(k) * (f64::from(k) + 1.0) / total))
        .collect();
    let samples = 16 * count.max(1);
    let peak = (0..samples)
        .map(|i| {
            let angle = TAU * i as f64 / samples as f64;
            own.iter().map(|(m, phase)| (m * angle + phase).sin()).sum::<f64>().abs()
        })
        .fold(0.0, f64::max);
    (own, if peak > 0.0 { 1.0 / peak } else { 0.0 })
}

/// Of the register x^7 + x^6 + 1, which is primitive: every state but zero appears once.
fn binary_sequence() -> Vec<bool> {
    let mut register = 0x7f_u8;
    (0..SEQUENCE)
        .map(|_| {
            let bit = (register >> 6 ^ register >> 5) & 1;
            register = (register << 1 | bit) & 0x7f;
            bit == 1
        })
        .collect()
}

/// Pulses of one jet after the other, at equal intervals: all jets with the first on-time, then with the next.
#[derive(Debug, Clone, PartialEq)]
pub struct PulseTrain {
    /// Indices of the jets, in the order in which they fire.
    pub jets: Vec<usize>,
    /// On-times \[s\].
    pub on_time_s: Vec<f64>,
    /// From pulse to pulse \[s\], > 0.
    pub every_s: f64,
}

impl PulseTrain {
    /// The number of the latest pulse that is due at this time since the start, its jet and its on-time \[s\].
    #[must_use]
    pub fn due(&self, time_s: f64) -> Option<(u64, usize, f64)> {
        let number =
            if time_s >= 0.0 && self.every_s > 0.0 { (time_s / self.every_s) as u64 } else { return None };
        let count = self.jets.len() as u64;
        let jet = *self.jets.get(usize::try_from(number.checked_rem(count)?).ok()?)?;
        let length = (number / count).checked_rem(self.on_time_s.len() as u64)?;
        Some((number, jet, *self.on_time_s.get(usize::try_from(length).ok()?)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples(signal: &Signal, wheel: usize, length_s: f64) -> Vec<f64> {
        (0..4000).map(|i| signal.torque_n_m(wheel, length_s * f64::from(i) / 4000.0)).collect()
    }

    fn product(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / a.len() as f64
    }

    #[test]
    fn multisines_are_orthogonal_have_no_mean_and_reach_their_peak() {
        let signal = Signal::new(Waveform::Multisine, 3, 0.2, 20.0, 1.0).unwrap();
        let all: Vec<Vec<f64>> = (0..3).map(|w| samples(&signal, w, 20.0)).collect();
        for (k, own) in all.iter().enumerate() {
            let peak = own.iter().fold(0.0_f64, |p, x| p.max(x.abs()));
            assert!((peak - 0.2).abs() < 0.004, "{peak}");
            assert!(product(own, &vec![1.0; own.len()]).abs() < 1e-9);
            for other in &all[k + 1..] {
                assert!(product(own, other).abs() < 1e-9);
            }
        }
        // A fraction of the energy at 0.45 Hz, harmonic 9, belongs to the third wheel alone.
        let sine: Vec<f64> =
            (0..4000).map(|i| (TAU * 9.0 * f64::from(i) / 4000.0 - PI / 3.0).sin()).collect();
        assert!(product(&all[0], &sine).abs() < 1e-9 && product(&all[2], &sine).abs() > 1e-3);
    }

    /// A sequence of greatest length has 64 ones, and its product with itself shifted is -1/127.
    #[test]
    fn the_binary_sequence_is_of_greatest_length() {
        let bits: Vec<f64> = binary_sequence().iter().map(|b| if *b { 1.0 } else { -1.0 }).collect();
        assert_eq!(bits.iter().sum::<f64>(), 1.0);
        for shift in 1..SEQUENCE {
            let shifted: Vec<f64> = (0..SEQUENCE).map(|k| bits[(k + shift) % SEQUENCE]).collect();
            assert!((product(&bits, &shifted) + 1.0 / 127.0).abs() < 1e-12, "{shift}");
        }
        // Half a period of 0.5 Hz lasts a second.
        let signal = Signal::new(Waveform::Prbs, 1, 0.1, 1.0, 0.5).unwrap();
        assert_eq!(signal.torque_n_m(0, 3.01), signal.torque_n_m(0, 3.99));
        assert_eq!(signal.torque_n_m(0, 3.5), 0.1 * bits[3]);
    }

    #[test]
    fn a_sweep_takes_one_wheel_after_the_other_and_ends_at_the_highest_frequency() {
        let signal = Signal::new(Waveform::Sweep, 2, 0.3, 30.0, 1.0).unwrap();
        assert!(samples(&signal, 1, 29.9).iter().all(|x| *x == 0.0));
        assert!(samples(&signal, 0, 29.9).iter().any(|x| *x > 0.29));
        assert!((0..100).all(|i| signal.torque_n_m(0, 30.01 + 0.29 * f64::from(i)) == 0.0));
        // Zero crossings: half cycles are twice the mean frequency, 0.55 Hz, times 30 s.
        let own = samples(&signal, 0, 30.0);
        let crossings = own.windows(2).filter(|w| w[0] * w[1] < 0.0).count();
        assert!((32..=33).contains(&crossings), "{crossings}");
    }

    #[test]
    fn pulses_go_through_jets_and_then_through_lengths() {
        let train = PulseTrain { jets: vec![4, 7], on_time_s: vec![0.03, 0.09], every_s: 1.5 };
        let pulses: Vec<_> = (0..5).map(|k| train.due(1.5 * f64::from(k) + 0.01).unwrap()).collect();
        assert_eq!(pulses, [(0, 4, 0.03), (1, 7, 0.03), (2, 4, 0.09), (3, 7, 0.09), (4, 4, 0.03)]);
        assert_eq!(train.due(2.9), Some((1, 7, 0.03)));
        assert_eq!(train.due(-0.1), None);
        assert_eq!(PulseTrain { jets: vec![], ..train }.due(1.0), None);
    }

    #[test]
    fn a_signal_that_cannot_be_is_refused() {
        let new = |torque, period, highest| Signal::new(Waveform::Multisine, 3, torque, period, highest);
        assert_eq!(new(0.0, 10.0, 1.0), Err(SignalError::NotPositive("torque_n_m")));
        assert_eq!(new(0.1, f64::NAN, 1.0), Err(SignalError::NotPositive("period_s")));
        assert!(new(0.1, 10.0, 0.2).unwrap_err().to_string().contains("0.300 Hz"));
    }
}
