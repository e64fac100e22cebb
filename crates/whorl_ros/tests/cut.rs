//! A cut of the network that outlasts DDS's lease of 50 s, between two network namespaces.
//!
//! Takes more than a minute and needs root, `ip` and no other user of these namespaces: it runs
//! only when `WHORL_SLOW_TESTS` is set, and says so when it cannot make namespaces.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests")]

use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

const DOMAIN: &str = "159";
/// Longer than the lease of 50 s and the 2 s between two looks at it.
const CUT: Duration = Duration::from_secs(60);

fn ip(arguments: &str) -> bool {
    Command::new("ip").args(arguments.split_whitespace()).status().is_ok_and(|status| status.success())
}

/// Two hosts on one switch; gone when dropped.
struct Laboratory;

impl Laboratory {
    fn build() -> Option<Self> {
        let made =
            ["whorl_cut_a", "whorl_cut_b", "whorl_cut_sw"].iter().all(|n| ip(&format!("netns add {n}")));
        let laboratory = Self;
        let host = |name: &str, number: u8| {
            let namespace = format!("whorl_cut_{name}");
            ip(&format!(
                "link add wc{name} netns {namespace} type veth peer name wp{name} netns whorl_cut_sw"
            )) && ip(&format!("-n {namespace} link set lo up"))
                && ip(&format!("-n {namespace} addr add 10.78.0.{number}/24 dev wc{name}"))
                && ip(&format!("-n {namespace} link set wc{name} up"))
                && ip(&format!("-n {namespace} route add 239.0.0.0/8 dev wc{name}"))
                && ip(&format!("-n whorl_cut_sw link set wp{name} master br0"))
                && ip(&format!("-n whorl_cut_sw link set wp{name} up"))
        };
        let wired = made
            && ip("-n whorl_cut_sw link add br0 type bridge")
            && ip("-n whorl_cut_sw link set br0 up")
            && host("a", 1)
            && host("b", 2);
        wired.then_some(laboratory)
    }

    /// Takes host b off the switch without its noticing.
    fn cut(&self) {
        assert!(ip("-n whorl_cut_sw link set wpb nomaster"));
    }

    fn join(&self) {
        assert!(ip("-n whorl_cut_sw link set wpb master br0"));
    }

    fn start(&self, host: &str, example: &str, arguments: &[&str]) -> Process {
        let test = std::env::current_exe().unwrap();
        let example = test.parent().unwrap().parent().unwrap().join("examples").join(example);
        let child = Command::new("ip")
            .args(["netns", "exec", &format!("whorl_cut_{host}")])
            .arg(example)
            .args(["--ros-args", "-p", "formation.platforms:=[whorl_1,whorl_2]"])
            .args(arguments)
            .envs([("ROS_DOMAIN_ID", DOMAIN), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")])
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        Process(child)
    }
}

impl Drop for Laboratory {
    fn drop(&mut self) {
        for namespace in ["whorl_cut_a", "whorl_cut_b", "whorl_cut_sw"] {
            ip(&format!("netns del {namespace}"));
        }
    }
}

struct Process(Child);

impl Process {
    /// Ends it and returns its log.
    fn finish(mut self) -> String {
        let mut log = String::new();
        Command::new("kill").args(["-TERM", &self.0.id().to_string()]).status().unwrap();
        std::io::Read::read_to_string(&mut self.0.stderr.take().unwrap(), &mut log).unwrap();
        self.0.wait().unwrap();
        log
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
    }
}

/// The silences that `link_watch` tells of, in seconds.
fn silences_s(log: &str) -> Vec<f64> {
    log.lines()
        .filter_map(|line| line.split_once("answers since now, after ")?.1.split(' ').next()?.parse().ok())
        .collect()
}

#[test]
fn the_formation_rejoins_after_a_cut_and_neighbours_do_not_notice() {
    if std::env::var_os("WHORL_SLOW_TESTS").is_none() {
        eprintln!("not run: WHORL_SLOW_TESTS is not set");
        return;
    }
    let Some(laboratory) = Laboratory::build() else {
        eprintln!("not run: no network namespaces here (root and `ip` are needed)");
        return;
    };
    let echo = laboratory.start("a", "echo_node", &["-r", "__ns:=/whorl_1"]);
    let beside = laboratory.start("a", "link_watch", &["-r", "__node:=beside"]);
    let far = laboratory.start("b", "link_watch", &[]);
    sleep(Duration::from_secs(5));
    let begin = Instant::now();
    laboratory.cut();
    sleep(CUT);
    let cut_s = begin.elapsed().as_secs_f64();
    laboratory.join();
    sleep(Duration::from_secs(10));
    let (far, beside, echo) = (far.finish(), beside.finish(), echo.finish());

    // The first entry is the begin.
    let [_, silence_s] = silences_s(&far)[..] else { panic!("{far}\n{echo}") };
    assert!((0.0..2.0).contains(&(silence_s - cut_s)), "back after {} s:\n{far}", silence_s - cut_s);
    // On the other side of the cut nothing stopped, neither in it nor while endpoints were renewed.
    assert_eq!(silences_s(&beside).len(), 1, "{beside}");
    assert!(echo.contains("endpoints renewed"), "{echo}");
}
