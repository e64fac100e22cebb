//! Whether the computer's clock is that of the others: stamps of different computers are compared.

use super::Check;
use super::machine::Machine;

const NAME: &str = "clock";
/// Clocks that agree so well need no thought \[s\]: a tenth of a sample.
const GOOD_S: f64 = 1e-3;
/// Clocks that differ so much spoil what is computed from two platforms \[s\].
const WRONG_S: f64 = 0.1;
const REMEDY: &str = "platforms and ground need one clock: apt install chrony on all, and in /etc/chrony/chrony.conf of the platforms \
                    `server GROUND iburst minpoll 0 maxpoll 2`, of the ground `local stratum 8` and `allow`; or ptp4l and phc2sys";

/// The clock.
pub(super) fn all(machine: &Machine) -> Vec<Check> {
    let ptp = (machine.run)("pmc", &["-u", "-b", "0", "GET TIME_STATUS_NP"]);
    if let Some(check) = ptp.as_deref().and_then(of_ptp) {
        return vec![check];
    }
    let chrony = (machine.run)("chronyc", &["-c", "tracking"]);
    if let Some(check) = chrony.as_deref().and_then(of_chrony) {
        return vec![check];
    }
    let timedate = (machine.run)("timedatectl", &["show", "--property=NTPSynchronized", "--value"]);
    vec![match timedate.as_deref().map(str::trim) {
        Some("yes") => Check::warning(
            NAME,
            "set by systemd-timesyncd, which keeps it to some milliseconds and does not say how well",
            REMEDY,
        ),
        Some("no") => Check::wrong(NAME, "nothing keeps it right", REMEDY),
        _ => Check::unknown(NAME, "neither ptp4l, chronyd nor systemd can be asked", REMEDY),
    }]
}

/// From `chronyc -c tracking`: one line of 14 fields (chronyc(1)); the fifth is how far the clock is off \[s\], the last the leap
/// status.
pub(super) fn of_chrony(text: &str) -> Option<Check> {
    let fields: Vec<&str> = text.lines().next()?.split(',').collect();
    let [_, source, stratum, _, off, .., leap] = fields.as_slice() else { return None };
    let off_s: f64 = off.parse().ok()?;
    if leap.trim() == "Not synchronised" || *stratum == "0" {
        return Some(Check::wrong(
            NAME,
            "chronyd runs and has no source",
            format!("chronyc sources; {REMEDY}"),
        ));
    }
    Some(judged(off_s, &format!("chrony, {source}")))
}

/// From `pmc 'GET TIME_STATUS_NP'` of linuxptp: `master_offset` is in nanoseconds.
pub(super) fn of_ptp(text: &str) -> Option<Check> {
    let value =
        |key: &str| text.lines().find_map(|line| Some(line.trim().strip_prefix(key)?.trim().to_owned()));
    let off_ns: f64 = value("master_offset")?.parse().ok()?;
    if value("gmPresent")? != "true" {
        let remedy = "start ptp4l on the grandmaster, on the same network";
        return Some(Check::wrong(NAME, "ptp4l runs and sees no grandmaster", remedy));
    }
    Some(judged(off_ns * 1e-9, "PTP"))
}

fn judged(off_s: f64, by: &str) -> Check {
    let found = format!("{:.3} ms off ({by})", off_s.abs() * 1e3);
    if off_s.abs() <= GOOD_S {
        Check::good(NAME, found)
    } else if off_s.abs() <= WRONG_S {
        Check::warning(NAME, found, "wait until it has settled; chronyc makestep sets it at once")
    } else {
        Check::wrong(NAME, found, "chronyc makestep, before anything runs")
    }
}
