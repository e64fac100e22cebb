//! What the page of a pass draws.

use super::burns::speeds_m_s;
use nalgebra::{Rotation3, Vector3};
use whorl_coordinator::parameters::CoObservation;
use whorl_orbits::EARTH_RATE_RAD_S;
use whorl_orbits::co_observation::ground_track_m;
use whorl_orbits::earth::geodetic_from_geocentric_rad;
use whorl_orbits::flight::Flight;
use whorl_report::{DrawnBurn, DrawnCraft, DrawnPass};

/// Instants of the page.
const INSTANTS: u32 = 240;

/// The pass at so many instants, in Earth-fixed axes.
pub fn drawn(
    step: &str,
    pass: &CoObservation,
    flight: &Flight<'_>,
    platforms: &[String],
) -> anyhow::Result<DrawnPass> {
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
    for flown in flight.flown() {
        let laboratory_s =
            |orbit_s: f64| laboratory_s(|t| first.orbit_time_s(t), pass.mapping.duration_s, orbit_s);
        let [wanted_m_s, along, across] = speeds_m_s(&flown.wanted_hill_m_s, &flown.given_hill_m_s);
        if let Some(craft) = drawn.spacecraft.get_mut(flown.spacecraft) {
            craft.burns.push(DrawnBurn {
                laboratory_s: [laboratory_s(flown.span_s.0), laboratory_s(flown.span_s.1)],
                orbit_s: [flown.span_s.0, flown.span_s.1],
                wanted_m_s,
                given_m_s: [along, across],
                gas_kg: flown.gas_kg,
            });
        }
    }
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

/// When the laboratory shows an instant of the orbit, whose times increase with its own; the pass's end for one after it.
fn laboratory_s(orbit_time_s: impl Fn(f64) -> f64, duration_s: f64, orbit_s: f64) -> f64 {
    let (mut low, mut high) = (0.0, duration_s);
    // To a millionth of the pass.
    for _ in 0..20 {
        let middle = 0.5 * (low + high);
        if orbit_time_s(middle) < orbit_s { low = middle } else { high = middle }
    }
    0.5 * (low + high)
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

    /// A pace that rises and falls smoothly: 100 s of orbit in 20 s; at 5 s, 100 (0.25 - sin(pi / 2) / (2 pi)).
    #[test]
    fn an_instant_of_the_orbit_is_found_in_the_laboratory() {
        let pace =
            |t: f64| 100.0 * (t / 20.0 - (t / 20.0 * std::f64::consts::TAU).sin() / std::f64::consts::TAU);
        for (orbit_s, expected_s) in
            [(9.084_505_69, 5.0), (50.0, 10.0), (0.0, 0.0), (100.0, 20.0), (130.0, 20.0)]
        {
            let found_s = laboratory_s(pace, 20.0, orbit_s);
            assert!((found_s - expected_s).abs() < 1e-4, "{orbit_s}: {found_s}");
        }
    }

    /// WGS 84: at 45 deg geodetic, the geocentric latitude is 44.8076 deg.
    #[test]
    fn maps_show_geodetic_latitudes() {
        let geocentric = 44.807_576_f64.to_radians();
        let [longitude, latitude] =
            on_map_deg(&(6.37e6 * Vector3::new(0.0, geocentric.cos(), geocentric.sin())));
        assert!((longitude - 90.0).abs() < 1e-9 && (latitude - 45.0).abs() < 1e-4, "{longitude} {latitude}");
    }
}
