//! What tests of several modules are about.

use nalgebra::Vector3;

use crate::EARTH_RADIUS_M;
use crate::co_observation::{Mounting, Target};
use crate::elements::Elements;
use crate::formation::Formation;
use crate::pass::{Pass, RelativeModel, Spacecraft, WantedDeltaV};

/// A chief whose perigee is 500 km high, and a deputy in this formation.
pub(crate) fn pass(
    model: RelativeModel,
    eccentricity: f64,
    formation: Formation,
    wanted: WantedDeltaV,
) -> Pass {
    let mounting = Mounting { boresight_body: Vector3::x_axis(), thrust_body: Vector3::y_axis() };
    let spacecraft = |formation, wanted| Spacecraft {
        formation,
        mounting,
        wanted,
        burn: None,
        velocity_error_hill_m_s: Vector3::zeros(),
    };
    Pass {
        chief: Elements {
            semi_major_axis_m: (EARTH_RADIUS_M + 500e3) / (1.0 - eccentricity),
            eccentricity,
            inclination_rad: 0.9,
            node_rad: 0.0,
            perigee_rad: 0.0,
            mean_anomaly_rad: 0.5,
        },
        model,
        spacecraft: vec![spacecraft(None, WantedDeltaV::None), spacecraft(Some(formation), wanted)],
        target: Target::Centroid,
        thrust_weight: 0.0,
    }
}
