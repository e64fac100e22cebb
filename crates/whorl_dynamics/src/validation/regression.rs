//! What the plant simulates with an effect, the model built from the same definition explains: the
//! momentum balance closes, and differences in the parameters are columns that recover their values.

use nalgebra::{DMatrix, DVector, UnitQuaternion, Vector3};

use crate::effects::{ParameterSpec, Role, find};
use crate::platform::TiltLimit;
use crate::{Environment, Gyrostat, InitialState, Plant, PlatformModel};

/// One instant of a record.
struct Instant {
    time_s: f64,
    q: UnitQuaternion<f64>,
    omega: Vector3<f64>,
    wheel_speed: [f64; 3],
    ballast_direction: Vector3<f64>,
}

const STEP_NS: i64 = 1_000_000;
const WINDOW: usize = 250;

/// Ten seconds of tilting, spinning, sweeping wheels.
fn record(model: &PlatformModel) -> Vec<Instant> {
    let initial = InitialState {
        q_world_body: UnitQuaternion::from_euler_angles(0.05, -0.03, 0.8),
        omega_wb_b_rad_s: Vector3::new(0.02, -0.03, 0.4),
        wheel_speed_rad_s: vec![40.0, -30.0, 20.0],
        ..InitialState::default()
    };
    let mut plant = Plant::new(model, &initial, 3).unwrap();
    let mut instants = Vec::new();
    for k in 0..=10_000_i64 {
        if k % 100 == 0 {
            let phase = 0.01 * k as f64;
            let torques = [0.3 * (0.7 * phase).sin(), 0.3 * (1.1 * phase).cos(), -0.4 * (0.5 * phase).sin()];
            plant.command_wheels(&torques).unwrap();
            // Back and forth to the same place: only the sense of the last travel changes.
            let sense = |rate: f64| 1e-9 * (rate * phase).sin();
            plant.set_ballast_moment(Vector3::new(sense(1.0), sense(1.3), sense(0.6)));
        }
        plant.advance_to(k * STEP_NS).unwrap();
        let environment = plant.environment();
        let [x, y, z, ..] = *plant.state().wheel_speed_rad_s();
        instants.push(Instant {
            time_s: environment.time_s,
            q: environment.q_world_body,
            omega: environment.omega_wb_b_rad_s,
            wheel_speed: [x, y, z],
            ballast_direction: environment.ballast_direction,
        });
    }
    instants
}

/// h(end) - h(start) + integral of w x h - g over windows, for the model with these values \[N m s\].
fn residual(id: &str, names: &[String], values: &[f64], instants: &[Instant]) -> DVector<f64> {
    let mut model = PlatformModel::whorl_1_reference();
    model.effects.insert(id.to_owned(), names.iter().cloned().zip(values.iter().copied()).collect());
    let gyrostat = Gyrostat::new(&model).unwrap();
    let momentum = |i: &Instant| gyrostat.momentum_b_n_m_s(&i.omega, &i.wheel_speed);
    let rate = |i: &Instant| {
        let environment = Environment {
            time_s: i.time_s,
            ballast_direction: i.ballast_direction,
            wheel_speed_rad_s: &i.wheel_speed,
            ..Environment::new(gyrostat.model(), i.q, i.omega)
        };
        i.omega.cross(&momentum(i)) - gyrostat.modelled_torque_b_n_m(&environment, &[])
    };
    let mut rows = Vec::new();
    for window in instants.windows(WINDOW + 1).step_by(WINDOW) {
        let (first, last) = (&window[0], &window[WINDOW]);
        let inner: Vector3<f64> = window[1..WINDOW].iter().map(rate).sum();
        let integral = (inner + 0.5 * (rate(first) + rate(last))) * (STEP_NS as f64 * 1e-9);
        rows.extend(&(momentum(last) - momentum(first) + integral));
    }
    DVector::from_vec(rows)
}

#[test]
fn differences_in_the_parameters_recover_the_simulated_values() {
    // Effects linear in their parameters, or nearly so for small values.
    let cases: [(&str, &[(&str, f64)]); 12] = [
        ("gravity_offset", &[("mgr_x_n_m", 0.02), ("mgr_y_n_m", -0.05), ("mgr_z_n_m", 0.1)]),
        ("inertia_products", &[("ixy_kg_m2", 0.1), ("ixz_kg_m2", -0.2), ("iyz_kg_m2", 0.15)]),
        ("bearing_viscous_friction", &[("c_n_m_s", 0.02)]),
        ("bearing_coulomb_friction", &[("torque_n_m", 0.004)]),
        ("air_drag_quadratic", &[("dx_n_m_s2", 0.05), ("dy_n_m_s2", 0.04), ("dz_n_m_s2", 0.02)]),
        ("air_current", &[("t_x_n_m", 0.003), ("t_y_n_m", -0.002), ("t_z_n_m", 0.001)]),
        ("bearing_turbine", &[("body_z_n_m", 0.002), ("vertical_n_m", -0.003)]),
        ("magnetic_torque", &[("dipole_x_a_m2", 30.0), ("dipole_y_a_m2", -20.0), ("dipole_z_a_m2", 40.0)]),
        ("moving_ballast_backlash", &[("gap_x_n_m", 0.01), ("gap_y_n_m", 0.02), ("gap_z_n_m", 0.03)]),
        ("wheel_inertia", &[("wheel_x", 0.02), ("wheel_y", -0.03), ("wheel_z", 0.01)]),
        (
            "wheel_misalignment",
            &[("wheel_x_a_rad", 0.005), ("wheel_y_b_rad", -0.004), ("wheel_z_a_rad", 0.003)],
        ),
        ("gravity_gradient", &[("scale", 1.0)]),
    ];
    for (id, given) in cases {
        let mut truth = PlatformModel::whorl_1_reference();
        // No contact with the stop, which is not among the effects compared here.
        truth.tilt_limit = TiltLimit::Cone { max_rad: 1.5 };
        let specs = find(id).unwrap().parameters(&truth);
        truth.effects.insert(id.to_owned(), given.iter().map(|(n, x)| ((*n).to_owned(), *x)).collect());
        let instants = record(&truth);
        let is_linear = |spec: &&ParameterSpec| !spec.known && spec.role == Role::Amplitude;
        let fitted: Vec<_> = specs.iter().filter(is_linear).collect();
        let names: Vec<String> = fitted.iter().map(|spec| spec.name.clone()).collect();
        let values: Vec<f64> =
            names.iter().map(|n| given.iter().find(|(g, _)| g == n).map_or(0.0, |(_, x)| *x)).collect();
        // With the true values the balance closes to the error of the trapezoid rule.
        let neutral: Vec<f64> = fitted.iter().map(|spec| spec.neutral).collect();
        let missing = residual(id, &names, &neutral, &instants);
        let closed = residual(id, &names, &values, &instants);
        assert!(closed.norm() < 0.02 * missing.norm() + 1e-7, "{id}: {} {}", closed.norm(), missing.norm());
        let mut columns = DMatrix::zeros(missing.len(), names.len());
        for (k, spec) in fitted.iter().enumerate() {
            let (mut low, mut high) = (neutral.clone(), neutral.clone());
            low[k] = (neutral[k] - 1e-3 * spec.prior_stddev).max(spec.min);
            high[k] = (neutral[k] + 1e-3 * spec.prior_stddev).min(spec.max);
            let difference = residual(id, &names, &high, &instants) - residual(id, &names, &low, &instants);
            columns.set_column(k, &(difference / (high[k] - low[k])));
        }
        let fit = (-columns).svd(true, true).solve(&missing, 1e-12).unwrap();
        for (k, spec) in fitted.iter().enumerate() {
            let error = (fit[k] - values[k]) / spec.prior_stddev;
            assert!(error.abs() < 0.02, "{id} {}: {} instead of {}", spec.name, fit[k], values[k]);
        }
    }
}
