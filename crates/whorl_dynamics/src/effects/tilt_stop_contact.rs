//! Contact with the bearing's stop; also the law of the stop in the base model.

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::{Clues, Effect, EffectInfo, EffectKind, ParameterSpec, Start, Starter};
use crate::platform::TiltLimit;
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct TiltStopContact;

static INFO: EffectInfo = EffectInfo {
    id: "tilt_stop_contact",
    title: "contact with a tilt stop",
    explanation: "Beyond an angle smaller than the model's limit something touches: a spring and damper that push back only, seen as impulses always at the same tilt.",
    equation: "g = max(0, k (tilt - angle) + c d(tilt)/dt) about the axis that rights the platform, when tilt > angle",
    source: "one-sided Kelvin-Voigt contact without adhesion",
    kind: EffectKind::Torque,
    confusable_with: &[],
    separated_by: "slow tilts into the stop",
    is_passive: false,
};

parameters! {
    Contact(model: PlatformModel) {
        k_n_m_rad: f64 = ParameterSpec::new(K, "N m/rad", (0.0, 5000.0), 100.0, "Stiffness."),
        c_n_m_s: f64 = ParameterSpec::new(C, "N m s", (0.0, 500.0), 10.0, "Damping."),
        angle_rad: f64 = ParameterSpec::new(
            ANGLE,
            "rad",
            (0.0, limit_rad(model)),
            0.2 * limit_rad(model),
            "Tilt at first contact.",
        )
        .with_neutral(limit_rad(model))
        .floating_shape(),
    }
}

const K: &str = "k_n_m_rad";
const C: &str = "c_n_m_s";
const ANGLE: &str = "angle_rad";

/// Angles that are tried, over the largest tilt that lasted.
const ANGLES: [f64; 8] = [0.995, 0.985, 0.97, 0.95, 0.92, 0.88, 0.8, 0.65];
/// A contact this near the platform's own stop is that stop \[rad\].
const OWN_STOP_RAD: f64 = 0.005;

/// Tilt at the platform's own stop.
fn limit_rad(model: &PlatformModel) -> f64 {
    model.tilt_limit.max_rad()
}

impl Effect for TiltStopContact {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Contact::specs(model)
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        let contact = Contact::of(values);
        let stop = environment.model.tilt_limit.with_max_rad(contact.angle_rad);
        contact_torque_b_n_m(
            &stop,
            contact.k_n_m_rad,
            contact.c_n_m_s,
            &environment.vertical_b,
            &environment.omega_wb_b_rad_s,
            environment.touching,
        )
    }

    fn is_fed_forward(&self, _model: &PlatformModel) -> bool {
        // Pushing against what pushes back would hold the platform at its stop.
        false
    }

    fn starts(&self, model: &PlatformModel, clues: &Clues<'_>) -> Option<Vec<Start>> {
        let starter = Starter::new(self, model);
        // The platform's own stop is not a missing effect.
        let is_within = |angle_rad: &f64| *angle_rad <= limit_rad(model) - OWN_STOP_RAD;
        let angles = ANGLES.into_iter().map(|share| share * clues.largest_tilt_rad).filter(is_within);
        let starts = angles.flat_map(|angle_rad| {
            let origin = starter.at(&[(ANGLE, angle_rad)]);
            let stiffness = starter.along(&origin, K);
            [vec![stiffness.clone()], vec![stiffness, starter.along(&origin, C)]]
        });
        Some(starts.collect())
    }

    fn contact_tilt_rad(&self, values: &[f64]) -> Option<f64> {
        Some(Contact::of(values).angle_rad)
    }
}

/// Whether a one-sided contact touches, as far as its torque is concerned.
///
/// The torque jumps when a contact begins and has a kink when it ends; a Runge-Kutta step across loses its order there.
/// An integrator keeps the branch over a step and cuts the step where the contact begins or ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Touching {
    /// As tilt and rate say.
    #[default]
    AsItIs,
    /// The branch without contact, also a little beyond its end.
    No,
    /// The branch with contact, also a little beyond its end.
    Yes,
}

impl Touching {
    /// The branch on which a state lies.
    pub(crate) fn branch(touches: bool) -> Self {
        if touches { Self::Yes } else { Self::No }
    }
}

/// Whether there is no torque for certain: a cheap test to come first, as a stop is rarely touched.
#[inline]
pub(crate) fn is_clear(stop: &TiltLimit, vertical_b: &Vector3<f64>, touching: Touching) -> bool {
    let far = || match stop {
        // cos(x) <= 1 - x^2/2 + x^4/24.
        TiltLimit::Cone { max_rad } => {
            let square = max_rad * max_rad;
            vertical_b.z > 1.0 - square * (0.5 - square / 24.0)
        }
        // sin(x) >= x - x^3/6.
        TiltLimit::Pitch { max_rad } => vertical_b.x.abs() < max_rad * (1.0 - max_rad * max_rad / 6.0),
    };
    match touching {
        Touching::No => true,
        Touching::Yes => false,
        Touching::AsItIs => far(),
    }
}

/// Torque of a one-sided spring and damper at `stop`, body axes [N m].
///
/// Cone: the angle is the tilt, cos(tilt) = z_b . k_b; a rotation of the body about
/// n = k_b x z_b / |k_b x z_b| increases it. Pitch: the angle is the elevation of body x above the
/// horizontal, sin(e) = x_b . k_b; a rotation about n = x_b x k_b / |x_b x k_b| increases it. Both
/// follow from d(k_b)/dt = -w x k_b.
pub(crate) fn contact_torque_b_n_m(
    stop: &TiltLimit,
    stiffness_n_m_rad: f64,
    damping_n_m_s: f64,
    vertical_b: &Vector3<f64>,
    omega_wb_b_rad_s: &Vector3<f64>,
    touching: Touching,
) -> Vector3<f64> {
    if is_clear(stop, vertical_b, touching) {
        return Vector3::zeros();
    }
    let branch = touching == Touching::Yes;
    // `axis_b`: rotation of the body about it increases the angle at unit rate.
    let (depth_rad, axis_b) = match stop {
        TiltLimit::Cone { max_rad } => {
            let sine = vertical_b.x.hypot(vertical_b.y);
            // k x z; upside down it has no direction and no torque is defined.
            let Some(axis_b) = Vector3::new(vertical_b.y, -vertical_b.x, 0.0).try_normalize(1e-12) else {
                return Vector3::zeros();
            };
            (sine.atan2(vertical_b.z) - max_rad, axis_b)
        }
        TiltLimit::Pitch { max_rad } => {
            // x . dk/dt = -x . (w x k) = w . (x x k).
            let Some(axis_b) = Vector3::new(0.0, -vertical_b.z, vertical_b.y).try_normalize(1e-12) else {
                return Vector3::zeros();
            };
            let elevation_rad = vertical_b.x.clamp(-1.0, 1.0).asin();
            (elevation_rad.abs() - max_rad, axis_b * elevation_rad.signum())
        }
    };
    let force_n_m = stiffness_n_m_rad * depth_rad + damping_n_m_s * omega_wb_b_rad_s.dot(&axis_b);
    if branch {
        return -force_n_m * axis_b;
    }
    if depth_rad <= 0.0 { Vector3::zeros() } else { -force_n_m.max(0.0) * axis_b }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;
    use whorl_math::vertical_b;

    #[test]
    fn the_stop_rights_the_platform_along_the_shortest_way() {
        for azimuth in [0.0, 1.0, 2.5, 4.0] {
            let axis = Vector3::new(f64::cos(azimuth), f64::sin(azimuth), 0.0);
            let q = UnitQuaternion::from_scaled_axis(axis * 0.1);
            let cone = TiltLimit::Cone { max_rad: 0.09 };
            // Tilted by +0.1 about `axis`: the torque must be -k * 0.01 about it.
            let torque = contact_torque_b_n_m(&cone, 100.0, 0.0, &vertical_b(&q), &Vector3::zeros(), Touching::AsItIs);
            assert!((torque + axis * 1.0).norm() < 1e-9, "{torque}");
            // Damping acts on the way in only.
            let inwards = contact_torque_b_n_m(&cone, 100.0, 10.0, &vertical_b(&q), &(axis * 0.05), Touching::AsItIs);
            assert!((inwards + axis * 1.5).norm() < 1e-9, "{inwards}");
            let outwards = contact_torque_b_n_m(&cone, 100.0, 10.0, &vertical_b(&q), &(axis * -0.5), Touching::AsItIs);
            assert_eq!(outwards.norm(), 0.0, "a stop does not pull");
        }
    }

    #[test]
    fn the_pitch_stop_leaves_yaw_and_roll_free() {
        let stop = TiltLimit::Pitch { max_rad: 0.5 };
        for (roll, pitch, yaw) in [(2.0, 0.6, 1.0), (0.0, -0.6, 0.0), (-1.0, 0.6, 3.0)] {
            let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
            let torque = contact_torque_b_n_m(&stop, 100.0, 0.0, &vertical_b(&q), &Vector3::zeros(), Touching::AsItIs);
            // By virtual work: rotating the body a little along the torque must lower |elevation|
            // at unit rate, and the size is k times the depth.
            assert!((torque.norm() - 10.0).abs() < 1e-9, "{torque}");
            let step = torque * 1e-7;
            let turned = q * UnitQuaternion::from_scaled_axis(step);
            let elevation = |q: &UnitQuaternion<f64>| (q * Vector3::x()).z.asin().abs();
            let fall = elevation(&q) - elevation(&turned);
            assert!((fall / step.norm() - 1.0).abs() < 1e-5, "{fall}");
        }
        let free = UnitQuaternion::from_euler_angles(2.0, 0.4, 1.0);
        let none = contact_torque_b_n_m(&stop, 100.0, 10.0, &vertical_b(&free), &Vector3::x(), Touching::AsItIs);
        assert_eq!(none.norm(), 0.0);
    }
}
