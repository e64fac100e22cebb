//! The commands to the platform, and the readings of its sensors.

pub mod excitation;
pub mod measure;

pub use excitation::{Style, plan};
pub use measure::{NoiseLevels, Stated, measure};

use rand_distr::{Distribution, StandardNormal, Uniform};
use rand_pcg::Pcg64;
use sha2::{Digest, Sha256};

/// Random numbers of one purpose in one case; the same key gives the same numbers.
#[must_use]
pub fn rng(key: &str) -> Pcg64 {
    let digest = Sha256::digest(key.as_bytes());
    let mut words = [0_u64; 4];
    for (word, bytes) in words.iter_mut().zip(digest.chunks_exact(8)) {
        *word = bytes.iter().fold(0, |sum, b| (sum << 8) | u64::from(*b));
    }
    let pair = |a: u64, b: u64| (u128::from(a) << 64) | u128::from(b);
    Pcg64::new(pair(words[0], words[1]), pair(words[2], words[3]))
}

/// A number between `low` and `high`.
pub fn between(rng: &mut Pcg64, low: f64, high: f64) -> f64 {
    if high > low { Uniform::new(low, high).map_or(low, |u| u.sample(rng)) } else { low }
}

/// Either sign.
pub fn sign(rng: &mut Pcg64) -> f64 {
    if between(rng, 0.0, 1.0) < 0.5 { -1.0 } else { 1.0 }
}

/// A standard normal number.
pub fn normal(rng: &mut Pcg64) -> f64 {
    StandardNormal.sample(rng)
}

/// An index below `count`.
pub fn index(rng: &mut Pcg64, count: usize) -> usize {
    (between(rng, 0.0, count as f64) as usize).min(count.saturating_sub(1))
}
