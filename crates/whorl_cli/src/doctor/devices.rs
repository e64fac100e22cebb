//! The devices of a platform's list: whether they are there, and may be used.

use std::net::TcpStream;
use std::path::Path;
use std::time::{Duration, Instant};

use rustix::fs::Access;
use whorl_devices::{DeviceList, NamedDevice, Place};
use whorl_driver::parameters;
use whorl_launch::{Setup, SetupOptions};
use whorl_params::ParameterTree;
use whorl_ros::Participant;
use whorl_ros::environment::Network;

use super::Check;
use crate::run::this_domain;

const CONNECT: Duration = Duration::from_secs(1);
/// In what time nodes of the network are found.
const DISCOVERY: Duration = Duration::from_secs(4);

/// Every device.
pub(super) fn all(mut options: SetupOptions, platform: &str) -> anyhow::Result<Vec<Check>> {
    options.platforms = Some(vec![platform.to_owned()]);
    let setup = Setup::new(options)?;
    let tree = ParameterTree::load(&setup.driver_files(platform), &[])?;
    let own = tree.for_node(&format!("/{platform}/driver"));
    let list: DeviceList = whorl_params::try_read(&own, parameters::read)?.0.devices;
    let mut checks = Vec::new();
    if list.devices.is_empty() {
        let remedy = format!("devices in the driver's section of {platform}'s file (docs/hardware.md)");
        return Ok(vec![Check::warning("devices", format!("{platform} has no list"), remedy)]);
    }
    if !list.missing.is_empty() {
        let remedy = format!("an entry each in the driver's section of {platform}'s file");
        checks.push(Check::wrong("devices", format!("none for: {}", list.missing.join(", ")), remedy));
    }
    let place = Place { root: this_domain()?.emulated(platform), ..Place::default() };
    if let Some(root) = &place.root {
        checks.push(Check::good(
            "emulators",
            format!("run for {platform}: devices are looked for in {}", root.display()),
        ));
    }
    checks.extend(list.devices.iter().filter_map(|named| of_file(named, &place)));
    checks.extend(list.devices.iter().filter_map(|named| seen(named, &place)));
    checks.extend(list.devices.iter().filter_map(|named| of_host(named, &place)));
    checks.extend(of_topics(&list, &place)?);
    Ok(checks)
}

fn title(named: &NamedDevice) -> String {
    format!("device {}", named.name)
}

/// What the device itself can say about this computer.
fn seen(named: &NamedDevice, place: &Place) -> Option<Check> {
    let name = title(named);
    Some(match named.device.inspect(place)? {
        Ok(found) => Check::good(&name, found),
        Err(wrong) => Check::wrong(&name, wrong.found, wrong.remedy),
    })
}

/// A port or folder.
fn of_file(named: &NamedDevice, place: &Place) -> Option<Check> {
    let path = place.path(named.device.path()?);
    Some(file(&title(named), &path))
}

/// Whether a port may be read and written, or a folder read.
pub(super) fn file(name: &str, path: &Path) -> Check {
    let shown = path.display();
    if !path.exists() {
        let remedy = "plug it in; dmesg shows under which name, and packaging/udev gives it a lasting one";
        return Check::wrong(name, format!("{shown} is not there"), remedy);
    }
    let needed = if path.is_dir() { Access::READ_OK } else { Access::READ_OK | Access::WRITE_OK };
    match rustix::fs::access(path, needed) {
        Ok(()) => Check::good(name, format!("{shown} can be opened")),
        Err(_) => {
            let remedy = "sudo usermod -aG dialout $USER, and log in again (packaging/udev sets the group)";
            Check::wrong(name, format!("{shown}: no permission"), remedy)
        }
    }
}

/// A board on the network.
fn of_host(named: &NamedDevice, place: &Place) -> Option<Check> {
    let host = named.device.host()?;
    let name = title(named);
    let address = match place.host(host) {
        Ok(address) => address,
        Err(error) => {
            let remedy = "write its address as number:port, or start the emulators";
            return Some(Check::wrong(&name, format!("{host}: {error}"), remedy));
        }
    };
    let began = Instant::now();
    Some(match TcpStream::connect_timeout(&address, CONNECT) {
        Ok(_) => {
            let ms = began.elapsed().as_secs_f64() * 1e3;
            Check::good(&name, format!("{host} answers within {ms:.1} ms"))
        }
        Err(error) => {
            let remedy =
                format!("ping {}; is it powered, on this network, and its port right?", address.ip());
            Check::wrong(&name, format!("{host}: {error}"), remedy)
        }
    })
}

/// Topics of other nodes.
fn of_topics(list: &DeviceList, place: &Place) -> anyhow::Result<Vec<Check>> {
    let wanted: Vec<(String, String, bool)> = list
        .devices
        .iter()
        .flat_map(|named| {
            let topics = named.device.topics().into_iter();
            topics.map(|topic| (title(named), place.topic(&topic.name), topic.is_read))
        })
        .collect();
    if wanted.is_empty() {
        return Ok(Vec::new());
    }
    let network = Network::from_environment()?;
    let participant = Participant::new(&network)?;
    let until = Instant::now() + DISCOVERY;
    loop {
        let (writers, readers) = (participant.discovered_writers(), participant.discovered_readers());
        let found = |topic: &String, is_read: bool| {
            let all = if is_read { &writers } else { &readers };
            all.iter().any(|endpoint| endpoint.topic().as_ref() == Some(topic))
        };
        let done = wanted.iter().all(|(_, topic, is_read)| found(topic, *is_read));
        if done || Instant::now() > until {
            let check = |(name, topic, is_read): &(String, String, bool)| {
                let does = if *is_read { "publishes" } else { "subscribes to" };
                if found(topic, *is_read) {
                    return Check::good(name, format!("a node {does} {topic}"));
                }
                let remedy = "start its driver; ros2 topic list shows names; ROS_DOMAIN_ID and ROS_AUTOMATIC_DISCOVERY_RANGE are as above";
                Check::wrong(name, format!("no node {does} {topic}"), remedy)
            };
            return Ok(wanted.iter().map(check).collect());
        }
        std::thread::sleep(Duration::from_millis(100));
    }
}
