//! Two computers on one radio link: network namespaces joined by a bridge whose port can be unplugged.

use std::fs::File;
use std::os::fd::AsFd;
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

use rustix::thread::{LinkNameSpaceType, move_into_link_name_space};

/// Two hosts, 10.77.0.1 and 10.77.0.2. The namespaces go away on drop.
pub struct Lan {
    /// Namespaces of the two hosts.
    pub hosts: [String; 2],
    air: String,
}

impl Lan {
    /// Builds them. `Err`: why this machine does not let us.
    pub fn new() -> Result<Self, String> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        if !super::is_root() {
            return Err("network namespaces need root".into());
        }
        let id = format!("{}_{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
        let name = |part: &str| format!("whorl_test_{id}_{part}");
        let lan = Self { hosts: [name("1"), name("2")], air: name("air") };
        let air = lan.air.as_str();
        for namespace in lan.hosts.iter().chain([&lan.air]) {
            ip(&["netns", "add", namespace])?;
            ip(&["-n", namespace, "link", "set", "lo", "up"])?;
        }
        ip(&["-n", air, "link", "add", "air", "type", "bridge"])?;
        ip(&["-n", air, "link", "set", "air", "up"])?;
        for (host, number) in lan.hosts.iter().zip(["1", "2"]) {
            let port = port(number);
            ip(&["-n", host, "link", "add", "radio", "type", "veth", "peer", "name", &port, "netns", air])?;
            ip(&["-n", air, "link", "set", &port, "up", "master", "air"])?;
            ip(&["-n", host, "addr", "add", &format!("10.77.0.{number}/24"), "dev", "radio"])?;
            ip(&["-n", host, "link", "set", "radio", "up"])?;
            ip(&["-n", host, "route", "add", "239.0.0.0/8", "dev", "radio"])?;
        }
        Ok(lan)
    }

    /// Lets nothing pass any more. The hosts do not notice: their interfaces stay up.
    pub fn cut(&self) {
        ip(&["-n", &self.air, "link", "set", &port("2"), "nomaster"]).unwrap();
    }

    /// Ends the cut.
    pub fn restore(&self) {
        ip(&["-n", &self.air, "link", "set", &port("2"), "master", "air"]).unwrap();
    }

    /// Runs something on a host (0 or 1); threads that it starts stay there.
    pub fn on_host<T: Send>(&self, host: usize, work: impl FnOnce() -> T + Send) -> T {
        let namespace = File::open(format!("/run/netns/{}", self.hosts[host])).unwrap();
        std::thread::scope(|scope| {
            let thread = scope.spawn(|| {
                move_into_link_name_space(namespace.as_fd(), Some(LinkNameSpaceType::Network)).unwrap();
                work()
            });
            thread.join().unwrap()
        })
    }
}

fn port(number: &str) -> String {
    format!("port{number}")
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
        for namespace in self.hosts.iter().chain([&self.air]) {
            let _ = ip(&["netns", "del", namespace]);
        }
    }
}
