//! A running node's parameters: checked, applied to the core, and offered by ROS 2's six services.

use ros2_client::parameters::raw;
use ros2_client::rcl_interfaces::ListParametersResult;
use serde::Serialize;
use whorl_params::{Descriptor, Kind, NodeParameters, ParameterErrors, Reader, Value};

use crate::parameter_wire::{describe, empty_descriptor, from_wire, to_wire};

/// Reads, checks and applies a whole set of parameters; the reason when it is refused.
pub(crate) type Apply<'a> = dyn FnMut(&NodeParameters) -> Result<Vec<Descriptor>, String> + 'a;

/// Whether a value stands for none. `ros2 param dump` writes `null` for a parameter that is not set, and `ros2 param load`
/// sends what it reads of it: the text `None` (rclpy, `parameter_dict_from_yaml_file`).
fn says_unset(wire: &raw::ParameterValue) -> bool {
    wire.ptype == raw::ParameterType::NOT_SET
        || (wire.ptype == raw::ParameterType::STRING
            && ["None", "null"].contains(&wire.string_value.as_str()))
}

/// A number that arrives as text. `ros2 param load` and `ros2 param set` write numbers as Python does (`1e-06`, `nan`, `inf`),
/// and read them as YAML 1.1, to which these are texts: alone, all numbers of a list, or a list of which some are.
fn number_as_text(wire: &raw::ParameterValue, kind: Kind) -> Option<Value> {
    let number = |text: &str| text.trim().parse::<f64>().ok();
    match (kind, wire.ptype) {
        (Kind::Double, raw::ParameterType::STRING) => number(&wire.string_value).map(Value::Double),
        (Kind::DoubleArray, raw::ParameterType::STRING_ARRAY) => {
            wire.string_array.iter().map(|text| number(text)).collect::<Option<_>>().map(Value::DoubleArray)
        }
        (Kind::DoubleArray, raw::ParameterType::STRING) => {
            let inside = wire.string_value.trim().strip_prefix('[')?.strip_suffix(']')?;
            inside.split(',').map(number).collect::<Option<_>>().map(Value::DoubleArray)
        }
        _ => None,
    }
}

/// Every ROS 2 node has this parameter.
const USE_SIM_TIME: &str = "use_sim_time";

/// `rcl_interfaces/msg/ParameterEvent`.
#[derive(Debug, Serialize)]
pub(crate) struct ParameterEvent {
    pub stamp: whorl_msgs::builtin_interfaces::Time,
    pub node: String,
    pub new_parameters: Vec<raw::Parameter>,
    pub changed_parameters: Vec<raw::Parameter>,
    pub deleted_parameters: Vec<raw::Parameter>,
}

/// The parameters in force.
#[derive(Debug, Clone)]
pub(crate) struct ParameterSet {
    parameters: NodeParameters,
    descriptors: Vec<Descriptor>,
    refused: u64,
}

/// Reads all parameters of a node with its single definition of them.
pub(crate) fn read<P>(
    parameters: &NodeParameters,
    read: impl FnOnce(&mut Reader<'_>) -> Option<P>,
) -> Result<(P, Vec<Descriptor>), ParameterErrors> {
    whorl_params::try_read(parameters, read)
}

impl ParameterSet {
    pub(crate) fn new(parameters: NodeParameters, descriptors: Vec<Descriptor>) -> Self {
        let mut set = Self { parameters, descriptors: Vec::new(), refused: 0 };
        set.describe(descriptors);
        set
    }

    fn describe(&mut self, mut descriptors: Vec<Descriptor>) {
        if !descriptors.iter().any(|d| d.name == USE_SIM_TIME) {
            descriptors.push(Descriptor {
                name: USE_SIM_TIME.into(),
                kind: Kind::Bool,
                value: Some(Value::Bool(false)),
                default: Some(Value::Bool(false)),
                required: false,
                doc: "always false: nodes run on the wall clock, `whorl simulate` on simulated time".into(),
                allowed: "false".into(),
                range: None,
                choices: Vec::new(),
                read_only: true,
            });
        }
        descriptors.sort_by(|a, b| a.name.cmp(&b.name));
        self.descriptors = descriptors;
    }

    /// How many sets were refused.
    pub(crate) fn refused(&self) -> u64 {
        self.refused
    }

    fn find(&self, name: &str) -> Option<&Descriptor> {
        self.descriptors.binary_search_by(|d| d.name.as_str().cmp(name)).ok().map(|at| &self.descriptors[at])
    }

    pub(crate) fn get(&self, names: &[String]) -> Vec<raw::ParameterValue> {
        let value = |name: &String| self.find(name).and_then(|d| d.value.as_ref());
        names.iter().map(|name| to_wire(value(name))).collect()
    }

    pub(crate) fn types(&self, names: &[String]) -> Vec<u8> {
        self.get(names).into_iter().map(|value| value.ptype).collect()
    }

    pub(crate) fn descriptions(&self, names: &[String]) -> Vec<raw::ParameterDescriptor> {
        names
            .iter()
            .map(|name| match self.find(name) {
                Some(descriptor) => describe(descriptor),
                None => raw::ParameterDescriptor { name: name.clone(), ..empty_descriptor() },
            })
            .collect()
    }

    /// Names below one of the prefixes (all for none), at most `depth` parts below it (0 = any).
    pub(crate) fn list(&self, prefixes: &[String], depth: u64) -> ListParametersResult {
        let near = |rest: &str| depth == 0 || (rest.matches('.').count() as u64) < depth;
        let wanted = |name: &str| {
            prefixes.is_empty() && near(name)
                || prefixes.iter().any(|prefix| {
                    name == prefix
                        || name
                            .strip_prefix(prefix.as_str())
                            .and_then(|rest| rest.strip_prefix('.'))
                            .is_some_and(near)
                })
        };
        let names: Vec<String> =
            self.descriptors.iter().map(|d| &d.name).filter(|name| wanted(name)).cloned().collect();
        let mut groups: Vec<String> = names
            .iter()
            .filter_map(|name| name.rsplit_once('.').map(|(group, _)| group.to_owned()))
            .collect();
        groups.sort();
        groups.dedup();
        ListParametersResult { names, prefixes: groups }
    }

    /// Sets all of `changes` or none. On success the changed parameters, for `/parameter_events`.
    pub(crate) fn set(
        &mut self,
        changes: &[raw::Parameter],
        apply: &mut Apply<'_>,
    ) -> Result<Vec<raw::Parameter>, String> {
        self.try_set(changes, apply).inspect_err(|_| self.refused += 1)
    }

    fn try_set(
        &mut self,
        changes: &[raw::Parameter],
        apply: &mut Apply<'_>,
    ) -> Result<Vec<raw::Parameter>, String> {
        let mut parameters = self.parameters.clone();
        let mut changed = Vec::new();
        let mut is_asked_again = false;
        for change in changes {
            if self.find(&change.name).is_some_and(|d| d.value.is_none()) && says_unset(&change.value) {
                continue;
            }
            let kind = self.find(&change.name).map(|descriptor| descriptor.kind);
            let value = kind.and_then(|kind| number_as_text(&change.value, kind)).map_or_else(
                || from_wire(&change.value).map_err(|problem| format!("{}: {problem}", change.name)),
                Ok,
            )?;
            if let Some(descriptor) = self.find(&change.name) {
                let same = descriptor.value.is_some()
                    && value.converted(descriptor.kind).as_ref() == descriptor.value.as_ref();
                if same {
                    is_asked_again |= !descriptor.read_only;
                    continue;
                }
                if descriptor.read_only {
                    return Err(format!(
                        "{} can only be set when the node starts, in a parameter file or with -p",
                        change.name
                    ));
                }
            }
            parameters = parameters.with(&change.name, value);
            changed.push(change.name.clone());
        }
        if changed.is_empty() {
            // The core hears of it: what it was asked for before may have ended by itself, as arming does.
            if is_asked_again {
                apply(&parameters)?;
            }
            return Ok(Vec::new());
        }
        let descriptors = apply(&parameters)?;
        self.parameters = parameters;
        self.describe(descriptors);
        let values = self.get(&changed);
        Ok(changed.into_iter().zip(values).map(|(name, value)| raw::Parameter { name, value }).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_params::{ParameterTree, range};

    #[derive(Debug, Clone, PartialEq)]
    struct Gains {
        kp: f64,
        axes: i64,
        law: String,
    }

    fn gains(r: &mut Reader<'_>) -> Option<Gains> {
        Some(Gains {
            kp: r.group("gain", |r| r.f64("kp_n_m", range(0.0..=2.0), "proportional gain [N m]")),
            axes: r.fixed(|r| r.i64("axes", range(1..=3), "axes under control")),
            law: r.choice("law", &["pd", "slide"], "control law").to_owned(),
        })
    }

    fn set() -> (NodeParameters, ParameterSet) {
        let text = "/**/control:\n  ros__parameters:\n    gain: {kp_n_m: 0.5}\n    axes: 3\n    law: pd\n";
        let parameters =
            ParameterTree::from_texts(&[("p.yaml", text)], &[]).unwrap().for_node("/whorl_1/control");
        let (_, descriptors) = read(&parameters, gains).unwrap();
        (parameters.clone(), ParameterSet::new(parameters, descriptors))
    }

    fn change(name: &str, value: impl Into<Value>) -> raw::Parameter {
        raw::Parameter { name: name.into(), value: to_wire(Some(&value.into())) }
    }

    /// Applies to a core that refuses kp above 1.
    fn apply(applied: &mut Vec<Gains>) -> impl FnMut(&NodeParameters) -> Result<Vec<Descriptor>, String> {
        move |parameters| {
            let (new, descriptors) = read(parameters, gains).map_err(|e| e.to_string())?;
            if new.kp > 1.0 {
                return Err("kp above 1 is not stable with this filter".into());
            }
            applied.push(new);
            Ok(descriptors)
        }
    }

    #[test]
    fn a_value_in_range_reaches_the_core_and_is_read_back() {
        let (_, mut set) = set();
        let mut applied = Vec::new();
        let events = set.set(&[change("gain.kp_n_m", 0.75)], &mut apply(&mut applied)).unwrap();
        assert_eq!(events.len(), 1);
        assert_eq!(applied[0].kp, 0.75);
        assert_eq!(set.get(&["gain.kp_n_m".into()])[0].double_value, 0.75);
        // `ros2 param set ... 1` sends an integer; what is read back is a number.
        set.set(&[change("gain.kp_n_m", 1_i64)], &mut apply(&mut applied)).unwrap();
        let back = &set.get(&["gain.kp_n_m".into()])[0];
        assert_eq!((back.ptype, back.double_value), (raw::ParameterType::DOUBLE, 1.0));
    }

    #[test]
    fn every_refusal_says_why_and_changes_nothing() {
        let (_, mut set) = set();
        let mut applied = Vec::new();
        for (name, value, expected) in [
            ("gain.kp_n_m", Value::Double(2.5), "2"),
            ("gain.kp_n_m", Value::Double(f64::NAN), "gain.kp_n_m"),
            ("gain.kp_n_m", Value::Double(1.5), "not stable"),
            ("gain.kp_n_m", Value::String("much".into()), "gain.kp_n_m"),
            ("gain.kp", Value::Double(0.1), "gain.kp"),
            ("axes", Value::Integer(2), "when the node starts"),
            ("use_sim_time", Value::Bool(true), "when the node starts"),
            ("law", Value::String("pid".into()), "slide"),
        ] {
            let reason = set.set(&[change(name, value)], &mut apply(&mut applied)).unwrap_err();
            assert!(reason.contains(expected), "{name}: {reason}");
        }
        assert!(applied.is_empty());
        assert_eq!(set.refused(), 8);
        assert_eq!(set.get(&["gain.kp_n_m".into()])[0].double_value, 0.5);
    }

    #[test]
    fn an_atomic_set_is_all_or_nothing() {
        let (_, mut set) = set();
        let mut applied = Vec::new();
        let both = [change("gain.kp_n_m", 0.25), change("law", "pid")];
        assert!(set.set(&both, &mut apply(&mut applied)).is_err());
        assert_eq!(set.get(&["gain.kp_n_m".into()])[0].double_value, 0.5);
        let both = [change("gain.kp_n_m", 0.25), change("law", "slide")];
        assert_eq!(set.set(&both, &mut apply(&mut applied)).unwrap().len(), 2);
        assert_eq!(applied, [Gains { kp: 0.25, axes: 3, law: "slide".into() }]);
    }

    #[test]
    fn setting_a_fixed_parameter_to_its_own_value_is_no_error() {
        // `ros2 param load` of a full dump does this.
        let (_, mut set) = set();
        let mut applied = Vec::new();
        assert!(set.set(&[change("axes", 3_i64)], &mut apply(&mut applied)).unwrap().is_empty());
        assert!(applied.is_empty());
    }

    #[derive(Debug, Clone, PartialEq)]
    struct Lists {
        failed: Vec<i64>,
        names: Vec<String>,
        source: Option<String>,
    }

    fn lists(r: &mut Reader<'_>) -> Option<Lists> {
        Some(Lists {
            failed: r.i64_array_or("failed", &[1], range(0..=11), "failed jets"),
            names: r.string_array_or("names", &["a"], "names"),
            source: r.optional_string("source", "recording"),
        })
    }

    #[test]
    fn an_empty_list_of_any_type_empties_a_list_and_a_dump_can_be_loaded() {
        let tree = ParameterTree::from_texts(&[("p.yaml", "/**:\n  ros__parameters: {}\n")], &[]).unwrap();
        let parameters = tree.for_node("/driver");
        let (_, descriptors) = read(&parameters, lists).unwrap();
        let mut set = ParameterSet::new(parameters, descriptors);
        let mut applied = Vec::new();
        let mut apply = |parameters: &NodeParameters| {
            let (new, descriptors) = read(parameters, lists).map_err(|e| e.to_string())?;
            applied.push(new);
            Ok(descriptors)
        };
        // What `ros2 param set NODE failed "[]"` sends: booleans, or bytes.
        let mut bytes = change("names", 0_i64);
        bytes.value = raw::ParameterValue { ptype: raw::ParameterType::BYTE_ARRAY, ..to_wire(None) };
        set.set(&[change("failed", Value::BoolArray(vec![])), bytes], &mut apply).unwrap();
        // A dump of everything, as `ros2 param load` sends it back.
        let unset = raw::Parameter { name: "source".into(), value: to_wire(None) };
        assert!(set.set(&[unset, change("source", "None")], &mut apply).unwrap().is_empty());
        assert_eq!(applied, [Lists { failed: vec![], names: vec![], source: None }]);
    }

    #[test]
    fn small_numbers_come_back_as_the_texts_that_yaml_1_1_takes_them_for() {
        // What rclpy's get_parameter_value makes of str(1e-06), str([1e-06, 2e-05]) and str([1e-06, 2.5]) with PyYAML.
        let text = |text: &str| to_wire(Some(&Value::String(text.into())));
        let texts = to_wire(Some(&Value::StringArray(vec!["1e-06".into(), "2e-05".into()])));
        assert_eq!(number_as_text(&text("1e-06"), Kind::Double), Some(Value::Double(1e-6)));
        assert_eq!(number_as_text(&text("-inf"), Kind::Double), Some(Value::Double(f64::NEG_INFINITY)));
        assert_eq!(number_as_text(&texts, Kind::DoubleArray), Some(Value::DoubleArray(vec![1e-6, 2e-5])));
        assert_eq!(
            number_as_text(&text("[1e-06, 2.5]"), Kind::DoubleArray),
            Some(Value::DoubleArray(vec![1e-6, 2.5]))
        );
        for (wire, kind) in [
            (text("much"), Kind::Double),
            (text("1e-06, 2"), Kind::DoubleArray),
            (text("[1e-06, x]"), Kind::DoubleArray),
            // A text that is one stays one.
            (text("1e-06"), Kind::String),
        ] {
            assert_eq!(number_as_text(&wire, kind), None, "{wire:?}");
        }
        let (_, mut set) = set();
        let mut applied = Vec::new();
        set.set(&[change("gain.kp_n_m", "5e-05")], &mut apply(&mut applied)).unwrap();
        assert_eq!(applied[0].kp, 5e-5);
    }

    #[test]
    fn names_are_listed_by_prefix_and_depth() {
        let (_, set) = set();
        assert_eq!(set.list(&[], 0).names, ["axes", "gain.kp_n_m", "law", "use_sim_time"]);
        assert_eq!(set.list(&[], 1).names, ["axes", "law", "use_sim_time"]);
        assert_eq!(set.list(&["gain".into()], 0).names, ["gain.kp_n_m"]);
        assert_eq!(set.list(&[], 0).prefixes, ["gain"]);
        assert!(set.list(&["gai".into()], 0).names.is_empty());
    }

    #[test]
    fn descriptors_carry_doc_range_and_choices() {
        let (_, set) = set();
        let d = set.descriptions(&["gain.kp_n_m".into(), "axes".into(), "law".into(), "none".into()]);
        assert_eq!(
            (d[0].floating_point_range[0].from_value, d[0].floating_point_range[0].to_value),
            (0.0, 2.0)
        );
        assert!(d[0].description.contains("[N m]") && !d[0].read_only);
        assert_eq!((d[1].integer_range[0].to_value, d[1].read_only), (3, true));
        assert!(d[2].additional_constraints.contains("slide"), "{}", d[2].additional_constraints);
        assert_eq!(d[3].r#type, raw::ParameterType::NOT_SET);
        assert_eq!(set.types(&["law".into(), "none".into()]), [4, 0]);
    }
}
