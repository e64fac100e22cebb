//! What the page of a pass draws.

use nalgebra::{Rotation3, Vector3};
use whorl_coordinator::parameters::CoObservation;
use whorl_orbits::EARTH_RATE_RAD_S;
use whorl_orbits::co_observation::ground_track_m;
use whorl_orbits::earth::geodetic_from_geocentric_rad;
use whorl_orbits::flight::Flight;
use whorl_report::{DrawnCraft, DrawnPass};

/// Instants of the page.
const INSTANTS: u32 = 240;

/// The pass at so many instants, in Earth-fixed axes.
pub fn drawn(step: &str, pass: &CoObservation, platforms: &[String]) -> anyhow::Result<DrawnPass> {
    let craft = |(name, craft): (&String, &whorl_orbits::pass::Spacecraft)| DrawnCraft {
        name: name.clone(),
        config_deg: craft.mounting.angle_rad().to_degrees(),
        ..DrawnCraft::default()
    };
    let mut drawn = DrawnPass {
        step: step.to_owned(),
        spacecraft: platforms.iter().zip(&pass.pass.spacecraft).map(craft).collect(),
        ..DrawnPass::default()
    };
    let Some(first) = pass.trajectories.first() else { return Ok(drawn) };
    let flight = Flight::new(&pass.pass)?;
    for k in 0..=INSTANTS {
        let time_s = pass.mapping.duration_s * f64::from(k) / f64::from(INSTANTS);
        let orbit_s = first.orbit_time_s(time_s);
        let to_earth = Rotation3::from_axis_angle(&Vector3::z_axis(), -EARTH_RATE_RAD_S * orbit_s);
        let sights = flight.at(orbit_s)?;
        let positions: Vec<Vector3<f64>> = sights.iter().map(|sight| sight.state.position_m).collect();
        let target = to_earth * pass.pass.target.position_m(&positions, orbit_s)?;
        drawn.time_s.push([time_s, orbit_s]);
        drawn.target_km.push(km(&target));
        drawn.target_deg.push(on_map_deg(&target));
        let all = drawn.spacecraft.iter_mut().zip(&sights).zip(&pass.pass.spacecraft).zip(&pass.trajectories);
        for (((craft, sight), spacecraft), motion) in all {
            let pointing = &sight.pointing;
            let boresight =
                to_earth * (pointing.q_eci_body * spacecraft.mounting.boresight_body.into_inner());
            let angles = motion.at(time_s).angles_rad.map(f64::to_degrees);
            craft.position_km.push(km(&(to_earth * sight.state.position_m)));
            craft.boresight.push([boresight.x, boresight.y, boresight.z]);
            craft.ground_deg.push(on_map_deg(&ground_track_m(&sight.state.position_m, orbit_s)));
            craft.mission_deg.push(pointing.mission_angle_rad.to_degrees());
            craft
                .off_deg
                .push([pointing.boresight_error_rad, pointing.thrust_error_rad].map(f64::to_degrees));
            craft.elevation_deg.push(sight.elevation_rad.to_degrees());
            craft.to_chief_km.push(sight.relative.position_m.norm() * 1e-3);
            craft.yaw_pitch_roll_deg.push([angles.x, angles.y, angles.z]);
        }
    }
    Ok(drawn)
}

fn km(position_m: &Vector3<f64>) -> [f64; 3] {
    [position_m.x, position_m.y, position_m.z].map(|metres| metres * 1e-3)
}

/// East longitude and geodetic latitude of a point of the surface.
fn on_map_deg(surface_m: &Vector3<f64>) -> [f64; 2] {
    let geocentric_rad = surface_m.z.atan2(surface_m.x.hypot(surface_m.y));
    [surface_m.y.atan2(surface_m.x), geodetic_from_geocentric_rad(geocentric_rad)].map(f64::to_degrees)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// WGS 84: at 45 deg geodetic, the geocentric latitude is 44.8076 deg.
    #[test]
    fn maps_show_geodetic_latitudes() {
        let geocentric = 44.807_576_f64.to_radians();
        let [longitude, latitude] =
            on_map_deg(&(6.37e6 * Vector3::new(0.0, geocentric.cos(), geocentric.sin())));
        assert!((longitude - 90.0).abs() < 1e-9 && (latitude - 45.0).abs() < 1e-4, "{longitude} {latitude}");
    }
}
