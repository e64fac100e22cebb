//! ROS 2's network.

use whorl_ros::environment::{Network, interface_addresses};
use whorl_security::policy::OPERATOR;

use super::Check;
use super::machine::Machine;

const NAME: &str = "network";
/// Receive buffer that a formation's traffic needs \[bytes\].
const BUFFER: f64 = 512.0 * 1024.0;

/// Variables, interfaces, buffers.
pub(super) fn all(machine: &Machine) -> Vec<Check> {
    let mut checks = Vec::new();
    let network = match Network::from_environment() {
        Ok(network) => network,
        Err(error) => return vec![Check::wrong(NAME, error.to_string(), "set the variable, or unset it")],
    };
    let domain = network.domain_id;
    if network.is_localhost() {
        checks.push(Check::warning(
            NAME,
            format!("ROS domain {domain}, this computer only"),
            "platforms on other computers: export ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET on all of them",
        ));
    } else {
        let used: Vec<String> = interface_addresses()
            .iter()
            .filter(|address| !address.address.is_loopback() && network.uses(address))
            .map(|address| format!("{} {}", address.name, address.address))
            .collect();
        checks.push(if used.is_empty() {
            let remedy = "plug the network in, or ip addr; WHORL_INTERFACE chooses an interface";
            Check::wrong(NAME, format!("ROS domain {domain}: no interface has an address"), remedy)
        } else {
            Check::good(NAME, format!("ROS domain {domain} on {}", used.join(", ")))
        });
        checks.extend(wireless(&machine.text("/proc/net/wireless").unwrap_or_default(), machine));
    }
    match network.secured(OPERATOR) {
        Ok(network) if network.enclave.is_some() => checks.push(Check::good("security", "keys are there")),
        Ok(_) => checks.push(Check::warning(
            "security",
            "open: whoever is on this network can command the platforms",
            "whorl security create, and ROS_SECURITY_ENABLE=true (docs/security.md)",
        )),
        Err(error) => checks.push(Check::wrong("security", error.to_string(), "whorl security check")),
    }
    checks.push(buffer(machine));
    checks
}

/// The largest receive buffer that a program may have.
pub(super) fn buffer(machine: &Machine) -> Check {
    let name = "receive buffers";
    let remedy =
        format!("sysctl -w net.core.rmem_max={BUFFER}, and the same line in /etc/sysctl.d/60-whorl.conf");
    match machine.number("/proc/sys/net/core/rmem_max") {
        None => Check::unknown(name, "the kernel does not say", remedy),
        Some(bytes) if bytes < BUFFER => {
            let found = format!("at most {:.0} kB: bursts of messages are lost", bytes / 1024.0);
            Check::warning(name, found, remedy)
        }
        Some(bytes) => Check::good(name, format!("up to {:.0} kB", bytes / 1024.0)),
    }
}

/// From `/proc/net/wireless`: two lines of heading, then an interface each; the third number is the quality of the link. Radios that save power
/// add a tenth of a second now and then.
pub(super) fn wireless(text: &str, machine: &Machine) -> Vec<Check> {
    let interfaces = text.lines().skip(2).filter_map(|line| Some(line.split_once(':')?.0.trim().to_owned()));
    interfaces
        .filter_map(|interface| {
            let answer = (machine.run)("iw", &["dev", &interface, "get", "power_save"])?;
            let name = format!("radio {interface}");
            let remedy = format!("iw dev {interface} set power_save off");
            Some(match answer.trim().rsplit(' ').next() {
                Some("off") => Check::good(&name, "does not save power"),
                Some("on") => Check::warning(&name, "saves power: messages are up to 0.1 s late", remedy),
                _ => Check::unknown(&name, "does not say whether it saves power", remedy),
            })
        })
        .collect()
}
