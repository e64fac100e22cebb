//! The devices of a platform, from its parameter file.

use std::fmt;
use std::sync::Arc;

use whorl_dynamics::PlatformModel;
use whorl_dynamics::actuators::Kind;
use whorl_params::Reader;

use crate::kinds::{Device, KINDS, Role};

/// What only one device may use: a serial port, a coil of a relay board, a channel of a converter.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Address(pub String);

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// A device under the user's name.
#[derive(Debug, Clone)]
pub struct NamedDevice {
    /// The user's name.
    pub name: String,
    /// Name of its row in [`KINDS`].
    pub kind: &'static str,
    /// The device.
    pub device: Arc<dyn Device>,
}

/// The devices of one platform, in the order of the file.
#[derive(Debug, Clone, Default)]
pub struct DeviceList {
    /// All of them.
    pub devices: Vec<NamedDevice>,
    /// What a complete platform would need besides, in words.
    pub missing: Vec<String>,
}

impl PartialEq for DeviceList {
    /// Devices are what their parameters say, which is what they print.
    fn eq(&self, other: &Self) -> bool {
        format!("{self:?}") == format!("{other:?}")
    }
}

/// Reads the group `devices`. Every kind, address and name is checked, whichever backend the driver has.
pub fn read(r: &mut Reader<'_>, model: &PlatformModel) -> DeviceList {
    let mut list = DeviceList::default();
    for name in r.children("devices") {
        let device = r.group("devices", |r| r.group(&name, |r| read_one(r, model)));
        if let Some((kind, device)) = device {
            list.devices.push(NamedDevice { name, kind, device: Arc::from(device) });
        }
    }
    refuse_clashes(r, &list, model);
    let given: Vec<Role> = list.devices.iter().flat_map(|d| d.device.roles()).collect();
    let missing = needed(model).into_iter().filter(|role| !given.contains(role));
    list.missing = missing.map(|role| role.words(model)).collect();
    list
}

fn read_one(r: &mut Reader<'_>, model: &PlatformModel) -> Option<(&'static str, Box<dyn Device>)> {
    let names: Vec<&str> = KINDS.iter().map(|kind| kind.name).collect();
    let before = r.error_count();
    let name = r.choice("kind", &names, "what it is: a kind of device");
    // Without its kind, nobody knows which other keys are right.
    if r.error_count() > before {
        r.leave_group();
        return None;
    }
    let row = KINDS.iter().find(|kind| kind.name == name)?;
    Some((row.name, (row.read)(r, model)?))
}

/// What a platform cannot be without.
fn needed(model: &PlatformModel) -> Vec<Role> {
    let mut roles = vec![Role::Imu];
    for (kind, range) in Kind::ALL.into_iter().zip(model.actuators.motor_ranges()) {
        roles.extend((0..range.len()).map(|index| Role::Motor(kind, index)));
    }
    roles.extend((0..model.jets().len()).map(Role::Jet));
    roles
}

fn refuse_clashes(r: &mut Reader<'_>, list: &DeviceList, model: &PlatformModel) {
    for (index, later) in list.devices.iter().enumerate() {
        for earlier in list.devices.iter().take(index) {
            let taken = earlier.device.addresses();
            if let Some(address) = later.device.addresses().into_iter().find(|a| taken.contains(a)) {
                let problem = format!(
                    "{address} belongs to device {} already; allowed: an address of its own",
                    earlier.name
                );
                r.reject(&format!("devices.{}.kind", later.name), problem);
            }
            let given = earlier.device.roles();
            if let Some(role) = later.device.roles().into_iter().find(|role| given.contains(role)) {
                let words = role.words(model);
                let problem = format!(
                    "device {} gives the {words} already; allowed: one device for each",
                    earlier.name
                );
                r.reject(&format!("devices.{}.kind", later.name), problem);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_params::ParameterTree;

    const IMU: &str = "imu: {kind: vn100, port: /dev/a}";
    const WHEELS: &str = "wheels: {kind: smartmotor_chain, port: /dev/b, drive: current, full_scale_torque_n_m: 1.0, motors: \
         {wheel_x: {address: 1}, wheel_y: {address: 2}, wheel_z: {address: 3}}}";

    /// The list of these entries, or what is said of them.
    fn listed(entries: &[&str]) -> Result<DeviceList, String> {
        let lines: String = entries.iter().map(|entry| format!("      {entry}\n")).collect();
        let text = format!("/whorl_1/driver:\n  ros__parameters:\n    devices:\n{lines}");
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.yaml");
        std::fs::write(&file, text).unwrap();
        let tree = ParameterTree::load(&[file], &[]).unwrap();
        let model = PlatformModel::whorl_1_reference();
        let own = tree.for_node("/whorl_1/driver");
        whorl_params::read(&own, |r| read(r, &model))
            .map(|(list, _)| list)
            .map_err(|errors| errors.to_string())
    }

    #[test]
    fn a_list_says_what_a_platform_lacks() {
        let list = listed(&[IMU, WHEELS]).unwrap();
        assert_eq!(list.devices.len(), 2);
        assert_eq!(list.missing.first().map(String::as_str), Some("valve of jet_1"));
        assert_eq!(list.missing.len(), 12);
    }

    #[test]
    fn clashes_are_refused_with_the_line_and_the_other_device() {
        let two = listed(&[IMU, &WHEELS.replace("/dev/b", "/dev/a")]).unwrap_err();
        assert!(two.contains("a.yaml:5") && two.contains("/dev/a belongs to device imu"), "{two}");
        let twice = listed(&[IMU, "other: {kind: vn100, port: /dev/c}"]).unwrap_err();
        assert!(twice.contains("device imu gives the rate gyro and accelerometer already"), "{twice}");
        let address = listed(&[&WHEELS.replace("address: 3", "address: 2")]).unwrap_err();
        assert!(address.contains("wheel_y has this address already"), "{address}");
    }

    #[test]
    fn wrong_entries_say_what_is_allowed() {
        for (entry, said) in [
            ("imu: {kind: vn1000, port: /dev/a}", "vn100"),
            ("imu: {kind: vn100}", "port"),
            ("imu: {kind: vn100, prot: /dev/a}", "did you mean devices.imu.port"),
            ("imu: {kind: vn100, port: /dev/a, baud: 12345}", "921600"),
            ("imu: {kind: vn100, port: /dev/a, baud: 9600}", "at most 90 %"),
            ("v: {kind: modbus_relays, host: 10.0.0.1, coils: {jet_1: 0}}", "address:port"),
            ("v: {kind: modbus_relays, host: '10.0.0.1:502', coils: {jet_1: 0, jet_2: 2}}", "consecutive"),
            ("v: {kind: modbus_relays, host: '10.0.0.1:502', coils: {jet_99: 0}}", "jet_12"),
            ("a: {kind: iio_adc, folder: /sys, inputs: {oxygen: {channel: x, gain: 1.0}}}", "tank_pressure"),
            (
                "w: {kind: smartmotor_chain, port: /dev/b, motors: {wheel_x: {address: 1}}}",
                "torque_constant_n_m_a",
            ),
            (
                "w: {kind: smartmotor_chain, port: /dev/b, drive: current, full_scale_torque_n_m: 1.0}",
                "wheel_x, wheel_y",
            ),
            ("a: {kind: ros_imu, topic: imu/data}", "such as /imu/data"),
            ("a: {kind: ros_imu, topic: /imu, clock: mine}", "computer"),
            ("a: {kind: ros_pose, topic: /p, mean_of: 2}", "unknown"),
            ("a: {kind: ros_motors, command: /c, state: /s}", "wheel_x, wheel_y"),
            (
                "a: {kind: ros_motors, command: /c, state: /s, motors: {wheel_9: {sign: 1}}}",
                "wheel_x, wheel_y",
            ),
            ("a: {kind: ros_motors, command: /c, state: /s, motors: {wheel_y: {sign: 1}}}", "gaps"),
            (
                "a: {kind: ros_motors, command: /c, state: /s, motors: {wheel_x: {sign: 1}, wheel_y: {element: 0}}}",
                "wheel_x has element 0 already",
            ),
            ("a: {kind: ros_valves, command: /v, elements: {jet_1: 0, jet_2: 2}}", "without gaps"),
            ("a: {kind: ros_valves, command: /v, elements: {jet_99: 0}}", "jet_12"),
        ] {
            let text = listed(&[entry]).unwrap_err();
            assert!(text.contains(said) && text.contains("a.yaml"), "{entry}\n{text}");
        }
        let kind = listed(&["imu: {kind: vn1000, port: /dev/a}"]).unwrap_err();
        assert!(!kind.contains("unknown parameter"), "{kind}");
    }
}
