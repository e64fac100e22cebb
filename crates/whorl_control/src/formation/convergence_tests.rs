//! Closed loops of laws, shapers and lagging platforms over random graphs, gains and delays: they stay
//! bounded and converge. A platform is a critically damped second-order loop with feed-forward.

use std::collections::VecDeque;

use super::shaper_tests::{DT_S, dumbbell};
use super::*;
use crate::reference::Reference;
use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;
use whorl_math::{attitude_error, quaternion_exp};

fn yaw(angle_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad)
}

/// A platform whose attitude follows its reference with its own bandwidth.
struct Platform {
    shaper: ReferenceShaper,
    q: UnitQuaternion<f64>,
    omega: Vector3<f64>,
    bandwidth: f64,
    /// Stays where it is, whatever is asked.
    stuck: bool,
}

impl Platform {
    fn advance(&mut self) {
        self.shaper.advance(DT_S);
        let reference = self.shaper.reference();
        if self.stuck {
            self.omega = Vector3::zeros();
            return;
        }
        let error = attitude_error(&reference.q_world_reference, &self.q);
        let to_body = self.q.inverse() * reference.q_world_reference;
        let omega_error = self.omega - to_body * reference.omega_wr_r_rad_s;
        let w = self.bandwidth;
        let acceleration =
            to_body * reference.omega_dot_wr_r_rad_s2 - error * (w * w) - omega_error * (2.0 * w);
        self.omega += acceleration * DT_S;
        self.q *= quaternion_exp(&(self.omega * DT_S));
    }

    fn member(&self) -> Member {
        Member {
            q_world_body: self.q,
            omega_wb_b_rad_s: self.omega,
            age_s: 0.0,
            usable: true,
            tracking: true,
            reference: self.shaper.reference(),
        }
    }
}

/// Platforms, the law that each of them runs, and a delay on everything that comes from another.
struct Laboratory {
    laws: Vec<Box<dyn RelativeAttitudeLaw>>,
    platforms: Vec<Platform>,
    goals: Goals,
    offsets: Vec<Offset>,
    delay_steps: usize,
    past: VecDeque<Vec<Member>>,
    lost: Vec<bool>,
}

impl Laboratory {
    /// One law for each platform: as when every platform runs its own.
    fn new(
        laws: Vec<Box<dyn RelativeAttitudeLaw>>,
        offsets: &[UnitQuaternion<f64>],
        delay_steps: usize,
    ) -> Self {
        let platform = |i: usize| {
            let q = yaw(0.15 * i as f64 - 0.2);
            Platform {
                shaper: ReferenceShaper::new(dumbbell(), 2.0, &q).unwrap(),
                q,
                omega: Vector3::zeros(),
                bandwidth: 2.0,
                stuck: false,
            }
        };
        let mut laboratory = Self {
            laws,
            platforms: (0..offsets.len()).map(platform).collect(),
            goals: Goals { formation: Reference::at_rest(UnitQuaternion::identity()), individual: vec![] },
            offsets: offsets.iter().map(|q| Offset::constant(*q)).collect(),
            delay_steps,
            past: VecDeque::new(),
            lost: vec![false; offsets.len()],
        };
        let members: Vec<Member> = laboratory.platforms.iter().map(Platform::member).collect();
        let input = LawInput {
            dt_s: DT_S,
            members: &members,
            goals: &laboratory.goals,
            offsets: &laboratory.offsets,
        };
        laboratory.laws.iter_mut().for_each(|law| law.restart(&input));
        laboratory
    }

    fn step(&mut self) {
        self.platforms.iter_mut().for_each(Platform::advance);
        let present: Vec<Member> = self.platforms.iter().map(Platform::member).collect();
        self.past.push_front(present.clone());
        self.past.truncate(self.delay_steps + 1);
        let delayed = self.past.back().unwrap();
        let mut demands = vec![];
        for own in 0..self.platforms.len() {
            let mut members = delayed.clone();
            members[own] = present[own];
            for (member, lost) in members.iter_mut().zip(&self.lost) {
                member.usable &= !lost;
            }
            let input =
                LawInput { dt_s: DT_S, members: &members, goals: &self.goals, offsets: &self.offsets };
            self.laws[own].demands(&input, &mut demands);
            self.platforms[own].shaper.plan(&demands[own], DT_S);
        }
    }

    /// Largest error of a platform against its place in the formation at the goal \[rad\].
    fn goal_error(&self) -> f64 {
        let error = |(p, o): (&Platform, &Offset)| {
            let place = o.apply(&self.goals.formation).q_world_reference;
            attitude_error(&place, &p.q).norm()
        };
        self.platforms.iter().zip(&self.offsets).map(error).fold(0.0, f64::max)
    }

    fn fastest(&self) -> f64 {
        self.platforms.iter().map(|p| p.omega.norm()).fold(0.0, f64::max)
    }
}

fn boxed(law: &(impl RelativeAttitudeLaw + Clone + 'static), n: usize) -> Vec<Box<dyn RelativeAttitudeLaw>> {
    (0..n).map(|_| Box::new(law.clone()) as Box<dyn RelativeAttitudeLaw>).collect()
}

/// A random graph over which the goal reaches everybody: a random tree, and more edges.
fn graphs() -> impl Strategy<Value = NeighbourGraph> {
    let n = 2..6_usize;
    n.prop_flat_map(|n| {
        (
            prop::collection::vec((any::<usize>(), 0.2..3.0_f64), n),
            prop::collection::vec((0..n, 0..n, 0.2..3.0_f64), 0..2 * n),
            0.3..3.0_f64,
        )
    })
    .prop_map(|(parents, edges, goal)| {
        let mut listening: Vec<Listening> = vec![Listening::default(); parents.len()];
        listening[0].goal_weight = goal;
        for (i, (parent, weight)) in parents.iter().enumerate().skip(1) {
            listening[i].neighbours.push((parent % i, *weight));
        }
        for (i, j, weight) in edges {
            if i != j && listening[i].neighbours.iter().all(|(k, _)| *k != j) {
                listening[i].neighbours.push((j, weight));
            }
        }
        NeighbourGraph::new(&listening).unwrap()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn decentralised_converges_for_every_graph_delay_and_allowed_share(
        graph in graphs(),
        share in 0.0..0.95_f64,
        delay_steps in 0..15_usize,
        goal in prop::array::uniform3(-0.3..0.3_f64),
        cap in prop::option::of(2.0..20.0_f64),
    ) {
        let n = graph.len();
        let error_share = share * Decentralised::error_share_bound(&graph).min(1.0);
        let traffic = cap.map(|rate_max_hz| TrafficCap { rate_max_hz, trigger_rad: 0.002, heartbeat_s: 1.0 });
        let capped = traffic.is_some();
        let radius = graph.spectral_radius();
        let law = Decentralised::new(DecentralisedSettings { graph, error_share, traffic }).unwrap();
        let offsets: Vec<_> = (0..n).map(|i| yaw(0.2 * i as f64)).collect();
        let mut lab = Laboratory::new(boxed(&law, n), &offsets, delay_steps);
        lab.goals.formation = Reference::at_rest(quaternion_exp(&Vector3::from(goal)));
        let mut fastest = 0.0_f64;
        // Information propagates through the graph: 1/(1 - rho) of the shaper's time and of the delay.
        let tau_s = (1.0 + delay_steps as f64 * DT_S) / (1.0 - radius);
        let steps = ((30.0 + 14.0 * tau_s) / DT_S) as usize;
        for _ in 0..steps {
            lab.step();
            fastest = fastest.max(lab.fastest());
        }
        prop_assert!(fastest < 0.15, "{fastest}");
        // Each hop may add the trigger; what loops back adds it again.
        let allowed = if capped { 0.002 * n as f64 / (1.0 - radius) } else { 2e-4 };
        prop_assert!(lab.goal_error() < allowed, "{} of {allowed}, rho {radius}", lab.goal_error());
    }

    #[test]
    fn leader_follower_chains_converge_whatever_the_delay(
        n in 2..6_usize,
        parents in prop::collection::vec(any::<usize>(), 6),
        delay_steps in 0..25_usize,
        goal in prop::array::uniform3(-0.3..0.3_f64),
    ) {
        let leaders: Vec<_> = (0..n).map(|i| (i > 0).then(|| parents[i] % i)).collect();
        let law = LeaderFollower::new(LeaderGraph::new(leaders.clone()).unwrap());
        let offsets: Vec<_> = (0..n).map(|i| yaw(if i == 0 { 0.0 } else { 0.1 })).collect();
        let mut lab = Laboratory::new(boxed(&law, n), &offsets, delay_steps);
        lab.goals.formation = Reference::at_rest(quaternion_exp(&Vector3::from(goal)));
        for _ in 0..3000 {
            lab.step();
            prop_assert!(lab.fastest() < 0.15);
        }
        // Every platform stands at the product of the offsets up to its root.
        for i in 0..n {
            let mut place = UnitQuaternion::identity();
            let mut at = Some(i);
            while let Some(platform) = at {
                if leaders[platform].is_some() {
                    place = yaw(0.1) * place;
                }
                at = leaders[platform];
            }
            let wanted = lab.goals.formation.q_world_reference * place;
            prop_assert!(attitude_error(&wanted, &lab.platforms[i].q).norm() < 1e-4);
        }
    }

    #[test]
    fn structure_behaviours_and_perceptive_frame_converge_in_their_proven_ranges(
        which in 0..3_u8,
        bandwidth in 0.1..0.6_f64,
        damping in 1.0..2.0_f64,
        share in 0.0..0.9_f64,
        delay_steps in 0..10_usize,
        goal in prop::array::uniform3(-0.3..0.3_f64),
    ) {
        let n = 3;
        let (rate_max_rad_s, acceleration_max_rad_s2) = (0.05, 0.015);
        let laws = match which {
            0 => boxed(&VirtualStructure::new(VirtualStructureGains {
                bandwidth_rad_s: bandwidth,
                damping,
                half_speed_error_rad: 0.002 + 0.05 * share,
                rate_max_rad_s,
                acceleration_max_rad_s2,
            }).unwrap(), n),
            1 => boxed(&PerceptiveFrame::new(PerceptiveFrameGains {
                bandwidth_rad_s: bandwidth,
                damping,
                perception_gain_s: 4.0 * share,
                member_bandwidth_rad_s: 2.0,
                rate_max_rad_s,
                acceleration_max_rad_s2,
            }).unwrap(), n),
            _ => boxed(&Behavioural::new(BehaviouralSettings {
                goal_bandwidth_rad_s: bandwidth,
                keeping_bandwidth_rad_s: share,
                damping,
                rate_max_rad_s,
                acceleration_max_rad_s2,
                member_bandwidth_rad_s: 2.0,
                neighbours: vec![vec![1, 2], vec![0, 2], vec![0, 1]],
                keep_out: vec![],
            }).unwrap(), n),
        };
        let mut lab = Laboratory::new(laws, &[0.0, 0.2, -0.1].map(yaw), delay_steps);
        lab.goals.formation = Reference::at_rest(quaternion_exp(&Vector3::from(goal)));
        let steps = ((40.0 + 20.0 * damping / bandwidth) / DT_S) as usize;
        for _ in 0..steps {
            lab.step();
            prop_assert!(lab.fastest() < 0.15, "{}", lab.fastest());
        }
        prop_assert!(lab.goal_error() < 1e-3, "{which}: {}", lab.goal_error());
    }

    #[test]
    fn no_boresight_enters_the_cone_that_it_keeps_out_of(
        azimuth in 0.3..0.9_f64,
        elevation in -0.12..0.12_f64,
        goal in 1.2..1.8_f64,
        bandwidth in 0.1..0.5_f64,
    ) {
        let (rate_max_rad_s, acceleration_max_rad_s2) = (0.03, 0.015);
        let direction = Vector3::new(azimuth.cos() * elevation.cos(), azimuth.sin() * elevation.cos(), elevation.sin());
        let keep_out = KeepOut {
            boresight_body: Vector3::x_axis(),
            direction_world: nalgebra::Unit::new_normalize(direction),
            half_angle_rad: 0.09,
            influence_rad: 0.09,
            bandwidth_rad_s: 0.1,
        };
        let law = Behavioural::new(BehaviouralSettings {
            goal_bandwidth_rad_s: bandwidth,
            keeping_bandwidth_rad_s: 0.0,
            damping: 1.0,
            rate_max_rad_s,
            acceleration_max_rad_s2,
            member_bandwidth_rad_s: 2.0,
            neighbours: vec![vec![]],
            keep_out: vec![Some(keep_out)],
        }).unwrap();
        let mut lab = Laboratory::new(boxed(&law, 1), &[UnitQuaternion::identity()], 0);
        lab.goals.formation = Reference::at_rest(yaw(goal));
        for _ in 0..6000 {
            lab.step();
            let left = keep_out.distance_rad(&lab.platforms[0].q);
            // The platform lags a little behind what the law commands.
            prop_assert!(left > -2e-3, "{left}");
        }
    }
}

#[test]
fn a_boresight_goes_around_a_lamp_in_its_way() {
    let keep_out = KeepOut {
        boresight_body: Vector3::x_axis(),
        direction_world: nalgebra::Unit::new_normalize(Vector3::new(0.6_f64.cos(), 0.6_f64.sin(), 0.05)),
        half_angle_rad: 0.08,
        influence_rad: 0.08,
        bandwidth_rad_s: 0.1,
    };
    let law = Behavioural::new(BehaviouralSettings {
        goal_bandwidth_rad_s: 0.3,
        keeping_bandwidth_rad_s: 0.3,
        damping: 1.0,
        rate_max_rad_s: 0.03,
        acceleration_max_rad_s2: 0.015,
        member_bandwidth_rad_s: 2.0,
        neighbours: vec![vec![]],
        keep_out: vec![Some(keep_out)],
    })
    .unwrap();
    let mut lab = Laboratory::new(boxed(&law, 1), &[UnitQuaternion::identity()], 0);
    lab.goals.formation = Reference::at_rest(yaw(1.2));
    let mut lowest = f64::INFINITY;
    for _ in 0..8000 {
        lab.step();
        lowest = lowest.min(keep_out.distance_rad(&lab.platforms[0].q));
    }
    assert!(lowest > 0.0 && lowest < 0.08, "it passes near: {lowest}");
    assert!(lab.goal_error() < 1e-3, "{}", lab.goal_error());
}

#[test]
fn a_perceptive_frame_waits_for_who_is_held_back_and_an_open_loop_does_not() {
    let frame_yaw = |gain: f64| {
        let law = PerceptiveFrame::new(PerceptiveFrameGains {
            bandwidth_rad_s: 0.4,
            damping: 1.0,
            perception_gain_s: gain,
            member_bandwidth_rad_s: 2.0,
            rate_max_rad_s: 0.05,
            acceleration_max_rad_s2: 0.015,
        })
        .unwrap();
        // One law for all, as in the coordinator.
        let mut lab = Laboratory::new(boxed(&law, 2), &[0.0, 0.1].map(yaw), 0);
        lab.goals.formation = Reference::at_rest(yaw(1.0));
        lab.platforms[1].stuck = true;
        for _ in 0..1500 {
            lab.step();
        }
        YawPitchRoll::of(&lab.platforms[0].q).yaw_rad
    };
    assert!(frame_yaw(0.0) > 0.95);
    // Perceived: half the distance to the stuck one; the plan's pull balances the gain times that.
    let waiting = frame_yaw(1.5);
    assert!(waiting < 0.3, "{waiting}");
}

/// A ring of 20 of which one knows the goal, with a delay of 4.68/w on every link: with all of the rates passed on, the
/// largest root of `(s + w)^2 = lambda e^(-s tau) (0.9 s^2 + 2 w s + w^2)` is at +7.4e-4 w, with 0.9747 of them at -1.8e-3 w
/// (found by Newton's method from a grid of starts in scipy). The ring must come to rest.
#[test]
fn a_large_ring_is_stable_at_the_delay_that_excited_it() {
    let ring = |i: usize| Listening {
        neighbours: [(i + 19) % 20, (i + 1) % 20].map(|j| (j, 1.0)).to_vec(),
        goal_weight: if i == 0 { 1.0 } else { 0.0 },
    };
    let graph = NeighbourGraph::new(&(0..20).map(ring).collect::<Vec<_>>()).unwrap();
    // numpy: 0.991397; the power method stops a little above.
    assert!((graph.spectral_radius() - 0.991_397).abs() < 1e-4, "{}", graph.spectral_radius());
    let law = Decentralised::new(DecentralisedSettings { graph, error_share: 0.0, traffic: None }).unwrap();
    // w = 2 rad/s: 2.34 s.
    let delay_steps = (4.68 / 2.0 / DT_S).round() as usize;
    let mut lab = Laboratory::new(boxed(&law, 20), &[yaw(0.0); 20], delay_steps);
    for (i, platform) in lab.platforms.iter_mut().enumerate() {
        // The mode that grew: neighbours against each other.
        let q = yaw(if i % 2 == 0 { 1e-3 } else { -1e-3 });
        platform.shaper.restart(&q);
        platform.q = q;
    }
    let largest = |lab: &Laboratory| {
        lab.platforms.iter().map(|p| attitude_error(&yaw(0.0), &p.q).norm()).fold(0.0, f64::max)
    };
    let mut peak_until = |time_s: f64| {
        (0..(time_s / DT_S) as usize).fold(0.0_f64, |peak, _| {
            lab.step();
            peak.max(largest(&lab))
        })
    };
    // Envelopes 400 s apart: e^(-1.8e-3 * 2 * 400) = 0.23, where the growing mode would give 1.8.
    peak_until(100.0);
    let early = peak_until(100.0);
    peak_until(300.0);
    let late = peak_until(100.0);
    assert!(late < 0.5 * early, "{early} {late}");
}

#[test]
fn a_lost_member_drops_out_and_the_rest_go_on() {
    let all = |i: usize| Listening {
        neighbours: (0..3).filter(|j| *j != i).map(|j| (j, 1.0)).collect(),
        goal_weight: 1.0,
    };
    let graph = NeighbourGraph::new(&[all(0), all(1), all(2)]).unwrap();
    let law = Decentralised::new(DecentralisedSettings { graph, error_share: 0.3, traffic: None }).unwrap();
    let mut lab = Laboratory::new(boxed(&law, 3), &[0.0, 0.2, 0.4].map(yaw), 2);
    lab.goals.formation = Reference::at_rest(yaw(0.5));
    lab.lost[2] = true;
    lab.platforms[2].stuck = true;
    for _ in 0..2500 {
        lab.step();
    }
    for i in 0..2 {
        let wanted = yaw(0.5 + 0.2 * i as f64);
        assert!(attitude_error(&wanted, &lab.platforms[i].q).norm() < 1e-4);
    }
}

#[test]
fn gains_outside_their_proven_ranges_are_refused_with_the_bound() {
    let all = |i: usize| Listening {
        neighbours: (0..4).filter(|j| *j != i).map(|j| (j, 1.0)).collect(),
        goal_weight: 1.0,
    };
    // rho = 3/4: the bound is (1/4) / (1.3 * 3/4) = 0.256.
    let graph = NeighbourGraph::new(&[all(0), all(1), all(2), all(3)]).unwrap();
    let settings = DecentralisedSettings { graph, error_share: 0.3, traffic: None };
    let error = Decentralised::new(settings.clone()).unwrap_err().to_string();
    assert!(error.contains("error_share = 0.3") && error.contains("0.256"), "{error}");
    assert!(Decentralised::new(DecentralisedSettings { error_share: 0.25, ..settings }).is_ok());

    let gains = PerceptiveFrameGains {
        bandwidth_rad_s: 0.3,
        damping: 1.0,
        perception_gain_s: 1.7,
        member_bandwidth_rad_s: 0.8,
        rate_max_rad_s: 0.05,
        acceleration_max_rad_s2: 0.015,
    };
    let error = PerceptiveFrame::new(gains).unwrap_err().to_string();
    assert!(error.contains("perception_gain_s = 1.7") && error.contains("1.600"), "{error}");

    let behavioural = BehaviouralSettings {
        goal_bandwidth_rad_s: 0.3,
        keeping_bandwidth_rad_s: 0.3,
        damping: 1.0,
        rate_max_rad_s: 0.05,
        acceleration_max_rad_s2: 0.015,
        member_bandwidth_rad_s: 0.8,
        neighbours: vec![vec![1], vec![]],
        keep_out: vec![],
    };
    let error = Behavioural::new(behavioural.clone()).unwrap_err().to_string();
    assert!(error.contains("mutual"), "{error}");
    let fast = BehaviouralSettings { keeping_bandwidth_rad_s: 0.5, ..behavioural };
    assert!(Behavioural::new(fast).unwrap_err().to_string().contains("0.400"));
}
