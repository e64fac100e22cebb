//! Two independent derivations of the motion must agree: the challenge's (momenta, Rodrigues
//! parameters) and the library's (rates, quaternions).

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test fails by panicking")]

use nalgebra::Vector3;
use whorl_challenge::detectability::Lens;
use whorl_challenge::scenario::{NoiseLevels, Style, plan};
use whorl_challenge::truth::run::Span;
use whorl_challenge::truth::{Body, Hidden, Mechanics, Plan, SLOT_S, Trace, simulate};
use whorl_dynamics::{InitialState, Plant, PlatformModel};

fn model() -> PlatformModel {
    let mut model = PlatformModel::whorl_1_reference();
    for wheel in model.wheels_mut() {
        wheel.spin_inertia_kg_m2 = 0.02;
        // Dry friction is smooth here and a step there: they differ where a wheel turns round.
        wheel.coulomb_friction_n_m = 0.0;
    }
    model.mass_properties = whorl_dynamics::MassProperties::new(
        *model.mass_properties.inertia_b_kg_m2(),
        *model.mass_properties.gravity_offset_b_n_m(),
        80.0,
    )
    .unwrap();
    model
}

fn whole(plan: &Plan, step_s: f64) -> Span {
    Span { from_slot: 0, to_slot: plan.wheel_command_n_m.len(), step_s, mark_every: usize::MAX }
}

fn run(mechanics: &Mechanics, plan: &Plan, step_s: f64) -> Trace {
    let mut plan = plan.clone();
    let start = plan.start.clone();
    let span = whole(&plan, step_s);
    simulate(mechanics, &mut plan, &start, span, None)
}

/// The library's plant through the same plan: attitude and rate at the end.
fn library(model: &PlatformModel, plan: &Plan) -> whorl_dynamics::Truth {
    let initial = InitialState {
        time_ns: 0,
        q_world_body: plan.start.q_world_body,
        omega_wb_b_rad_s: plan.start.omega_b_rad_s,
        wheel_speed_rad_s: plan.start.wheel_speed_rad_s.to_vec(),
    };
    let mut plant = Plant::new(model, &initial, 1).unwrap();
    let ns = |s: f64| (s * 1e9).round() as i64;
    for (slot, command) in plan.wheel_command_n_m.iter().enumerate() {
        let (from, to) = (slot as f64 * SLOT_S, (slot + 1) as f64 * SLOT_S);
        plant.command_wheels(command).unwrap();
        for (jet, pulses) in plan.pulses.iter().enumerate() {
            for pulse in pulses.iter().filter(|p| p.on_s >= from - 1e-9 && p.on_s < to - 1e-9) {
                plant.command_jet_pulse(jet, ns(pulse.on_s), pulse.off_s - pulse.on_s).unwrap();
            }
        }
        plant.advance_to(ns(to)).unwrap();
    }
    plant.truth()
}

#[test]
fn motion_agrees_with_the_library_without_effects() {
    let model = model();
    let body = Body::as_drawn(&model);
    let hidden = Hidden::none(3, body.jets.len());
    for style in [Style::Multisine, Style::SlowTurn, Style::SingleJets] {
        let plan = plan(style, "agree", &body, &hidden, "agree");
        let trace = run(&Mechanics::new(body.clone(), hidden.clone()), &plan, 1e-3);
        let mine = trace.marks.last().unwrap();
        let theirs = library(&model, &plan);
        let angle = mine.q_world_body.angle_to(&theirs.q_world_body);
        let rate = (mine.omega_b_rad_s - theirs.omega_wb_b_rad_s).norm();
        assert!(trace.largest_tilt_rad > 0.02, "{style:?} hardly moves");
        assert!(angle < 1e-6 && rate < 1e-6, "{style:?}: {angle:.2e} rad, {rate:.2e} rad/s");
        let wheel = (mine.wheel_speed_rad_s[2] - theirs.wheel_speed_rad_s[2]).abs();
        assert!(wheel < 1e-5, "{style:?}: wheel {wheel:.2e} rad/s");
    }
}

#[test]
fn the_fine_step_has_converged() {
    let model = model();
    let body = Body::as_drawn(&model);
    let mut hidden = Hidden::none(3, body.jets.len());
    hidden.plenum_s = 0.01;
    hidden.slosh_kg = 0.4;
    hidden.flexible_sqrt_kg_m = Vector3::new(0.1, 0.2, 0.0);
    hidden.coulomb_n_m = 0.003;
    let plan = plan(Style::Multisine, "step", &body, &hidden, "step");
    let mechanics = Mechanics::new(body, hidden);
    let (coarse, fine) = (run(&mechanics, &plan, 2e-3), run(&mechanics, &plan, 5e-4));
    let (a, b) = (coarse.marks.last().unwrap(), fine.marks.last().unwrap());
    assert!((a.omega_b_rad_s - b.omega_b_rad_s).norm() < 1e-6);
    assert!(a.q_world_body.angle_to(&b.q_world_body) < 1e-6);
}

#[test]
fn energy_and_momentum_are_kept_without_losses() {
    let model = model();
    let mut body = Body::as_drawn(&model);
    for wheel in &mut body.wheels {
        wheel.viscous_n_m_s = 0.0;
        wheel.coulomb_n_m = 0.0;
    }
    let hidden = Hidden::none(3, body.jets.len());
    let mut swing = plan(Style::FixedHeading, "swing", &body, &hidden, "swing");
    swing.wheel_command_n_m.iter_mut().for_each(|u| *u = [0.0; 3]);
    swing.start.omega_b_rad_s = Vector3::new(0.02, -0.03, 0.1);
    swing.start.wheel_speed_rad_s = [40.0, -30.0, 100.0];
    let mechanics = Mechanics::new(body, hidden);
    let trace = run(&mechanics, &swing, 2e-3);
    let (first, last) = (mechanics.state(&swing.start), mechanics.state(trace.marks.last().unwrap()));
    let spread = mechanics.energy_j(&last) - mechanics.energy_j(&first);
    assert!(spread.abs() < 1e-7, "energy moved by {spread:.2e} J");
    // Gravity has no moment about the vertical.
    assert!((last[5] - first[5]).abs() < 1e-9, "vertical momentum moved");
    assert!((last[3] - first[3]).abs() > 1e-3, "the horizontal momentum precesses");
}

#[test]
fn one_torque_under_two_names_has_no_separation() {
    let model = model();
    let prior = whorl_dynamics::ModelPrior::typical(&model);
    let body = Body::as_drawn(&model);
    let none = Hidden::none(3, body.jets.len());
    let plans = [plan(Style::YawTurns, "names", &body, &none, "names")];
    let lens = Lens::new(&body, &plans, &NoiseLevels::of(&model), &prior);
    // A turbine about the vertical is a draught about it: g = t k. Large enough to turn the platform by degrees.
    let draught =
        |t: &[f64]| Hidden { air_current_world_n_m: Vector3::new(t[0], t[1], t[2]) * 2e-3, ..none.clone() };
    let slope = |axis: usize| {
        let mut t = [0.0; 3];
        t[axis] = 0.05;
        lens.see(&draught(&t)).times(20.0)
    };
    let slopes = [slope(0), slope(1), slope(2)];
    let turbine = lens.see(&Hidden { turbine_vertical_n_m: 2e-3, ..none.clone() });
    let shows = lens.lambda(&turbine);
    assert!(shows > 500.0, "{shows}");
    // Only the cost of one plausible step remains.
    let left = lens.beyond_fitted(&turbine, &slopes, draught);
    assert!(left < 0.2, "{left} of {shows}");
    // Friction is no draught.
    let friction = lens.see(&Hidden { viscous_n_m_s: 0.01, ..none.clone() });
    let (left, shows) = (lens.beyond_fitted(&friction, &slopes, draught), lens.lambda(&friction));
    assert!(left > 0.3 * shows, "{left} of {shows}");
}
