//! Computers on one radio link: network namespaces, each joined by a virtual cable to the air.

use std::fs::File;
use std::os::fd::AsFd;
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

use rustix::thread::{LinkNameSpaceType, move_into_link_name_space};

use super::relay::{Quality, Relay};

/// Hosts 10.77.0.1, 10.77.0.2 and so on. The namespaces go away on drop.
pub struct Lan {
    /// Namespaces of the hosts.
    pub hosts: Vec<String>,
    air: String,
    relay: Option<Relay>,
}

impl Lan {
    /// Builds them. `Err`: why this machine does not allow it.
    pub fn new(hosts: usize) -> Result<Self, String> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        if !super::is_root() {
            return Err("network namespaces need root".into());
        }
        let id = format!("{}_{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
        let name = |part: &str| format!("whorl_test_{id}_{part}");
        let hosts = (1..=hosts).map(|number| name(&number.to_string())).collect();
        let mut lan = Self { hosts, air: name("air"), relay: None };
        let air = lan.air.as_str();
        for namespace in lan.hosts.iter().chain([&lan.air]) {
            ip(&["netns", "add", namespace])?;
            ip(&["-n", namespace, "link", "set", "lo", "up"])?;
        }
        let mut ports = Vec::new();
        for (number, host) in (1..).zip(&lan.hosts) {
            let port = format!("port{number}");
            ip(&["-n", host, "link", "add", "radio", "type", "veth", "peer", "name", &port, "netns", air])?;
            ip(&["-n", air, "link", "set", &port, "up"])?;
            ip(&["-n", host, "addr", "add", &format!("10.77.0.{number}/24"), "dev", "radio"])?;
            ip(&["-n", host, "link", "set", "radio", "up"])?;
            ip(&["-n", host, "route", "add", "239.0.0.0/8", "dev", "radio"])?;
            ports.push(port);
        }
        lan.relay = Some(inside(air, || Relay::new(&ports))?);
        Ok(lan)
    }

    /// Changes all links of a host.
    pub fn set(&self, host: usize, change: impl Fn(&mut Quality)) {
        let Some(relay) = &self.relay else { return };
        for other in (0..self.hosts.len()).filter(|other| *other != host) {
            let mut quality = relay.get(host, other);
            change(&mut quality);
            relay.set(host, other, quality);
        }
    }

    /// Changes every link.
    pub fn set_all(&self, change: impl Fn(&mut Quality) + Copy) {
        (0..self.hosts.len()).for_each(|host| self.set(host, change));
    }

    /// Blocks all traffic to and from the last host. Interfaces stay up, so no program is notified.
    pub fn cut(&self) {
        self.set(self.hosts.len() - 1, |quality| quality.cut = true);
    }

    /// Ends the cut.
    pub fn restore(&self) {
        self.set(self.hosts.len() - 1, |quality| quality.cut = false);
    }

    /// Gives a host another address, as a new lease of DHCP does: the old one is taken away first.
    pub fn readdress(&self, host: usize, last_byte: u8) -> Result<(), String> {
        let host = &self.hosts[host];
        ip(&["-n", host, "addr", "flush", "dev", "radio"])?;
        ip(&["-n", host, "addr", "add", &format!("10.77.0.{last_byte}/24"), "dev", "radio"])?;
        // Went with the last address.
        ip(&["-n", host, "route", "replace", "239.0.0.0/8", "dev", "radio"])
    }

    /// Runs something on a host, from 0; threads that it starts stay there.
    pub fn on_host<T: Send>(&self, host: usize, work: impl FnOnce() -> T + Send) -> T {
        inside(&self.hosts[host], work)
    }
}

fn inside<T: Send>(namespace: &str, work: impl FnOnce() -> T + Send) -> T {
    let namespace = File::open(format!("/run/netns/{namespace}")).unwrap();
    std::thread::scope(|scope| {
        let thread = scope.spawn(|| {
            move_into_link_name_space(namespace.as_fd(), Some(LinkNameSpaceType::Network)).unwrap();
            work()
        });
        thread.join().unwrap()
    })
}

fn ip(arguments: &[&str]) -> Result<(), String> {
    let output =
        Command::new("ip").args(arguments).output().map_err(|e| format!("cannot run ip (iproute2): {e}"))?;
    if output.status.success() {
        return Ok(());
    }
    Err(format!("ip {}: {}", arguments.join(" "), String::from_utf8_lossy(&output.stderr).trim()))
}

impl Drop for Lan {
    fn drop(&mut self) {
        self.relay = None;
        for namespace in self.hosts.iter().chain([&self.air]) {
            let _ = ip(&["netns", "del", namespace]);
        }
    }
}
