//! The driver's parameters: the single definition of their names, ranges and meaning.

use std::time::Duration;

use nalgebra::{UnitQuaternion, Vector3};
use whorl_devices::DeviceList;
use whorl_dynamics::PlatformModel;
use whorl_math::rad_from_deg;
use whorl_msgs::topics::PlatformId;
use whorl_params::{Reader, any, own_platform, platform_model, range, truth_model};

use crate::faults::{self, Fault};
use crate::prearm::Supplies;
use crate::simulated::Start;

/// What the driver drives.
#[derive(Debug, Clone, PartialEq)]
pub enum Backend {
    /// Simulated hardware.
    Simulated {
        /// The truth.
        truth: Box<PlatformModel>,
        /// Where it starts.
        start: Start,
        /// Seed of its sensors' noise.
        seed: u64,
        /// What breaks, and when.
        faults: Vec<Fault>,
    },
    /// A recording.
    Replay {
        /// Run directory, bag or CSV file.
        source: String,
        /// For CSV: the column map.
        channels: Option<String>,
    },
    /// Real hardware: [`Parameters::devices`].
    Hardware {
        /// Folder in which emulators have their ports; `None`: the devices are this computer's own.
        root: Option<String>,
    },
}

/// Validated parameters of a driver.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// The platform's index.
    pub platform: PlatformId,
    /// The platform's name.
    pub name: String,
    /// The platform's model, as estimator and control use it.
    pub model: PlatformModel,
    /// The valve board switches everything off this long after the driver's last heartbeat \[s\]; 0: it has no watchdog.
    pub watchdog_s: f64,
    /// What is driven.
    pub backend: Backend,
    /// The platform's devices, whatever is driven.
    pub devices: DeviceList,
    /// What it needs before it may.
    pub supplies: Supplies,
    /// Whether the platform may move.
    pub armed: bool,
    /// What goes wrong with emulated devices.
    pub emulated_faults: Vec<whorl_devices::emulation::Fault>,
}

impl Parameters {
    /// Sample period of the fast sensors.
    #[must_use]
    pub fn period(&self) -> Duration {
        Duration::from_secs_f64(1.0 / self.model.sensors.rate_hz)
    }
}

/// Reads them for the platform in whose namespace the node is. `None` when the model is unusable: the reader
/// then holds the reasons.
pub fn read(r: &mut Reader<'_>) -> Option<Parameters> {
    let own = own_platform(r);
    let model = platform_model(r, "model");
    let truth = truth_model(r);
    let seed =
        r.i64_or("seed", 1, range(0..), "seed of the simulated sensors' noise; platforms of one seed differ");
    let kind = r.choice_or("backend", "sim", &["sim", "replay", "hardware"], "what the driver drives");
    let watchdog_s = r.f64_or(
        "watchdog_s",
        0.2,
        range(0.0..=10.0),
        "the simulated valve board switches everything off this long after the driver's last heartbeat [s]; 0: it has \
         no watchdog",
    );
    let source = r.group("replay", |r| {
        r.string_or("source", "", "recording to replay: run directory, bag or CSV file")
    });
    let channels = r.group("replay", |r| {
        r.optional_string("channels", "for CSV: YAML file that says which column is which")
    });
    let start = r.group("initial", read_start);
    let root = r.group("hardware", |r| {
        r.optional_string(
            "root",
            "folder in which emulators have their ports; left out: the devices are real",
        )
    });
    // What cannot hurt anybody is armed from the start.
    let armed = r.bool_or(
        "armed",
        kind != "hardware" || root.is_some(),
        "whether the platform may move; set it while the driver runs, by `whorl arm` and `whorl disarm`. Left out: true, but false \
         with real devices, which always start disarmed",
    );
    let (model, truth) = (model?, truth?);
    let devices = r.fixed(|r| whorl_devices::read(r, &model));
    let supplies = r.fixed(|r| Supplies::read(r, &model));
    let emulated_faults = whorl_devices::emulation::read(r, &model, &devices);
    if kind == "hardware" && !devices.missing.is_empty() {
        let problem = format!(
            "backend hardware needs a device for: {}; allowed: entries devices.<name>.kind for all of them \
             (docs/hardware.md)",
            devices.missing.join(", ")
        );
        r.reject("backend", problem);
    }
    let jets: Vec<String> = truth.jets().iter().map(|j| j.name.clone()).collect();
    let faults = faults::read(r, &jets);
    if kind == "replay" && source.is_empty() {
        r.reject(
            "replay.source",
            "backend replay needs a recording; allowed: path of a run directory, bag or CSV file",
        );
    }
    let wheels = truth.wheels().len();
    if ![0, wheels].contains(&start.wheel_speed_rad_s.len()) {
        r.reject("initial.wheel_speed_rad_s", format!("allowed: {wheels} numbers, one per wheel, or none"));
    }
    let (index, name) = own?;
    let platform_id = PlatformId(index);
    Some(Parameters {
        platform: platform_id,
        name,
        model,
        watchdog_s,
        backend: match kind {
            "replay" => Backend::Replay { source, channels },
            "hardware" => Backend::Hardware { root },
            // Platforms need independent noise: offset the seed by multiples of an odd constant (2^64 / golden ratio).
            _ => Backend::Simulated {
                truth: Box::new(truth),
                start,
                seed: seed
                    .unsigned_abs()
                    .wrapping_add(u64::from(platform_id.0).wrapping_mul(0x9e37_79b9_7f4a_7c15)),
                faults,
            },
        },
        devices,
        supplies,
        armed,
        emulated_faults,
    })
}

fn read_start(r: &mut Reader<'_>) -> Start {
    let yaw_deg = r.f64_or("yaw_deg", 0.0, range(-360.0..=360.0), "yaw at the start [deg]");
    let pitch_deg = r.f64_or("pitch_deg", 0.0, range(-90.0..=90.0), "pitch at the start [deg]");
    let roll_deg = r.f64_or("roll_deg", 0.0, range(-180.0..=180.0), "roll at the start [deg]");
    let rate_deg_s = r.vector3_or(
        "rate_deg_s",
        Vector3::zeros(),
        range(-60.0..=60.0),
        "body rate at the start, body axes [deg/s]",
    );
    let wheel_speed_rad_s = r.f64_array_or(
        "wheel_speed_rad_s",
        &[],
        any(),
        "wheel speeds at the start [rad/s]; left out: stopped",
    );
    let [roll, pitch, yaw] = [roll_deg, pitch_deg, yaw_deg].map(rad_from_deg);
    Start {
        q_world_body: UnitQuaternion::from_euler_angles(roll, pitch, yaw),
        omega_wb_b_rad_s: rate_deg_s.map(rad_from_deg),
        wheel_speed_rad_s,
    }
}
