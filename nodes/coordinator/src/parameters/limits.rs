//! Limits of each platform's reference.

use whorl_control::formation::ReferenceLimits;
use whorl_control::reference::TiltEnvelope;
use whorl_dynamics::platform::TiltLimit;
use whorl_params::{Reader, non_negative, range};

/// One group per platform, all of it optional. Empty after an error.
pub(super) fn read(r: &mut Reader<'_>, platforms: &[String]) -> Vec<ReferenceLimits> {
    let read: Vec<_> = platforms.iter().map_while(|platform| r.group(platform, read_platform).ok()).collect();
    if read.len() == platforms.len() { read } else { Vec::new() }
}

fn read_platform(r: &mut Reader<'_>) -> Result<ReferenceLimits, ()> {
    let kind = r.choice_or(
        "tilt_kind",
        "cone",
        &["cone", "pitch"],
        "freedom of the bearing: a cone about the vertical (tabletop), or pitch alone (dumbbell)",
    );
    let max_rad =
        r.f64_or("tilt_max_deg", 5.0, range(0.1..=75.0), "where the bearing stops [deg]").to_radians();
    let margin_rad = r
        .f64_or(
            "tilt_margin_deg",
            1.0,
            non_negative(),
            "references keep this much away from the stop, for control errors [deg]",
        )
        .to_radians();
    let rate_max_rad_s = r
        .f64_or("rate_max_deg_s", 4.0, range(0.01..=60.0), "largest rate of the reference [deg/s]")
        .to_radians();
    let acceleration_max_rad_s2 = r
        .f64_or(
            "acceleration_max_deg_s2",
            0.6,
            range(0.001..=60.0),
            "largest angular acceleration of the reference [deg/s^2]",
        )
        .to_radians();
    let tilt_limit = if kind == "pitch" { TiltLimit::Pitch { max_rad } } else { TiltLimit::Cone { max_rad } };
    let envelope =
        TiltEnvelope::new(tilt_limit, margin_rad).map_err(|e| r.reject("tilt_margin_deg", e.to_string()))?;
    let limits = ReferenceLimits { envelope, rate_max_rad_s, acceleration_max_rad_s2 };
    limits.check().map_err(|e| r.reject("tilt_max_deg", e.to_string()))?;
    Ok(limits)
}
