//! A law that nobody listed: a drawn shape of a drawn variable about a drawn axis, in the judge's own equations.

use nalgebra::{Matrix3, Vector3};

/// What it depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Variable {
    RollRate,
    PitchRate,
    YawRate,
    Rate,
    TiltX,
    TiltY,
    Heading,
}

/// How.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    Square,
    Cube,
    SignedSquare,
    /// Nothing up to a third of the scale, then in proportion.
    DeadZone,
    /// In proportion up to a third of the scale, then constant.
    Saturation,
    /// Of the heading.
    Sine(u8),
}

/// A torque of this size where the variable is at its scale.
#[derive(Debug, Clone, PartialEq)]
pub struct DrawnLaw {
    pub variable: Variable,
    pub shape: Shape,
    /// Axis, of the body or of the world; `None`: against the rate.
    pub axis: Option<(bool, usize)>,
    pub scale: f64,
    pub size_n_m: f64,
}

impl DrawnLaw {
    /// Torque on the body [N m], body axes; the columns of `bn` are the world's axes in body axes.
    #[must_use]
    pub fn torque(&self, bn: &Matrix3<f64>, omega: &Vector3<f64>) -> Vector3<f64> {
        let x = match self.variable {
            Variable::RollRate => omega.x,
            Variable::PitchRate => omega.y,
            Variable::YawRate => omega.z,
            Variable::Rate => omega.norm(),
            Variable::TiltX => bn[(0, 2)],
            Variable::TiltY => bn[(1, 2)],
            Variable::Heading => bn[(0, 1)].atan2(bn[(0, 0)]),
        };
        let u = x / self.scale;
        let size = self.size_n_m
            * match self.shape {
                Shape::Square => u * u,
                Shape::Cube => u * u * u,
                Shape::SignedSquare => u * u.abs(),
                Shape::DeadZone => u.signum() * (u.abs() - 1.0 / 3.0).max(0.0),
                Shape::Saturation => u.signum() * u.abs().min(1.0 / 3.0),
                Shape::Sine(n) => (f64::from(n) * x).sin(),
            };
        match self.axis {
            None => omega * (-size / omega.norm().max(1e-9)),
            Some((false, i)) => Vector3::ith(i, size),
            Some((true, i)) => bn.column(i) * size,
        }
    }

    /// The variable as `whorl discover` names it.
    #[must_use]
    pub fn variable_text(&self) -> &'static str {
        match self.variable {
            Variable::RollRate => "rate.x",
            Variable::PitchRate => "rate.y",
            Variable::YawRate => "rate.z",
            Variable::Rate => "norm(rate)",
            Variable::TiltX => "vertical.x",
            Variable::TiltY => "vertical.y",
            Variable::Heading => "heading",
        }
    }

    /// The factor that is of the true form, without its constants: a part of the equation.
    #[must_use]
    pub fn form(&self) -> String {
        let x = self.variable_text();
        match self.shape {
            Shape::Square => format!("{x}^2"),
            Shape::Cube => format!("{x}^3"),
            Shape::SignedSquare => format!("abs({x}) * {x}"),
            Shape::DeadZone => format!("beyond({x}"),
            Shape::Saturation => format!("limit({x}"),
            Shape::Sine(1) => "(heading)".to_owned(),
            Shape::Sine(n) => format!("({n} * heading)"),
        }
    }
}
