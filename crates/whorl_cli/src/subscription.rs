//! Listening to a running formation: the same for the monitor and the live page.

use whorl_msgs::topics::{Message, PlatformId, Route, Topic};
use whorl_ros::environment::Network;
use whorl_ros::{EndpointQos, Participant, RawReader};

/// Samples that are skipped in one go.
const MOST_UNREADABLE: usize = 100;

/// Readers of some topics; they join the network anew when DDS fails.
pub struct Subscription {
    network: Network,
    routes: Vec<(Route, String)>,
    readers: Vec<(Route, RawReader)>,
    participant: Participant,
}

impl Subscription {
    /// Listens to shared topics, and to topics of each platform.
    pub fn new(
        network: &Network,
        platforms: &[String],
        shared: &[Topic],
        of_platforms: &[Topic],
    ) -> anyhow::Result<Self> {
        let ids = (0..u16::try_from(platforms.len()).unwrap_or(u16::MAX)).map(PlatformId);
        let of_platforms = ids.flat_map(|id| of_platforms.iter().map(move |t| Route::platform(id, *t)));
        let routes: Vec<(Route, String)> = shared
            .iter()
            .map(|topic| Route::shared(*topic))
            .chain(of_platforms)
            .filter_map(|route| Some((route, route.name(platforms)?)))
            .collect();
        let (participant, readers) = join(network, &routes)?;
        Ok(Self { network: network.clone(), routes, readers, participant })
    }

    /// Hands over everything that has arrived. Messages that cannot be decoded are left out: the nodes that receive
    /// them count them.
    pub fn drain(&mut self, mut take: impl FnMut(Route, Message)) -> anyhow::Result<()> {
        self.drain_raw(|_, route, bytes| {
            if let Ok(message) = Message::decode(route.topic.info().message_type, &bytes) {
                take(route, message);
            }
        })
    }

    /// What is listened to, with its name; its place in this list is its number.
    pub fn routes(&self) -> &[(Route, String)] {
        &self.routes
    }

    /// Hands over everything that has arrived as it came: number of the route, route, CDR.
    pub fn drain_raw(&mut self, mut take: impl FnMut(u32, Route, Vec<u8>)) -> anyhow::Result<()> {
        // DDS's threads may fail, for example after the process was stopped for hours.
        if !self.participant.is_alive() {
            (self.participant, self.readers) = join(&self.network, &self.routes)?;
        }
        for (number, (route, reader)) in (0u32..).zip(&self.readers) {
            reader.drain_notifications();
            // A sample that cannot be read is skipped; a stranger who sends nothing else does not keep this from going on.
            let mut unreadable = 0;
            while unreadable < MOST_UNREADABLE {
                match reader.take() {
                    Ok(Some(sample)) => take(number, *route, sample.bytes),
                    Ok(None) => break,
                    Err(_) => unreadable += 1,
                }
            }
        }
        Ok(())
    }

    /// What to say when nothing was heard for a while.
    pub fn hint(&self) -> String {
        let reach = if self.network.is_localhost() {
            "on this machine? Whorl looks no further unless ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET; what is on the network, and ROS 2 \
             by default, needs that on both sides"
        } else {
            "on this network (ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET there too)?"
        };
        format!(
            "nothing is heard in ROS domain {}: is a formation running there (ROS_DOMAIN_ID), with these platforms, {reach}",
            self.network.domain_id
        )
    }
}

fn join(
    network: &Network,
    routes: &[(Route, String)],
) -> anyhow::Result<(Participant, Vec<(Route, RawReader)>)> {
    Ok(Participant::with(network, |participant| {
        let reader = |(route, name): &(Route, String)| {
            let info = route.topic.info();
            let qos = EndpointQos::from(info.qos);
            Ok((*route, participant.reader(name, info.message_type.name(), qos)?))
        };
        routes.iter().map(reader).collect()
    })?)
}
