//! Whether this computer's addresses have changed since the network was joined. DDS announces the addresses that it finds
//! when it joins, and RustDDS never looks again: after a new lease of DHCP, or on another network, nobody could reach the
//! node. The kernel tells of changes (`rtnetlink(7)`), so that watching costs nothing.

use std::net::Ipv4Addr;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::time::Duration;

use rustix::io::Errno;
use rustix::net::netlink::SocketAddrNetlink;
use rustix::net::{AddressFamily, RecvFlags, SocketFlags, SocketType, bind, recv, socket_with};

use crate::environment::{InterfaceAddress, Network, interface_addresses};
use crate::error::RosError;

/// Group of messages on IPv4 addresses: `RTMGRP_IPV4_IFADDR` of `linux/rtnetlink.h`.
const ADDRESSES: u32 = 0x10;
/// An address is taken away and another given in several steps: wait for the end.
const SETTLE: Duration = Duration::from_secs(1);

/// Watches the addresses of this computer.
#[derive(Debug)]
pub struct AddressWatch {
    socket: OwnedFd,
    network: Network,
    /// Those with which the network was joined.
    joined: Vec<InterfaceAddress>,
    check_at: Option<Duration>,
}

impl AddressWatch {
    /// From now on; `None` on a network of this machine only, whose address never changes.
    ///
    /// # Errors
    /// When the operating system refuses.
    pub fn new(network: &Network) -> Result<Option<Self>, RosError> {
        if network.is_localhost() {
            return Ok(None);
        }
        let error = |e: Errno| RosError::io("watching the addresses of this computer")(e.into());
        let flags = SocketFlags::NONBLOCK | SocketFlags::CLOEXEC;
        // The first protocol, NETLINK_ROUTE, is number 0: the default.
        let socket = socket_with(AddressFamily::NETLINK, SocketType::RAW, flags, None).map_err(error)?;
        bind(&socket, &SocketAddrNetlink::new(0, ADDRESSES)).map_err(error)?;
        let joined = own(network, interface_addresses());
        Ok(Some(Self { socket, network: network.clone(), joined, check_at: None }))
    }

    /// Takes what the kernel has told, and returns the network to join anew at monotonic time `now` if the addresses with which
    /// it was joined are no longer those of this computer.
    ///
    /// # Errors
    /// When the interface that was asked for (`WHORL_INTERFACE`) is not there any more.
    pub fn changed(&mut self, now: Duration) -> Result<Option<Network>, RosError> {
        let mut buffer = [0_u8; 4096];
        // An error tells of changes too: of more than the buffer holds.
        while !matches!(recv(&self.socket, &mut buffer, RecvFlags::empty()), Err(Errno::AGAIN)) {
            self.check_at = Some(now + SETTLE);
        }
        if self.check_at.is_none_or(|at| now < at) {
            return Ok(None);
        }
        self.check_at = None;
        let all = interface_addresses();
        let present = own(&self.network, all.clone());
        if !must_rejoin(&self.joined, &present) {
            return Ok(None);
        }
        self.network = self.network.with_addresses(&all)?;
        self.joined = present;
        Ok(Some(self.network.clone()))
    }
}

impl AsFd for AddressWatch {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}

impl AsRawFd for AddressWatch {
    fn as_raw_fd(&self) -> i32 {
        self.socket.as_raw_fd()
    }
}

/// The addresses at which the network can be reached from other computers.
fn own(network: &Network, mut all: Vec<InterfaceAddress>) -> Vec<InterfaceAddress> {
    all.retain(|a| a.address != Ipv4Addr::LOCALHOST && network.uses(a));
    all
}

/// Whether an interface has another address than when the network was joined, or all that was joined with is gone and there is
/// something else. Interfaces that only come or only go (of containers, of a tunnel) change nothing: joining anew interrupts
/// the node.
fn must_rejoin(joined: &[InterfaceAddress], present: &[InterfaceAddress]) -> bool {
    let left = |a: &&InterfaceAddress| !present.contains(a);
    let new = |a: &&InterfaceAddress| !joined.contains(a);
    let replaced = present.iter().filter(new).any(|new| {
        let mut before = joined.iter().filter(|old| old.name == new.name).peekable();
        before.peek().is_some() && before.all(|old| left(&old))
    });
    let nothing_left = joined.iter().all(|old| left(&old)) && present.iter().any(|a| new(&a));
    replaced || nothing_left
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(name: &str, last: u8) -> InterfaceAddress {
        InterfaceAddress { name: name.into(), address: Ipv4Addr::new(192, 168, 1, last) }
    }

    #[test]
    fn only_a_lost_address_with_something_in_its_place_makes_a_node_rejoin() {
        let wlan = at("wlan0", 7);
        let docker = at("docker0", 200);
        for (what, joined, present, expected) in [
            ("nothing", vec![wlan.clone()], vec![wlan.clone()], false),
            ("another lease", vec![wlan.clone()], vec![at("wlan0", 8)], true),
            (
                "another lease beside a bridge",
                vec![wlan.clone(), docker.clone()],
                vec![at("wlan0", 8), docker.clone()],
                true,
            ),
            ("unplugged", vec![wlan.clone()], vec![], false),
            ("plugged in elsewhere", vec![wlan.clone()], vec![at("eth0", 9)], true),
            ("joined before there was a network", vec![], vec![wlan.clone()], true),
            ("a bridge came", vec![wlan.clone()], vec![wlan.clone(), docker.clone()], false),
            ("a bridge went", vec![wlan.clone(), docker.clone()], vec![wlan.clone()], false),
            (
                "a second address of the same interface",
                vec![wlan.clone()],
                vec![wlan.clone(), at("wlan0", 8)],
                false,
            ),
        ] {
            assert_eq!(must_rejoin(&joined, &present), expected, "{what}");
        }
    }

    #[test]
    fn this_machine_alone_is_not_watched() {
        assert!(AddressWatch::new(&Network::localhost(0)).unwrap().is_none());
    }
}
