//! Who follows whom.

use thiserror::Error;

/// A forest: every platform has at most one leader, and no chain of leaders closes on itself.
///
/// A pair, a chain, a tree and several parallel leaders are all such forests.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeaderGraph {
    leaders: Vec<Option<usize>>,
    order: Vec<usize>,
}

/// An invalid graph. Platforms are named by their index.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum GraphError {
    /// The leader does not exist.
    #[error("platform {follower} follows platform {leader}, but there are only {platforms} platforms")]
    UnknownLeader {
        /// Who follows.
        follower: usize,
        /// The leader that does not exist.
        leader: usize,
        /// How many there are.
        platforms: usize,
    },
    /// Leaders in a circle.
    #[error("platforms {members:?} follow each other in a circle: one of them must lead")]
    Cycle {
        /// Those on the circle, each followed by its leader.
        members: Vec<usize>,
    },
}

impl LeaderGraph {
    /// From each platform's leader (`None`: it leads itself).
    ///
    /// # Errors
    /// A leader that does not exist, or a circle.
    pub fn new(leaders: Vec<Option<usize>>) -> Result<Self, GraphError> {
        let platforms = leaders.len();
        for (follower, leader) in leaders.iter().enumerate() {
            if let Some(leader) = leader.filter(|&l| l >= platforms) {
                return Err(GraphError::UnknownLeader { follower, leader, platforms });
            }
        }
        // Leaders first: from every platform walk up to a platform that is already placed.
        let mut placed = vec![false; platforms];
        let mut order = Vec::with_capacity(platforms);
        for start in 0..platforms {
            let mut chain: Vec<usize> = Vec::new();
            let mut next = Some(start);
            while let Some(platform) = next.filter(|&p| !placed[p]) {
                if let Some(first) = chain.iter().position(|&p| p == platform) {
                    return Err(GraphError::Cycle { members: chain.split_off(first) });
                }
                chain.push(platform);
                next = leaders[platform];
            }
            for &platform in chain.iter().rev() {
                placed[platform] = true;
                order.push(platform);
            }
        }
        Ok(Self { leaders, order })
    }

    /// How many platforms.
    #[must_use]
    pub fn len(&self) -> usize {
        self.leaders.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.leaders.is_empty()
    }

    /// The platform's leader; `None` for one that leads itself, and for one that does not exist.
    #[must_use]
    pub fn leader(&self, platform: usize) -> Option<usize> {
        self.leaders.get(platform).copied().flatten()
    }

    /// All platforms, every leader before its followers.
    #[must_use]
    pub fn leaders_first(&self) -> &[usize] {
        &self.order
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn circles_and_strangers_are_refused_by_name() {
        assert_eq!(
            LeaderGraph::new(vec![None, Some(2), Some(3), Some(1)]),
            Err(GraphError::Cycle { members: vec![1, 2, 3] })
        );
        assert_eq!(LeaderGraph::new(vec![Some(0)]), Err(GraphError::Cycle { members: vec![0] }));
        // A tail that leads into a circle is not on it.
        assert_eq!(
            LeaderGraph::new(vec![Some(1), Some(2), Some(1)]),
            Err(GraphError::Cycle { members: vec![1, 2] })
        );
        assert!(matches!(LeaderGraph::new(vec![None, Some(2)]), Err(GraphError::UnknownLeader { .. })));
    }

    proptest! {
        #[test]
        fn leaders_come_first_in_any_forest(choices in prop::collection::vec(any::<u16>(), 1..60)) {
            // Platform i follows a platform with a lower number after a random relabelling by reversal.
            let n = choices.len();
            let leaders = (0..n)
                .map(|i| {
                    let higher = n - 1 - i;
                    let choice = usize::from(choices[i]) % (higher + 1);
                    (choice != 0).then(|| i + choice)
                })
                .collect();
            let graph = LeaderGraph::new(leaders).expect("a forest");
            let position = |p: usize| graph.leaders_first().iter().position(|&x| x == p);
            for platform in 0..n {
                prop_assert!(position(platform).is_some());
                if let Some(leader) = graph.leader(platform) {
                    prop_assert!(position(leader) < position(platform));
                }
            }
            prop_assert_eq!(graph.leaders_first().len(), n);
        }
    }
}
