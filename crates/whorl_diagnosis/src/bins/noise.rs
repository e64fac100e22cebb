//! Noise of the sensors as the data show it.
//!
//! Second differences of neighbouring samples measure the noise of one sample without the model. Noise that is correlated from sample to
//! sample shows in the innovations, and is whitened there ([`crate::evidence::ar_noise`]).

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_recording::{Recording, Series, VectorChannel};
use whorl_trajectory::noise::from_second_differences;

/// Standard deviations of one sample.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NoiseLevels {
    /// [rad/s]
    pub gyro: Vector3<f64>,
    /// [m/s^2]
    pub accel: Vector3<f64>,
    /// [rad/s]
    pub wheel: f64,
    /// Measured over modelled.
    pub gyro_ratio: f64,
    /// Measured over modelled.
    pub accel_ratio: f64,
    /// Measured over modelled; 1 where it could not be measured.
    pub wheel_ratio: f64,
}

impl NoiseLevels {
    pub fn measured(recording: &Recording, model: &PlatformModel) -> Self {
        let sensors = &model.sensors;
        let floor = |measured: Option<f64>, modelled: f64, quantum: f64| {
            let smallest = (quantum / 12f64.sqrt()).max(1e-3 * modelled).max(1e-9);
            measured.unwrap_or(modelled).max(smallest)
        };
        let triaxial = |series: &Series<Vector3<f64>>, stddev: &Vector3<f64>, quantum: f64| {
            Vector3::from_fn(|i, _| floor(spread(series, |v| v[i]), stddev[i], quantum))
        };
        let axes = recording.gyro_axes();
        let mut gyro =
            triaxial(&recording.gyro_b_rad_s, &sensors.gyro.errors.noise_stddev, sensors.gyro.errors.quantum);
        let of_axes = |levels: &Vector3<f64>, axes: [bool; 3]| {
            let present = levels.iter().zip(axes).filter(|(_, has)| *has).map(|(x, _)| x * x);
            (present.clone().sum::<f64>() / present.count().max(1) as f64).sqrt()
        };
        // Axes that a sensor does not have are like those that it has.
        let fill = |levels: &mut Vector3<f64>, axes: [bool; 3]| {
            let level = of_axes(levels, axes);
            for (slot, _) in levels.iter_mut().zip(axes).filter(|(_, has)| !has) {
                *slot = level;
            }
            level
        };
        let gyro_level = fill(&mut gyro, axes);
        let mut accel = triaxial(
            &recording.specific_force_b_m_s2,
            &sensors.accelerometer.errors.noise_stddev,
            sensors.accelerometer.errors.quantum,
        );
        let accel_axes = recording.force_axes();
        let accel_level = fill(&mut accel, accel_axes);
        let wheels = model.wheels().len();
        let spreads: Vec<f64> = (0..wheels)
            .filter_map(|j| spread(&recording.wheel_speed_rad_s, |v| v.get(j).copied().unwrap_or(0.0)))
            .collect();
        let measured = Some(spreads.iter().copied().fold(0.0, f64::max)).filter(|s| *s > 0.0);
        let (modelled, quantum) = (sensors.wheel_speed.noise_stddev_rad_s, sensors.wheel_speed.quantum_rad_s);
        let wheel = floor(measured, modelled, quantum);
        let modelled_wheel = sensors.wheel_speed.one_sample_stddev_rad_s();
        Self {
            gyro_ratio: gyro_level / of_axes(&sensors.gyro.errors.noise_stddev, axes),
            accel_ratio: accel_level / of_axes(&sensors.accelerometer.errors.noise_stddev, accel_axes),
            gyro,
            accel,
            wheel: wheel.max(1e-4),
            wheel_ratio: measured.map_or(1.0, |stddev| stddev / modelled_wheel),
        }
    }
}

/// Noise of one direction of a vector sensor, in each of the two directions across it \[rad\].
pub(crate) fn direction_noise_rad(channel: &VectorChannel, model: &PlatformModel) -> f64 {
    let modelled = model.sensors.vector.map_or(5e-3, |v| v.noise_stddev_rad);
    // Three components share the noise of two directions.
    let squares = (0..3).filter_map(|i| spread(&channel.direction_b, |v| v[i])).map(|s| s * s);
    let measured = (squares.sum::<f64>() / 2.0).sqrt();
    if measured > 0.0 { measured.max(0.1 * modelled) } else { modelled }
}

fn spread<T>(series: &Series<T>, component: impl Fn(&T) -> f64) -> Option<f64> {
    from_second_differences(&series.value.iter().map(component).collect::<Vec<_>>())
}

/// How far a reading may be from a whole multiple of a step, in steps.
const OFF_GRID: f64 = 0.02;
/// How far readings at the end of a range may be apart, as a share of it.
const AT_END: f64 = 1e-9;

/// What the gyro's readings show of the numbers in which it reads.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Digits {
    /// Where readings pile up at their largest [rad/s].
    pub clips_at_rad_s: Option<f64>,
    /// Log evidence of that: noise hardly repeats its largest value.
    pub clips_nats: f64,
    /// Step of its output [rad/s]; 0 = none found.
    pub step_rad_s: f64,
    /// Log evidence of that: of readings without steps few are close to multiples of one.
    pub step_nats: f64,
}

/// Where the gyro's readings pile up at their largest, and the step of its output.
pub(crate) fn digits_of_gyro(recording: &Recording, model: &PlatformModel) -> Digits {
    let values = &recording.gyro_b_rad_s.value;
    let largest = values.iter().map(Vector3::amax).fold(0.0, f64::max);
    let at_largest = values.iter().filter(|v| v.amax() >= largest * (1.0 - AT_END)).count();
    // Noise never repeats its largest value many times unless the output has coarse steps.
    let axis = recording.gyro_axes().iter().position(|has| *has).unwrap_or(0);
    let (step, on_grid) = step_of(values.iter().map(|v| v[axis]));
    let noise = model.sensors.gyro.errors.noise_stddev.amax();
    let coarse = step > 0.2 * noise;
    let clips = at_largest >= if coarse { 60 } else { 12 } && largest > 0.0;
    let near = values.iter().filter(|v| v.amax() >= largest - 3.0 * step.max(1e-12)).count();
    // With steps, a clipped reading piles up in one step only.
    let piles_up = !coarse || at_largest * 2 > near;
    // A normal variable is within w of one number with a probability below 2 w / (sqrt(2 pi) sigma).
    let within = (AT_END * largest).max(0.5 * step);
    let rare = (0.5 * std::f64::consts::TAU.sqrt() * noise / within).ln().max(0.0);
    let is_clipped = clips && piles_up;
    Digits {
        clips_at_rad_s: is_clipped.then_some(largest),
        clips_nats: if is_clipped { at_largest as f64 * rare } else { 0.0 },
        step_rad_s: step,
        step_nats: -(on_grid as f64) * (2.0 * OFF_GRID).ln(),
    }
}

/// Smallest nonzero difference that all readings are whole multiples of, and how many are; 0 = none found.
fn step_of(values: impl Iterator<Item = f64>) -> (f64, usize) {
    let mut sorted: Vec<f64> = values.take(20_000).collect();
    sorted.sort_by(f64::total_cmp);
    let smallest = sorted.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 1e-9).fold(f64::INFINITY, f64::min);
    if !smallest.is_finite() {
        return (0.0, 0);
    }
    // Refine the step over a wide span, then test that readings are multiples of it.
    let (Some(first), Some(last)) = (sorted.first(), sorted.last()) else { return (0.0, 0) };
    let count = ((last - first) / smallest).round();
    if !(1.0..1e6).contains(&count) {
        return (0.0, 0);
    }
    let step = (last - first) / count;
    let fits = |x: &f64| {
        let multiple = (x - first) / step;
        (multiple - multiple.round()).abs() < OFF_GRID
    };
    let on_grid = sorted.iter().filter(|x| fits(x)).count();
    if on_grid * 1000 >= sorted.len() * 998 { (step, on_grid) } else { (0.0, 0) }
}

#[cfg(test)]
mod tests {
    use nalgebra::Unit;
    use rand_distr::{Distribution, Normal};
    use rand_pcg::Pcg64;

    use super::*;

    /// Readings on a grid of their own are no chance, and each says so as much as it is unlikely; of others nothing is said.
    #[test]
    fn steps_of_a_gyro_are_as_sure_as_readings_are_many() {
        let model = PlatformModel::whorl_1_reference();
        let mut random = Pcg64::new(3, 5);
        let normal = Normal::new(0.0, 1e-3).unwrap();
        let values: Vec<Vector3<f64>> =
            (0..500).map(|_| Vector3::from_fn(|_, _| normal.sample(&mut random))).collect();
        let digits = |value: Vec<Vector3<f64>>| {
            let time_s = (0..value.len()).map(|i| i as f64 * 0.01).collect();
            let recording = Recording { gyro_b_rad_s: Series { time_s, value }, ..Recording::default() };
            digits_of_gyro(&recording, &model)
        };
        let free = digits(values.clone());
        assert!(free.clips_at_rad_s.is_none() && free.step_nats == 0.0, "{free:?}");
        let step = 1e-3;
        let coarse = digits(values.iter().map(|v| v.map(|x| (x / step).round() * step)).collect());
        assert!((coarse.step_rad_s - step).abs() < 1e-9, "{coarse:?}");
        assert!((coarse.step_nats - 500.0 * 25f64.ln()).abs() < 1e-6, "{coarse:?}");
        let limit = 1.2e-3;
        let clipped = digits(values.iter().map(|v| v.map(|x| x.clamp(-limit, limit))).collect());
        assert_eq!(clipped.clips_at_rad_s, Some(limit));
        assert!(clipped.clips_nats > 100.0, "{clipped:?}");
    }

    /// The noise of a direction is that of two independent angles, and of this sensor alone, whatever the model says
    /// of vector sensors in general.
    #[test]
    fn each_vector_sensor_has_its_own_noise() {
        let model = PlatformModel::whorl_1_reference();
        let mut random = Pcg64::new(7, 11);
        for stddev_rad in [1e-3, 4e-3] {
            let normal = Normal::new(0.0, stddev_rad).unwrap();
            let mut direction_b = Series::default();
            for i in 0..4000 {
                let (a, b) = (normal.sample(&mut random), normal.sample(&mut random));
                let turn = Unit::new_normalize(Vector3::new(0.3, a, b + 0.2 * (f64::from(i) * 0.01).sin()));
                direction_b.time_s.push(f64::from(i) * 0.1);
                direction_b.value.push(Vector3::new(turn.x, turn.y, turn.z));
            }
            // The angles are those of a vector of length 0.3.
            let channel = VectorChannel { reference_world: Vector3::x_axis(), direction_b };
            let ratio = direction_noise_rad(&channel, &model) / (stddev_rad / 0.3);
            assert!((0.8..1.1).contains(&ratio), "{ratio}");
        }
    }
}
