//! The interface to control of a kind whose actuators are moved by motors: wheels, gimbals.

use nalgebra::Vector3;

/// Measured states of the parts that the motors of one kind move, in the order of its actuators; missing entries
/// count as zero.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Joints {
    /// Positions \[rad\], where the kind needs them.
    pub position_rad: Vec<f64>,
    /// Speeds [rad/s].
    pub velocity_rad_s: Vec<f64>,
}

impl Joints {
    /// Speed of one part [rad/s].
    #[must_use]
    pub fn velocity(&self, member: usize) -> f64 {
        self.velocity_rad_s.get(member).copied().unwrap_or(0.0)
    }

    /// Position of one part \[rad\].
    #[must_use]
    pub fn position(&self, member: usize) -> f64 {
        self.position_rad.get(member).copied().unwrap_or(0.0)
    }
}

/// One motor at one instant: a column of the allocation. The *net* command is what turns the body; what the motor is
/// told is that and the feed-forward.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Motor {
    /// Torque on the body per unit of net command, body axes [N m per unit].
    pub torque_b: Vector3<f64>,
    /// Largest command, either sign, whatever the state; > 0.
    pub limit: f64,
    /// Least net command now.
    pub min: f64,
    /// Largest net command now.
    pub max: f64,
    /// Command on top of the net one, to counter friction and effects on the part that is moved.
    pub feedforward: f64,
}
