//! A demand in the scaled variables that solver, closed form and fallback share.
//!
//! Effector k runs over jets, then motors. Its value is x = lower + width v with v in 0..=1, and
//! torque is measured in units of `scale`, the strongest free effector's reach, so that all that
//! follows is dimensionless and of order one:
//!
//! sum a_k v_k + o = alpha t,  a_k = width_k b_k / scale,  o = sum lower_k b_k / scale,  t = tau / scale.
//!
//! Effectors that cannot move (failed, out of mode, equal bounds) have a_k = 0.

use nalgebra::Vector3;

use crate::demand::TorqueDemand;
use crate::effectors::Effectors;

/// Curvature that makes the optimum unique, relative to the smallest jet cost: by
/// u^2 <= u it raises the gas above the linear optimum by at most half of this.
const RELATIVE_CURVATURE: f64 = 2e-4;

#[derive(Debug, Clone, Default)]
pub(crate) struct Problem {
    pub jets: usize,
    pub lower: Vec<f64>,
    pub width: Vec<f64>,
    /// a_k
    pub columns: Vec<Vector3<f64>>,
    /// Effectors that can move.
    pub free: Vec<bool>,
    /// o
    pub offset: Vector3<f64>,
    /// t
    pub torque: Vector3<f64>,
    /// Unit of torque [N m].
    pub scale_n_m: f64,
    /// Linear cost of v_k, in units of the thirstiest jet fully open.
    pub linear: Vec<f64>,
    /// Second derivative of the cost of v_k.
    pub curvature: Vec<f64>,
    /// Smallest jet curvature before scaling by width.
    pub curvature_unit: f64,
    /// Net force per v_k, and of the lower bounds, in units of the strongest jet; empty when off.
    pub force_columns: Vec<Vector3<f64>>,
    pub force_offset: Vector3<f64>,
    pub force_weight: f64,
}

impl Problem {
    /// Fills the buffers from a demand that has been checked.
    pub fn fill(&mut self, effectors: &Effectors, demand: &TorqueDemand) {
        let layout = effectors.layout();
        let jets = effectors.jets();
        let count = jets + effectors.motors();
        self.jets = jets;
        self.lower.clear();
        self.width.clear();
        self.free.clear();
        self.columns.clear();
        self.linear.clear();
        self.curvature.clear();
        self.force_columns.clear();
        self.force_offset = Vector3::zeros();
        self.force_weight = demand.net_force_weight;

        let jet_bounds = demand.jet_on_fraction_min.iter().zip(&demand.jet_on_fraction_max);
        for (j, (&min, &max)) in jet_bounds.enumerate() {
            self.push_bounds(if !demand.jet_available.contains(j) {
                (0.0, 0.0)
            } else if demand.mode.uses_jets() {
                (min, max)
            } else {
                (min, min)
            });
        }
        let min = &demand.motor_min;
        for (&min, &max) in min.iter().zip(&demand.motor_max) {
            let rest = 0.0_f64.clamp(min, max);
            self.push_bounds(if demand.mode.uses_motors() { (min, max) } else { (rest, rest) });
        }

        let reach = |k: usize| {
            // Most cannot move: jets, where motors alone do.
            if self.width[k] > 0.0 { effectors.column(k).norm() * self.width[k] } else { 0.0 }
        };
        let strongest = (0..count).map(reach).fold(0.0, f64::max);
        self.scale_n_m = if strongest > 0.0 { strongest } else { 1.0 };
        self.offset = Vector3::zeros();
        for k in 0..count {
            let (lower, width) = (self.lower[k], self.width[k]);
            if lower == 0.0 && width == 0.0 {
                self.columns.push(Vector3::zeros());
                continue;
            }
            let column = effectors.column(k) / self.scale_n_m;
            self.columns.push(column * width);
            self.offset += column * lower;
        }
        // Opposite motors at their lower bounds may cancel to rounding: that is a zero.
        let rounding = 1e-14 * self.lower.iter().map(|lower| lower.abs()).sum::<f64>();
        if self.offset.norm() * self.scale_n_m <= rounding {
            self.offset = Vector3::zeros();
        }
        self.torque = demand.torque_b_n_m / self.scale_n_m;

        let rates = &layout.jet_gas_rate_kg_s;
        let thirstiest = rates.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let thriftiest = rates.iter().copied().fold(thirstiest, f64::min);
        self.curvature_unit = RELATIVE_CURVATURE * thriftiest / thirstiest;
        for (j, rate) in rates.iter().enumerate() {
            let (lower, width) = (self.lower[j], self.width[j]);
            self.push_cost(width, rate / thirstiest + self.curvature_unit * lower, self.curvature_unit);
        }
        for (i, limit) in layout.motor_limit.iter().enumerate() {
            let (lower, width) = (self.lower[jets + i], self.width[jets + i]);
            let weight = demand.motor_weight + self.curvature_unit;
            let miss = (lower - demand.motor_desired[i]) / limit;
            self.push_cost(width, weight * miss / limit, weight / (limit * limit));
        }
        if let (true, Some(force)) = (demand.net_force_weight > 0.0, &layout.jet_force_b_n) {
            let strongest = force.column_iter().map(|f| f.norm()).fold(f64::MIN_POSITIVE, f64::max);
            for (j, column) in force.column_iter().enumerate() {
                self.force_columns.push(column * (self.width[j] / strongest));
                self.force_offset += column * (self.lower[j] / strongest);
            }
        }
    }

    fn push_bounds(&mut self, (lower, upper): (f64, f64)) {
        self.lower.push(lower);
        self.width.push(upper - lower);
        self.free.push(upper > lower);
    }

    fn push_cost(&mut self, width: f64, slope: f64, curvature: f64) {
        if width > 0.0 {
            self.linear.push(width * slope);
            self.curvature.push(width * width * curvature);
        } else {
            // Held at v = 0 by a cost of its own: a variable with equal bounds has no interior.
            self.linear.push(1.0);
            self.curvature.push(1.0);
        }
    }

    /// Number of effectors.
    pub fn len(&self) -> usize {
        self.columns.len()
    }

    /// sum a_k v_k + o
    pub fn torque_of(&self, v: &[f64]) -> Vector3<f64> {
        self.columns.iter().zip(v).fold(self.offset, |sum, (a, &v)| sum + a * v)
    }

    /// Value of effector k in its own unit, inside its bounds to the last bit.
    pub fn value(&self, k: usize, v: f64) -> f64 {
        let (lower, width) = (self.lower[k], self.width[k]);
        (lower + width * v.clamp(0.0, 1.0)).clamp(lower, lower + width)
    }

    /// v at which effector k is nearest to rest.
    pub fn rest(&self, k: usize) -> f64 {
        if self.width[k] > 0.0 { (-self.lower[k] / self.width[k]).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// True when every effector may be at rest and nothing is asked of any.
    pub fn asks_nothing(&self, demand: &TorqueDemand) -> bool {
        let wanted = demand.motor_weight > 0.0 && demand.motor_desired.iter().any(|&torque| torque != 0.0);
        self.torque == Vector3::zeros()
            && !wanted
            && (0..self.len()).all(|k| self.lower[k] <= 0.0 && self.lower[k] + self.width[k] >= 0.0)
    }
}
