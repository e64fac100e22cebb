//! The process on the DDS network: creates readers and writers, and lists the other participants.

use std::collections::HashSet;
use std::net::IpAddr;
use std::time::{Duration, Instant};

#[cfg(feature = "security")]
use ros2_client::dds::rustdds::DomainParticipantSecurityConfigFiles;
use ros2_client::dds::rustdds::{
    DomainParticipant, DomainParticipantBuilder, DomainParticipantStatusEvent, Publisher, QosPolicies,
    QosPolicyBuilder, StatusEvented, Subscriber, Topic, TopicKind,
    bytes::Bytes,
    dds::CreateResult,
    no_key::{DataWriter, SimpleDataReader},
    policy::{Durability, History, Reliability, ResourceLimits},
};
use whorl_msgs::topics::Qos;

use crate::environment::Network;
use crate::error::RosError;
use crate::names;
use crate::nudge::Nudge;
use crate::peers::{ParticipantPrefix, PeerEvent};
use crate::raw::{EndpointId, RawCdr, RawReader, RawWriter};
use crate::relay::Relay;
use crate::worker::{Kept, LONGEST_CREATION, Worker};

/// How an endpoint is created, beyond what the table of topics says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EndpointQos {
    /// Reliable or best effort.
    pub reliable: bool,
    /// KeepLast depth.
    pub depth: u16,
    /// Whether late joiners get the history.
    pub transient_local: bool,
}

impl From<Qos> for EndpointQos {
    fn from(qos: Qos) -> Self {
        Self { reliable: qos.reliable, depth: qos.depth, transient_local: false }
    }
}

impl EndpointQos {
    /// Services, as `rmw_qos_profile_services_default`.
    pub const SERVICE: Self = Self { reliable: true, depth: 10, transient_local: false };
    /// `/rosout`: `rcl`'s profile, without the thousand lines of history.
    pub const ROSOUT: Self = Self { reliable: true, depth: 10, transient_local: true };
    /// `/parameter_events`.
    pub const PARAMETER_EVENTS: Self = Self { reliable: true, depth: 10, transient_local: false };
    /// `ros_discovery_info`.
    pub const DISCOVERY_INFO: Self = Self { reliable: true, depth: 1, transient_local: true };

    fn policies_of_reader(self) -> QosPolicies {
        self.builder().build()
    }

    /// A writer takes limits that it does not have from its topic, and then waits where so many samples are not acknowledged.
    fn policies_of_writer(self) -> QosPolicies {
        self.within(MOST_UNACKNOWLEDGED)
    }

    /// What is kept of a topic in all: RustDDS keeps 64 samples of it where nothing else is said, however large they are, and a
    /// stranger's may be of megabytes.
    fn policies_of_topic(self) -> QosPolicies {
        self.within(i32::from(self.depth).max(LEAST_KEPT))
    }

    fn within(self, most: i32) -> QosPolicies {
        let limits =
            ResourceLimits { max_samples: most, max_instances: most, max_samples_per_instance: most };
        self.builder().resource_limits(limits).build()
    }

    fn builder(self) -> QosPolicyBuilder {
        // A writer that waits for a slow reliable reader blocks the core: 10 ms at most.
        let max_blocking_time = ros2_client::dds::rustdds::Duration::from_millis(10);
        QosPolicyBuilder::new()
            .reliability(if self.reliable {
                Reliability::Reliable { max_blocking_time }
            } else {
                Reliability::BestEffort
            })
            .durability(if self.transient_local { Durability::TransientLocal } else { Durability::Volatile })
            .history(History::KeepLast { depth: i32::from(self.depth) })
    }
}

/// A topic that an endpoint on the network writes or reads.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct DiscoveredEndpoint {
    /// DDS name of the topic (`rt/...` for ROS topics).
    pub dds_topic: String,
    /// DDS name of the type.
    pub dds_type: String,
    /// Id of the endpoint.
    pub endpoint: EndpointId,
    /// Whether it offers or asks for reliable transport.
    pub reliable: bool,
}

impl DiscoveredEndpoint {
    /// ROS name of the topic, e.g. `/whorl_1/imu/data_raw`; `None` for services and the like.
    #[must_use]
    pub fn topic(&self) -> Option<String> {
        names::ros_topic(&self.dds_topic)
    }

    /// ROS name of the type, e.g. `sensor_msgs/msg/Imu`.
    #[must_use]
    pub fn type_name(&self) -> Option<String> {
        names::ros_type(&self.dds_type)
    }
}

/// Samples of a topic that are kept for its reader at least: 0.2 s of the fastest topics, for which DDS stands still at times where
/// traffic is secured.
const LEAST_KEPT: i32 = 20;
/// Samples of a reliable writer that some reader has not acknowledged at most, then it waits and loses what it writes: those of the fastest topics
/// in 40 s, and what RustDDS allows where nothing is said. A reader that has gone without a word counts until its lease is over, and one
/// behind a poor link is late: neither must silence the writer for all others.
const MOST_UNACKNOWLEDGED: i32 = 8192;
/// How often creation is repeated when DDS gets stuck. This happens to about one participant in a hundred on a
/// very busy machine.
const ATTEMPTS: usize = 5;
/// How long DDS may take to join the network: RustDDS itself gives its threads 10 s to begin.
const LONGEST_JOINING: Duration = Duration::from_secs(12);
/// How long DDS may take to say whom it knows: it holds that table for milliseconds, and sleeps for 100 ms at a time where
/// traffic is secured.
const LONGEST_LOOK: Duration = Duration::from_secs(4);
/// How long DDS may take to say goodbye and end its threads.
const LONGEST_FAREWELL: Duration = Duration::from_secs(2);

/// A DDS domain participant with one publisher and one subscriber. Neither creating endpoints nor dropping them, or
/// the participant, blocks for longer than some seconds.
pub struct Participant {
    entities: Kept<Entities>,
    network: Network,
    worker: Worker,
    _relay: Option<Relay>,
}

#[derive(Clone)]
struct Entities {
    participant: DomainParticipant,
    publisher: Publisher,
    subscriber: Subscriber,
}

impl Participant {
    /// Joins the network and creates endpoints: once more when DDS gets stuck at it ([`RosError::Stuck`]).
    ///
    /// # Errors
    /// As [`Self::new`] and `create`.
    pub fn with<T>(
        network: &Network,
        mut create: impl FnMut(&Self) -> Result<T, RosError>,
    ) -> Result<(Self, T), RosError> {
        let mut attempt = || {
            let participant = Self::new(network)?;
            let endpoints = create(&participant)?;
            Ok((participant, endpoints))
        };
        for _ in 1..ATTEMPTS {
            match attempt() {
                Err(error @ RosError::Stuck { .. }) => tracing::warn!("{error}: rejoining the network"),
                other => return other,
            }
        }
        attempt()
    }

    /// Joins the network.
    ///
    /// # Errors
    /// When sockets cannot be opened; [`RosError::Stuck`] when DDS does not come back.
    pub fn new(network: &Network) -> Result<Self, RosError> {
        let worker = Worker::start().map_err(RosError::io("starting a thread"))?;
        let joining = format!("joining domain {}", network.domain_id);
        let own = network.clone();
        // Before DDS chooses our number.
        let relay = Relay::for_network(network)?;
        let entities = worker
            .run(LONGEST_JOINING, move || Entities::new(&own))
            .ok_or(RosError::Stuck { doing: joining })??;
        Ok(Self { entities: worker.keep(entities), network: network.clone(), worker, _relay: relay })
    }

    /// Reads a ROS topic, e.g. `/whorl_1/imu/data_raw` of `sensor_msgs/msg/Imu`.
    ///
    /// # Errors
    /// When DDS refuses.
    pub fn reader(&self, topic: &str, ros_type: &str, qos: EndpointQos) -> Result<RawReader, RosError> {
        self.dds_reader(&names::dds_topic(topic), &names::dds_type(ros_type), qos)
    }

    /// Writes a ROS topic.
    ///
    /// # Errors
    /// When DDS refuses.
    pub fn writer(&self, topic: &str, ros_type: &str, qos: EndpointQos) -> Result<RawWriter, RosError> {
        self.dds_writer(&names::dds_topic(topic), &names::dds_type(ros_type), qos)
    }

    /// Reads a topic by its DDS names.
    ///
    /// # Errors
    /// When DDS refuses; [`RosError::Stuck`] when it does not come back.
    pub fn dds_reader(&self, topic: &str, dds_type: &str, qos: EndpointQos) -> Result<RawReader, RosError> {
        let doing = format!("creating a reader of {topic}");
        let reader = self.create(doing, topic, dds_type, qos, move |entities, topic| {
            entities.reader(topic, qos.policies_of_reader())
        })?;
        Ok(RawReader::new(self.worker.keep(reader), topic.to_owned()))
    }

    /// Writes a topic by its DDS names.
    ///
    /// # Errors
    /// When DDS refuses; [`RosError::Stuck`] when it does not come back.
    pub fn dds_writer(&self, topic: &str, dds_type: &str, qos: EndpointQos) -> Result<RawWriter, RosError> {
        let doing = format!("creating a writer of {topic}");
        let writer = self.create(doing, topic, dds_type, qos, move |entities, topic| {
            entities.writer(topic, qos.policies_of_writer())
        })?;
        Ok(RawWriter::new(self.worker.keep(writer), topic.to_owned(), self.network.enclave.is_some()))
    }

    fn create<T: Send + 'static>(
        &self,
        doing: String,
        topic: &str,
        dds_type: &str,
        qos: EndpointQos,
        create: impl FnOnce(&Entities, &Topic) -> CreateResult<T> + Send + 'static,
    ) -> Result<T, RosError> {
        let entities = self.entities.clone();
        let (topic, dds_type) = (topic.to_owned(), dds_type.to_owned());
        let work = move || {
            let kept = qos.policies_of_topic();
            let topic = entities.participant.create_topic(topic, dds_type, &kept, TopicKind::NoKey)?;
            create(&entities, &topic)
        };
        match self.worker.run(LONGEST_CREATION, work) {
            Some(result) => result.map_err(|e| RosError::dds(doing, e)),
            None => Err(RosError::Stuck { doing }),
        }
    }

    /// What the participant knows of the others; nothing when it is stuck.
    fn look<T: Send + 'static>(&self, look: fn(&DomainParticipant) -> Vec<T>) -> Vec<T> {
        let participant = self.entities.participant.clone();
        self.worker.run(LONGEST_LOOK, move || look(&participant)).unwrap_or_default()
    }

    /// Whether DDS has locked up; then only a new participant helps.
    #[must_use]
    pub fn is_stuck(&self) -> bool {
        self.worker.is_stuck()
    }

    /// Joins the network, creates endpoints, and asks somebody with them, who is given as long as is left of
    /// [`Network::patience`]; anew when DDS gets stuck meanwhile.
    ///
    /// # Errors
    /// As [`Self::with`] and `ask`.
    pub fn ask<C, T>(
        network: &Network,
        mut create: impl FnMut(&Self) -> Result<C, RosError>,
        mut ask: impl FnMut(&Self, &C, Duration) -> Result<T, RosError>,
    ) -> Result<T, RosError> {
        let deadline = Instant::now() + network.patience();
        loop {
            let (participant, endpoints) = Self::with(network, &mut create)?;
            let left = deadline.saturating_duration_since(Instant::now());
            match ask(&participant, &endpoints, left) {
                Err(RosError::Stuck { .. }) if Instant::now() < deadline => {}
                other => return other,
            }
        }
    }

    /// Every writer known on the network, sorted by topic.
    #[must_use]
    pub fn discovered_writers(&self) -> Vec<DiscoveredEndpoint> {
        let writers = self.look(DomainParticipant::discovered_writers);
        let mut list: Vec<_> = writers
            .into_iter()
            .map(|w| DiscoveredEndpoint {
                dds_topic: w.publication_topic_data.topic_name.clone(),
                dds_type: w.publication_topic_data.type_name.clone(),
                endpoint: w.writer_proxy.remote_writer_guid.into(),
                reliable: matches!(w.publication_topic_data.reliability, Some(Reliability::Reliable { .. })),
            })
            .collect();
        list.sort();
        list
    }

    /// Every reader known on the network, sorted by topic.
    #[must_use]
    pub fn discovered_readers(&self) -> Vec<DiscoveredEndpoint> {
        let readers = self.look(DomainParticipant::discovered_readers);
        let mut list: Vec<_> = readers
            .into_iter()
            .map(|r| DiscoveredEndpoint {
                dds_topic: r.subscription_topic_data.topic_name().clone(),
                dds_type: r.subscription_topic_data.type_name().clone(),
                endpoint: r.reader_proxy.remote_reader_guid.into(),
                reliable: matches!(
                    r.subscription_topic_data.qos().reliability(),
                    Some(Reliability::Reliable { .. })
                ),
            })
            .collect();
        list.sort();
        list
    }

    /// Participants of which an endpoint is known.
    #[must_use]
    pub fn known_peers(&self) -> HashSet<ParticipantPrefix> {
        let endpoints = [self.discovered_readers(), self.discovered_writers()].concat();
        endpoints.iter().map(|e| e.endpoint.participant()).collect()
    }

    /// Announced addresses at which the others receive messages.
    #[must_use]
    pub fn addresses_of_peers(&self) -> Vec<IpAddr> {
        let readers = self.look(DomainParticipant::discovered_readers);
        let mut list: Vec<IpAddr> = readers
            .iter()
            .filter(|r| {
                EndpointId::from(r.reader_proxy.remote_reader_guid).participant() != self.id().participant()
            })
            .flat_map(|r| r.reader_proxy.unicast_locator_list.iter().cloned())
            .map(|locator| std::net::SocketAddr::from(locator).ip())
            .collect();
        list.sort();
        list.dedup();
        list
    }

    /// The next change among the others, or `None` when there is none now.
    pub fn peer_event(&self) -> Option<PeerEvent> {
        use DomainParticipantStatusEvent as Event;
        use ros2_client::dds::rustdds::LostReason;
        let listener = self.entities.participant.status_listener();
        loop {
            let event = match listener.try_recv_status()? {
                Event::ParticipantDiscovered { dpd } => {
                    PeerEvent::Discovered(EndpointId::from(dpd.guid).participant())
                }
                Event::ParticipantLost { id, reason } => match reason {
                    LostReason::Disposed => PeerEvent::Left(prefix(id.as_ref())),
                    LostReason::Timeout { .. } => PeerEvent::TimedOut(prefix(id.as_ref())),
                },
                Event::RemoteReaderMatched { local_writer, remote_reader } => {
                    PeerEvent::ReaderMatched { writer: local_writer.into(), reader: remote_reader.into() }
                }
                Event::RemoteWriterMatched { local_reader, remote_writer } => {
                    PeerEvent::WriterMatched { reader: local_reader.into(), writer: remote_writer.into() }
                }
                Event::ReaderLost { guid, .. } => PeerEvent::ReaderLost(guid.into()),
                Event::WriterLost { guid, .. } => PeerEvent::WriterLost(guid.into()),
                #[cfg(feature = "security")]
                Event::Authentication { participant, status } => {
                    // The type of `status` has no public name.
                    match format!("{status:?}").as_str() {
                        "Authenticating" => PeerEvent::Authenticating(prefix(participant.as_ref())),
                        "Rejected" => PeerEvent::Rejected(prefix(participant.as_ref())),
                        _ => continue,
                    }
                }
                _ => continue,
            };
            match event {
                PeerEvent::Discovered(peer) | PeerEvent::Left(peer) | PeerEvent::TimedOut(peer)
                    if Nudge::made(&peer) => {}
                _ => return Some(event),
            }
        }
    }

    /// Whether the background threads of DDS still run. RustDDS 0.15 ends them when a system call
    /// is interrupted, as it is when the process is stopped and continued (Ctrl-Z and `fg`); what is
    /// written then goes nowhere, without an error. Nor do they run when they wait for each other, which is noticed some
    /// seconds later, if this is called at least once a second.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        let participant = self.entities.participant.clone();
        if !self.worker.probe(LONGEST_LOOK, move || drop(participant.discovered_topics())) {
            return false;
        }
        self.entities.participant.assert_liveliness().is_ok()
    }

    /// Our id on the network.
    #[must_use]
    pub fn id(&self) -> EndpointId {
        use ros2_client::dds::rustdds::RTPSEntity;
        self.entities.participant.guid().into()
    }

    /// Our number among the participants of this machine, which fixes our UDP ports.
    #[must_use]
    pub fn participant_number(&self) -> u16 {
        self.entities.participant.participant_id()
    }

    /// The network that we joined.
    #[must_use]
    pub fn network(&self) -> &Network {
        &self.network
    }
}

impl Drop for Participant {
    fn drop(&mut self) {
        // The endpoints, which should be gone by now, are dropped on the same thread and before.
        self.entities.leave();
        self.worker.wait(LONGEST_FAREWELL);
    }
}

impl Entities {
    fn new(network: &Network) -> Result<Self, RosError> {
        let error = |e| RosError::dds(format!("joining domain {}", network.domain_id), e);
        let mut builder = DomainParticipantBuilder::new(network.domain_id)
            // The default of 8 MiB per socket is for point clouds. The kernel clamps to its own
            // limit anyway and RustDDS warns about that.
            .socket_receive_buffer_size(SOCKET_BUFFER_BYTES)
            .socket_send_buffer_size(SOCKET_BUFFER_BYTES);
        if let Some(interfaces) = &network.interfaces {
            builder = builder.with_only_networks(interfaces.iter().copied());
        }
        #[cfg(feature = "security")]
        if let Some(folder) = &network.enclave {
            // SROS2 does not encrypt private keys.
            let files = DomainParticipantSecurityConfigFiles::with_ros_default_names(folder, String::new());
            builder = builder.builtin_security(files);
        }
        let participant = builder.build().map_err(error)?;
        let publisher = participant.create_publisher(&QosPolicies::default()).map_err(error)?;
        let subscriber = participant.create_subscriber(&QosPolicies::default()).map_err(error)?;
        Ok(Self { participant, publisher, subscriber })
    }

    fn reader(
        &self,
        topic: &Topic,
        policies: QosPolicies,
    ) -> CreateResult<SimpleDataReader<Vec<u8>, RawCdr>> {
        self.subscriber.create_simple_datareader_no_key(topic, Some(policies))
    }

    fn writer(&self, topic: &Topic, policies: QosPolicies) -> CreateResult<DataWriter<Bytes, RawCdr>> {
        self.publisher.create_datawriter_no_key(topic, Some(policies))
    }
}

fn prefix(bytes: &[u8]) -> [u8; 12] {
    let mut prefix = [0; 12];
    prefix.iter_mut().zip(bytes).for_each(|(to, from)| *to = *from);
    prefix
}

/// Holds a second of traffic of the whole formation (300 messages/s of 400 bytes, each way).
const SOCKET_BUFFER_BYTES: usize = 512 * 1024;
