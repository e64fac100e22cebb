//! Computers whose clocks are off: the coordinator finds out, translates, and nothing moves otherwise.

#![allow(clippy::unwrap_used, clippy::panic, reason = "tests")]

use std::convert::Infallible;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use nalgebra::UnitQuaternion;
use whorl_msgs::topics::{Message, PlatformId, Route, Topic};
use whorl_msgs::whorl::{ClockRequest, ControlStatus};
use whorl_node::{LogLine, Timestamp};
use whorl_params::{Override, ParameterTree, standard_layers};
use whorl_sim::{NodeSet, Observer, run};

#[derive(Default)]
struct Watch {
    truth: Vec<[UnitQuaternion<f64>; 2]>,
    latest: [UnitQuaternion<f64>; 2],
    clocks: Vec<ClockRequest>,
    safe: u32,
}

impl Observer for Watch {
    type Error = Infallible;

    fn published(&mut self, _: Timestamp, route: Route, message: &Arc<Message>) -> Result<(), Infallible> {
        match (route.platform, &**message) {
            (Some(PlatformId(id)), Message::AttitudeEstimate(m)) if route.topic == Topic::TruthState => {
                self.latest[usize::from(id)] = m.q_world_body.to_unit().unwrap();
                if id == 1 {
                    self.truth.push(self.latest);
                }
            }
            (_, Message::ControlStatus(m)) if m.mode >= ControlStatus::MODE_SAFE_DAMPING => self.safe += 1,
            (_, Message::ClockRequest(m)) => self.clocks.push(m.clone()),
            _ => {}
        }
        Ok(())
    }

    fn logged(&mut self, _: Timestamp, _: &str, _: &LogLine) {}
}

fn simulate(overrides: &[&str]) -> Watch {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params");
    let experiment = folder.join("experiments/leader_follower_short.yaml");
    let overrides: Vec<_> = overrides.iter().map(|o| Override::parse(o).unwrap()).collect();
    let layers = standard_layers(&folder, &["whorl_1", "whorl_2"], Some(&experiment));
    let tree = ParameterTree::load(&layers, &overrides).unwrap();
    let mut set = NodeSet::build(&tree, 3, Timestamp(0)).unwrap_or_else(|e| panic!("{e}"));
    let mut watch = Watch::default();
    run(&mut set, Duration::from_secs(24), &mut watch, |_| ()).unwrap();
    watch
}

#[test]
fn offsets_are_found_and_the_platforms_move_as_with_one_clock() {
    let poor = ["/simulation:link.delay_s:=0.02", "/simulation:link.jitter_s:=0.03"];
    let one = simulate(&poor);
    let offsets = [5.0, -0.05];
    let own = ["/simulation:clock_offset_s.whorl_1:=5.0", "/simulation:clock_offset_s.whorl_2:=-0.05"];
    let two = simulate(&[poor, own].concat());
    let last = two.clocks.last().unwrap();
    for (measured, (uncertainty, set)) in last.offset_s.iter().zip(last.uncertainty_s.iter().zip(offsets)) {
        assert!((measured - set).abs() < 4e-3 && (measured - set).abs() <= *uncertainty, "{last:?}");
    }
    assert!(one.clocks.last().unwrap().applied_s.iter().all(|s| s.abs() < 4e-3));
    assert_eq!(two.safe, 0);
    // The follower against the leader, from the middle of the slew on; the noise is another.
    let relative = |watch: &Watch| -> f64 {
        let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, 20_f64.to_radians());
        let errors = watch.truth[1400..]
            .iter()
            .map(|[leader, follower]| (leader.inverse() * follower).angle_to(&turn).to_degrees().powi(2));
        (errors.sum::<f64>() / watch.truth[1400..].len() as f64).sqrt()
    };
    let (with_one, with_two) = (relative(&one), relative(&two));
    assert!(with_two < with_one + 0.03, "{with_two} deg against {with_one} deg");
}
