//! `whorl balance`: how far to move which balance mass.

use anyhow::{Context, bail};
use nalgebra::{Unit, Vector3};
use serde_json::{Value, json};
use whorl_commands::identify::findings_as_json;
use whorl_dynamics::PlatformModel;
use whorl_dynamics::actuators::moving_masses::MovingMass;
use whorl_dynamics::balance::{Ballast, plan_balance};
use whorl_dynamics::mass_parameters::gravity_offset_b_n_m;
use whorl_identification::{Finding, Options, identify};
use whorl_math::GRAVITY_M_S2;

use crate::identify::print_findings;
use crate::output::{JsonArgument, say};
use crate::runs::RunArguments;

#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    runs: RunArguments,
    /// Movable mass, as NAME:AXIS:WEIGHT_N:TRAVEL_MM with AXIS x, y, z or three numbers, e.g.
    /// battery:1,1,0:30:50; may be given several times [default: the model's moving_masses; without any x, y and z with 20 N and +-100 mm each].
    #[arg(long, value_name = "BALLAST")]
    ballast: Vec<String>,
    /// Desired gravity offset about z [N m]; negative is stable.
    #[arg(long, allow_negative_numbers = true, value_name = "N_M")]
    target_z: Option<f64>,
    #[command(flatten)]
    json: JsonArgument,
}

/// Carries out `whorl balance`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let given: Vec<Ballast> = arguments.ballast.iter().map(|s| parse(s)).collect::<Result<_, _>>()?;
    if arguments.target_z.is_some_and(|z| !z.is_finite()) {
        bail!("--target-z is not a number");
    }
    let runs = arguments.runs.read()?;
    let ballasts = if given.is_empty() { of_model(&runs.known.model)? } else { given };
    let found = identify(&runs.training, &runs.known.model, &runs.known.prior, &Options::default())?;
    print_findings(&found.findings);
    if !found.usable() {
        bail!("these runs do not determine the centre of mass");
    }
    let offset = gravity_offset_b_n_m(&found.estimate);
    let stddev = found.stddev().fixed_rows::<3>(6).into_owned();
    say!(
        "gravity offset {:.1}, {:.1}, {:.1} N mm (+- {:.1}, {:.1}, {:.1})",
        1e3 * offset.x,
        1e3 * offset.y,
        1e3 * offset.z,
        1e3 * stddev.x,
        1e3 * stddev.y,
        1e3 * stddev.z
    );
    let target = Vector3::new(0.0, 0.0, arguments.target_z.unwrap_or(offset.z));
    let (moves_m, after) = plan_balance(&offset, &target, &ballasts);
    let level_torque_n_m = after.xy().norm();
    for (ballast, moved) in ballasts.iter().zip(&moves_m) {
        let end = if moved.abs() < ballast.travel_m { "" } else { ", the end of its travel" };
        say!("  move {} by {:+.2} mm{end}", ballast.name, 1e3 * moved);
    }
    say!(
        "predicted offset {:.2}, {:.2}, {:.2} N mm; torque left when level {:.2} N mm (+- {:.2})",
        1e3 * after.x,
        1e3 * after.y,
        1e3 * after.z,
        1e3 * level_torque_n_m,
        1e3 * stddev.xy().norm()
    );
    let above = Finding::warning(
        "The centre of mass may then lie above the bearing's centre: the platform would tip over. Leave a small negative z as target.".to_owned(),
    );
    let findings: Vec<Finding> = (after.z > -2.0 * stddev.z).then_some(above).into_iter().collect();
    print_findings(&findings);
    let moves: Vec<Value> = ballasts
        .iter()
        .zip(&moves_m)
        .map(|(ballast, moved)| json!({"ballast": ballast.name, "move_mm": 1e3 * moved}))
        .collect();
    let axes = |v: &Vector3<f64>| [v.x, v.y, v.z];
    arguments.json.write(|| {
        Ok(json!({
            "schema": 1,
            "platform": runs.known.platform,
            "gravity_offset_b_n_m": axes(&offset),
            "gravity_offset_stddev_b_n_m": axes(&stddev),
            "moves": moves,
            "predicted_offset_b_n_m": axes(&after),
            "level_torque_n_m": level_torque_n_m,
            "findings": findings_as_json(&findings),
        }))
    })
}

/// The platform's own masses; ideal ones where its file lists none.
fn of_model(model: &PlatformModel) -> anyhow::Result<Vec<Ballast>> {
    let masses = &model.moving_masses().0;
    if masses.is_empty() {
        let usual = ["actuator_x:x:20:100", "actuator_y:y:20:100", "actuator_z:z:20:100"];
        return usual.iter().map(|s| parse(s)).collect();
    }
    let ballast = |mass: &MovingMass| Ballast {
        name: mass.name.clone(),
        axis_b: mass.axis_b,
        weight_n: mass.mass_kg * GRAVITY_M_S2,
        travel_m: mass.travel_m,
    };
    Ok(masses.iter().map(ballast).collect())
}

fn parse(text: &str) -> anyhow::Result<Ballast> {
    let refuse =
        || format!("--ballast {text}: allowed: NAME:AXIS:WEIGHT_N:TRAVEL_MM, e.g. actuator_x:x:20:100");
    let parts: Vec<&str> = text.split(':').collect();
    let [name, axis, weight, travel] = parts.as_slice() else { bail!(refuse()) };
    let axis = match *axis {
        "x" => Vector3::x(),
        "y" => Vector3::y(),
        "z" => Vector3::z(),
        numbers => {
            let values: Vec<f64> =
                numbers.split(',').map(str::parse).collect::<Result<_, _>>().with_context(refuse)?;
            let [x, y, z] = values.as_slice() else { bail!(refuse()) };
            Vector3::new(*x, *y, *z)
        }
    };
    let axis_b = Unit::try_new(axis, 1e-9).with_context(refuse)?;
    let weight_n: f64 = weight.parse().with_context(refuse)?;
    let travel_mm: f64 = travel.parse().with_context(refuse)?;
    if !(weight_n > 0.0 && travel_mm > 0.0 && weight_n.is_finite() && travel_mm.is_finite()) {
        bail!(refuse());
    }
    Ok(Ballast { name: (*name).to_owned(), axis_b, weight_n, travel_m: 1e-3 * travel_mm })
}
