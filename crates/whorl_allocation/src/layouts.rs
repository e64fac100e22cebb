//! Effector layouts and seeded demands that tests and benches share.

use nalgebra::{Matrix3xX, Vector3};
use rand_core::Rng;
use rand_pcg::Pcg64;

use crate::{EffectorLayout, Effectors};

/// A number in `low..high`.
pub fn uniform(rng: &mut Pcg64, low: f64, high: f64) -> f64 {
    low + (high - low) * (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

/// A direction, uniform on the sphere.
pub fn direction(rng: &mut Pcg64) -> Vector3<f64> {
    loop {
        let v = Vector3::from_fn(|_, _| uniform(rng, -1.0, 1.0));
        if (0.01..1.0).contains(&v.norm_squared()) {
            return v / v.norm();
        }
    }
}

/// Three orthogonal wheels of 0.5 N m.
pub fn three_wheels() -> (Matrix3xX<f64>, Vec<f64>) {
    (Matrix3xX::identity(3), vec![0.5; 3])
}

/// `from_columns`, for none as well.
fn columns(columns: &[Vector3<f64>]) -> Matrix3xX<f64> {
    Matrix3xX::from_fn(columns.len(), |i, k| columns[k][i])
}

fn build(jets: &[(Vector3<f64>, Vector3<f64>)], gas: f64, wheels: (Matrix3xX<f64>, Vec<f64>)) -> Effectors {
    let torque: Vec<_> = jets.iter().map(|(position, force)| position.cross(force)).collect();
    let force: Vec<_> = jets.iter().map(|(_, force)| *force).collect();
    let rates = force.iter().map(|force| gas * force.norm()).collect();
    Effectors::new(EffectorLayout {
        jet_torque_b_n_m: columns(&torque),
        jet_force_b_n: (!force.is_empty()).then(|| columns(&force)),
        jet_gas_rate_kg_s: rates,
        // A motor that accelerates its wheel turns the body the other way.
        motor_torque_b: -wheels.0,
        motor_limit: wheels.1,
    })
    .expect("as many columns as limits and rates, all of them finite and none negative")
}

/// Twelve canted jets in four pods, centre of rotation off their centre, +-5 % thrust spread.
pub fn canted_pods(wheels: (Matrix3xX<f64>, Vec<f64>)) -> Effectors {
    let mut rng = Pcg64::new(12, 1);
    let offset = Vector3::new(0.012, -0.017, 0.021);
    let mut jets = Vec::new();
    for pod in 0..4 {
        let angle = (45.0 + 90.0 * f64::from(pod)).to_radians();
        let position = Vector3::new(0.45 * angle.cos(), 0.45 * angle.sin(), 0.1) - offset;
        let tangent = Vector3::new(-angle.sin(), angle.cos(), 0.0);
        let outward = Vector3::new(angle.cos(), angle.sin(), 0.0);
        let cant = 25.0_f64.to_radians();
        let up = if pod % 2 == 0 { 1.0 } else { -1.0 };
        for axis in [
            tangent * cant.cos() + Vector3::z() * cant.sin(),
            -tangent * cant.cos() + Vector3::z() * cant.sin(),
            Vector3::z() * (-up * cant.cos()) + outward * (up * cant.sin()),
        ] {
            jets.push((position, axis * (0.5 * uniform(&mut rng, 0.95, 1.05))));
        }
    }
    build(&jets, 1.4e-3, wheels)
}

/// Eight equal jets: four in-plane ones make pure yaw couples, four vertical ones roll and pitch.
pub fn eight_jets(wheels: (Matrix3xX<f64>, Vec<f64>)) -> Effectors {
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    let arm = 0.4;
    let jets = [
        (x * arm, y),
        (x * -arm, -y),
        (y * arm, x),
        (y * -arm, -x),
        (x * arm, z),
        (x * -arm, z),
        (y * arm, z),
        (y * -arm, z),
    ];
    build(&jets.map(|(position, force)| (position, force * 0.6)), 1.4e-3, wheels)
}

/// Six jets that push one way about each axis: pure couples are not to be had.
pub fn six_jets(wheels: (Matrix3xX<f64>, Vec<f64>)) -> Effectors {
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    let arm = 0.4;
    let jets = [(x * arm, y), (x * arm, -y), (y * arm, z), (y * arm, -z), (z * arm, x), (z * arm, -x)];
    build(&jets.map(|(position, force)| (position, force * 0.6)), 1.4e-3, wheels)
}

/// No jets.
pub fn wheels_only(axes: &[Vector3<f64>], limit_n_m: f64) -> Effectors {
    let axes: Vec<_> = axes.iter().map(|axis| axis / axis.norm()).collect();
    build(&[], 1.0, (Matrix3xX::from_columns(&axes), vec![limit_n_m; axes.len()]))
}

/// No wheels.
pub fn no_wheels() -> (Matrix3xX<f64>, Vec<f64>) {
    (Matrix3xX::zeros(0), vec![])
}
