//! Kinds of rigs.

/// A kind of rig, where somebody says which.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preset {
    /// A platform on an air bearing or a ball, with weight.
    Table,
    /// A body that turns about one axis: a pendulum, a turntable.
    Hinge,
    /// Wheels in a stand that does not turn.
    WheelBench,
    /// Nothing holds it: a spacecraft, a drone.
    Free,
}

impl Preset {
    /// All of them, by the word that people write.
    pub const ALL: [(&str, Self); 4] = [
        ("table", Self::Table),
        ("hinge", Self::Hinge),
        ("wheel_bench", Self::WheelBench),
        ("free", Self::Free),
    ];

    /// The kind of motion in the platform's file.
    pub(super) fn freedom(self) -> &'static str {
        match self {
            Self::Table => "on_bearing",
            Self::Hinge => "hinge",
            Self::WheelBench => "clamped",
            Self::Free => "free",
        }
    }
}
