//! What can turn the body: jets and wheels, checked once.

use nalgebra::{Matrix3xX, Vector3};

use crate::list::{ListError, check_count, check_list};

/// Most jets an [`Effectors`] may have: one bit each in a [`crate::JetMask`].
pub const MAX_JETS: usize = 32;
/// Most wheels an [`Effectors`] may have.
pub const MAX_WHEELS: usize = 8;

/// Largest number in a layout, in its unit: keeps squares and ratios finite.
const LARGEST: f64 = 1e9;

/// The plain description from which [`Effectors`] are checked and built.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectorLayout {
    /// One column per jet: torque on the body about the centre of rotation at full thrust, body
    /// axes [N m].
    pub jet_torque_b_n_m: Matrix3xX<f64>,
    /// One column per jet: force on the body at full thrust, body axes \[N\]. `None` when net force
    /// is of no concern, as on an air bearing; needed for [`crate::Demand::net_force_weight`].
    pub jet_force_b_n: Option<Matrix3xX<f64>>,
    /// Gas drawn by each jet while open [kg/s] (any other unit serves as a relative cost); > 0.
    pub jet_gas_rate_kg_s: Vec<f64>,
    /// One column per wheel: spin axis, body axes, unit length.
    pub wheel_axis_b: Matrix3xX<f64>,
    /// Largest motor torque of each wheel [N m]; > 0.
    pub wheel_torque_limit_n_m: Vec<f64>,
}

/// Jets and wheels of a platform: finite, counted, consistent.
#[derive(Debug, Clone, PartialEq)]
pub struct Effectors {
    layout: EffectorLayout,
}

/// Why a layout is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EffectorError {
    /// Neither jets nor wheels.
    #[error("no jets and no wheels: nothing to allocate to")]
    Empty,
    /// More jets than [`MAX_JETS`].
    #[error("{0} jets; at most {MAX_JETS} are supported")]
    TooManyJets(usize),
    /// More wheels than [`MAX_WHEELS`].
    #[error("{0} wheels; at most {MAX_WHEELS} are supported")]
    TooManyWheels(usize),
    /// A list does not fit.
    #[error(transparent)]
    List(#[from] ListError),
}

impl Effectors {
    /// Checks a layout.
    ///
    /// # Errors
    /// [`EffectorError`] naming the field, the jet or wheel and the value.
    pub fn new(layout: EffectorLayout) -> Result<Self, EffectorError> {
        let jets = layout.jet_torque_b_n_m.ncols();
        let wheels = layout.wheel_axis_b.ncols();
        if jets + wheels == 0 {
            return Err(EffectorError::Empty);
        }
        if jets > MAX_JETS {
            return Err(EffectorError::TooManyJets(jets));
        }
        if wheels > MAX_WHEELS {
            return Err(EffectorError::TooManyWheels(wheels));
        }
        check_count("jet_gas_rate_kg_s", layout.jet_gas_rate_kg_s.len(), jets)?;
        check_count("wheel_torque_limit_n_m", layout.wheel_torque_limit_n_m.len(), wheels)?;
        check_columns("jet_torque_b_n_m", &layout.jet_torque_b_n_m)?;
        if let Some(force) = &layout.jet_force_b_n {
            check_count("jet_force_b_n", force.ncols(), jets)?;
            check_columns("jet_force_b_n", force)?;
        }
        check_positive("jet_gas_rate_kg_s", &layout.jet_gas_rate_kg_s)?;
        check_positive("wheel_torque_limit_n_m", &layout.wheel_torque_limit_n_m)?;
        check_columns("wheel_axis_b", &layout.wheel_axis_b)?;
        for (index, axis) in layout.wheel_axis_b.column_iter().enumerate() {
            let norm = axis.norm();
            if (norm - 1.0).abs() > 1e-6 {
                let allowed = "of length 1";
                return Err(ListError::Value { field: "wheel_axis_b", index, value: norm, allowed }.into());
            }
        }
        Ok(Self { layout })
    }

    /// Number of jets.
    #[must_use]
    pub fn jets(&self) -> usize {
        self.layout.jet_torque_b_n_m.ncols()
    }

    /// Number of wheels.
    #[must_use]
    pub fn wheels(&self) -> usize {
        self.layout.wheel_axis_b.ncols()
    }

    /// The checked layout.
    #[must_use]
    pub fn layout(&self) -> &EffectorLayout {
        &self.layout
    }

    /// Torque on the body [N m] per unit of effector `k`: a jet's on-time fraction, then a wheel's
    /// motor torque [N m]. A motor that accelerates its wheel turns the body the other way, hence
    /// the minus sign.
    pub(crate) fn column(&self, k: usize) -> Vector3<f64> {
        let jets = self.jets();
        if k < jets {
            self.layout.jet_torque_b_n_m.column(k).into_owned()
        } else {
            -self.layout.wheel_axis_b.column(k - jets)
        }
    }

    /// Torque on the body of given jet fractions and wheel motor torques [N m].
    pub(crate) fn torque_b_n_m(&self, jet_on_fraction: &[f64], wheel_n_m: &[f64]) -> Vector3<f64> {
        jet_on_fraction
            .iter()
            .chain(wheel_n_m)
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
