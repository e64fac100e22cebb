//! Fault row: a sensor gives NaN, freezes, leaves its range or falls silent. That is refused and reported,
//! control is safe where it must be, and everything goes on when the sensor is back.

use whorl_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus};
use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{AttitudeEstimate, ControlStatus};
use whorl_params::Value;

use super::held::{Held, NEVER_S, SOON};
use crate::support::watch::{Watch, route};

struct SensorFault {
    kind: &'static str,
    /// What the estimate says meanwhile.
    flag: u32,
    /// Whether the attitude cannot be controlled without that sensor.
    safe_mode: bool,
}

const FAULTS: [SensorFault; 7] = [
    SensorFault { kind: "gyro_nan", flag: AttitudeEstimate::FLAG_GYRO_REJECTED, safe_mode: true },
    SensorFault { kind: "gyro_frozen", flag: AttitudeEstimate::FLAG_GYRO_REJECTED, safe_mode: true },
    SensorFault { kind: "gyro_out_of_range", flag: AttitudeEstimate::FLAG_GYRO_REJECTED, safe_mode: true },
    SensorFault {
        kind: "accelerometer_nan",
        flag: AttitudeEstimate::FLAG_ACCELEROMETER_REJECTED,
        safe_mode: false,
    },
    SensorFault { kind: "imu_silent", flag: AttitudeEstimate::FLAG_IMU_STALE, safe_mode: true },
    SensorFault { kind: "vector_nan", flag: AttitudeEstimate::FLAG_VECTOR_REJECTED, safe_mode: false },
    SensorFault { kind: "vector_silent", flag: AttitudeEstimate::FLAG_VECTOR_STALE, safe_mode: false },
];

pub fn are_refused_and_reported_and_taken_back(held: &mut Held) {
    for fault in FAULTS {
        let kind = fault.kind;
        held.set_driver("faults.sensor.kind", &Value::String(kind.to_owned()));
        held.set_driver("faults.sensor.start_s", &Value::Double(0.0));
        refused(&held.watch, &fault);
        held.formation.check_alive();
        held.set_driver("faults.sensor.start_s", &Value::Double(NEVER_S));
        let back = held.watch.wait_next::<AttitudeEstimate>(
            &format!("an estimate as before {kind}"),
            route(0, Topic::AttitudeEstimate),
            SOON,
            |m| m.health == AttitudeEstimate::HEALTH_OK && m.flags & fault.flag == 0,
        );
        held.watch.wait(&format!("tracking after {kind}"), SOON, |log| {
            log.after::<ControlStatus>(route(0, Topic::ControlStatus), back)
                .find(|(_, m)| m.mode == ControlStatus::MODE_TRACK)
                .map(|_| ())
        });
    }
    for (_, m) in held.watch.log().of::<AttitudeEstimate>(route(0, Topic::AttitudeEstimate)) {
        let rate = nalgebra::Vector3::from(m.omega_wb_b_rad_s);
        let sound = m.q_world_body.to_unit().is_some() && rate.norm() < 1.0;
        assert!(!m.usable() || sound, "a broken sensor went through: {m:?}");
    }
}

/// The estimate flags the fault, the estimator reports it, and control continues as far as possible without the sensor.
fn refused(watch: &Watch, fault: &SensorFault) {
    let (estimate, status) = (route(0, Topic::AttitudeEstimate), route(0, Topic::ControlStatus));
    let flagged =
        watch.wait_next::<AttitudeEstimate>(&format!("the flag of {}", fault.kind), estimate, SOON, |m| {
            m.flags & fault.flag != 0
        });
    watch.wait_next::<DiagnosticArray>(
        &format!("a diagnostic of {}", fault.kind),
        route(0, Topic::Diagnostics),
        SOON,
        |m| m.status.iter().any(|s| s.name == "whorl_1: estimator" && s.level >= DiagnosticStatus::WARN),
    );
    if fault.safe_mode {
        watch.wait(&format!("safe mode in {}", fault.kind), SOON, |log| {
            log.after::<ControlStatus>(status, flagged)
                .find(|(_, m)| m.mode >= ControlStatus::MODE_SAFE_DAMPING)
                .map(|_| ())
        });
    } else {
        watch.wait(&format!("tracking in {}", fault.kind), SOON, |log| {
            let mut later = log.after::<ControlStatus>(status, flagged);
            later.find(|(_, m)| m.mode == ControlStatus::MODE_TRACK).map(|_| ())
        });
    }
}
