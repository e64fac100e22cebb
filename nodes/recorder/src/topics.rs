//! Which topics are recorded.

use whorl_msgs::topics::Qos;
use whorl_msgs::{PlatformId, Route, Topic};

/// A topic to record.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedTopic {
    /// Full name.
    pub name: String,
    /// ROS type, `package/msg/Type`.
    pub type_name: String,
    /// How it is sent.
    pub qos: Qos,
    /// The topic of Whorl, if it is one.
    pub route: Option<Route>,
}

impl RecordedTopic {
    /// Every topic of Whorl: of each platform, and the shared ones.
    #[must_use]
    pub fn all_of<S: AsRef<str>>(platforms: &[S]) -> Vec<Self> {
        let numbers = 0..u16::try_from(platforms.len()).unwrap_or(u16::MAX);
        let routes = Topic::ALL.iter().flat_map(|&topic| {
            let platforms: Vec<Option<PlatformId>> = if topic.info().per_platform {
                numbers.clone().map(|number| Some(PlatformId(number))).collect()
            } else {
                vec![None]
            };
            platforms.into_iter().map(move |platform| Route { platform, topic })
        });
        routes
            .filter_map(|route| {
                let info = route.topic.info();
                Some(Self {
                    name: route.name(platforms)?,
                    type_name: info.message_type.name().to_owned(),
                    qos: info.qos,
                    route: Some(route),
                })
            })
            .collect()
    }

    /// A topic of another program, written `NAME TYPE`, e.g. `/rosout rcl_interfaces/msg/Log`. Such a
    /// topic is read best effort, which every writer can serve.
    ///
    /// # Errors
    /// What is expected, in words.
    pub fn parse(text: &str) -> Result<Self, String> {
        let expected = || format!("`{text}`: allowed: `/TOPIC PACKAGE/msg/TYPE`");
        let mut words = text.split_whitespace();
        let (Some(name), Some(type_name), None) = (words.next(), words.next(), words.next()) else {
            return Err(expected());
        };
        let parts: Vec<&str> = type_name.split('/').collect();
        if !name.starts_with('/') || name.len() < 2 || !matches!(parts[..], [_, "msg", _]) {
            return Err(expected());
        }
        Ok(Self {
            name: name.to_owned(),
            type_name: type_name.to_owned(),
            qos: Qos { reliable: false, depth: 10 },
            route: None,
        })
    }
}
