//! A pass of spacecraft over their common target, shown by the platforms.

use nalgebra::Vector3;
use whorl_control::formation::{ReferenceLimits, YawPitchRoll, YawPitchRollMotion};
use whorl_control::reference::Reference;
use whorl_dynamics::platform::TiltLimit;
use whorl_orbits::burn::Burn;
use whorl_orbits::co_observation::{Mounting, Target};
use whorl_orbits::flight::Flight;
use whorl_orbits::formation::Formation;
use whorl_orbits::formation_keeping::Keeper;
use whorl_orbits::laboratory::{LaboratoryError, Mapping, Reach, Trajectory, trajectories};
use whorl_orbits::pass::{Pass, PassError, RelativeModel, Spacecraft, WantedDeltaV};
use whorl_orbits::{EARTH_RADIUS_M, Elements};
use whorl_params::{Reader, positive, range};

use super::refusals;

/// The pass and the resulting motions.
#[derive(Debug, Clone, PartialEq)]
pub struct CoObservation {
    /// The pass in orbit.
    pub pass: Pass,
    /// How it is scaled to the laboratory.
    pub mapping: Mapping,
    /// Time for the platforms to reach its initial attitudes \[s\].
    pub settle_s: f64,
    /// The motion of each platform.
    pub trajectories: Vec<Trajectory>,
    /// How each spacecraft is kept in its formation after the pass; `None`: not at all.
    pub keepers: Vec<Option<Keeper>>,
}

impl CoObservation {
    /// The motion of a platform, `elapsed_s` after the step began. `None` for one that does not exist.
    #[must_use]
    pub fn motion(&self, platform: usize, elapsed_s: f64, yaw_zero_rad: f64) -> Option<Reference> {
        let at = self.trajectories.get(platform)?.at(elapsed_s - self.settle_s);
        let motion = YawPitchRollMotion {
            angles: YawPitchRoll::from_vector(at.angles_rad + Vector3::new(yaw_zero_rad, 0.0, 0.0)),
            rates_rad_s: at.rates_rad_s,
            accelerations_rad_s2: at.accelerations_rad_s2,
        };
        Some(motion.reference())
    }

    /// Largest angles between boresight and target and between thrust and wanted velocity change over the pass, per
    /// platform \[rad\]; NaN where there is none.
    #[must_use]
    pub fn largest_errors_rad(&self) -> Vec<(f64, f64)> {
        let mut largest = vec![(f64::NAN, f64::NAN); self.pass.spacecraft.len()];
        let Ok(flight) = Flight::new(&self.pass) else { return largest };
        for k in 0..=50 {
            let time_s = self.mapping.orbit_span_s() * f64::from(k) / 50.0;
            for (worst, sight) in largest.iter_mut().zip(flight.at(time_s).into_iter().flatten()) {
                worst.0 = worst.0.max(sight.pointing.boresight_error_rad);
                worst.1 = worst.1.max(sight.pointing.thrust_error_rad);
            }
        }
        largest
    }
}

const MODELS: [&str; 5] = ["two_body", "j2", "nonlinear", "clohessy_wiltshire", "yamanaka_ankersen"];
const FORMATIONS: [&str; 5] = ["chief", "in_plane", "in_track", "circular", "projected_circular"];

/// Reads the pass of a step; a pass that is impossible or cannot be shown is refused here, before anything moves.
pub(super) fn read(
    r: &mut Reader<'_>,
    duration_s: f64,
    platforms: &[String],
    limits: &[ReferenceLimits],
) -> Option<CoObservation> {
    let chief = r.group("orbit", read_orbit);
    let model =
        match r.choice_or("model", "two_body", &MODELS, "how the spacecraft move relative to each other") {
            "j2" => RelativeModel::J2,
            "nonlinear" => RelativeModel::Nonlinear,
            "clohessy_wiltshire" => RelativeModel::ClohessyWiltshire,
            "yamanaka_ankersen" => RelativeModel::YamanakaAnkersen,
            _ => RelativeModel::TwoBody,
        };
    let target = read_target(r);
    let thrust_weight = r.f64_or(
        "thrust_weight",
        0.0,
        range(0.0..=1.0),
        "share of the mismatch between theta_mission and theta_config that the boresight takes; 0: it points \
         exactly, 1: the thruster does",
    );
    let settle_s = r.f64_or("settle_s", 20.0, range(0.0..), "time to come to the first attitudes [s]");
    let mapping = Mapping {
        time_ratio: r.f64_or("time_ratio", 4.0, positive(), "seconds of orbit in a second of the laboratory"),
        geometry_scale: r.f64_or(
            "geometry_scale",
            1.0,
            range(0.001..=1.0),
            "share of every rotation that is shown",
        ),
        ramp_s: r.f64_or("ramp_s", 10.0, positive(), "time of the smooth beginning, and of the end [s]"),
        duration_s: duration_s - settle_s,
    };
    let (spacecraft, keepers) = platforms
        .iter()
        .enumerate()
        .map(|(index, name)| {
            r.group(&format!("spacecraft.{name}"), |r| {
                let spacecraft = read_spacecraft(r, index);
                let keeper = r.has("keep").then(|| read_keeper(r, &spacecraft, model)).flatten();
                (spacecraft, keeper)
            })
        })
        .unzip();
    let pass = Pass { chief, model, spacecraft, target, thrust_weight };
    let reach = |l: &ReferenceLimits| Reach {
        pitch_only: matches!(l.envelope.limit(), TiltLimit::Pitch { .. }),
        tilt_max_rad: l.envelope.max_rad(),
        rate_max_rad_s: l.rate_max_rad_s,
        acceleration_max_rad_s2: l.acceleration_max_rad_s2,
    };
    let reaches: Vec<Reach> = limits.iter().map(reach).collect();
    if reaches.len() != platforms.len() || r.error_count() > 0 {
        return None;
    }
    match trajectories(&pass, &mapping, &reaches) {
        Ok(trajectories) => Some(CoObservation { pass, mapping, settle_s, trajectories, keepers }),
        Err(error) => {
            let key = match &error {
                LaboratoryError::Pass(PassError::Orbit(_)) => "orbit.perigee_altitude_km",
                LaboratoryError::Pass(PassError::Target(_)) if r.has("target") => "target",
                LaboratoryError::Pass(PassError::NotCircular { .. } | PassError::ThrustWithoutOrbits) => {
                    "model"
                }
                _ => "kind",
            };
            let error = refusals::with_names(&error.to_string(), platforms);
            r.reject(key, format!("the pass cannot be shown: {error}"));
            None
        }
    }
}

fn read_orbit(r: &mut Reader<'_>) -> Elements {
    let altitude_m =
        1e3 * r.f64_or("perigee_altitude_km", 500.0, range(-6000.0..=1e6), "height of the lowest point [km]");
    let eccentricity = r.f64_or("eccentricity", 0.0, range(0.0..=0.95), "eccentricity [1]");
    let mut angle = |key, default, doc| r.f64_or(key, default, range(-360.0..=360.0), doc).to_radians();
    Elements {
        semi_major_axis_m: (EARTH_RADIUS_M + altitude_m) / (1.0 - eccentricity),
        eccentricity,
        inclination_rad: angle("inclination_deg", 51.6, "inclination [deg]"),
        node_rad: angle("node_deg", 0.0, "right ascension of the ascending node [deg]"),
        perigee_rad: angle("perigee_deg", 0.0, "argument of perigee [deg]"),
        mean_anomaly_rad: angle("mean_anomaly_deg", 0.0, "mean anomaly when the pass begins [deg]"),
    }
}

fn read_target(r: &mut Reader<'_>) -> Target {
    match r.choice_or(
        "target",
        "centroid",
        &["centroid", "point"],
        "centroid of the points below, or a given one",
    ) {
        "point" => {
            let on_map = r.choice_or(
                "latitude_is",
                "geocentric",
                &["geocentric", "geodetic"],
                "which latitude latitude_deg is: of the line from the Earth's centre, or geodetic, as on maps (WGS 84)",
            ) == "geodetic";
            let latitude_rad =
                r.f64("latitude_deg", range(-90.0..=90.0), "latitude, see latitude_is [deg]").to_radians();
            let longitude_rad = r
                .f64(
                    "longitude_deg",
                    range(-360.0..=360.0),
                    "east of the vernal equinox when the pass begins [deg]",
                )
                .to_radians();
            if on_map {
                Target::geodetic(latitude_rad, longitude_rad)
            } else {
                Target::Point { latitude_rad, longitude_rad }
            }
        }
        _ => Target::Centroid,
    }
}

fn read_spacecraft(r: &mut Reader<'_>, index: usize) -> Spacecraft {
    let default = if index == 0 { "chief" } else { "projected_circular" };
    let kind = r.choice_or("formation", default, &FORMATIONS, "its place relative to the chief");
    let separation_m = if kind == "chief" {
        0.0
    } else {
        r.f64_or("separation_m", 10_000.0, range(-2e5..=2e5), "distance ahead, or radius of the circle [m]")
    };
    let phase_rad = if kind.ends_with("circular") {
        let phase = r.f64_or(
            "phase_deg",
            0.0,
            range(-360.0..=360.0),
            "where on the circle when the pass begins [deg]",
        );
        phase.to_radians()
    } else {
        0.0
    };
    let formation = match kind {
        "in_plane" => Some(Formation::InPlane { ahead_m: separation_m }),
        "in_track" => Some(Formation::InTrack { ahead_m: separation_m }),
        "circular" => Some(Formation::Circular { radius_m: separation_m, phase_rad }),
        "projected_circular" => Some(Formation::ProjectedCircular { radius_m: separation_m, phase_rad }),
        _ => None,
    };
    let mounting = if r.has("boresight_body") || r.has("thrust_body") {
        Mounting {
            boresight_body: r.direction("boresight_body", "body axis that points at the target"),
            thrust_body: r.direction("thrust_body", "velocity change that the thruster gives, body axes"),
        }
    } else {
        Mounting { boresight_body: Vector3::x_axis(), thrust_body: Vector3::y_axis() }
    };
    let wanted = match r.choice_or(
        "wanted",
        "none",
        &["none", "remove_drift", "fixed"],
        "velocity change that it wants: none, what takes the drift out of its relative motion, or a fixed one",
    ) {
        "remove_drift" => WantedDeltaV::RemoveDrift,
        "fixed" => WantedDeltaV::Hill(r.vector3(
            "delta_v_hill_m_s",
            range(-1000.0..=1000.0),
            "radial, in-track, cross-track [m/s]",
        )),
        _ => WantedDeltaV::None,
    };
    let burn = r.has("burn").then(|| {
        r.group("burn", |r| Burn {
            start_s: r.f64(
                "start_s",
                range(0.0..),
                "when it begins, in seconds of orbit after the pass has [s]",
            ),
            thrust_n: r.f64("thrust_n", positive(), "thrust [N]"),
            mass_kg: r.f64("mass_kg", positive(), "mass of the spacecraft [kg]"),
            specific_impulse_s: r.f64_or(
                "specific_impulse_s",
                70.0,
                positive(),
                "specific impulse; cold nitrogen: 70 [s]",
            ),
        })
    });
    let velocity_error_hill_m_s = r.vector3_or(
        "velocity_error_hill_m_s",
        Vector3::zeros(),
        range(-100.0..=100.0),
        "by how much its velocity is off when the pass begins: radial, in-track, cross-track [m/s]",
    );
    Spacecraft { formation, mounting, wanted, burn, velocity_error_hill_m_s }
}

/// How a spacecraft is kept after the pass, by the thruster of its burn.
fn read_keeper(r: &mut Reader<'_>, spacecraft: &Spacecraft, model: RelativeModel) -> Option<Keeper> {
    let keeper = r.group("keep", |r| Keeper {
        half_width_m: r.vector3(
            "half_width_m",
            positive(),
            "half the width of the box in which it is held: radial, in-track, cross-track [m]",
        ),
        duration_s: 86_400.0
            * r.f64_or("days", 5.0, range(0.0..=100.0), "how long it is kept after the pass [days]"),
        thrust_error: r.f64_or(
            "thrust_error",
            0.0,
            range(-0.9..=9.0),
            "by which share its thruster gives more than thrust_n, which the law does not know",
        ),
        gas_kg: r.f64_or("gas_kg", 5.0, range(0.0..), "gas that it has before the pass [kg]"),
        thrust_n: spacecraft.burn.map_or(f64::NAN, |b| b.thrust_n),
        mass_kg: spacecraft.burn.map_or(f64::NAN, |b| b.mass_kg),
        specific_impulse_s: spacecraft.burn.map_or(f64::NAN, |b| b.specific_impulse_s),
    });
    let Some(burn) = spacecraft.burn else {
        r.reject_group("keep", "needs a burn beside it, for thrust_n, mass_kg and specific_impulse_s");
        return None;
    };
    if spacecraft.formation.is_none() {
        r.reject_group("keep", "is for a spacecraft with a formation: the chief moves freely");
        return None;
    }
    if !matches!(model, RelativeModel::TwoBody | RelativeModel::J2) {
        r.reject_group("keep", "moves single spacecraft: the model must be two_body or j2");
        return None;
    }
    if keeper.gas_kg >= burn.mass_kg {
        r.reject("keep.gas_kg", "allowed: less than mass_kg of the burn");
        return None;
    }
    Some(keeper)
}
