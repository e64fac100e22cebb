//! A node's endpoints and their renewal after the network was cut.

use std::collections::{HashMap, HashSet};
use std::time::{Duration, Instant};

use mio::{Registry, Token};

use crate::clock::monotonic;
use crate::endpoints::{Endpoints, Plan, Readable};
use crate::environment::Network;
use crate::error::RosError;
use crate::handshakes::Handshakes;
use crate::nudge::Nudge;
use crate::participant::Participant;
use crate::peers::{ParticipantPrefix, PeerEvent};
use crate::raw::EndpointId;
use crate::recovery::{Action, Reason, Recovery, RecoveryTimes};
use crate::services::ServiceServer;

/// The old endpoints are dropped this long after the new ones were created at the latest.
const OVERLAP: Duration = Duration::from_secs(1);

/// How long the end of a node waits for acknowledgements.
const LAST_WORDS: Duration = Duration::from_millis(100);
/// How long the end of a node waits for best-effort messages to arrive.
const BEST_EFFORT_ARRIVES: Duration = Duration::from_millis(10);

/// Something worth a line in the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Notice {
    Missing,
    Renewing(Reason),
    Renewed,
}

/// The endpoints in use; for a moment after a renewal, the old and the new ones.
pub(crate) struct Connection {
    // Fields are dropped in this order: endpoints before the participant.
    current: Endpoints,
    incoming: Option<(Endpoints, Duration)>,
    matched: HashMap<EndpointId, HashSet<EndpointId>>,
    lost_writers: Vec<EndpointId>,
    recovery: Recovery,
    /// Where traffic is secured.
    handshakes: Option<Handshakes>,
    nudge: Nudge,
    generation: usize,
    plan: Plan,
    participant: Participant,
}

impl Connection {
    pub(crate) fn new(network: &Network, plan: Plan, registry: &Registry) -> Result<Self, RosError> {
        let handshakes = network.enclave.is_some().then(|| Handshakes::new(monotonic()));
        Self::with_generation(network, plan, registry, 0, handshakes)
    }

    fn with_generation(
        network: &Network,
        plan: Plan,
        registry: &Registry,
        generation: usize,
        handshakes: Option<Handshakes>,
    ) -> Result<Self, RosError> {
        let (participant, mut current) =
            Participant::with(network, |participant| Endpoints::new(participant, &plan, generation))?;
        current.register(registry)?;
        current.announce(&participant, &plan.node, true)?;
        Ok(Self {
            current,
            incoming: None,
            matched: HashMap::new(),
            lost_writers: Vec::new(),
            recovery: Recovery::new(if participant.network().is_localhost() {
                RecoveryTimes::localhost()
            } else {
                RecoveryTimes::default()
            }),
            handshakes,
            nudge: Nudge::new(participant.network(), participant.participant_number())?,
            generation,
            plan,
            participant,
        })
    }

    /// Whether the background threads of DDS still run.
    pub(crate) fn is_alive(&self) -> bool {
        self.participant.is_alive()
    }

    /// Whether they wait for each other for ever.
    pub(crate) fn is_stuck(&self) -> bool {
        self.participant.is_stuck()
    }

    /// The same endpoints in a new participant, after the background threads of the old one have ended.
    pub(crate) fn rebuilt(&self, registry: &Registry) -> Result<Self, RosError> {
        self.rebuilt_on(self.participant.network(), registry)
    }

    /// The same, on a network with other addresses.
    pub(crate) fn rebuilt_on(&self, network: &Network, registry: &Registry) -> Result<Self, RosError> {
        let handshakes = self.handshakes.as_ref().map(Handshakes::renewed);
        Self::with_generation(network, self.plan.clone(), registry, self.generation + 1, handshakes)
    }

    /// The endpoints to write with.
    pub(crate) fn endpoints(&self) -> &Endpoints {
        &self.current
    }

    /// Both generations, the one in use first.
    pub(crate) fn generations(&self) -> impl Iterator<Item = &Endpoints> {
        std::iter::once(&self.current).chain(self.incoming.as_ref().map(|(endpoints, _)| endpoints))
    }

    /// What an event is about: the generation (0 = in use, 1 = incoming) and what is readable.
    pub(crate) fn at(&self, token: Token) -> Option<(usize, Readable)> {
        self.generations().enumerate().find_map(|(g, endpoints)| endpoints.at(token).map(|what| (g, what)))
    }

    pub(crate) fn recovery(&self) -> &Recovery {
        &self.recovery
    }

    pub(crate) fn domain_id(&self) -> u16 {
        self.participant.network().domain_id
    }

    pub(crate) fn is_localhost(&self) -> bool {
        self.participant.network().is_localhost()
    }

    pub(crate) fn is_renewing(&self) -> bool {
        self.incoming.is_some()
    }

    /// Writers that are gone since the last call.
    pub(crate) fn take_lost_writers(&mut self) -> Vec<EndpointId> {
        std::mem::take(&mut self.lost_writers)
    }

    /// Ids of all writers known on the network.
    pub(crate) fn known_writers(&self) -> HashSet<EndpointId> {
        self.participant.discovered_writers().into_iter().map(|w| w.endpoint).collect()
    }

    /// Checks the peers; to be called a few times a second, and every 10 ms while renewing.
    pub(crate) fn look_after(
        &mut self,
        now: Duration,
        longest_silence: Option<Duration>,
        registry: &Registry,
    ) -> Result<Option<Notice>, RosError> {
        let missing_before = self.recovery.missing();
        self.hear_of_peers(now);
        self.look_at_handshakes(now)?;
        if self.try_promote(now, registry)? {
            return Ok(Some(Notice::Renewed));
        }
        match self.recovery.act(now, longest_silence) {
            Some(Action::Renew(reason)) => {
                self.renew(now, registry)?;
                Ok(Some(Notice::Renewing(reason)))
            }
            Some(Action::Announce) => {
                self.nudge.send(self.participant.participant_number());
                Ok(None)
            }
            None => Ok((self.recovery.missing() > missing_before).then_some(Notice::Missing)),
        }
    }

    fn hear_of_peers(&mut self, now: Duration) {
        while let Some(event) = self.participant.peer_event() {
            self.peer(now, event);
        }
    }

    /// Fails with [`RosError::Stuck`] when a handshake does not end and we lack something: then only a new participant
    /// helps.
    fn look_at_handshakes(&mut self, now: Duration) -> Result<(), RosError> {
        let lacks = self
            .current
            .subscriptions
            .iter()
            .any(|reader| self.matched.get(&reader.id()).is_none_or(HashSet::is_empty));
        match self.handshakes.as_mut().filter(|_| lacks) {
            Some(handshakes) => handshakes.look(now, || self.participant.known_peers()),
            None => Ok(()),
        }
    }

    /// Sends the answers to services whose readers are known by now; true when others still wait.
    pub(crate) fn release_answers(&mut self, now: Duration) -> Result<bool, RosError> {
        if !self.generations().flat_map(Endpoints::servers).any(ServiceServer::is_holding) {
            return Ok(false);
        }
        self.hear_of_peers(now);
        let mut result = Ok(());
        for server in self.generations().flat_map(Endpoints::servers) {
            let readers = self.matched.get(&server.responses.id());
            let is_known = |to: &ParticipantPrefix| {
                readers.is_some_and(|readers| readers.iter().any(|reader| reader.participant() == *to))
            };
            result = result.and(server.release(now, is_known));
        }
        result.map(|()| self.generations().flat_map(Endpoints::servers).any(ServiceServer::is_holding))
    }

    fn peer(&mut self, now: Duration, event: PeerEvent) {
        match event {
            PeerEvent::ReaderMatched { writer: ours, reader: theirs }
            | PeerEvent::WriterMatched { reader: ours, writer: theirs } => {
                self.matched.entry(ours).or_default().insert(theirs);
            }
            PeerEvent::ReaderLost(theirs) => self.unmatch(|id| *id == theirs),
            PeerEvent::WriterLost(theirs) => {
                self.unmatch(|id| *id == theirs);
                self.lost_writers.push(theirs);
            }
            PeerEvent::Left(peer) | PeerEvent::TimedOut(peer) => {
                self.unmatch(|id| id.participant() == peer);
            }
            PeerEvent::Authenticating(_) | PeerEvent::Rejected(_) | PeerEvent::Discovered(_) => {}
        }
        self.recovery.peer(now, event);
        if let Some(handshakes) = &mut self.handshakes {
            handshakes.peer(now, event);
        }
    }

    fn unmatch(&mut self, gone: impl Fn(&EndpointId) -> bool) {
        self.matched.values_mut().for_each(|peers| peers.retain(|id| !gone(id)));
    }

    fn renew(&mut self, now: Duration, registry: &Registry) -> Result<(), RosError> {
        if let Some((mut endpoints, _)) = self.incoming.take() {
            endpoints.deregister(registry);
        }
        self.generation += 1;
        let mut endpoints = Endpoints::new(&self.participant, &self.plan, self.generation)?;
        endpoints.register(registry)?;
        self.incoming = Some((endpoints, now));
        Ok(())
    }

    /// Puts the incoming endpoints into use when they have found as many peers as those in use.
    fn try_promote(&mut self, now: Duration, registry: &Registry) -> Result<bool, RosError> {
        let Some((incoming, since)) = &self.incoming else { return Ok(false) };
        let peers = |id: EndpointId| self.matched.get(&id).map_or(0, HashSet::len);
        let found_all = self.current.ids().zip(incoming.ids()).all(|(old, new)| peers(new) >= peers(old));
        // A dropped peer may still be in the count of a reader that has not noticed: do not
        // wait for ever.
        if !(found_all || now.saturating_sub(*since) >= OVERLAP) {
            return Ok(false);
        }
        if let Some((incoming, _)) = self.incoming.take() {
            let mut old = std::mem::replace(&mut self.current, incoming);
            old.deregister(registry);
            old.ids().for_each(|id| {
                self.matched.remove(&id);
            });
            self.current.announce(&self.participant, &self.plan.node, true)?;
        }
        Ok(true)
    }

    /// Says goodbye, after the last messages have arrived: a reader that hears of the end of a
    /// participant first drops what still comes from it.
    pub(crate) fn close(self) -> Result<(), RosError> {
        let deadline = Instant::now() + LAST_WORDS;
        for writer in self.current.reliable_writers() {
            // The wait is limited: a reader that is stuck or gone never acknowledges.
            let _ = writer.flush(deadline.saturating_duration_since(Instant::now()));
        }
        self.current.announce(&self.participant, &self.plan.node, false)?;
        std::thread::sleep(BEST_EFFORT_ARRIVES);
        Ok(())
    }
}
