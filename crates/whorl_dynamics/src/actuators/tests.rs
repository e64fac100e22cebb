//! Requirements on every kind in the table.

use std::collections::BTreeSet;

use super::{Actuators, Group, Slot};

#[test]
fn groups_and_keys_are_distinct_and_described() {
    let mut actuators = Actuators::default();
    let mut names = BTreeSet::new();
    for kind in actuators.kinds_mut() {
        for (g, group) in kind.groups().iter().enumerate() {
            assert!(names.insert(group.name()), "{} twice", group.name());
            if let Group::Members { defaults, .. } = group {
                assert!(names.insert(defaults), "{defaults} twice");
                assert_eq!(g, 0, "members come first, so that `add` and `names` are about them");
                kind.add("one".to_owned());
                assert_eq!(kind.names(), ["one"]);
            }
            let fields = kind.fields(g, 0);
            assert!(!fields.is_empty(), "{}", group.name());
            let keys: BTreeSet<&str> = fields.iter().map(|field| field.key).collect();
            assert_eq!(keys.len(), fields.len(), "a key of {} is there twice", group.name());
            for field in &fields {
                assert!(!field.doc.is_empty() && !field.unit.is_empty(), "{}", field.key);
                assert!(
                    !field.shared || matches!(field.slot, Slot::Number(_)),
                    "{}: only numbers are shared",
                    field.key
                );
            }
        }
    }
}

#[test]
fn what_fits_estimate_is_an_entry_of_its_kind_and_has_a_typical_deviation() {
    let mut actuators = Actuators::default();
    for kind in actuators.kinds_mut() {
        kind.add("one".to_owned());
    }
    let mut priors = actuators.typical_priors();
    for (kind, prior) in actuators.kinds_mut().into_iter().zip(priors.kinds_mut()) {
        let members = kind.count();
        let keys: Vec<&str> = kind.fields(0, 0).iter().map(|field| field.key).collect();
        for key in prior.keys() {
            assert!(keys.contains(key), "{key} is no entry of {kind:?}");
            let fields = kind.fields(0, 0);
            let field = fields.iter().find(|field| field.key == *key).unwrap();
            // What may be zero is known as it is stated.
            let in_its_unit = matches!(field.slot, Slot::Number(_)) && !prior.is_share(key);
            for member in 0..members {
                assert_eq!(prior.stddev(key, member).unwrap() > 0.0, !in_its_unit, "{key} {member}");
                prior.set_stddev(key, member, 0.125);
                assert_eq!(prior.stddev(key, member), Some(0.125));
            }
            assert_eq!(prior.stddev(key, members), None);
        }
    }
}
