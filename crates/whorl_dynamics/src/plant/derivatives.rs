//! Derivatives of a plant's motion and of its inertial readings on paper, where nothing but the equation of motion, the wheels and gravity
//! depends on the state.

use nalgebra::{Matrix3, Vector3};
use whorl_math::{GRAVITY_M_S2, skew, vertical_b};

use super::{LinearisedPlant, Plant, RATE, ROTATION};
use crate::actuators::wheels::torque_by_speed_n_m_s;
use crate::actuators::{Forces, OnBody};
use crate::gyrostat::Derivative;
use crate::platform::TriaxialErrors;

impl Plant {
    /// The derivatives in the present state but those of the rotation's own rate, into zeros; false, and nothing done, where effects act,
    /// gimbals move, something touches or a sensor has a low-pass: these are differenced.
    pub(super) fn derive_into(&self, found: &mut LinearisedPlant) -> bool {
        let (gyrostat, state, drive) = (&self.gyrostat, &self.state, &self.drive);
        let model = gyrostat.model();
        let is_plain = !gyrostat.effects().any_acts() && model.gyros().is_empty() && !self.has_filter;
        if !is_plain || self.touching()[0] {
            return false;
        }
        let tangent = self.tangent();
        let (omega, vertical_b) = (state.omega_wb_b_rad_s, vertical_b(&state.q_world_body));
        let mut body = OnBody {
            torque_b_n_m: Vector3::zeros(),
            thrust_factor: 1.0,
            gravity_offset_b_n_m: *model.mass_properties.gravity_offset_b_n_m(),
        };
        let (mut forces, mut derivative) = (Forces::default(), Derivative::zero());
        let actuators = &model.actuators;
        actuators.act(&self.instant(0.0), &state.actuators, &drive.actuators, &omega, &mut body, &mut forces);
        gyrostat.derivative(&self.instant(0.0), state, drive, &mut forces, &mut derivative);
        let momentum = gyrostat.total_momentum_b_n_m_s(state);
        let paper = drive.equation.linearised(&omega, &momentum, &body.gravity_offset_b_n_m, &vertical_b);
        let turns = model.freedom.turns() && !drive.clamped;
        let accelerates = |by: Matrix3<f64>| if turns { by } else { Matrix3::zeros() };
        let by_torque = accelerates(paper.by_torque);
        let rates = &mut found.rate_by_state;
        rates.fixed_view_mut::<3, 3>(RATE.start, ROTATION.start).copy_from(&accelerates(paper.by_attitude));
        rates.fixed_view_mut::<3, 3>(RATE.start, RATE.start).copy_from(&accelerates(paper.by_rate));
        found.rate_by_torque.fill(0.0);
        found.rate_by_torque.fixed_rows_mut::<3>(RATE.start).copy_from(&by_torque);
        let wheels = || model.wheels().iter().zip(tangent.wheels()).enumerate();
        for (j, (wheel, i)) in wheels() {
            let axis = wheel.spin_axis_b.into_inner();
            let mut of_rate = accelerates(paper.by_wheel_momentum) * axis * wheel.spin_inertia_kg_m2;
            if !drive.actuators.wheels.holds(j) {
                let of_torque =
                    torque_by_speed_n_m_s(wheel, &drive.actuators.wheels, j, &state.actuators.wheels);
                of_rate -= by_torque * axis * of_torque;
                rates[(i, i)] = of_torque / wheel.spin_inertia_kg_m2;
            }
            rates.fixed_view_mut::<3, 1>(RATE.start, i).copy_from(&of_rate);
        }
        for (_, (wheel, i)) in wheels().filter(|(j, _)| !drive.actuators.wheels.holds(*j)) {
            // What the body gains a wheel loses.
            let axis = wheel.spin_axis_b.into_inner();
            for k in 0..tangent.size() {
                let of_body: f64 = (0..3).map(|row| axis[row] * rates[(RATE.start + row, k)]).sum();
                rates[(i, k)] -= of_body;
            }
            let of_torque = -(axis.transpose() * by_torque);
            found.rate_by_torque.fixed_view_mut::<1, 3>(i, 0).copy_from(&of_torque);
        }
        // Specific force: dw/dt x r + w (w . r) - r (w . w) + g k.
        let sensors = &model.sensors;
        let arm = sensors.accelerometer.lever_arm_b_m;
        let [of_gyro, of_force] = [&sensors.gyro.errors, &sensors.accelerometer.errors].map(reads);
        let turned = -skew(&arm);
        let weight =
            if model.freedom.has_weight() { skew(&vertical_b) * GRAVITY_M_S2 } else { Matrix3::zeros() };
        for k in 0..tangent.size() {
            let acceleration: Vector3<f64> = found.rate_by_state.fixed_view::<3, 1>(RATE.start, k).into();
            let mut force = turned * acceleration;
            if ROTATION.contains(&k) {
                force += weight.column(k - ROTATION.start);
            }
            if turns && RATE.contains(&k) {
                let axis = Vector3::ith(k - RATE.start, 1.0);
                force += axis * omega.dot(&arm) + omega * arm.dot(&axis) - arm * (2.0 * omega.dot(&axis));
                found.imu_by_state.fixed_view_mut::<3, 1>(0, k).copy_from(&(of_gyro * axis));
            }
            found.imu_by_state.fixed_view_mut::<3, 1>(3, k).copy_from(&(of_force * force));
        }
        found.force_by_torque = of_force * turned * by_torque;
        true
    }
}

/// What a sensor reads without bias, noise and limits by what it sees, which is linear.
fn reads(errors: &TriaxialErrors) -> Matrix3<f64> {
    Matrix3::from_columns(&[0, 1, 2].map(|axis| errors.ideal(&Vector3::ith(axis, 1.0))))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Unit, UnitQuaternion};

    use super::*;
    use crate::actuators::Kind;
    use crate::{Freedom, InitialState, PlatformModel};

    /// The same as central differences of the plant's own equations, whatever the rig, its wheels and its sensors.
    #[test]
    fn derivatives_on_paper_are_differences() {
        let oblique = Unit::new_normalize(Vector3::new(0.3, -0.5, 0.8));
        for freedom in
            [Freedom::OnBearing, Freedom::Free, Freedom::Hinge { axis_b: oblique }, Freedom::Clamped]
        {
            let mut model = PlatformModel::whorl_1_reference();
            model.freedom = freedom;
            model.wheels_mut()[0].viscous_friction_n_m_s = 3e-3;
            model.wheels_mut()[1].coulomb_friction_n_m = 0.02;
            // Its motor loses torque near its largest speed.
            model.wheels_mut()[2].max_speed_rad_s = 50.2;
            let sensors = &mut model.sensors;
            sensors.gyro.errors.scale = Vector3::new(0.02, -0.01, 0.03);
            sensors.accelerometer.errors.skew_rad[0] = 0.02;
            sensors.accelerometer.lever_arm_b_m = Vector3::new(0.1, 0.05, 0.15);
            let start = InitialState {
                q_world_body: UnitQuaternion::from_euler_angles(0.2, -0.3, 1.0),
                omega_wb_b_rad_s: Vector3::new(0.1, -0.4, 0.6),
                wheel_speed_rad_s: vec![20.0, 0.0, 50.0],
                ..InitialState::default()
            };
            let mut plant = Plant::new(&model, &start, 1).unwrap();
            plant.command_motors(Kind::Wheels, &[0.1, 1e-3, 0.2]).unwrap();
            plant.set_ballast_moment(Vector3::new(0.05, -0.02, 0.1));
            let [mut paper, mut differences] = [(); 2].map(|()| LinearisedPlant::none(&plant));
            plant.linearise_into(&mut paper, true);
            plant.difference_into(&mut differences);
            assert!(plant.held_wheels().eq([false, true, false]), "{freedom:?}");
            for (what, paper, differences) in [
                ("rates", paper.rate_by_state.as_slice(), differences.rate_by_state.as_slice()),
                ("by torque", paper.rate_by_torque.as_slice(), differences.rate_by_torque.as_slice()),
                ("readings", paper.imu_by_state.as_slice(), differences.imu_by_state.as_slice()),
                ("force", paper.force_by_torque.as_slice(), differences.force_by_torque.as_slice()),
            ] {
                let largest = differences.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
                let off = paper.iter().zip(differences).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(off <= 1e-6 * largest.max(1e-3), "{freedom:?} {what}: {off} of {largest}");
            }
        }
    }
}
