//! Excitations: the coordinator starts them, this platform's parameters define them, and limits of tilt, rate and
//! wheel speed end them.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_control::reference::{Reference, TiltEnvelope};
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_dynamics::platform::Wheel;
use whorl_math::integrate_rate;
use whorl_msgs::whorl::ControlStatus;

use crate::inputs::Estimate;
use crate::parameters::{Excitation, Hold};

/// Share of the rate at which safe mode begins, and of a wheel's largest speed, at which an excitation ends.
const RATE_SHARE: f64 = 0.8;
const WHEEL_SPEED_SHARE: f64 = 0.9;
/// Tilt is predicted this far ahead \[s\]: control must still be able to stop it before safe mode begins, and half a
/// newton metre takes about a second for the rates at which a platform tilts.
const AHEAD_S: f64 = 0.5;
/// An excitation whose time goes back by more than this has been restarted \[s\].
const BEGUN_ANEW_S: f64 = 0.5;

/// The excitation being played.
#[derive(Debug, Clone)]
struct Playing {
    name: String,
    elapsed_s: f64,
    /// Attitude at which it began.
    start: UnitQuaternion<f64>,
    /// Number of the latest pulse that was fired.
    fired: Option<u64>,
    /// A limit was reached.
    over: bool,
}

/// What the actuators do in this step besides control.
#[derive(Debug, Clone)]
pub(crate) struct Drive {
    pub hold: Hold,
    /// Attitude at which the excitation began.
    pub start: UnitQuaternion<f64>,
    /// Motor torque of every wheel [N m].
    pub wheel_torque_n_m: [f64; MAX_WHEELS],
    /// The jet that is to fire in the next slot, and for how long [s].
    pub pulse: Option<(usize, f64)>,
}

/// Result of asking for the excitation to play.
#[derive(Debug, Clone)]
pub(crate) enum Played {
    /// Nothing was asked for.
    Nothing,
    /// The requested excitation cannot be played; `ControlStatus::REASON_*`.
    Refused(u8),
    /// Play this.
    Drive(Box<Drive>),
}

/// Limits at which excitations end, and the excitation being played.
#[derive(Debug, Clone)]
pub(crate) struct Excitations {
    envelope: TiltEnvelope,
    rate_rad_s: f64,
    playing: Option<Playing>,
}

impl Excitations {
    /// `envelope` is that of references, `rate_rad_s` the rate at which safe mode begins.
    pub fn new(envelope: TiltEnvelope, rate_rad_s: f64) -> Self {
        Self { envelope, rate_rad_s: RATE_SHARE * rate_rad_s, playing: None }
    }

    /// Applies new limits and continues playing.
    pub fn reconfigure(&mut self, fresh: Self) {
        *self = Self { playing: self.playing.take(), ..fresh };
    }

    /// Stops playing. True when an excitation was being played.
    pub fn stop(&mut self) -> bool {
        self.playing.take().is_some()
    }

    /// Control was interrupted: ends the excitation until the next one. True when one was being played.
    pub fn interrupt(&mut self) -> bool {
        self.playing.as_mut().is_some_and(|playing| !std::mem::replace(&mut playing.over, true))
    }

    /// The pulse of the latest step was sent.
    pub fn fired(&mut self, number: Option<u64>) {
        if let Some(playing) = &mut self.playing {
            playing.fired = number.or(playing.fired);
        }
    }

    /// The excitation `name` out of `known` at `elapsed_s` after its start, with the number of its pulse.
    pub fn play(
        &mut self,
        (name, elapsed_s): (&str, f64),
        known: &[Excitation],
        wheels: &[Wheel],
        wheel_speed_rad_s: &[f64],
        estimate: &Estimate,
    ) -> (Played, Option<u64>) {
        let Some(excitation) = known.iter().find(|e| e.name == name) else {
            self.playing = None;
            return (Played::Refused(ControlStatus::REASON_EXCITATION_UNKNOWN), None);
        };
        if self.playing.as_ref().is_some_and(|p| p.name != name || elapsed_s < p.elapsed_s - BEGUN_ANEW_S) {
            self.playing = None;
        }
        let playing = self.playing.get_or_insert_with(|| Playing {
            name: name.to_owned(),
            elapsed_s,
            start: estimate.q_world_body,
            fired: None,
            over: false,
        });
        playing.elapsed_s = elapsed_s;
        let fast = |(speed, wheel): (&f64, &Wheel)| speed.abs() > WHEEL_SPEED_SHARE * wheel.max_speed_rad_s;
        let ahead = integrate_rate(&estimate.q_world_body, &estimate.omega_wb_b_rad_s, AHEAD_S);
        let tilt_rad = self.envelope.angle_rad(&estimate.q_world_body).max(self.envelope.angle_rad(&ahead));
        playing.over |= tilt_rad > self.envelope.max_rad()
            || estimate.omega_wb_b_rad_s.norm() > self.rate_rad_s
            || wheel_speed_rad_s.iter().zip(wheels).any(fast);
        if playing.over {
            return (Played::Refused(ControlStatus::REASON_EXCITATION_LIMIT), None);
        }
        let mut wheel_torque_n_m = [0.0; MAX_WHEELS];
        if let Some(signal) = &excitation.signal {
            for (k, wheel) in excitation.wheels.iter().enumerate() {
                if let Some(torque) = wheel_torque_n_m.get_mut(*wheel) {
                    *torque = signal.torque_n_m(k, elapsed_s);
                }
            }
        }
        let due = excitation.pulses.as_ref().and_then(|train| train.due(elapsed_s));
        let due = due.filter(|(number, ..)| playing.fired.is_none_or(|fired| *number > fired));
        let drive = Drive {
            hold: excitation.hold,
            start: playing.start,
            wheel_torque_n_m,
            pulse: due.map(|(_, jet, on_s)| (jet, on_s)),
        };
        (Played::Drive(Box::new(drive)), due.map(|(number, ..)| number))
    }
}

/// The attitude nearest to the body's that is tilted as `start` was, turning with the body about the vertical.
pub(crate) fn tilted_as(start: &UnitQuaternion<f64>, estimate: &Estimate) -> Reference {
    let up_wanted = start.inverse() * Vector3::z();
    let up = estimate.q_world_body.inverse() * Vector3::z();
    // Only opposite directions have no rotation between them; the bearing's tilt limit is far from that.
    let turn = UnitQuaternion::rotation_between(&up_wanted, &up).unwrap_or_else(UnitQuaternion::identity);
    Reference {
        q_world_reference: estimate.q_world_body * turn,
        omega_wr_r_rad_s: up_wanted * estimate.omega_wb_b_rad_s.dot(&up),
        omega_dot_wr_r_rad_s2: Vector3::zeros(),
    }
}
