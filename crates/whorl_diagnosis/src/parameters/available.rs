//! What recordings hold.

use std::f64::consts::PI;

use nalgebra::Vector3;
use whorl_dynamics::Effect;
use whorl_dynamics::effects::Need;

use crate::bins::run::Run;

/// What the recordings hold, as far as it decides which effects can be tested.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Available {
    pub body: bool,
    pub jets: bool,
    pub wheels: bool,
    pub wheel_command: bool,
    pub gimbals: bool,
    pub accel: bool,
    pub vector: bool,
    pub temperature: bool,
    pub voltage: bool,
    pub ballast: bool,
    pub bin_s: f64,
    /// Largest rate about any axis that lasted a few bins [rad/s].
    pub largest_rate_rad_s: f64,
    /// Largest tilt that lasted a few bins \[rad\].
    pub largest_tilt_rad: f64,
    /// Largest angle between two instants of a run, turned about an axis of the body \[rad\].
    pub largest_turn_rad: f64,
    /// The gyro's readings pile up at a limit.
    pub clips: bool,
}

impl Available {
    pub fn of(runs: &[Run]) -> Self {
        let any = |test: &dyn Fn(&Run) -> bool| runs.iter().any(test);
        Self {
            body: any(&|r| !r.clamped),
            jets: any(&|r| !r.clamped && r.jet_pulses.iter().any(|p| !p.is_empty())),
            wheels: any(&|r| !r.wheel_command.is_empty()),
            wheel_command: any(&|r| r.has_wheel_command),
            gimbals: any(&|r| {
                !r.clamped && r.gimbals.iter().any(|g| g.rate_rad_s.iter().any(|rate| *rate != 0.0))
            }),
            accel: any(&|r| !r.clamped && r.accel.iter().any(|a| a.count > 0.0)),
            vector: any(&|r| !r.clamped && !r.vectors.is_empty()),
            temperature: any(&|r| r.has_temperature),
            voltage: any(&|r| r.has_voltage),
            ballast: any(&|r| r.ballast_direction.iter().any(|d| d.norm() > 0.0)),
            bin_s: runs.iter().map(|r| r.length(0)).fold(0.0, f64::max),
            largest_rate_rad_s: largest(runs, |r| &r.gyro, |w| w.amax()),
            largest_tilt_rad: largest(runs, |r| &r.accel, |f| f.x.hypot(f.y).atan2(f.z)),
            largest_turn_rad: runs.iter().filter(|r| !r.clamped).map(turned_rad).fold(0.0, f64::max),
            clips: any(&|r| r.gyro_digits.clips_at_rad_s.is_some()),
        }
    }

    /// Whether these data could show the effect at all.
    pub fn can_test(&self, effect: &dyn Effect) -> bool {
        effect.evidence().iter().any(|needs| needs.iter().all(|need| self.has(*need)))
    }

    /// Whether they hold what an effect needs.
    pub fn has(&self, need: Need) -> bool {
        match need {
            Need::FreeBody => self.body,
            Need::Jets => self.jets,
            Need::Wheels => self.wheels,
            Need::WheelCommands => self.wheel_command,
            Need::Gimbals => self.gimbals,
            Need::Accelerometer => self.accel,
            Need::VectorSensor => self.vector,
            Need::Temperature => self.temperature,
            Need::BusVoltage => self.voltage,
            Need::Ballast => self.ballast,
            Need::HalfATurn => self.largest_turn_rad > PI,
            Need::UnclippedGyro => !self.clips,
        }
    }
}

/// Angle between the two instants of a run that are furthest apart, by the gyro about one axis of the body \[rad\].
fn turned_rad(run: &Run) -> f64 {
    let (mut turned, mut least, mut most) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
    for (k, rate) in run.gyro.iter().enumerate() {
        turned += rate.value * run.length_or_zero(k);
        least = least.inf(&turned);
        most = most.sup(&turned);
    }
    (most - least).amax()
}

/// Largest size of the mean of five bins in a row.
fn largest(
    runs: &[Run],
    means: impl Fn(&Run) -> &Vec<whorl_trajectory::bins::Mean3>,
    size: impl Fn(&Vector3<f64>) -> f64,
) -> f64 {
    runs.iter()
        .flat_map(|run| {
            let whole: Vec<_> = means(run).iter().filter(|m| m.count > 0.0).map(|m| m.value).collect();
            whole.windows(5).map(|w| size(&(w.iter().sum::<Vector3<f64>>() / 5.0))).collect::<Vec<_>>()
        })
        .fold(0.0, f64::max)
}
