//! The reference that the tracking law follows in this step.
//!
//! It never jumps: it starts from the body's own motion, follows the coordinator's reference
//! exactly while that one moves within its rate and acceleration, and approaches it through a
//! [`CommandFilter`] when it is elsewhere (at the start, after a link returned).

use whorl_control::reference::{CommandFilter, CommandFilterSettings, Reference, TiltEnvelope, Validity};
use whorl_math::attitude_error;
use whorl_node::Timestamp;

/// Further away than this the reference is approached through the filter [rad]: 0.5 deg.
const JUMP_RAD: f64 = 8.7e-3;
/// The same for its rate [rad/s]: 0.5 deg/s.
const JUMP_RAD_S: f64 = 8.7e-3;
/// Closer than this the filter is no longer needed.
const JOINED_RAD: f64 = 2e-4;
/// The same for its rate [rad/s].
const JOINED_RAD_S: f64 = 2e-4;
/// A gap between steps after which the previous target is not used [s].
const LONGEST_GAP_S: f64 = 1.0;

/// Input of the target.
#[derive(Debug, Clone, Copy)]
pub enum Goal<'a> {
    /// The coordinator's reference: its stamp, validity after that [s], and value.
    Follow(Timestamp, f64, &'a Reference),
    /// Decelerate and stand still.
    Hold,
}

/// The target's memory.
#[derive(Debug, Clone)]
pub struct Target {
    settings: CommandFilterSettings,
    deceleration_rad_s2: f64,
    envelope: TiltEnvelope,
    /// The target of the latest step.
    latest: Option<(Timestamp, Reference)>,
    /// Where and when holding began.
    hold: Option<(Timestamp, Reference)>,
    filter: Option<CommandFilter>,
}

/// The target at one instant.
#[derive(Debug, Clone, Copy)]
pub struct Aim {
    /// The reference to track.
    pub reference: Reference,
    /// The coordinator's reference had run out.
    pub stale: bool,
}

impl Target {
    /// Nothing to follow yet. Rejoin settings must be valid for [`CommandFilter::new`]; otherwise a
    /// jump is followed as it comes.
    pub fn new(settings: CommandFilterSettings, deceleration_rad_s2: f64, envelope: TiltEnvelope) -> Self {
        Self { settings, deceleration_rad_s2, envelope, latest: None, hold: None, filter: None }
    }

    /// Resets: the next step starts from the body's own motion.
    pub fn reset(&mut self) {
        self.latest = None;
        self.hold = None;
        self.filter = None;
    }

    /// Applies new settings.
    pub fn reconfigure(&mut self, fresh: Self) {
        *self = Self { latest: self.latest, hold: self.hold, filter: self.filter.take(), ..fresh };
    }

    /// The target at `stamp`, starting from `body` if there was none before.
    pub fn step(&mut self, stamp: Timestamp, goal: Goal<'_>, body: &Reference) -> Aim {
        let previous = self.latest.filter(|(at, _)| {
            let gap_s = stamp.seconds_since(*at);
            (0.0..=LONGEST_GAP_S).contains(&gap_s)
        });
        if previous.is_none() {
            self.reset();
        }
        let (previous_stamp, previous) = previous.unwrap_or((stamp, self.envelope.clip_reference(body).0));
        let dt_s = stamp.seconds_since(previous_stamp);

        let aim = match goal {
            Goal::Hold => {
                self.filter = None;
                let (since, start) = *self.hold.get_or_insert((previous_stamp, previous));
                let elapsed_s = stamp.seconds_since(since);
                let reference = start.coming_to_rest(elapsed_s, self.deceleration_rad_s2);
                Aim { reference: self.envelope.clip_reference(&reference).0, stale: false }
            }
            Goal::Follow(from, valid_for_s, reference) => {
                self.hold = None;
                let validity = Validity { valid_for_s, deceleration_rad_s2: self.deceleration_rad_s2 };
                let extrapolated = validity.apply(reference, stamp.seconds_since(from));
                let wanted = self.envelope.clip_reference(&extrapolated.reference).0;
                Aim { reference: self.joined(&previous, &wanted, dt_s), stale: !extrapolated.fresh }
            }
        };
        self.latest = Some((stamp, aim.reference));
        aim
    }

    fn joined(&mut self, previous: &Reference, wanted: &Reference, dt_s: f64) -> Reference {
        if self.filter.is_none() {
            let expected = previous.extrapolated(dt_s);
            let (angle_rad, rate_rad_s) = distance(&expected, wanted);
            if angle_rad > JUMP_RAD || rate_rad_s > JUMP_RAD_S {
                self.filter = CommandFilter::new(self.settings, *previous).ok();
            }
        }
        let Some(filter) = &mut self.filter else { return *wanted };
        filter.step(wanted, dt_s, &self.envelope);
        let reference = *filter.reference();
        let (angle_rad, rate_rad_s) = distance(&reference, wanted);
        if angle_rad < JOINED_RAD && rate_rad_s < JOINED_RAD_S {
            self.filter = None;
        }
        reference
    }
}

/// Angle [rad] and difference of rates [rad/s] between two references.
fn distance(a: &Reference, b: &Reference) -> (f64, f64) {
    let a_from_b = a.q_world_reference.inverse() * b.q_world_reference;
    let rate = a_from_b * b.omega_wr_r_rad_s - a.omega_wr_r_rad_s;
    (attitude_error(&a.q_world_reference, &b.q_world_reference).norm(), rate.norm())
}
