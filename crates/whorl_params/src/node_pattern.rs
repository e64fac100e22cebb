//! Node names with wildcards, as section names of parameter files.

use std::fmt;

/// A section name: `/whorl_1/estimator`, `/**`, `/*`, `/whorl_1/**`, `/**/estimator`.
/// `*` stands for one part of a name, `**` for any number of parts, none included.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct NodePattern {
    parts: Vec<Part>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Part {
    Name(String),
    One,
    Any,
}

impl NodePattern {
    /// From section names, outermost first; each may hold several parts.
    pub fn parse(names: &[&str]) -> Result<Self, String> {
        let mut parts = Vec::new();
        for name in names {
            let inner = name.strip_prefix('/').unwrap_or(name);
            for part in inner.split('/') {
                parts.push(match part {
                    "*" => Part::One,
                    "**" => Part::Any,
                    word if is_ros_name(word) => Part::Name(word.to_owned()),
                    _ => {
                        return Err(format!(
                            "`{name}` is not a node name; allowed: parts of letters, digits and _ (the first no digit), `*` or `**`, joined by /"
                        ));
                    }
                });
            }
        }
        Ok(Self { parts })
    }

    pub fn matches(&self, node: &str) -> bool {
        let names: Vec<&str> = node.split('/').filter(|part| !part.is_empty()).collect();
        matches(&self.parts, &names)
    }

    /// The first part, when it is a name and not the whole pattern.
    pub fn namespace(&self) -> Option<&str> {
        match self.parts.as_slice() {
            [Part::Name(name), _, ..] => Some(name),
            _ => None,
        }
    }

    /// True when the section does not name its node: it ends in `*` or `**`.
    pub fn ends_in_wildcard(&self) -> bool {
        !matches!(self.parts.last(), Some(Part::Name(_)))
    }

    /// Larger wins within a file: more parts named, then the node itself named, then more parts
    /// counted by `*` instead of left open by `**`.
    pub fn specificity(&self) -> (usize, bool, usize) {
        let count = |test: fn(&Part) -> bool| self.parts.iter().filter(|part| test(part)).count();
        (
            count(|part| matches!(part, Part::Name(_))),
            !self.ends_in_wildcard(),
            count(|part| matches!(part, Part::One)),
        )
    }
}

fn matches(parts: &[Part], names: &[&str]) -> bool {
    match (parts.split_first(), names.split_first()) {
        (None, None) => true,
        (None, Some(_)) => false,
        (Some((Part::Any, rest)), None) => matches(rest, names),
        (Some((Part::Any, rest)), Some((_, names_rest))) => {
            matches(rest, names) || matches(parts, names_rest)
        }
        (Some(_), None) => false,
        (Some((Part::One, rest)), Some((_, names_rest))) => matches(rest, names_rest),
        (Some((Part::Name(part), rest)), Some((name, names_rest))) => {
            part == name && matches(rest, names_rest)
        }
    }
}

/// A name part that ROS 2 allows.
pub(crate) fn is_ros_name(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && word.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}

impl fmt::Display for NodePattern {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for part in &self.parts {
            match part {
                Part::Name(name) => write!(f, "/{name}")?,
                Part::One => write!(f, "/*")?,
                Part::Any => write!(f, "/**")?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pattern(text: &str) -> NodePattern {
        NodePattern::parse(&[text]).unwrap()
    }

    #[test]
    fn matches_as_ros_does() {
        let table = [
            ("/**", "/whorl_1/estimator", true),
            ("/**", "/coordinator", true),
            ("/*", "/coordinator", true),
            ("/*", "/whorl_1/estimator", false),
            ("/*/estimator", "/whorl_1/estimator", true),
            ("/*/estimator", "/lab/whorl_1/estimator", false),
            ("/whorl_1/**", "/whorl_1/estimator", true),
            ("/whorl_1/**", "/whorl_2/estimator", false),
            ("/**/estimator", "/whorl_2/estimator", true),
            ("/**/estimator", "/estimator", true),
            ("/**/estimator", "/whorl_2/driver", false),
            ("/**/b/**/d", "/a/b/c/c/d", true),
            ("/**/b/**/d", "/a/b/c/c/e", false),
            ("coordinator", "/coordinator", true),
            ("/whorl_1/estimator", "/whorl_1/estimator", true),
            ("/whorl_1/estimator", "/whorl_1/estimator_2", false),
        ];
        for (text, node, expected) in table {
            assert_eq!(pattern(text).matches(node), expected, "{text} on {node}");
        }
    }

    #[test]
    fn more_named_parts_are_more_specific() {
        let ascending =
            ["/**", "/*", "/whorl_1/**", "/whorl_1/*", "/**/estimator", "/*/estimator", "/whorl_1/estimator"];
        for pair in ascending.windows(2) {
            assert!(pattern(pair[0]).specificity() < pattern(pair[1]).specificity(), "{pair:?}");
        }
    }

    #[test]
    fn refuses_other_names() {
        for text in ["", "/", "/whorl 1", "/1whorl", "/a//b", "/***", "/a/"] {
            assert!(NodePattern::parse(&[text]).is_err(), "{text}");
        }
    }
}
