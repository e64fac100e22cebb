//! Any inertial sensor with a driver that publishes `sensor_msgs/Imu` as REP-145 says: rates in rad/s, specific force in m/s^2, +9.81
//! along the axis that points up at rest.

use std::time::{Duration, Instant};

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_msgs::sensor_msgs::Imu;
use whorl_msgs::topics::{Message, MessageType};
use whorl_params::{Reader, range};

use super::emulator::{header, publisher};
use super::stamps::Stamps;
use super::{read_mounting, read_topic, serve_sensor, topic};
use crate::DeviceError;
use crate::device::{Address, Device, DeviceKind, Role, UsedTopic};
use crate::emulation::Emulator;
use crate::mailbox::Mailbox;
use crate::place::Place;
use crate::reading::{Measured, Reporter};

/// Its row in the table.
pub const IMU: DeviceKind =
    DeviceKind { name: "ros_imu", what: "any inertial sensor with a ROS 2 driver: sensor_msgs/Imu", read };

/// A sensor without a sample for so long is lost.
const SILENT: Duration = Duration::from_millis(250);

/// One sensor.
#[derive(Debug, Clone)]
pub(super) struct RosImu {
    pub(super) topic: String,
    pub(super) q_body_sensor: UnitQuaternion<f64>,
    /// Each sample is the mean of so many messages.
    pub(super) mean_of: u32,
    /// Rate of the samples \[Hz\].
    pub(super) rate_hz: f64,
    has_accelerometer: bool,
    stamps: Stamps,
}

fn read(r: &mut Reader<'_>, model: &PlatformModel) -> Option<Box<dyn Device>> {
    let before = r.error_count();
    let topic =
        read_topic(r, "topic", "topic of the sensor's driver, with sensor_msgs/Imu: such as /imu/data");
    let q_body_sensor = read_mounting(r, "the sensor's axes");
    let doc = "each sample is the mean of so many messages: those in a second over model.sensors.rate_hz";
    let mean_of = r.i64_or("mean_of", 1, range(1..=1000), doc);
    let stamps = Stamps::read(r);
    (r.error_count() == before).then(|| {
        Box::new(RosImu {
            topic,
            q_body_sensor,
            mean_of: u32::try_from(mean_of).unwrap_or(1),
            rate_hz: model.sensors.rate_hz,
            has_accelerometer: model.sensors.accelerometer.fitted,
            stamps,
        }) as Box<dyn Device>
    })
}

impl Device for RosImu {
    fn addresses(&self) -> Vec<Address> {
        vec![Address(self.topic.clone())]
    }

    fn topics(&self) -> Vec<UsedTopic> {
        vec![UsedTopic { name: self.topic.clone(), is_read: true }]
    }

    fn roles(&self) -> Vec<Role> {
        vec![Role::Imu]
    }

    fn serve(&self, place: &Place, mailbox: &Mailbox, reporter: &Reporter) -> Result<(), DeviceError> {
        let topic = topic(place, &self.topic, MessageType::Imu);
        let mut mean = Mean::default();
        serve_sensor(place, topic, self.stamps.clone(), SILENT, mailbox, reporter, |at, message| {
            let Message::Imu(imu) = message else { return Ok(()) };
            let (rate, force) = self.vectors(&imu)?;
            if let Some((at, rate, force)) = mean.add(self.mean_of, at, rate, force) {
                let rate_b_rad_s = self.q_body_sensor * rate;
                let specific_force_b_m_s2 = self.q_body_sensor * force;
                reporter.measured(at, Measured::Imu { rate_b_rad_s, specific_force_b_m_s2 });
            }
            Ok(())
        })
    }

    fn emulator(&self, _: &PlatformModel) -> Emulator {
        emulated(self)
    }
}

impl RosImu {
    /// Rate and specific force in the sensor's axes.
    pub(super) fn vectors(&self, imu: &Imu) -> Result<(Vector3<f64>, Vector3<f64>), String> {
        let finite = |vector: &Vector3<f64>| vector.iter().all(|x| x.is_finite());
        let rate: Vector3<f64> = imu.angular_velocity.into();
        // A covariance that begins with -1 says that there is no such sensor (sensor_msgs/Imu).
        if imu.angular_velocity_covariance[0] == -1.0 || !finite(&rate) {
            return Err("it has no angular velocity".to_owned());
        }
        let force: Vector3<f64> = imu.linear_acceleration.into();
        if imu.linear_acceleration_covariance[0] != -1.0 && finite(&force) {
            return Ok((rate, force));
        }
        if self.has_accelerometer {
            return Err("it has no linear acceleration, and model.sensors.accelerometer is fitted".to_owned());
        }
        Ok((rate, Vector3::zeros()))
    }
}

/// The mean of some samples, at the mean of their times.
#[derive(Debug, Default)]
struct Mean {
    first: Option<Instant>,
    since_first_s: f64,
    rate: Vector3<f64>,
    force: Vector3<f64>,
    count: u32,
}

impl Mean {
    /// Adds one; the mean, once there are enough.
    fn add(
        &mut self,
        enough: u32,
        at: Instant,
        rate: Vector3<f64>,
        force: Vector3<f64>,
    ) -> Option<(Instant, Vector3<f64>, Vector3<f64>)> {
        let first = *self.first.get_or_insert(at);
        self.since_first_s += at.saturating_duration_since(first).as_secs_f64();
        self.rate += rate;
        self.force += force;
        self.count += 1;
        if self.count < enough {
            return None;
        }
        let count = f64::from(self.count);
        let mean = Self::default();
        let sum = std::mem::replace(self, mean);
        let at = first + Duration::try_from_secs_f64(sum.since_first_s / count).unwrap_or_default();
        Some((at, sum.rate / count, sum.force / count))
    }
}

/// The sensor as it looks from its topic.
fn emulated(imu: &RosImu) -> Emulator {
    let q_sensor_body = imu.q_body_sensor.inverse();
    publisher(&imu.topic, MessageType::Imu, imu.rate_hz * f64::from(imu.mean_of), move |at_ns, world| {
        let sample = world.plant.sample_imu();
        world.sampled_ns = Some(at_ns);
        let mut message = Imu {
            header: header(at_ns),
            angular_velocity: (q_sensor_body * sample.angular_velocity_rad_s).into(),
            linear_acceleration: (q_sensor_body * sample.specific_force_m_s2).into(),
            ..Imu::default()
        };
        message.orientation_covariance[0] = -1.0;
        Some(message.into())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mean_has_the_mean_time() {
        let begin = Instant::now();
        let ms = |ms: u64| begin + Duration::from_millis(ms);
        let mut mean = Mean::default();
        let (x, y) = (Vector3::x(), Vector3::y());
        assert_eq!(mean.add(4, ms(0), x, y), None);
        assert_eq!(mean.add(4, ms(2), x, y * 3.0), None);
        assert_eq!(mean.add(4, ms(5), x * 3.0, y), None);
        let (at, rate, force) = mean.add(4, ms(9), x * 3.0, y * 3.0).unwrap();
        assert_eq!((at, rate, force), (ms(4), x * 2.0, y * 2.0));
        assert_eq!(mean.add(1, ms(10), x, y), Some((ms(10), x, y)));
    }
}
