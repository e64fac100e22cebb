//! Motors with a ROS 2 driver, as `ros2_control` has them: commands as `std_msgs/Float64MultiArray`, states as
//! `sensor_msgs/JointState`.
//!
//! Wheels are commanded in N m (`effort_controllers`), gimbals in rad/s (`velocity_controllers`). What stops a motor when no
//! command comes is a matter of its controller.

mod emulator;

use std::time::{Duration, Instant};

use whorl_dynamics::PlatformModel;
use whorl_dynamics::actuators::Kind;
use whorl_msgs::sensor_msgs::JointState;
use whorl_msgs::std_msgs::Float64MultiArray;
use whorl_msgs::topics::{Message, MessageType};
use whorl_node::ForeignTopics;
use whorl_params::{Reader, range};

use super::stamps::Stamps;
use super::{Heard, join, read_topic, topic};
use crate::DeviceError;
use crate::device::{Address, Device, DeviceKind, Role, UsedTopic};
use crate::emulation::Emulator;
use crate::mailbox::{Command, Mailbox};
use crate::place::Place;
use crate::reading::{Joint, Measured, Reporter, State};

/// Its row in the table.
pub const MOTORS: DeviceKind = DeviceKind {
    name: "ros_motors",
    what: "wheels or gimbals with a ROS 2 driver: std_msgs/Float64MultiArray, sensor_msgs/JointState",
    read,
};

/// Motors without a state for so long are lost.
const SILENT: Duration = Duration::from_millis(250);
/// Between commands when nothing new is asked for: a controller that begins later gets them, and its watchdog.
const REFRESH: Duration = Duration::from_millis(50);

/// Motors of one kind of actuator behind one controller.
#[derive(Debug, Clone)]
pub(super) struct RosMotors {
    pub(super) command: String,
    pub(super) state: String,
    pub(super) kind: Kind,
    /// In the order of the command message.
    pub(super) motors: Vec<RosMotor>,
    /// Rate of the model's sensors \[Hz\].
    pub(super) rate_hz: f64,
    stamps: Stamps,
}

/// One of them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RosMotor {
    pub(super) index: usize,
    pub(super) joint: String,
    pub(super) sign: f64,
}

fn read(r: &mut Reader<'_>, model: &PlatformModel) -> Option<Box<dyn Device>> {
    let before = r.error_count();
    let command = read_topic(
        r,
        "command",
        "topic of the commands, std_msgs/Float64MultiArray: wheels in N m, gimbals in rad/s",
    );
    let state =
        read_topic(r, "state", "topic of the joints' states, sensor_msgs/JointState: such as /joint_states");
    let known: Vec<(Kind, usize, String)> = Kind::ALL
        .into_iter()
        .zip(model.actuators.kinds())
        .filter(|(_, row)| row.channel().is_some())
        .flat_map(|(kind, row)| {
            let names: Vec<String> = row.names().into_iter().map(str::to_owned).collect();
            names.into_iter().enumerate().map(move |(index, name)| (kind, index, name))
        })
        .collect();
    let names = known.iter().map(|(.., name)| name.as_str()).collect::<Vec<_>>().join(", ");
    let mut motors: Vec<(Kind, i64, String, RosMotor)> = Vec::new();
    for name in r.children("motors") {
        let Some((kind, index, _)) = known.iter().find(|(.., known)| *known == name) else {
            r.reject_group(
                &format!("motors.{name}"),
                format!("{name} has no motor on this platform; allowed: {names}"),
            );
            continue;
        };
        let (joint, sign, element) = r.group("motors", |r| {
            r.group(&name, |r| {
                let joint = r.string_or("joint", &name, "name of the joint in the state message");
                let doc =
                    "-1: positive numbers turn it against its axis in the model; whorl checkout finds it";
                let sign = r.i64_or("sign", 1, range(-1..=1), doc);
                if sign == 0 {
                    r.reject("sign", "allowed: 1 or -1");
                }
                let doc =
                    "place in the command message, from 0; left out: the order of the platform's actuators";
                (joint, sign, r.optional_i64("element", range(0..=255), doc))
            })
        });
        let element = element.unwrap_or(i64::try_from(*index).unwrap_or(0));
        if let Some((first, ..)) = motors.first().filter(|(first, ..)| first != kind) {
            let problem =
                format!("{first:?} and {kind:?} have commands of different units; allowed: a device each");
            r.reject_group(&format!("motors.{name}"), problem);
        }
        if let Some((_, _, other, _)) = motors.iter().find(|(_, other, ..)| *other == element) {
            let problem = format!("{other} has element {element} already; allowed: an element of its own");
            r.reject_group(&format!("motors.{name}"), problem);
        }
        let motor = RosMotor { index: *index, joint, sign: sign as f64 };
        motors.push((*kind, element, name, motor));
    }
    motors.sort_by_key(|(_, element, ..)| *element);
    if motors.is_empty() && r.error_count() == before {
        r.reject("kind", format!("it moves nothing; allowed: motors.<name> for one or more of: {names}"));
    }
    let in_order = (0i64..).zip(&motors).all(|(place, (_, element, ..))| place == *element);
    if !in_order && r.error_count() == before {
        r.reject("kind", "elements of its motors have gaps; allowed: 0, 1, 2, ..., one for each");
    }
    let stamps = Stamps::read(r);
    let kind = motors.first().map_or(Kind::Wheels, |(kind, ..)| *kind);
    let motors = motors.into_iter().map(|(.., motor)| motor).collect();
    let rate_hz = model.sensors.rate_hz;
    (r.error_count() == before)
        .then(|| Box::new(RosMotors { command, state, kind, motors, rate_hz, stamps }) as Box<dyn Device>)
}

impl Device for RosMotors {
    fn addresses(&self) -> Vec<Address> {
        let joints = self.motors.iter().map(|motor| Address(format!("{} of {}", motor.joint, self.state)));
        std::iter::once(Address(self.command.clone())).chain(joints).collect()
    }

    fn topics(&self) -> Vec<UsedTopic> {
        vec![
            UsedTopic { name: self.state.clone(), is_read: true },
            UsedTopic { name: self.command.clone(), is_read: false },
        ]
    }

    fn roles(&self) -> Vec<Role> {
        self.motors.iter().map(|motor| Role::Motor(self.kind, motor.index)).collect()
    }

    fn serve(&self, place: &Place, mailbox: &Mailbox, reporter: &Reporter) -> Result<(), DeviceError> {
        let command = topic(place, &self.command, MessageType::Float64MultiArray);
        let state = topic(place, &self.state, MessageType::JointState);
        let mut listener = join(place, &[state], &[command])?;
        let mut heard = Heard::new(reporter, MessageType::JointState, self.stamps.clone(), SILENT);
        let mut asked = vec![0.0; self.motors.len()];
        let mut parts = Parts { latest: vec![None; self.motors.len()] };
        let result = (|| {
            send(listener.as_mut(), &asked)?;
            let mut refresh = Instant::now() + REFRESH;
            loop {
                let woken = mailbox.wait(Some(listener.fd()), heard.until().min(refresh));
                let mut is_new = false;
                while let Some(command) = mailbox.take() {
                    is_new |= self.ask(&command, &mut asked);
                }
                if mailbox.is_closed() {
                    return Ok(());
                }
                let now = Instant::now();
                // Motors that do not say how they turn are not driven.
                if !matches!(heard.told.state, None | Some(State::Ready)) {
                    asked.fill(0.0);
                }
                if is_new || now >= refresh {
                    refresh = now + REFRESH;
                    send(listener.as_mut(), &asked)?;
                }
                if woken.device {
                    heard.take(listener.as_mut(), |at, message| {
                        let Message::JointState(state) = message else { return Ok(()) };
                        if let Some(motors) = parts.add(self, &state, &asked)? {
                            reporter.measured(at, Measured::Motors { kind: self.kind, motors });
                        }
                        Ok(())
                    })?;
                }
                heard.look(listener.as_ref())?;
            }
        })();
        // The last word is zero.
        asked.fill(0.0);
        result.and(send(listener.as_mut(), &asked))
    }

    fn emulator(&self, _: &PlatformModel) -> Emulator {
        emulator::motors(self)
    }
}

impl RosMotors {
    /// Takes a command; whether it must be sent at once.
    fn ask(&self, command: &Command, asked: &mut [f64]) -> bool {
        match command {
            Command::Motors(kind, values) if *kind == self.kind => {
                for (motor, asked) in self.motors.iter().zip(asked) {
                    *asked = motor.sign * values.get(motor.index).copied().unwrap_or(0.0);
                }
                true
            }
            Command::AllOff => {
                asked.fill(0.0);
                true
            }
            _ => false,
        }
    }
}

fn send(listener: &mut dyn ForeignTopics, asked: &[f64]) -> Result<(), DeviceError> {
    let message = Float64MultiArray { data: asked.to_vec(), ..Float64MultiArray::default() };
    Ok(listener.publish(0, &message.into())?)
}

/// States of motors that come one by one, or all at once, among others.
struct Parts {
    latest: Vec<Option<Joint>>,
}

impl Parts {
    /// Takes what concerns us; the motors once all are there.
    fn add(
        &mut self,
        device: &RosMotors,
        state: &JointState,
        asked: &[f64],
    ) -> Result<Option<Vec<Joint>>, String> {
        let mut found = false;
        for ((motor, asked), latest) in device.motors.iter().zip(asked).zip(&mut self.latest) {
            let Some(place) = state.name.iter().position(|name| *name == motor.joint) else { continue };
            found = true;
            let value = |values: &[f64]| values.get(place).copied().filter(|x| x.is_finite());
            let speed =
                value(&state.velocity).ok_or_else(|| format!("joint {} has no velocity", motor.joint))?;
            // Wheels whose driver does not say get the torque that they were asked for.
            let torque = match device.kind {
                Kind::Wheels => value(&state.effort).unwrap_or(*asked),
                _ => value(&state.effort).unwrap_or(0.0),
            };
            *latest = Some(Joint {
                index: motor.index,
                angle_rad: value(&state.position)
                    .filter(|_| device.kind != Kind::Wheels)
                    .map(|a| motor.sign * a),
                speed_rad_s: motor.sign * speed,
                torque_n_m: motor.sign * torque,
            });
        }
        if !found {
            let wanted: Vec<&str> = device.motors.iter().map(|motor| motor.joint.as_str()).collect();
            return Err(format!("joints {}, none of {}", state.name.join(", "), wanted.join(", ")));
        }
        let all: Option<Vec<Joint>> = self.latest.iter().copied().collect();
        if all.is_some() {
            self.latest.fill(None);
        }
        Ok(all)
    }
}
