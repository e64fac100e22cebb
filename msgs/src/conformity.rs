//! Test: the Rust types agree with other implementations of the same definitions.
//!
//! The truth is `golden/cdr.json`, written by `tests/interop/golden_cdr.py` with rosbags and Eclipse Cyclone DDS:
//! messages whose fields all differ, with their CDR bytes, and the constants. A message that was added since is
//! not in it; what it is made by has been tested with all others.

use std::collections::BTreeSet;

use serde::{Serialize, de::DeserializeOwned};
use serde_json::{Map, Value};

use crate::cdr;
use crate::topics::{Message, MessageType};
use crate::whorl::srv::{
    AbortExperimentRequest, AbortExperimentResponse, StartExperimentRequest, StartExperimentResponse,
};

struct Golden {
    ty: String,
    value: Value,
    cdr: Vec<u8>,
}

fn golden() -> (Vec<Golden>, Map<String, Value>) {
    let file: Value = serde_json::from_str(include_str!("../golden/cdr.json")).unwrap();
    let bytes = |hex: &str| -> Vec<u8> {
        (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
    };
    let messages = file["messages"].as_array().unwrap().iter().map(|entry| Golden {
        ty: entry["type"].as_str().unwrap().to_owned(),
        value: entry["value"].clone(),
        cdr: bytes(entry["cdr"].as_str().unwrap()),
    });
    (messages.collect(), file["constants"].as_object().unwrap().clone())
}

#[test]
fn rust_types_have_the_fields_of_their_definitions() {
    let mut compared = Vec::new();
    for Golden { ty, value, cdr } in golden().0 {
        let Some(&message_type) = MessageType::ALL.iter().find(|t| t.name() == ty) else { continue };
        let message = Message::decode(message_type, &cdr).unwrap_or_else(|e| panic!("{ty}: {e}"));
        // Names and values; the order of the fields is in the bytes.
        let decoded = serde_json::to_value(&message).unwrap();
        assert_eq!(decoded.as_object().unwrap().values().collect::<Vec<_>>(), [&value], "{ty}");
        let mut bytes = Vec::new();
        message.encode_into(&mut bytes).unwrap();
        assert_eq!(bytes, cdr, "{ty}");
        compared.push(message_type);
    }
    // As many as there were when the golden file was written, each full and empty.
    assert_eq!(compared.len(), 2 * 37);
}

/// The interface package declares every package whose messages its own use, and no other.
#[test]
fn the_interface_package_depends_on_what_its_messages_use() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let read = |path: &std::path::Path| std::fs::read_to_string(path).unwrap();
    let definitions = ["msg", "srv"].iter().flat_map(|folder| std::fs::read_dir(root.join(folder)).unwrap());
    let mut used = BTreeSet::from(["builtin_interfaces".to_owned()]);
    for path in definitions.map(|entry| entry.unwrap().path()) {
        let of_field =
            |line: &str| Some(line.split_once('/')?.0.to_owned()).filter(|p| !p.contains(['#', ' ']));
        used.extend(read(&path).lines().filter_map(of_field));
    }
    assert!(used.contains("std_msgs") && used.contains("geometry_msgs"), "{used:?}");
    let (package, cmake) = (read(&root.join("package.xml")), read(&root.join("CMakeLists.txt")));
    let declared = package.split("<depend>").skip(1).filter_map(|rest| rest.split_once("</depend>"));
    let declared: BTreeSet<String> = declared.map(|(name, _)| name.to_owned()).collect();
    assert_eq!(declared, used);
    for name in &used {
        assert!(cmake.contains(&format!("find_package({name} REQUIRED)")), "{name} is not looked for");
    }
    let listed = cmake.split_once("DEPENDENCIES ").and_then(|(_, rest)| rest.split_once('\n')).unwrap().0;
    assert_eq!(listed.split_whitespace().map(str::to_owned).collect::<BTreeSet<_>>(), used);
}

#[test]
fn services_have_the_fields_of_their_definitions() {
    fn compare<T: Serialize + DeserializeOwned>(ty: &'static str) {
        let mut compared = 0;
        for Golden { value, cdr, .. } in golden().0.iter().filter(|g| g.ty == ty) {
            let message: T = cdr::decode(ty, cdr).unwrap();
            assert_eq!(serde_json::to_value(&message).unwrap(), *value, "{ty}");
            assert_eq!(cdr::encode(ty, &message).unwrap(), *cdr, "{ty}");
            compared += 1;
        }
        assert_eq!(compared, 2, "{ty}");
    }
    compare::<StartExperimentRequest>("whorl_msgs/msg/StartExperimentRequest");
    compare::<AbortExperimentRequest>("whorl_msgs/msg/AbortExperimentRequest");
    // One type serves for the answers of both.
    compare::<StartExperimentResponse>("whorl_msgs/msg/StartExperimentResponse");
    compare::<StartExperimentResponse>("whorl_msgs/msg/AbortExperimentResponse");
    compare::<AbortExperimentResponse>("whorl_msgs/msg/AbortExperimentResponse");
}

#[test]
fn constants_have_the_values_of_their_definitions() {
    let (_, golden) = golden();
    let mut compared = 0;
    macro_rules! check {
        ($name:literal $ty:ty: $($constant:ident)+) => {{
            let rust = [$((stringify!($constant), u64::from(<$ty>::$constant))),+];
            let constants = golden[$name].as_object().unwrap();
            let other: Vec<_> = constants.iter().map(|(name, v)| (name.as_str(), v.as_u64().unwrap())).collect();
            assert_eq!(other, rust, $name);
            compared += 1;
        }};
    }
    use crate::diagnostic_msgs::DiagnosticStatus;
    use crate::sensor_msgs::BatteryState;
    use crate::whorl::{
        AttitudeEstimate, AttitudeReference, ControlStatus, FormationCommand, FormationState, GateState,
        ModelFit, ThrusterState,
    };
    check!("diagnostic_msgs/msg/DiagnosticStatus" DiagnosticStatus: OK WARN ERROR STALE);
    assert_eq!(BatteryState::POWER_SUPPLY_STATUS_DISCHARGING, 2);
    let battery = &golden["sensor_msgs/msg/BatteryState"];
    assert_eq!(battery["POWER_SUPPLY_TECHNOLOGY_VRLA"], BatteryState::POWER_SUPPLY_TECHNOLOGY_VRLA);
    check!("whorl_msgs/msg/AttitudeEstimate" AttitudeEstimate:
        HEALTH_INITIALISING HEALTH_OK HEALTH_DEGRADED HEALTH_UNHEALTHY
        FLAG_GYRO_REJECTED FLAG_ACCELEROMETER_REJECTED FLAG_VECTOR_REJECTED FLAG_VECTOR_STALE FLAG_IMU_STALE
        FLAG_INCONSISTENT);
    check!("whorl_msgs/msg/AttitudeReference" AttitudeReference: MODE_TRACK MODE_HOLD);
    check!("whorl_msgs/msg/ControlStatus" ControlStatus:
        MODE_IDLE MODE_TRACK MODE_HOLD MODE_SAFE_DAMPING MODE_SAFE_COAST MODE_EXCITE
        REASON_NONE REASON_NO_AUTHORITY REASON_REFERENCE_STALE REASON_ESTIMATE_STALE REASON_ESTIMATE_UNHEALTHY
        REASON_TILT_LIMIT REASON_ABORT REASON_RATE_LIMIT REASON_EXCITATION_LIMIT REASON_EXCITATION_UNKNOWN
        REASON_COMMANDS_REFUSED
        ALLOCATION_SOLVED ALLOCATION_UNIQUE ALLOCATION_FALLBACK ALLOCATION_OFF);
    check!("whorl_msgs/msg/FormationCommand" FormationCommand:
        COMMAND_STANDBY COMMAND_TRACK COMMAND_HOLD COMMAND_ABORT);
    check!("whorl_msgs/msg/FormationState" FormationState:
        PHASE_WAITING PHASE_READY PHASE_SETTLE PHASE_MANOEUVRE PHASE_HOLD PHASE_FINISHED PHASE_ABORTED);
    check!("whorl_msgs/msg/GateState" GateState:
        STATE_OFF STATE_OBEYING
        REFUSAL_NONE REFUSAL_WRONG_SIZE REFUSAL_NOT_FINITE REFUSAL_OUT_OF_RANGE REFUSAL_OUT_OF_ORDER REFUSAL_EXPIRED
        REFUSAL_AHEAD);
    check!("whorl_msgs/msg/ModelFit" ModelFit: STATE_WAITING STATE_AGREES STATE_DOUBT STATE_MISMATCH);
    check!("whorl_msgs/msg/ThrusterState" ThrusterState: HEALTH_OK HEALTH_FAILED);
    // And the battery's.
    assert_eq!(golden.len(), compared + 1);
}
