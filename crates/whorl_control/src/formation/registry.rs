//! The laws by their names.

use super::{RelativeAttitudeLaw, Roster, Settings};

/// A law as the catalogue has it.
#[derive(Debug, Clone, Copy)]
pub struct RegisteredLaw {
    kind: fn() -> &'static str,
    runs_on_platforms: fn() -> bool,
    read: fn(&mut dyn Settings, &Roster<'_>) -> Option<Box<dyn RelativeAttitudeLaw>>,
}

impl RegisteredLaw {
    pub(super) const fn of<L: RelativeAttitudeLaw + Clone + PartialEq + 'static>() -> Self {
        Self {
            kind: L::kind,
            runs_on_platforms: L::runs_on_platforms,
            read: |settings, roster| Some(Box::new(L::read(settings, roster)?)),
        }
    }

    /// Its name in parameter files, messages and reports.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        (self.kind)()
    }

    /// Whether each platform may run it for itself.
    #[must_use]
    pub fn runs_on_platforms(&self) -> bool {
        (self.runs_on_platforms)()
    }

    /// The law with the user's settings; `None` after they were refused.
    pub fn read(
        &self,
        settings: &mut dyn Settings,
        roster: &Roster<'_>,
    ) -> Option<Box<dyn RelativeAttitudeLaw>> {
        (self.read)(settings, roster)
    }
}
