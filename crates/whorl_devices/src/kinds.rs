//! The table of kinds of devices.

use crate::device::DeviceKind;
use crate::{cia402, gpio, hwmon, iio, modbus_relays, odrive, ros, smartmotor, vn100};

/// Every kind of device. A further kind is its folder and a row here.
pub const KINDS: &[DeviceKind] = &[
    vn100::KIND,
    smartmotor::KIND,
    cia402::KIND,
    odrive::KIND,
    modbus_relays::KIND,
    gpio::KIND,
    iio::KIND,
    hwmon::KIND,
    iio::inertial::KIND,
    ros::IMU,
    ros::MAGNETOMETER,
    ros::POSE,
    ros::MOTORS,
    ros::VALVES,
];
