//! Fast effects that the samples show by themselves: unbalanced wheels, vibration of the sensors.

use std::f64::consts::TAU;
use std::ops::Range;

use nalgebra::{Complex, Matrix2, Matrix3, Vector2, Vector3, Vector6};
use whorl_dynamics::effects::{Part, Signature, catalogue};
use whorl_dynamics::{Effect, Gyrostat, PlatformModel};
use whorl_math::spectrum::{Gridded, common_motion, peaks, surprise_of_motion};
use whorl_math::unit_or;

use crate::Settings;
use crate::signals::fast::Fast;
use crate::signals::observed::Observed;
use crate::verdict::diagnosis::{Candidate, ParameterEstimate};

/// Cycles a turn at which no imbalance is: what is there is noise.
const BESIDE: [f64; 4] = [0.79, 0.9, 1.11, 1.23];
/// Samples with valves open in which a vibration is looked for.
const FEWEST_OPEN: f64 = 30.0;

#[derive(Debug, Default)]
pub(crate) struct Seen {
    pub rows: Vec<Candidate>,
    /// Wheels whose turning shows.
    pub turning: Vec<usize>,
}

impl Seen {
    pub fn of(
        runs: &[Observed<'_>],
        model: &PlatformModel,
        settings: &Settings,
        is_tested: impl Fn(&dyn Effect) -> bool,
    ) -> Self {
        let mut runs: Vec<Fast<'_>> = runs.iter().filter_map(|run| Fast::new(run, model, settings)).collect();
        let is_tested = &is_tested;
        let tested = || catalogue().iter().copied().filter(move |effect| is_tested(*effect));
        // What turns with a wheel is taken off the samples before a line of its own is looked for.
        let of_wheels = tested().filter(|effect| effect.signature() == Some(Signature::WheelTurn));
        let (turning, mut rows): (Vec<usize>, Vec<Candidate>) =
            of_wheels.filter_map(|effect| imbalance(&mut runs, model, effect, settings)).unzip();
        rows.extend(tested().filter_map(|effect| vibration(&runs, effect, settings)));
        Self { rows, turning }
    }
}

/// What a run holds of one frequency, in units of its noise: both phases of each channel, and how much one phase weighs.
fn held(fast: &Fast<'_>, gate: &[f64], hz: f64) -> (Vector6<Complex<f64>>, Vector6<f64>) {
    let grid = fast.grid;
    let mut sums = Vector6::from_element(Complex::new(0.0, 0.0));
    let mut weights = Vector6::zeros();
    let step = Complex::from_polar(1.0, TAU * hz * grid.step_s);
    let mut wave = Complex::from_polar(1.0, TAU * hz * grid.start_s);
    for (index, g) in gate.iter().enumerate() {
        for c in (0..6).filter(|_| *g > 0.0) {
            sums[c] += wave * fast.channel[c][index];
            weights[c] += 0.5 * f64::from(u8::from(grid.there[c / 3][index]));
        }
        wave *= step;
    }
    (sums.zip_map(&weights, |sum: Complex<f64>, weight: f64| sum / (2.0 * weight).max(1.0).sqrt()), weights)
}

/// A line in gyro and accelerometer, always or only while valves are open.
fn vibration(runs: &[Fast<'_>], effect: &dyn Effect, settings: &Settings) -> Option<Candidate> {
    let Signature::SensorLine { gyro, accelerometer, frequency, background } = effect.signature()? else {
        return None;
    };
    let first = runs.first()?.grid;
    let (mut best, mut most) = (None, f64::NEG_INFINITY);
    for share in [1.0, 0.0] {
        let gate = |fast: &Fast<'_>| if share > 0.0 { vec![1.0; fast.grid.len()] } else { fast.valves() };
        let gates: Vec<Vec<f64>> = runs.iter().map(gate).collect();
        let gated = |(fast, gate): (&Fast<'_>, &Vec<f64>)| Gridded {
            series: fast.channel.iter().map(|c| c.iter().zip(gate).map(|(x, g)| x * g).collect()).collect(),
            variance: gate.iter().zip(&fast.grid.there[0]).filter(|(_, there)| **there).map(|(g, _)| g).sum(),
            stretch: fast.grid.step_s / first.step_s,
        };
        let mut parts: Vec<Gridded> = runs.iter().zip(&gates).map(gated).collect();
        parts.retain(|part| part.variance >= FEWEST_OPEN);
        let length = runs.iter().map(|fast| fast.grid.len()).max()?;
        let spacing_hz = 0.5 / (length.next_power_of_two() as f64 * first.step_s);
        for peak in peaks(&parts, first.step_s, settings.slowest_vibration_hz) {
            // The best frequency near the peak.
            for hz in (-4..=4).map(|i| peak.frequency + 0.25 * f64::from(i) * spacing_hz) {
                let (held, weights): (Vec<_>, Vec<_>) =
                    runs.iter().zip(&gates).map(|(fast, gate)| held(fast, gate, hz)).unzip();
                let (power, phases) = common_motion(&held);
                let surprise = surprise_of_motion(power / peak.level, runs.len());
                if surprise > most {
                    (most, best) = (surprise, Some((power / peak.level, hz, share, held, weights, phases)));
                }
            }
        }
    }
    let (power, hz, share, held, weights, phases) = best?;
    // Each of the frequencies, with valves open and always, might have been it.
    let evidence = most - (first.len() as f64).ln();
    let drop = 2.0 * (power - (5 + runs.len()) as f64);
    if evidence < settings.window_nats || drop < settings.clear_misfit {
        return None;
    }
    let mut parameters: Vec<ParameterEstimate> = Vec::new();
    for (c, name) in gyro.into_iter().chain(accelerometer).enumerate() {
        // The runs' readings turned to one phase.
        let turned = held.iter().zip(&weights).zip(&phases).map(|((held, weight), phase)| {
            held[c] * (phase.conj() / phase.norm().max(f64::MIN_POSITIVE)) * (2.0 * weight[c]).sqrt()
        });
        let sum: Complex<f64> = turned.sum();
        let information: f64 = weights.iter().map(|weight| weight[c]).sum();
        if information > 0.0 {
            let (unit, stddev) = (if c < 3 { "rad/s" } else { "m/s^2" }, runs.first()?.stddev(c));
            let amplitude = sum.norm() / information * stddev;
            parameters.push(ParameterEstimate::new(name, unit, amplitude, stddev / information.sqrt()));
        }
    }
    let length_s = first.len() as f64 * first.step_s;
    parameters.push(ParameterEstimate::new(frequency, "Hz", hz, 0.1 / length_s));
    parameters.push(ParameterEstimate::new(background, "1", share, 0.5));
    Some(Candidate::seen(effect.info().id, drop, evidence, parameters))
}

/// Both phases of a wheel's imbalance over one stretch.
pub(super) struct Fit {
    pub drop: f64,
    /// Inverse variance of one amplitude.
    pub information: f64,
    /// What it explains of each axis of the gyro.
    pub explained: [Vec<f64>; 3],
}

/// The wheel whose turning shows in the gyro, and the row that says so; what it explains is taken off the samples.
fn imbalance(
    runs: &mut [Fast<'_>],
    model: &PlatformModel,
    effect: &dyn Effect,
    settings: &Settings,
) -> Option<(usize, Candidate)> {
    let wheels = model.wheels().len();
    let of_run = |(run, fast): (usize, &Fast<'_>)| stretches(fast, settings).map(move |part| (run, part));
    let parts: Vec<(usize, Range<usize>)> = runs.iter().enumerate().flat_map(of_run).collect();
    let all_fits = |wheel: usize, order: f64| -> Vec<Fit> {
        parts.iter().map(|(run, part)| Fit::of(&runs[*run], model, wheel, order, part.clone())).collect()
    };
    let found = (0..wheels).filter_map(|wheel| {
        let mut fits = all_fits(wheel, 1.0);
        if one_size(&fits)?.0 > settings.window_nats {
            // The same test at an order that no imbalance has measures how much louder the noise is here than at high frequencies.
            let off: Vec<f64> = BESIDE.iter().flat_map(|n| all_fits(wheel, *n)).map(|f| f.drop).collect();
            let level = (0.5 * off.iter().sum::<f64>() / off.len().max(1) as f64).max(1.0);
            for fit in &mut fits {
                fit.drop /= level;
                fit.information /= level;
            }
        }
        let (evidence, size) = one_size(&fits)?;
        Some((evidence - (wheels as f64).ln(), size, wheel, fits))
    });
    let (evidence, size, wheel, fits) = found.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let drop = fits.iter().map(|f| f.drop - 2.0).sum::<f64>();
    if evidence < settings.window_nats || drop < settings.clear_misfit {
        return None;
    }
    for ((run, part), fit) in parts.iter().zip(&fits) {
        for (channel, explained) in runs[*run].channel.iter_mut().zip(&fit.explained) {
            channel[part.start..].iter_mut().zip(explained).for_each(|(slot, explained)| *slot -= explained);
        }
    }
    let information: f64 = fits.iter().map(|f| f.information).sum();
    let spec = effect.parameters(model).into_iter().find(|s| s.part == Part::Wheel(wheel))?;
    let estimate = ParameterEstimate::new(spec.name, spec.unit, size, (1.0 / information).sqrt());
    Some((wheel, Candidate::seen(effect.info().id, drop, evidence, vec![estimate])))
}

/// Log evidence and likeliest size of an imbalance that is the same in all stretches, its phase in each unknown: both phases of each are
/// normal about none with the variance that this size gives.
pub(super) fn one_size(fits: &[Fit]) -> Option<(f64, f64)> {
    let sum = |of: fn(&Fit) -> f64| fits.iter().map(of).sum::<f64>();
    let (information, excess) = (sum(|f| f.information), sum(|f| f.drop - 2.0));
    let square = excess.max(0.0) / information;
    let gain = |f: &Fit| {
        let variance = 0.5 * square * f.information;
        0.5 * f.drop * variance / (1.0 + variance) - (1.0 + variance).ln()
    };
    (information > 0.0).then(|| (fits.iter().map(gain).sum(), square.sqrt()))
}

/// Parts of a run for which the angles of wheels stay good, each from a sample on to before another.
fn stretches(fast: &Fast<'_>, settings: &Settings) -> impl Iterator<Item = Range<usize>> + use<> {
    let (all, length) = (fast.grid.len(), (settings.wheel_angle_s / fast.grid.step_s) as usize);
    let count = (all as f64 / length.max(1) as f64).round().max(1.0) as usize;
    (0..count).map(move |i| i * all / count..(i + 1) * all / count)
}

impl Fit {
    /// To a part of a run; felt `order` times a turn.
    fn of(fast: &Fast<'_>, model: &PlatformModel, wheel: usize, order: f64, part: Range<usize>) -> Self {
        let axis = model.wheels().get(wheel).map_or(Vector3::z_axis(), |w| w.spin_axis_b);
        let helper = if axis.z.abs() > 0.7 { Vector3::x() } else { Vector3::z() };
        let e1 = unit_or(axis.cross(&helper), Vector3::x_axis()).into_inner();
        let inverse = Gyrostat::new(model)
            .map_or_else(|_| Matrix3::zeros(), |of| *of.rate_equation().inverse_resisting());
        let (u1, u2) = (inverse * e1, inverse * axis.cross(&e1));
        // What 1 kg m^2 adds at two phases a quarter turn apart. The rate is the torque's integral: Om^2 becomes Om, a quarter turn later.
        let turned = |index: usize| {
            let (speed, angle) = fast.run.motion.wheel_at(wheel, fast.grid.time(index));
            let (s, c) = (order * angle).sin_cos();
            [(u1 * s - u2 * c) * speed, (u1 * c + u2 * s) * speed]
        };
        let turned: Vec<[Vector3<f64>; 2]> = part.clone().map(turned).collect();
        let signals: [[Vec<f64>; 2]; 3] = std::array::from_fn(|i| {
            [0, 1].map(|phase| {
                let mut signal: Vec<f64> = turned.iter().map(|both| both[phase][i]).collect();
                fast.fast_part(&mut signal, 0, part.start);
                signal.iter_mut().for_each(|x| *x /= fast.stddev(i));
                signal
            })
        });
        let (mut matrix, mut vector) = (Matrix2::zeros(), Vector2::zeros());
        for ([a, b], channel) in signals.iter().zip(&fast.channel) {
            for ((x, y), z) in a.iter().zip(b).zip(&channel[part.clone()]) {
                let g = Vector2::new(*x, *y);
                matrix += g * g.transpose();
                vector += g * *z;
            }
        }
        let size = matrix.try_inverse().map_or_else(Vector2::zeros, |m| m * vector);
        let explained = signals.map(|[a, b]| a.iter().zip(b).map(|(x, y)| size.x * x + size.y * y).collect());
        Self { drop: size.dot(&vector), information: 0.5 * matrix.trace(), explained }
    }
}
