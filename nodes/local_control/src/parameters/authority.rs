//! Actuators that cannot turn the platform about some direction are refused before anything moves.

use nalgebra::Vector3;
use whorl_allocation::{Mode, missing_torque};
use whorl_dynamics::PlatformModel;
use whorl_dynamics::platform::Freedom;
use whorl_params::Reader;

/// Parts of a torque smaller than this are none, relative to the largest \[1\].
const NONE: f64 = 1e-6;

/// Refuses jets that, with the motors where those are used too, give no torque in some direction.
pub(super) fn refuse_missing_torque(
    r: &mut Reader<'_>,
    model: &PlatformModel,
    actuators: Mode,
    failed: &[String],
) {
    let jets = model.jets().iter().filter(|jet| !failed.contains(&jet.name));
    let jets: Vec<Vector3<f64>> = jets.map(|jet| jet.torque_b_n_m()).collect();
    let motors: Vec<Vector3<f64>> = if actuators == Mode::Both {
        let mut motors =
            vec![Default::default(); model.actuators.motor_ranges().iter().map(ExactSizeIterator::len).sum()];
        model.actuators.motors(&Default::default(), &[], &mut motors);
        motors.iter().map(|motor| motor.torque_b).collect()
    } else {
        Vec::new()
    };
    let missing = match model.freedom {
        Freedom::Clamped => None,
        Freedom::Hinge { axis_b } => missing_about(&axis_b, &jets, &motors),
        Freedom::OnBearing | Freedom::Free => missing_torque(&jets, &motors),
    };
    let Some(missing) = missing else { return };
    let [x, y, z] = <[f64; 3]>::from(missing).map(|part| if part.abs() < 5e-3 { 0.0 } else { part });
    let without = if failed.is_empty() { "" } else { " that have not failed" };
    let with = if actuators == Mode::Both { "jets and motors" } else { "jets" };
    r.reject(
        "actuators",
        format!(
            "the {with}{without} give no torque along [{x:.2}, {y:.2}, {z:.2}], body axes: what pushes the platform the other way \
             is never countered. A jet whose torque (position_m x force_direction) has a part along that would give it, or a motor; \
             allowed: actuators that give torque in every direction in which the platform turns"
        ),
    );
}

/// The direction along a shaft in which nothing turns it.
fn missing_about(
    axis_b: &Vector3<f64>,
    jets: &[Vector3<f64>],
    motors: &[Vector3<f64>],
) -> Option<Vector3<f64>> {
    let along = |of: &[Vector3<f64>]| -> Vec<f64> { of.iter().map(|tau| tau.dot(axis_b)).collect() };
    let (jets, motors) = (along(jets), along(motors));
    let least = NONE * jets.iter().chain(&motors).fold(0.0, |most: f64, part| most.max(part.abs()));
    let turns = |sign: f64| {
        jets.iter().any(|part| sign * part > least) || motors.iter().any(|part| part.abs() > least)
    };
    [1.0, -1.0].into_iter().find(|sign| !turns(*sign)).map(|sign| axis_b * sign)
}
