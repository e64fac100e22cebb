//! Every topic for Foxglove and Lichtblick, over their WebSocket protocol
//! (<https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md>, version 1). Messages go out as they came over DDS, in
//! CDR with the definitions that recordings have; nothing comes in but what a client wants to see.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::ws::{Message, WebSocket};
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::sync::broadcast;
use whorl_msgs::definitions;
use whorl_msgs::topics::Topic;
use whorl_ros::environment::Network;
use whorl_serving::{PATIENCE, Place};

use crate::output::tell;
use crate::subscription::Subscription;

/// Names of the protocol: of its specification, and of what the Foxglove SDK calls the same.
pub const PROTOCOLS: [&str; 2] = ["foxglove.websocket.v1", "foxglove.sdk.v1"];
/// Messages that wait for a slow client; what is older is lost to it, and nobody waits.
const WAITING: usize = 2048;
/// Time between two looks for messages.
const LOOK: Duration = Duration::from_millis(5);
/// Opcode of a message of a channel.
const MESSAGE_DATA: u8 = 1;
/// A list of subscriptions to everything is shorter.
pub const LARGEST_REQUEST: usize = 64 * 1024;

/// A message as it came over DDS.
#[derive(Debug)]
struct Sample {
    channel: u32,
    received_ns: u64,
    bytes: Vec<u8>,
}

/// What clients are told of and can subscribe to.
#[derive(Debug)]
pub struct Feed {
    name: String,
    channels: Vec<Value>,
    samples: broadcast::Sender<Arc<Sample>>,
}

impl Feed {
    /// Listens to every topic of these platforms in a thread of its own.
    pub fn start(network: &Network, platforms: &[String]) -> anyhow::Result<Arc<Self>> {
        let (of_platforms, shared): (Vec<Topic>, Vec<Topic>) =
            Topic::ALL.iter().copied().partition(|topic| topic.info().per_platform);
        let mut subscription = Subscription::new(network, platforms, &shared, &of_platforms)?;
        let channels = (0u32..).zip(subscription.routes()).map(|(id, (route, name))| {
            let message_type = route.topic.info().message_type.name();
            let schema = definitions::find(message_type).map_or_else(String::new, |found| found.schema());
            json!({
                "id": id, "topic": name, "encoding": "cdr",
                "schemaName": message_type, "schema": schema, "schemaEncoding": "ros2msg",
            })
        });
        let feed = Arc::new(Self {
            name: format!("Whorl: {}", platforms.join(", ")),
            channels: channels.collect(),
            samples: broadcast::Sender::new(WAITING),
        });
        let weak = Arc::downgrade(&feed);
        std::thread::Builder::new().name("foxglove".to_owned()).spawn(move || {
            while let Some(feed) = weak.upgrade() {
                let received_ns = u64::try_from(whorl_ros::wall_clock().0).unwrap_or_default();
                let drained = subscription.drain_raw(|channel, _, bytes| {
                    // Without a client nothing is kept.
                    if feed.samples.receiver_count() > 0 {
                        let _ = feed.samples.send(Arc::new(Sample { channel, received_ns, bytes }));
                    }
                });
                if let Err(error) = drained {
                    tell(format_args!("warning: Foxglove hears nothing more: {error:#}"));
                    return;
                }
                std::thread::sleep(LOOK);
            }
        })?;
        Ok(feed)
    }
}

/// What clients ask for; other requests of the protocol are for servers that take commands.
#[derive(Debug, Deserialize)]
#[serde(tag = "op", rename_all = "camelCase")]
enum Wanted {
    Subscribe {
        subscriptions: Vec<SubscriptionRequest>,
    },
    #[serde(rename_all = "camelCase")]
    Unsubscribe {
        subscription_ids: Vec<u32>,
    },
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct SubscriptionRequest {
    id: u32,
    channel_id: u32,
}

/// Channel by subscription.
type Subscriptions = HashMap<u32, u32>;

/// Serves one client until it leaves.
pub async fn serve(mut socket: WebSocket, feed: Arc<Feed>, place: Place) {
    let mut samples = feed.samples.subscribe();
    let info = json!({"op": "serverInfo", "name": feed.name, "capabilities": [], "metadata": {}});
    let advertised = json!({"op": "advertise", "channels": feed.channels});
    for told in [info, advertised] {
        if !sent(&mut socket, Message::text(told.to_string())).await {
            return;
        }
    }
    let mut subscriptions = Subscriptions::new();
    loop {
        tokio::select! {
            () = place.is_lost() => return,
            received = socket.recv() => match received {
                Some(Ok(Message::Text(text))) => {
                    place.heard();
                    apply(&text, feed.channels.len(), &mut subscriptions);
                }
                Some(Ok(Message::Close(_)) | Err(_)) | None => return,
                Some(Ok(_)) => {}
            },
            sample = samples.recv() => match sample {
                Ok(sample) => {
                    for (id, _) in subscriptions.iter().filter(|(_, channel)| **channel == sample.channel) {
                        let data = message_data(*id, sample.received_ns, &sample.bytes);
                        if !sent(&mut socket, Message::binary(data)).await {
                            return;
                        }
                    }
                }
                Err(broadcast::error::RecvError::Lagged(_)) => {}
                Err(broadcast::error::RecvError::Closed) => return,
            },
        }
    }
}

async fn sent(socket: &mut WebSocket, message: Message) -> bool {
    matches!(tokio::time::timeout(PATIENCE, socket.send(message)).await, Ok(Ok(())))
}

fn apply(text: &str, channels: usize, subscriptions: &mut Subscriptions) {
    match serde_json::from_str(text) {
        Ok(Wanted::Subscribe { subscriptions: new }) => {
            let known = new.iter().filter(|s| usize::try_from(s.channel_id).is_ok_and(|id| id < channels));
            // Nobody needs more views of a channel than there are channels.
            for request in known.take((4 * channels).saturating_sub(subscriptions.len())) {
                subscriptions.insert(request.id, request.channel_id);
            }
        }
        Ok(Wanted::Unsubscribe { subscription_ids }) => {
            for id in &subscription_ids {
                subscriptions.remove(id);
            }
        }
        Err(_) => {}
    }
}

/// Opcode, subscription and time \[ns since 1970\], little-endian, then the message.
fn message_data(subscription: u32, received_ns: u64, bytes: &[u8]) -> Vec<u8> {
    let mut data = Vec::with_capacity(13 + bytes.len());
    data.push(MESSAGE_DATA);
    data.extend(subscription.to_le_bytes());
    data.extend(received_ns.to_le_bytes());
    data.extend(bytes);
    data
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_framed_as_the_protocol_says() {
        let data = message_data(0x0403_0201, 0x0c0b_0a09_0807_0605, &[0xaa, 0xbb]);
        assert_eq!(data, [1, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 0xaa, 0xbb]);
    }

    #[test]
    fn clients_subscribe_and_unsubscribe_and_nothing_else() {
        let mut subscriptions = Subscriptions::new();
        apply(
            r#"{"op":"subscribe","subscriptions":[{"id":7,"channelId":1},{"id":8,"channelId":9}]}"#,
            3,
            &mut subscriptions,
        );
        assert_eq!(subscriptions, HashMap::from([(7, 1)]), "there is no channel 9");
        for nonsense in ["", "{}", r#"{"op":"setParameters"}"#, r#"{"op":"subscribe","subscriptions":[{}]}"#]
        {
            apply(nonsense, 3, &mut subscriptions);
        }
        assert_eq!(subscriptions.len(), 1);
        apply(r#"{"op":"unsubscribe","subscriptionIds":[7]}"#, 3, &mut subscriptions);
        assert!(subscriptions.is_empty());
    }
}
