//! Resonances that the platform's own motion drives: sloshing masses and flexible appendages.
//!
//! A lightly damped mode responds only near its own frequency, and a grid of a few frequencies misses it. Its
//! response is known except for frequency and damping: a second-order filter of the platform's angular
//! acceleration. So the residual of the gyro's readings is correlated with that response at every
//! frequency the runs resolve, in the frequency domain, where each mode touches few bins. Phase and shape of
//! the drive count, so that a mode is seen long before its line stands out of the spectrum.

use nalgebra::{Complex, Matrix3, SymmetricEigen, Vector3};
use whorl_recording::Channel;
use whorl_trajectory::spectrum::Fourier;

use crate::explanations::hypothesis::Hypothesis;
use crate::explanations::lines::{Mode, gamma_significance};
use crate::explanations::place::Place;

/// Slower resonances are told from slow torques by the regression itself \[Hz\].
const SLOWEST_HZ: f64 = 0.15;

/// Damping ratios that are tried: a boom or a liquid's free surface, and a liquid with baffles.
const DAMPING: [f64; 3] = [0.004, 0.012, 0.04];

/// Modes that are looked at, strongest first.
const MOST_MODES: usize = 3;

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

fn spectra(place: Place<'_>, of: &Hypothesis) -> Vec<Spectra> {
    let estimate = of.estimate.spread(place.design.columns.len());
    let data = place.problem.runs.iter().zip(place.problem.motions.iter()).zip(&place.data.whitened);
    data.filter(|((run, _), _)| !run.clamped && run.nodes() >= 64)
        .map(|((run, motion), whitened)| {
            let nodes = run.nodes();
            let mut left = vec![Vector3::zeros(); nodes];
            let residual = whitened.residual(&estimate);
            for ((e, reading), node) in residual.iter().zip(&whitened.reading).zip(&whitened.node) {
                if let (Channel::Gyro, Some(slot)) = (reading.channel, left.get_mut(*node as usize)) {
                    // The edge of a jet is no resonance.
                    slot[reading.index()] = e.clamp(-5.0, 5.0);
                }
            }
            let step_s = (run.time(nodes - 1) - run.time(0)) / (nodes - 1) as f64;
            // Twice the length, so that what rings on at the end does not come back at the start.
            let size = nodes.next_power_of_two() * 2;
            let fourier = Fourier::of_length(size);
            let spectrum = |series: &mut dyn Iterator<Item = f64>| {
                let mut found = fourier.transform(series);
                found.truncate(size / 2);
                found
            };
            let rate = |k: usize| motion.omega.get(k).copied().unwrap_or_default();
            Spectra {
                left: [0, 1, 2].map(|i| spectrum(&mut left.iter().map(|v| v[i]))),
                drive: [0, 1, 2].map(|i| {
                    let mut series = (0..nodes).map(|k| (rate((k + 1).min(nodes - 1)) - rate(k))[i] / step_s);
                    let mut drive = spectrum(&mut series);
                    // An interval's acceleration belongs to its middle.
                    for (m, x) in drive.iter_mut().enumerate() {
                        *x *= Complex::from_polar(1.0, -std::f64::consts::PI * m as f64 / size as f64);
                    }
                    drive
                }),
                spacing_hz: 1.0 / (size as f64 * step_s),
                length_s: step_s * nodes as f64,
            }
        })
        .collect()
}

/// Correlations of what is left with the answers of a mode, and the answers' own.
fn correlate(runs: &[Spectra], hz: f64, damping_ratio: f64) -> ([Vector3<f64>; 3], Matrix3<f64>) {
    let mut with = [Vector3::zeros(); 3];
    let mut gram = Matrix3::zeros();
    let w = std::f64::consts::TAU * hz;
    for run in runs {
        // Parseval: a sum over bins of one sign is so many times the sum over time.
        let weight = 1.0 / run.left[0].len() as f64;
        let half_hz = 12.0 * damping_ratio * hz + 3.0 / run.length_s;
        let from = ((hz - half_hz).max(0.3 * SLOWEST_HZ) / run.spacing_hz) as usize;
        let to = (((hz + half_hz) / run.spacing_hz) as usize + 1).min(run.left[0].len());
        for m in from..to {
            let s = Complex::new(0.0, std::f64::consts::TAU * m as f64 * run.spacing_hz);
            let filter = s / (s * s + s * (2.0 * damping_ratio * w) + w * w);
            let answer = [0, 1, 2].map(|j| filter * run.drive[j][m]);
            for i in 0..3 {
                for j in 0..3 {
                    with[i][j] += weight * (run.left[i][m].conj() * answer[j]).re;
                    gram[(i, j)] += weight * (answer[i].conj() * answer[j]).re;
                }
            }
        }
    }
    (with, gram)
}

/// Modes in what a hypothesis leaves, strongest first.
pub(crate) fn modes(place: Place<'_>, of: &Hypothesis) -> Vec<Mode> {
    let runs = spectra(place, of);
    let longest_s = runs.iter().map(|r| r.length_s).fold(0.0, f64::max);
    let fastest_hz = 0.3 / place.available.bin_s.max(1e-3);
    let inertia = place.problem.reference.model.mass_properties.inertia_b_kg_m2().diagonal();
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
        if significance < 0.8 * place.problem.reference.settings.certain_stddevs {
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
