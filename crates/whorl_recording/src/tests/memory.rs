//! What reading a run of some length costs in memory.

use nalgebra::Vector3;

use super::whorl_1;
use crate::{Recording, RunOrigin, Series, read_run, write_run};

/// Bytes for each further sample of gyro, accelerometer, wheel speeds and torques: those of the recording that is read (192),
/// and what is still gathered when most of them are filled. Where each sample was a list of its own it was 256.
const MOST_PER_SAMPLE: f64 = 236.0;

#[test]
fn a_long_run_is_read_into_little_more_than_its_recording() {
    let known = whorl_1();
    let directory = tempfile::tempdir().unwrap();
    let peak = |samples: u32| {
        let time_s: Vec<f64> = (0..samples).map(|k| f64::from(k) * 0.01).collect();
        let axes = |scale: f64| Series {
            time_s: time_s.clone(),
            value: (0..samples).map(|k| Vector3::repeat(scale * f64::from(k % 97))).collect(),
        };
        let wheels = |scale: f64| Series {
            time_s: time_s.clone(),
            value: (0..samples).map(|k| vec![scale * f64::from(k % 89); 3]).collect(),
        };
        let recording = Recording {
            platform: known.platform.clone(),
            gyro_b_rad_s: axes(1e-3),
            specific_force_b_m_s2: axes(1e-1),
            wheel_speed_rad_s: wheels(1.0),
            wheel_torque_command_n_m: wheels(1e-4),
            ..Recording::default()
        };
        let path = directory.path().join(samples.to_string());
        write_run(&recording, &known, &RunOrigin::default(), &path).unwrap();
        drop(recording);
        let counted = allocation_counter::measure(|| {
            assert_eq!(read_run(&path, None).unwrap()[0].gyro_b_rad_s.len(), samples as usize);
        });
        counted.bytes_max as f64
    };
    // Powers of two, so that lists that double are as full in both.
    let (short, long) = (8192, 32_768);
    let per_sample = (peak(long) - peak(short)) / f64::from(long - short);
    assert!(per_sample < MOST_PER_SAMPLE, "{per_sample:.0} bytes for each sample");
}
