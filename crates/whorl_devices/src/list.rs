//! The devices of a platform, from its parameter file.

use std::sync::Arc;

use whorl_dynamics::PlatformModel;
use whorl_dynamics::actuators::Kind;
use whorl_params::Reader;

use crate::device::{Device, NamedDevice, Role};
use crate::kinds::KINDS;
use crate::logical::{self, ImuSetup};

/// The devices of one platform, in the order of the file.
#[derive(Debug, Clone, Default)]
pub struct DeviceList {
    /// All of them.
    pub devices: Vec<NamedDevice>,
    /// The inertial sensor, where several devices make it together.
    pub imu: Option<ImuSetup>,
    /// What a complete platform would need besides, in words.
    pub missing: Vec<String>,
}

impl PartialEq for DeviceList {
    /// Devices are what their parameters say, which is what they print.
    fn eq(&self, other: &Self) -> bool {
        format!("{self:?}") == format!("{other:?}")
    }
}

/// Reads the groups `devices` and `logical`. Every kind, address and name is checked, whichever backend the driver has.
pub fn read(r: &mut Reader<'_>, model: &PlatformModel) -> DeviceList {
    let mut list = DeviceList::default();
    for name in r.children("devices") {
        let device = r.group("devices", |r| r.group(&name, |r| read_one(r, model)));
        if let Some((kind, device)) = device {
            list.devices.push(NamedDevice { name, kind, device: Arc::from(device) });
        }
    }
    list.imu = logical::read(r, &list.devices, model);
    refuse_clashes(r, &list, model);
    refuse_lone_axes(r, &list);
    let mut given: Vec<Role> = list.devices.iter().flat_map(|d| d.device.roles()).collect();
    if list.imu.is_some() {
        given.push(Role::Imu);
    }
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
            // Members of one sensor give the same quantities, and their temperature: the first one's counts.
            let together = list.has_members(&[&earlier.name, &later.name]);
            let is_shared = |role: &Role| {
                *role == Role::InertialAxes || together && matches!(role, Role::Imu | Role::Temperature)
            };
            let mut roles = later.device.roles().into_iter();
            if let Some(role) = roles.find(|role| given.contains(role) && !is_shared(role)) {
                let words = role.words(model);
                let also = match role {
                    Role::Imu => ", or both in logical.imu.of",
                    Role::Direction => "; of sensors that vote only one may be the vector sensor",
                    _ => "",
                };
                let problem = format!(
                    "device {} gives the {words} already; allowed: one device for each{also}",
                    earlier.name
                );
                r.reject(&format!("devices.{}.kind", later.name), problem);
            }
        }
    }
}

/// What measures single axes is of no use by itself; and beside a logical sensor there is no other.
fn refuse_lone_axes(r: &mut Reader<'_>, list: &DeviceList) {
    for named in &list.devices {
        let roles = named.device.roles();
        let is_lone = roles.contains(&Role::InertialAxes) && !list.has_members(&[&named.name]);
        let is_beside = list.imu.is_some() && roles.contains(&Role::Imu) && !list.has_members(&[&named.name]);
        if is_lone && list.imu.is_none() && r.has("logical") {
            // What is wrong with the logical sensor has been said.
            continue;
        }
        if is_lone || is_beside {
            let problem = "it is no part of the inertial sensor; allowed: its name in logical.imu.of";
            r.reject(&format!("devices.{}.kind", named.name), problem);
        }
    }
}

impl DeviceList {
    /// Whether all of these are members of the logical inertial sensor.
    fn has_members(&self, names: &[&str]) -> bool {
        let is_member = |name: &&str| {
            self.imu.as_ref().is_some_and(|imu| imu.members.iter().any(|member| member.name == **name))
        };
        names.iter().all(is_member)
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
        listed_with(entries, "")
    }

    /// The same with a line of the group `logical`.
    fn listed_with(entries: &[&str], logical: &str) -> Result<DeviceList, String> {
        let lines: String = entries.iter().map(|entry| format!("      {entry}\n")).collect();
        let logical =
            if logical.is_empty() { String::new() } else { format!("    logical:\n      {logical}\n") };
        let text = format!("/whorl_1/driver:\n  ros__parameters:\n    devices:\n{lines}{logical}");
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

    const CIA402: &str =
        "w: {kind: cia402_motors, bus: can0, rated_torque_n_m: 0.2, motors: {wheel_x: {node: 1}}}";

    #[test]
    fn devices_of_one_bus_have_identifiers_of_their_own() {
        // Two that say SYNC, on one bus and on two.
        let second = CIA402.replace("w:", "v:").replace("wheel_x: {node: 1}", "wheel_y: {node: 2}");
        let clash = listed(&[CIA402, &second]).unwrap_err();
        assert!(clash.contains("identifier 0x000 on can0 belongs to device w already"), "{clash}");
        listed(&[CIA402, &second.replace("can0", "can1")]).unwrap();
        // 0x181 is what node 1 of the one says, and the heartbeat of node 12 of the other; 0x1A1 is nobody else's.
        let other =
            |node| format!("v: {{kind: odrive_motors, bus: can0, motors: {{wheel_y: {{node: {node}}}}}}}");
        let clash = listed(&[CIA402, &other(12)]).unwrap_err();
        assert!(clash.contains("identifier 0x181 on can0 belongs to device w already"), "{clash}");
        listed(&[CIA402, &other(13)]).unwrap();
    }

    const AXES: &str = "gyros: {kind: iio_inertial, folder: /sys/a, inputs: \
         {x: {channel: in_anglvel_x, axis: [1.0, 0.0, 0.0]}, y: {channel: in_anglvel_y, axis: [0.0, 1.0, 0.0]}}}";

    #[test]
    fn several_devices_make_one_sensor() {
        let second = "imu_2: {kind: vn100, port: /dev/c, magnetometer_is_vector_sensor: false}";
        let list = listed_with(&[IMU, second, AXES, WHEELS], "imu: {of: [imu, imu_2, gyros]}").unwrap();
        assert_eq!(list.missing.len(), 12, "{:?}", list.missing);
        assert_eq!(list.imu.unwrap().members.len(), 3);
    }

    #[test]
    fn wrong_logical_sensors_are_refused_with_line_and_reason() {
        let second = "imu_2: {kind: vn100, port: /dev/c, magnetometer_is_vector_sensor: false}";
        let third = "imu_3: {kind: vn100, port: /dev/d}";
        for (entries, logical, said) in [
            (vec![IMU, second], "", "or both in logical.imu.of"),
            (vec![IMU, second], "imu: {of: [imu, imu_9]}", "there is no device imu_9; allowed: imu, imu_2"),
            (vec![IMU, second], "imu: {of: [imu, imu, imu_2]}", "imu is named twice"),
            (vec![IMU, WHEELS], "imu: {of: [imu, wheels]}", "wheels measures neither"),
            (vec![IMU, second], "imu: {of: [imu]}", "no part of the inertial sensor"),
            (vec![IMU, third], "imu: {of: [imu, imu_3]}", "only one may be the vector sensor"),
            (vec![AXES], "", "no part of the inertial sensor"),
            (vec![AXES], "imu: {of: [gyros]}", "do not measure angular rate along every direction"),
            (vec![IMU, second], "imu: {of: [imu, imu_2], disagreement_rad_s: 0.0}", "disagreement_rad_s"),
        ] {
            let text = listed_with(&entries, logical).unwrap_err();
            assert!(text.contains(said) && text.contains("a.yaml"), "{logical}\n{text}");
        }
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
            ("w: {kind: cia402_motors, bus: can0, motors: {wheel_x: {node: 1}}}", "rated_torque_n_m"),
            (&CIA402.replace("can0", "'tcp:somewhere'"), "tcp:HOST:PORT"),
            (&CIA402.replace("can0", "an_interface_so_long"), "the name of an interface"),
            (&CIA402.replace("node: 1", "node: 127"), "126"),
            (&CIA402.replace("wheel_x", "wheel_9"), "wheel_x, wheel_y"),
            (
                &CIA402.replace("wheel_x: {node: 1}", "wheel_x: {node: 1}, wheel_y: {node: 1}"),
                "wheel_x has this node",
            ),
            (&CIA402.replace("bus:", "bit_rate: 123456, bus:"), "250000"),
            (
                &CIA402.replace("bus:", "bit_rate: 50000, bus:").replace("1}", "1}, wheel_y: {node: 2}"),
                "at most 70 %",
            ),
            (&CIA402.replace("bus:", "watchdog_s: 0.01, bus:"), "0.05"),
            (&CIA402.replace("0.2,", "1.0e-3,"), "more than can be asked for"),
            (&CIA402.replace("wheel_x: {node: 1}", ""), "drives nothing"),
            ("w: {kind: odrive_motors, bus: can0, motors: {wheel_x: {node: 63}}}", "62"),
            (
                "w: {kind: odrive_motors, bus: can0, rated_torque_n_m: 1.0, motors: {wheel_x: {node: 1}}}",
                "unknown",
            ),
            ("v: {kind: valves_gpio, lines: {jet_1: 17}}", "chip"),
            ("v: {kind: valves_gpio, chip: /dev/gpiochip0}", "lines.<jet>"),
            ("v: {kind: valves_gpio, chip: /dev/gpiochip0, lines: {jet_99: 17}}", "jet_12"),
            (
                "v: {kind: valves_gpio, chip: /dev/gpiochip0, lines: {jet_1: 17, jet_2: 17}}",
                "jet_1 has number 17",
            ),
            ("v: {kind: valves_gpio, chip: /dev/gpiochip0, lines: {jet_1: -1}}", "65535"),
            (
                "v: {kind: valves_gpio, chip: /dev/gpiochip0, lines: {jet_1: 17}, heartbeat_line: 17}",
                "works a valve",
            ),
            (
                "v: {kind: valves_gpio, chip: /dev/gpiochip0, lines: {jet_1: 1}, emergency_stop_line: 1}",
                "an output",
            ),
            ("v: {kind: valves_gpio, chip: /dev/gpiochip0, lines: {jet_1: 1}, watchdog_s: 0.05}", "0.15"),
            ("a: {kind: hwmon, folder: /sys}", "bus_voltage, bus_current, temperature"),
            (
                "a: {kind: hwmon, folder: /sys, inputs: {oxygen: {channel: in1}}}",
                "bus_voltage, bus_current, temperature",
            ),
            ("a: {kind: hwmon, folder: /sys, inputs: {bus_voltage: {channel: curr1}}}", "such as in1"),
            ("a: {kind: hwmon, folder: /sys, inputs: {bus_voltage: {channel: in1_input}}}", "such as in1"),
            ("a: {kind: hwmon, folder: /sys, inputs: {bus_voltage: {channel: in1, gain: 0.0}}}", "but 0"),
            ("a: {kind: hwmon, folder: /sys, inputs: {bus_current: {channel: curr1}}}", "inputs.bus_voltage"),
            ("a: {kind: iio_inertial, folder: /sys}", "measures nothing"),
            (
                "a: {kind: iio_inertial, folder: /sys, inputs: {x: {channel: in_voltage0, axis: [1.0, 0.0, 0.0]}}}",
                "gain",
            ),
            (
                "a: {kind: iio_inertial, folder: /sys, inputs: {x: {channel: in_temp0, axis: [1.0, 0.0, 0.0]}}}",
                "in_anglvel",
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
