//! Who listens to whom without a leader: a weighted directed graph with sources of the goal.

use thiserror::Error;

/// Iterations of the power method; its error after them is below `rho^200` of the second eigenvalue's share.
const POWER_STEPS: usize = 200;

/// Every platform's weights of its neighbours and of the experiment's goal, normalised to a sum of one.
///
/// The goal reaches every platform: from each there is a path of neighbours to one that knows it.
#[derive(Debug, Clone, PartialEq)]
pub struct NeighbourGraph {
    neighbours: Vec<Vec<(usize, f64)>>,
    goal: Vec<f64>,
}

/// What a platform listens to, as given.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Listening {
    /// Platforms that it hears, by index, each with its weight > 0.
    pub neighbours: Vec<(usize, f64)>,
    /// Weight of the experiment's goal, >= 0; 0: the platform does not know it.
    pub goal_weight: f64,
}

/// A graph over which no common attitude can be agreed on. Platforms are named by their index.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum NeighbourError {
    /// A neighbour that does not exist.
    #[error("platform {platform} listens to platform {neighbour}, but there are only {platforms} platforms")]
    Unknown {
        /// Who listens.
        platform: usize,
        /// To whom.
        neighbour: usize,
        /// How many there are.
        platforms: usize,
    },
    /// A platform that listens to itself, or twice to another.
    #[error("platform {platform} lists platform {neighbour} as a neighbour of its own or twice")]
    Repeated {
        /// Who listens.
        platform: usize,
        /// To whom.
        neighbour: usize,
    },
    /// An invalid weight.
    #[error("platform {platform}: a weight is {value}: it must be positive and finite (the goal's may be 0)")]
    Weight {
        /// Who listens.
        platform: usize,
        /// As given.
        value: f64,
    },
    /// The goal does not reach every platform.
    #[error(
        "the graph is not connected: no path of neighbours leads from platforms {platforms:?} to one that knows the goal"
    )]
    Unconnected {
        /// Those that the goal does not reach.
        platforms: Vec<usize>,
    },
}

impl NeighbourGraph {
    /// Checks and normalises what each platform listens to.
    ///
    /// # Errors
    /// An unknown or repeated neighbour, an invalid weight, or platforms that the goal does not reach.
    pub fn new(listening: &[Listening]) -> Result<Self, NeighbourError> {
        let platforms = listening.len();
        let mut neighbours = Vec::with_capacity(platforms);
        let mut goal = Vec::with_capacity(platforms);
        for (platform, own) in listening.iter().enumerate() {
            let bad_goal = !(own.goal_weight >= 0.0 && own.goal_weight.is_finite());
            let bad = own.neighbours.iter().map(|(_, w)| *w).find(|w| !(*w > 0.0 && w.is_finite()));
            if let Some(value) = bad.or(bad_goal.then_some(own.goal_weight)) {
                return Err(NeighbourError::Weight { platform, value });
            }
            for (index, (neighbour, _)) in own.neighbours.iter().enumerate() {
                let neighbour = *neighbour;
                if neighbour >= platforms {
                    return Err(NeighbourError::Unknown { platform, neighbour, platforms });
                }
                let earlier = own.neighbours.iter().take(index).any(|(other, _)| *other == neighbour);
                if neighbour == platform || earlier {
                    return Err(NeighbourError::Repeated { platform, neighbour });
                }
            }
            let sum: f64 = own.neighbours.iter().map(|(_, w)| w).sum::<f64>() + own.goal_weight;
            // A platform without any source is found below: the goal does not reach it.
            let scale = if sum > 0.0 { 1.0 / sum } else { 0.0 };
            neighbours.push(own.neighbours.iter().map(|(j, w)| (*j, w * scale)).collect());
            goal.push(own.goal_weight * scale);
        }
        let graph = Self { neighbours, goal };
        let reached = graph.reached_from_goal(|_| true);
        let missing: Vec<usize> = (0..platforms).filter(|p| !reached[*p]).collect();
        if missing.is_empty() { Ok(graph) } else { Err(NeighbourError::Unconnected { platforms: missing }) }
    }

    /// How many platforms.
    #[must_use]
    pub fn len(&self) -> usize {
        self.goal.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.goal.is_empty()
    }

    /// The platform's neighbours with their normalised weights.
    #[must_use]
    pub fn neighbours(&self, platform: usize) -> &[(usize, f64)] {
        self.neighbours.get(platform).map_or(&[], Vec::as_slice)
    }

    /// The goal's normalised weight at a platform; 0 for one that does not know it.
    #[must_use]
    pub fn goal_weight(&self, platform: usize) -> f64 {
        self.goal.get(platform).copied().unwrap_or(0.0)
    }

    /// Which platforms the goal reaches when only some can be heard.
    pub fn reached_from_goal(&self, heard: impl Fn(usize) -> bool) -> Vec<bool> {
        let platforms = self.goal.len();
        let mut reached: Vec<bool> = (0..platforms).map(|p| self.goal[p] > 0.0 && heard(p)).collect();
        let mut changed = true;
        while changed {
            changed = false;
            for platform in 0..platforms {
                let next = !reached[platform]
                    && heard(platform)
                    && self.neighbours[platform].iter().any(|(j, _)| reached[*j]);
                reached[platform] |= next;
                changed |= next;
            }
        }
        reached
    }

    /// Spectral radius of the matrix of the neighbours' weights: below 1 because the goal reaches all, 0
    /// for a forest that listens towards its roots only.
    #[must_use]
    pub fn spectral_radius(&self) -> f64 {
        let platforms = self.goal.len();
        if platforms == 0 {
            return 0.0;
        }
        // On (I + A)/2, whose largest eigenvalue is (1 + rho)/2 and alone: a bipartite graph has -rho too.
        let mut v = vec![1.0; platforms];
        let mut growth = 1.0;
        for _ in 0..POWER_STEPS {
            let next: Vec<f64> = (0..platforms)
                .map(|p| {
                    let heard: f64 = self.neighbours[p].iter().map(|(j, w)| w * v[*j]).sum();
                    0.5 * (v[p] + heard)
                })
                .collect();
            growth = next.iter().copied().fold(0.0, f64::max);
            if growth <= 0.0 {
                return 0.0;
            }
            v = next.into_iter().map(|x| x / growth).collect();
        }
        (2.0 * growth - 1.0).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn hears(neighbours: &[usize], goal_weight: f64) -> Listening {
        Listening { neighbours: neighbours.iter().map(|j| (*j, 1.0)).collect(), goal_weight }
    }

    #[test]
    fn what_the_goal_does_not_reach_is_named() {
        let two_islands = [hears(&[1], 1.0), hears(&[0], 0.0), hears(&[3], 0.0), hears(&[2], 0.0)];
        assert_eq!(
            NeighbourGraph::new(&two_islands),
            Err(NeighbourError::Unconnected { platforms: vec![2, 3] })
        );
        assert!(NeighbourGraph::new(&two_islands).unwrap_err().to_string().contains("not connected"));
        let deaf = [hears(&[], 1.0), hears(&[], 0.0)];
        assert_eq!(NeighbourGraph::new(&deaf), Err(NeighbourError::Unconnected { platforms: vec![1] }));
        assert!(matches!(NeighbourGraph::new(&[hears(&[0], 1.0)]), Err(NeighbourError::Repeated { .. })));
        assert!(matches!(NeighbourGraph::new(&[hears(&[4], 1.0)]), Err(NeighbourError::Unknown { .. })));
        let negative = [Listening { neighbours: vec![], goal_weight: -1.0 }];
        assert!(matches!(NeighbourGraph::new(&negative), Err(NeighbourError::Weight { .. })));
    }

    #[test]
    fn spectral_radii_match_their_closed_forms() {
        // Complete graph of n where all know the goal: all weights 1/n, radius (n - 1)/n.
        for n in [2_usize, 3, 7] {
            let all: Vec<_> =
                (0..n).map(|i| hears(&(0..n).filter(|j| *j != i).collect::<Vec<_>>(), 1.0)).collect();
            let radius = NeighbourGraph::new(&all).unwrap().spectral_radius();
            assert!((radius - (n as f64 - 1.0) / n as f64).abs() < 1e-9, "{n}: {radius}");
        }
        // A pair where one knows the goal: A = [[0, 1/2], [1, 0]], eigenvalues +- sqrt(1/2).
        let pair = [hears(&[1], 1.0), hears(&[0], 0.0)];
        assert!((NeighbourGraph::new(&pair).unwrap().spectral_radius() - 0.5_f64.sqrt()).abs() < 1e-9);
        // A chain that listens one way: nilpotent. The power method nears 0 as 1/steps.
        let chain = [hears(&[], 1.0), hears(&[0], 0.0), hears(&[1], 0.0)];
        assert!(NeighbourGraph::new(&chain).unwrap().spectral_radius() < 0.03);
    }

    proptest! {
        #[test]
        fn a_goal_that_reaches_all_keeps_the_radius_below_one(
            edges in prop::collection::vec((0..8_usize, 0..8_usize, 0.1..5.0_f64), 0..40),
            goals in prop::collection::vec(prop_oneof![Just(0.0), 0.1..3.0_f64], 8),
        ) {
            let mut listening: Vec<Listening> =
                goals.iter().map(|g| Listening { neighbours: vec![], goal_weight: *g }).collect();
            for (i, j, w) in edges {
                if i != j && listening[i].neighbours.iter().all(|(k, _)| *k != j) {
                    listening[i].neighbours.push((j, w));
                }
            }
            match NeighbourGraph::new(&listening) {
                Ok(graph) => prop_assert!(graph.spectral_radius() < 1.0),
                Err(NeighbourError::Unconnected { platforms }) => prop_assert!(!platforms.is_empty()),
                Err(other) => prop_assert!(false, "{other}"),
            }
        }
    }
}
