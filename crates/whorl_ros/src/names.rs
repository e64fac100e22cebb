//! ROS names: what is allowed, and how they map to DDS.
//!
//! <https://design.ros2.org/articles/topic_and_service_names.html>

use thiserror::Error;

/// A name that ROS would not accept.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("`{name}` is not a valid {kind}: {reason}")]
pub struct NameError {
    /// The name.
    pub name: String,
    /// Namespace, node name, ...
    pub kind: &'static str,
    /// What is wrong with it.
    pub reason: &'static str,
}

fn token(kind: &'static str, whole: &str, token: &str) -> Result<(), NameError> {
    let error = |reason| Err(NameError { name: whole.to_owned(), kind, reason });
    match token.bytes().next() {
        None => return error("empty, or `//` or `/` at its end"),
        Some(b'0'..=b'9') => return error("a part begins with a digit"),
        Some(_) => {}
    }
    if !token.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_') {
        return error("only letters, digits and `_` are allowed between `/`");
    }
    if token.contains("__") {
        return error("`__` is reserved");
    }
    Ok(())
}

/// Checks a node's base name.
///
/// # Errors
/// [`NameError`].
pub fn base_name(name: &str) -> Result<String, NameError> {
    token("node name", name, name).map(|()| name.to_owned())
}

/// Checks a namespace; a missing leading `/` is added, as `rcl` does.
///
/// # Errors
/// [`NameError`].
pub fn namespace(name: &str) -> Result<String, NameError> {
    let relative = name.strip_prefix('/').unwrap_or(name);
    if !relative.is_empty() {
        relative.split('/').try_for_each(|part| token("namespace", name, part))?;
    }
    Ok(format!("/{relative}"))
}

/// Checks a topic or service name: absolute, relative, or private (`~/`).
///
/// # Errors
/// [`NameError`].
pub fn topic_name(name: &str) -> Result<(), NameError> {
    let relative = name.strip_prefix("~/").or_else(|| name.strip_prefix('/')).unwrap_or(name);
    relative.split('/').try_for_each(|part| token("topic or service name", name, part))
}

/// A node's full name and what follows from it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeName {
    namespace: String,
    base: String,
}

impl NodeName {
    /// A name from its checked parts.
    ///
    /// # Errors
    /// [`NameError`].
    pub fn new(namespace: &str, base: &str) -> Result<Self, NameError> {
        Ok(Self { namespace: self::namespace(namespace)?, base: base_name(base)? })
    }

    /// `/` or `/whorl_1`.
    #[must_use]
    pub fn namespace(&self) -> &str {
        &self.namespace
    }

    /// Without the namespace.
    #[must_use]
    pub fn base(&self) -> &str {
        &self.base
    }

    /// `/whorl_1/estimator`.
    #[must_use]
    pub fn full(&self) -> String {
        format!("{}/{}", self.namespace.trim_end_matches('/'), self.base)
    }

    /// Completes a relative or private name.
    #[must_use]
    pub fn resolve(&self, name: &str) -> String {
        if name.starts_with('/') {
            name.to_owned()
        } else if let Some(private) = name.strip_prefix("~/") {
            format!("{}/{private}", self.full())
        } else {
            format!("{}/{name}", self.namespace.trim_end_matches('/'))
        }
    }
}

/// DDS name of a topic: `rt/whorl_1/imu/data_raw`.
#[must_use]
pub fn dds_topic(name: &str) -> String {
    format!("rt/{}", name.trim_start_matches('/'))
}

/// ROS name of a DDS topic, if it is one.
#[must_use]
pub fn ros_topic(dds_name: &str) -> Option<String> {
    dds_name.strip_prefix("rt/").map(|name| format!("/{name}"))
}

/// DDS name of a type: `sensor_msgs::msg::dds_::Imu_` for `sensor_msgs/msg/Imu`. A name that does
/// not have three parts is returned as it is.
#[must_use]
pub fn dds_type(ros_type: &str) -> String {
    match ros_type.split('/').collect::<Vec<_>>().as_slice() {
        [package, kind, name] => format!("{package}::{kind}::dds_::{name}_"),
        _ => ros_type.to_owned(),
    }
}

/// ROS name of a DDS type, if it is one.
#[must_use]
pub fn ros_type(dds_type: &str) -> Option<String> {
    match dds_type.split("::").collect::<Vec<_>>().as_slice() {
        [package, kind, "dds_", name] => Some(format!("{package}/{kind}/{}", name.strip_suffix('_')?)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_joined_as_ros_does() {
        let node = NodeName::new("/whorl_1", "estimator").unwrap();
        assert_eq!(node.full(), "/whorl_1/estimator");
        assert_eq!(node.resolve("imu/data_raw"), "/whorl_1/imu/data_raw");
        assert_eq!(node.resolve("/imu"), "/imu");
        assert_eq!(node.resolve("~/state"), "/whorl_1/estimator/state");
        let root = NodeName::new("/", "coordinator").unwrap();
        assert_eq!(root.full(), "/coordinator");
        assert_eq!(root.resolve("tf"), "/tf");
        assert_eq!(NodeName::new("whorl_1", "a").unwrap().namespace(), "/whorl_1");
    }

    #[test]
    fn the_rules_of_the_design_article_hold() {
        for bad in ["", "/", "a//b", "a/", "a b", "1a", "a/1b", "a__b", "a-b", "\u{fc}"] {
            assert!(topic_name(bad).is_err(), "{bad:?}");
        }
        for good in ["a", "/a/b_1", "~/a", "A9"] {
            assert!(topic_name(good).is_ok(), "{good:?}");
        }
        assert!(namespace("/").is_ok() && namespace("/a/").is_err() && base_name("a/b").is_err());
    }

    #[test]
    fn dds_names_are_those_seen_on_the_wire() {
        assert_eq!(dds_topic("/whorl_1/imu/data_raw"), "rt/whorl_1/imu/data_raw");
        assert_eq!(ros_topic("rt/tf").as_deref(), Some("/tf"));
        assert_eq!(ros_topic("rq/xRequest"), None);
        assert_eq!(dds_type("sensor_msgs/msg/Imu"), "sensor_msgs::msg::dds_::Imu_");
        assert_eq!(ros_type("sensor_msgs::msg::dds_::Imu_").as_deref(), Some("sensor_msgs/msg/Imu"));
        assert_eq!(ros_type("Imu"), None);
    }
}
