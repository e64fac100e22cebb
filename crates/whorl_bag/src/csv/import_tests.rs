use std::io::Write;
use std::path::{Path, PathBuf};

use nalgebra::{UnitQuaternion, Vector3};
use whorl_msgs::whorl::AttitudeEstimate;
use whorl_msgs::{Message, Topic};
use whorl_node::Timestamp;

use super::*;

const MAP: &str = "csv:
  ros__parameters:
    time: {column: t}
    gyro: {columns: [gx, gy, gz], unit: deg/s}
    accelerometer: {columns: [ax, ay, az], unit: g}
    vector: {columns: [mx, my, -mz]}
    true_attitude: {columns: [qw, qx, qy, qz], scored: movement}
";
const HEADER: &str = "t,gx,gy,gz,ax,ay,az,mx,my,mz,qw,qx,qy,qz,movement\n";

struct Files {
    directory: tempfile::TempDir,
}

impl Files {
    fn new() -> Self {
        Self { directory: tempfile::tempdir().unwrap() }
    }

    fn write(&self, name: &str, content: &[u8]) -> PathBuf {
        let path = self.directory.path().join(name);
        std::fs::write(&path, content).unwrap();
        path
    }

    fn map(&self, text: &str) -> CsvMap {
        CsvMap::load(&self.write("map.yaml", text.as_bytes())).unwrap()
    }

    fn open(&self, map: &str, csv: &str) -> Result<CsvRecording, CsvError> {
        CsvRecording::open(&self.write("a.csv", csv.as_bytes()), &self.map(map))
    }
}

fn samples(recording: &CsvRecording) -> Vec<Measurement> {
    recording.samples("whorl_1", Timestamp(5_000_000_000)).unwrap().map(Result::unwrap).collect()
}

fn short(path: &Path, error: impl std::fmt::Display) -> String {
    error.to_string().replace(&format!("{}/", path.parent().unwrap().display()), "")
}

#[test]
fn units_signs_and_gaps_are_as_the_map_says() {
    let files = Files::new();
    let csv = format!(
        "{HEADER}10.0,180,0,-90,0,0,1,3,0,4,1,0,0,0,1\n10.5,1,,2,0,0,1,3,0,4,,,,,0\n11.25,1,2,3,0,0,1,0,5,0,0,0,0,-2,0\n"
    );
    let recording = files.open(MAP, &csv).unwrap();
    assert_eq!((recording.rows(), recording.duration_s()), (3, 1.25));
    let samples = samples(&recording);
    // The second line has an incomplete gyro, a repeated vector, and no truth.
    let topics: Vec<_> = samples.iter().map(|s| (s.stamp.0 / 1_000_000, s.topic)).collect();
    let line = |ms: i64| [(ms, Topic::ImuRaw), (ms, Topic::VectorDirection), (ms, Topic::TruthState)];
    assert_eq!(topics, [line(5_000), line(6_250)].concat());
    let Message::Imu(imu) = &samples[0].message else { panic!() };
    assert_eq!(imu.angular_velocity.x, std::f64::consts::PI);
    assert_eq!(imu.angular_velocity.z, -std::f64::consts::FRAC_PI_2);
    assert_eq!(imu.linear_acceleration.z, 9.806_65);
    assert_eq!((imu.orientation_covariance[0], imu.header.frame_id.as_str()), (-1.0, "whorl_1/base_link"));
    let Message::Vector3Stamped(vector) = &samples[1].message else { panic!() };
    assert_eq!((vector.vector.x, vector.vector.z), (0.6, -0.8));
    let truth = |i: usize| match &samples[i].message {
        Message::AttitudeEstimate(truth) => truth.clone(),
        _ => panic!(),
    };
    assert_eq!((truth(2).sequence, truth(2).health), (0, AttitudeEstimate::HEALTH_OK));
    assert_eq!((truth(5).sequence, truth(5).health), (1, AttitudeEstimate::HEALTH_DEGRADED));
    assert_eq!(truth(5).q_world_body.z, -1.0);
    assert!(truth(2).omega_wb_b_rad_s.x.is_nan());
}

#[test]
fn a_quaternion_the_other_way_round_is_inverted() {
    let files = Files::new();
    let map = MAP.replace("scored: movement", "rotation: world_to_body");
    let recording = files.open(&map, &format!("{HEADER}0,0,0,0,0,0,1,1,0,0,0.5,0.5,0.5,0.5,1\n")).unwrap();
    let Message::AttitudeEstimate(truth) = &samples(&recording)[2].message else { panic!() };
    assert_eq!((truth.q_world_body.w, truth.q_world_body.x), (0.5, -0.5));
}

/// 2 s at 10 Hz: moving in the first second, then still at `q_world_body`.
fn recording_at(files: &Files, q: UnitQuaternion<f64>, reference: Vector3<f64>, truth: bool) -> CsvRecording {
    let mut csv = HEADER.to_owned();
    for i in 0..25 {
        let moving = i < 10;
        let force = q.inverse() * Vector3::z();
        let vector = q.inverse() * reference * 40.0;
        let rate = if moving { 50.0 } else { 0.5 };
        let q = if truth { format!("{},{},{},{}", q.w, q.i, q.j, q.k) } else { ",,,".into() };
        let vector = if moving { Vector3::new(1.0, 2.0, 3.0) } else { vector };
        csv += &format!(
            "{},{rate},0,0,{},{},{},{},{},{},{q},1\n",
            f64::from(i) * 0.1,
            force.x,
            force.y,
            force.z,
            vector.x,
            vector.y,
            -vector.z
        );
    }
    files.open(MAP, &csv).unwrap()
}

#[test]
fn the_reference_direction_is_found_in_the_first_still_second() {
    let files = Files::new();
    let q = UnitQuaternion::from_euler_angles(0.3, -0.4, 1.2);
    let reference = Vector3::new(0.1, 0.5, -0.8).try_normalize(0.0).unwrap();
    let with_truth = recording_at(&files, q, reference, true).vector_reference_world().unwrap();
    assert!((with_truth.into_inner() - reference).norm() < 1e-12);
    // Without truth the angle to the vertical is found; its horizontal part is north.
    let without = recording_at(&files, q, reference, false).vector_reference_world().unwrap();
    let expected = Vector3::new(0.0, reference.xy().norm(), reference.z);
    assert!((without.into_inner() - expected).norm() < 1e-12);
    let given = MAP.replace("-mz]", "-mz], reference_world: [0, 3, 4]");
    let recording = files.open(&given, &format!("{HEADER}0,0,0,0,0,0,1,1,0,0,1,0,0,0,1\n")).unwrap();
    assert_eq!(recording.vector_reference_world().unwrap().z, 0.8);
    let nothing = files.open(MAP, &format!("{HEADER}0,0,0,0,0,0,1,,,,1,0,0,0,1\n"));
    assert!(matches!(nothing, Err(CsvError::NoReference { .. })));
}

#[test]
fn gzip_is_read_and_a_cut_one_is_an_error_with_its_line() {
    let files = Files::new();
    let mut csv = HEADER.to_owned();
    for i in 0..5_000 {
        csv += &format!("{i},{},0,0,0,0,1,{i},1,0,1,0,0,0,1\n", (f64::from(i) * 1.7).sin());
    }
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(csv.as_bytes()).unwrap();
    let bytes = encoder.finish().unwrap();
    let map = files.map(MAP);
    let path = files.write("a.csv.gz", &bytes);
    assert_eq!(CsvRecording::open(&path, &map).unwrap().rows(), 5_000);
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let Err(CsvError::Format { line, .. }) = CsvRecording::open(&path, &map) else { panic!() };
    assert!((1_000..5_000).contains(&line), "{line}");
}

#[test]
fn errors_name_file_line_and_column() {
    let files = Files::new();
    let line = "0,0,0,0,0,0,1,1,0,0,1,0,0,0,1\n";
    let path = files.write("a.csv", b"");
    let error = |csv: &str| short(&path, files.open(MAP, csv).unwrap_err());
    assert_eq!(
        error(&format!("{}{line}", HEADER.replace("az", "acc_z"))),
        "a.csv:1: there is no column `az`; there are: t, gx, gy, gz, ax, ay, acc_z, mx, my, mz, qw, qx, qy, qz, movement"
    );
    assert_eq!(
        error(&format!("{HEADER}{line}\n1,0,zero,0,0,0,1,1,0,0,1,0,0,0,1\n")),
        "a.csv:4: column `gy`: `zero` is not a number"
    );
    assert_eq!(
        error(&format!("{HEADER}{line}1,inf,0,0,0,0,1,1,0,0,1,0,0,0,1\n")),
        "a.csv:3: column `gx`: `inf` is not a number"
    );
    assert_eq!(
        error(&format!("{HEADER}{line}{line}")),
        "a.csv:3: column `t`: time 0 s does not come after 0 s; where several lines have one time, `duplicates` of the map's time says which counts: first, mean, or burst: \
         measured one after the other since the time before"
    );
    assert_eq!(error(&format!("{HEADER}{line}1,2\n")), "a.csv:3: 2 cells, but the header has 15");
    assert_eq!(error(HEADER), "a.csv: there are no measurements: no line of numbers");
    assert_eq!(
        error(&format!("{HEADER},{}", &line[2..])),
        "a.csv:2: column `t`: an empty cell is not a number"
    );
}

#[test]
fn the_map_in_params_is_good() {
    let params = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params/channels/broad.yaml");
    let map = CsvMap::load(&params).unwrap();
    assert_eq!(map.true_attitude.unwrap().scored_column.as_deref(), Some("movement"));
    assert_eq!((map.channels[&Channel::Gyro].factor, map.vectors[0].reference_world), (1.0, None));
}

#[test]
fn a_wrong_map_is_refused_with_its_line() {
    let files = Files::new();
    let error = |map: &str| {
        let path = files.write("map.yaml", map.as_bytes());
        short(&path, CsvMap::load(&path).unwrap_err())
    };
    let unit = error(&MAP.replace("unit: g", "unit: furlong"));
    assert!(unit.starts_with("map.yaml:5: accelerometer.unit") && unit.contains("m/s^2"), "{unit}");
    let two = error(&MAP.replace("[gx, gy, gz]", "[gx, gy]"));
    assert!(two.starts_with("map.yaml:4: gyro.columns") && two.contains("2 names"), "{two}");
    let unknown = error(&MAP.replace("scored", "score"));
    assert!(unknown.contains("did you mean true_attitude.scored?"), "{unknown}");
    assert!(error("csw:\n  ros__parameters: {}\n").contains("csv"));
}

proptest::proptest! {
    /// Whatever is in the cells: an error or measurements, never a panic.
    #[test]
    fn any_text_is_survived(text in "[-0-9,.e\n\"nai]{0,300}") {
        let files = Files::new();
        if let Ok(recording) = files.open(MAP, &format!("{HEADER}{text}")) {
            assert!(recording.samples("p", Timestamp(0)).unwrap().all(|s| s.is_ok()));
        }
    }
}
