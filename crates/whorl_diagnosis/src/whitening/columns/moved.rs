//! The platform moved a little along one column, and what of it then differs.

use nalgebra::Vector3;
use whorl_dynamics::{Effect, EffectKind, Environment, Gyrostat, TrueImu};

use crate::DiagnosisError;
use crate::parameters::{Column, Point, Reference, Target};
use crate::whitening::mechanics::Mechanics;

/// Share of a column's unit by which values are changed to see the difference.
const DIFFERENCE: f64 = 0.1;

/// Shares of that change that are tried in turn, until a platform can be so.
const SHARES: [f64; 5] = [1.0, -1.0, 0.1, -0.1, 0.01];

/// The platform moved along a column.
#[derive(Debug, Clone)]
pub(crate) struct Moved {
    pub mechanics: Mechanics,
    /// By how many units.
    pub units: f64,
    /// Readings differ along the same motion.
    pub readings: bool,
    /// Valves open or shut at other times.
    pub valves: bool,
    /// How the motion differs, if it does.
    pub motion: Option<Way>,
}

/// How the accelerations differ.
#[derive(Debug, Clone)]
pub(crate) enum Way {
    /// By the torque of one effect, all constants of the platform being the same.
    Torque(OneEffect),
    /// Only while jets flow.
    Jets,
    /// Anyhow.
    Whole,
}

/// One effect before and after.
#[derive(Debug, Clone)]
pub(crate) struct OneEffect {
    pub effect: &'static dyn Effect,
    /// `None`: it was not there.
    pub before: Option<Vec<f64>>,
    pub after: Vec<f64>,
    pub hidden_states: usize,
}

impl Moved {
    /// Moves along `column` from `point`, where the platform is `base`.
    pub fn new(
        base: &Mechanics,
        reference: &Reference,
        point: &Point,
        column: &Column,
    ) -> Result<Self, DiagnosisError> {
        let mut units = DIFFERENCE;
        if column.quadratic {
            units = 1.0;
        } else if column.name == "range_rad_s" || column.name == "angle_rad" {
            // What lies beyond a limit is small: so must be the step.
            units *= 0.02;
        } else if column.is_shape {
            // A tenth of a usual frequency would be many turns by the end of a run.
            units *= 0.002;
        }
        if column.range.1 < units + reference.distance(point, column) {
            units = -units;
        }
        // At the edge of what a platform can be, only a step the other way or a small one stays within.
        let moved = |share: f64| {
            let model = reference.model_at(&reference.moved(point, column, share * units))?;
            Ok::<_, DiagnosisError>((Mechanics::new(&model)?, share * units))
        };
        let [first, others @ ..] = SHARES;
        let (mechanics, units) = others
            .into_iter()
            .fold(moved(first), |found, share| found.or_else(|e| moved(share).map_err(|_| e)))?;
        let (readings, motion) = match column.target {
            Target::Moment(_) => (false, Some(Way::Whole)),
            Target::Effect(effect) if effect.info().kind == EffectKind::Sensor => (true, None),
            Target::Effect(effect) => (
                touches_sensors(&base.gyrostat, &mechanics.gyrostat),
                Some(Way::of(&base.gyrostat, &mechanics.gyrostat, effect)),
            ),
        };
        let valves = !mechanics.gyrostat.has_valves_of(&base.gyrostat);
        Ok(Self { mechanics, units, readings, valves, motion })
    }
}

impl Way {
    fn of(base: &Gyrostat, moved: &Gyrostat, effect: &'static dyn Effect) -> Self {
        let (a, b) = (base.model(), moved.model());
        let lag = base.thrust_lag() != moved.thrust_lag();
        let thrust = thrust_factor(base) != thrust_factor(moved);
        let jets = a.jets() != b.jets() || a.tank() != b.tank() || lag || thrust;
        let gyros = a.gyros() != b.gyros();
        let platform = gyros || a.wheels() != b.wheels() || a.mass_properties != b.mass_properties;
        let values = |gyrostat: &Gyrostat| {
            let mut active = gyrostat.effects().iter();
            active.find(|e| e.effect().info().id == effect.info().id).map(|e| e.values().to_vec())
        };
        if valve_delay_s(base) != valve_delay_s(moved) {
            return Self::Whole;
        }
        match (jets, platform, values(moved)) {
            (true, false, _) => Self::Jets,
            (false, false, Some(after)) => Self::Torque(OneEffect {
                effect,
                before: values(base),
                after,
                hidden_states: effect.hidden_states(b),
            }),
            _ => Self::Whole,
        }
    }
}

/// A platform at rest whose bus is low by 1 V.
fn low_bus(gyrostat: &Gyrostat) -> Environment<'_> {
    let model = gyrostat.model();
    let mut environment = Environment::new(model, nalgebra::UnitQuaternion::identity(), Vector3::zeros());
    environment.bus_voltage_v -= 1.0;
    environment
}

/// Delays that effects give to the valves when the bus is low by 1 V.
fn valve_delay_s(gyrostat: &Gyrostat) -> (f64, f64) {
    gyrostat.effects().valve_delay_s(&low_bus(gyrostat))
}

/// The factor that effects give to all thrust when the bus is low by 1 V.
fn thrust_factor(gyrostat: &Gyrostat) -> f64 {
    gyrostat.effects().thrust_factor(&low_bus(gyrostat))
}

fn touches_sensors(base: &Gyrostat, moved: &Gyrostat) -> bool {
    if base.model().sensors != moved.model().sensors {
        return true;
    }
    let q = nalgebra::UnitQuaternion::from_euler_angles(0.1, -0.2, 0.7);
    let mut environment = Environment::new(base.model(), q, Vector3::new(0.1, 0.2, -0.3));
    environment.time_s = 12.3;
    environment.temperature_k += 3.0;
    let read = |gyrostat: &Gyrostat| {
        let mut imu = TrueImu {
            angular_velocity_b_rad_s: environment.omega_wb_b_rad_s,
            specific_force_b_m_s2: Vector3::new(0.3, -0.2, 9.8),
        };
        gyrostat.effects().measure_imu(&environment, &mut imu);
        imu
    };
    read(base) != read(moved)
}
