//! Resonances that the platform's own motion drives: sloshing masses and flexible appendages.
//!
//! A lightly damped mode responds only near its own frequency, and a grid of a few frequencies misses it. Its
//! response is known except for frequency and damping: a second-order filter of the platform's angular
//! acceleration. So the residual of the gyro's readings is correlated with that response at every
//! frequency the runs resolve, in the frequency domain, where each mode touches few bins. Phase and shape of
//! the drive count, so that a mode is seen long before its line stands out of the spectrum.

use nalgebra::{Complex, Matrix3, SymmetricEigen, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_math::noise::typical_step_s;
use whorl_math::spectrum::Fourier;
use whorl_math::statistics::median;

use crate::Settings;
use crate::signals::observed::Observed;
use crate::signals::spectrum::gamma_significance;

/// A resonance that the motion drives.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Mode {
    pub hz: f64,
    pub damping_ratio: f64,
    /// Body axis that drives it and that it turns.
    pub axis_b: Vector3<f64>,
    /// Standard deviations by which it stands out.
    pub significance: f64,
}

/// Slower resonances are told from slow torques by the regression itself \[Hz\].
const SLOWEST_HZ: f64 = 0.15;

/// Damping ratios that are tried: a boom or a liquid's free surface, and a liquid with baffles.
const DAMPING: [f64; 3] = [0.004, 0.012, 0.04];

/// Modes that are looked at, strongest first.
const MOST_MODES: usize = 3;

/// Bins to each side of a band whose median is the noise there.
const BESIDE: usize = 40;

/// Spectra of one run.
struct Spectra {
    /// What is left of the rate about each body axis, in standard deviations.
    left: [Vec<Complex<f64>>; 3],
    /// Angular acceleration about each body axis.
    drive: [Vec<Complex<f64>>; 3],
    /// Between bins \[Hz\].
    spacing_hz: f64,
    length_s: f64,
}

/// Of what runs leave where they go without a random torque: a filter that has one follows slow swings.
fn spectra(observed: &[Observed<'_>]) -> Vec<Spectra> {
    let free =
        observed.iter().filter(|run| !run.clamped && run.loud.len() >= 64 && run.motion.time_s.len() >= 64);
    free.map(|run| {
        let (grid, motion) = (run.grid(true), &run.motion);
        let (count, step_s) = (grid.len(), grid.step_s);
        // Twice the length, so that what rings on at the end does not come back at the start.
        let size = count.next_power_of_two() * 2;
        let fourier = Fourier::of_length(size);
        let spectrum = |series: &mut dyn Iterator<Item = f64>| {
            let mut found = fourier.transform(series);
            found.truncate(size / 2);
            found
        };
        let rate = |time_s: f64| {
            let k = motion.index(time_s);
            let at = |k: usize| motion.omega.get(k).copied().unwrap_or_default();
            match (motion.time_s.get(k), motion.time_s.get(k + 1)) {
                (Some(from_s), Some(to_s)) => {
                    at(k).lerp(&at(k + 1), ((time_s - from_s) / (to_s - from_s)).clamp(0.0, 1.0))
                }
                _ => at(k),
            }
        };
        let rates: Vec<Vector3<f64>> = (0..=count).map(|k| rate(grid.time(k))).collect();
        Spectra {
            left: [0, 1, 2].map(|i| spectrum(&mut grid.inertial[i].iter().copied())),
            drive: [0, 1, 2].map(|i| {
                let mut series = rates.windows(2).map(|pair| (pair[1] - pair[0])[i] / step_s);
                let mut drive = spectrum(&mut series);
                // An interval's acceleration belongs to its middle.
                for (m, x) in drive.iter_mut().enumerate() {
                    *x *= Complex::from_polar(1.0, -std::f64::consts::PI * m as f64 / size as f64);
                }
                drive
            }),
            spacing_hz: 1.0 / (size as f64 * step_s),
            length_s: step_s * count as f64,
        }
    })
    .collect()
}

impl Spectra {
    /// Bins of a band.
    fn band(&self, hz: f64, damping_ratio: f64) -> (usize, usize) {
        let half_hz = 12.0 * damping_ratio * hz + 3.0 / self.length_s;
        let from = ((hz - half_hz).max(0.3 * SLOWEST_HZ) / self.spacing_hz) as usize;
        let to = (((hz + half_hz) / self.spacing_hz) as usize + 1).min(self.left[0].len());
        (from.min(to), to)
    }

    /// Power of what is left beside a band about each axis, over that of white noise; 1 at least.
    fn levels(&self, from: usize, to: usize) -> [f64; 3] {
        let (low, high) = (from.saturating_sub(BESIDE), (to + BESIDE).min(self.left[0].len()));
        // Of white noise each bin has an exponential power whose median is that share of its mean.
        let samples = (self.length_s * self.spacing_hz * 2.0 * self.left[0].len() as f64).max(1.0);
        [0, 1, 2].map(|i| {
            let powers = self.left[i][low..high].iter().map(Complex::norm_sqr);
            (median(powers) / (std::f64::consts::LN_2 * samples)).max(1.0)
        })
    }
}

/// Correlations of what is left with the answers of a mode, and the answers' own.
fn correlate(runs: &[Spectra], hz: f64, damping_ratio: f64) -> ([Vector3<f64>; 3], Matrix3<f64>) {
    let mut with = [Vector3::zeros(); 3];
    let mut gram = Matrix3::zeros();
    let w = std::f64::consts::TAU * hz;
    for run in runs {
        // Parseval: a sum over bins of one sign is so many times the sum over time.
        let weight = 1.0 / run.left[0].len() as f64;
        let (from, to) = run.band(hz, damping_ratio);
        let levels = run.levels(from, to);
        for m in from..to {
            let s = Complex::new(0.0, std::f64::consts::TAU * m as f64 * run.spacing_hz);
            let filter = s / (s * s + s * (2.0 * damping_ratio * w) + w * w);
            let answer = [0, 1, 2].map(|j| filter * run.drive[j][m]);
            for i in 0..3 {
                for j in 0..3 {
                    with[i][j] += weight * (run.left[i][m].conj() * answer[j]).re / levels[i].sqrt();
                    gram[(i, j)] += weight * (answer[i].conj() * answer[j]).re;
                }
            }
        }
    }
    (with, gram)
}

/// Modes in what a hypothesis leaves, strongest first.
pub(crate) fn modes(observed: &[Observed<'_>], model: &PlatformModel, settings: &Settings) -> Vec<Mode> {
    let runs = spectra(observed);
    let longest_s = runs.iter().map(|r| r.length_s).fold(0.0, f64::max);
    let step_s = observed.iter().map(|run| typical_step_s(&run.motion.time_s)).fold(1e-3, f64::max);
    let fastest_hz = 0.3 / step_s;
    let inertia = model.mass_properties.inertia_b_kg_m2().diagonal();
    let mut found: Vec<Mode> = Vec::new();
    let mut here: Vec<(f64, f64)> = Vec::new();
    for damping_ratio in DAMPING.into_iter().filter(|_| longest_s > 0.0) {
        let mut hz = SLOWEST_HZ;
        while hz < fastest_hz {
            here.push((hz, damping_ratio));
            hz += (0.3 / longest_s).max(0.7 * damping_ratio * hz);
        }
    }
    for (hz, damping_ratio) in here {
        let (with, gram) = correlate(&runs, hz, damping_ratio);
        let Some(inverse) = gram.try_inverse() else { continue };
        let explained: f64 = with.iter().map(|c| c.dot(&(inverse * c))).sum();
        // Nine correlations of noise alone: half their squares are the sum of 4.5 exponential variates.
        let significance = gamma_significance(0.5 * explained, 4.5);
        if significance < 0.8 * settings.certain_stddevs {
            continue;
        }
        // Torque about i for acceleration about j is d_i d_j.
        let mut product = Matrix3::zeros();
        for i in 0..3 {
            let coupling = inverse * with[i] * inertia[i];
            for j in 0..3 {
                product[(i, j)] += 0.5 * coupling[j];
                product[(j, i)] += 0.5 * coupling[j];
            }
        }
        let eigen = SymmetricEigen::new(product);
        let axis_b = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
        found.push(Mode { hz, damping_ratio, axis_b, significance });
    }
    found.sort_by(|a, b| b.significance.total_cmp(&a.significance));
    let mut chosen: Vec<Mode> = Vec::new();
    for mode in found {
        let is_near = |c: &Mode| (c.hz - mode.hz).abs() < 0.08 * mode.hz.max(c.hz);
        if chosen.len() < MOST_MODES && !chosen.iter().any(is_near) {
            chosen.push(mode);
        }
    }
    chosen
}
