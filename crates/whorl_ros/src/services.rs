//! Services over raw CDR, for clients of every ROS 2 middleware.
//!
//! There are two ways to say which answer belongs to which request. Fast DDS (the default of
//! ROS 2), Connext and `ros2-client` put it into the inline QoS of the DDS sample ("enhanced");
//! Cyclone DDS puts 16 bytes in front of the payload (half the client's id, a count). We answer
//! each client in the way it asked, told apart by the vendor number in its id.

use std::cell::{Cell, RefCell};
use std::time::{Duration, Instant};

use ros2_client::dds::rustdds::{SequenceNumber, rpc::SampleIdentity};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use whorl_msgs::cdr;

use crate::clock::monotonic;
use crate::error::RosError;
use crate::nudge::Nudge;
use crate::participant::{EndpointQos, Participant};
use crate::peers::ParticipantPrefix;
use crate::raw::{EndpointId, RawReader, RawSample, RawWriter};
use crate::recovery::ANNOUNCE_PERIOD;

/// Vendor number of Cyclone DDS, the first two bytes of its ids
/// (<https://www.dds-foundation.org/dds-rtps-vendor-and-product-ids/>).
const CYCLONE: [u8; 2] = [0x01, 0x10];
const CYCLONE_HEADER_BYTES: usize = 16;
/// Between two looks for a server or an answer.
const PAUSE: Duration = Duration::from_millis(5);

/// Identifies a request, so that the answer finds its way back.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RequestId {
    from: ParticipantPrefix,
    way: Way,
}

/// How the client recognises its answer.
#[derive(Debug, Clone, Copy)]
enum Way {
    Enhanced(SampleIdentity),
    /// The 16 bytes, in little-endian.
    Cyclone([u8; CYCLONE_HEADER_BYTES]),
}

/// The request of Whorl's own services: `StartExperiment` and `AbortExperiment` are alike.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub(crate) struct TextRequest {
    pub argument: String,
}

/// The server's side of one service.
pub(crate) struct ServiceServer {
    pub(crate) requests: RawReader,
    pub(crate) responses: RawWriter,
    held: RefCell<Vec<HeldAnswer>>,
    longest_hold: Duration,
}

/// An answer whose reader is not yet known: what is written before that is lost.
#[derive(Debug)]
struct HeldAnswer {
    to: ParticipantPrefix,
    bytes: Vec<u8>,
    related: Option<SampleIdentity>,
    /// Monotonic time.
    until: Duration,
}

/// How long an answer waits for its reader, which a client announces right after it was created.
const LONGEST_HOLD: Duration = Duration::from_secs(1);
/// The same where keys are exchanged first, each of whose messages RustDDS repeats once a second.
const LONGEST_HOLD_SECURED: Duration = Duration::from_secs(5);
/// Answers that wait at the most; the oldest is sent when there is one more.
const MOST_HELD: usize = 64;

impl ServiceServer {
    /// Offers `/name` of type `package/srv/Type`.
    pub(crate) fn new(participant: &Participant, name: &str, service_type: &str) -> Result<Self, RosError> {
        let names = ServiceNames::new(name, service_type);
        Ok(Self {
            requests: participant.dds_reader(&names.request, &names.request_type, EndpointQos::SERVICE)?,
            responses: participant.dds_writer(&names.response, &names.response_type, EndpointQos::SERVICE)?,
            held: RefCell::default(),
            longest_hold: if participant.network().enclave.is_some() {
                LONGEST_HOLD_SECURED
            } else {
                LONGEST_HOLD
            },
        })
    }

    /// The next request; its bytes are plain CDR with header.
    pub(crate) fn take(&self) -> Result<Option<(RequestId, Vec<u8>)>, RosError> {
        self.requests.drain_notifications();
        Ok(self.requests.take()?.map(split_request))
    }

    /// Prepares an answer, which [`Self::release`] sends.
    pub(crate) fn respond<T: Serialize>(&self, id: RequestId, response: &T) -> Result<(), RosError> {
        let mut bytes = cdr::encode("service response", response)?;
        let related = match id.way {
            Way::Enhanced(identity) => Some(identity),
            Way::Cyclone(header) => {
                bytes.splice(4..4, header);
                None
            }
        };
        let until = monotonic() + self.longest_hold;
        let mut held = self.held.borrow_mut();
        if held.len() >= MOST_HELD
            && let Some(oldest) = held.first_mut()
        {
            oldest.until = Duration::ZERO;
        }
        held.push(HeldAnswer { to: id.from, bytes, related, until });
        Ok(())
    }

    /// Whether an answer waits for its reader.
    pub(crate) fn is_holding(&self) -> bool {
        !self.held.borrow().is_empty()
    }

    /// Sends the answers whose reader is known, and those that have waited for long enough.
    pub(crate) fn release(
        &self,
        now: Duration,
        is_known: impl Fn(&ParticipantPrefix) -> bool,
    ) -> Result<(), RosError> {
        let mut failure = Ok(());
        self.held.borrow_mut().retain(|answer| {
            let waits = now < answer.until && !is_known(&answer.to);
            if !waits && let Err(error) = self.responses.write(&answer.bytes, answer.related) {
                failure = Err(error);
            }
            waits
        });
        failure
    }
}

fn split_request(sample: RawSample) -> (RequestId, Vec<u8>) {
    let RawSample { mut bytes, writer, sequence_number, related, .. } = sample;
    if writer.0[..2] == CYCLONE && bytes.len() >= 4 + CYCLONE_HEADER_BYTES {
        let mut header = [0; CYCLONE_HEADER_BYTES];
        for (to, from) in header.iter_mut().zip(bytes.drain(4..4 + CYCLONE_HEADER_BYTES)) {
            *to = from;
        }
        if bytes[1] == 0 {
            // Two 8-byte numbers from a big-endian client.
            header[..8].reverse();
            header[8..].reverse();
        }
        return (RequestId { from: writer.participant(), way: Way::Cyclone(header) }, bytes);
    }
    let sent =
        SampleIdentity { writer_guid: writer.guid(), sequence_number: SequenceNumber::from(sequence_number) };
    // Fast DDS names its response reader in the inline QoS but may leave the count unknown, which
    // then is that of the sample; `ros2-client` names nothing.
    let mut identity = related.unwrap_or(sent);
    if identity.sequence_number == SequenceNumber::UNKNOWN {
        identity.sequence_number = sent.sequence_number;
    }
    (RequestId { from: writer.participant(), way: Way::Enhanced(identity) }, bytes)
}

struct ServiceNames {
    request: String,
    response: String,
    request_type: String,
    response_type: String,
}

impl ServiceNames {
    fn new(name: &str, service_type: &str) -> Self {
        let name = name.trim_start_matches('/');
        let dds_type = |suffix| crate::names::dds_type(&format!("{service_type}_{suffix}"));
        Self {
            request: format!("rq/{name}Request"),
            response: format!("rr/{name}Reply"),
            request_type: dds_type("Request"),
            response_type: dds_type("Response"),
        }
    }
}

/// The client's side of one service.
pub struct ServiceClient {
    requests: RawWriter,
    responses: RawReader,
    name: String,
    /// Whether a reader of our requests was matched.
    is_matched: Cell<bool>,
}

impl ServiceClient {
    /// A client of `/name` of type `package/srv/Type`.
    ///
    /// # Errors
    /// When DDS refuses.
    pub fn new(participant: &Participant, name: &str, service_type: &str) -> Result<Self, RosError> {
        let names = ServiceNames::new(name, service_type);
        Ok(Self {
            requests: participant.dds_writer(&names.request, &names.request_type, EndpointQos::SERVICE)?,
            responses: participant.dds_reader(&names.response, &names.response_type, EndpointQos::SERVICE)?,
            name: name.to_owned(),
            is_matched: Cell::new(false),
        })
    }

    /// Whether a server has been found, in both directions, and what is asked from now on reaches it.
    #[must_use]
    pub fn server_is_there(&self, participant: &Participant) -> bool {
        // Known first, matched a moment later: on a busy computer, or where keys are exchanged, much later.
        if self.requests.has_new_reader() {
            self.is_matched.set(true);
        }
        if !self.is_matched.get() {
            return false;
        }
        let others = |list: Vec<crate::DiscoveredEndpoint>, topic: &str, own: EndpointId| {
            list.iter().any(|e| e.dds_topic == topic && e.endpoint.participant() != own.participant())
        };
        others(participant.discovered_readers(), self.requests.topic(), self.requests.id())
            && others(participant.discovered_writers(), self.responses.topic(), self.responses.id())
    }

    /// Calls the service; waits for the server and its answer up to `timeout`.
    ///
    /// # Errors
    /// [`RosError::NoServer`], [`RosError::NoAnswer`]; [`RosError::Stuck`] before anything was asked; or when DDS fails.
    pub fn call<Q: Serialize, A: DeserializeOwned>(
        &self,
        participant: &Participant,
        request: &Q,
        timeout: Duration,
    ) -> Result<A, RosError> {
        let deadline = Instant::now() + timeout;
        if !self.server_is_there(participant) {
            self.look_for_server(participant, deadline, timeout)?;
        }
        // The server may discover us a moment later than we discover it; requests sent before are lost.
        std::thread::sleep(Duration::from_millis(50));
        let bytes = cdr::encode("service request", request)?;
        let identity = self.requests.write(&bytes, None)?;
        let no_answer = || RosError::NoAnswer { service: self.name.clone(), seconds: timeout.as_secs_f64() };
        loop {
            self.responses.drain_notifications();
            while let Some(sample) = self.responses.take()? {
                if sample.related == Some(identity) {
                    return Ok(cdr::decode("service response", &sample.bytes)?);
                }
            }
            if Instant::now() > deadline {
                return Err(no_answer());
            }
            std::thread::sleep(PAUSE);
        }
    }

    /// Waits for the server. The first announcement may be lost on a busy computer, and RustDDS repeats it after 10 s: so all announce
    /// themselves again and again.
    fn look_for_server(
        &self,
        participant: &Participant,
        deadline: Instant,
        timeout: Duration,
    ) -> Result<(), RosError> {
        let mut nudge = Nudge::new(participant.network(), participant.participant_number())?;
        let mut next_nudge = Instant::now() + ANNOUNCE_PERIOD;
        while !self.server_is_there(participant) {
            if participant.is_stuck() {
                return Err(RosError::Stuck { doing: format!("calling {}", self.name) });
            }
            if Instant::now() > deadline {
                let (service, seconds) = (self.name.clone(), timeout.as_secs_f64());
                return Err(RosError::NoServer { service, seconds });
            }
            if Instant::now() > next_nudge {
                nudge.send(participant.participant_number());
                next_nudge = Instant::now() + ANNOUNCE_PERIOD;
            }
            std::thread::sleep(PAUSE);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_node::Timestamp;

    fn sample(prefix: [u8; 2], bytes: Vec<u8>, related: Option<SampleIdentity>) -> RawSample {
        let mut writer = [9; 16];
        writer[..2].copy_from_slice(&prefix);
        RawSample {
            bytes,
            writer: EndpointId(writer),
            sequence_number: 17,
            source_time: None,
            receive_time: Timestamp(0),
            related,
        }
    }

    #[test]
    fn a_cyclone_request_is_stripped_of_its_header() {
        let mut bytes = vec![0, 1, 0, 0];
        bytes.extend(1..=16);
        bytes.extend([0xaa, 0xbb]);
        let (id, payload) = split_request(sample(CYCLONE, bytes, None));
        assert!(matches!(id.way, Way::Cyclone(h) if h[0] == 1 && h[15] == 16));
        assert_eq!(payload, [0, 1, 0, 0, 0xaa, 0xbb]);
    }

    #[test]
    fn an_enhanced_request_without_a_count_takes_that_of_the_sample() {
        let theirs = SampleIdentity {
            writer_guid: EndpointId([3; 16]).guid(),
            sequence_number: SequenceNumber::UNKNOWN,
        };
        let (id, payload) = split_request(sample([1, 15], vec![0, 1, 0, 0, 5], Some(theirs)));
        let Way::Enhanced(identity) = id.way else { panic!("{id:?}") };
        assert_eq!(identity.writer_guid, theirs.writer_guid);
        assert_eq!(i64::from(identity.sequence_number), 17);
        assert_eq!(payload.len(), 5);
    }

    #[test]
    fn service_names_are_those_of_the_other_implementations() {
        let names = ServiceNames::new("/coordinator/start", "whorl_msgs/srv/StartExperiment");
        assert_eq!(names.request, "rq/coordinator/startRequest");
        assert_eq!(names.response, "rr/coordinator/startReply");
        assert_eq!(names.request_type, "whorl_msgs::srv::dds_::StartExperiment_Request_");
        assert_eq!(names.response_type, "whorl_msgs::srv::dds_::StartExperiment_Response_");
    }
}
