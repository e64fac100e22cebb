//! What Tables 4.1-4.4 and the designed manoeuvre show, said from their numbers.

use nalgebra::{Matrix3, Unit, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_dynamics::mass_parameters::{MASS_PARAMETERS, MassVector, NAMES};
use whorl_math::attitude_from_vertical;
use whorl_math::statistics::median;

use crate::data::{level, rigid_whorl_1};
use crate::printed_tables;
use crate::regression::StateSeries;
use crate::rigid_body::simulate_rigid_body;
use crate::study::{Printed, SEEDS, bang_bang, printed_run};

/// What the signs of the printed errors are, counted: every second column of a table is the error of the one before.
pub fn sign_sentence(printed: &Printed, truth: &MassVector) -> String {
    let number = |cell: &str| cell.parse::<f64>().ok().filter(|x| *x != 0.0);
    let (mut cells, mut of_error, mut of_truth) = (0, 0, 0);
    for (row, truth) in printed.iter().zip(truth.iter()) {
        for pair in row.chunks(2) {
            let [estimate, error] = pair else { continue };
            let (Ok(estimate), Some(error)) = (estimate.parse::<f64>(), number(error)) else { continue };
            cells += 1;
            of_error += usize::from((estimate - truth) * error > 0.0);
            of_truth += usize::from(truth * error > 0.0);
        }
    }
    let convention = "100 (estimate - truth) / |truth|";
    let verdict = if of_error == cells {
        format!("they are {convention}, as ours")
    } else if of_truth == cells {
        format!("they are 100 |estimate - truth| / truth. Ours are {convention}")
    } else {
        format!("neither fits all. Ours are {convention}")
    };
    format!(
        "The text says that a negative percent error means an estimate smaller than expected. Of {cells} printed signs {of_error} are those of estimate less truth, and {of_truth} those of the truth, whichever way the estimate is off: {verdict}."
    )
}

/// Whether the printed numbers are ours, and those of a body.
pub fn cad_sentence(printed: &[&str; MASS_PARAMETERS], ours: &MassVector) -> String {
    let same =
        printed.iter().zip(ours.iter()).filter(|(p, o)| p.parse::<f64>().is_ok_and(|p| p == **o)).count();
    let [xx, xy, xz, yy, yz, zz] = [0, 1, 2, 3, 4, 5].map(|i| ours[i]);
    let mut principal = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz).symmetric_eigenvalues();
    principal.as_mut_slice().sort_by(f64::total_cmp);
    let [least, middle, largest] = [0, 1, 2].map(|i| principal[i]);
    let realisable = least > 0.0 && largest <= least + middle;
    format!(
        "{same} of {MASS_PARAMETERS} numbers are those of the model of Whorl-I in params/whorl_1.yaml. Its principal moments are {least:.2}, {middle:.2} and {largest:.2} kg m^2: {}.",
        if realisable {
            "a body can have them, as the largest is below the sum of the others"
        } else {
            "no body has them"
        }
    )
}

/// Median of a column of printed errors \[%\], size alone.
pub fn printed_error_percent(printed: &Printed, column: usize) -> f64 {
    median(printed.iter().filter_map(|row| row.get(column)?.parse::<f64>().ok()).map(f64::abs))
}

/// How far the platform tilts, from level and from where it would rest.
pub fn tilt_sentence(series: &StateSeries) -> String {
    let model = rigid_whorl_1(true);
    let up = Unit::new_normalize(-model.mass_properties.gravity_offset_b_n_m());
    let balance = attitude_from_vertical(up, 0.0);
    let deg = [level(), balance].map(|from| printed_tables::tilt_deg(series, &from));
    let from_rest =
        simulate_rigid_body(&model.mass_properties, (balance, Vector3::zeros()), &bang_bang, 0.1, 1001, 20);
    let rest_deg = [level(), balance].map(|from| printed_tables::tilt_deg(&from_rest, &from));
    let nearer = if (rest_deg[1] - 5.0).abs() < (deg[0] - 5.0).abs() {
        "the printed run probably began at its balance and counts angles from there"
    } else {
        "the printed run probably began level"
    };
    format!(
        "The text says that the thrust makes motions of up to 5 deg, the limit of the bearing. Begun level, as here, the platform tilts to {:.1} deg ({:.1} deg from its balance, which is {:.1} deg off level); begun at its balance to {:.1} deg, {:.1} deg from there: {nearer}.",
        deg[0],
        deg[1],
        (balance.inverse() * Vector3::z()).angle(&Vector3::z()).to_degrees(),
        rest_deg[0],
        rest_deg[1]
    )
}

/// What the torque method and the likelihood method lose on the table's own data.
pub fn loss_sentence(
    truth: &MassVector,
    ours: &[MassVector],
    sensed: &PlatformModel,
    printed: &Printed,
) -> String {
    let percent = |e: &MassVector, i: usize| 100.0 * ((e[i] - truth[i]) / truth[i]).abs();
    let excited = |e: &MassVector| median([0, 1, 3, 6, 7, 8].map(|i| percent(e, i)));
    let (Some(torque), Some(likelihood)) = (ours.first(), ours.last()) else { return String::new() };
    let rates = printed_run(sensed);
    let [across_deg_s, yaw_deg_s] = [false, true].map(|yaw| {
        let squares = rates.samples.iter().map(|s| {
            let w = s.omega_wb_b_rad_s;
            if yaw { w.z * w.z } else { w.xy().norm_squared() }
        });
        (squares.sum::<f64>() / rates.samples.len().max(1) as f64).sqrt().to_degrees()
    });
    let lost: Vec<String> = [0, 2]
        .iter()
        .filter_map(|column| Some((printed[5][*column], printed[5][column + 1].parse::<f64>().ok()?)))
        .filter(|(_, error)| error.abs() > 90.0)
        .map(|(estimate, error)| format!("{estimate} kg m^2, {:.0} % off", error.abs()))
        .collect();
    let signature = if lost.is_empty() {
        String::new()
    } else {
        format!(
            " An I_zz that the pseudo-inverse drives to zero, as the printed ones ({}), is the signature of a parameter that was not excited, not an estimate.",
            lost.join("; ")
        )
    };
    let errors = &sensed.sensors;
    format!(
        "Noise of {:.3} deg/s and {:.4} m/s^2 a sample, read at {:.0} Hz, begun level: the torque method is {:.0} % off in I_xx, I_xy, I_yy and the gravity offset (median) and {:.0} % in I_zz, which the thrust about x excites by a yaw rate of {yaw_deg_s:.2} deg/s (root mean square) where the others are {across_deg_s:.2} deg/s; the likelihood method on the same data {:.2} % and {:.1} %.{signature}",
        errors.gyro.errors.noise_stddev.amax().to_degrees(),
        errors.accelerometer.errors.noise_stddev.amax(),
        errors.rate_hz,
        excited(torque),
        percent(torque, 5),
        excited(likelihood),
        percent(likelihood, 5)
    )
}

/// What the manoeuvre was asked to find, with two vectors and with the accelerometer alone \[%\].
const ASKED_PERCENT: [f64; 2] = [2.0, 5.0];
/// The same for products of inertia, which may be next to nothing [kg m^2].
const ASKED_PRODUCT_KG_M2: f64 = 0.02;

/// Under which conditions the designed manoeuvre was flown, and whether it found what it was asked for.
pub fn asked_sentence(truth: &MassVector, columns: &[Vec<MassVector>]) -> String {
    let missed: Vec<String> = columns
        .iter()
        .zip(ASKED_PERCENT)
        .zip(["two vectors", "the accelerometer alone"])
        .flat_map(|((estimates, percent), sensors)| {
            (0..MASS_PARAMETERS).filter_map(move |i| {
                let worst = estimates.iter().map(|e| (e[i] - truth[i]).abs()).fold(0.0, f64::max);
                let product = [1, 2, 4].contains(&i);
                let allowed = if product { ASKED_PRODUCT_KG_M2 } else { 0.01 * percent * truth[i].abs() };
                let found = worst <= allowed && estimates.iter().all(|e| e[i].is_finite());
                (!found).then(|| format!("{} with {sensors}", NAMES[i]))
            })
        })
        .collect();
    let model = rigid_whorl_1(true);
    let sensors = &model.sensors;
    format!(
        "MotionPak-class data at {:.0} Hz ({:.2} deg/s, {:.3} m/s^2, biases drawn anew), torques known exactly as in section 4.6.4, started a tenth off; the worst of {} repetitions with other noise and biases. Asked for: {} % with two vectors, {} % with the accelerometer alone, products of inertia within {ASKED_PRODUCT_KG_M2} kg m^2: {}.",
        sensors.rate_hz,
        sensors.gyro.errors.noise_stddev.amax().to_degrees(),
        sensors.accelerometer.errors.noise_stddev.amax(),
        SEEDS.len(),
        ASKED_PERCENT[0],
        ASKED_PERCENT[1],
        if missed.is_empty() { "found".to_owned() } else { format!("not found: {}", missed.join(", ")) }
    )
}
