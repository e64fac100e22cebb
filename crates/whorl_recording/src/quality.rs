//! Missing channels of a recording, what cannot be identified without them, and suspicious data, in words.

use nalgebra::Vector3;
use whorl_bag::Channel;
use whorl_dynamics::effects::{Aid, Need, hard_without, untold_without};
use whorl_dynamics::{Freedom, PlatformModel};
use whorl_math::statistics::median;

use crate::error::RecordingError;
use crate::recording::{Mounting, Recording};
use crate::series::Series;
use crate::truth::truth_contradiction;

/// Runs with fewer readings hold too little.
const FEW_READINGS: usize = 200;
/// Usual intervals between readings beyond which one is a gap.
const GAP_STEPS: f64 = 8.0;
/// Standard gravity [m/s^2].
const GRAVITY_M_S2: f64 = 9.806_65;

/// What cannot be identified without a channel.
struct Cost {
    /// The channel, and those that make up for it.
    any_of: &'static [Channel],
    /// Whether it measures the body, which does not move when it is clamped.
    is_of_body: bool,
    /// Whether such a platform has it at all.
    matters: fn(&PlatformModel) -> bool,
    sentence: &'static str,
    /// The needs of effects that it meets, and how it helps to tell others.
    need: Option<Need>,
    aid: Option<Aid>,
}

impl Cost {
    /// The sentence, and the effects of this platform that it is about.
    fn in_words(&self, model: &PlatformModel) -> String {
        let mut words = self.sentence.to_owned();
        let untold = self.need.map(|need| untold_without(need, model)).unwrap_or_default();
        let mut hard = self.aid.map(|aid| hard_without(aid, model)).unwrap_or_default();
        hard.retain(|id| !untold.contains(id));
        for (what, ids) in [("Cannot be told", untold), ("Hard to tell", hard)] {
            if !ids.is_empty() {
                words += &format!(" {what}: {}.", ids.join(", "));
            }
        }
        words
    }
}

const COSTS: [Cost; 10] = [
    Cost {
        any_of: &[Channel::WheelSpeed],
        is_of_body: false,
        matters: |model| !model.wheels().is_empty(),
        sentence: "No wheel speed: the wheels' momentum has to be taken from their commands.",
        need: None,
        aid: Some(Aid::WheelSpeed),
    },
    Cost {
        any_of: &[Channel::WheelTorqueCommand],
        is_of_body: false,
        matters: |model| !model.wheels().is_empty(),
        sentence: "No wheel torque command: the wheels' reaction has to be taken from their speeds, which is noisier.",
        need: Some(Need::WheelCommands),
        aid: None,
    },
    Cost {
        any_of: &[Channel::GimbalAngle],
        is_of_body: true,
        matters: |model| !model.gyros().is_empty(),
        sentence: "No gimbal angle: the momentum of the control moment gyros is not known, so their torque looks like a \
             disturbance.",
        need: Some(Need::Gimbals),
        aid: None,
    },
    Cost {
        any_of: &[Channel::Gyro],
        is_of_body: true,
        matters: |_| true,
        sentence: "No gyro: the motion is not known, so no torque on the body can be told; only the wheels can be \
             judged.",
        need: None,
        aid: None,
    },
    Cost {
        any_of: &[Channel::Accelerometer],
        is_of_body: true,
        matters: |model| model.freedom == Freedom::OnBearing,
        sentence: "No accelerometer: the tilt is not known, and everything that follows the vertical is told by the gyro alone.",
        need: Some(Need::Accelerometer),
        aid: Some(Aid::Tilt),
    },
    Cost {
        any_of: &[Channel::Vector],
        is_of_body: true,
        matters: |model| model.freedom.axes() == 3,
        sentence: "No vector sensor: yaw drifts with the gyro, and with it everything that follows the heading.",
        need: Some(Need::VectorSensor),
        aid: Some(Aid::Heading),
    },
    Cost {
        any_of: &[Channel::Jets, Channel::BodyTorque],
        is_of_body: true,
        matters: |model| !model.jets().is_empty(),
        sentence: "No jet commands: if a jet fired, its torque looks like a disturbance.",
        need: Some(Need::Jets),
        aid: None,
    },
    Cost {
        any_of: &[Channel::TankPressure],
        is_of_body: true,
        matters: |model| !model.jets().is_empty(),
        sentence: "No tank pressure: it has to be told by the gas that the commands used.",
        need: None,
        aid: Some(Aid::TankPressure),
    },
    Cost {
        any_of: &[Channel::BusVoltage],
        is_of_body: false,
        matters: |model| !model.wheels().is_empty() || !model.jets().is_empty(),
        sentence: "No bus voltage: it has to be taken from the model's discharge.",
        need: Some(Need::BusVoltage),
        aid: Some(Aid::BusVoltage),
    },
    Cost {
        any_of: &[Channel::Temperature],
        is_of_body: false,
        matters: |_| true,
        sentence: "No temperature: the sensors' drift with it is not known.",
        need: Some(Need::Temperature),
        aid: None,
    },
];

impl Recording {
    /// Refuses a model of another platform.
    ///
    /// # Errors
    /// [`RecordingError::OtherPlatform`] when the numbers of wheels, gyros or jets differ.
    pub fn check_fits(&self, model: &PlatformModel, model_name: &str) -> Result<(), RecordingError> {
        self.other_count(model).map_or(Ok(()), |(what, counted, expected)| {
            Err(RecordingError::OtherPlatform {
                run: self.name.clone(),
                counted: format!("{counted} {what}"),
                model: model_name.to_owned(),
                expected: format!("{expected}"),
            })
        })
    }

    /// Wheels, control moment gyros or jets of which it has another number than the model: what, how many, and how many the model has.
    #[must_use]
    pub fn other_count(&self, model: &PlatformModel) -> Option<(&'static str, usize, usize)> {
        let (wheels, gyros) = (model.wheels().len(), model.gyros().len());
        let all = [
            ("wheels", wheels, &self.wheel_speed_rad_s),
            ("wheels", wheels, &self.wheel_torque_command_n_m),
            ("wheels", wheels, &self.wheel_current_a),
            ("control moment gyros", gyros, &self.gimbal_angle_rad),
            ("control moment gyros", gyros, &self.gimbal_rate_rad_s),
            ("control moment gyros", gyros, &self.gimbal_torque_n_m),
        ];
        let of_series = all.into_iter().find_map(|(what, expected, series)| {
            let counted = series.value.iter().map(Vec::len).find(|counted| *counted != expected)?;
            Some((what, counted, expected))
        });
        let (pulsed, jets) = (self.jet_pulses.len(), model.jets().len());
        of_series.or((pulsed > 0 && pulsed != jets).then_some(("jets", pulsed, jets)))
    }

    /// One sentence for each missing channel of the platform: what cannot be identified without it.
    #[must_use]
    pub fn missing_channels(&self, model: &PlatformModel) -> Vec<String> {
        let recorded = |channel: &Channel| match channel {
            Channel::Jets => !self.jet_pulses.is_empty(),
            channel => self.sampled().any(|(there, ..)| there == *channel),
        };
        let held = self.mounting == Mounting::Clamped;
        let axes = ["x", "y", "z"].into_iter().zip(self.no_gyro_axis);
        let axes: Vec<&str> = axes.filter(|(_, missing)| *missing).map(|(axis, _)| axis).collect();
        let rate_is_open = !axes.is_empty()
            && !held
            && model.freedom.rate_from_gyro_b_rad_s(&Vector3::zeros(), self.gyro_axes()).is_none();
        let partial = rate_is_open.then(|| {
            format!(
                "No gyro axis {}: the platform turns about it as well, so its motion is not known; only the wheels can be \
                 judged.",
                axes.join(", ")
            )
        });
        let missing = COSTS.iter().filter(|cost| {
            (cost.matters)(model) && !(cost.is_of_body && held) && !cost.any_of.iter().any(recorded)
        });
        let tilt = (!held && model.freedom.has_weight()).then(|| self.partial_accelerometer()).flatten();
        missing.map(|cost| cost.in_words(model)).chain(partial).chain(tilt).collect()
    }

    /// What an accelerometer of one or two axes is used for, in a sentence; `None` of one that has all, or none.
    #[must_use]
    pub fn partial_accelerometer(&self) -> Option<String> {
        let axes = ["x", "y", "z"].into_iter().zip(self.no_force_axis);
        let (there, missing): (Vec<_>, Vec<_>) = axes.partition(|(_, missing)| !*missing);
        let named =
            |axes: Vec<(&str, bool)>| axes.iter().map(|(axis, _)| *axis).collect::<Vec<_>>().join(", ");
        (!self.specific_force_b_m_s2.is_empty() && !missing.is_empty()).then(|| {
            format!(
                "No accelerometer axis {}: what {} shows is used where a model predicts it; by itself it does not show the \
                 vertical.",
                named(missing),
                named(there)
            )
        })
    }

    /// One sentence for each suspicious finding: a channel that never changes, an implausible unit, a run
    /// that is too short. The recording may still be correct.
    #[must_use]
    pub fn suspicions(&self, model: Option<&PlatformModel>) -> Vec<String> {
        let mut found = Vec::new();
        let readings = self.sampled().filter(|(channel, ..)| channel.info().is_motion);
        let readings = readings.map(|(.., series)| series.time_s().len()).max().unwrap_or(0);
        if readings < FEW_READINGS {
            let plural = if readings == 1 { "" } else { "s" };
            found.push(format!(
                "The run has {readings} reading{plural} in {:.1} s: too few to tell one cause from another; record a longer one.",
                self.duration_s()
            ));
        }
        found.extend(self.contradictions(model));
        found.extend(truth_contradiction(self).map(|said| format!("{said}.")));
        if model.is_none_or(|model| model.freedom.has_weight()) {
            let upright = model.is_none_or(|model| model.freedom.hinge_axis_b().is_none());
            if self.has_whole_accelerometer() {
                force_unit(&self.specific_force_b_m_s2, upright, &mut found);
            }
        }
        if let Some(model) = model {
            let range = model.sensors.gyro.errors.range;
            let largest = largest(self.gyro_b_rad_s.value.iter().flat_map(Vector3::iter));
            if largest > 1.2 * range {
                found.push(format!(
                    "The gyro reads up to {largest:.3} rad/s and its range is {range:.3} rad/s: is the unit deg/s?"
                ));
            }
            for (j, wheel) in model.wheels().iter().enumerate() {
                let speeds = self.wheel_speed_rad_s.value.iter().filter_map(|speeds| speeds.get(j));
                let largest = self::largest(speeds);
                if largest > 1.5 * wheel.max_speed_rad_s {
                    found.push(format!(
                        "{} reads up to {largest:.0} rad/s and its limit is {:.0} rad/s: is the unit rpm?",
                        wheel.name, wheel.max_speed_rad_s
                    ));
                }
                let torques = self.wheel_torque_command_n_m.value.iter().filter_map(|torques| torques.get(j));
                let largest = self::largest(torques);
                if largest > 10.0 * wheel.max_torque_n_m {
                    found.push(format!(
                        "{} is commanded up to {largest:.1} N m and its limit is {:.1} N m: is the unit mN m?",
                        wheel.name, wheel.max_torque_n_m
                    ));
                }
            }
        }
        found
    }
}

impl Recording {
    /// What is missing between the readings of the gyro (of the wheels, without one), in a sentence; `None` when no
    /// more than a few readings in a row are.
    #[must_use]
    pub fn gaps(&self) -> Option<String> {
        let gyro = &self.gyro_b_rad_s.time_s;
        let times = if gyro.len() > 1 { gyro } else { &self.wheel_speed_rad_s.time_s };
        let steps_s: Vec<f64> = times.windows(2).filter_map(|w| Some(w.get(1)? - w.first()?)).collect();
        let usual_s = median(steps_s.iter().copied());
        let longest_s = steps_s.iter().copied().max_by(f64::total_cmp)?;
        let count = steps_s.iter().filter(|step| **step > GAP_STEPS * usual_s).count();
        (count > 0).then(|| {
            format!(
                "{}: {count} {} in its readings, the longest of {longest_s:.2} s: what was commanded meanwhile may be \
                 missing as well, and looks like a torque that the model lacks; if anything is left unexplained, \
                 record again with less load on the computers",
                self.name,
                if count == 1 { "gap" } else { "gaps" }
            )
        })
    }
}

fn largest<'a>(values: impl Iterator<Item = &'a f64>) -> f64 {
    values.fold(0.0, |largest, x| largest.max(x.abs()))
}

/// At rest, and for the most part in any run on a bearing, its length is g; of a platform that stands upright it points
/// along z.
fn force_unit(series: &Series<Vector3<f64>>, upright: bool, found: &mut Vec<String>) {
    if series.is_empty() {
        return;
    }
    let mean = series.value.iter().map(|force| force.norm()).sum::<f64>() / series.len() as f64;
    let ratio = mean / GRAVITY_M_S2;
    let guess = |low: f64, high: f64| (low..high).contains(&mean);
    let unit = if guess(0.8, 1.25) {
        "its unit looks like g."
    } else if guess(800.0, 1250.0) {
        "its unit looks like mg."
    } else {
        "is its unit right, and is it the specific force (+9.81 on z at rest)?"
    };
    if !(0.8..1.25).contains(&ratio) {
        found.push(format!("The accelerometer's mean length is {mean:.3} m/s^2 instead of 9.8: {unit}"));
    }
    let mean_z = series.value.iter().map(|force| force.z).sum::<f64>() / series.len() as f64;
    if upright && mean_z < -0.5 * mean {
        found.push(
            "The accelerometer reads negative on z: it must be the specific force, +9.81 on z at rest; reverse the \
             sign in the map."
                .to_owned(),
        );
    }
}
