//! Makes participants announce themselves at once.
//!
//! RustDDS announces a participant every 10 s, and has no function to do so earlier. But every DDS
//! implementation answers the announcement of a new participant at once, to
//! all. So we send the announcement of a dummy participant without endpoints, which expires after a
//! second: to our own participant, and, unless everything stays on this machine, to all others.
//!
//! With an address of another machine in it, the same announcement makes RustDDS tell that machine
//! about us by unicast, so that `ROS_STATIC_PEERS` works where a wireless LAN does not carry multicast. With more addresses
//! of this machine, more than twelve participants on one machine find each other.
//!
//! Wire format: OMG DDSI-RTPS 2.5, 8.5.3 (SPDP), 9.4 (messages), 9.6.2.3 (ports).

use std::net::{IpAddr, Ipv4Addr, SocketAddrV4, UdpSocket};

use crate::environment::{Network, interface_addresses};
use crate::error::RosError;
use crate::peers::ParticipantPrefix;

/// First bytes of the ids that are made here. 0x01 0x?? are the vendors of real participants.
const MARK: [u8; 8] = *b"\x00\x00whorl\x00";

/// Ids are used in turn: each has expired (after at most 4 s) when it is used again.
const IDS: u32 = 8;
/// Where traffic is secured, RustDDS refuses the dummy, and answers each id only once.
const IDS_SECURED: u32 = u32::MAX / 2;

/// Lease of a dummy participant [s].
const NUDGE_LEASE_S: i32 = 1;
/// For ever, in the sense of DDS.
const INFINITE_S: i32 = i32::MAX;

/// Bit of `BuiltinEndpointSet_t`: reads announcements.
const READS_ANNOUNCEMENTS: u32 = 2;

/// Largest number of participants on a machine of `ROS_STATIC_PEERS` (RTPS counts them from 0).
const PARTICIPANTS_PER_PEER: u16 = 12;

/// RustDDS announces itself to this many participants of this machine (`SPDP_LOCALHOST_PEER_COUNT`), where the
/// loopback interface carries no multicast; two that both have a higher number would never meet.
pub(crate) const TOLD_BY_RUSTDDS: u16 = 12;

/// Largest number of participants on one machine: ten platforms with three nodes each, and a few more.
pub(crate) const PARTICIPANTS_HERE: u16 = 36;

/// Where a participant receives announcements: RTPS 9.6.2.3.
pub(crate) fn announcement_port(domain_id: u16, participant: u16) -> u16 {
    7400 + 250 * domain_id + 10 + 2 * participant
}

/// Where all participants receive announcements, at port 7400 + 250 * domain.
const EVERYBODY: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);

/// Sends announcements.
#[derive(Debug)]
pub(crate) struct Nudge {
    to_ourselves: UdpSocket,
    /// One socket for each of our addresses on the network.
    to_others: Vec<UdpSocket>,
    static_peers: Vec<Ipv4Addr>,
    domain_id: u16,
    ids: u32,
    count: u32,
}

impl Nudge {
    /// For the participant of this number on a network.
    pub(crate) fn new(network: &Network, own: u16) -> Result<Self, RosError> {
        let nudge = Self {
            to_ourselves: socket(Ipv4Addr::LOCALHOST).map_err(RosError::io("opening a socket"))?,
            // The kernel sends multicast from the interface whose address a socket is bound to. An
            // address that is just disappearing is not an error.
            to_others: outward_addresses(network).into_iter().filter_map(|a| socket(a).ok()).collect(),
            static_peers: network.static_peers.clone(),
            domain_id: network.domain_id,
            ids: if network.enclave.is_some() { IDS_SECURED } else { IDS },
            count: 0,
        };
        for (index, peer) in network.static_peers.iter().enumerate() {
            let locators: Vec<_> = nudge.ports_of_peer().map(|port| SocketAddrV4::new(*peer, port)).collect();
            let id = prefix(u32::MAX - u32::try_from(index).unwrap_or(0));
            let message = announcement(id, 1, INFINITE_S, READS_ANNOUNCEMENTS, &locators);
            nudge.deliver(own, &message);
        }
        // Secured participants refuse what is announced without a certificate; they have a relay.
        if network.is_localhost() && network.enclave.is_none() {
            for other in (TOLD_BY_RUSTDDS..PARTICIPANTS_HERE).filter(|other| *other != own) {
                // Of the loopback addresses of a participant RustDDS takes the first: one id for each.
                let place = SocketAddrV4::new(Ipv4Addr::LOCALHOST, announcement_port(nudge.domain_id, other));
                let id = prefix(u32::MAX / 2 + u32::from(other));
                let message = announcement(id, 1, INFINITE_S, READS_ANNOUNCEMENTS, &[place]);
                nudge.deliver(own, &message);
            }
        }
        Ok(nudge)
    }

    fn ports_of_peer(&self) -> impl Iterator<Item = u16> + use<> {
        let domain_id = self.domain_id;
        (0..PARTICIPANTS_PER_PEER).map(move |p| announcement_port(domain_id, p))
    }

    /// Whether an id belongs to a dummy participant of this or another process.
    pub(crate) fn made(id: &ParticipantPrefix) -> bool {
        id.starts_with(&MARK)
    }

    /// Makes our participant, and those that hear us, announce themselves within some 10 ms.
    pub(crate) fn send(&mut self, participant_number: u16) {
        let (id, number) = (self.count % self.ids, self.count / self.ids + 1);
        self.count = self.count.wrapping_add(1);
        // An address is mandatory; nothing is ever sent to it, as no endpoint is offered.
        let nowhere = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 9);
        let message = announcement(prefix(id), number, NUDGE_LEASE_S, 0, &[nowhere]);
        self.deliver(participant_number, &message);
        for socket in &self.to_others {
            let everybody = (EVERYBODY, 7400 + 250 * self.domain_id);
            let _ = socket.send_to(&message, everybody);
        }
        if let Some(socket) = self.to_others.first() {
            for peer in &self.static_peers {
                self.ports_of_peer().for_each(|port| drop(socket.send_to(&message, (*peer, port))));
            }
        }
    }

    fn deliver(&self, participant_number: u16, message: &[u8]) {
        let port = announcement_port(self.domain_id, participant_number);
        // A datagram that does not fit now is sent again a second later.
        let _ = self.to_ourselves.send_to(message, (Ipv4Addr::LOCALHOST, port));
    }
}

fn socket(address: Ipv4Addr) -> std::io::Result<UdpSocket> {
    let socket = UdpSocket::bind((address, 0))?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

/// Our addresses on the networks that DDS uses, without the loopback's.
fn outward_addresses(network: &Network) -> Vec<Ipv4Addr> {
    if network.is_localhost() {
        return Vec::new();
    }
    let used = |a: &Ipv4Addr| network.interfaces.as_ref().is_none_or(|list| list.contains(&IpAddr::from(*a)));
    let ours = interface_addresses().into_iter().map(|i| i.address);
    ours.filter(|a| !a.is_loopback() && used(a)).collect()
}

fn prefix(id: u32) -> ParticipantPrefix {
    let mut prefix = [0; 12];
    prefix[..8].copy_from_slice(&MARK);
    prefix[8..].copy_from_slice(&id.to_be_bytes());
    prefix
}

/// An RTPS message with one DATA submessage: SPDP data of a participant, little-endian.
fn announcement(
    id: ParticipantPrefix,
    sequence_number: u32,
    lease_s: i32,
    endpoints: u32,
    locators: &[SocketAddrV4],
) -> Vec<u8> {
    const PROTOCOL_VERSION: [u8; 2] = [2, 4];
    const VENDOR_UNKNOWN: [u8; 2] = [0, 0];
    const PARTICIPANT: [u8; 4] = [0, 0, 1, 0xc1];
    const READER: [u8; 4] = [0, 1, 0, 0xc7];
    const WRITER: [u8; 4] = [0, 1, 0, 0xc2];

    let mut parameters: Vec<u8> = vec![0, 3, 0, 0]; // PL_CDR_LE
    let mut parameter = |id: u16, value: &[u8]| {
        parameters.extend(id.to_le_bytes());
        parameters.extend((value.len() as u16).to_le_bytes());
        parameters.extend(value);
    };
    parameter(0x15, &[PROTOCOL_VERSION[0], PROTOCOL_VERSION[1], 0, 0]);
    parameter(0x16, &[VENDOR_UNKNOWN[0], VENDOR_UNKNOWN[1], 0, 0]);
    parameter(0x50, &[&id[..], &PARTICIPANT].concat());
    for locator in locators {
        let mut value = [0; 24];
        value[..4].copy_from_slice(&1_i32.to_le_bytes()); // UDPv4
        value[4..8].copy_from_slice(&u32::from(locator.port()).to_le_bytes());
        value[20..].copy_from_slice(&locator.ip().octets());
        parameter(0x32, &value); // metatraffic unicast
        parameter(0x31, &value); // default unicast
    }
    parameter(0x02, &[lease_s.to_le_bytes(), [0; 4]].concat());
    parameter(0x58, &endpoints.to_le_bytes());
    parameter(0x01, &[]);

    let mut body = vec![0, 0, 16, 0]; // no extra flags; 16 bytes to the (absent) inline QoS
    body.extend(READER);
    body.extend(WRITER);
    body.extend(0_i32.to_le_bytes());
    body.extend(sequence_number.to_le_bytes());
    body.extend(parameters);

    let mut message = b"RTPS".to_vec();
    message.extend(PROTOCOL_VERSION);
    message.extend(VENDOR_UNKNOWN);
    message.extend(id);
    message.extend([0x15, 0x05]); // DATA; little-endian, with data
    message.extend((body.len() as u16).to_le_bytes());
    message.extend(body);
    message
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ports_are_those_of_the_standard() {
        // RTPS 2.5, 9.6.2.3: PB 7400, DG 250, d1 10, PG 2.
        assert_eq!(announcement_port(0, 0), 7410);
        assert_eq!(announcement_port(1, 3), 7666);
    }

    #[test]
    fn only_ids_made_here_are_taken_for_such() {
        assert!(Nudge::made(&prefix(5)));
        assert!(!Nudge::made(b"\x01\x0fwhorl\x00\x00\x00\x00\x01"));
    }

    #[test]
    fn the_message_has_the_length_that_its_header_says() {
        let message = announcement(prefix(1), 1, 1, 0, &[SocketAddrV4::new(Ipv4Addr::LOCALHOST, 9)]);
        let length = usize::from(u16::from_le_bytes([message[22], message[23]]));
        assert_eq!(message.len(), 24 + length);
        assert_eq!(message[24 + 4..24 + 8], [0, 1, 0, 0xc7]);
    }
}
