//! Readings of the platform's sensors.

use nalgebra::Vector3;
use whorl_math::vertical_b;

use super::{Plant, ns_from_s};
use crate::actuators::Kind;
use crate::platform::TriaxialErrors;
use crate::sensing::{ImuSample, JointSample, Snapshot, VectorSample, low_passed};
use crate::{Environment, State, TrueImu};

impl Plant {
    /// Reads gyro and accelerometer now.
    pub fn sample_imu(&mut self) -> ImuSample {
        let sensors = &self.gyrostat.model().sensors;
        let now = self.snapshot();
        let gyro_truth = self.true_imu(&now, &sensors.gyro.errors);
        let accelerometer_truth = self.true_imu(&now, &sensors.accelerometer.errors);
        ImuSample {
            stamp_ns: self.now_ns,
            angular_velocity_rad_s: self.gyro.sample(&gyro_truth.angular_velocity_b_rad_s, self.now_ns),
            specific_force_m_s2: self
                .accelerometer
                .sample(&accelerometer_truth.specific_force_b_m_s2, self.now_ns),
        }
    }

    /// Reads the vector sensor now; `None` if the platform has none.
    pub fn sample_vector(&mut self) -> Option<VectorSample> {
        let sensor = self.gyrostat.model().sensors.vector?;
        let then = self.history.at(self.now_ns - ns_from_s(sensor.latency_s), &self.snapshot());
        let noise = [self.vector_noise.draw(), self.vector_noise.draw()];
        Some(VectorSample { stamp_ns: self.now_ns, direction: sensor.reading(&then.q_world_body, &noise) })
    }

    /// Reads the joints of one kind of actuator now, in the order of its actuators.
    pub fn sample_joints(&mut self, kind: Kind) -> JointSample {
        let sensors = &self.gyrostat.model().sensors;
        let (states, drives) = (&self.state.actuators, &self.drive.actuators);
        let noise = &mut || self.wheel_noise.draw();
        self.gyrostat.model().actuators.sample(kind, states, drives, sensors, noise)
    }

    /// Reads the bus voltage now \[V\].
    pub fn sample_bus_voltage_v(&mut self) -> f64 {
        let truth = self.gyrostat.environment(self.time_s(), &self.state, &self.drive).bus_voltage_v;
        self.gyrostat.model().sensors.bus_voltage.reading(truth, self.bus_noise.draw())
    }

    /// Reads the platform's temperature now \[K\].
    pub fn sample_temperature_k(&mut self) -> f64 {
        let truth = self.gyrostat.environment(self.time_s(), &self.state, &self.drive).temperature_k;
        self.gyrostat.model().sensors.temperature.reading(truth, self.temperature_noise.draw())
    }

    fn snapshot(&self) -> Snapshot {
        Snapshot {
            time_ns: self.now_ns,
            q_world_body: self.state.q_world_body,
            omega_wb_b_rad_s: self.state.omega_wb_b_rad_s,
            omega_dot_wb_b_rad_s2: self.angular_acceleration_b_rad_s2(),
            behind_filter: self.behind_filter,
        }
    }

    /// What ideal inertial sensors see in this state of the body.
    pub(super) fn ideal_imu(&self, state: &State, omega_dot_wb_b_rad_s2: &Vector3<f64>) -> TrueImu {
        let model = self.gyrostat.model();
        self.gyrostat.ideal_imu(&Environment {
            omega_dot_wb_b_rad_s2: *omega_dot_wb_b_rad_s2,
            ..Environment::new(model, state.q_world_body, state.omega_wb_b_rad_s)
        })
    }

    /// Carries what is behind the sensors' low-pass over a step in which they saw this at its two ends.
    pub(super) fn filter(&mut self, from: &TrueImu, to: &TrueImu, step_s: f64) {
        let sensors = &self.gyrostat.model().sensors;
        let behind = &self.behind_filter;
        self.behind_filter = TrueImu {
            angular_velocity_b_rad_s: low_passed(
                &behind.angular_velocity_b_rad_s,
                &from.angular_velocity_b_rad_s,
                &to.angular_velocity_b_rad_s,
                step_s,
                sensors.gyro.errors.time_constant_s,
            ),
            specific_force_b_m_s2: low_passed(
                &behind.specific_force_b_m_s2,
                &from.specific_force_b_m_s2,
                &to.specific_force_b_m_s2,
                step_s,
                sensors.accelerometer.errors.time_constant_s,
            ),
        };
    }

    /// What inertial sensors of this latency and window read now, ideal ones otherwise. Wheels, valves and temperature
    /// enter as they are now: only effects on the sensors use them, and they change little meanwhile.
    fn true_imu(&self, now: &Snapshot, errors: &TriaxialErrors) -> TrueImu {
        let then = self.shown(errors, now);
        let mut environment = self.gyrostat.environment(self.time_s(), &self.state, &self.drive);
        environment.time_s -= errors.latency_s;
        environment.q_world_body = then.q_world_body;
        environment.vertical_b = vertical_b(&then.q_world_body);
        environment.omega_wb_b_rad_s = then.omega_wb_b_rad_s;
        environment.omega_dot_wb_b_rad_s2 = then.omega_dot_wb_b_rad_s2;
        let sensors = &self.gyrostat.model().sensors;
        let mut imu = self.gyrostat.ideal_imu(&environment);
        if sensors.gyro.errors.time_constant_s > 0.0 {
            imu.angular_velocity_b_rad_s = then.behind_filter.angular_velocity_b_rad_s;
        }
        if sensors.accelerometer.errors.time_constant_s > 0.0 {
            imu.specific_force_b_m_s2 = then.behind_filter.specific_force_b_m_s2;
        }
        self.gyrostat.effects().measure_imu(&environment, &mut imu);
        imu
    }
}
