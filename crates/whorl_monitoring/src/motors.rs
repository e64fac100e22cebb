//! What motors and bearings of wheels may do that nobody predicts.
//!
//! No data sheet states the white noise of a motor's torque, and a filter that allows too much of it is slow to see what else
//! happens to a wheel. So its level is learned in the first part of a run, from readings of wheels that turn freely. With s =
//! d ln S/d ln q of the variance S of an innovation e by a motor's noise q, each reading moves the logarithm of q by
//!
//! ```text
//! (e^2/S - 1) s/2 / (1/V + sum s^2/2)
//! ```
//!
//! a Newton step up the likelihood with its expected curvature, and 1/V that of what is known before. A speed that walks by q from reading
//! to reading of variance R has S = R + (q + r)/2, r^2 = q^2 + 4 q R. It acts on later readings only, so that innovations stay white and the
//! evidence a likelihood ratio.

use whorl_dynamics::platform::Wheel;

/// A wheel slower than this may stick or turn back [rad/s], and for so long at a time \[s\].
const SLOW_RAD_S: f64 = 1.0;
pub(crate) const STICKING_S: f64 = 5.0;
/// A wheel slower than this rests [rad/s] while its motor asks for less than this share of its bearing's friction: that holds
/// it even where it is half of what the model says.
const RESTING_RAD_S: f64 = 0.1;
const HELD_SHARE: f64 = 0.5;
/// What a wheel that rests may yet move by in a cell [rad/s].
pub(crate) const HELD_RAD_S: f64 = 1e-3;
/// Standard deviation of ln q about that of the settings: from a thirtieth of the noise to three times of it, more likely below.
const KNOWN_BEFORE: f64 = 2.6;
/// A step is at most this factor's logarithm: where a filter is far off, the likelihood is no parabola.
const LARGEST_STEP: f64 = 0.5;

/// How a wheel turns, as far as its friction is concerned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Turning {
    /// Its bearing holds it.
    Held,
    /// It may stick or turn back: nobody knows which way its friction points.
    Slowly,
    /// As its model says.
    Freely,
}

impl Turning {
    /// Of a wheel in a bin.
    pub(crate) fn of(wheel: &Wheel, speed_rad_s: f64, torque_n_m: f64) -> Self {
        let held = torque_n_m.abs() < HELD_SHARE * wheel.coulomb_friction_n_m;
        match speed_rad_s.abs() {
            speed if speed < RESTING_RAD_S && held => Self::Held,
            speed if speed < SLOW_RAD_S && wheel.coulomb_friction_n_m > 0.0 => Self::Slowly,
            _ => Self::Freely,
        }
    }
}

/// What is known of the motors' noise.
#[derive(Debug, Clone)]
pub(crate) struct MotorNoise {
    left_s: f64,
    ln_share: f64,
    information: f64,
}

impl MotorNoise {
    /// Before the first cell; learns for so long \[s\], 0 = never.
    pub fn new(learned_s: f64) -> Self {
        Self { left_s: learned_s, ln_share: 0.0, information: KNOWN_BEFORE.powi(-2) }
    }

    /// Variance over that of the settings.
    pub fn share(&self) -> f64 {
        self.ln_share.exp()
    }

    /// Takes a cell of this length \[s\]: of each wheel that turns freely the innovation over its deviation, and the variances that motors'
    /// noise has added to its speed since the reading before and that the reading has itself [(rad/s)^2].
    pub fn learn(&mut self, length_s: f64, wheels: impl Iterator<Item = (f64, f64, f64)>) {
        if self.left_s <= 0.0 {
            return;
        }
        let (mut slope, mut turns) = (0.0, false);
        for (normalised, q, own) in wheels {
            let root = (q * q + 4.0 * q * own).sqrt();
            let share = 0.5 * (q + (q * q + 2.0 * q * own) / root) / (own + 0.5 * (q + root));
            slope += 0.5 * (normalised * normalised - 1.0) * share;
            self.information += 0.5 * share * share;
            turns = true;
        }
        self.ln_share += (slope / self.information).clamp(-LARGEST_STEP, LARGEST_STEP);
        if turns {
            self.left_s -= length_s;
        }
    }
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
    /// noise is told less well: the readings' own is larger, and the slow torque that the filter allows stands in for it; a thirtieth hardly shows at all.
    #[test]
    fn the_noise_of_motors_is_learned_from_how_wheels_move() {
        let assumed = 1e-3 * PlatformModel::whorl_1_reference().wheels()[0].max_torque_n_m;
        for (over_assumed, tolerance) in
            [(1.0 / 30.0, 10.0), (0.1, 3.0), (1.0 / 3.0, 2.0), (1.0, 1.5), (3.0, 1.5)]
        {
            let (monitor, mean_square) = watched(assumed * over_assumed, 130.0);
            let ratio = monitor.watch.motors.share().sqrt() / over_assumed;
            assert!(ratio > 1.0 / tolerance && ratio < tolerance, "{over_assumed}: {ratio} times the truth");
            assert!((mean_square - 1.0).abs() < 0.2, "{over_assumed}: mean square {mean_square}");
        }
    }
}
