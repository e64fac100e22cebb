//! How noisy the motors are, learned while the platform moves.
//!
//! No data sheet states the white noise of a motor's torque, and a filter that allows too much of it is slow to see what else
//! happens to a wheel. So filters like the monitor's, each with another noise, run beside it in the first part of a run.
//! The wheels' innovations, given the gyro's, give each a likelihood; the variance in force is the mean over their
//! posterior. It is always made of bins before the one that it is used for, so that innovations stay white and the
//! evidence a likelihood ratio.

use nalgebra::DVector;

use crate::filter::{Filter, Turning, Whitened};
use crate::lanes::{Changes, Lanes};
use crate::predictor::Bin;

/// Standard deviations over that of the settings, and how likely each is before any data: no motor is without any noise, and
/// a small one is more likely below than above.
const CHOICES: [(f64, f64); 5] = [(1.0 / 30.0, 0.1), (0.1, 0.2), (1.0 / 3.0, 0.3), (1.0, 0.3), (3.0, 0.1)];

/// One of the noises.
#[derive(Debug, Clone)]
struct Choice {
    variance: f64,
    filter: Filter,
    ln_weight: f64,
}

/// What is known of the motors' noise.
#[derive(Debug, Clone)]
pub struct MotorNoise {
    /// Empty once all is learned.
    choices: Vec<Choice>,
    left_s: f64,
    share: f64,
}

impl MotorNoise {
    /// Before the first bin; learns for so long \[s\], 0 = never, beside this filter.
    #[must_use]
    pub fn new(filter: &Filter, learned_s: f64) -> Self {
        let of = |(stddev, weight): (f64, f64)| {
            let mut filter = filter.clone();
            let variance = stddev * stddev;
            filter.set_motor_noise_share(variance);
            Choice { variance, filter, ln_weight: weight.ln() }
        };
        let learns = learned_s > 0.0 && filter.places.wheels > 0;
        let choices = if learns { CHOICES.map(of).into() } else { Vec::new() };
        let mut noise = Self { choices, left_s: learned_s, share: 1.0 };
        noise.average();
        noise
    }

    /// Variance over that of the settings.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.share
    }

    /// The motion is unknown: after a gap in the data.
    pub fn forget_motion(&mut self) {
        self.choices.iter_mut().for_each(|choice| choice.filter.forget_motion());
    }

    /// Takes a bin, and by what the monitor's own filter corrected the motion at its end.
    ///
    /// Until the motion is `settled` the innovations say nothing about motors.
    pub fn step(
        &mut self,
        lanes: &Lanes,
        bin: &Bin,
        changes: &Changes,
        corrected_by: &DVector<f64>,
        settled: bool,
    ) {
        // At rest and near it friction decides.
        let wheels =
            lanes.base().model().wheels().iter().zip(bin.wheel_speed_rad_s).zip(bin.wheel_torque_n_m);
        let turns: Vec<bool> = wheels
            .map(|((wheel, speed), torque)| settled && Turning::of(wheel, speed, torque) == Turning::Freely)
            .collect();
        self.choices.retain_mut(|choice| {
            let Some((whitened, correction)) = choice.filter.step(lanes, bin, changes) else { return false };
            choice.filter.set_motion_error(&(correction - corrected_by));
            choice.ln_weight += ln_likelihood_of_wheels(&whitened, &turns);
            true
        });
        if turns.contains(&true) && !self.choices.is_empty() {
            self.left_s -= bin.length_s;
            self.average();
            if self.left_s <= 0.0 {
                self.choices.clear();
            }
        }
    }

    /// The mean of the variance over what is known.
    fn average(&mut self) {
        let most = self.choices.iter().map(|c| c.ln_weight).fold(f64::NEG_INFINITY, f64::max);
        let weights = self.choices.iter().map(|c| ((c.ln_weight - most).exp(), c.variance));
        let (sum, of_variance) =
            weights.fold((0.0, 0.0), |(sum, mean), (w, variance)| (sum + w, mean + w * variance));
        if sum > 0.0 && of_variance.is_finite() {
            self.share = of_variance / sum;
        }
    }
}

/// ln of the density of the readings of wheels that turn freely, given the gyro's and all before, but for a constant.
fn ln_likelihood_of_wheels(whitened: &Whitened, turns: &[bool]) -> f64 {
    let of = |k: usize| {
        let y = whitened.innovation[k];
        -0.5 * y * y - whitened.lower()[(k, k)].ln()
    };
    // The gyro's rows come first, so that the lower triangle leaves the wheels' given theirs.
    let freely =
        |reading: usize| reading.checked_sub(3).and_then(|j| turns.get(j)).is_some_and(|turns| *turns);
    whitened.reading.iter().enumerate().filter(|(_, reading)| freely(**reading)).map(|(k, _)| of(k)).sum()
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, UnitQuaternion, Vector3};
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64Mcg;

    use whorl_dynamics::platform::TiltLimit;
    use whorl_dynamics::{MassProperties, ModelPrior, PlatformModel};

    use crate::{Monitor, Settings};

    const STEP_S: f64 = 0.01;

    /// A balanced platform with three wheels that turn without friction, moved by nothing but their motors' noise: Euler's
    /// equation of a gyrostat, integrated here.
    fn watched(noise_n_m_sqrt_s: f64, end_s: f64) -> (Monitor, f64) {
        let mut model = PlatformModel::whorl_1_reference();
        let inertia = Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0));
        model.mass_properties = MassProperties::new(inertia, Vector3::zeros(), 110.0).unwrap();
        // Noise turns it further than the dissertation's stops would let it.
        model.tilt_limit = TiltLimit::Cone { max_rad: 1.5 };
        for wheel in model.wheels_mut() {
            (wheel.viscous_friction_n_m_s, wheel.coulomb_friction_n_m) = (0.0, 0.0);
        }
        let jets = model.jets().len();
        let spin_inertia = model.wheels()[0].spin_inertia_kg_m2;
        let settings = Settings { background_torque_n_m: 1e-6, ..Settings::of(&model) };
        let mut monitor = Monitor::new(&model, &ModelPrior::typical(&model), &settings).unwrap();

        let mut rng = Pcg64Mcg::new(3);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let gyro_noise = model.sensors.gyro.errors.one_sample_stddev();
        let speed_noise = model.sensors.wheel_speed.one_sample_stddev_rad_s();
        let (mut q, mut omega, mut speed) =
            (UnitQuaternion::identity(), Vector3::<f64>::zeros(), Vector3::new(40.0, -35.0, 30.0));
        let (mut squares, mut count, mut steps) = (0.0, 0_u32, 0);
        while f64::from(steps) * STEP_S < end_s {
            steps += 1;
            let at_ns = i64::from(steps) * 10_000_000;
            let torque = Vector3::from_fn(|_, _| noise_n_m_sqrt_s / STEP_S.sqrt() * normal());
            let momentum = inertia * omega + speed * spin_inertia;
            // Of the body without the wheels' inertia about their spin axes.
            let resisting = inertia - Matrix3::identity() * spin_inertia;
            let omega_dot = resisting.try_inverse().unwrap() * (-omega.cross(&momentum) - torque);
            speed += (torque / spin_inertia - omega_dot) * STEP_S;
            q *= UnitQuaternion::from_scaled_axis((omega + omega_dot * (0.5 * STEP_S)) * STEP_S);
            omega += omega_dot * STEP_S;
            let reading = omega + gyro_noise.map(|s| s * normal());
            let speeds = speed.map(|s| s + speed_noise * normal());
            monitor.on_gyro(at_ns, &reading);
            monitor.on_wheels(at_ns, speeds.as_slice(), &[0.0; 3]);
            monitor.on_valves(at_ns, &vec![false; jets], &vec![0.0; jets]);
            monitor.on_controlled(at_ns);
            monitor.on_attitude(at_ns, &q, &omega);
            if steps % 100 == 0 {
                let fit = monitor.fit(at_ns);
                if f64::from(steps) * STEP_S > 70.0 {
                    squares += fit.squares.0;
                    count += fit.squares.1;
                }
            }
        }
        (monitor, squares / f64::from(count))
    }

    /// From a thirtieth of what is assumed to three times it. The residuals then have the variance they should have. A small
    /// noise is told less well: the readings' own is larger, and the slow torque that the filter allows stands in for it.
    #[test]
    fn the_noise_of_motors_is_learned_from_how_wheels_move() {
        let assumed = 1e-3 * PlatformModel::whorl_1_reference().wheels()[0].max_torque_n_m;
        for (over_assumed, tolerance) in
            [(1.0 / 30.0, 5.0), (0.1, 3.0), (1.0 / 3.0, 2.0), (1.0, 1.5), (3.0, 1.5)]
        {
            let (monitor, mean_square) = watched(assumed * over_assumed, 130.0);
            let ratio = monitor.motor_noise_over_assumed() / over_assumed;
            assert!(ratio > 1.0 / tolerance && ratio < tolerance, "{over_assumed}: {ratio} times the truth");
            assert!((mean_square - 1.0).abs() < 0.2, "{over_assumed}: mean square {mean_square}");
        }
    }
}
