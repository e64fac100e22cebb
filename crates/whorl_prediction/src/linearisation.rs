//! Derivatives of the plant, and where they hold.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::plant::{LinearisedPlant, Plant, ROTATION};
use whorl_math::vertical_b;
use whorl_recording::Channel;

use crate::prepared::Prepared;

/// Where derivatives were made, as far as they depend on it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Place {
    q_world_body: UnitQuaternion<f64>,
    /// Rate of the body, and what its wheels' momentum would be as a rate of it [rad/s].
    rates_rad_s: [Vector3<f64>; 2],
    /// Which wheels are held,
    held: u64,
    /// and which contacts touch.
    touching: [bool; 2],
}

impl Place {
    pub fn of(plant: &Plant) -> Self {
        let (model, state) = (plant.gyrostat().model(), plant.state());
        let inertia_kg_m2 = model.mass_properties.inertia_b_kg_m2().trace() / 3.0;
        let wheels = model.wheels().iter().zip(state.wheel_speed_rad_s());
        let momentum: Vector3<f64> = wheels
            .map(|(wheel, speed)| wheel.spin_axis_b.into_inner() * (wheel.spin_inertia_kg_m2 * speed))
            .sum();
        let held = plant.held_wheels().fold(0, |bits, on| bits << 1 | u64::from(on));
        Self {
            q_world_body: state.q_world_body,
            rates_rad_s: [state.omega_wb_b_rad_s, momentum / inertia_kg_m2],
            held,
            touching: plant.touching(),
        }
    }

    /// Whether anything touches.
    pub fn touches(&self) -> bool {
        self.touching != [false; 2]
    }

    /// How far another place is: an angle, and rates against the fastest motion, or 1 rad/s; infinite on another branch.
    pub fn distance_rad(&self, other: &Self, fastest_1_s: f64) -> f64 {
        if (self.held, self.touching) != (other.held, other.touching) {
            return f64::INFINITY;
        }
        let angle = 2.0 * (self.q_world_body.inverse() * other.q_world_body).imag().norm();
        let rates = self.rates_rad_s.iter().zip(&other.rates_rad_s).map(|(a, b)| (a - b).norm()).sum::<f64>();
        angle + rates / fastest_1_s.max(1.0)
    }
}

/// Share of the derivatives by attitude below which motion and readings do not depend on the heading: differences that make them
/// err by less than a hundredth of it.
const NOTHING: f64 = 1e-6;

/// The vertical at the start, body axes, if neither the motion nor a reading depends on how far the platform is turned about it.
///
/// Such a heading can be anything, and a filter takes the one that it has, at the start and all the way (METHOD.md, "Start"). What a body's axes are
/// turned by about others than the vertical does not depend on the heading, so that nothing is lost.
pub(crate) fn unseen_axis(
    case: &Prepared<'_>,
    plant: &Plant,
    linearised: &LinearisedPlant,
) -> Option<Vector3<f64>> {
    let vertical_b = vertical_b(&plant.state().q_world_body);
    let seen = case.tracks.iter().any(|track| track.channel == Channel::Vector);
    (!seen && !matters(linearised, &vertical_b)).then_some(vertical_b)
}

/// Whether a turn about the vertical changes what the plant does next, or what its sensors read.
fn matters(linearised: &LinearisedPlant, vertical_b: &Vector3<f64>) -> bool {
    let motion = linearised.rate_by_state.fixed_columns::<3>(ROTATION.start);
    let readings = linearised.imu_by_state.fixed_columns::<3>(ROTATION.start);
    // By row: a torque is no speed. How a turn itself goes on does not count.
    let mut rows = motion.row_iter().skip(ROTATION.end).chain(readings.row_iter());
    rows.any(|row| (row * vertical_b).x.abs() > NOTHING * row.norm())
}
