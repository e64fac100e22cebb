//! Rigs that are drawn, and recordings of them: every freedom, size, rate and loop.

use nalgebra::{Matrix3, Unit, UnitQuaternion, Vector3};
use rand_distr::{Distribution, StandardNormal, Uniform};
use rand_pcg::Pcg64;
use whorl_dynamics::platform::{Jet, TiltLimit, Wheel};
use whorl_dynamics::{Freedom, InitialState, MassProperties, Plant, PlatformModel};
use whorl_recording::{Mounting, OnInterval, Recording, VectorChannel};

/// Random numbers of one rig.
pub struct Draw(Pcg64);

impl Draw {
    pub fn new(seed: u64) -> Self {
        Self(Pcg64::new(u128::from(seed).wrapping_mul(0x9e37_79b9_7f4a_7c15_f39c), 77))
    }
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        Uniform::new(low, high).unwrap().sample(&mut self.0)
    }
    /// Uniform in the logarithm.
    pub fn magnitude(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }
    pub fn happens(&mut self, probability: f64) -> bool {
        self.between(0.0, 1.0) < probability
    }
    pub fn vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal())
    }
}

/// What closes a loop on the noisy readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loop {
    Open,
    /// Each wheel is held at a speed by its tachometer.
    Tachometer,
    /// Wheels or jets damp what the gyro reads.
    Gyro,
}

/// A rig that was drawn, and its recording.
pub struct Rig {
    pub what: String,
    pub model: PlatformModel,
    pub recording: Recording,
}

/// Draws a rig and records it.
#[allow(dead_code, reason = "each test uses its part")]
pub fn drawn(seed: u64) -> Rig {
    drawn_as(seed, &|model, _| model.clone())
}

/// Draws a rig, and records what its model does as it really is.
pub fn drawn_as(seed: u64, really: &dyn Fn(&PlatformModel, &mut Draw) -> PlatformModel) -> Rig {
    let mut draw = Draw::new(seed);
    let mut model = PlatformModel::whorl_1_reference();
    let rate_hz = draw.magnitude(1.0, 1000.0).round().max(1.0);
    let size = draw.magnitude(1e-3, 100.0);
    let kind = seed % 5;
    let inertia = Matrix3::from_diagonal(&Vector3::new(
        draw.between(0.8, 1.2),
        draw.between(0.8, 1.2),
        draw.between(0.8, 1.2),
    )) * size;
    // How often it swings or turns.
    let swing_hz = draw.magnitude(0.1, 5.0).min(0.3 * rate_hz);
    let omega = std::f64::consts::TAU * swing_hz;
    let mut offset = Vector3::zeros();
    let axis = Vector3::z_axis();
    let mut tilt = 0.0;
    model.tilt_limit = TiltLimit::NONE;
    let freedom = match kind {
        0 => {
            // A pendulum on a level shaft, up to 60 deg.
            offset = Vector3::new(-size * omega * omega, 0.0, 0.0);
            tilt = draw.between(0.0, 1.05);
            Freedom::Hinge { axis_b: axis }
        }
        1 => Freedom::Hinge { axis_b: axis },
        2 => Freedom::Clamped,
        3 => {
            offset = Vector3::new(0.0, 0.0, -size * (0.3 * omega).powi(2));
            tilt = draw.between(0.0, 0.4);
            Freedom::OnBearing
        }
        _ => Freedom::Free,
    };
    model.mass_properties = MassProperties::new(inertia, offset, size.max(0.1)).unwrap();
    model.freedom = freedom;
    // Wheels: as strong as turns the rig by a radian in some seconds.
    let acceleration = omega * draw.between(0.02, 0.2);
    let wheels = if kind == 2 { 1 } else { (draw.between(0.0, 3.99)) as usize };
    let with_friction = draw.happens(0.5);
    let spin = size * draw.magnitude(1e-3, 0.1);
    let torque = if kind == 2 { spin * omega * 20.0 } else { size * acceleration };
    *model.wheels_mut() = (0..wheels)
        .map(|j| Wheel {
            name: format!("wheel_{j}"),
            spin_axis_b: if wheels == 1 {
                Vector3::z_axis()
            } else {
                [Vector3::z_axis(), Vector3::x_axis(), Vector3::y_axis()][j]
            },
            spin_inertia_kg_m2: spin,
            max_torque_n_m: 10.0 * torque,
            max_speed_rad_s: 1e6,
            viscous_friction_n_m_s: if with_friction { 0.01 * torque / omega } else { 0.0 },
            coulomb_friction_n_m: if with_friction { 0.05 * torque } else { 0.0 },
        })
        .collect();
    let with_jets = wheels == 0 && kind != 2 && draw.happens(0.7);
    model.jets_mut().clear();
    // It never runs empty.
    model.tank_mut().volume_m3 = 1e6;
    if with_jets {
        for sign in [1.0, -1.0] {
            model.jets_mut().push(Jet {
                name: format!("jet_{sign}"),
                position_b_m: Vector3::x(),
                force_direction_b: Unit::new_normalize(Vector3::y() * sign),
                thrust_n: size * acceleration,
                min_on_time_s: 1e-3,
                opening_delay_s: 2e-3,
                closing_delay_s: 1e-3,
            });
        }
    }
    let sensors = &mut model.sensors;
    sensors.rate_hz = rate_hz;
    let moves = acceleration / omega;
    let gyro_noise = moves * draw.magnitude(1e-3, 0.3);
    sensors.gyro.errors.noise_stddev = Vector3::repeat(gyro_noise);
    sensors.gyro.errors.range = 1e6;
    let biased = draw.happens(0.5);
    sensors.gyro.errors.bias_turn_on_stddev = Vector3::repeat(if biased { moves * 0.1 } else { 0.0 });
    sensors.gyro.errors.bias_walk =
        Vector3::repeat(if biased && draw.happens(0.5) { moves * 1e-3 } else { 0.0 });
    sensors.accelerometer.fitted = kind != 2 && kind != 4 && draw.happens(0.6);
    sensors.accelerometer.errors.range = 1e6;
    sensors.accelerometer.errors.noise_stddev = Vector3::repeat(draw.magnitude(0.005, 0.2));
    sensors.accelerometer.errors.bias_turn_on_stddev = Vector3::repeat(if biased { 0.02 } else { 0.0 });
    sensors.accelerometer.errors.bias_walk = Vector3::zeros();
    sensors.accelerometer.lever_arm_b_m = draw.vector() * 0.1;
    if draw.happens(0.3) {
        sensors.gyro.errors.latency_s = (draw.between(0.0, 3.0) / rate_hz).min(0.1);
    }
    let with_vector = kind == 4 || (kind != 2 && !sensors.accelerometer.fitted) || draw.happens(0.4);
    if let Some(vector) = &mut sensors.vector {
        vector.noise_stddev_rad = draw.magnitude(1e-3, 0.03);
        vector.reference_direction_world =
            if kind == 0 || kind == 3 { Vector3::z_axis() } else { Vector3::x_axis() };
        if kind == 3 && sensors.accelerometer.fitted {
            vector.reference_direction_world = Vector3::x_axis();
        }
    }
    let speed_scale = if wheels > 0 { torque / spin / omega } else { 1.0 };
    sensors.wheel_speed.noise_stddev_rad_s = speed_scale * draw.magnitude(1e-3, 0.1);
    sensors.wheel_speed.quantum_rad_s = 0.0;
    let tachometer = wheels > 0;
    let closed = match (kind, draw.between(0.0, 1.0)) {
        (_, x) if x < 0.4 => Loop::Open,
        (2, _) => Loop::Tachometer,
        (_, x) if x < 0.6 && tachometer => Loop::Tachometer,
        _ => Loop::Gyro,
    };
    let samples = draw.magnitude(300.0, 2000.0) as i64;
    let hanging = match kind {
        // Body z level and its -x down.
        0 => Unit::new_normalize(Vector3::new(1.0, 0.0, 0.0)),
        _ => Vector3::z_axis(),
    };
    let level = whorl_math::attitude_from_vertical(hanging, 0.0);
    let turn_axis = if kind == 0 {
        axis
    } else if kind == 3 {
        Vector3::x_axis()
    } else {
        axis
    };
    let start = InitialState {
        q_world_body: level * UnitQuaternion::from_axis_angle(&turn_axis, tilt),
        omega_wb_b_rad_s: draw.vector() * moves,
        wheel_speed_rad_s: (0..wheels).map(|_| draw.normal() * 5.0 * speed_scale).collect(),
        ..InitialState::default()
    };
    let what = format!(
        "seed {seed}: {freedom:?}, {rate_hz} Hz, swing {swing_hz:.2} Hz from {tilt:.2} rad, inertia {size:.2e}, {wheels} wheels friction {with_friction}, jets {with_jets}, {closed:?}, accelerometer {}, vector {with_vector}, bias {biased}, {samples} samples",
        sensors.accelerometer.fitted
    );
    let truth = really(&model, &mut draw);
    let recording = record(&truth, &start, &mut draw, closed, samples, with_vector, torque, spin);
    Rig { what, model, recording }
}

#[expect(clippy::too_many_arguments, reason = "all that was drawn")]
fn record(
    model: &PlatformModel,
    start: &InitialState,
    draw: &mut Draw,
    closed: Loop,
    samples: i64,
    with_vector: bool,
    torque: f64,
    spin: f64,
) -> Recording {
    let rate_hz = model.sensors.rate_hz;
    let mut plant = Plant::new(model, start, draw.between(0.0, 1e9) as u64).unwrap();
    let clamped = model.freedom == Freedom::Clamped;
    plant.set_clamped(clamped);
    let step_ns = (1e9 / rate_hz).round() as i64;
    let mut r =
        Recording { name: "drawn".to_owned(), closed_loop: closed != Loop::Open, ..Recording::default() };
    if clamped {
        r.mounting = Mounting::Clamped;
    }
    r.jet_pulses = vec![Vec::new(); model.jets().len()];
    let one_axis = model.freedom.hinge_axis_b().is_some();
    if one_axis {
        r.no_gyro_axis = [true, true, false];
    }
    let wheels = model.wheels().len();
    let reference: Vec<f64> = start.wheel_speed_rad_s.clone();
    let inertia = model.mass_properties.inertia_b_kg_m2().trace() / 3.0;
    let mut directions = Vec::new();
    let every = if draw.happens(0.5) { 1 } else { 5 };
    let lost = draw.between(0.0, 0.2);
    for k in 0..samples {
        let now_ns = k * step_ns;
        let t = now_ns as f64 * 1e-9;
        plant.advance_to(now_ns).unwrap();
        let imu = plant.sample_imu();
        let mut rate = imu.angular_velocity_rad_s;
        if one_axis {
            (rate.x, rate.y) = (0.0, 0.0);
        }
        let tach: Vec<f64> = plant.sample_wheels().iter().map(|w| w.speed_rad_s).collect();
        let recorded = !draw.happens(lost);
        // Before the start there was no motion that a late reading could show.
        if recorded && !clamped && t >= model.sensors.gyro.errors.latency_s {
            r.gyro_b_rad_s.time_s.push(t);
            r.gyro_b_rad_s.value.push(rate);
        }
        if recorded && model.sensors.accelerometer.fitted {
            r.specific_force_b_m_s2.time_s.push(t);
            r.specific_force_b_m_s2.value.push(imu.specific_force_m_s2);
        }
        if with_vector && k % every == 0 && !clamped {
            directions.push((t, plant.sample_vector().unwrap().direction.into_inner()));
        }
        if wheels > 0 && recorded {
            r.wheel_speed_rad_s.time_s.push(t);
            r.wheel_speed_rad_s.value.push(tach.clone());
        }
        // What acts from here on follows from what has just been read.
        let gain = 0.3 * rate_hz;
        if wheels > 0 {
            let command: Vec<f64> = (0..wheels)
                .map(|j| {
                    let wave = torque * (0.7 * t * (1.0 + j as f64)).sin() * 0.3;
                    match closed {
                        Loop::Open => wave,
                        Loop::Tachometer => -gain * spin * (tach[j] - reference[j]),
                        Loop::Gyro => {
                            0.1 * gain * inertia * rate.dot(&model.wheels()[j].spin_axis_b) + 0.1 * wave
                        }
                    }
                    .clamp(-9.0 * torque, 9.0 * torque)
                })
                .collect();
            plant.command_wheels(&command).unwrap();
            r.wheel_torque_command_n_m.time_s.push(t);
            r.wheel_torque_command_n_m.value.push(command);
        }
        if !model.jets().is_empty() {
            let jet = usize::from(match closed {
                Loop::Open => (0.5 * t).sin() > 0.0,
                _ => rate.z > 0.0,
            });
            let on_s = 0.4 / rate_hz;
            if plant.command_jet_pulse(jet, now_ns, on_s).is_ok() {
                r.jet_pulses[jet].push(OnInterval { on_s: t, off_s: t + on_s });
            }
        }
    }
    if with_vector && !clamped {
        r.vectors.push(VectorChannel {
            reference_world: model.sensors.vector.unwrap().reference_direction_world,
            direction_b: directions.into_iter().collect(),
        });
    }
    r
}
