//! Checks against texts that the programs print, and files as the kernel has them.

use super::machine::Machine;
use super::{Verdict, clock, computer, devices, network};

fn machine(folder: &std::path::Path) -> Machine {
    Machine { root: folder.to_owned(), run: |_, _| None }
}

#[test]
fn clocks_are_judged_by_what_chrony_and_ptp_say() {
    // chronyc -c tracking of chrony 4.5.
    let line = |off: &str, leap: &str| {
        format!(
            "C0A84D01,192.168.77.1,9,1732330000.123456789,{off},-0.000000412,0.000011254,12.114,-0.001,0.034,0.000212,0.000871,2.1,{leap}\n"
        )
    };
    let good = clock::of_chrony(&line("-0.000023511", "Normal")).unwrap();
    assert_eq!(good.verdict, Verdict::Good);
    assert!(good.found.contains("0.024 ms off") && good.found.contains("192.168.77.1"), "{good:?}");
    assert_eq!(clock::of_chrony(&line("0.02", "Normal")).unwrap().verdict, Verdict::Warning);
    assert_eq!(clock::of_chrony(&line("-3.2", "Normal")).unwrap().verdict, Verdict::Wrong);
    let none = "7F7F0101,,0,0.000000000,0.000000000,0.0,0.0,0.0,0.0,0.0,1.0,1.0,0.0,Not synchronised";
    assert_eq!(clock::of_chrony(none).unwrap().verdict, Verdict::Wrong);
    assert_eq!(clock::of_chrony("506 Cannot talk to daemon"), None);
    // pmc of linuxptp 4.
    let ptp = |present: &str| {
        format!(
            "sending: GET TIME_STATUS_NP\n\tfeedab.fffe.cdef01-0 seq 0 RESPONSE MANAGEMENT TIME_STATUS_NP\n\t\tmaster_offset              -42\n\t\tingress_time               1732330000000000000\n\t\tgmPresent                  {present}\n"
        )
    };
    assert!(clock::of_ptp(&ptp("true")).unwrap().found.starts_with("0.000 ms off"));
    assert_eq!(clock::of_ptp(&ptp("false")).unwrap().verdict, Verdict::Wrong);
    assert_eq!(clock::of_ptp("sending: GET TIME_STATUS_NP"), None);
    // Nobody to ask is not the same as right.
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(clock::all(&machine(folder.path()))[0].verdict, Verdict::Unknown);
}

#[test]
fn the_computer_is_judged_by_its_files() {
    let folder = tempfile::tempdir().unwrap();
    let write = |path: &str, text: &str| {
        let path = folder.path().join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    };
    let machine = machine(folder.path());
    assert_eq!(computer::temperature(&machine).verdict, Verdict::Unknown);
    write("sys/class/thermal/thermal_zone0/temp", "41000\n");
    write("sys/class/thermal/thermal_zone0/type", "soc\n");
    assert_eq!(computer::temperature(&machine).found, "41 deg C (soc)");
    write("sys/class/thermal/thermal_zone1/temp", "86500\n");
    assert_eq!(computer::temperature(&machine).verdict, Verdict::Warning);

    assert_eq!(computer::governor(&machine).verdict, Verdict::Good);
    write("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "performance\n");
    write("sys/devices/system/cpu/cpu1/cpufreq/scaling_governor", "powersave\n");
    assert!(computer::governor(&machine).found.contains("1 processors have the governor powersave"));

    write("proc/sys/net/core/rmem_max", "212992\n");
    assert!(network::buffer(&machine).found.contains("208 kB"));
    write("proc/sys/net/core/rmem_max", "4194304\n");
    assert_eq!(network::buffer(&machine).verdict, Verdict::Good);

    write("proc/loadavg", "999.00 1.0 1.0 1/100 1\n");
    assert_eq!(computer::load(&machine).unwrap().verdict, Verdict::Warning);

    assert_eq!(
        computer::memory("MemTotal: 8000000 kB\nMemAvailable:  300000 kB\n").verdict,
        Verdict::Warning
    );
    assert_eq!(computer::memory("MemAvailable:  3000000 kB\n").found, "3.0 GB available");
    assert_eq!(computer::memory("").verdict, Verdict::Unknown);

    let limits = "Limit                     Soft Limit           Hard Limit           Units     \n\
                  Max realtime priority     0                    0                    \n";
    assert_eq!(computer::limits(limits).verdict, Verdict::Warning);
    assert_eq!(computer::limits(&limits.replacen("0 ", "80", 1)).found, "priorities up to 80");
    assert_eq!(computer::judged_wake_ups(8e-5, 4e-4).verdict, Verdict::Good);
    assert_eq!(computer::judged_wake_ups(8e-5, 0.02).verdict, Verdict::Warning);
    assert_eq!(computer::judged_wake_ups(0.015, 0.02).verdict, Verdict::Wrong);
}

#[test]
fn files_say_what_is_wrong_with_them() {
    let folder = tempfile::tempdir().unwrap();
    let port = folder.path().join("imu");
    assert!(devices::file("device imu", &port).found.contains("is not there"));
    std::fs::write(&port, "").unwrap();
    assert_eq!(devices::file("device imu", &port).verdict, Verdict::Good);
    let disk = computer::disk(&folder.path().join("runs/of/today"));
    assert!(disk.found.contains("GB free"), "{disk:?}");
}
