//! Do accelerometer and magnetometer turn with the gyro?
//!
//! Gravity and the field are nearly fixed in the world. Where the gyro says that the sensor turned by `R` between two samples,
//! the later one is `v_1 = R^T v_0`, in right axes. For each order of the axes and each choice of signs `S` (24, as `S` and `-S`
//! say the same) the misfit `|S v_1 - R^T S v_0|^2` is summed up. A reversed axis makes the axes left-handed: what is seen turns
//! the other way. A sensor is contradicted when its axes as they are explain the turns worse than no turn at all would, and
//! others explain them well.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use whorl_math::quaternion_exp;

/// Turns of at least this are looked at \[rad\] ...
const LEAST_TURN_RAD: f64 = 0.4;
/// ... within this time, in which the gyro's bias turns it by less \[s\].
const LONGEST_S: f64 = 4.0;
/// Turns that are needed, and the sum of their squared chords over the square of the length \[1\].
const TURNS: u32 = 8;
const POWER: f64 = 0.2;
/// The axes as they are leave more than this of the turns, ...
const CONTRADICTED: f64 = 0.5;
/// ... others less than this of the turns, and than this of what the axes as they are leave \[1\].
const EXPLAINED: f64 = 0.2;
const BETTER: f64 = 0.1;
/// Other axes explain the turns as well when they leave less than so many times the least.
const AS_WELL: f64 = 2.0;
/// A specific force within this of gravity shows the vertical [m/s^2].
const NEAR_GRAVITY_M_S2: f64 = 1.0;
const GRAVITY_M_S2: f64 = 9.81;

/// Orders of axes and signs.
const HYPOTHESES: usize = 24;

/// The misfit of one sensor.
#[derive(Clone, Debug, PartialEq)]
struct Turns {
    before: Option<Vector3<f64>>,
    /// Since then.
    turn: UnitQuaternion<f64>,
    elapsed_s: f64,
    count: u32,
    power: f64,
    misfit: [f64; HYPOTHESES],
}

/// Which axes would explain what a contradicted sensor saw.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Contradiction {
    /// Axes of the sensor one of which may be reversed.
    pub reversed: Vec<char>,
    /// The order and signs that explain the turns, where no reversed axis does: `x` is read from the first, and so on.
    pub order: Option<[String; 3]>,
}

/// Compares what accelerometer and magnetometer saw with the gyro's turns.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisCheck {
    previous_ns: Option<i64>,
    force: Turns,
    field: Turns,
}

impl Default for AxisCheck {
    fn default() -> Self {
        Self { previous_ns: None, force: Turns::new(), field: Turns::new() }
    }
}

impl AxisCheck {
    /// A sample of gyro [rad/s] and accelerometer [m/s^2].
    pub fn on_imu(&mut self, stamp_ns: i64, gyro_rad_s: &Vector3<f64>, force_m_s2: Option<&Vector3<f64>>) {
        let dt_s = self.previous_ns.map_or(0.0, |before_ns| stamp_ns.saturating_sub(before_ns) as f64 * 1e-9);
        self.previous_ns = Some(stamp_ns);
        if !(0.0..=LONGEST_S).contains(&dt_s) || !gyro_rad_s.sum().is_finite() {
            (self.force.before, self.field.before) = (None, None);
            return;
        }
        let turn = quaternion_exp(&(gyro_rad_s * dt_s));
        for sensor in [&mut self.force, &mut self.field] {
            sensor.turn *= turn;
            sensor.elapsed_s += dt_s;
        }
        let near = force_m_s2.filter(|force| (force.norm() - GRAVITY_M_S2).abs() < NEAR_GRAVITY_M_S2);
        if let Some(force) = near {
            self.force.add(force);
        }
    }

    /// A sample of the magnetometer, at the time of the latest sample of the gyro.
    pub fn on_field(&mut self, field: &Vector3<f64>) {
        self.field.add(field);
    }

    /// What contradicts the gyro: accelerometer, magnetometer.
    #[must_use]
    pub fn contradictions(&self) -> [Option<Contradiction>; 2] {
        [self.force.contradiction(), self.field.contradiction()]
    }
}

impl Turns {
    fn new() -> Self {
        Self {
            before: None,
            turn: UnitQuaternion::identity(),
            elapsed_s: 0.0,
            count: 0,
            power: 0.0,
            misfit: [0.0; HYPOTHESES],
        }
    }

    fn add(&mut self, seen: &Vector3<f64>) {
        let Some(seen) = seen.try_normalize(1e-9) else { return };
        let turned_rad = self.turn.angle();
        if let Some(before) = self.before.filter(|_| self.elapsed_s <= LONGEST_S) {
            if turned_rad < LEAST_TURN_RAD {
                return;
            }
            let back = self.turn.inverse().to_rotation_matrix();
            for (misfit, axes) in self.misfit.iter_mut().zip(hypotheses()) {
                *misfit += (axes * seen - back * (axes * before)).norm_squared();
            }
            self.power += (seen - before).norm_squared();
            self.count += 1;
        }
        self.before = Some(seen);
        self.turn = UnitQuaternion::identity();
        self.elapsed_s = 0.0;
    }

    fn contradiction(&self) -> Option<Contradiction> {
        if self.count < TURNS || self.power < POWER {
            return None;
        }
        let as_is = *self.misfit.first()?;
        let least = self.misfit.iter().copied().fold(f64::INFINITY, f64::min);
        let is_contradicted =
            as_is > CONTRADICTED * self.power && least < EXPLAINED * self.power && least < BETTER * as_is;
        if !is_contradicted {
            return None;
        }
        let fits: Vec<Matrix3<f64>> = hypotheses()
            .zip(self.misfit)
            .filter(|(_, misfit)| *misfit <= AS_WELL * least)
            .map(|(axes, _)| axes)
            .collect();
        let reverses = |axis: usize| {
            let mut one = Matrix3::identity();
            one[(axis, axis)] = -1.0;
            fits.iter().any(|axes| *axes == one || *axes == -one)
        };
        let names = ['x', 'y', 'z'];
        let reversed =
            names.into_iter().enumerate().filter(|(axis, _)| reverses(*axis)).map(|(_, name)| name);
        let reversed: Vec<char> = reversed.collect();
        let order = fits.first().filter(|_| reversed.is_empty()).map(|axes| {
            [0, 1, 2].map(|row| {
                let from = axes.row(row).iamax_full().1;
                let sign = if axes[(row, from)] < 0.0 { "-" } else { "" };
                format!("{sign}{}", names.get(from).copied().unwrap_or('x'))
            })
        });
        Some(Contradiction { reversed, order })
    }
}

impl std::fmt::Display for Contradiction {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let axes: Vec<String> = self.reversed.iter().map(char::to_string).collect();
        match &self.order {
            Some(order) => write!(f, "the order [{}] of its axes would fit", order.join(", ")),
            None => write!(f, "its axis {} is reversed", axes.join(" or ")),
        }
    }
}

/// What contradicts the gyro, in words: accelerometer, magnetometer.
#[must_use]
pub fn doubts(wrong: &[Option<Contradiction>; 2]) -> Vec<String> {
    let [force, field] = wrong;
    if let (Some(force), Some(field)) = (force, field)
        && force == field
    {
        return vec![format!(
            "The gyro turns against accelerometer and magnetometer, which agree: by them, {}, of the gyro. The attitudes are wrong; \
             correct the map.",
            force.to_string().replace("its ", "")
        )];
    }
    let both = [("accelerometer", "inclination", force), ("magnetometer", "heading", field)];
    let said =
        both.into_iter().filter_map(|(name, what, found)| found.as_ref().map(|found| (name, what, found)));
    said.map(|(name, what, found)| {
        format!(
            "The {name} turns against the gyro: {found}, or the gyro's axes are wrong. It is not used from where that is \
             seen on; the {what} is carried by the gyro. Correct the map (docs/recordings.md)."
        )
    })
    .collect()
}

/// The axes as they are first; of `S` and `-S` the one with the positive sign on x.
fn hypotheses() -> impl Iterator<Item = Matrix3<f64>> {
    const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    const SIGNS: [[f64; 2]; 4] = [[1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]];
    ORDERS.into_iter().flat_map(|order| {
        SIGNS.into_iter().map(move |[y, z]| {
            let mut axes = Matrix3::zeros();
            for (row, (from, sign)) in order.into_iter().zip([1.0, y, z]).enumerate() {
                axes[(row, from)] = sign;
            }
            axes
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A minute of turns about the axes of `rate` at 100 Hz; the sensors' axes are `force` and `field` of the true ones.
    fn check(rate: impl Fn(f64) -> Vector3<f64>, force: Matrix3<f64>, field: Matrix3<f64>) -> AxisCheck {
        let mut check = AxisCheck::default();
        let mut q = UnitQuaternion::from_euler_angles(0.2, 0.1, 0.4);
        for i in 0..6000_i64 {
            let w = rate(i as f64 * 0.01);
            q *= quaternion_exp(&(w * 0.01));
            // The hand accelerates, a bias and a magnet are there too.
            let shaken =
                Vector3::new(0.0, 0.0, 9.81) + Vector3::new(0.4, -0.3, 0.2) * (i as f64 * 0.31).sin();
            let near =
                Vector3::new(3.0, 20.0, -40.0) + Vector3::new(5.0, 0.0, 4.0) * (i as f64 * 0.003).sin();
            let gyro = w + Vector3::new(0.01, -0.02, 0.01);
            check.on_imu(i * 10_000_000, &gyro, Some(&(force * (q.inverse() * shaken))));
            if i % 5 == 0 {
                check.on_field(&(field * (q.inverse() * near)));
            }
        }
        check
    }

    fn tumble(t: f64) -> Vector3<f64> {
        Vector3::new(1.2 * (0.9 * t).sin(), (1.3 * t).sin(), 0.8 * (0.7 * t).cos())
    }

    fn diagonal(x: f64, y: f64, z: f64) -> Matrix3<f64> {
        Matrix3::from_diagonal(&Vector3::new(x, y, z))
    }

    #[test]
    fn right_axes_are_not_doubted() {
        let one = Matrix3::identity();
        for rate in [tumble, |t: f64| Vector3::z() * t.sin(), |_| Vector3::zeros()] {
            assert_eq!(check(rate, one, one).contradictions(), [None, None]);
        }
        // An upside-down accelerometer shows the same turns; its sign is the map's affair.
        assert_eq!(check(tumble, -one, one).contradictions(), [None, None]);
    }

    #[test]
    fn each_reversed_axis_is_named() {
        let one = Matrix3::identity();
        let axes = [
            ('x', diagonal(-1.0, 1.0, 1.0)),
            ('y', diagonal(1.0, -1.0, 1.0)),
            ('z', diagonal(1.0, 1.0, -1.0)),
        ];
        for (name, reversed) in axes {
            let [force, field] = check(tumble, reversed, one).contradictions();
            assert_eq!((force.unwrap().reversed, field), (vec![name], None));
            let [force, field] = check(tumble, one, reversed).contradictions();
            let field = field.unwrap();
            assert_eq!((force, field.to_string()), (None, format!("its axis {name} is reversed")));
        }
    }

    #[test]
    fn other_orders_are_told_as_a_map_has_them() {
        // The file has y, x, -z of the true axes.
        let swapped = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
        let rotated = diagonal(-1.0, -1.0, 1.0) * Matrix3::new(0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        for axes in [swapped, rotated] {
            let [_, field] = check(tumble, Matrix3::identity(), axes).contradictions();
            let order = field.unwrap().order.unwrap();
            let read = Matrix3::from_fn(|row, column| {
                let sign = if order[row].starts_with('-') { -1.0 } else { 1.0 };
                if order[row].ends_with(['x', 'y', 'z'][column]) { sign } else { 0.0 }
            });
            let right = read * axes;
            assert!(right == Matrix3::identity() || right == -Matrix3::identity(), "{order:?}");
        }
    }

    #[test]
    fn about_the_vertical_alone_two_axes_are_in_question() {
        let about_vertical = |t: f64| Vector3::z() * (0.5 * t).sin().abs();
        let mut check = AxisCheck::default();
        let mut q = UnitQuaternion::identity();
        for i in 0..6000_i64 {
            let w = about_vertical(i as f64 * 0.01);
            q *= quaternion_exp(&(w * 0.01));
            check.on_imu(i * 10_000_000, &w, Some(&Vector3::new(0.0, 0.0, 9.81)));
            check.on_field(&(diagonal(1.0, -1.0, 1.0) * (q.inverse() * Vector3::new(0.0, 20.0, -40.0))));
        }
        let [force, field] = check.contradictions();
        assert_eq!((force, field.unwrap().to_string()), (None, "its axis x or y is reversed".to_owned()));
    }
}
