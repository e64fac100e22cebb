//! The relative-attitude laws of an experiment.

mod settings;

use nalgebra::UnitQuaternion;
use whorl_control::formation::{
    self, ReferenceLimits, RegisteredLaw, RelativeAttitudeLaw, Roster, YawPitchRoll, catalogue,
};
use whorl_params::{Reader, range};

use settings::ReaderSettings;

/// The default initial law of an experiment.
const DEFAULT_KIND: &str = "leader_follower";

/// The laws of an experiment and the initial offsets.
#[derive(Debug, Clone, PartialEq)]
pub struct LawSettings {
    /// The laws that the experiment uses, in their initial state; the first is the initial law. At least one.
    pub laws: Vec<Box<dyn RelativeAttitudeLaw>>,
    /// Commanded angles of each platform relative to its leader, or to the virtual structure.
    pub offsets: Vec<YawPitchRoll>,
}

/// Names of the laws in `law.kind`.
pub(super) fn kinds() -> Vec<&'static str> {
    catalogue().iter().map(RegisteredLaw::kind).collect()
}

impl LawSettings {
    /// The initial law.
    #[must_use]
    pub fn first(&self) -> Option<&dyn RelativeAttitudeLaw> {
        self.laws.first().map(Box::as_ref)
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.first().map_or("", |law| law.name())
    }

    /// The commanded offset of a platform.
    #[must_use]
    pub fn offset(&self, platform: usize) -> UnitQuaternion<f64> {
        self.offsets.get(platform).map_or_else(UnitQuaternion::identity, YawPitchRoll::attitude)
    }
}

/// Reads the initial law, and those `others` that steps switch to.
pub(super) fn read(
    r: &mut Reader<'_>,
    platforms: &[String],
    limits: &[ReferenceLimits],
    others: &[String],
) -> Option<LawSettings> {
    let kind = r.choice_or("kind", DEFAULT_KIND, &kinds(), "the relative-attitude law");
    for name in r.children("members") {
        // Platforms that were refused are none.
        if !platforms.is_empty() && !platforms.contains(&name) {
            r.reject(
                &format!("members.{name}"),
                format!("`{name}` is no platform; allowed: {}", platforms.join(", ")),
            );
        }
    }
    let offsets =
        platforms.iter().map(|name| r.group(&format!("members.{name}.offset"), read_angles)).collect();
    let switched_to =
        catalogue().iter().filter(|law| law.kind() != kind && others.iter().any(|o| o == law.kind()));
    let used = formation::find(kind).into_iter().chain(switched_to);
    let roster = Roster { platforms, limits };
    // All are read, so that all errors are found at once.
    let laws: Vec<_> = used.map(|law| law.read(&mut ReaderSettings::new(r, platforms), &roster)).collect();
    Some(LawSettings { laws: laws.into_iter().collect::<Option<_>>()?, offsets })
}

fn read_angles(r: &mut Reader<'_>) -> YawPitchRoll {
    let mut angle = |key, doc| r.f64_or(key, 0.0, range(-180.0..=180.0), doc).to_radians();
    YawPitchRoll {
        yaw_rad: angle("yaw_deg", "commanded yaw relative to the leader, about its z axis [deg]"),
        pitch_rad: angle("pitch_deg", "then pitch about the new y axis, positive nose down [deg]"),
        roll_rad: angle("roll_deg", "then roll about the new x axis [deg]"),
    }
}
