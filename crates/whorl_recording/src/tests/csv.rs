//! CSV files of other people.

use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use whorl_bag::{Channel, CsvMap};

use super::whorl_1;
use crate::{
    ImportedCsv, Mounting, RecordingError, RunOrigin, export_csv, platform_parts, read_csv,
    read_csv_beginning, read_run, write_long_csv, write_run,
};

struct Files {
    directory: tempfile::TempDir,
}

impl Files {
    fn new() -> Self {
        Self { directory: tempfile::tempdir().unwrap() }
    }

    fn write(&self, name: &str, content: &str) -> PathBuf {
        let path = self.directory.path().join(name);
        std::fs::write(&path, content).unwrap();
        path
    }

    fn import(&self, map: &str, csv: &str) -> Result<ImportedCsv, RecordingError> {
        let map = self.write("map.yaml", &format!("csv:\n  ros__parameters:\n{map}"));
        let csv = self.write("a.csv", csv);
        let known = whorl_1();
        let map = CsvMap::load_for(&map, &platform_parts(&known))?;
        read_csv(&csv, &map, &known)
    }

    /// The error's text without the folder.
    fn error(&self, map: &str, csv: &str) -> String {
        let text = self.import(map, csv).unwrap_err().to_string();
        text.replace(&format!("{}/", Path::display(self.directory.path())), "")
    }
}

/// Every channel in a unit that is not SI, with axes in another order.
const MAP: &str = "    time: {column: ms, unit: ms}
    gyro: {columns: [gy, -gx, gz], unit: deg/s}
    accelerometer: {columns: [ax, ay, -az], unit: mg}
    vectors:
      lamp: {columns: [lx, ly, lz], reference_world: [0, 2, 0]}
      magnet: {columns: [mx, my, mz], reference_world: [0, 0.6, -0.8]}
    wheel_speed: {columns: [n1, n2, n3], unit: rpm}
    wheel_torque_command: {columns: [u1, u2, u3], unit: mN m}
    jets: {columns: [j1, j2, j3, j4, j5, j6, j7, j8, j9, j10, j11, j12], quantity: duty, unit: \"%\", slot_length_s: 0.1}
    bus_voltage: {column: mv, unit: mV}
    tank_pressure: {column: bar, unit: bar}
    temperature: {column: c, unit: degC}
    true_attitude: {columns: [qw, qx, qy, qz]}
    closed_loop: true
";
const HEADER: &str = "ms,gx,gy,gz,ax,ay,az,lx,ly,lz,mx,my,mz,n1,n2,n3,u1,u2,u3,\
j1,j2,j3,j4,j5,j6,j7,j8,j9,j10,j11,j12,mv,bar,c,qw,qx,qy,qz\n";

fn lines() -> String {
    let mut csv = HEADER.to_owned();
    for i in 0..30 {
        let duty = if (10..20).contains(&i) { "25" } else { "0" };
        let slow = if i % 10 == 0 { "25200,200,20" } else { ",,NaN" };
        csv += &format!(
            "{},90,180,{i},0,0,-1000,0,3,{i},1,0,0,60,-60,0,100,0,-50,{duty},0,0,0,0,0,0,0,0,0,0,0,{slow},1,0,0,0\n",
            5000 + i * 10
        );
    }
    csv
}

#[test]
fn every_channel_arrives_in_si_units_and_body_axes() {
    let pi = std::f64::consts::PI;
    let imported = Files::new().import(MAP, &lines()).unwrap();
    let r = &imported.recording;
    assert_eq!((imported.rows, r.platform.as_str(), r.mounting), (30, "whorl_1", Mounting::OnBearing));
    assert!(r.closed_loop);
    // The first line is the start.
    assert_eq!((r.gyro_b_rad_s.time_s[0], r.gyro_b_rad_s.time_s[29]), (0.0, 0.29));
    assert!((r.gyro_b_rad_s.value[3] - Vector3::new(pi, -pi / 2.0, pi / 60.0)).norm() < 1e-12);
    assert!((r.specific_force_b_m_s2.value[0] - Vector3::new(0.0, 0.0, 9.806_65)).norm() < 1e-12);
    assert_eq!(*r.vectors[0].reference_world, Vector3::y());
    assert_eq!(r.vectors[0].direction_b.value[4], Vector3::new(0.0, 0.6, 0.8));
    // A value that is repeated is no measurement.
    assert_eq!((r.vectors[0].direction_b.len(), r.vectors[1].direction_b.len()), (30, 1));
    for (given, expected) in r.wheel_speed_rad_s.value[0].iter().zip([2.0 * pi, -2.0 * pi, 0.0]) {
        assert!((given - expected).abs() < 1e-12);
    }
    assert_eq!(r.wheel_torque_command_n_m.value[0], [0.1, 0.0, -0.05]);
    // Slot by slot: opens at 0.1 s for a quarter of 0.1 s.
    assert_eq!(r.jet_pulses.len(), 12);
    assert_eq!(r.jet_pulses[0].len(), 1);
    assert!((r.jet_pulses[0][0].on_s - 0.1).abs() < 1e-9 && (r.jet_pulses[0][0].off_s - 0.125).abs() < 1e-9);
    assert!(r.jet_pulses[1].is_empty());
    assert_eq!((r.bus_voltage_v.len(), r.bus_voltage_v.value[0]), (3, 25.2));
    assert!((r.tank_pressure_pa.value[2] - 2e7).abs() < 1e-6);
    assert!((r.temperature_k.value[0] - 293.15).abs() < 1e-12);
    assert_eq!(r.truth.as_ref().unwrap().q_world_body.len(), 30);
}

/// A file of which only the beginning fits into memory becomes the same run.
#[test]
fn a_long_file_is_written_line_by_line() {
    let files = Files::new();
    let gyro_without_x = MAP.replace("[gy, -gx, gz]", "[~, -gx, gz]");
    let turning = MAP.replace("lz], reference_world: [0, 2, 0]}", "lz], reference_columns: [mx, my, mz]}");
    for map in [MAP, &gyro_without_x, &turning] {
        // A line without gyro and accelerometer among them, and one that lacks an axis.
        let csv = lines().replace("5150,90,180,15,0,0,-1000", "5150,,,,,,").replace("5160,90,", "5160,,");
        let whole = files.import(map, &csv).unwrap();
        let path = files.directory.path().join("a.csv");
        let known = whorl_1();
        let map =
            CsvMap::load_for(&files.directory.path().join("map.yaml"), &platform_parts(&known)).unwrap();
        let beginning = read_csv_beginning(&path, &map, &known, 7).unwrap();
        assert!(whole.is_whole && !beginning.is_whole);
        assert_eq!((beginning.rows, beginning.recording.gyro_b_rad_s.len()), (30, 7));
        assert_eq!((beginning.duration_s, &beginning.channels), (0.29, &whole.channels));
        assert_eq!(beginning.recording.jet_pulses, whole.recording.jet_pulses);
        let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        let [one, other] = folders.each_ref().map(|folder| folder.path().join("run"));
        let origin = RunOrigin::default();
        write_run(&whole.recording, &known, &origin, &one).unwrap();
        write_long_csv(&path, &map, &beginning, &known, &origin, &other).unwrap();
        let read = |path| read_run(path, None).unwrap().remove(0);
        assert_eq!(read(&one), read(&other));
        let count = |path| whorl_bag::BagReader::open(path).unwrap().message_count();
        assert_eq!(count(&one.join("bag")), count(&other.join("bag")));
    }
}

/// A magnetometer in orbit: what it sees turns, and a recording holds one direction of each sensor.
#[test]
fn a_sensor_whose_direction_turns_is_left_out_aloud() {
    let map = MAP.replace("lz], reference_world: [0, 2, 0]}", "lz], reference_columns: [mx, my, mz]}");
    let imported = Files::new().import(&map, &lines()).unwrap();
    let r = &imported.recording;
    assert_eq!(r.vectors.len(), 1);
    assert!((*r.vectors[0].reference_world - Vector3::new(0.0, 0.6, -0.8)).norm() < 1e-12);
    let told = r.remarks.iter().any(|remark| remark.contains("Vector sensor 1 is left out"));
    assert!(told, "{:?}", r.remarks);
}

#[test]
fn wrong_files_and_maps_are_refused_with_file_line_and_what_is_allowed() {
    let files = Files::new();
    let csv = lines();
    let table = [
        (
            MAP.replace("unit: rpm", "unit: rps"),
            csv.clone(),
            "map.yaml:9: wheel_speed.unit = rps: allowed: one of rad/s, rpm, rev/s, deg/s (unit of these columns); did you mean rpm?",
        ),
        (
            MAP.replace("[n1, n2, n3]", "[n1, n2]"),
            csv.clone(),
            "map.yaml:9: wheel_speed.columns = [n1, n2]: 2 names, but whorl_1 has 3 wheels; allowed: one column for each of wheel_x, wheel_y, wheel_z, in this order",
        ),
        (
            MAP.replace("wheel_speed:", "wheel_sped:"),
            csv.clone(),
            "map.yaml:9: wheel_sped: is no channel; allowed: time, gyro, accelerometer, vector, vectors, wheel_speed, wheel_torque_command, wheel_current, gimbal_angle, gimbal_rate, gimbal_torque, jets, body_torque, ballast_moment, bus_voltage, tank_pressure, temperature, true_attitude, true_rate, wheel_angle, hinge_angle, closed_loop, mounting, jets_off, imu_latency_s, delimiter, decimal",
        ),
        (
            MAP.replace("u2", "torque_2"),
            csv.clone(),
            "a.csv:1: there is no column `torque_2`; there are: ms, gx, gy, gz, ax, ay, az, lx, ly, lz, mx, my, mz, n1, n2, n3, u1, u2, u3, j1, j2, j3, j4, j5, j6, j7, j8, j9, j10, j11, j12, mv, bar, c, qw, qx, qy, qz",
        ),
        (
            MAP.replace(", unit: \"%\"", ""),
            csv.clone(),
            "a.csv:12: column `j1`: 25 is refused; allowed: a share of the slot, from 0 to 1 (0 to 100 with unit: \"%\")",
        ),
        (
            MAP.replace("duty, unit: \"%\"", "on_time, unit: s"),
            csv.clone(),
            "a.csv:12: column `j1`: 25 is refused; allowed: an on-time from 0 to the slot's length, 0.1 s; is the unit right?",
        ),
        (
            MAP.to_owned(),
            csv.replace("\n5060,", "\n5050,"),
            "a.csv:8: column `ms`: time 5.05 s does not come after 5.05 s; where several lines have one time, \
         `duplicates` of the map's time says which counts: first, mean, or burst: \
         measured one after the other since the time before",
        ),
        (
            MAP.to_owned(),
            csv.replace("\n5060,", "\n5020,"),
            "a.csv:8: column `ms`: time 5.02 s does not come after 5.05 s",
        ),
        (MAP.to_owned(), HEADER.to_owned(), "a.csv: there are no measurements: no line of numbers"),
        (
            "    time: {column: ms}\n    temperature: {column: c, unit: degC}\n".to_owned(),
            csv.clone(),
            "/csv: gyro: nothing that moves is named; allowed: one of gyro, accelerometer, wheel_speed",
        ),
        (
            "    time: {column: ms, unit: s}\n    gyro: {columns: [gx, gy, gz]}\n    jets: {columns: [j1, j2, j3, j4, j5, j6, j7, j8, j9, j10, j11, j12], quantity: on_time, unit: ms, slot_length_s: 0.1}\n".to_owned(),
            csv.replace("\n5290,", "\n20000000,"),
            "a.csv: from the first to the last line it is 19995000 s: is the time column's unit right?",
        ),
        (
            MAP.replace(", reference_world: [0, 0.6, -0.8]", ""),
            csv.clone(),
            "a.csv: vector sensor 2: the direction that it sees in the world is not known: give reference_world in the map",
        ),
    ];
    for (map, csv, expected) in table {
        assert_eq!(files.error(&map, &csv), expected);
    }
}

#[test]
fn nan_everywhere_is_an_error_and_in_one_channel_a_remark() {
    let files = Files::new();
    let map =
        "    time: {column: t}\n    gyro: {columns: [x, y, z]}\n    wheel_speed: {columns: [a, b, c]}\n";
    let line = |i: i32, rest: &str| format!("{i},{rest}\n");
    let all: String = (0..5).map(|i| line(i, "nan,NaN,,,nan,nan")).collect();
    assert_eq!(
        files.error(map, &format!("t,x,y,z,a,b,c\n{all}")),
        "a.csv: 5 lines, and not one has a number in every column of gyro, accelerometer or wheel_speed: is the map that of this file?"
    );
    let one: String = (0..400).map(|i| line(i, &format!("nan,nan,nan,1,2,{i}"))).collect();
    let imported = files.import(map, &format!("t,x,y,z,a,b,c\n{one}")).unwrap();
    assert_eq!(
        imported.recording.remarks,
        ["The map names columns for gyro, and no line has numbers in all of them: the channel is missing."]
    );
    let costs = imported.recording.missing_channels(&whorl_1().model);
    assert!(costs.iter().any(|cost| cost.starts_with("No gyro: ")), "{costs:?}");
    assert!(!costs.iter().any(|cost| cost.starts_with("No wheel speed")), "{costs:?}");
}

#[test]
fn columns_that_the_map_does_not_name_are_told() {
    let map = "    time: {column: t}\n    gyro: {columns: [x, -y, z]}\n";
    let lines: String = (0..25).map(|i| format!("{i},1,2,{i},4,5\n")).collect();
    let imported = Files::new().import(map, &format!("t,x,y,z,ballast,note\n{lines}")).unwrap();
    assert_eq!(imported.ignored, ["ballast", "note"]);
}

#[test]
fn what_looks_wrong_is_said() {
    let files = Files::new();
    let map = "    time: {column: t}\n    gyro: {columns: [x, y, z]}\n    accelerometer: {columns: [a, b, c]}\n    wheel_speed: {columns: [n, n2, n3]}\n";
    let lines: String =
        (0..20).map(|i| format!("0.{i:02},{i},0.5,0.{i},0.0,0.01,0.99{i},3000,{i},0\n")).collect();
    let remarks = files.import(map, &format!("t,x,y,z,a,b,c,n,n2,n3\n{lines}")).unwrap().recording.remarks;
    for start in [
        "The run has 20 readings in 0.2 s: too few",
        "The gyro reads the same number in all 20 samples (y)",
        "The accelerometer reads the same number in all 20 samples (x, y)",
        "The accelerometer's mean length is 0.993 m/s^2 instead of 9.8: its unit looks like g.",
        "The gyro reads up to 19.000 rad/s and its range is 1.309 rad/s: is the unit deg/s?",
        "wheel_x reads up to 3000 rad/s and its limit is 314 rad/s: is the unit rpm?",
    ] {
        assert!(remarks.iter().any(|remark| remark.starts_with(start)), "{start}: {remarks:#?}");
    }
}

#[test]
fn a_bench_test_needs_no_gyro() {
    let map = "    time: {column: t, unit: us}\n    wheel_speed: {columns: [a, b, c]}\n    wheel_torque_command: {columns: [u, v, w]}\n    mounting: clamped\n";
    let lines: String = (0..2000).map(|i| format!("{},{i},0,0,0.1,0,0\n", i * 10_000)).collect();
    let recording = Files::new().import(map, &format!("t,a,b,c,u,v,w\n{lines}")).unwrap().recording;
    assert_eq!((recording.mounting, recording.duration_s()), (Mounting::Clamped, 19.99));
    let costs = recording.missing_channels(&whorl_1().model);
    assert_eq!(costs.len(), 2, "bus voltage and temperature: {costs:?}");
    // A platform without wheels misses none of their channels.
    let mut bare = whorl_1().model;
    bare.wheels_mut().clear();
    bare.jets_mut().clear();
    let costs = recording.missing_channels(&bare);
    assert!(costs.iter().all(|cost| cost.starts_with("No temperature")), "{costs:?}");
}

#[test]
fn motor_currents_come_in_by_their_map_and_go_out_as_they_are() {
    let map = "    time: {column: t}
    wheel_speed: {columns: [n1, n2, n3]}
    wheel_current: {columns: [i1, -i2, i3], unit: mA}
";
    let csv = "t,n1,n2,n3,i1,i2,i3\n0,1,2,3,250,-40,0\n0.01,1,2,3,,,\n0.02,1,2,3,125.5,0,-3000\n";
    let files = Files::new();
    let imported = files.import(map, csv).unwrap();
    assert_eq!(imported.ignored, Vec::<String>::new());
    let current = &imported.recording.wheel_current_a;
    assert_eq!(current.time_s, [0.0, 0.02]);
    assert_eq!(current.value, [[0.25, 0.04, 0.0], [0.1255, 0.0, -3.0]]);
    // Out and in again, in amperes and by the wheels' names.
    let known = whorl_1();
    let parts = platform_parts(&known);
    let out = files.directory.path().join("out");
    let exported = export_csv(&imported.recording, &parts.wheels, &parts.jets, &out).unwrap();
    let text = std::fs::read_to_string(&exported.csv).unwrap();
    assert!(text.contains("wheel_x_a,wheel_y_a,wheel_z_a"), "{text}");
    let again = read_csv(&exported.csv, &CsvMap::load_for(&exported.map, &parts).unwrap(), &known).unwrap();
    assert_eq!(again.recording.wheel_current_a, *current);
    // Two columns for three wheels.
    assert_eq!(
        files.error(&map.replace("[i1, -i2, i3]", "[i1, i2]"), csv),
        "map.yaml:5: wheel_current.columns = [i1, i2]: 2 names, but whorl_1 has 3 wheels; allowed: one column for \
         each of wheel_x, wheel_y, wheel_z, in this order"
    );
}

#[test]
fn the_example_in_params_maps_every_channel() {
    let known = whorl_1();
    let path = super::parameters().join("channels/whorl.yaml");
    let map = CsvMap::load_for(&path, &platform_parts(&known)).unwrap();
    assert_eq!((map.vectors.len(), map.jets.as_ref().unwrap().columns.len()), (2, 12));
    let slow = [Channel::WheelCurrent, Channel::BusVoltage, Channel::TankPressure, Channel::Temperature];
    assert!(slow.into_iter().all(|channel| map.has(channel)));
}

proptest::proptest! {
    /// Whatever is in the cells: an error or a recording, never a panic.
    #[test]
    fn any_text_is_survived(text in "[-0-9,.e\n\"nai]{0,300}") {
        let _ = Files::new().import(MAP, &format!("{HEADER}{text}"));
        let narrow = "    time: {column: t}\n    wheel_speed: {columns: [a, b, c]}\n    jets: {columns: [a, b, c, a, b, c, a, b, c, a, b, c], quantity: on_time, slot_length_s: 0.5}\n";
        let _ = Files::new().import(narrow, &format!("t,a,b,c\n{text}"));
    }
}

/// A gyro with one axis: in by its map, out to CSV and to a bag, and back.
#[test]
fn a_gyro_may_lack_axes() {
    let map = "    time: {column: t}\n    gyro: {columns: [~, ~, -g], unit: deg/s}\n    wheel_speed: {columns: [a, b, c]}\n";
    let lines: String = (0..50).map(|i| format!("0.{i:02},{},{i},0,0\n", i % 7)).collect();
    let (files, known) = (Files::new(), whorl_1());
    let recording = files.import(map, &format!("t,g,a,b,c\n{lines}")).unwrap().recording;
    assert_eq!(recording.gyro_axes(), [false, false, true]);
    assert!((recording.gyro_b_rad_s.value[6] - Vector3::z() * -6.0_f64.to_radians()).norm() < 1e-15);
    let frozen = recording.remarks.iter().any(|remark| remark.starts_with("The gyro reads the same"));
    assert!(!frozen, "{:?}", recording.remarks);
    // On a bearing one axis says nothing of the motion, on a shaft along it everything.
    let says_so = |model: &whorl_dynamics::PlatformModel| {
        recording.missing_channels(model).iter().any(|cost| cost.starts_with("No gyro axis x, y"))
    };
    let mut hinge = known.model.clone();
    hinge.freedom = whorl_dynamics::Freedom::Hinge { axis_b: Vector3::z_axis() };
    assert!(says_so(&known.model) && !says_so(&hinge));

    let parts = platform_parts(&known);
    let out = files.directory.path().join("out");
    let exported = export_csv(&recording, &parts.wheels, &parts.jets, &out).unwrap();
    let text = std::fs::read_to_string(&exported.csv).unwrap();
    assert!(text.starts_with("time_s,gyro_z_rad_s,wheel_x_rad_s"), "{text}");
    let again = read_csv(&exported.csv, &CsvMap::load_for(&exported.map, &parts).unwrap(), &known).unwrap();
    assert_eq!(again.recording.gyro_axes(), [false, false, true]);
    assert_eq!(again.recording.gyro_b_rad_s, recording.gyro_b_rad_s);
    let run = files.directory.path().join("run");
    write_run(&recording, &known, &RunOrigin::default(), &run).unwrap();
    let read = read_run(&run, None).unwrap().remove(0);
    assert_eq!((read.gyro_axes(), &read.gyro_b_rad_s), ([false, false, true], &recording.gyro_b_rad_s));

    let table = format!("t,g,a,b,c\n{lines}");
    for (wrong, expected) in [
        ("[~, ~, ~]", "has no value"),
        ("['~', '~', '~']", "~ stands for an axis that is not measured, and here at least one must be"),
        (
            "[~, ~, g]}\n    true_rate: {columns: [a, ~, c]",
            "~ stands for an axis that is not measured, and here all three must be",
        ),
    ] {
        let error = files.error(&map.replace("[~, ~, -g]", wrong).replace(", unit: deg/s", ""), &table);
        assert!(error.contains(expected), "{error}");
    }
}

/// An accelerometer with x and z: in by its map, out to CSV and to a bag, and back; its absent axis is never a zero in a file.
#[test]
fn an_accelerometer_may_lack_axes() {
    let map = "    time: {column: t}\n    gyro: {columns: [a, b, c]}\n    accelerometer: {columns: [-f, ~, g], unit: g}\n";
    let lines: String =
        (0..50).map(|i| format!("0.{i:02},0.{i},0.1{i},-0.{i},0.0{},1.00{}\n", i % 7, i % 5)).collect();
    let (files, known) = (Files::new(), whorl_1());
    let recording = files.import(map, &format!("t,a,b,c,f,g\n{lines}")).unwrap().recording;
    assert_eq!((recording.force_axes(), recording.gyro_axes()), ([true, false, true], [true; 3]));
    let third = recording.specific_force_b_m_s2.value[3];
    assert!((third - Vector3::new(-0.03, 0.0, 1.003) * 9.806_65).norm() < 1e-12, "{third}");
    assert!(
        recording.remarks.iter().all(|remark| !remark.contains("accelerometer")),
        "{:?}",
        recording.remarks
    );
    let said = recording.missing_channels(&known.model);
    assert!(
        said.iter().any(|cost| cost.starts_with("No accelerometer axis y: what x, z shows is used")),
        "{said:?}"
    );

    let parts = platform_parts(&known);
    let out = files.directory.path().join("out");
    let exported = export_csv(&recording, &parts.wheels, &parts.jets, &out).unwrap();
    let text = std::fs::read_to_string(&exported.csv).unwrap();
    assert!(text.contains("force_x_m_s2,force_z_m_s2") && !text.contains("force_y"), "{text}");
    let again = read_csv(&exported.csv, &CsvMap::load_for(&exported.map, &parts).unwrap(), &known).unwrap();
    let run = files.directory.path().join("run");
    write_run(&recording, &known, &RunOrigin::default(), &run).unwrap();
    for read in [again.recording, read_run(&run, None).unwrap().remove(0)] {
        assert_eq!(read.force_axes(), [true, false, true]);
        assert_eq!(read.specific_force_b_m_s2, recording.specific_force_b_m_s2);
    }
}
