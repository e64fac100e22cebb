//! One mass on its way: a spindle at constant speed, and the mass that it pushes across its play.

use super::MovingMass;

/// The way of one spindle from an instant on, and where the mass was then.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Course {
    start_ns: i64,
    /// Of the spindle \[m\].
    from_m: f64,
    to_m: f64,
    /// Of the mass at the start \[m\].
    mass_from_m: f64,
}

impl Course {
    /// At rest in the middle of the play.
    pub fn resting(position_m: f64) -> Self {
        Self { start_ns: 0, from_m: position_m, to_m: position_m, mass_from_m: position_m }
    }

    /// Where the spindle is going \[m\].
    pub fn target_m(&self) -> f64 {
        self.to_m
    }

    /// The spindle's position `offset_s` after `now_ns` \[m\].
    pub fn spindle_m(&self, mass: &MovingMass, now_ns: i64, offset_s: f64) -> f64 {
        let elapsed_s = (now_ns - self.start_ns) as f64 * 1e-9 + offset_s;
        let reach_m = mass.max_speed_m_s * elapsed_s.max(0.0);
        self.from_m + (self.to_m - self.from_m).max(-reach_m).min(reach_m)
    }

    /// The mass's position \[m\]. As the spindle moves one way only, the play operator needs no history besides where
    /// the mass was at the start.
    pub fn mass_m(&self, mass: &MovingMass, now_ns: i64, offset_s: f64) -> f64 {
        let spindle_m = self.spindle_m(mass, now_ns, offset_s);
        let half_m = 0.5 * mass.backlash_m;
        self.mass_from_m.max(spindle_m - half_m).min(spindle_m + half_m)
    }

    /// From now on to another target, from where spindle and mass are.
    pub fn turn_to(&mut self, mass: &MovingMass, to_m: f64, now_ns: i64) {
        *self = Self {
            start_ns: now_ns,
            from_m: self.spindle_m(mass, now_ns, 0.0),
            to_m,
            mass_from_m: self.mass_m(mass, now_ns, 0.0),
        };
    }

    /// At the target at once, having come there from where it was.
    pub fn put(&mut self, mass: &MovingMass, to_m: f64, now_ns: i64) {
        let half_m = 0.5 * mass.backlash_m;
        let mass_m = self.mass_m(mass, now_ns, 0.0).max(to_m - half_m).min(to_m + half_m);
        *self = Self { start_ns: now_ns, from_m: to_m, to_m, mass_from_m: mass_m };
    }

    /// The next instant after `now_ns` at which the motion has a kink: the spindle meets the mass, or arrives \[ns\].
    pub fn next_event_ns(&self, mass: &MovingMass, now_ns: i64) -> i64 {
        let way_m = self.to_m - self.from_m;
        let sense = way_m.signum();
        let contact_m = (self.mass_from_m - self.from_m) * sense + 0.5 * mass.backlash_m;
        let after = |distance_m: f64| {
            // Beyond a century nothing is awaited.
            self.start_ns.saturating_add((distance_m / mass.max_speed_m_s * 1e9).ceil().clamp(0.0, 3.0e18) as i64)
        };
        let contact_ns = (contact_m < way_m.abs()).then(|| after(contact_m));
        let arrival_ns = (way_m != 0.0).then(|| after(way_m.abs()));
        [contact_ns, arrival_ns].into_iter().flatten().filter(|at| *at > now_ns).min().unwrap_or(i64::MAX)
    }
}
