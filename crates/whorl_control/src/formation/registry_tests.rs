//! Tests of every law in the catalogue.

use std::collections::HashSet;

use super::shaper_tests::{DT_S, dumbbell};
use super::*;
use crate::reference::Reference;
use nalgebra::{Unit, UnitQuaternion, Vector3};
use whorl_math::attitude_error;

/// Settings that are all left out, so that defaults apply; keeps the keys that were read and refused.
#[derive(Default)]
struct Silent {
    groups: Vec<String>,
    asked: Vec<String>,
    refused: Vec<String>,
}

impl Silent {
    fn ask(&mut self, key: &str, doc: &str) {
        assert!(!doc.is_empty(), "{key} has no doc");
        let full: Vec<&str> = self.groups.iter().map(String::as_str).chain([key]).collect();
        self.asked.push(full.join("."));
    }
}

impl Settings for Silent {
    fn enter(&mut self, group: &str) {
        self.groups.push(group.to_owned());
    }

    fn leave(&mut self) {
        self.groups.pop().unwrap();
    }

    fn has(&self, _key: &str) -> bool {
        false
    }

    fn number(&mut self, key: &str, _allowed: Allowed, doc: &str) -> f64 {
        self.ask(key, doc);
        panic!("{key}: a law must be complete without any setting");
    }

    fn number_or(&mut self, key: &str, default: f64, allowed: Allowed, doc: &str) -> f64 {
        self.ask(key, doc);
        let inside = std::ops::RangeBounds::contains(&(allowed.lower, allowed.upper), &default);
        assert!(inside && default.is_finite(), "{key}: its default {default} is not allowed");
        default
    }

    fn direction(&mut self, key: &str, doc: &str) -> Unit<Vector3<f64>> {
        self.ask(key, doc);
        panic!("{key}: a law must be complete without any setting");
    }

    fn platform_or(&mut self, key: &str, default: Option<usize>, doc: &str) -> Option<usize> {
        self.ask(key, doc);
        default
    }

    fn optional_platforms(&mut self, key: &str, doc: &str) -> Option<Vec<usize>> {
        self.ask(key, doc);
        None
    }

    fn reject(&mut self, key: &str, problem: String) {
        self.refused.push(format!("{key}: {problem}"));
    }
}

fn each(platforms: usize, mut check: impl FnMut(&RegisteredLaw, Box<dyn RelativeAttitudeLaw>, &Silent)) {
    let names: Vec<String> = (1..=platforms).map(|n| format!("whorl_{n}")).collect();
    let limits = vec![dumbbell(); platforms];
    for registered in catalogue() {
        let mut user = Silent::default();
        let law = registered.read(&mut user, &Roster { platforms: &names, limits: &limits });
        assert!(user.groups.is_empty() && user.refused.is_empty(), "{:?}", user.refused);
        check(registered, law.expect("the defaults are allowed"), &user);
    }
}

fn members(references: &[Reference]) -> Vec<Member> {
    let member = |reference: &Reference| Member {
        q_world_body: reference.q_world_reference,
        omega_wb_b_rad_s: reference.omega_wr_r_rad_s,
        age_s: 0.0,
        usable: true,
        tracking: true,
        reference: *reference,
    };
    references.iter().map(member).collect()
}

#[test]
fn names_are_distinct_and_lead_back_to_the_law() {
    let mut names = HashSet::new();
    each(3, |registered, law, _| {
        let kind = registered.kind();
        assert!(kind.chars().all(|c| c.is_ascii_lowercase() || c == '_') && names.insert(kind), "{kind}");
        assert_eq!(law.name(), kind);
        assert_eq!(find(kind).map(RegisteredLaw::kind), Some(kind));
    });
    assert!(names.len() >= 5 && find("perceptive").is_none());
}

#[test]
fn a_law_asks_in_its_own_group_and_of_its_members_only() {
    each(2, |registered, _, user| {
        let own = format!("{}.", registered.kind());
        for key in &user.asked {
            assert!(key.starts_with(&own) || key.starts_with("members.whorl_"), "{own} {key}");
        }
    });
}

#[test]
fn either_somebody_leads_or_a_structure_moves() {
    for platforms in 1..5 {
        each(platforms, |_, law, _| {
            let leaders = (0..platforms).filter(|p| law.leads(*p)).count();
            assert_eq!(leaders == 0, law.moves_a_structure(), "{}: {leaders} lead", law.name());
            assert!((0..platforms).all(|p| law.leader(p).is_none() || !law.leads(p)));
        });
    }
}

#[test]
fn a_formation_at_its_goal_is_told_to_stay_there() {
    let yaw = |angle: f64| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
    let goal = Reference::at_rest(yaw(0.2));
    let offsets: Vec<Offset> = [0.0, 0.3, -0.2].map(|a| Offset::constant(yaw(a))).to_vec();
    let places: Vec<Reference> = offsets.iter().map(|offset| offset.apply(&goal)).collect();
    let goals = Goals { formation: goal, individual: vec![] };
    let members = members(&places);
    let input = LawInput { dt_s: DT_S, members: &members, goals: &goals, offsets: &offsets };
    each(3, |_, mut law, _| {
        let name = law.name();
        law.restart(&input);
        let mut demands = Vec::new();
        law.demands(&input, &mut demands);
        assert_eq!(demands.len(), 3, "{name}");
        for (platform, (demand, place)) in demands.iter().zip(&places).enumerate() {
            let MotionDemand::Follow(at) = demand else { panic!("{name}: {demand:?}") };
            assert!(attitude_error(&place.q_world_reference, &at.q_world_reference).norm() < 1e-9, "{name}");
            assert!(at.omega_wr_r_rad_s.norm() < 1e-9 && at.omega_dot_wr_r_rad_s2.norm() < 1e-9, "{name}");
            assert!(law.relative_error_rad(&input, platform).unwrap().norm() < 1e-9, "{name}");
        }
    });
}

#[test]
fn a_copy_is_equal_and_another_law_is_not() {
    let mut laws = Vec::new();
    each(2, |_, law, _| laws.push(law));
    for (i, a) in laws.iter().enumerate() {
        for (j, b) in laws.clone().iter().enumerate() {
            assert_eq!(a == b, i == j, "{} {}", a.name(), b.name());
        }
    }
}
