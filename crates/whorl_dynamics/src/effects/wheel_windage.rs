//! Air drag on the wheels.

use super::named::{Named as _, parameters, per_wheel};
use super::{Aid, Effect, EffectInfo, EffectKind, Evidence, Need, ParameterSpec};
use crate::platform::Wheel;
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct WheelWindage;

static INFO: EffectInfo = EffectInfo {
    id: "wheel_windage",
    title: "air drag of a wheel",
    explanation: "Air brakes a fast wheel with the square of its speed. The drag is taken as acting between wheel and housing, so the body takes the torque.",
    equation: "torque on wheel j = -d_j Om_j |Om_j|; the body takes the opposite",
    source: "drag in proportion to the dynamic pressure: a rough or spoked wheel, whose momentum coefficient does not depend on the Reynolds number (Schlichting, Boundary-Layer Theory, chapter 21). Smooth disks in a housing have Om^1.75 to Om^1.8 when turbulent (Daily and Nece 1960); over a factor of two in speed the square is within 7 % of that",
    kind: EffectKind::Actuator,
    confusable_with: &["wheel_friction"],
    separated_by: "wheel coast-down from high speed to a stop",
    is_passive: false,
};

parameters! {
    /// Of one wheel.
    Windage(wheel: Wheel) {
        d_n_m_s2: f64 = ParameterSpec::new(
            "_n_m_s2",
            "N m s^2",
            (0.0, wheel.max_torque_n_m / wheel.max_speed_rad_s.powi(2)),
            0.05 * (wheel.max_torque_n_m / wheel.max_speed_rad_s.powi(2)),
            "Drag per squared speed.",
        ),
    }
}

impl Effect for WheelWindage {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        per_wheel::<Windage>(model)
    }

    fn add_wheel_torque_n_m(&self, values: &[f64], environment: &Environment<'_>, torque_n_m: &mut [f64]) {
        for (j, torque) in torque_n_m.iter_mut().enumerate() {
            let speed = environment.wheel_speed(j);
            *torque -= Windage::nth(values, j).d_n_m_s2 * speed * speed.abs();
        }
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::Wheels, Need::WheelCommands]]
    }

    fn aids(&self) -> &'static [Aid] {
        &[Aid::WheelSpeed]
    }
}
