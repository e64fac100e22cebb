//! Authority over this platform: the coordinator's heartbeat.

use whorl_msgs::whorl::FormationCommand;
use whorl_node::Timestamp;

use crate::inputs::{Order, Refused};

/// Longest validity that a heartbeat may claim [s].
const LONGEST_VALIDITY_S: f64 = 5.0;

/// The current command of the authority.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Authority {
    /// No authority, or standby commanded: actuators off.
    None,
    /// Follow the reference.
    Track,
    /// Hold the current reference.
    Hold,
    /// Safe mode.
    Abort,
    /// The heartbeat stopped this long ago [s] while tracking or holding.
    Lost(f64),
}

/// The latest heartbeat.
#[derive(Debug, Clone, Copy, Default)]
pub struct Heartbeat {
    order: Order,
    latest: Option<(u8, Timestamp)>,
}

impl Heartbeat {
    /// Takes a heartbeat. Its validity counts from its arrival, so that a difference between two
    /// computers' clocks neither ends nor prolongs it.
    pub fn arrived(
        &mut self,
        now: Timestamp,
        message: &FormationCommand,
        max_age_s: f64,
        refused: &mut Refused,
    ) {
        let Some(stamp) = self.order.admit(&message.header, now, max_age_s, refused) else { return };
        let validity_s =
            Timestamp::from(message.valid_until).seconds_since(stamp).clamp(0.0, LONGEST_VALIDITY_S);
        self.latest = Some((message.command, Timestamp(now.0.saturating_add((validity_s * 1e9) as i64))));
    }

    /// The current command. An abort persists until another command arrives: it ends with actuators off.
    pub fn authority(&self, now: Timestamp) -> Authority {
        let Some((command, expires)) = self.latest else { return Authority::None };
        let lost_s = now.seconds_since(expires);
        match command {
            FormationCommand::COMMAND_ABORT => Authority::Abort,
            FormationCommand::COMMAND_TRACK | FormationCommand::COMMAND_HOLD if lost_s > 0.0 => {
                Authority::Lost(lost_s)
            }
            FormationCommand::COMMAND_TRACK => Authority::Track,
            FormationCommand::COMMAND_HOLD => Authority::Hold,
            // STANDBY, and commands unknown to this version.
            _ => Authority::None,
        }
    }
}
