//! Folders that apps on phones write.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::{UnitQuaternion, Vector3};

use super::lines::Origin;
use super::new_rig;
use super::next::Next;
use super::questions::Nobody;
use super::tests::{is_taken, line};

/// Rate, specific force and field of a phone that turns about two axes.
fn seen(t: f64) -> [Vector3<f64>; 3] {
    let rate = Vector3::new(0.0, 0.0, 0.5);
    let attitude = UnitQuaternion::from_scaled_axis(Vector3::new(1.2, 0.3, 0.0))
        * UnitQuaternion::from_scaled_axis(rate * t);
    let of = |world: Vector3<f64>| attitude.inverse() * world;
    // A hand trembles, and no axis reads the same number throughout.
    let tremble = Vector3::new((31.0 * t).sin(), (37.0 * t).sin(), (41.0 * t).sin());
    [
        rate + 1e-3 * tremble,
        of(Vector3::new(0.0, 0.0, 9.806_65)) + 1e-2 * tremble,
        of(Vector3::new(0.0, 20.0, -40.0)),
    ]
}

fn write(folder: &Path, name: &str, hz: u32, late_s: f64, value: impl Fn(f64) -> Vector3<f64>) {
    let mut text = "time,seconds_elapsed,z,y,x\n".to_owned();
    for k in 0..20 * hz {
        let t = f64::from(k) / f64::from(hz) + late_s;
        let v = value(t);
        let ns = 1_700_000_000_000_000_000_i64 + (1e9 * t).round() as i64;
        let _ = writeln!(text, "{ns},{t:.9},{:.6},{:.6},{:.6}", v.z, v.y, v.x);
    }
    std::fs::write(folder.join(name), text).unwrap();
}

#[test]
fn files_of_a_phone_are_put_together() {
    let folder = tempfile::tempdir().unwrap();
    let (phone, out) = (folder.path().join("Kitchen 2026-11-26"), folder.path().join("out"));
    std::fs::create_dir(&phone).unwrap();
    write(&phone, "Gyroscope.csv", 100, 0.02, |t| seen(t)[0]);
    write(&phone, "GyroscopeUncalibrated.csv", 100, 0.02, |t| seen(t)[0] + Vector3::repeat(0.1));
    write(&phone, "Accelerometer.csv", 100, 0.023, |_| Vector3::zeros());
    write(&phone, "TotalAcceleration.csv", 100, 0.023, |t| seen(t)[1]);
    write(&phone, "Gravity.csv", 100, 0.023, |t| seen(t)[1]);
    write(&phone, "Magnetometer.csv", 25, 0.05, |t| seen(t)[2]);
    std::fs::write(phone.join("Metadata.csv"), "device name,app\nphone,logger\n").unwrap();
    let made = new_rig(&phone, &out, None, &mut Nobody).unwrap();
    assert_eq!(made.file, out.join("kitchen_2026_11_26.csv"));
    assert_eq!(line(&made, "time: {"), ("time: {column: seconds_elapsed, unit: s}", Origin::Assumed));
    let columns = "columns: [TotalAcceleration_x, TotalAcceleration_y, TotalAcceleration_z]";
    assert!(line(&made, "accelerometer: {").0.contains(columns));
    assert!(
        made.notes[0].starts_with("Gyroscope, Magnetometer, TotalAcceleration were put together in "),
        "{}",
        made.notes[0]
    );
    assert!(made.notes[0].contains("Accelerometer: gravity was taken out"), "{}", made.notes[0]);
    assert_eq!(made.samples, [("gyro", 2000), ("accelerometer", 2000), ("vector", 500)]);
    assert!(matches!(made.next, Next::Estimate(_)), "{:?}", made.next);
    // Each sample keeps its time and its number.
    let recording = is_taken(&made, &made.file);
    let force = &recording.specific_force_b_m_s2;
    assert!((force.time_s[7] - 0.073).abs() < 1e-9, "{}", force.time_s[7]);
    assert!((force.value[1999] - seen(19.99 + 0.023)[1]).norm() < 1e-5);
    // What is there is somebody's.
    let again = new_rig(&phone, &out, None, &mut Nobody).unwrap_err();
    assert!(format!("{again:#}").contains("kitchen_2026_11_26.csv is there already") && made.rig.exists());
}

#[test]
fn a_folder_of_other_tables_is_refused_with_what_would_do() {
    let folder = tempfile::tempdir().unwrap();
    let tables = folder.path().join("tables");
    std::fs::create_dir(&tables).unwrap();
    std::fs::write(tables.join("swing.csv"), "t,yaw_deg\n0.0,1.0\n0.1,2.0\n").unwrap();
    let error = format!("{:#}", new_rig(&tables, folder.path(), None, &mut Nobody).unwrap_err());
    assert!(error.contains("it is no bag") && error.contains("swing.csv"), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}
