//! Three computers on a radio link, ground and two platforms, whose clocks differ: loss, delay with jitter, cuts, a
//! computer that restarts. Nothing diverges, stale state is never used, and the formation is whole again
//! within two seconds of a link's return, without a restart.
//!
//! Needs root, `ip` (iproute2) for network namespaces and `cc` for the clocks. `tests/measures/links.sh` runs the slow ones.

use std::time::Duration;

use nalgebra::Vector3;
use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{AttitudeEstimate, ClockRequest, ControlStatus, FormationState};
use whorl_node::{Node, Timestamp};
use whorl_ros::environment::Network;

use crate::support::formation::{Formation, LONG_HOLD, STARTUP};
use crate::support::network::Lan;
use crate::support::relay::Quality;
use crate::support::watch::{Watch, route};
use crate::support::{binaries, clock, measured, skipped};

const PLATFORMS: [&str; 2] = ["whorl_1", "whorl_2"];
/// Clocks of the platforms' computers less that of the ground [s].
const CLOCKS_S: [f64; 2] = [0.05, -0.05];
const SOON: Duration = Duration::from_secs(10);
/// The requirement is 2 s; this limit allows for a busy machine.
const REJOIN: Duration = Duration::from_secs(6);
/// `coordinator` `reference_validity_s`, and a period of the estimates besides.
const OLDEST_REFERENCE_S: f64 = 0.3 + 0.02;
/// `coordinator` `link.stale_s`.
const STALE_S: f64 = 0.3;

/// 0.1 deg.
const POINTS_RAD: f64 = 1.7e-3;

struct Laboratory {
    lan: Lan,
    formation: Formation,
    watch: Watch,
    /// Loss, delay and cuts as they are said in what is measured.
    lines: Vec<String>,
}

#[test]
#[ignore = "slow: poor links and cuts up to two minutes"]
fn a_formation_on_three_computers_lives_with_loss_delay_cuts_and_a_restart() {
    let Some(mut laboratory) = Laboratory::start("a poor link between three computers") else { return };
    laboratory.clocks_are_known("on a good link", 3e-3);
    for (loss, delay_s, jitter_s) in
        [(0.05, 0.0, 0.0), (0.2, 0.0, 0.0), (0.0, 0.02, 0.0), (0.0, 0.02, 0.18), (0.2, 0.02, 0.18)]
    {
        laboratory.poor_link(loss, delay_s, jitter_s, Duration::from_secs(40));
    }
    for seconds in [1, 10, 35, 120] {
        laboratory.cut(Duration::from_secs(seconds));
    }
    laboratory.restart_of_a_computer();
    laboratory.nothing_diverged();
    laboratory.report_tells();
    measured(&laboratory.lines.join("\n              "));
    laboratory.formation.stop();
}

/// Beside every other test it is short, and judges nothing that needs a computer's time.
#[test]
fn a_formation_lives_with_a_third_lost_and_a_jitter_of_200_ms() {
    let Some(laboratory) = Laboratory::start("a third of all frames lost between three computers") else {
        return;
    };
    laboratory.a_third_is_lost(20);
}

#[test]
#[ignore = "slow: a third of all frames lost for five minutes"]
fn a_formation_lives_for_minutes_with_a_third_lost_and_a_jitter_of_200_ms() {
    let what = "a third of all frames lost between three computers for five minutes";
    let Some(laboratory) = Laboratory::start(what) else { return };
    laboratory.a_third_is_lost(300);
}

impl Laboratory {
    fn a_third_is_lost(mut self, seconds: u64) {
        self.poor_link(0.3, 0.0, 0.2, Duration::from_secs(seconds));
        self.nothing_diverged();
        measured(&format!("for {seconds} s, both ways: {}", self.lines.join("\n              ")));
        self.formation.stop();
    }

    /// A formation in hold; `None` where this machine cannot.
    fn start(what: &str) -> Option<Self> {
        let lan = Lan::new(3)
            .map_err(|why| skipped(what, &format!("network namespaces cannot be made here: {why}")))
            .ok()?;
        let [ground, first, second] = [0, 1, 2].map(|host| lan.hosts[host].as_str());
        let mut formation = Formation::new(&PLATFORMS, &[LONG_HOLD]).in_namespaces(ground, &[first, second]);
        for (platform, ahead_s) in PLATFORMS.iter().zip(CLOCKS_S) {
            let variables = clock::shifted(formation.folder(), ahead_s)
                .map_err(|why| skipped(what, &format!("no clock can be shifted here: {why}")))
                .ok()?;
            formation.set_environment(platform, variables);
        }
        let network = Network { interfaces: None, ..Network::localhost(formation.domain()) };
        // The observer sits on the ground, whose clock is that of this test.
        let watch = lan.on_host(0, || Watch::on(network, &PLATFORMS));
        formation.start_all();
        let run = formation.folder().join("run");
        formation.start_with("/recorder", &[format!("run_directory:={}", run.display())]);
        formation.wait_for_step(&watch, "hold");
        let mut laboratory = Self { lan, formation, watch, lines: Vec::new() };
        laboratory.wait_until_whole(whorl_ros::wall_clock(), STARTUP);
        Some(laboratory)
    }

    /// Until both platforms track and their links are well, by what arrived after `since`: after how long [s].
    fn wait_until_whole(&mut self, since: Timestamp, timeout: Duration) -> f64 {
        self.formation.check_alive();
        let whole = self.watch.wait("the formation to be whole", timeout, |log| {
            let state = log.after::<FormationState>(route(0, Topic::FormationState), since).find(|(_, m)| {
                m.step == "hold" && m.link_ok == [true; 2] && m.control_mode == [ControlStatus::MODE_TRACK; 2]
            });
            // The coordinator reports the latest mode that it has received; these were received since.
            let tracks = |platform| {
                let mut statuses = log.after::<ControlStatus>(route(platform, Topic::ControlStatus), since);
                statuses.find(|(_, m)| m.mode == ControlStatus::MODE_TRACK).map(|(at, _)| at)
            };
            Some(state?.0.max(tracks(0)?).max(tracks(1)?))
        });
        whole.seconds_since(since)
    }

    /// Largest angle between the follower's demanded and actual attitude, as reported by the coordinator [deg].
    fn worst_error_deg(&self, since: Timestamp) -> f64 {
        let log = self.watch.log();
        log.after::<FormationState>(route(0, Topic::FormationState), since)
            .map(|(_, m)| Vector3::from(m.relative_error_rad[1]).norm().to_degrees())
            .filter(|e| e.is_finite())
            .fold(0.0, f64::max)
    }

    fn clocks_are_known(&mut self, when: &str, within_s: f64) {
        let known = self.watch.wait("the clocks' offsets", SOON, |log| {
            let request = log.latest::<ClockRequest>(route(0, Topic::FormationClock))?.1;
            request.offset_s.iter().all(|s| s.is_finite()).then(|| request.clone())
        });
        for ((offset_s, uncertainty_s), true_s) in
            known.offset_s.iter().zip(&known.uncertainty_s).zip(CLOCKS_S)
        {
            let error_s = offset_s - true_s;
            assert!(error_s.abs() <= within_s && error_s.abs() <= uncertainty_s + 1e-3, "{when}: {known:?}");
            self.lines.push(format!(
                "{when}: a clock that is {:+.0} ms off is measured as {:+.2} ms, known within {:.2} ms",
                true_s * 1e3,
                offset_s * 1e3,
                uncertainty_s * 1e3
            ));
        }
        assert!(known.applied_s.iter().zip(&known.offset_s).all(|(a, o)| (a - o).abs() < 2e-3), "{known:?}");
    }

    fn poor_link(&mut self, loss: f64, delay_s: f64, jitter_s: f64, time: Duration) {
        self.lan.set_all(|quality| *quality = Quality { cut: false, loss, delay_s, jitter_s });
        // What was on its way before is over.
        std::thread::sleep(Duration::from_secs(1));
        let since = self.watch.during(time);
        let (mut tracked, mut all) = (0, 0);
        for platform in 0..2 {
            let log = self.watch.log();
            for (_, m) in log.after::<ControlStatus>(route(platform, Topic::ControlStatus), since) {
                // Its own sensors and estimates cross no link: if they are missing, the machine is too busy.
                let own = [ControlStatus::REASON_ESTIMATE_STALE, ControlStatus::REASON_ESTIMATE_UNHEALTHY];
                let busy = own.contains(&m.reason);
                assert!(busy || m.mode < ControlStatus::MODE_SAFE_DAMPING, "safe mode on a poor link: {m:?}");
                all += 1;
                tracked += usize::from(m.mode == ControlStatus::MODE_TRACK);
            }
        }
        assert!(all > 0, "no status crossed the link");
        let share = tracked as f64 / all as f64;
        let worst_deg = self.worst_error_deg(since);
        self.lines.push(format!(
            "loss {:.0} %, delay {:.0} to {:.0} ms: tracks {:.1} % of the time, relative error at most {worst_deg:.3} deg",
            loss * 100.0,
            delay_s * 1e3,
            (delay_s + jitter_s) * 1e3,
            share * 100.0
        ));
        // A slow test has the computer to itself, and is long enough that the clock estimate no longer uses exchanges over the good link
        // before.
        if time > Duration::from_secs(35) {
            assert!(share > 0.7, "tracked in {share} of the time");
            assert!(worst_deg < 1.0, "{worst_deg} deg");
            self.clocks_are_known("on that link", 0.02);
        }
        self.lan.set_all(|quality| *quality = Quality::default());
        self.wait_until_whole(whorl_ros::wall_clock(), STARTUP);
    }

    fn cut(&mut self, length: Duration) {
        self.lan.cut();
        std::thread::sleep(length);
        self.formation.check_alive();
        if length > Duration::from_secs(2) {
            let log = self.watch.log();
            let (_, state) = log.latest::<FormationState>(route(0, Topic::FormationState)).unwrap();
            assert!(!state.link_ok[1] && state.link_ok[0], "{state:?}");
        }
        self.lan.restore();
        let restored = whorl_ros::wall_clock();
        let rejoined_s = self.wait_until_whole(restored, REJOIN);
        // In a long cut the platform, with its actuators off, has swung to its equilibrium and must come back from there.
        let points_s = self.watch.wait("the follower to point again", 3 * SOON, |log| {
            log.after::<FormationState>(route(0, Topic::FormationState), restored)
                .find(|(_, m)| Vector3::from(m.relative_error_rad[1]).norm() < POINTS_RAD)
                .map(|(at, _)| at.seconds_since(restored))
        });
        self.lines.push(format!(
            "a cut of {} s: whole again after {rejoined_s:.2} s, points within 0.1 deg after {points_s:.2} s",
            length.as_secs()
        ));
    }

    /// Power fails and comes back on the computer of Whorl-II.
    fn restart_of_a_computer(&mut self) {
        self.lan.cut();
        for node in Node::of_platform(false) {
            self.formation.kill(&format!("/whorl_2/{}", node.name()));
        }
        let state = route(0, Topic::FormationState);
        self.watch.wait_next::<FormationState>("the loss of Whorl-II", state, SOON, |m| !m.link_ok[1]);
        std::thread::sleep(Duration::from_secs(3));
        self.lan.restore();
        let up = whorl_ros::wall_clock();
        self.formation.start_platform("whorl_2");
        let healthy = self.watch.wait("the estimator of Whorl-II", 3 * SOON, |log| {
            log.after::<AttitudeEstimate>(route(1, Topic::AttitudeEstimate), up)
                .find(|(_, m)| m.usable())
                .map(|(at, _)| at)
        });
        let whole_s = self.wait_until_whole(up, 3 * SOON);
        let healthy_s = healthy.seconds_since(up);
        assert!(whole_s - healthy_s < REJOIN.as_secs_f64(), "{whole_s} s, its estimator after {healthy_s} s");
        self.lines.push(format!(
            "a computer restarts: its estimator is well {healthy_s:.2} s after its nodes start, the formation \
             {:.2} s later",
            whole_s - healthy_s
        ));
    }

    fn nothing_diverged(&self) {
        let log = self.watch.log();
        for platform in 0..2 {
            for (_, m) in log.of::<ControlStatus>(route(platform, Topic::ControlStatus)) {
                let stale = m.mode == ControlStatus::MODE_TRACK && m.reference_age_s > OLDEST_REFERENCE_S;
                assert!(!stale, "platform {platform} tracks a reference that is {} s old", m.reference_age_s);
            }
            for (_, m) in log.of::<AttitudeEstimate>(route(platform, Topic::TruthState)) {
                let rate_deg_s = Vector3::from(m.omega_wb_b_rad_s).norm().to_degrees();
                assert!(rate_deg_s < 10.0, "platform {platform} turned with {rate_deg_s} deg/s");
            }
        }
        for (_, m) in log.of::<FormationState>(route(0, Topic::FormationState)) {
            let used = m.link_ok.iter().zip(&m.link_age_s).all(|(ok, age_s)| !ok || *age_s <= STALE_S);
            assert!(used, "{m:?}");
        }
    }

    /// The run's report shows links, cuts and clocks.
    fn report_tells(&mut self) {
        self.formation.node("/recorder").signal(rustix::process::Signal::INT);
        assert!(self.formation.node("/recorder").wait(SOON).success());
        let run = self.formation.folder().join("run");
        let mut whorl = self.formation.command(None, &binaries::path("whorl"));
        let output = whorl.arg("report").arg(&run).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        if let Ok(keep) = std::env::var("WHORL_LINKS_REPORT") {
            std::fs::copy(run.join("report.html"), keep).unwrap();
        }
        let page = std::fs::read_to_string(run.join("report.html")).unwrap();
        for text in ["link lost", "link up", "clock offset"] {
            assert!(page.contains(text), "the report says nothing of `{text}`");
        }
    }
}
