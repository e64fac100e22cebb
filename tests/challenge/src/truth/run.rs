//! A run: its commands, and the readings of ideal sensors.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_recording::OnInterval;

use super::filter::{Filtering, Seen};
use super::motion::{Inputs, Instant, Mechanics, Motion, State, WHEELS};
use super::valves::Valves;

/// Length of a command slot \[s\].
pub const SLOT_S: f64 = 0.02;
/// Inertial and wheel samples per slot.
const SAMPLES_PER_SLOT: usize = 2;

/// What happens in a run besides the platform's own physics.
#[derive(Debug, Clone)]
pub struct Plan {
    pub name: String,
    pub duration_s: f64,
    pub start: Motion,
    /// Wheel torques, one per slot [N m].
    pub wheel_command_n_m: Vec<[f64; WHEELS]>,
    pub pulses: Vec<Vec<OnInterval>>,
    /// Moment of the linear mass actuators as commanded, one per slot [N m].
    pub ballast_n_m: Vec<Vector3<f64>>,
    pub has_ballast: bool,
    pub start_v: f64,
    pub discharge_v_s: f64,
    /// Temperature = start + rise (1 - exp(-t/60 s)).
    pub start_k: f64,
    pub rise_k: f64,
    /// The platform is clamped; only wheels move.
    pub clamped: bool,
    pub closed_loop: bool,
}

impl Plan {
    /// Temperature at a time \[K\].
    #[must_use]
    pub fn temperature_k(&self, time_s: f64) -> f64 {
        self.start_k + self.rise_k * (1.0 - (-time_s / 60.0).exp())
    }

    /// Bus voltage in a slot \[V\].
    #[must_use]
    pub fn volt(&self, slot: usize, sag_v_n_m: f64) -> f64 {
        let load: f64 = self.wheel_command_n_m.get(slot).map_or(0.0, |u| u.iter().map(|x| x.abs()).sum());
        self.start_v - self.discharge_v_s * slot as f64 * SLOT_S - sag_v_n_m * load
    }
}

/// What ideal sensors see: sensor effects included, noise and turn-on biases not.
#[derive(Debug, Clone, Default)]
pub struct Trace {
    /// Stamps of inertial and wheel samples \[s\].
    pub time_s: Vec<f64>,
    pub gyro_b_rad_s: Vec<Vector3<f64>>,
    pub force_b_m_s2: Vec<Vector3<f64>>,
    pub wheel_rad_s: Vec<[f64; WHEELS]>,
    /// 10 Hz.
    pub vector_time_s: Vec<f64>,
    pub direction_b: Vec<Vector3<f64>>,
    pub volt: Vec<f64>,
    pub pressure_pa: Vec<f64>,
    pub temperature_k: Vec<f64>,
    /// Motion at the start of every segment asked for, and at the end.
    pub marks: Vec<Motion>,
    pub largest_tilt_rad: f64,
    pub largest_rate_rad_s: f64,
    /// True attitude at each inertial stamp.
    pub q_world_body: Vec<UnitQuaternion<f64>>,
    pub omega_b_rad_s: Vec<Vector3<f64>>,
}

/// How to simulate.
#[derive(Debug, Clone, Copy)]
pub struct Span {
    pub from_slot: usize,
    pub to_slot: usize,
    pub step_s: f64,
    /// Number of slots between marks.
    pub mark_every: usize,
}

/// A controller: gets time, the measured rate and the true attitude, gives wheel torques.
pub type Controller<'a> = dyn FnMut(f64, &Vector3<f64>, &UnitQuaternion<f64>) -> [f64; WHEELS] + 'a;

/// Play of a spindle: the mass follows only when pushed.
fn with_play(commands: &[Vector3<f64>], gap: &Vector3<f64>) -> Vec<Vector3<f64>> {
    let mut at = commands.first().copied().unwrap_or_default();
    commands
        .iter()
        .map(|command| {
            for i in 0..3 {
                at[i] = at[i].clamp(command[i] - 0.5 * gap[i], command[i] + 0.5 * gap[i]);
            }
            at
        })
        .collect()
}

/// Valves of a run on this platform.
fn valves(mechanics: &Mechanics, plan: &Plan) -> Valves {
    let (body, hidden) = (&mechanics.body, &mechanics.hidden);
    let delay_s = |jet: usize, pulse: &OnInterval| {
        let slot = (pulse.on_s / SLOT_S).floor() as usize;
        let drop = (body.full_v - plan.volt(slot, body.sag_v_n_m)).max(0.0);
        (
            body.jets[jet].opening_s + hidden.valve_on_s + hidden.valve_delay_s_v * drop,
            body.jets[jet].closing_s + hidden.valve_off_s,
        )
    };
    Valves::new(&plan.pulses, delay_s, hidden.plenum_s)
}

/// Moves the platform through a part of a plan, from `start`.
pub fn simulate(
    mechanics: &Mechanics,
    plan: &mut Plan,
    start: &Motion,
    span: Span,
    mut controller: Option<&mut Controller<'_>>,
) -> Trace {
    let valves = valves(mechanics, plan);
    let ballast = with_play(&plan.ballast_n_m, &mechanics.hidden.ballast_gap_n_m);
    let late_s = mechanics.hidden.imu_late_s;
    let mut state = mechanics.state(start);
    if plan.clamped {
        // The clamp takes any torque.
        return bench(mechanics, plan, start, span);
    }
    let mut trace = Trace::default();
    let mut filtering: Option<Filtering> = None;
    let mut first_sample = None;
    let mut missing = 0;
    for slot in span.from_slot..span.to_slot {
        let slot_s = slot as f64 * SLOT_S;
        if (slot - span.from_slot).is_multiple_of(span.mark_every) {
            trace.marks.push(mechanics.motion(&state));
        }
        if let Some(controller) = controller.as_deref_mut() {
            let motion = mechanics.motion(&state);
            let command = controller(slot_s, &motion.omega_b_rad_s, &motion.q_world_body);
            plan.wheel_command_n_m[slot] = command;
        }
        let inputs = Inputs {
            time_s: slot_s,
            wheel_command_n_m: plan.wheel_command_n_m[slot],
            ballast_n_m: ballast.get(slot).copied().unwrap_or_default(),
            volt: plan.volt(slot, mechanics.body.sag_v_n_m),
            temperature_k: plan.temperature_k(slot_s),
            valves: &valves,
            blowing: &[],
        };
        // Inertial samples show what was `late_s` before their stamps: those whose instant is in this slot.
        let spacing = SLOT_S / SAMPLES_PER_SLOT as f64;
        let mut sample = ((slot_s - late_s) / spacing - 1e-6).ceil().max(0.0);
        // Stamp = instant + lateness; instants from slot_s on.
        while sample * spacing - late_s < slot_s - 1e-9 {
            sample += 1.0;
        }
        let first_sample = *first_sample.get_or_insert(sample);
        missing = (first_sample as usize).saturating_sub(span.from_slot * SAMPLES_PER_SLOT);
        if slot.is_multiple_of(5) {
            let now = mechanics.at(&state, &at_edge(&inputs, &valves, slot_s));
            record_slow(mechanics, &mut trace, slot_s, &now, &inputs, state[18]);
        }
        for i in 0..SAMPLES_PER_SLOT {
            trace.time_s.push(slot_s + i as f64 * spacing);
        }
        let end_s = slot_s + SLOT_S;
        let mut wheel_sample = 0;
        let mut time_s = slot_s;
        while time_s < end_s - 1e-9 {
            let grid = ((time_s - slot_s) / span.step_s + 1e-6).floor() + 1.0;
            let next = (slot_s + grid * span.step_s).min(end_s).min(valves.next_edge_s(time_s));
            let here = at_edge(&inputs, &valves, time_s);
            let advance = |to: f64, state: &State| {
                if to - time_s < 1e-9 { *state } else { mechanics.step(state, &here, to - time_s) }
            };
            let from = seen(mechanics, &mechanics.at(&state, &here));
            let filtering =
                filtering.get_or_insert_with(|| Filtering::new(mechanics.hidden.imu_filters, time_s, from));
            loop {
                let instant = sample * spacing - late_s;
                if instant >= next - 1e-9 {
                    break;
                }
                let there = advance(instant, &state);
                let now = mechanics.at(&there, &at_edge(&inputs, &valves, instant));
                let given = if filtering.is_idle() {
                    seen(mechanics, &now)
                } else {
                    let mut until = filtering.clone();
                    until.advance(instant, &from, &seen(mechanics, &now));
                    until.output()
                };
                record_imu(mechanics, &mut trace, (instant, &given), &now, &inputs, &there);
                sample += 1.0;
            }
            while wheel_sample < SAMPLES_PER_SLOT {
                let instant = slot_s + wheel_sample as f64 * spacing;
                if instant >= next - 1e-9 {
                    break;
                }
                let there = advance(instant, &state);
                trace.wheel_rad_s.push(mechanics.motion(&there).wheel_speed_rad_s);
                wheel_sample += 1;
            }
            state = mechanics.step(&state, &here, next - time_s);
            if !filtering.is_idle() {
                // Just before an edge that may be there.
                let end = Inputs { time_s: next - 1e-8, ..here };
                filtering.advance(next, &from, &seen(mechanics, &mechanics.at(&state, &end)));
            }
            time_s = next;
        }
    }
    trace.marks.push(mechanics.motion(&state));
    // Late channels: stamps whose data are from before the start repeat the first sample.
    if let (Some(gyro), Some(force), Some(q), Some(omega)) = (
        trace.gyro_b_rad_s.first().copied(),
        trace.force_b_m_s2.first().copied(),
        trace.q_world_body.first().copied(),
        trace.omega_b_rad_s.first().copied(),
    ) {
        for _ in 0..missing {
            trace.gyro_b_rad_s.insert(0, gyro);
            trace.force_b_m_s2.insert(0, force);
            trace.q_world_body.insert(0, q);
            trace.omega_b_rad_s.insert(0, omega);
        }
    }
    let keep = trace.time_s.len();
    trace.gyro_b_rad_s.truncate(keep);
    trace.force_b_m_s2.truncate(keep);
    trace.q_world_body.truncate(keep);
    trace.omega_b_rad_s.truncate(keep);
    trace
}

fn at_edge<'a>(inputs: &Inputs<'a>, valves: &'a Valves, time_s: f64) -> Inputs<'a> {
    Inputs { time_s, blowing: valves.blowing(time_s), valves, ..*inputs }
}

fn record_slow(
    mechanics: &Mechanics,
    trace: &mut Trace,
    time_s: f64,
    now: &Instant,
    inputs: &Inputs<'_>,
    gas_kg: f64,
) {
    let yaw = now.world_to_body[(0, 1)].atan2(now.world_to_body[(0, 0)]);
    let iron = Vector3::z() * (mechanics.hidden.foreign.iron_rad * (2.0 * yaw).sin());
    let seen = now.world_to_body * (UnitQuaternion::from_scaled_axis(iron) * mechanics.body.lamp_world);
    let turn = UnitQuaternion::from_scaled_axis(mechanics.hidden.vector_turn_rad);
    trace.vector_time_s.push(time_s);
    trace.direction_b.push(turn.inverse_transform_vector(&seen));
    trace.volt.push(inputs.volt);
    trace.pressure_pa.push(mechanics.pressure_pa(gas_kg));
    trace.temperature_k.push(inputs.temperature_k);
}

/// What ideal gyros and accelerometers are given.
fn seen(mechanics: &Mechanics, now: &Instant) -> Seen {
    let (omega, arm) = (now.omega_b_rad_s, mechanics.body.lever_arm_m + mechanics.hidden.accel_arm_m);
    let force =
        now.omega_dot_b_rad_s2.cross(&arm) + omega.cross(&omega.cross(&arm)) + super::G_M_S2 * now.vertical_b;
    let mut both = Seen::zeros();
    both.fixed_rows_mut::<3>(0).copy_from(&omega);
    both.fixed_rows_mut::<3>(3).copy_from(&force);
    both
}

fn record_imu(
    mechanics: &Mechanics,
    trace: &mut Trace,
    (time_s, given): (f64, &Seen),
    now: &Instant,
    inputs: &Inputs<'_>,
    state: &State,
) {
    let (body, hidden) = (&mechanics.body, &mechanics.hidden);
    let (omega, force): (Vector3<f64>, Vector3<f64>) =
        (given.fixed_rows::<3>(0).into(), given.fixed_rows::<3>(3).into());
    let mut gyro = omega + hidden.gyro_scale.component_mul(&omega) + hidden.gyro_cross * omega;
    gyro += hidden.gyro_per_k * (inputs.temperature_k - body.ambient_k) + hidden.gyro_per_g * force;
    let mut accel = force + hidden.accel_scale.component_mul(&force) + hidden.accel_bias_m_s2;
    if hidden.alias_gyro_rad_s != Vector3::zeros() || hidden.alias_accel_m_s2 != Vector3::zeros() {
        let source = now.valve_open + (1.0 - now.valve_open) * hidden.alias_background;
        let wave = source * (std::f64::consts::TAU * hidden.alias_hz * time_s).sin();
        gyro += hidden.alias_gyro_rad_s * wave;
        accel += hidden.alias_accel_m_s2 * wave;
    }
    gyro = gyro.map(|x| x.clamp(-hidden.gyro_range_rad_s, hidden.gyro_range_rad_s));
    if hidden.foreign.gyro_xy_swapped {
        gyro = Vector3::new(gyro.y, gyro.x, gyro.z);
    }
    let dead = hidden.foreign.dead_rad_s;
    if dead > 0.0 {
        gyro = gyro.map(|x| if x.abs() < dead { 0.0 } else { x });
    }
    if hidden.foreign.gyro_z_reversed {
        gyro.z = -gyro.z;
    }
    trace.gyro_b_rad_s.push(gyro);
    trace.force_b_m_s2.push(accel);
    trace.largest_rate_rad_s = trace.largest_rate_rad_s.max(omega.amax());
    trace.largest_tilt_rad =
        trace.largest_tilt_rad.max(now.vertical_b.x.hypot(now.vertical_b.y).atan2(now.vertical_b.z));
    trace.q_world_body.push(mechanics.motion(state).q_world_body);
    trace.omega_b_rad_s.push(now.omega_b_rad_s);
}

/// Wheels on a body that is held still, level.
fn bench(mechanics: &Mechanics, plan: &Plan, start: &Motion, span: Span) -> Trace {
    let mut trace = Trace::default();
    let valves = Valves::new(&[], |_, _| (0.0, 0.0), 0.0);
    let mut speed = start.wheel_speed_rad_s;
    let held = Motion { omega_b_rad_s: Vector3::zeros(), ..start.clone() };
    for slot in span.from_slot..span.to_slot {
        if (slot - span.from_slot).is_multiple_of(span.mark_every) {
            trace.marks.push(Motion { wheel_speed_rad_s: speed, ..held.clone() });
        }
        let slot_s = slot as f64 * SLOT_S;
        let inputs = Inputs {
            time_s: slot_s,
            wheel_command_n_m: plan.wheel_command_n_m[slot],
            ballast_n_m: Vector3::zeros(),
            volt: plan.volt(slot, mechanics.body.sag_v_n_m),
            temperature_k: plan.temperature_k(slot_s),
            valves: &valves,
            blowing: &[],
        };
        if slot.is_multiple_of(5) {
            trace.volt.push(inputs.volt);
            trace.vector_time_s.push(slot_s);
            trace.temperature_k.push(inputs.temperature_k);
        }
        let fine = 10;
        for i in 0..fine {
            if i % (fine / SAMPLES_PER_SLOT) == 0 {
                trace.time_s.push(slot_s + i as f64 * SLOT_S / fine as f64);
                trace.wheel_rad_s.push(speed);
            }
            // The midpoint rule on each wheel alone: J dOm/dt = u.
            let torque = |speed: [f64; WHEELS]| {
                let state = mechanics.state(&Motion { wheel_speed_rad_s: speed, ..held.clone() });
                let d = mechanics.at(&state, &inputs).derivative;
                [d[6], d[7], d[8]]
            };
            let step = SLOT_S / fine as f64;
            let rate = |u: [f64; WHEELS]| {
                std::array::from_fn(|w| u[w] / mechanics.body.wheels[w].spin_inertia_kg_m2)
            };
            let first: [f64; WHEELS] = rate(torque(speed));
            let middle = std::array::from_fn(|w| speed[w] + 0.5 * step * first[w]);
            let second: [f64; WHEELS] = rate(torque(middle));
            for w in 0..WHEELS {
                speed[w] += step * second[w];
            }
        }
    }
    trace.marks.push(Motion { wheel_speed_rad_s: speed, ..held });
    trace
}
