//! Mass properties in the whole loop: found while the platform moves, and balanced away.

#![allow(clippy::unwrap_used, clippy::panic, reason = "tests")]

use std::convert::Infallible;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use nalgebra::Vector3;
use whorl_msgs::topics::{Message, Route, Topic};
use whorl_msgs::whorl::ParameterEstimate;
use whorl_node::{Event, LogLine, Timestamp};
use whorl_params::{ParameterTree, standard_layers};
use whorl_sim::{NodeSet, Observer, run};

#[derive(Default)]
struct Watch {
    estimates: Vec<ParameterEstimate>,
    moments: Vec<(f64, Vector3<f64>)>,
}

impl Observer for Watch {
    type Error = Infallible;

    fn published(&mut self, now: Timestamp, route: Route, message: &Arc<Message>) -> Result<(), Infallible> {
        match &**message {
            Message::ParameterEstimate(m) => self.estimates.push(m.clone()),
            Message::Vector3Stamped(m) if route.topic == Topic::BallastMoment => {
                self.moments.push((now.seconds(), m.vector.into()));
            }
            _ => {}
        }
        Ok(())
    }

    fn logged(&mut self, _: Timestamp, _: &str, _: &LogLine) {}

    fn stepping(&mut self, _: Timestamp, _: &str, _: &Event<'_>) {}
}

/// Runs an experiment of Whorl-I to its end.
fn simulate(experiment: &str, seed: u64) -> Watch {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params");
    let experiment = folder.join("experiments").join(experiment);
    let layers = standard_layers(&folder, &["whorl_1"], Some(&experiment));
    let tree = ParameterTree::load(&layers, &[]).unwrap();
    let mut set = NodeSet::build(&tree, seed, Timestamp(0)).unwrap_or_else(|e| panic!("{e}"));
    let mut watch = Watch::default();
    run(&mut set, Duration::from_secs(320), &mut watch, |_| ()).unwrap();
    watch
}

/// `parameters/estimate` of the estimator node: from the model's values to the truth of params/truth/whorl_1.yaml.
#[test]
fn the_estimator_finds_the_mass_properties_while_the_platform_moves() {
    let watch = simulate("identify_whorl_1.yaml", 1);
    assert!(watch.estimates.len() > 90, "{}", watch.estimates.len());
    let truth = [6.29, -0.92, -0.19, 7.40, 0.11, 12.28, -0.021, -0.0735, -2.1];
    let last = watch.estimates.last().unwrap();
    for (i, t) in truth.iter().enumerate() {
        let allowed = (0.02 * f64::abs(*t)).max(if i < 6 { 0.02 } else { 1e-3 });
        println!("{} {:.4} true {t} +- {:.4}", last.name[i], last.value[i], last.stddev[i]);
        assert!((last.value[i] - t).abs() < allowed, "{}: {} true {t}", last.name[i], last.value[i]);
        assert!(last.stddev[i] < 0.2 * last.prior_stddev[i], "{}", last.name[i]);
    }
    let sequences: Vec<u64> = watch.estimates.iter().map(|e| e.sequence).collect();
    assert!(sequences.iter().enumerate().all(|(n, s)| *s == n as u64));
}

/// Nobody asked: nothing is estimated.
#[test]
fn mass_properties_are_not_estimated_unless_asked_for() {
    let watch = simulate("free_swing_whorl_1.yaml", 1);
    assert!(watch.estimates.is_empty() && watch.moments.is_empty());
}

/// 30 N mm across and 100 N mm along z at the start; the experiment file says so.
#[test]
fn thirty_newton_millimetres_are_balanced_to_less_than_one() {
    for seed in [1, 2] {
        let watch = simulate("balance_whorl_1.yaml", seed);
        let off = Vector3::new(0.024, -0.018, -0.1);
        let (_, moment) = watch.moments.last().unwrap();
        let left = off + moment;
        let reached = watch.moments.iter().rev().find(|(_, m)| (off + m).xy().norm() >= 1e-3).unwrap().0;
        println!("seed {seed}: {left:?} N m left, across below 1 N mm for good after {reached:.0} s");
        assert!(left.xy().norm() < 1e-3 && left.z.abs() < 5e-3, "seed {seed}: {left}");
    }
}
