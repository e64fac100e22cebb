//! A rest-to-rest profile of one coordinate with bounded rate and acceleration and a continuous
//! acceleration.
//!
//! The trapezoidal rate profile is the time-optimal one under bounds on rate and acceleration; its
//! corners excite slosh and flexible modes and ask the actuators for steps. Here each ramp of the
//! rate follows `3 x^2 - 2 x^3` instead of a line: acceleration is a parabola with peak
//! `1.5 v / T_ramp` and the jerk stays below `6 v / T_ramp^2`. The price is a ramp 1.5 times as
//! long.

/// The profile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmoothTrapezoid {
    distance: f64,
    peak_rate_s: f64,
    ramp_s: f64,
    cruise_s: f64,
}

/// Coordinate and its derivatives at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProfilePoint {
    /// The coordinate, 0 to the distance.
    pub position: f64,
    /// First derivative \[1/s\].
    pub rate_s: f64,
    /// Second derivative \[1/s^2\].
    pub acceleration_s2: f64,
}

impl SmoothTrapezoid {
    /// The shortest such profile over `distance` (>= 0), rate and acceleration limits > 0.
    ///
    /// Limits that are not positive and distances that are not are taken as "do not move".
    #[must_use]
    pub fn new(distance: f64, max_rate_s: f64, max_acceleration_s2: f64) -> Self {
        let still = Self { distance: 0.0, peak_rate_s: 0.0, ramp_s: 0.0, cruise_s: 0.0 };
        if !(distance > 0.0 && max_rate_s > 0.0 && max_acceleration_s2 > 0.0 && distance.is_finite()) {
            return still;
        }
        // Both ramps together cover peak * ramp = 1.5 peak^2 / acceleration.
        let peak_rate_s = max_rate_s.min((distance * max_acceleration_s2 / 1.5).sqrt());
        if peak_rate_s <= 0.0 {
            return still;
        }
        let ramp_s = 1.5 * peak_rate_s / max_acceleration_s2;
        Self { distance, peak_rate_s, ramp_s, cruise_s: (distance / peak_rate_s - ramp_s).max(0.0) }
    }

    /// From start to rest \[s\].
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        2.0 * self.ramp_s + self.cruise_s
    }

    /// The point at `elapsed_s` after the start; clamped to the ends.
    #[must_use]
    pub fn at(&self, elapsed_s: f64) -> ProfilePoint {
        let duration_s = self.duration_s();
        if elapsed_s.is_nan() || elapsed_s <= 0.0 || duration_s <= 0.0 {
            return ProfilePoint { position: 0.0, rate_s: 0.0, acceleration_s2: 0.0 };
        }
        if elapsed_s >= duration_s {
            return ProfilePoint { position: self.distance, rate_s: 0.0, acceleration_s2: 0.0 };
        }
        if elapsed_s < self.ramp_s {
            return self.ramp(elapsed_s);
        }
        if elapsed_s <= self.ramp_s + self.cruise_s {
            return ProfilePoint {
                position: self.peak_rate_s * (elapsed_s - 0.5 * self.ramp_s),
                rate_s: self.peak_rate_s,
                acceleration_s2: 0.0,
            };
        }
        let mirrored = self.ramp(duration_s - elapsed_s);
        ProfilePoint {
            position: self.distance - mirrored.position,
            rate_s: mirrored.rate_s,
            acceleration_s2: -mirrored.acceleration_s2,
        }
    }

    fn ramp(&self, elapsed_s: f64) -> ProfilePoint {
        let x = elapsed_s / self.ramp_s;
        ProfilePoint {
            position: self.peak_rate_s * self.ramp_s * x * x * x * (1.0 - 0.5 * x),
            rate_s: self.peak_rate_s * x * x * (3.0 - 2.0 * x),
            acceleration_s2: self.peak_rate_s / self.ramp_s * 6.0 * x * (1.0 - x),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_move_cruises_at_the_rate_limit_and_takes_the_computed_time() {
        // 2 rad at 0.1 rad/s and 0.05 rad/s^2: ramps of 3 s cover 0.15 rad each, cruise 17 s.
        let p = SmoothTrapezoid::new(2.0, 0.1, 0.05);
        assert!((p.duration_s() - 23.0).abs() < 1e-12);
        assert!((p.at(11.5).position - 1.0).abs() < 1e-12);
        assert!((p.at(11.5).rate_s - 0.1).abs() < 1e-15);
    }

    #[test]
    fn derivatives_are_consistent_and_within_limits_also_for_a_short_move() {
        for distance in [2.0, 0.01] {
            let p = SmoothTrapezoid::new(distance, 0.1, 0.05);
            let dt = p.duration_s() / 5000.0;
            let (mut top_rate, mut top_acceleration) = (0.0_f64, 0.0_f64);
            for k in 1..5000 {
                let t = f64::from(k) * dt;
                let (before, here, after) = (p.at(t - 0.5 * dt), p.at(t), p.at(t + 0.5 * dt));
                assert!(((after.position - before.position) / dt - here.rate_s).abs() < 1e-6);
                assert!(((after.rate_s - before.rate_s) / dt - here.acceleration_s2).abs() < 1e-4);
                top_rate = top_rate.max(here.rate_s);
                top_acceleration = top_acceleration.max(here.acceleration_s2.abs());
            }
            assert!(top_rate <= 0.1 + 1e-15 && top_acceleration <= 0.05 + 1e-15);
            assert!(top_acceleration > 0.0499);
            assert_eq!(p.at(p.duration_s()).position, distance);
            assert!((p.at(0.5 * p.duration_s()).position - distance / 2.0).abs() < 1e-12);
        }
    }

    #[test]
    fn nothing_to_do_takes_no_time() {
        for p in [
            SmoothTrapezoid::new(0.0, 0.1, 0.1),
            SmoothTrapezoid::new(1.0, 0.0, 0.1),
            SmoothTrapezoid::new(f64::NAN, 0.1, 0.1),
        ] {
            assert_eq!(p.duration_s(), 0.0);
            assert_eq!(p.at(1.0).position, 0.0);
        }
    }
}
