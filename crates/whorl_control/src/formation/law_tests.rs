//! Tests of the laws with their shapers and ideal platforms, against closed forms.

use super::shaper_tests::{DT_S, dumbbell, tabletop};
use super::*;
use crate::reference::{Reference, Slew, SlewLimits};
use nalgebra::{UnitQuaternion, Vector3};
use whorl_math::{attitude_error, quaternion_exp};

fn yaw(angle_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad)
}

/// Platforms that are where their reference is, plus an error that a test may set.
struct Formation {
    law: Box<dyn RelativeAttitudeLaw>,
    shapers: Vec<ReferenceShaper>,
    errors: Vec<UnitQuaternion<f64>>,
    usable: Vec<bool>,
    goals: Goals,
    offsets: Vec<Offset>,
    demands: Vec<MotionDemand>,
}

impl Formation {
    fn new(law: impl RelativeAttitudeLaw + 'static, offsets: &[UnitQuaternion<f64>]) -> Self {
        let n = offsets.len();
        let shaper = |i: usize| {
            let limits = if i == 0 { tabletop() } else { dumbbell() };
            ReferenceShaper::new(limits, 2.0, &yaw(0.1 * i as f64)).unwrap()
        };
        Self {
            law: Box::new(law),
            shapers: (0..n).map(shaper).collect(),
            errors: vec![UnitQuaternion::identity(); n],
            usable: vec![true; n],
            goals: Goals { formation: Reference::at_rest(UnitQuaternion::identity()), individual: vec![] },
            offsets: offsets.iter().map(|q| Offset::constant(*q)).collect(),
            demands: vec![],
        }
    }

    fn members(&self) -> Vec<Member> {
        let member = |i: usize| {
            let reference = self.shapers[i].reference();
            Member {
                q_world_body: reference.q_world_reference * self.errors[i],
                omega_wb_b_rad_s: reference.omega_wr_r_rad_s,
                age_s: 0.0,
                usable: self.usable[i],
                tracking: true,
                reference,
            }
        };
        (0..self.shapers.len()).map(member).collect()
    }

    fn step(&mut self) {
        self.shapers.iter_mut().for_each(|s| s.advance(DT_S));
        let members = self.members();
        let input = LawInput { dt_s: DT_S, members: &members, goals: &self.goals, offsets: &self.offsets };
        self.law.demands(&input, &mut self.demands);
        for (shaper, demand) in self.shapers.iter_mut().zip(&self.demands) {
            shaper.plan(demand, DT_S);
        }
    }

    fn relative_error(&self, platform: usize) -> Option<Vector3<f64>> {
        let members = self.members();
        let input = LawInput { dt_s: DT_S, members: &members, goals: &self.goals, offsets: &self.offsets };
        self.law.relative_error_rad(&input, platform)
    }
}

fn pair() -> Formation {
    let graph = LeaderGraph::new(vec![None, Some(0)]).unwrap();
    Formation::new(LeaderFollower::new(graph), &[UnitQuaternion::identity(), yaw(0.35)])
}

#[test]
fn the_follower_converges_to_its_offset_and_keeps_it_through_a_slew() {
    let mut formation = pair();
    for _ in 0..1500 {
        formation.step();
    }
    assert!(formation.relative_error(1).unwrap().norm() < 1e-9);
    let end = yaw(0.4) * quaternion_exp(&Vector3::new(0.02, 0.01, 0.0));
    let limits = SlewLimits::new(0.054, 0.016).unwrap();
    let slew = Slew::new(&UnitQuaternion::identity(), &end, &limits, &tabletop().envelope);
    let (mut worst, mut fastest) = (0.0_f64, 0.0_f64);
    for k in 0..1500 {
        formation.goals.formation = slew.at(f64::from(k) * DT_S);
        formation.step();
        worst = worst.max(formation.relative_error(1).unwrap().norm());
        fastest = fastest.max(formation.shapers[1].motion().rates_rad_s.norm());
    }
    // The leader's acceleration is known one step late: jerk * dt / bandwidth^2 of lag.
    assert!(worst < 1e-4, "{worst}");
    assert!(fastest > 0.05, "it did slew");
    let expected = formation.goals.formation.q_world_reference * yaw(0.35);
    let reached = formation.shapers[1].reference().q_world_reference;
    assert!(attitude_error(&expected, &reached).norm() < 1e-6);
}

#[test]
fn the_follower_follows_an_error_that_its_leader_makes() {
    let mut formation = pair();
    let lean = quaternion_exp(&Vector3::new(0.0, 0.0, 0.01));
    formation.errors[0] = lean;
    for _ in 0..1500 {
        formation.step();
    }
    assert!(formation.relative_error(1).unwrap().norm() < 1e-9);
    let follower = formation.shapers[1].reference().q_world_reference;
    assert!(attitude_error(&(lean * yaw(0.35)), &follower).norm() < 1e-9);
    // A leader's error is its own, against its reference.
    assert!((formation.relative_error(0).unwrap() - Vector3::new(0.0, 0.0, 0.01)).norm() < 1e-12);
}

#[test]
fn a_chain_and_two_trees_reach_the_product_of_their_offsets() {
    // 0 <- 1 <- 2 <- 3 and 4 <- 5, with 4 leading on its own motion.
    let graph = LeaderGraph::new(vec![None, Some(0), Some(1), Some(2), None, Some(4)]).unwrap();
    let offsets = [0.0, 0.2, -0.3, 0.1, 0.0, 0.5].map(yaw);
    let mut formation = Formation::new(LeaderFollower::new(graph), &offsets);
    formation.goals.formation = Reference::at_rest(yaw(0.3));
    formation.goals.individual = vec![None; 6];
    formation.goals.individual[4] = Some(Reference::at_rest(yaw(-0.6)));
    for _ in 0..3000 {
        formation.step();
    }
    for (platform, expected) in [0.3, 0.5, 0.2, 0.3, -0.6, -0.1].into_iter().enumerate() {
        let reached = formation.shapers[platform].motion().angles.yaw_rad;
        assert!((reached - expected).abs() < 1e-7, "{platform}: {reached}");
        assert!(formation.relative_error(platform).unwrap().norm() < 1e-7);
    }
}

#[test]
fn a_follower_of_an_unseen_leader_holds_and_its_error_is_unknown() {
    let mut formation = pair();
    formation.step();
    formation.usable[0] = false;
    formation.step();
    assert_eq!(formation.demands[1], MotionDemand::Hold);
    assert_eq!(formation.demands[0], MotionDemand::Hold);
    assert_eq!(formation.relative_error(1), None);
    assert_eq!(formation.relative_error(0), None);
}

fn gains() -> VirtualStructureGains {
    VirtualStructureGains {
        bandwidth_rad_s: 0.5,
        damping: 1.0,
        half_speed_error_rad: 0.02,
        rate_max_rad_s: 0.05,
        acceleration_max_rad_s2: 0.015,
    }
}

fn structure(gains: VirtualStructureGains) -> Formation {
    let mut formation =
        Formation::new(VirtualStructure::new(gains).unwrap(), &[yaw(0.0), yaw(0.1), yaw(-0.2)]);
    let members = formation.members();
    let input =
        LawInput { dt_s: DT_S, members: &members, goals: &formation.goals, offsets: &formation.offsets };
    formation.law.restart(&input);
    formation
}

#[test]
fn the_structure_takes_all_members_to_the_goal_at_its_rate() {
    let mut formation = structure(gains());
    formation.goals.formation = Reference::at_rest(yaw(1.2));
    let mut fastest = 0.0_f64;
    for _ in 0..3500 {
        formation.step();
        fastest = fastest.max(formation.shapers[0].motion().rates_rad_s.norm());
    }
    assert!(fastest <= 0.05 + 1e-6 && fastest > 0.0499, "{fastest}");
    for (platform, offset) in [0.0, 0.1, -0.2].into_iter().enumerate() {
        let reached = formation.shapers[platform].motion().angles.yaw_rad;
        assert!((reached - 1.2 - offset).abs() < 1e-5, "{platform}: {reached}");
        assert!(formation.relative_error(platform).unwrap().norm() < 1e-5);
    }
}

#[test]
fn formation_feedback_slows_the_structure_by_the_closed_form() {
    // Three members lag by e each: E = e^2, and the steady rate is rate_max / (1 + E / e_half^2).
    for (lag, half) in [(0.02, 0.02), (0.04, 0.02), (0.02, f64::INFINITY)] {
        let mut formation = structure(VirtualStructureGains { half_speed_error_rad: half, ..gains() });
        formation.goals.formation = Reference::at_rest(yaw(3.0));
        formation.errors = vec![yaw(-lag); 3];
        for _ in 0..600 {
            formation.step();
        }
        let rate = formation.shapers[0].motion().rates_rad_s.norm();
        let expected = 0.05 / (1.0 + lag * lag / (half * half));
        assert!((rate / expected - 1.0).abs() < 1e-3, "{rate} {expected}");
    }
}

#[test]
fn the_structure_stands_while_a_member_is_unseen_and_goes_on_after() {
    let mut formation = structure(gains());
    formation.goals.formation = Reference::at_rest(yaw(1.0));
    for _ in 0..400 {
        formation.step();
    }
    formation.usable[2] = false;
    for _ in 0..400 {
        formation.step();
    }
    assert!(formation.shapers.iter().all(|s| s.motion().rates_rad_s.norm() < 1e-9));
    formation.usable[2] = true;
    for _ in 0..3000 {
        formation.step();
    }
    assert!((formation.shapers[2].motion().angles.yaw_rad - 0.8).abs() < 1e-5);
}

#[test]
fn the_structures_motion_is_consistent_with_its_rates() {
    let mut formation = structure(gains());
    formation.goals.formation = Reference::at_rest(quaternion_exp(&Vector3::new(0.3, -0.5, 0.9)));
    let mut law = VirtualStructure::new(gains()).unwrap();
    let members = formation.members();
    let mut previous: Option<Reference> = None;
    let mut demands = vec![];
    for _ in 0..2000 {
        let input =
            LawInput { dt_s: DT_S, members: &members, goals: &formation.goals, offsets: &formation.offsets };
        law.demands(&input, &mut demands);
        let now = *law.structure().unwrap();
        if let Some(before) = previous {
            let mean = (before.omega_wr_r_rad_s + now.omega_wr_r_rad_s) * 0.5;
            let rate = attitude_error(&before.q_world_reference, &now.q_world_reference) / DT_S;
            assert!((rate - mean).norm() < 1e-7);
            let acceleration = (now.omega_wr_r_rad_s - before.omega_wr_r_rad_s) / DT_S;
            assert!((acceleration - before.omega_dot_wr_r_rad_s2).norm() < 1e-12);
            assert!(acceleration.norm() <= 0.015 + 1e-12);
            assert!(now.omega_wr_r_rad_s.norm() <= 0.05 + 1e-9);
        }
        previous = Some(now);
    }
}

#[test]
fn gains_beyond_the_proven_range_are_refused_with_the_bound() {
    let too_fast = VirtualStructureGains { bandwidth_rad_s: 1.0, ..gains() };
    let error = VirtualStructure::new(too_fast).unwrap_err().to_string();
    assert!(error.contains("bandwidth_rad_s = 1") && error.contains("2.718"), "{error}");
    for bad in [
        VirtualStructureGains { damping: 0.9, ..gains() },
        VirtualStructureGains { half_speed_error_rad: 0.0, ..gains() },
        VirtualStructureGains { rate_max_rad_s: f64::NAN, ..gains() },
    ] {
        assert!(VirtualStructure::new(bad).is_err());
    }
}
