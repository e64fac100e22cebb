//! The model monitor beside the other nodes: how often it is wrong, and how soon it is right.
//!
//! Truth: simulated hardware. Its parameters differ from the model's within what the model's priors say
//! (`params/truth/`), as those of a laboratory do.

#![allow(clippy::unwrap_used, clippy::panic, reason = "tests")]

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use whorl_model_monitor::ModelMonitorCore;
use whorl_msgs::topics::{Message, PlatformId, Route};
use whorl_msgs::whorl::{FormationState, ModelFit};
use whorl_node::{Event, LogLine, NodeCore, Outputs, Timestamp};
use whorl_params::{Override, ParameterTree, standard_layers};
use whorl_sim::{NodeSet, Observer, run};

#[derive(Default)]
struct Watch {
    /// Time since the start of the simulation \[s\], platform.
    fits: Vec<(f64, u16, ModelFit)>,
    /// Commanded-open time of the first platform's jets at this time \[s\].
    jets: Vec<(f64, Vec<f64>)>,
    states: Vec<FormationState>,
    /// All that the first platform published, in its order.
    messages: Vec<(Timestamp, Route, Arc<Message>)>,
    first: Option<Timestamp>,
}

impl Observer for Watch {
    type Error = Infallible;

    fn published(&mut self, now: Timestamp, route: Route, message: &Arc<Message>) -> Result<(), Infallible> {
        let at_s = now.seconds_since(*self.first.get_or_insert(now));
        if route.platform == Some(PlatformId(0)) {
            self.messages.push((now, route, Arc::clone(message)));
        }
        match (route.platform, &**message) {
            (Some(PlatformId(id)), Message::ModelFit(fit)) => self.fits.push((at_s, id, fit.clone())),
            (Some(PlatformId(0)), Message::ThrusterState(m)) => {
                self.jets.push((at_s, m.total_on_time_s.clone()))
            }
            (_, Message::FormationState(m)) => self.states.push(m.clone()),
            _ => {}
        }
        Ok(())
    }

    fn logged(&mut self, _: Timestamp, _: &str, _: &LogLine) {}

    fn stepping(&mut self, _: Timestamp, _: &str, _: &Event<'_>) {}
}

fn parameters(experiment: &str, overrides: &[&str]) -> ParameterTree {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params");
    let experiment = folder.join(format!("experiments/{experiment}.yaml"));
    let overrides: Vec<_> = overrides.iter().map(|o| Override::parse(o).unwrap()).collect();
    let layers = standard_layers(&folder, &["whorl_1", "whorl_2"], Some(&experiment));
    ParameterTree::load(&layers, &overrides).unwrap()
}

fn simulate(experiment: &str, seed: u64, longest_s: f64, overrides: &[&str]) -> Watch {
    let tree = parameters(experiment, overrides);
    let mut set = NodeSet::build(&tree, seed, Timestamp(1_800_000_000_000_000_000)).unwrap();
    let mut watch = Watch::default();
    run(&mut set, Duration::from_secs_f64(longest_s), &mut watch, |_| ()).unwrap();
    watch
}

impl Watch {
    fn first_mismatch(&self, platform: u16) -> Option<(f64, &ModelFit)> {
        let of =
            |(_, id, fit): &&(f64, u16, ModelFit)| *id == platform && fit.state == ModelFit::STATE_MISMATCH;
        self.fits.iter().find(of).map(|(at_s, _, fit)| (*at_s, fit))
    }

    fn watched_s(&self) -> f64 {
        self.fits.iter().filter(|(.., fit)| fit.state != ModelFit::STATE_WAITING).count() as f64
    }
}

#[test]
fn a_model_that_is_right_is_not_accused() {
    is_not_accused(4);
}

/// Over eleven hours.
#[test]
#[ignore = "slow: 170 runs"]
fn a_model_that_is_right_is_accused_at_most_once_in_ten_hours() {
    is_not_accused(170);
}

/// At most one in ten hours, and none in a few runs.
fn is_not_accused(runs: u64) {
    let mut readings: BTreeMap<&str, (f64, u32)> = BTreeMap::new();
    let (mut accused, mut watched_s, mut squares, mut count) = (0, 0.0, 0.0, 0.0);
    for seed in 0..runs {
        let watch = simulate("leader_follower_jets", 100 + seed, 200.0, &[]);
        for platform in [0, 1] {
            accused += u32::from(watch.first_mismatch(platform).is_some());
        }
        watched_s += watch.watched_s();
        for (.., fit) in watch.fits.iter().skip(20) {
            squares += fit.squares;
            count += f64::from(fit.squares_dof);
        }
        let settled = |(at_s, id, fit): &&(f64, u16, ModelFit)| {
            *id == 0 && *at_s > 80.0 && fit.state != ModelFit::STATE_WAITING
        };
        for (.., fit) in watch.fits.iter().filter(settled) {
            let gyro = [fit.gyro_whitened.x, fit.gyro_whitened.y, fit.gyro_whitened.z];
            let all = gyro
                .into_iter()
                .map(|y| ("gyro", y))
                .chain(fit.wheel_speed_whitened.iter().map(|y| ("wheel speed", *y)));
            for (name, y) in all.filter(|(_, y)| y.is_finite()) {
                let slot = readings.entry(name).or_insert((0.0, 0));
                *slot = (slot.0 + y * y, slot.1 + 1);
            }
        }
    }
    println!(
        "{accused} accused in {:.2} h; mean square {:.3} of {count}",
        watched_s / 3600.0,
        squares / count
    );
    for (name, (squares, count)) in readings.iter() {
        println!("{name}: mean square {:.3} of {count}", squares / f64::from(*count));
    }
    assert!(watched_s > 200.0 * runs as f64, "it watched: {watched_s} s");
    assert!(f64::from(accused) <= (0.1 * watched_s / 3600.0).floor() + 1.0 && (runs > 10 || accused == 0));
    // A little below one: the filter expects background torque and errors of formulas, which simulated hardware has hardly any of.
    for (squares, count) in
        readings.values().map(|(squares, count)| (*squares, f64::from(*count))).chain([(squares, count)])
    {
        // The scatter of a mean of so many squares, four times.
        let by_chance = 4.0 * (2.0 / count).sqrt();
        let mean = squares / count;
        assert!(mean > 0.85 - by_chance && mean < 1.05 + by_chance, "{mean} of {count}");
    }
}

/// A nozzle clogs to 70 % in mid-run: found within 30 s of when the jet has been open for a tenth of a second, and named.
#[test]
fn a_weak_jet_is_found_and_named() {
    for (jet, index) in [("jet_3", 2), ("jet_6", 5), ("jet_9", 8)] {
        let faults = [
            "/whorl_1/driver:faults.weak.kind:=jet_weak".to_owned(),
            format!("/whorl_1/driver:faults.weak.jet:={jet}"),
            "/whorl_1/driver:faults.weak.thrust:=0.7".to_owned(),
            "/whorl_1/driver:faults.weak.start_s:=60.0".to_owned(),
        ];
        let faults: Vec<&str> = faults.iter().map(String::as_str).collect();
        let watch = simulate("leader_follower_jets", 5, 200.0, &faults);
        let before = watch.jets.iter().rev().find(|(at_s, _)| *at_s < 60.0).unwrap().1[index];
        let fired_s = watch.jets.iter().find(|(_, total)| total[index] > before + 0.1).unwrap().0;
        let (found_s, fit) = watch.first_mismatch(0).unwrap_or_else(|| panic!("{jet} was not found"));
        println!("{jet}: fired at {fired_s:.1} s, found at {found_s:.1} s: {}", fit.in_words());
        assert!(
            found_s > 60.0 && found_s < fired_s + 30.0,
            "{jet}: fired at {fired_s} s, found at {found_s} s"
        );
        // With five seconds more of it.
        let later = |(at_s, id, _): &&(f64, u16, ModelFit)| *id == 0 && *at_s >= found_s + 5.0;
        let fit = &watch.fits.iter().find(later).unwrap().2;
        assert_eq!((fit.effect.as_str(), &fit.parameter[..]), ("thruster_strength", &[jet.to_owned()][..]));
        assert!((fit.estimate[0] + 0.3).abs() < 4.0 * fit.stddev[0], "{}", fit.in_words());
        assert!(watch.first_mismatch(1).is_none(), "the other platform is well");
    }
}

/// How long a jet at 70 % fires, once it is weak, until it is found \[s\], and what then is named; `None` where it is not found.
struct Found {
    jet: String,
    fired_s: f64,
    after_s: Option<f64>,
    named: String,
}

fn weak_jet(index: usize, seed: u64, start_s: f64, thrust: f64) -> Found {
    let jet = format!("jet_{}", index + 1);
    let faults = [
        "/whorl_1/driver:faults.weak.kind:=jet_weak".to_owned(),
        format!("/whorl_1/driver:faults.weak.jet:={jet}"),
        format!("/whorl_1/driver:faults.weak.thrust:={thrust}"),
        format!("/whorl_1/driver:faults.weak.start_s:={start_s}"),
    ];
    let faults: Vec<&str> = faults.iter().map(String::as_str).collect();
    let watch = simulate("leader_follower_jets", seed, 200.0, &faults);
    let open_s =
        |at_s: f64| watch.jets.iter().rev().find(|(t, _)| *t < at_s).map_or(0.0, |(_, total)| total[index]);
    let before_s = if start_s > 0.0 { open_s(start_s) } else { 0.0 };
    let first = watch.first_mismatch(0).filter(|(at_s, _)| *at_s > start_s);
    let last = watch.fits.iter().rev().find(|(_, id, fit)| *id == 0 && !fit.effect.is_empty());
    Found {
        jet,
        fired_s: open_s(f64::INFINITY) - before_s,
        after_s: first.map(|(at_s, _)| open_s(at_s) - before_s),
        named: last
            .map_or_else(String::new, |(.., fit)| format!("{} {}", fit.effect, fit.parameter.join(" "))),
    }
}

#[test]
fn a_weak_jet_is_found_by_how_long_it_fired() {
    weak_jets_are_found(5..6, 5..6);
}

#[test]
#[ignore = "slow: every jet, twice"]
fn weak_jets_are_found_by_how_long_they_fired() {
    weak_jets_are_found(0..12, 5..7);
}

/// Jets at 70 % from mid-run on, and at half from the start: of a weakness that was always there the monitor takes a ninth of a reading's
/// deviation for an error that every reading may have.
fn weak_jets_are_found(jets: Range<usize>, seeds: Range<u64>) {
    // From the start a thrust that the prior calls certain to 5 % must be refuted, beside all else that the priors leave open.
    for (start_s, thrust, enough_s, share) in [(60.0, 0.7, 1.9, 1.0), (0.0, 0.5, 5.0, 0.5)] {
        let (mut fired, mut hit) = (0_u32, 0_u32);
        for (jet, seed) in jets.clone().flat_map(|jet| seeds.clone().map(move |seed| (jet, seed))) {
            let found = weak_jet(jet, seed, start_s, thrust);
            println!(
                "{} weak from {start_s} s, seed {seed}: fired {:.2} s, found after {:.2?} s of it: {}",
                found.jet, found.fired_s, found.after_s, found.named
            );
            fired += u32::from(found.fired_s >= enough_s);
            hit += u32::from(found.fired_s >= enough_s && found.after_s.is_some());
            let named = format!("thruster_strength {}", found.jet);
            assert!(found.after_s.is_none() || found.named == named, "{}: {}", found.jet, found.named);
        }
        println!("weak from {start_s} s: {hit} of {fired} that fired {enough_s} s were found");
        assert!(f64::from(hit) >= share * f64::from(fired), "{hit} of {fired}");
    }
}

/// Told to hold, the experiment waits, and ends when nobody makes the monitor forget.
#[test]
fn an_experiment_holds_when_told_to() {
    let overrides = [
        "/whorl_1/driver:faults.weak.kind:=jet_weak",
        "/whorl_1/driver:faults.weak.jet:=jet_3",
        "/whorl_1/driver:faults.weak.thrust:=0.5",
        "/whorl_1/driver:faults.weak.start_s:=60.0",
        "/coordinator:experiment.on_model_mismatch:=hold",
        "/coordinator:experiment.model_hold_s:=15.0",
    ];
    let watch = simulate("leader_follower_jets", 5, 200.0, &overrides);
    let (found_s, _) = watch.first_mismatch(0).unwrap();
    let last = watch.states.last().unwrap();
    assert_eq!(last.phase, FormationState::PHASE_ABORTED);
    let mut held =
        watch.states.iter().filter(|s| s.run_elapsed_s > 0.0 && s.phase != FormationState::PHASE_ABORTED);
    let ended_s = held.next_back().unwrap().run_elapsed_s;
    // The run began some seconds after the simulation; the hold is not part of its time.
    assert!(found_s - ended_s < 15.0, "found at {found_s} s, run at {ended_s} s");
    // Not told to, it goes on.
    let watch = simulate("leader_follower_jets", 5, 200.0, &overrides[..4]);
    assert_eq!(watch.states.last().unwrap().phase, FormationState::PHASE_FINISHED);
}

/// Numbers from 0 to 1, each as likely (xorshift, Marsaglia 2003).
struct Drawn(u64);

impl Drawn {
    fn next(&mut self) -> f64 {
        for (left, by) in [(true, 13), (false, 7), (true, 17)] {
            self.0 ^= if left { self.0 << by } else { self.0 >> by };
        }
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// What a busy computer does with messages.
#[derive(Debug, Clone, Copy)]
enum Busy {
    /// Stalls of up to so long \[s\], about every two seconds, after which topic after topic is read.
    Stalls(f64),
    /// This share is lost.
    Loses(f64),
    /// This share comes late by up to 0.2 s, each by itself.
    Scatters(f64),
}

/// The monitor of the first platform, which gets the messages of a run as a busy computer delivers them: its fits.
fn delivered(watch: &Watch, busy: Busy, seed: u64) -> Vec<ModelFit> {
    let tree = parameters("leader_follower_jets", &[]);
    let node = tree.for_node("/whorl_1/model_monitor");
    let read = whorl_params::read(&node, whorl_model_monitor::parameters::read).unwrap();
    let mut core = ModelMonitorCore::new(read.0.unwrap()).unwrap();
    let routes = core.subscriptions();
    let mut drawn = Drawn(88_172_645_463_325_252 ^ (seed + 1));
    let mut stalled_until = Timestamp(0);
    let mut queue = Vec::new();
    let of_monitor = watch.messages.iter().filter(|(_, route, _)| routes.contains(route));
    for (number, (sent, route, message)) in of_monitor.enumerate() {
        let late = |share_s: f64| *sent + Duration::from_secs_f64(share_s);
        let at = match busy {
            Busy::Loses(share) if drawn.next() < share => continue,
            Busy::Scatters(share) if drawn.next() < share => late(0.2 * drawn.next()),
            Busy::Loses(_) | Busy::Scatters(_) => *sent,
            Busy::Stalls(longest_s) => {
                // Some 450 messages a second.
                if drawn.next() < 1.0 / 900.0 {
                    stalled_until = late(longest_s * drawn.next());
                }
                (*sent).max(stalled_until)
            }
        };
        let topic = routes.iter().position(|known| known == route).unwrap();
        let in_turn = if matches!(busy, Busy::Stalls(_)) { topic } else { 0 };
        queue.push((at, in_turn, number, *route, Arc::clone(message)));
    }
    queue.sort_by_key(|(at, topic, number, ..)| (*at, *topic, *number));
    let (mut fits, mut outputs) = (Vec::new(), Outputs::default());
    let mut due = queue[0].0;
    for (at, _, _, route, message) in &queue {
        while due <= *at {
            core.step(due, Event::Timer, &mut outputs);
            fits.extend(std::mem::take(&mut outputs).messages.into_iter().filter_map(|published| {
                match &*published.message {
                    Message::ModelFit(fit) => Some(fit.clone()),
                    _ => None,
                }
            }));
            due = due + Duration::from_secs(1);
        }
        core.step(*at, Event::Message { route: *route, message }, &mut outputs);
    }
    fits
}

#[test]
fn a_busy_computer_accuses_nobody() {
    busy_computers_accuse_nobody(2);
}

#[test]
#[ignore = "slow: thirty runs"]
fn a_busy_computer_accuses_at_most_once_in_ten_hours() {
    busy_computers_accuse_nobody(30);
}

/// The same run, whose model is right, as a busy computer hears of it: late, lost and in disorder. Nothing is concluded from that,
/// and what arrives whole is still compared.
fn busy_computers_accuse_nobody(runs: u64) {
    let all =
        [Busy::Stalls(0.1), Busy::Stalls(0.6), Busy::Loses(0.01), Busy::Loses(0.1), Busy::Scatters(0.002)];
    let (mut accused, mut watched_s) = (0, 0.0);
    for seed in 0..runs {
        let watch = simulate("leader_follower_jets", 300 + seed, 200.0, &[]);
        for busy in all {
            let fits = delivered(&watch, busy, seed);
            let mismatch = fits.iter().find(|fit| fit.state == ModelFit::STATE_MISMATCH);
            let compared = fits.iter().filter(|fit| fit.state != ModelFit::STATE_WAITING).count();
            println!(
                "{busy:?}: {compared} of {} s compared, {:?}",
                fits.len(),
                mismatch.map(ModelFit::in_words)
            );
            accused += u32::from(mismatch.is_some());
            watched_s += compared as f64;
            // Ten such stalls or twenty messages out of order a minute leave little that hangs together.
            let least = match busy {
                Busy::Stalls(_) | Busy::Loses(_) => 0.5,
                Busy::Scatters(_) => 0.0,
            };
            assert!(compared as f64 >= least * fits.len() as f64, "{busy:?}: {compared} of {}", fits.len());
        }
    }
    println!("{accused} accused in {:.2} h", watched_s / 3600.0);
    assert!(f64::from(accused) <= (0.1 * watched_s / 3600.0).floor() + 1.0 && (runs > 10 || accused == 0));
}

#[test]
fn a_busy_computer_finds_a_jet_that_breaks() {
    let faults = [
        "/whorl_1/driver:faults.weak.kind:=jet_weak",
        "/whorl_1/driver:faults.weak.jet:=jet_9",
        "/whorl_1/driver:faults.weak.thrust:=0.7",
        "/whorl_1/driver:faults.weak.start_s:=60.0",
    ];
    let watch = simulate("leader_follower_jets", 5, 200.0, &faults);
    for busy in [Busy::Stalls(0.1), Busy::Loses(0.02)] {
        let fits = delivered(&watch, busy, 1);
        let last = fits.iter().rev().find(|fit| !fit.effect.is_empty());
        let last = last.unwrap_or_else(|| panic!("{busy:?}: the weak jet was not found"));
        println!("{busy:?}: {}", last.in_words());
        assert_eq!((last.effect.as_str(), last.parameter.join(" ").as_str()), ("thruster_strength", "jet_9"));
    }
}

/// Seed 2 had accused the gyro of a scale of -0.2 after 542 s.
#[test]
fn holding_still_is_no_evidence() {
    holding_still(2..3);
}

#[test]
#[ignore = "slow: twelve runs of ten minutes"]
fn holding_still_is_no_evidence_with_more_seeds() {
    holding_still(1..13);
}

/// Platforms that hold still for ten minutes: hardly anything is excited, and evidence does not grow with time alone.
fn holding_still(seeds: Range<u64>) {
    for seed in seeds {
        let watch = simulate("hold", seed, 700.0, &["/coordinator:steps.hold.duration_s:=600.0"]);
        for platform in [0, 1] {
            let own =
                || watch.fits.iter().filter(|(_, id, _)| *id == platform).map(|(at_s, _, fit)| (*at_s, fit));
            let most = own().map(|(_, fit)| fit.ln_evidence).fold(f64::NEG_INFINITY, f64::max);
            let mismatch = watch.first_mismatch(platform).map(|(at_s, fit)| (at_s, fit.in_words()));
            println!("seed {seed}, platform {platform}: evidence {most:.2} at most");
            assert!(mismatch.is_none(), "seed {seed}, platform {platform}: {mismatch:?}");
            let at = |second: f64| own().find(|(at_s, _)| *at_s >= second).unwrap().1.ln_evidence;
            assert!(at(600.0) < at(120.0) + 1.0, "it grows: {} at 120 s, {} at 600 s", at(120.0), at(600.0));
        }
    }
}

/// After two minutes of ten.
#[test]
fn an_empty_tank_accuses_nobody() {
    empty_tanks(2..3, 600.0, 1.0e6);
}

/// After 37 minutes of an hour as well.
#[test]
#[ignore = "slow: three runs of an hour"]
fn empty_tanks_accuse_nobody_for_long() {
    empty_tanks(3..6, 600.0, 1.0e6);
    empty_tanks(1..4, 3600.0, 2.0e7);
}

/// Tanks that run empty: a sensor then reads less than nothing every other time, and a model whose jets use a little more or less gas
/// than the platform's is a minute late. What jets that have no gas do not do is nobody's fault.
fn empty_tanks(seeds: Range<u64>, hold_s: f64, pressure_pa: f64) {
    for seed in seeds {
        let hold = format!("/coordinator:steps.hold.duration_s:={hold_s:.1}");
        let tank = format!("/**:model.tank.initial_pressure_pa:={pressure_pa:.1}");
        let watch = simulate("hold", seed, hold_s + 100.0, &[&hold, &tank]);
        for platform in [0, 1] {
            let mismatch = watch.first_mismatch(platform).map(|(at_s, fit)| (at_s, fit.in_words()));
            println!("seed {seed}, platform {platform}: {mismatch:?}, watched {} s", watch.watched_s());
            assert!(mismatch.is_none(), "seed {seed}, platform {platform}: {mismatch:?}");
        }
    }
}
