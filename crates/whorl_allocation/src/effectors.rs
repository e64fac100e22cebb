//! What can turn the body: jets and motors, checked once.
//!
//! A *jet* is on or off and costs gas. A *motor* takes any command between its limits at once and costs none: the
//! motor of a wheel (commanded by its torque), of a gimbal (by its rate).

use nalgebra::{Matrix3xX, Vector3};

use crate::list::{ListError, check_count, check_list};

/// Most jets an [`Effectors`] may have: one bit each in a [`crate::JetMask`].
pub const MAX_JETS: usize = 32;
/// Most motors an [`Effectors`] may have.
pub const MAX_MOTORS: usize = 16;

/// Largest number in a layout, in its unit: keeps squares and ratios finite.
const LARGEST: f64 = 1e9;

/// The plain description from which [`Effectors`] are checked and built.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectorLayout {
    /// One column per jet: torque on the body about the centre of rotation at full thrust, body
    /// axes [N m].
    pub jet_torque_b_n_m: Matrix3xX<f64>,
    /// One column per jet: force on the body at full thrust, body axes \[N\]. `None` when net force
    /// is of no concern, as on an air bearing; needed for [`crate::TorqueDemand::net_force_weight`].
    pub jet_force_b_n: Option<Matrix3xX<f64>>,
    /// Gas drawn by each jet while open [kg/s] (any other unit serves as a relative cost); > 0.
    pub jet_gas_rate_kg_s: Vec<f64>,
    /// One column per motor: torque on the body per unit of its command, body axes. Of a wheel that is its spin axis
    /// with a minus sign: a motor that accelerates its wheel turns the body the other way.
    pub motor_torque_b: Matrix3xX<f64>,
    /// Largest command of each motor, in its unit; > 0.
    pub motor_limit: Vec<f64>,
}

/// Jets and motors of a platform: finite, counted, consistent.
#[derive(Debug, Clone, PartialEq)]
pub struct Effectors {
    layout: EffectorLayout,
}

/// Why a layout is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EffectorError {
    /// Neither jets nor motors.
    #[error("no jets and no motors: nothing to allocate to")]
    Empty,
    /// More jets than [`MAX_JETS`].
    #[error("{0} jets; at most {MAX_JETS} are supported")]
    TooManyJets(usize),
    /// More motors than [`MAX_MOTORS`].
    #[error("{0} motors; at most {MAX_MOTORS} are supported")]
    TooManyMotors(usize),
    /// A list does not fit.
    #[error(transparent)]
    List(#[from] ListError),
}

impl Effectors {
    /// Checks a layout.
    ///
    /// # Errors
    /// [`EffectorError`] naming the field, the jet or motor and the value.
    pub fn new(layout: EffectorLayout) -> Result<Self, EffectorError> {
        let jets = layout.jet_torque_b_n_m.ncols();
        let motors = layout.motor_torque_b.ncols();
        if jets + motors == 0 {
            return Err(EffectorError::Empty);
        }
        if jets > MAX_JETS {
            return Err(EffectorError::TooManyJets(jets));
        }
        if motors > MAX_MOTORS {
            return Err(EffectorError::TooManyMotors(motors));
        }
        check_count("jet_gas_rate_kg_s", layout.jet_gas_rate_kg_s.len(), jets)?;
        check_count("motor_limit", layout.motor_limit.len(), motors)?;
        check_columns("jet_torque_b_n_m", &layout.jet_torque_b_n_m)?;
        if let Some(force) = &layout.jet_force_b_n {
            check_count("jet_force_b_n", force.ncols(), jets)?;
            check_columns("jet_force_b_n", force)?;
        }
        check_positive("jet_gas_rate_kg_s", &layout.jet_gas_rate_kg_s)?;
        check_positive("motor_limit", &layout.motor_limit)?;
        check_columns("motor_torque_b", &layout.motor_torque_b)?;
        Ok(Self { layout })
    }

    /// Number of jets.
    #[must_use]
    pub fn jets(&self) -> usize {
        self.layout.jet_torque_b_n_m.ncols()
    }

    /// Number of motors.
    #[must_use]
    pub fn motors(&self) -> usize {
        self.layout.motor_torque_b.ncols()
    }

    /// The checked layout.
    #[must_use]
    pub fn layout(&self) -> &EffectorLayout {
        &self.layout
    }

    pub(crate) fn set_motor_torque(&mut self, motor: usize, torque_b: &Vector3<f64>) {
        let sane = torque_b.iter().all(|value| value.abs() <= LARGEST);
        if sane && motor < self.motors() {
            self.layout.motor_torque_b.set_column(motor, torque_b);
        }
    }

    /// Torque on the body [N m] per unit of effector `k`: a jet's on-time fraction, then a motor's command.
    pub(crate) fn column(&self, k: usize) -> Vector3<f64> {
        let jets = self.jets();
        if k < jets {
            self.layout.jet_torque_b_n_m.column(k).into_owned()
        } else {
            self.layout.motor_torque_b.column(k - jets).into_owned()
        }
    }

    /// Torque on the body of given jet fractions and motor commands [N m].
    pub(crate) fn torque_b_n_m(&self, jet_on_fraction: &[f64], motor_command: &[f64]) -> Vector3<f64> {
        jet_on_fraction
            .iter()
            .chain(motor_command)
            .enumerate()
            .fold(Vector3::zeros(), |sum, (k, &x)| sum + self.column(k) * x)
    }
}

fn check_columns(field: &'static str, columns: &Matrix3xX<f64>) -> Result<(), ListError> {
    for (index, column) in columns.column_iter().enumerate() {
        if let Some(&value) = column.iter().find(|value| value.is_nan() || value.abs() > LARGEST) {
            let allowed = "finite, at most 1e9";
            return Err(ListError::Value { field, index, value, allowed });
        }
    }
    Ok(())
}

fn check_positive(field: &'static str, values: &[f64]) -> Result<(), ListError> {
    let valid = |value| (1.0 / LARGEST..=LARGEST).contains(&value);
    check_list(field, values, values.len(), valid, "in 1e-9..=1e9")
}
