//! The operator's commands to the platform: open-loop manoeuvres drawn at random, a controller, a bench.

use std::f64::consts::{PI, TAU};

use nalgebra::{UnitQuaternion, Vector3};
use rand_pcg::Pcg64;
use whorl_recording::OnInterval;

use super::{between, index, rng, sign};
use crate::truth::run::Span;
use crate::truth::{Body, Hidden, Mechanics, Motion, Plan, SLOT_S, WHEELS, simulate};

/// A kind of run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// Wheel multisines with bias momentum, and jet pulses; full tank.
    Multisine,
    /// Yaw turns both ways, coasting to a stop; warm; moving masses.
    YawTurns,
    /// Low tank and low battery: free swings, pulses, a little of everything.
    Mixed,
    /// One long spin at nearly constant rate: nothing that separates kinds of friction.
    NarrowSpin,
    /// Heading held within a few degrees: nothing that separates room-fixed from body-fixed.
    FixedHeading,
    /// Every pulse of every jet as long as the others: nothing that separates thrust from valve delay.
    OnePulse,
    /// Clamped: each wheel held at about one speed, nothing that separates kinds of drag.
    SteadyWheels,
    /// Spun up to both sides and braked in steps to a full stop.
    CoastDown,
    /// Slow full turns at two tilts.
    SlowTurn,
    /// Wheels swept at rest, then at constant yaw rate.
    WheelSweep,
    /// Single jets, short and long pulses.
    SingleJets,
    /// A controller follows steps of heading and tilt.
    ClosedLoop,
    /// Clamped: wheels swept and coasting.
    Bench,
}

/// Balance attitude at a heading.
fn balanced(body: &Body, yaw_rad: f64) -> UnitQuaternion<f64> {
    let k = -body.mgr_n_m / body.mgr_n_m.norm();
    let level = UnitQuaternion::rotation_between(&k, &Vector3::z()).unwrap_or_default();
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad) * level
}

/// Adds torque on one wheel over a time.
fn push(plan: &mut Plan, wheel: usize, from_s: f64, to_s: f64, torque: impl Fn(f64) -> f64) {
    let slots = plan.wheel_command_n_m.len();
    let first = (from_s / SLOT_S).max(0.0) as usize;
    for slot in first..((to_s / SLOT_S) as usize).min(slots) {
        plan.wheel_command_n_m[slot][wheel] += torque(slot as f64 * SLOT_S);
    }
}

/// A sum of sines with random frequencies and phases, faded in and out.
fn multisine(
    plan: &mut Plan,
    rng: &mut Pcg64,
    wheel: usize,
    span: (f64, f64),
    size_n_m: f64,
    band_hz: (f64, f64),
) {
    let (from, to) = span;
    for _ in 0..6 {
        let f = band_hz.0 * (band_hz.1 / band_hz.0).powf(between(rng, 0.0, 1.0));
        let amplitude = (size_n_m * (f / 0.3).powf(0.7)).min(5.0 * size_n_m) * between(rng, 0.6, 1.4);
        let phase = between(rng, 0.0, TAU);
        push(plan, wheel, from, to, |t| {
            let fade = ((t - from) / 2.0).min((to - t) / 2.0).clamp(0.0, 1.0);
            fade * amplitude * (TAU * f * t + phase).sin()
        });
    }
}

/// Changes the yaw rate with wheel z.
fn yaw_rate_change(plan: &mut Plan, body: &Body, at_s: f64, over_s: f64, change_rad_s: f64) {
    let torque = -body.inertia_kg_m2[(2, 2)] * change_rad_s / over_s;
    push(plan, 2, at_s, at_s + over_s, |_| torque);
}

fn pulses(plan: &mut Plan, rng: &mut Pcg64, span: (f64, f64), mean_gap_s: f64, scale: f64) {
    let jets = plan.pulses.len();
    let mut time_s = span.0;
    let mut free_s = vec![0.0_f64; jets];
    while time_s < span.1 - 1.0 {
        let jet = index(rng, jets);
        let long = between(rng, 0.0, 1.0) < 0.25;
        let length = if long { between(rng, 0.15, 0.35) } else { between(rng, 0.02, 0.12) };
        let length = ((length * scale).max(0.02) * 1000.0).round() / 1000.0;
        // Commands start on slots, as a controller's do, or anywhere.
        let start = (time_s * 1000.0).round() / 1000.0;
        if start > free_s[jet] + 0.2 {
            plan.pulses[jet].push(OnInterval { on_s: start, off_s: start + length });
            free_s[jet] = start + length;
        }
        time_s += between(rng, 0.3, 1.7) * mean_gap_s;
    }
}

/// Moves the masses to and fro.
fn move_ballast(plan: &mut Plan, rng: &mut Pcg64, from_s: f64, size_n_m: f64) {
    plan.has_ballast = true;
    let mut at = Vector3::zeros();
    let mut target = at;
    let mut next_s = from_s;
    for (slot, ballast) in plan.ballast_n_m.iter_mut().enumerate() {
        let time_s = slot as f64 * SLOT_S;
        if time_s >= next_s {
            next_s += between(rng, 4.0, 9.0);
            target = Vector3::new(between(rng, -size_n_m, size_n_m), between(rng, -size_n_m, size_n_m), 0.0);
        }
        // Ten steps a second of at most 3 mN m.
        if slot.is_multiple_of(5) {
            at += (target - at).map(|d: f64| d.clamp(-0.003, 0.003));
        }
        *ballast = at;
    }
}

/// Draws a run. `scale` shrinks what tilts the platform.
fn draw(style: Style, body: &Body, key: &str, scale: f64) -> Plan {
    let mut rng = rng(key);
    let r = &mut rng;
    let duration_s = match style {
        Style::Bench | Style::SteadyWheels => 60.0,
        _ => 90.0,
    };
    let slots = (duration_s / SLOT_S).round() as usize;
    let yaw = between(r, -PI, PI);
    let bias_xy = 25.0;
    let bias = [
        sign(r) * between(r, 10.0, bias_xy) * scale,
        sign(r) * between(r, 10.0, bias_xy) * scale,
        sign(r) * between(r, 50.0, 120.0),
    ];
    let mut plan = Plan {
        name: String::new(),
        duration_s,
        start: Motion {
            q_world_body: balanced(body, yaw),
            omega_b_rad_s: Vector3::zeros(),
            wheel_speed_rad_s: bias,
            wheel_angle_rad: std::array::from_fn(|_| between(r, 0.0, TAU)),
            slosh: None,
            flex: [0.0; 2],
            gas_kg: body.full_gas_kg * between(r, 0.9, 1.0),
            heading_rad: None,
        },
        wheel_command_n_m: vec![[0.0; WHEELS]; slots],
        pulses: vec![Vec::new(); body.jets.len()],
        ballast_n_m: vec![Vector3::zeros(); slots],
        has_ballast: false,
        start_v: body.full_v - between(r, 0.0, 0.3),
        discharge_v_s: between(r, 2e-4, 2e-3),
        start_k: body.ambient_k + between(r, -0.5, 0.5),
        rise_k: between(r, 0.3, 1.5),
        clamped: false,
        closed_loop: style == Style::ClosedLoop,
    };
    let end = duration_s;
    let still = 6.0;
    match style {
        Style::Multisine => {
            for wheel in 0..2 {
                multisine(&mut plan, r, wheel, (still, end), 0.035 * scale, (0.15, 2.5));
            }
            multisine(&mut plan, r, 2, (still, end), 0.06, (0.04, 2.0));
            pulses(&mut plan, r, (still, end), 1.4, scale);
        }
        Style::YawTurns => {
            plan.start_k += between(r, 3.0, 6.0);
            plan.rise_k = between(r, 2.0, 5.0);
            yaw_program(&mut plan, r, body, still, end, 0.22 * scale);
            multisine(&mut plan, r, 0, (end * 0.5, end), 0.03 * scale, (0.2, 2.0));
            multisine(&mut plan, r, 1, (end * 0.5, end), 0.03 * scale, (0.2, 2.0));
            pulses(&mut plan, r, (still, end), 5.0, scale);
            move_ballast(&mut plan, r, 10.0, 0.03 * scale);
        }
        Style::Mixed => {
            plan.start.gas_kg = body.full_gas_kg * between(r, 0.25, 0.4);
            plan.start_v = body.full_v - between(r, 2.0, 3.2);
            plan.start_k += between(r, -2.0, 3.0);
            // Released tilted: a free swing.
            let azimuth = between(r, 0.0, TAU);
            let release = Vector3::new(azimuth.cos(), azimuth.sin(), 0.0) * (0.03 * scale);
            plan.start.q_world_body *= UnitQuaternion::from_scaled_axis(release);
            yaw_program(&mut plan, r, body, 15.0, end, 0.15 * scale);
            for wheel in 0..2 {
                multisine(&mut plan, r, wheel, (25.0, end), 0.025 * scale, (0.15, 2.5));
            }
            multisine(&mut plan, r, 2, (25.0, end), 0.04, (0.1, 2.0));
            pulses(&mut plan, r, (5.0, end), 1.8, scale);
            move_ballast(&mut plan, r, 30.0, 0.02 * scale);
        }
        Style::NarrowSpin => {
            plan.start.omega_b_rad_s = Vector3::z() * between(r, 0.11, 0.14) * sign(r);
            plan.start.wheel_speed_rad_s = [5.0 * scale, -5.0 * scale, 60.0];
            multisine(&mut plan, r, 2, (10.0, end), 0.01, (0.3, 2.0));
        }
        Style::FixedHeading => {
            multisine(&mut plan, r, 2, (still, end), 0.01, (0.4, 2.0));
            plan.start.wheel_speed_rad_s = [4.0, -4.0, 60.0];
            for wheel in 0..2 {
                multisine(&mut plan, r, wheel, (still, end), 0.012 * scale, (0.3, 2.5));
            }
        }
        Style::OnePulse => {
            plan.start.wheel_speed_rad_s = [5.0, -5.0, 60.0];
            let length_s = (0.08 * scale * 1000.0).round() / 1000.0;
            let jets = plan.pulses.len();
            for (i, jet) in (0..jets).cycle().take(((end - 10.0) / 0.8) as usize).enumerate() {
                let on_s = still + 0.8 * i as f64;
                plan.pulses[jet].push(OnInterval { on_s, off_s: on_s + length_s });
            }
        }
        Style::SteadyWheels => {
            plan.clamped = true;
            for wheel in 0..WHEELS {
                let speed = between(r, 120.0, 200.0) * sign(r);
                plan.start.wheel_speed_rad_s[wheel] = speed;
                let of = &body.wheels[wheel];
                let hold = of.viscous_n_m_s * speed + of.coulomb_n_m * speed.signum();
                push(&mut plan, wheel, 0.0, end, |_| hold);
                multisine(&mut plan, r, wheel, (5.0, end), 0.01, (0.3, 2.0));
            }
        }
        Style::CoastDown => {
            plan.start.wheel_speed_rad_s = [6.0 * scale, 6.0 * scale, -60.0];
            let mut rate = 0.0;
            let levels = [0.25, 0.12, 0.05, 0.0, -0.25, -0.12, -0.05, 0.0];
            let hold = (end - 6.0) / levels.len() as f64;
            for (i, level) in levels.into_iter().enumerate() {
                let to = level * scale;
                yaw_rate_change(&mut plan, body, 4.0 + hold * i as f64, 3.0, to - rate);
                rate = to;
            }
        }
        Style::SlowTurn => {
            plan.start.wheel_speed_rad_s = [5.0, 5.0, 60.0];
            yaw_rate_change(&mut plan, body, 3.0, 4.0, 0.14);
            yaw_rate_change(&mut plan, body, end * 0.5, 6.0, -0.28);
            for wheel in 0..2 {
                multisine(&mut plan, r, wheel, (6.0, end), 0.025 * scale, (0.15, 0.6));
            }
        }
        Style::WheelSweep => {
            for wheel in 0..WHEELS {
                multisine(&mut plan, r, wheel, (4.0, end), 0.04 * scale, (0.15, 2.5));
            }
            yaw_rate_change(&mut plan, body, end * 0.5, 4.0, 0.12 * scale);
        }
        Style::SingleJets => {
            pulses(&mut plan, r, (4.0, end), 1.0, scale);
        }
        Style::ClosedLoop => {
            plan.start.wheel_speed_rad_s = [8.0, -8.0, 40.0];
            pulses(&mut plan, r, (10.0, end), 3.0, 0.6 * scale);
        }
        Style::Bench => {
            plan.clamped = true;
            for wheel in 0..WHEELS {
                let first = between(r, 100.0, 250.0) * sign(r);
                plan.start.wheel_speed_rad_s[wheel] = first;
                // Coast, brake through zero, coast again, wiggle.
                let brake = -first * body.wheels[wheel].spin_inertia_kg_m2 * 1.6 / 12.0;
                push(&mut plan, wheel, 15.0, 27.0, |_| brake);
                multisine(&mut plan, r, wheel, (40.0, end), 0.05, (0.1, 2.0));
            }
        }
    }
    plan
}

/// Random yaw turns both ways with coasting between, back to rest now and then.
fn yaw_program(plan: &mut Plan, r: &mut Pcg64, body: &Body, from_s: f64, to_s: f64, largest: f64) {
    let mut rate = 0.0;
    let mut time_s = from_s;
    let mut direction = sign(r);
    while time_s < to_s - 12.0 {
        let next = if between(r, 0.0, 1.0) < 0.25 { 0.0 } else { direction * largest * between(r, 0.4, 1.0) };
        direction = -direction;
        let over = between(r, 3.0, 6.0);
        yaw_rate_change(plan, body, time_s, over, next - rate);
        rate = next;
        time_s += over + between(r, 5.0, 14.0);
    }
}

/// A lab's own controller: proportional-derivative about a stepped reference, wheels only.
fn controller(
    body: &Body,
    key: &str,
) -> impl FnMut(f64, &Vector3<f64>, &UnitQuaternion<f64>) -> [f64; WHEELS] + use<> {
    let mut r = rng(&format!("{key}/controller"));
    let (mut target, mut next_s) = (None, 8.0);
    let inertia = body.inertia_kg_m2;
    let mgr = body.mgr_n_m;
    let drawn = [2.0_f64, 2.0, 0.6];
    move |time_s, rate, q| {
        let aim = *target.get_or_insert(*q);
        let mut aim = aim;
        if time_s >= next_s {
            next_s += between(&mut r, 9.0, 15.0);
            let tilt = Vector3::new(between(&mut r, -0.01, 0.01), between(&mut r, -0.01, 0.01), 0.0);
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), between(&mut r, -0.4, 0.4));
            aim = turn * balanced_at(&mgr, q) * UnitQuaternion::from_scaled_axis(tilt);
            target = Some(aim);
        }
        let noisy_rate = rate.map(|x| x + 1e-3 * super::normal(&mut r));
        let error = (aim.inverse() * q).scaled_axis();
        let torque = -(inertia * (error.component_mul(&Vector3::new(0.16, 0.16, 0.09)))
            + inertia * noisy_rate.component_mul(&Vector3::new(drawn[0] * 0.4, drawn[1] * 0.4, drawn[2])));
        std::array::from_fn(|w| (-torque[w]).clamp(-0.3, 0.3))
    }
}

/// Balanced at the heading of `q`.
fn balanced_at(mgr: &Vector3<f64>, q: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    let k = -mgr / mgr.norm();
    let level = UnitQuaternion::rotation_between(&k, &Vector3::z()).unwrap_or_default();
    let yaw = |q: &UnitQuaternion<f64>| {
        let x = q * Vector3::x();
        x.y.atan2(x.x)
    };
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw(q) - yaw(&level)) * level
}

/// A whole plan, shrunk until the platform stays off its tilt stop; commands of a controller filled in.
#[must_use]
pub fn plan(style: Style, name: &str, body: &Body, hidden: &Hidden, key: &str) -> Plan {
    let mut scale = 1.25;
    let mechanics = Mechanics::new(body.clone(), hidden.clone());
    loop {
        let mut plan = draw(style, body, key, scale);
        plan.name = name.to_owned();
        let span = Span {
            from_slot: 0,
            to_slot: plan.wheel_command_n_m.len(),
            step_s: 0.01,
            mark_every: usize::MAX,
        };
        let start = plan.start.clone();
        let tilt = if style == Style::ClosedLoop {
            let mut control = controller(body, key);
            simulate(&mechanics, &mut plan, &start, span, Some(&mut control)).largest_tilt_rad
        } else {
            simulate(&mechanics, &mut plan, &start, span, None).largest_tilt_rad
        };
        if tilt < 0.9 * body.tilt_max_rad || scale < 0.05 || plan.clamped {
            return plan;
        }
        scale *= 0.85;
    }
}
