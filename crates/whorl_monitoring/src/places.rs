//! Where what is estimated stands in the filter's state.

/// Places of the state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Places {
    /// Wheels of the platform.
    pub wheels: usize,
    /// Constants of the platform.
    pub constants: usize,
}

impl Places {
    /// Rate and wheel speeds.
    #[must_use]
    pub fn motion(&self) -> usize {
        3 + self.wheels
    }

    pub(crate) fn bias(&self) -> usize {
        self.motion()
    }

    /// The first of the background torques.
    #[must_use]
    pub fn torque(&self) -> usize {
        self.motion() + 3
    }

    pub(crate) fn wheel_torque(&self) -> usize {
        self.motion() + 6
    }

    /// The first of the platform's constants.
    #[must_use]
    pub fn first_constant(&self) -> usize {
        self.motion() + 6 + self.wheels
    }

    /// Length of the state.
    #[must_use]
    pub fn len(&self) -> usize {
        self.first_constant() + self.constants
    }

    /// Never.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        false
    }
}
