//! ROS 2's environment variables, and which network they choose.
//!
//! `ros2-client` reads none of them, so that they are read here:
//! <https://docs.ros.org/en/jazzy/Tutorials/Advanced/Improved-Dynamic-Discovery.html>

use std::net::{IpAddr, Ipv4Addr};
use std::path::PathBuf;
use std::time::Duration;

use thiserror::Error;

use crate::security::{self, Choice, SecurityRefusal};

/// How long a node may take to be found and to answer: three announcements of a participant of another system, which announces
/// itself every 3 s.
const PATIENCE: Duration = Duration::from_secs(10);
/// The same where keys are exchanged first: RustDDS announces a participant every 10 s and repeats a message of a handshake
/// once a second, ten times; on a busy computer the first announcement may be lost.
const PATIENCE_SECURED: Duration = Duration::from_secs(30);

/// An environment variable with an invalid value.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum EnvironmentError {
    /// Not 0 to 232.
    #[error(
        "ROS_DOMAIN_ID={value} is not a whole number from 0 to 232: the UDP ports of a higher domain \
         would exceed 65535"
    )]
    Domain {
        /// What it is set to.
        value: String,
    },
    /// Not a discovery range of ROS 2.
    #[error("ROS_AUTOMATIC_DISCOVERY_RANGE={value} is none of LOCALHOST, SUBNET, OFF, SYSTEM_DEFAULT")]
    Range {
        /// What it is set to.
        value: String,
    },
    /// Discovery is off.
    #[error(
        "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF: the nodes of Whorl would find neither each other nor any \
         peer. Use LOCALHOST (this machine) or SUBNET (this network)"
    )]
    Off,
    /// Not 0 or 1.
    #[error("ROS_LOCALHOST_ONLY={value} is neither 0 nor 1")]
    LocalhostOnly {
        /// What it is set to.
        value: String,
    },
    /// Not an IPv4 address.
    #[error("ROS_STATIC_PEERS: `{value}` is not an IPv4 address (addresses are separated by `;`)")]
    Peer {
        /// The part that is wrong.
        value: String,
    },
    /// No such interface.
    #[error(
        "WHORL_INTERFACE: `{value}` is neither an interface nor an IPv4 address of this machine ({known})"
    )]
    Interface {
        /// The part that is wrong.
        value: String,
        /// The interfaces that exist.
        known: String,
    },
}

/// Which network DDS uses.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Network {
    /// DDS domain, 0 to 232.
    pub domain_id: u16,
    /// Interfaces by address; `None` for all.
    pub interfaces: Option<Vec<IpAddr>>,
    /// What `WHORL_INTERFACE` says, to be looked up again when addresses change.
    pub chosen: Option<String>,
    /// Machines to which we announce ourselves by unicast.
    pub static_peers: Vec<Ipv4Addr>,
    /// Folder of the keys with which we take part; `None` where the network is open.
    pub enclave: Option<PathBuf>,
}

/// An IPv4 address of this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InterfaceAddress {
    /// Interface name.
    pub name: String,
    /// Its address.
    pub address: Ipv4Addr,
}

impl InterfaceAddress {
    /// Whether this is its interface's name, or it.
    fn is(&self, part: &str) -> bool {
        self.name == part || self.address.to_string() == part
    }
}

impl Network {
    /// This machine only.
    #[must_use]
    pub fn localhost(domain_id: u16) -> Self {
        Self {
            domain_id,
            interfaces: Some(vec![Ipv4Addr::LOCALHOST.into()]),
            chosen: None,
            static_peers: Vec::new(),
            enclave: None,
        }
    }

    /// Reads the environment of this process.
    ///
    /// # Errors
    /// [`EnvironmentError`].
    pub fn from_environment() -> Result<Self, EnvironmentError> {
        Self::from_variables(|name| std::env::var(name).ok(), &interface_addresses())
    }

    /// As [`Self::from_environment`], from any source of variables.
    ///
    /// # Errors
    /// [`EnvironmentError`].
    pub fn from_variables(
        variable: impl Fn(&str) -> Option<String>,
        addresses: &[InterfaceAddress],
    ) -> Result<Self, EnvironmentError> {
        let set = |name| variable(name).map(|v| v.trim().to_owned()).filter(|v| !v.is_empty());
        let domain_id = match set("ROS_DOMAIN_ID") {
            None => 0,
            Some(value) => match value.parse() {
                Ok(id @ 0..=232) => id,
                _ => return Err(EnvironmentError::Domain { value }),
            },
        };
        let range = set("ROS_AUTOMATIC_DISCOVERY_RANGE");
        let by_range = match range.as_deref() {
            None | Some("SYSTEM_DEFAULT" | "LOCALHOST") => true,
            Some("SUBNET") => false,
            Some("OFF") => return Err(EnvironmentError::Off),
            Some(_) => return Err(EnvironmentError::Range { value: range.unwrap_or_default() }),
        };
        let localhost = match set("ROS_LOCALHOST_ONLY") {
            None => by_range,
            Some(value) if value == "1" => true,
            Some(value) if value == "0" => match range {
                // Many setups set `0`; it does not widen the range when one is given.
                Some(_) => by_range,
                None => false,
            },
            Some(value) => return Err(EnvironmentError::LocalhostOnly { value }),
        };
        if localhost {
            return Ok(Self::localhost(domain_id));
        }
        let static_peers = set("ROS_STATIC_PEERS")
            .unwrap_or_default()
            .split(';')
            .map(str::trim)
            .filter(|peer| !peer.is_empty())
            .map(|peer| peer.parse().map_err(|_| EnvironmentError::Peer { value: peer.to_owned() }))
            .collect::<Result<_, _>>()?;
        let chosen = set("WHORL_INTERFACE");
        Self { domain_id, interfaces: None, chosen, static_peers, enclave: None }.with_addresses(addresses)
    }

    /// The same network with other addresses of this machine.
    ///
    /// # Errors
    /// [`EnvironmentError::Interface`].
    pub fn with_addresses(&self, addresses: &[InterfaceAddress]) -> Result<Self, EnvironmentError> {
        let chosen = self.chosen.as_ref().map(|chosen| choose_interfaces(chosen, addresses));
        let interfaces = if self.is_localhost() { self.interfaces.clone() } else { chosen.transpose()? };
        Ok(Self { interfaces, ..self.clone() })
    }

    /// Whether traffic may pass this address.
    #[must_use]
    pub fn uses(&self, address: &InterfaceAddress) -> bool {
        self.chosen.as_ref().is_none_or(|chosen| parts(chosen).any(|part| address.is(part)))
    }

    /// With the keys that the environment of this process asks for: those of `enclave`, unless
    /// `ROS_SECURITY_ENCLAVE_OVERRIDE` names another. Says on stderr when security was asked for, but is permitted to be off.
    ///
    /// # Errors
    /// [`SecurityRefusal`].
    pub fn secured(self, enclave: &str) -> Result<Self, SecurityRefusal> {
        let variable = |name: &str| std::env::var(name).ok();
        let folder = match security::choose(variable, enclave, cfg!(feature = "security"))? {
            Choice::Open => None,
            Choice::Enclave(folder) => Some(folder),
            Choice::Permitted(refusal) => {
                tracing::warn!(
                    target: "whorl",
                    "WITHOUT SECURITY, which ROS_SECURITY_STRATEGY permits (Enforce does not): {refusal}"
                );
                None
            }
        };
        Ok(Self { enclave: folder, ..self })
    }

    /// How long a node may take to be found and to answer.
    #[must_use]
    pub fn patience(&self) -> Duration {
        if self.enclave.is_some() { PATIENCE_SECURED } else { PATIENCE }
    }

    /// Whether all traffic stays on this machine.
    #[must_use]
    pub fn is_localhost(&self) -> bool {
        self.interfaces.as_ref().is_some_and(|list| list.iter().all(IpAddr::is_loopback))
    }
}

/// Names and addresses, separated by commas.
fn parts(chosen: &str) -> impl Iterator<Item = &str> {
    chosen.split(',').map(str::trim).filter(|part| !part.is_empty())
}

fn choose_interfaces(chosen: &str, addresses: &[InterfaceAddress]) -> Result<Vec<IpAddr>, EnvironmentError> {
    let mut interfaces = Vec::new();
    for part in parts(chosen) {
        let before = interfaces.len();
        interfaces.extend(addresses.iter().filter(|a| a.is(part)).map(|a| IpAddr::from(a.address)));
        if interfaces.len() == before {
            let known = addresses.iter().map(|a| format!("{} {}", a.name, a.address)).collect::<Vec<_>>();
            return Err(EnvironmentError::Interface { value: part.to_owned(), known: known.join(", ") });
        }
    }
    Ok(interfaces)
}

/// The IPv4 addresses of this machine, as reported by the operating system.
#[must_use]
pub fn interface_addresses() -> Vec<InterfaceAddress> {
    netdev::get_interfaces()
        .into_iter()
        .flat_map(|interface| {
            let name = interface.name.clone();
            interface
                .ipv4
                .into_iter()
                .map(move |net| InterfaceAddress { name: name.clone(), address: net.addr() })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn network(variables: &[(&str, &str)]) -> Result<Network, EnvironmentError> {
        let wlan = InterfaceAddress { name: "wlan0".into(), address: Ipv4Addr::new(192, 168, 1, 7) };
        let wired = InterfaceAddress { name: "eth0".into(), address: Ipv4Addr::new(10, 0, 0, 7) };
        Network::from_variables(
            |name| variables.iter().find(|(n, _)| *n == name).map(|(_, v)| (*v).to_owned()),
            &[wlan, wired],
        )
    }

    #[test]
    fn nothing_set_means_loopback_and_domain_zero() {
        let network = network(&[]).unwrap();
        assert_eq!(network, Network::localhost(0));
        assert!(network.is_localhost());
    }

    #[test]
    fn the_domain_ends_where_the_ports_end() {
        assert_eq!(network(&[("ROS_DOMAIN_ID", "232")]).unwrap().domain_id, 232);
        // RTPS 9.6.2.3: the multicast port is 7400 + 250 * domain.
        let port = |domain: u32| 7400 + 250 * domain;
        assert!(port(232) <= 65535 && port(233) > 65535);
        for bad in ["233", "-1", "x", "1.5"] {
            assert!(
                matches!(network(&[("ROS_DOMAIN_ID", bad)]), Err(EnvironmentError::Domain { .. })),
                "{bad}"
            );
        }
    }

    #[test]
    fn the_range_opens_the_network_only_when_asked() {
        let range = |value| network(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", value)]);
        assert!(range("LOCALHOST").unwrap().is_localhost());
        assert_eq!(range("SUBNET").unwrap().interfaces, None);
        assert_eq!(range("OFF"), Err(EnvironmentError::Off));
        assert!(matches!(range("subnet"), Err(EnvironmentError::Range { .. })));
        assert!(
            network(&[("ROS_LOCALHOST_ONLY", "1"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")])
                .unwrap()
                .is_localhost()
        );
        assert!(!network(&[("ROS_LOCALHOST_ONLY", "0")]).unwrap().is_localhost());
        assert!(
            network(&[("ROS_LOCALHOST_ONLY", "0"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")])
                .unwrap()
                .is_localhost()
        );
        assert!(network(&[("ROS_LOCALHOST_ONLY", "yes")]).is_err());
    }

    #[test]
    fn an_interface_is_chosen_by_name_or_address() {
        let with =
            |value| network(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET"), ("WHORL_INTERFACE", value)]);
        let wlan: IpAddr = Ipv4Addr::new(192, 168, 1, 7).into();
        assert_eq!(with("wlan0").unwrap().interfaces, Some(vec![wlan]));
        assert_eq!(with("192.168.1.7").unwrap().interfaces, Some(vec![wlan]));
        assert_eq!(with("wlan0,eth0").unwrap().interfaces.unwrap().len(), 2);
        let message = with("wlan1").unwrap_err().to_string();
        assert!(message.contains("wlan1") && message.contains("eth0 10.0.0.7"), "{message}");
    }

    #[test]
    fn an_interface_chosen_by_name_keeps_its_name_when_its_address_changes() {
        let with = |value| {
            network(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET"), ("WHORL_INTERFACE", value)]).unwrap()
        };
        let new = InterfaceAddress { name: "wlan0".into(), address: Ipv4Addr::new(192, 168, 1, 8) };
        let address: IpAddr = new.address.into();
        assert_eq!(
            with("wlan0").with_addresses(std::slice::from_ref(&new)).unwrap().interfaces,
            Some(vec![address])
        );
        assert!(with("wlan0").uses(&new) && !with("eth0").uses(&new));
        // An address that is gone cannot be used any more, and that is said.
        assert!(with("192.168.1.7").with_addresses(&[new]).is_err());
    }

    #[test]
    fn peers_are_addresses_separated_by_semicolons() {
        let with =
            |value| network(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET"), ("ROS_STATIC_PEERS", value)]);
        assert_eq!(with("10.0.0.1; 10.0.0.2;").unwrap().static_peers.len(), 2);
        assert!(matches!(with("whorl-ii.local"), Err(EnvironmentError::Peer { .. })));
    }
}
