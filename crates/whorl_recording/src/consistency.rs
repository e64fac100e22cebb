//! Consistency checks: channels that contradict themselves or each other.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::PlatformModel;

use crate::{Mounting, Recording, Series};

/// A sensor that gave fewer readings than this is not called frozen.
const FEW: usize = 10;
/// Readings that come faster than this have a wrong time [Hz].
const FASTEST_HZ: f64 = 20_000.0;
/// Readings slower than this, and slower by [`SLOWER`] than the sensors' stated rate where that is known, have a wrong
/// time \[Hz\].
const SLOWEST_HZ: f64 = 0.4;
const SLOWER: f64 = 100.0;
/// Time over which turns are compared \[s\].
const WINDOW_S: f64 = 0.5;
/// Turns or speeds that differ by more than this factor cannot be a scale error of a sensor.
const FACTOR: f64 = 5.0;
/// Windows below which nothing is compared.
const LEAST_WINDOWS: usize = 10;
/// Correlation above which a factor between two channels is considered significant.
const CORRELATED: f64 = 0.8;
/// A turn in a window that the gyro indicates and no other sensor confirms \[rad\].
const CLAIMED_RAD: f64 = 0.05;

/// What a sensor of directions sees of turns, beside the gyro.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenTurns {
    /// What it is.
    pub sensor: &'static str,
    /// How far it turns, over what the gyro says \[1\].
    pub ratio: f64,
    /// How alike both are \[-1, 1\].
    pub correlation: f64,
    /// What the gyro says, RMS over half a second \[rad\].
    pub claimed_rad: f64,
}

impl Recording {
    /// One sentence for each contradiction: a frozen sensor, a time, rate or speed in a wrong unit, a reversed
    /// axis. Nothing can be explained by such a recording.
    #[must_use]
    pub fn contradictions(&self, model: Option<&PlatformModel>) -> Vec<String> {
        let mut found = Vec::new();
        found.extend(frozen(&self.gyro_b_rad_s, self.gyro_axes(), "gyro"));
        found.extend(frozen(&self.specific_force_b_m_s2, [true; 3], "accelerometer"));
        found.extend(self.time_unit(model.map(|model| model.sensors.rate_hz)));
        if self.mounting == Mounting::OnBearing && self.has_whole_gyro() {
            found.extend(self.gyro_unit());
        }
        found.extend(model.into_iter().flat_map(|model| self.wheel_units(model)));
        found
    }

    fn time_unit(&self, stated_hz: Option<f64>) -> Option<String> {
        let slowest_hz = stated_hz.map_or(SLOWEST_HZ, |stated_hz| SLOWEST_HZ.min(stated_hz / SLOWER));
        [&self.gyro_b_rad_s.time_s, &self.wheel_speed_rad_s.time_s].into_iter().find_map(|times| {
            let length_s = times.last()? - times.first()?;
            let rate_hz = times.len() as f64 / length_s.max(1e-9);
            if times.len() > FEW && rate_hz < slowest_hz {
                return Some(format!(
                    "Readings come every {:.0} s: is the time's unit right? (ms taken for s: 1000 times.)",
                    1.0 / rate_hz
                ));
            }
            (times.len() > FEW && rate_hz > FASTEST_HZ).then(|| {
                format!(
                    "{} readings within {length_s:.3} s are {:.0} kHz: the time's unit is wrong.",
                    times.len(),
                    rate_hz / 1e3
                )
            })
        })
    }

    /// Compares the turns of measured directions with those from the gyro.
    fn gyro_unit(&self) -> Option<String> {
        self.turns_seen().into_iter().find_map(|SeenTurns { sensor, ratio, correlation, claimed_rad }| {
            if ratio > FACTOR && correlation > CORRELATED {
                Some(format!(
                    "The {sensor} turns {ratio:.0} times as far as the gyro says: is the gyro's unit right? (rad/s taken for deg/s: 57 times.)"
                ))
            } else if ratio < 1.0 / FACTOR && claimed_rad > CLAIMED_RAD {
                Some(format!(
                    "The gyro says that the platform turns {:.0} times as far as the {sensor} sees: is the gyro's unit right? (deg/s taken for rad/s: 57 times.)",
                    1.0 / ratio
                ))
            } else if correlation < -CORRELATED {
                Some(format!("The gyro and the {sensor} turn in opposite senses: reverse the signs of one of them in the map."))
            } else {
                None
            }
        })
    }

    /// How far vector sensors and accelerometer turn within half a second, beside what the gyro says; of sensors that can be
    /// compared.
    #[must_use]
    pub fn turns_seen(&self) -> Vec<SeenTurns> {
        let force = averaged(&self.specific_force_b_m_s2, 0.1);
        let seen = self.vectors.iter().map(|v| (&v.direction_b, "vector sensor"));
        let compared = seen.chain([(&force, "accelerometer")]).filter_map(|(directions, sensor)| {
            let turns = Turns::of(directions, &self.gyro_b_rad_s)?;
            let ratio = turns.seen / turns.claimed;
            Some(SeenTurns { sensor, ratio, correlation: turns.correlation, claimed_rad: turns.claimed })
        });
        compared.collect()
    }

    /// Compares the change of each wheel's speed with what its command can do.
    fn wheel_units(&self, model: &PlatformModel) -> Option<String> {
        self.wheel_responses(model).into_iter().zip(model.wheels()).find_map(|(response, wheel)| {
            let (ratio, correlation) = response?;
            if correlation.abs() < CORRELATED || (1.0 / 4.0..4.0).contains(&ratio) {
                // Opposite senses are left to the diagnosis: a motor may be wired in reverse.
                return None;
            }
            Some(format!(
                "{} changes its speed {ratio:.2} times as much as its torque command does: are both units right? (rpm taken for rad/s: 9.5 times.)",
                wheel.name
            ))
        })
    }

    /// How much each wheel's speed changes in a second, over what its commanded torque does to the model's inertia, and how alike
    /// both are \[-1, 1\]; `None` of a wheel without enough of both.
    #[must_use]
    pub fn wheel_responses(&self, model: &PlatformModel) -> Vec<Option<(f64, f64)>> {
        let inertias = model.wheels().iter().map(|wheel| wheel.spin_inertia_kg_m2);
        inertias.enumerate().map(|(j, inertia_kg_m2)| self.wheel_response(j, inertia_kg_m2)).collect()
    }

    fn wheel_response(&self, j: usize, spin_inertia_kg_m2: f64) -> Option<(f64, f64)> {
        let (speed, command) = (&self.wheel_speed_rad_s, &self.wheel_torque_command_n_m);
        let (first, last) = (*command.time_s.first()?, *speed.time_s.last()?);
        let mut sums = Sums::default();
        let mut from = speed.time_s.partition_point(|t| *t < first);
        let mut next = 0;
        while let Some(&start) = speed.time_s.get(from).filter(|t| **t + 1.0 < last) {
            let to = speed.time_s.partition_point(|t| *t < start + 1.0);
            let end = *speed.time_s.get(to)?;
            let mut impulse = 0.0;
            let mut at = start;
            while at < end {
                while command.time_s.get(next + 1).is_some_and(|t| *t <= at) {
                    next += 1;
                }
                let until = command.time_s.get(next + 1).copied().unwrap_or(end).min(end);
                impulse += command.value.get(next)?.get(j)? * (until - at);
                at = until;
            }
            let change = speed.value.get(to)?.get(j)? - speed.value.get(from)?.get(j)?;
            sums.add(change, impulse / spin_inertia_kg_m2);
            from = to;
        }
        sums.ratio_and_correlation()
    }
}

/// Sums over windows of two quantities that should be the same.
#[derive(Debug, Default)]
struct Sums {
    count: usize,
    seen: f64,
    claimed: f64,
    product: f64,
}

impl Sums {
    fn add(&mut self, seen: f64, claimed: f64) {
        self.count += 1;
        self.seen += seen * seen;
        self.claimed += claimed * claimed;
        self.product += seen * claimed;
    }

    fn ratio_and_correlation(&self) -> Option<(f64, f64)> {
        let enough = self.count >= LEAST_WINDOWS && self.seen > 0.0 && self.claimed > 0.0;
        enough.then(|| ((self.seen / self.claimed).sqrt(), self.product / (self.seen * self.claimed).sqrt()))
    }
}

/// RMS turns of a direction in a window, and how alike they are.
#[derive(Debug)]
struct Turns {
    seen: f64,
    claimed: f64,
    correlation: f64,
}

impl Turns {
    fn of(directions: &Series<Vector3<f64>>, gyro: &Series<Vector3<f64>>) -> Option<Self> {
        let mut sums = Sums { count: 0, ..Sums::default() };
        let mut from = 0;
        let mut windows = 0;
        while let Some(&start) = directions.time_s.get(from) {
            let to = directions.time_s.partition_point(|t| *t < start + WINDOW_S);
            let (Some(&end), Some(a), Some(b)) =
                (directions.time_s.get(to), directions.value.get(from), directions.value.get(to))
            else {
                break;
            };
            from = to.max(from + 1);
            // The motion across a gap is unknown.
            if end - start > 3.0 * WINDOW_S {
                continue;
            }
            let (first, beyond) =
                (gyro.time_s.partition_point(|t| *t < start), gyro.time_s.partition_point(|t| *t < end));
            if beyond <= first + 1 {
                continue;
            }
            let mean = gyro.value.get(first..beyond)?.iter().sum::<Vector3<f64>>() / (beyond - first) as f64;
            // A direction fixed in the world turns against the body.
            let turn = UnitQuaternion::from_scaled_axis(-mean * (end - start));
            let (seen, claimed) = (b - a, turn * a - a);
            windows += 1;
            for i in 0..3 {
                sums.add(seen[i], claimed[i]);
            }
        }
        let (_, correlation) = sums.ratio_and_correlation().filter(|_| windows >= LEAST_WINDOWS)?;
        let rms = |sum: f64| (sum / windows as f64).sqrt();
        Some(Self { seen: rms(sums.seen), claimed: rms(sums.claimed), correlation })
    }
}

/// A sensor with noise never reads the same number throughout.
fn frozen(series: &Series<Vector3<f64>>, there: [bool; 3], name: &str) -> Option<String> {
    let first = series.value.first().filter(|_| series.len() >= FEW)?;
    let constant = |axis: usize| series.value.iter().all(|v| v.get(axis) == first.get(axis));
    let axes = (0..3).zip(["x", "y", "z"]).zip(there);
    let axes: Vec<&str> =
        axes.filter(|((axis, _), there)| *there && constant(*axis)).map(|((_, n), _)| n).collect();
    (!axes.is_empty()).then(|| {
        format!(
            "The {name} reads the same number in all {} samples ({}): it is frozen, not connected, or rounded away by its unit; \
             record again, or leave the channel out.",
            series.len(),
            axes.join(", ")
        )
    })
}

/// Directions of length one, the mean of all samples in each stretch of `width_s`.
fn averaged(series: &Series<Vector3<f64>>, width_s: f64) -> Series<Vector3<f64>> {
    let mut means = Series::default();
    let mut from = 0;
    while let Some(&start) = series.time_s.get(from) {
        let to = series.time_s.partition_point(|t| *t < start + width_s).max(from + 1);
        let sum: Vector3<f64> = series.value.get(from..to).unwrap_or(&[]).iter().sum();
        if let Some(direction) = sum.try_normalize(1e-6) {
            let times = series.time_s.get(from..to).unwrap_or(&[]);
            means.time_s.push(times.iter().sum::<f64>() / (to - from) as f64);
            means.value.push(direction);
        }
        from = to;
    }
    means
}
