//! Cost of one control step: estimate in, actuator command out.
//! `cargo bench -p whorl_local_control`

#![expect(clippy::expect_used, reason = "a bench may stop on its own inputs")]

use std::path::Path;

use criterion::{Criterion, criterion_group, criterion_main};
use whorl_local_control::{LocalControlCore, parameters};
use whorl_msgs::geometry_msgs::{Quaternion, Vector3};
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::{Message, PlatformId, Route, Topic};
use whorl_msgs::whorl::{AttitudeEstimate, AttitudeReference, FormationCommand};
use whorl_node::{Event, NodeCore, Outputs, Timestamp};
use whorl_params::{Override, ParameterTree, standard_layers, try_read};

const PERIOD_NS: i64 = 10_000_000;

fn core(actuators: &str) -> LocalControlCore {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params");
    let files = standard_layers(&directory, &["whorl_1", "whorl_2"], None);
    let arguments = [Override::parse(&format!("actuators:={actuators}")).expect("an argument")];
    let tree = ParameterTree::load(&files, &arguments).expect("the repository's parameters");
    let node = tree.for_node("/whorl_1/local_control");
    let (parameters, _) = try_read(&node, parameters::read).expect("valid parameters");
    LocalControlCore::new(parameters).expect("a possible platform")
}

struct Loop {
    core: LocalControlCore,
    outputs: Outputs,
    k: i64,
}

impl Loop {
    fn send(&mut self, now: Timestamp, route: Route, message: &Message) {
        self.core.step(now, Event::Message { route, message }, &mut self.outputs);
    }

    /// One estimate, with the reference and the authority at their own rates.
    fn step(&mut self) {
        self.k += 1;
        let now = Timestamp(self.k * PERIOD_NS);
        let header = Header { stamp: now.into(), frame_id: String::new() };
        let later = Timestamp(now.0 + 500_000_000).into();
        let own = |topic| Route::platform(PlatformId(0), topic);
        self.outputs.clear();
        if self.k % 2 == 0 {
            let reference = AttitudeReference {
                header: header.clone(),
                valid_until: later,
                q_world_reference: Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 },
                ..AttitudeReference::default()
            };
            self.send(now, own(Topic::AttitudeReference), &reference.into());
        }
        if self.k % 5 == 0 {
            let command = FormationCommand {
                header: header.clone(),
                command: FormationCommand::COMMAND_TRACK,
                valid_until: later,
                ..FormationCommand::default()
            };
            self.send(now, Route::shared(Topic::FormationCommand), &command.into());
        }
        // A small, changing error, as noise makes it.
        let wobble = 1e-3 * (self.k as f64 * 0.7).sin();
        let estimate = AttitudeEstimate {
            header,
            q_world_body: Quaternion {
                x: 0.5 * wobble,
                y: 0.0,
                z: 0.0,
                w: (1.0 - 0.25 * wobble * wobble).sqrt(),
            },
            omega_wb_b_rad_s: Vector3 { x: wobble, y: -wobble, z: 2.0 * wobble },
            health: AttitudeEstimate::HEALTH_OK,
            ..AttitudeEstimate::default()
        };
        self.send(now, own(Topic::AttitudeEstimate), &estimate.into());
    }
}

fn steps(criterion: &mut Criterion) {
    for actuators in ["wheels", "both", "jets"] {
        let mut cycle = Loop { core: core(actuators), outputs: Outputs::default(), k: 0 };
        for _ in 0..100 {
            cycle.step();
        }
        criterion.bench_function(&format!("control step, {actuators}"), |b| b.iter(|| cycle.step()));
    }
}

criterion_group!(benches, steps);
criterion_main!(benches);
