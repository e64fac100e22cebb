//! Names of hidden effects.

use whorl_dynamics::PlatformModel;

use super::generator::{map, record, wrong_model};
use crate::parameters::Reference;
use crate::problem::Problem;
use crate::search::Search;
use crate::Options;

fn try_it(name: &str, effects: &[(&str, &[(&str, f64)])], seed: u64) {
    let clock = std::time::Instant::now();
    let mut truth = PlatformModel::whorl_1_reference();
    truth.effects = map(effects);
    let runs: Vec<_> = (0..2).map(|i| record(&truth, seed * 10 + i, 90.0, None)).collect();
    let (model, prior) = wrong_model(&truth, seed);
    let made = clock.elapsed();
    let mut problem = Problem::new(&runs, Reference::new(&model, &prior), 2).unwrap();
    let options = Options::default();
    let mut search = Search::start(&mut problem, None, &options, &mut |_| {}).unwrap();
    println!("== {name} (made {made:.2?})  columns {}  base sum of squares {:.1} rows {:.0} after base {:.1}", search.layout.columns.len(), search.data.total.sum_of_squares, search.data.total.rows, search.data.total.sum_of_squares - search.base.estimate.drop);
    for h in search.additions(&search.base).iter().take(5) {
        let c = &search.layout.candidates[h.members[0].candidate];
        println!("    {:28} dlogZ {:9.2} drop {:9.2} gain {:9.2}", c.id, h.log_evidence - search.base.log_evidence, h.estimate.drop - search.base.estimate.drop, search.gain(h, &search.base));
    }
    search.run(&mut |_| {}).unwrap();
    println!("  => {:?}  or {:?}   {:.2?}", search.best.names(&search.layout), search.alternatives(), clock.elapsed() - made);
    for m in &search.best.members {
        for i in &m.columns {
            let c = &search.layout.columns[*i];
            println!("      {} = {:.4e} {}", c.name, search.best.estimate.of(*i) * c.scale, c.unit);
        }
    }
}

#[test]
fn explore() {
    let only = std::env::var("ONLY").unwrap_or_default();
    let cases: &[(&str, &[(&str, &[(&str, f64)])])] = &[
        ("none", &[]),
        ("none2", &[]),
        ("viscous", &[("bearing_viscous_friction", &[("c_n_m_s", 0.03)])]),
        ("coulomb", &[("bearing_coulomb_friction", &[("torque_n_m", 0.003)])]),
        ("quadratic", &[("air_drag_quadratic", &[("dx_n_m_s2", 0.2), ("dy_n_m_s2", 0.2), ("dz_n_m_s2", 0.2)])]),
        ("air", &[("air_current", &[("t_x_n_m", 0.002), ("t_y_n_m", -0.001), ("t_z_n_m", 0.001)])]),
        ("turbine", &[("bearing_turbine", &[("body_z_n_m", 0.003)])]),
        ("magnetic", &[("magnetic_torque", &[("dipole_x_a_m2", 60.0)])]),
        ("sag", &[("anisoelastic_sag", &[("cxx_m_n", 8e-7)])]),
        ("mass_shift", &[("mass_shift", &[("shift_x_n_m_kg", 2.0)])]),
        ("strength", &[("thruster_strength", &[("jet_3", -0.4)])]),
        ("thr_mis", &[("thruster_misalignment", &[("jet_3_a_rad", 0.1)])]),
        ("delay", &[("thruster_delay", &[("t_on_s", 0.02), ("t_off_s", 0.02)])]),
        ("rise", &[("thruster_rise", &[("tau_s", 0.03)])]),
        ("leak", &[("thruster_leak", &[("jet_9_n", 0.008)])]),
        ("wheel_friction", &[("wheel_friction", &[("wheel_z_viscous_n_m_s", 3e-4)])]),
        ("wheel_mis", &[("wheel_misalignment", &[("wheel_z_a_rad", 0.03)])]),
        ("wheel_inertia", &[("wheel_inertia", &[("wheel_z", 0.08)])]),
        ("windage", &[("wheel_windage", &[("wheel_z_n_m_s2", 5e-6)])]),
        ("gyro_scale", &[("gyro_scale", &[("scale_z", 0.02)])]),
        ("gyro_mis", &[("gyro_misalignment", &[("xz_rad", 0.02)])]),
        ("gyro_g", &[("gyro_g_sensitivity", &[("xx_s_m", 1e-3)])]),
        ("lever", &[("accel_lever_arm", &[("d_x_m", 0.3)])]),
        ("accel_bias", &[("accel_bias", &[("bias_x_m_s2", 0.1)])]),
        ("latency", &[("imu_latency", &[("t_s", 0.03)])]),
        ("vector", &[("vector_sensor_misalignment", &[("m_x_rad", 0.02)])]),
        ("spring", &[("harness_spring", &[("k_n_m_rad", 0.01), ("yaw0_rad", 0.5)])]),
        ("slosh", &[("slosh", &[("mass_ratio", 0.01), ("frequency_hz", 0.8)])]),
        ("flex", &[("flexible_mode", &[("participation_z_sqrt_kg_m", 0.5), ("frequency_hz", 2.0)])]),
    ];
    for (i, (name, effects)) in cases.iter().enumerate() {
        if only.is_empty() || only.split(',').any(|o| o == *name) {
            try_it(name, effects, 1 + i as u64);
        }
    }
}
